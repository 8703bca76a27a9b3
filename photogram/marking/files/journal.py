"""The journal of marking: an SQLite database in which every action is on the disk before it is answered.

A row of its one table is an action, numbered from 1, with the CRC-32 (RFC 1952, as zlib) of what it says: SQLite
notices pages that do not fit together, not a digit that has changed. A database that photogram has not made is refused.
"""

from __future__ import annotations

import os
import sqlite3
import stat
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from threading import Lock
from types import GenericAlias, TracebackType
from typing import cast

from pydantic import ConfigDict, TypeAdapter, ValidationError

from photogram.errors import WorkspaceError
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
from photogram.marking.files.text_journal import read_text_journal
from photogram.wording import printable, shortened

FORMAT = 1
MOST_BYTES = 1_000_000_000
_APPLICATION = 0x70676D6B
"""What says that a database is photogram's journal of marks: "pgmk"."""
_TABLE = (
    "CREATE TABLE actions (number INTEGER PRIMARY KEY, at TEXT NOT NULL, kind TEXT NOT NULL, fields TEXT NOT NULL, "
    "crc INTEGER NOT NULL)"
)
_INSERT = "INSERT INTO actions VALUES (?, ?, ?, ?, ?)"

_KINDS: dict[str, type[Action]] = {
    "mark": PlaceMarks,
    "confirm": ConfirmProposals,
    "remove": RemoveMarks,
    "not_visible": SetNotVisible,
    "role": SetRole,
    "point": AddPoint,
    "undo": Undo,
    "redo": Redo,
}


def utc_now() -> str:
    """Return the time as marks and journals have it, 2026-05-01T10:20:30Z."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


# ---- rows ----------------------------------------------------------------------------------------------------------


@cache
def _json_of(kind: str) -> TypeAdapter[tuple[Action]]:
    """Return what writes and reads an action as a JSON array of one; alone it would take no configuration."""
    array = cast("type[tuple[Action]]", GenericAlias(tuple, (_KINDS[kind],)))
    return TypeAdapter(array, config=ConfigDict(extra="forbid", strict=True))


def _crc(number: object, at: object, kind: object, fields: object) -> int:
    return zlib.crc32(f"{number} {at} {kind} {fields}".encode())


def _row(number: int, at: str, kind: str, fields: str) -> tuple[int, str, str, str, int]:
    return number, at, kind, fields, _crc(number, at, kind, fields)


def _row_of(number: int, action: Action) -> tuple[int, str, str, str, int]:
    kind = next(kind for kind, form in _KINDS.items() if isinstance(action, form))
    array = _json_of(kind).dump_json((action,), exclude_defaults=True)
    return _row(number, utc_now(), kind, array[1:-1].decode())


def _action(path: Path, number: int, kind: object, fields: object) -> Action:
    """Return the action of a row. Raises WorkspaceError where it is none."""
    if not isinstance(kind, str) or not isinstance(fields, str) or kind not in _KINDS:
        raise WorkspaceError(
            f"{path}: action {number}: unknown action {shortened(printable(str(kind)))!r}: install the photogram that "
            "wrote it"
        )
    try:
        return _json_of(kind).validate_json(f"[{fields}]")[0]
    except ValidationError as error:
        reason = shortened(printable(str(error.errors()[0]["msg"]).removeprefix("Value error, ")), 200)
        raise WorkspaceError(f"{path}: action {number}: {reason}: install the photogram that wrote it") from error


# ---- reading -------------------------------------------------------------------------------------------------------


def read_journal(path: Path) -> tuple[Action, ...]:
    """Return the actions of a journal, none where there is no journal, while another process may have it open.

    Raises WorkspaceError where it cannot be read, is damaged, or is no journal of photogram's.
    """
    actions = None
    if os.path.lexists(path):
        with _sqlite_errors(path), closing(_connected(path, "ro")) as database:
            actions = _stored_actions(path, database)
    if actions is None:
        actions = tuple(_action(path, n, kind, fields) for n, (_, kind, fields) in enumerate(_former_rows(path), 1))
    return actions


def _former_rows(path: Path) -> tuple[tuple[str, str, str], ...]:
    """Return time, kind and fields of the actions of a journal that an earlier photogram kept as text."""
    text = path.with_suffix(".jsonl")
    return read_text_journal(text, MOST_BYTES) if text.exists() else ()


def _connected(path: Path, mode: str) -> sqlite3.Connection:
    """Open a database that has no links or devices among its files, and can do nothing but give what is stored."""
    size = 0
    for suffix in ("", "-wal", "-shm", "-journal"):
        size += _regular_size(path.with_name(path.name + suffix))
    if size > MOST_BYTES:
        raise WorkspaceError(
            f"{path}: it has {size / 1e6:.0f} MB, at most {MOST_BYTES / 1e6:.0f} MB are read here: restore a copy of it"
        )
    address = f"{path.absolute().as_uri()}?mode={mode}"
    database = sqlite3.connect(address, uri=True, isolation_level=None, check_same_thread=False)
    database.text_factory = lambda data: data.decode(errors="replace")  # which the CRC then notices
    database.execute("PRAGMA trusted_schema = OFF")
    database.execute("PRAGMA cell_size_check = ON")
    return database


def _regular_size(path: Path) -> int:
    if not os.path.lexists(path):
        return 0
    status = path.lstat()
    if not stat.S_ISREG(status.st_mode):
        raise WorkspaceError(f"{path}: is no regular file: remove it, or choose another folder")
    return status.st_size


def _number(database: sqlite3.Connection, pragma: str) -> int:
    return int(database.execute(pragma).fetchone()[0])


def _stored_actions(path: Path, database: sqlite3.Connection) -> tuple[Action, ...] | None:
    """Return the actions of an open database, None where nothing was ever stored in it."""
    application, version = _number(database, "PRAGMA application_id"), _number(database, "PRAGMA user_version")
    schema = database.execute("SELECT type, name, sql FROM sqlite_master").fetchall()
    if not (application or version or schema):
        return None
    if application == _APPLICATION and version > FORMAT:
        raise WorkspaceError(f"{path}: has format {version}, this photogram reads {FORMAT}: install a newer photogram")
    if application != _APPLICATION or schema != [("table", "actions", _TABLE)]:
        raise WorkspaceError(f"{path}: is not a journal of marks: move it away, or restore a copy of the journal")
    (verdict,) = database.execute("PRAGMA integrity_check(1)").fetchone()
    if verdict != "ok":
        raise _damaged(path, str(verdict))
    actions = []
    rows = database.execute("SELECT number, at, kind, fields, crc FROM actions ORDER BY number")
    for expected, (number, at, kind, fields, crc) in enumerate(rows, 1):
        if number != expected:
            raise _damaged(path, f"action {expected} is missing")
        if crc != _crc(number, at, kind, fields):
            raise _damaged(path, f"corrupt record inside the journal, action {number}")
        actions.append(_action(path, number, kind, fields))
    return tuple(actions)


# ---- errors --------------------------------------------------------------------------------------------------------


def _damaged(path: Path, reason: str) -> WorkspaceError:
    return WorkspaceError(
        f"{path}: the journal of marks is damaged ({shortened(printable(reason), 200)}): restore a copy of it, or move "
        "it away and name marks.csv in the project file, where the marks are"
    )


@contextmanager
def _sqlite_errors(path: Path) -> Iterator[None]:
    """Turn the errors of SQLite into those of photogram."""
    try:
        yield
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY:
            raise WorkspaceError(
                f"{path}: another process has it open: use that one, or end it before this one begins"
            ) from error
        raise WorkspaceError(
            f"{path}: cannot be opened or written ({printable(str(error))}): check that the folder exists, may be "
            "written to and has free space"
        ) from error
    except sqlite3.DatabaseError as error:
        raise _damaged(path, str(error)) from error


# ---- writing -------------------------------------------------------------------------------------------------------


class Journal:
    """A journal open for one process: its threads may append at the same time.

    Opening makes the file where there is none, and takes over the journal that an earlier photogram kept as text
    (``.jsonl``). Raises WorkspaceError where another process has it open, where it cannot be written, and as
    ``read_journal`` does.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock, self._replay = Lock(), Replay()
        with ExitStack() as opened, _sqlite_errors(path):
            opened.enter_context(closing(_reserved(path)))
            self._database = opened.enter_context(closing(_connected(path, "rwc")))
            actions = _stored_actions(path, self._database)
            self._database.execute("PRAGMA journal_mode = WAL")
            self._database.execute("PRAGMA synchronous = FULL")
            if actions is None:
                actions = self._begin()
            for action in actions:
                self._replay.do(action)
            self.earlier: tuple[Action, ...] = actions
            """The actions before this session."""
            self._sequence = len(actions)
            self._is_open = True
            self._databases = opened.pop_all()

    def _begin(self) -> tuple[Action, ...]:
        """Make the table, with the actions of the journal before it, all at once or not at all; return these."""
        rows = [_row(number, *row) for number, row in enumerate(_former_rows(self.path), 1)]
        actions = tuple(_action(self.path, number, kind, fields) for number, _, kind, fields, _ in rows)
        with self._database:
            self._database.execute("BEGIN IMMEDIATE")
            self._database.execute(_TABLE)
            self._database.executemany(_INSERT, rows)
            self._database.execute("PRAGMA user_version = 1")
            self._database.execute("PRAGMA application_id = 0x70676D6B")
        return actions

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; nothing is appended afterwards."""
        with self._lock:
            self._is_open = False
            self._databases.close()

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
            if not self._is_open:
                raise WorkspaceError(f"{self.path}: the journal is closed: open it again")
            number = self._sequence + 1
            with _sqlite_errors(self.path):
                self._database.execute(_INSERT, _row_of(number, action))
            self._sequence = number
            self._replay.do(action)
            return number


def _reserved(path: Path) -> sqlite3.Connection:
    """Lock an empty database beside the journal, which others may go on reading; the lock goes with the process."""
    lock = path.with_suffix(".lock")
    if _regular_size(lock):
        raise WorkspaceError(f"{lock}: is not the empty file that locks the journal: remove it")
    session = sqlite3.connect(lock, isolation_level=None, check_same_thread=False, timeout=0.0)
    session.execute("PRAGMA journal_mode = OFF")
    session.execute("BEGIN EXCLUSIVE")
    return session
