"""What reaches the terminal: photogram's own words, in whatever characters the terminal has."""

import codecs
import io
import logging
import os
import re
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType

from photogram.wording import THIN_SPACE, printable

_PLAIN = {THIN_SPACE: " ", "–": "-", "…": "...", "×": "x", "σ": "sigma", "≤": "<=", "→": "->", "√": "sqrt"}
"""Of characters that the code pages of Windows, for one, lack."""


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Answer a character that the terminal has not: as a handler of errors of codecs."""
    if isinstance(error, UnicodeEncodeError) and error.object[error.start] in _PLAIN:
        return _PLAIN[error.object[error.start]], error.start + 1
    answer, place = codecs.backslashreplace_errors(error)
    return str(answer), place


codecs.register_error("photogram", _plain)


def prepare_streams() -> logging.Handler:
    """Let nothing reach the terminal raw; returns the handler that keeps the log silent.

    Characters that the terminal has not stand as plain ones or as escapes; warnings and messages of libraries go to
    the log, which -v shows, and so do exceptions that compiled code cannot hand on; what libraries in C write to
    standard error past Python is dropped, unless -vv is asked for.
    """
    if not _very_verbose():
        _keep_standard_error()
        # compiled code prints through the first, then names the place through the second
        sys.excepthook = _log_exception
        sys.unraisablehook = _log_unraisable
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="photogram")
    silent = logging.NullHandler()
    logging.getLogger().addHandler(silent)  # without any handler Python prints warnings
    logging.captureWarnings(True)
    return silent


@contextmanager
def nothing_raw() -> Iterator[list[BaseException]]:
    """Prepare the streams while the block runs, and collect in the list given what a thread raises that nobody waits
    for."""
    unwatched: list[BaseException] = []
    show_warning, hooks = warnings.showwarning, (sys.excepthook, sys.unraisablehook, threading.excepthook)
    silent = prepare_streams()
    captured_before = warnings.showwarning is show_warning
    threading.excepthook = lambda raised: unwatched.append(raised.exc_value or raised.exc_type())
    try:
        yield unwatched
    finally:
        sys.excepthook, sys.unraisablehook, threading.excepthook = hooks
        if not captured_before:
            logging.captureWarnings(False)
        logging.getLogger().removeHandler(silent)


class _Printable(logging.Formatter):
    """Lines of the log in which control characters, of a file's name for example, stand as escapes."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        return printable(super().format(record))


def show_log() -> Callable[[], None]:
    """Show photogram's own log and the warnings of libraries on standard error; returns what ends that."""
    root, own = logging.getLogger(), logging.getLogger("photogram")
    handler, level = logging.StreamHandler(), own.level
    handler.setFormatter(_Printable("%(name)s: %(message)s"))
    root.addHandler(handler)
    own.setLevel(logging.DEBUG)

    def end() -> None:
        own.setLevel(level)
        root.removeHandler(handler)

    return end


def _log_exception(_kind: type[BaseException], raised: BaseException, _trace: TracebackType | None) -> None:
    logging.getLogger("photogram").warning("compiled code raised %r", raised)


def _log_unraisable(ignored: "sys.UnraisableHookArgs") -> None:
    logging.getLogger("photogram").warning("%r is ignored in %r", ignored.exc_value, ignored.object)


def _very_verbose() -> bool:
    letters = sum(len(word) - 1 for word in sys.argv[1:] if re.fullmatch("-v+", word))
    return letters + sys.argv[1:].count("--verbose") > 1


def _keep_standard_error() -> None:
    """Keep the process's standard error to Python: libtiff, for one, writes to it past every handler."""
    try:
        if sys.stderr.fileno() != 2:
            return  # a test, or a program that has its own
    except (AttributeError, OSError, ValueError):
        return  # there is none
    own = os.dup(2)
    sys.stderr = io.TextIOWrapper(
        os.fdopen(own, "wb"), encoding=sys.stderr.encoding, errors="photogram", line_buffering=True
    )
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)
