"""The journal of marking: every action appended as a line and forced to the disk, and read again after any crash.

A line is a JSON object whose last key is the CRC-32 of what comes before it (RFC 1952, as zlib):
``{"n":17,"at":"2026-05-01T10:20:30Z","do":"role","point":"A","role":"check","crc":"89abcdef"}``. Line 1 has ``n`` 0 and
names the format. What stands after the last whole record, where a process or the power has failed, is no data.
"""

from __future__ import annotations

import fcntl
import gc
import json
import os
import stat
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock
from types import TracebackType

from photogram.errors import ControlPointError, WorkspaceError
from photogram.files.marks.marks import ROLES, Mark, NewPoint, Proposal
from photogram.files.reading import read_whole
from photogram.marking.files.actions import (
    Action,
    AddPoint,
    ConfirmProposals,
    MarkState,
    PlaceMarks,
    Redo,
    RemoveMarks,
    Replay,
    SetNotVisible,
    SetRole,
    Undo,
)

FORMAT = 1
MOST_BYTES = 1_000_000_000
_AT_ONCE = 1000
"""Lines parsed in one call, which takes a third of the time that single ones take."""

_SEAL = len(',"crc":"00000000"}')
Record = Mapping[str, object]


@dataclass(frozen=True)
class Torn:
    """What stood at the end of a journal and was no whole record."""

    line: int
    """Its line."""
    size: int
    """Its length in bytes."""

    def __str__(self) -> str:
        return f"line {self.line} was cut off when it was written, its {self.size} bytes are left out"


@dataclass(frozen=True)
class JournalContent:
    """What a journal holds."""

    actions: tuple[Action, ...]
    """The actions in their order."""
    torn: Torn | None
    """What follows the last whole record, None where nothing does."""
    length: int
    """Length in bytes of the whole records."""


def utc_now() -> str:
    """Return the time as marks and journals have it, 2026-05-01T10:20:30Z."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


# ---- records -------------------------------------------------------------------------------------------------------


def _sealed(record: Record) -> bytes:
    body = json.dumps(record, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    return body[:-1] + b',"crc":"%08x"}\n' % zlib.crc32(body[:-1])


_HEADER = _sealed({"n": 0, "journal": "photogram marks", "format": FORMAT})


def _is_whole(line: bytes) -> bool:
    body = line[:-_SEAL]
    return len(line) > _SEAL and line[-_SEAL:] == b',"crc":"%08x"}' % zlib.crc32(body)


def _from_mark(mark: Mark) -> Record:
    record: dict[str, object] = {
        "point": mark.point,
        "photograph": mark.photograph,
        "u": mark.pixel[0],
        "v": mark.pixel[1],
    }
    if mark.sigma_px is not None:
        record |= {"sigma_u": mark.sigma_px[0], "sigma_v": mark.sigma_px[1], "rho": mark.rho}
    elif mark.rho:
        record["rho"] = mark.rho
    record |= {"kind": mark.kind, "time": mark.time}
    if mark.raw_pixel is not None:
        record |= {"raw_u": mark.raw_pixel[0], "raw_v": mark.raw_pixel[1]}
    if mark.is_doubtful:
        record["doubtful"] = True
    return record


def _from_action(action: Action) -> Record:
    if isinstance(action, PlaceMarks):
        return {"do": "mark", "marks": [_from_mark(mark) for mark in action.marks]}
    if isinstance(action, ConfirmProposals):
        proposals = [{**_from_mark(p.mark), "score": p.score} for p in action.proposals]
        return {"do": "confirm", "proposals": proposals}
    if isinstance(action, RemoveMarks):
        return {"do": "remove", "places": action.places}
    if isinstance(action, SetNotVisible):
        visible = {"visible": True} if action.is_visible else {}
        return {"do": "not_visible", "point": action.point, "photograph": action.photograph, **visible}
    if isinstance(action, SetRole):
        return {"do": "role", "point": action.point, "role": action.role}
    if isinstance(action, AddPoint):
        point = action.point
        given = {"position": point.position, "sigma_m": point.sigma_m, "crs": point.crs}
        return {"do": "point", "name": point.name, **{k: v for k, v in given.items() if v is not None}}
    return {"do": "undo" if isinstance(action, Undo) else "redo"}


def _text(record: Record, key: str) -> str:
    value = record[key]
    if not isinstance(value, str):
        raise TypeError(key)
    return value


def _number(value: object) -> float:
    if type(value) is float:  # nearly always, and far quicker told
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError("number")
    return float(value)


def _three(record: Record, key: str) -> tuple[float, float, float] | None:
    if key not in record:
        return None
    x, y, z = (_number(value) for value in _list(record, key))
    return x, y, z


def _list(record: Record, key: str) -> list[object]:
    value = record[key]
    if not isinstance(value, list):
        raise TypeError(key)
    return value


def _object(value: object) -> Record:
    if not isinstance(value, dict):
        raise TypeError("object")
    return value


def _to_mark(record: Record) -> Mark:
    point, photograph, kind, time = record["point"], record["photograph"], record["kind"], record["time"]
    if not (isinstance(point, str) and isinstance(photograph, str) and isinstance(kind, str) and isinstance(time, str)):
        raise TypeError("text")
    return Mark(
        point,
        photograph,
        (_number(record["u"]), _number(record["v"])),
        (_number(record["sigma_u"]), _number(record["sigma_v"])) if "sigma_u" in record else None,
        _number(record["rho"]) if "rho" in record else 0.0,
        kind,
        time,
        (_number(record["raw_u"]), _number(record["raw_v"])) if "raw_u" in record else None,
        record.get("doubtful") is True,
    )


def _to_proposal(record: Record) -> Proposal:
    return Proposal(_to_mark(record), _number(record["score"]))


def _to_place(value: object) -> tuple[str, str]:
    point, photograph = _list({"place": value}, "place")
    if not isinstance(point, str) or not isinstance(photograph, str):
        raise TypeError("place")
    return point, photograph


def _to_role(record: Record) -> SetRole:
    role = next(role for role in ROLES if role == record["role"])
    return SetRole(_text(record, "point"), role)


def _to_point(record: Record) -> AddPoint:
    crs = _text(record, "crs") if "crs" in record else None
    return AddPoint(NewPoint(_text(record, "name"), _three(record, "position"), _three(record, "sigma_m"), crs))


def _to_action(record: Record) -> Action:
    """Return the action of a record. Raises KeyError, TypeError, ValueError or StopIteration where it is none."""
    do = record["do"]
    if do == "mark":
        return PlaceMarks(tuple(_to_mark(_object(value)) for value in _list(record, "marks")))
    if do == "confirm":
        return ConfirmProposals(tuple(_to_proposal(_object(value)) for value in _list(record, "proposals")))
    if do == "remove":
        return RemoveMarks(tuple(_to_place(value) for value in _list(record, "places")))
    if do == "not_visible":
        return SetNotVisible(_text(record, "point"), _text(record, "photograph"), record.get("visible") is True)
    if do == "role":
        return _to_role(record)
    if do == "point":
        return _to_point(record)
    if do == "undo":
        return Undo()
    if do == "redo":
        return Redo()
    raise KeyError("do")


# ---- reading -------------------------------------------------------------------------------------------------------


@contextmanager
def _without_collection() -> Iterator[None]:
    """Keep the collector of cycles from going through what is read over and over: there are none in it, and it takes a
    third of the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _content(path: Path, data: bytes) -> JournalContent:
    if not data or (len(data) < len(_HEADER) and (_HEADER.startswith(data) or not data.strip(b"\0"))):
        return JournalContent((), Torn(1, len(data)) if data else None, 0)
    lines = data.split(b"\n")
    whole = 0
    for line in lines[:-1]:
        if not _is_whole(line):
            break
        whole += 1
    if not whole or b'"journal":"photogram marks"' not in lines[0]:
        raise WorkspaceError(f"{path}:1: is not a journal of marks, or its first line is damaged: restore a copy of it")
    if any(map(_is_whole, lines[whole:])) and len(lines) > whole + 1:
        raise WorkspaceError(
            f"{path}:{whole + 1}: the record is damaged, and whole ones follow it: restore a copy of the file, "
            "or remove this line and all after it"
        )
    actions = []
    for number, record in enumerate(_records(path, lines[:whole])):
        if number:
            actions.append(_action(path, number, record))
        elif record.get("format") != FORMAT:
            raise WorkspaceError(
                f"{path}:1: has format {record.get('format')}, this photogram reads {FORMAT}: install a newer photogram"
            )
    length = sum(len(line) + 1 for line in lines[:whole])
    return JournalContent(tuple(actions), Torn(whole + 1, len(data) - length) if len(data) > length else None, length)


def _records(path: Path, lines: Sequence[bytes]) -> Iterator[Record]:
    for begin in range(0, len(lines), _AT_ONCE):
        some = lines[begin : begin + _AT_ONCE]
        try:
            found: list[object] = json.loads(b"[" + b",".join(some) + b"]")
        except (ValueError, RecursionError):
            found = []
        if len(found) != len(some):
            found = [_parsed(path, begin + i, line) for i, line in enumerate(some)]
        for number, record in enumerate(found, begin):
            if not isinstance(record, dict) or record.get("n") != number:
                raise WorkspaceError(
                    f"{path}:{number + 1}: has not the number {number}, so lines are missing or came from another "
                    "process: restore a copy of the file, or remove this line and all after it"
                )
            yield record


def _parsed(path: Path, number: int, line: bytes) -> object:
    try:
        return json.loads(line)
    except (ValueError, RecursionError) as fault:
        raise WorkspaceError(f"{path}:{number + 1}: is no JSON: restore a copy of the file") from fault


def _action(path: Path, number: int, record: Record) -> Action:
    try:
        return _to_action(record)
    except (KeyError, TypeError, ValueError, StopIteration) as fault:
        why = str(fault) if isinstance(fault, ControlPointError) else f"no action that this photogram knows ({fault})"
        raise WorkspaceError(f"{path}:{number + 1}: {why}: install the photogram that wrote it") from fault


def read_journal(path: Path) -> JournalContent:
    """Return the actions of a journal, without touching it.

    A last record that was cut off is left out and told. Raises WorkspaceError where the file cannot be read or is no
    journal, and where a record is damaged that others follow.
    """
    try:
        data = read_whole(path, MOST_BYTES)
    except OSError as fault:
        raise WorkspaceError(f"{path}: cannot be read ({fault.strerror}): check its name and folder") from fault
    with _without_collection():
        return _content(path, data)


# ---- writing -------------------------------------------------------------------------------------------------------


class Journal:
    """A journal open for one process: its threads may append at the same time.

    Opening makes the file where there is none, and cuts off what a crash has left half written (``torn`` says what).
    Raises WorkspaceError where another process has it open, where it cannot be written, and as ``read_journal`` does.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = Lock()
        self._file = _opened(path)
        try:
            self._replay = Replay()
            with _without_collection():
                content = _content(path, _all_of(self._file))
                for action in content.actions:
                    self._replay.do(action)
            self.torn = content.torn
            self._sequence, self._length = len(content.actions), content.length
            if self.torn:
                os.ftruncate(self._file, self._length)
                os.fsync(self._file)
            if not self._length:
                self._write(_HEADER)
                _sync_folder(path)
        except OSError as fault:
            os.close(self._file)
            if isinstance(fault, WorkspaceError):
                raise
            raise _unwritable(path, fault) from fault
        except BaseException:
            os.close(self._file)
            raise

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; nothing is appended afterwards."""
        with self._lock:
            if self._file >= 0:
                os.close(self._file)
                self._file = -1

    @property
    def sequence(self) -> int:
        """The number of the last action, 0 before the first."""
        with self._lock:
            return self._sequence

    @property
    def state(self) -> MarkState:
        """What follows from the actions so far."""
        with self._lock:
            return self._replay.state()

    def append(self, action: Action) -> int:
        """Append an action and return its number, when it is on the disk.

        Raises WorkspaceError where it cannot be written; it was not done then.
        """
        with self._lock:
            if self._file < 0:
                raise WorkspaceError(f"{self.path}: the journal is closed: open it again")
            number = self._sequence + 1
            line = _sealed({"n": number, "at": utc_now(), **_from_action(action)})
            try:
                self._write(line)
            except OSError as fault:
                self._take_back()
                raise _unwritable(self.path, fault) from fault
            self._sequence = number
            self._replay.do(action)
            return number

    def _write(self, line: bytes) -> None:
        rest = memoryview(line)
        while rest:
            rest = rest[os.write(self._file, rest) :]
        os.fsync(self._file)
        self._length += len(line)

    def _take_back(self) -> None:
        """Cut off what was written of a record; where not even that can be done, nothing more is appended."""
        try:
            os.ftruncate(self._file, self._length)
            os.fsync(self._file)
        except OSError:
            os.close(self._file)
            self._file = -1


def _opened(path: Path) -> int:
    """Return a descriptor to append to, of an ordinary file that no other process has open."""
    try:
        file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except OSError as fault:
        raise _unwritable(path, fault) from fault
    try:
        if not stat.S_ISREG(os.fstat(file).st_mode):
            raise WorkspaceError(f"{path}: is no ordinary file: choose another name for the journal")
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as fault:
        os.close(file)
        raise WorkspaceError(
            f"{path}: another process has it open: use that one, or end it before this one begins"
        ) from fault
    except OSError as fault:
        os.close(file)
        raise fault if isinstance(fault, WorkspaceError) else _unwritable(path, fault) from fault
    return file


def _all_of(file: int) -> bytes:
    size = os.fstat(file).st_size
    if size > MOST_BYTES:
        raise OSError(0, f"it has {size / 1e6:.0f} MB, at most {MOST_BYTES / 1e6:.0f} MB are read here")
    return b"".join(_pieces(file, size))


def _pieces(file: int, size: int) -> Sequence[bytes]:
    pieces, place = [], 0
    while place < size:
        piece = os.pread(file, size - place, place)
        if not piece:
            break
        pieces.append(piece)
        place += len(piece)
    return pieces


def _sync_folder(path: Path) -> None:
    """Force the name of a new file to the disk."""
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _unwritable(path: Path, fault: OSError) -> WorkspaceError:
    return WorkspaceError(
        f"{path}: cannot be written ({fault.strerror or fault}): check that the folder exists, may be written to "
        "and has free space"
    )
