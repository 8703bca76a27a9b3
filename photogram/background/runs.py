"""Commands that work for hours, each in a process of its own: a page that is closed or a server that ends stops none.

What runs is `photogram adjust --json` or `photogram deliver`, as in a terminal, or another module that says events. Its
output goes to files in a folder of their own, from which this server, or the next one, reads what it does. Whether it
still runs is told by a lock that the process holds as long as it lives.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Literal, NotRequired

import psutil
from typing_extensions import TypedDict

from photogram.background.runner import IS_TAKEN
from photogram.errors import WorkspaceError
from photogram.files.atomic import make_folder, make_folder_within, replacing
from photogram.files.portable import try_lock
from photogram.languages.said import Said
from photogram.terminal.events import Event

NOTE, LOCK, OUTPUT, ERRORS, END = "run.json", "run.lock", "output.txt", "errors.txt", "end.json"
RunState = Literal["none", "running", "paused", "done", "failed", "stopped"]
RunKind = Literal["adjust", "deliver", "task"]
"""All but `deliver` say events."""

COMMAND = "photogram.cli.main"
"""The module of photogram's own command."""

MOST_EVENTS = 2000
"""That are handed on at once."""

_MOST_ERROR_CHARACTERS = 4000
_INTERRUPTED = 130
HAS_GROUPS = os.name == "posix"
"""Whether processes have groups, which can be interrupted as Ctrl-C does it."""
UNDER_WAY = Said("a run is under way already: wait for its end, or stop it first")


class RunNote(TypedDict):
    """What is kept of a run that was started."""

    pid: int
    kind: RunKind
    arguments: list[str]
    began_unix_s: float
    paused: bool
    stopped: NotRequired[bool]
    """Whether somebody has ended it; earlier versions did not say so."""


@dataclass(frozen=True)
class RunView:
    """What a run does, or has done."""

    state: RunState
    kind: RunKind | None
    began_unix_s: float | None
    events: tuple[Event, ...]
    """From the one that was asked for on; none of `deliver`."""
    next: int
    """Number of the event that comes next."""
    last: Event | None
    """The newest of all."""
    text: str
    """What the process wrote on standard error, and where it ended without a word, how."""
    lang: str | None = None
    """Which HTML calls the language of ``text`` where that is always the same."""
    exit_code: int | None = None
    """Of a process that ended by itself; negative where a signal ended it."""


class Runs:
    """The runs of one survey, of which no two go on at a time; ``folder`` is theirs alone, within one that is made for
    it. May be asked from several threads at once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._one_at_a_time = Lock()
        self._child: subprocess.Popen[bytes] | None = None

    def start(self, kind: RunKind, arguments: Sequence[str], module: str = COMMAND) -> None:
        """Start a command of photogram, or another module. Raises WorkspaceError where one runs already, or the folder
        cannot be written."""
        make_folder(self._folder.parent)
        make_folder_within(self._folder)
        with self._one_at_a_time:
            with (self._folder / LOCK).open("ab") as lock:
                if not try_lock(lock.fileno()):
                    raise WorkspaceError(UNDER_WAY)
                (self._folder / END).unlink(missing_ok=True)
                self._child = self._started(module, arguments)
                self._write(
                    {
                        "pid": self._child.pid,
                        "kind": kind,
                        "arguments": list(arguments),
                        "began_unix_s": time.time(),
                        "paused": False,
                        "stopped": False,
                    }
                )
            while not self._alive():  # until the process has the lock that was given free here
                if self._child.poll() is not None:
                    if self._child.returncode == IS_TAKEN:
                        raise WorkspaceError(UNDER_WAY)
                    return
                time.sleep(0.05)

    def _started(self, module: str, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
        places = str(self._folder / LOCK), str(self._folder / END)
        with (self._folder / OUTPUT).open("wb") as out, (self._folder / ERRORS).open("wb") as errors:
            return subprocess.Popen(
                [sys.executable, "-m", "photogram.background.runner", *places, module, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=errors,
                start_new_session=True,
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
            )

    def pause(self) -> None:
        """Hold the run, which keeps its memory and takes no processor time."""
        self._do(_suspend, paused=True)

    def resume(self) -> None:
        """Go on with a run that is held."""
        self._do(_resume, paused=False)

    def stop(self) -> None:
        """End the run; stages that are finished, and pieces of the one under way, are kept."""
        self._do(_end, paused=False, stopped=True)

    def kill(self) -> None:
        """End a run that does not end in order; what its stages have written is whole."""
        self._do(_kill, paused=False, stopped=True)

    def goes_on(self) -> bool:
        """Return whether the last run has a process still, held or not."""
        with self._one_at_a_time:
            if self._child is not None:
                self._child.poll()
            return self._alive()

    def view(self, after: int = 0) -> RunView:
        """Return what the last run does, with its events from number ``after`` on."""
        with self._one_at_a_time:
            note, alive = self._note(), self._alive()
        if note is None:
            return RunView("none", None, None, (), 0, None, "")
        lines = self._lines() if note["kind"] != "deliver" else []
        events = tuple(json.loads(line) for line in lines[after : after + MOST_EVENTS])
        code = None if alive else self._exit_code()
        state, text = self._outcome(note, alive, code)
        last = json.loads(lines[-1]) if lines else None
        lang = None if isinstance(text, Said) else "en"
        return RunView(state, note["kind"], note["began_unix_s"], events, after + len(events), last, text, lang, code)

    def _outcome(self, note: RunNote, alive: bool, code: int | None) -> tuple[RunState, str]:
        text = self._text(ERRORS)[-_MOST_ERROR_CHARACTERS:]
        if alive:
            return ("paused" if note["paused"] else "running"), text
        if self._child is not None:
            self._child.poll()  # so that no process stays behind that has ended
        if code is None:
            return "failed", text or Said("It was ended from outside, or the machine was switched off: start it again.")
        if code in (_INTERRUPTED, -signal.SIGINT) or (code and note.get("stopped")):
            return "stopped", text
        if code < 0:
            reason = Said("memory ran out, most likely") if code == -signal.SIGKILL else signal.Signals(-code).name
            ended = Said("The system ended it ({reason}): close other programs and start it again.", reason=reason)
            return "failed", text or ended
        return ("done" if code == 0 else "failed"), text

    def _exit_code(self) -> int | None:
        try:
            return int(json.loads(self._text(END) or "{}")["exit_code"])
        except (KeyError, ValueError):
            return None

    def _lines(self) -> list[str]:
        """Return the whole lines of the events so far."""
        return self._text(OUTPUT).split("\n")[:-1]

    def _text(self, name: str) -> str:
        try:
            return (self._folder / name).read_text(encoding="utf-8", errors="replace")
        except FileNotFoundError:
            return ""

    def _note(self) -> RunNote | None:
        text = self._text(NOTE)
        note: RunNote | None = json.loads(text) if text else None
        return note

    def _write(self, note: RunNote) -> None:
        with replacing(self._folder / NOTE) as path:
            path.write_text(json.dumps(note))

    def _alive(self) -> bool:
        try:
            with (self._folder / LOCK).open() as lock:
                return not try_lock(lock.fileno(), shared=True)
        except FileNotFoundError:
            return False

    def _do(self, act: Callable[[int], None], *, paused: bool, stopped: bool = False) -> None:
        """Do something to the process of the run and those that it started, and note it; nothing where it has ended."""
        with self._one_at_a_time:
            note = self._note()
            if note is not None and self._alive():
                act(note["pid"])
                self._write({**note, "paused": paused, "stopped": stopped})


def _family(pid: int) -> list[psutil.Process]:
    """Return a process and those that it started, none where it has ended."""
    try:
        first = psutil.Process(pid)
        return [first, *first.children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def _suspend(pid: int) -> None:
    held = set[psutil.Process]()
    while new := [process for process in _family(pid) if process not in held]:  # what they start meanwhile is held too
        for process in new:
            with suppress(psutil.NoSuchProcess):
                process.suspend()
        held.update(new)


def _resume(pid: int) -> None:
    for process in _family(pid):
        with suppress(psutil.NoSuchProcess):
            process.resume()


def _kill(pid: int) -> None:
    for process in reversed(_family(pid)):
        with suppress(psutil.NoSuchProcess):
            process.kill()


def _end(pid: int) -> None:
    if HAS_GROUPS:
        with suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGINT)
        _resume(pid)
        return
    _resume(pid)
    for process in _family(pid)[1:]:  # no process can be interrupted here; what is written is whole
        with suppress(psutil.NoSuchProcess):
            process.terminate()
