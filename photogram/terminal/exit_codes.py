"""How the command ends: what the user reads of an error, and the exit code.

0 done; 1 an error that the user or the machine can fix; 2 wrong usage; 70 a defect of photogram; 130 interrupted.
"""

import errno
import os
import platform
import shlex
import sys
import tempfile
import traceback
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

from photogram import __version__
from photogram.errors import PhotogramError
from photogram.machine import cores
from photogram.wording import printable

FAILED, DEFECT, INTERRUPTED = 1, 70, 130
"""70 is EX_SOFTWARE of sysexits.h, 130 what shells give to a command ended by Ctrl-C."""

RESUMED = ("adjust", "demo", "study")
"""Commands that keep finished work and go on from there."""

_MACHINE = {
    errno.ENOSPC: "free some space",
    errno.EDQUOT: "free some of your quota",
    errno.EROFS: "write to another place",
    errno.EIO: "check the disk",
    errno.ESTALE: "check the network drive",
    errno.EMFILE: "raise the limit of open files (ulimit -n)",
    errno.ENFILE: "close other programs",
    errno.ENOMEM: "close other programs",
}
_NO_MEMORY = ("Insufficient memory", "annot allocate memory", "failed to map segment", "bad_alloc", "bad allocation")
"""What OpenCV, the loader of libraries and C++ say of it."""

_LONGEST_CHAIN = 20
_LIBRARIES = ("numpy", "scipy", "numba", "gtsam", "opencv-python-headless", "rasterio", "pyproj", "typer", "rich")


def say(text: str) -> None:
    """Write a line to standard error; control characters, of a file's name for example, stand as escapes."""
    if sys.stderr is not None:
        with suppress(OSError, ValueError):  # nowhere is left to say it: the exit code does
            sys.stderr.write(f"{printable(text)}\n")
            sys.stderr.flush()


def output_error(*, probe: bool = False) -> OSError | None:
    """Return why standard output cannot be written, None where it can.

    ``probe`` writes an empty line to find out: what could not be written before is forgotten by then.
    """
    if sys.stdout is None or sys.stdout.closed:
        return None
    try:
        if probe:
            sys.stdout.write("\n")
        sys.stdout.flush()
    except OSError as error:
        return error
    return None


def give_up_output() -> None:
    """Send what is still to be written to standard output nowhere, so that Python does not try again at its end."""
    with suppress(OSError, ValueError):  # a stream without a descriptor
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def say_output_error(error: OSError) -> int:
    """Say that standard output cannot be written; of a pipe that was closed, nothing. Returns the exit code."""
    give_up_output()
    if not isinstance(error, BrokenPipeError):
        say(f"photogram: standard output cannot be written ({error.strerror}): its results may be incomplete")
    return FAILED


def say_outcome(cause: BaseException, command: str | None, verbosity: int) -> int:
    """Say how the command ended, from what it raised, and return the exit code."""
    if isinstance(cause, KeyboardInterrupt):
        kept = "; finished work is kept, the same command resumes it" if command in RESUMED else ""
        say(f"photogram: interrupted{kept}")
        return INTERRUPTED
    if isinstance(cause, BrokenPipeError):
        return say_output_error(cause)
    if isinstance(cause, OSError) and cause.errno in _MACHINE and cause.filename is None:
        error = output_error(probe=True)
        if error is not None:
            return say_output_error(error)
    if verbosity > 1:
        say("".join(traceback.format_exception(cause)).rstrip())
    message = _fixable(cause)
    if message is None:
        return _say_defect(cause)
    say(f"photogram: {message}")
    return FAILED


def in_words(cause: BaseException) -> str:
    """Return what a program is told of what a command raised."""
    if isinstance(cause, KeyboardInterrupt):
        return "interrupted"
    return _fixable(cause) or f"a defect of photogram ({type(cause).__name__}: {cause})"


def _fixable(cause: BaseException) -> str | None:
    """Return the message of an error that the user or the machine can fix, None of any other."""
    if isinstance(cause, PhotogramError):
        return str(cause)
    if _lacks_memory(cause):
        return "out of memory: close other programs, or use smaller photographs (quality: medium) or larger cells"
    if isinstance(cause, RuntimeError) and "can't start new thread" in str(cause):
        return "no thread can be started: close other programs, or raise the limits of memory and processes (ulimit)"
    if isinstance(cause, OSError) and cause.errno in _MACHINE:
        place = f"{cause.filename}: " if cause.filename else ""
        return f"{place}{cause.strerror}: {_MACHINE[cause.errno]}, then run the command again"
    return None


def _lacks_memory(cause: BaseException) -> bool:
    """Return whether something was raised because there is no memory left, whatever a library has made of that."""
    at: BaseException | None = cause
    for _ in range(_LONGEST_CHAIN):
        if at is None:
            break
        if isinstance(at, MemoryError) or any(words in str(at) for words in _NO_MEMORY):
            return True
        at = at.__cause__ or at.__context__
    return False


def _say_defect(cause: BaseException) -> int:
    try:
        details = _details(cause)
    except MemoryError as error:
        say(f"photogram: {_fixable(error)}")
        return FAILED
    kind = f"{type(cause).__name__}: {cause}".splitlines()[0][:300]
    try:
        handle, path = tempfile.mkstemp(prefix="photogram-defect-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as stream:
            stream.write(details)
    except OSError as error:
        say(f"photogram: a defect of photogram ({kind}), please report it. No file of details ({error}); they are:")
        say(details)
    else:
        say(f"photogram: a defect of photogram ({kind}), please report it; details in {path}")
    return DEFECT


def _details(cause: BaseException) -> str:
    """Return what a report of a defect needs: version, machine, command line, traceback."""
    libraries = ", ".join(f"{name} {_version(name)}" for name in _LIBRARIES)
    return "\n".join(
        [
            f"photogram {__version__}",
            f"Python {sys.version}",
            f"platform {platform.platform()}, {cores()} processors",
            libraries,
            f"command {shlex.join(sys.argv)}",
            f"folder {_folder()}",
            "",
            "".join(traceback.format_exception(cause)),
        ]
    )


def _folder() -> str:
    try:
        return os.getcwd()
    except OSError as error:
        return str(error)


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
