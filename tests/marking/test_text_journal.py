"""The journal of marking as text, taken over by the one that is a database."""

import shutil
import sqlite3
import zlib
from contextlib import closing
from pathlib import Path

import pytest

from photogram.errors import WorkspaceError
from photogram.files.tables.surveyed_points import Mark, Proposal, SurveyedPoint
from photogram.marking.files.actions import (
    Action,
    AddPoint,
    ConfirmProposals,
    PlaceMarks,
    Redo,
    RemoveMarks,
    SetNotVisible,
    SetRole,
    Undo,
)
from photogram.marking.files.journal import Journal, read_journal

WRITTEN = Path(__file__).parents[1] / "data/text_journal.jsonl"
"""Written when journals were text."""
ACTIONS: tuple[Action, ...] = (
    PlaceMarks((Mark("A", "1.jpg", (1.5, 2.25)),)),
    AddPoint(SurveyedPoint("Ø 1", (1.0, 2.0, 3.0), (0.01, 0.01, 0.02), crs="EPSG:25832")),
    SetRole("A", "check"),
    ConfirmProposals((Proposal(Mark("A", "2.jpg", (3.0, 4.0), (0.2, 0.3), 0.5, "matched"), 0.875),)),
    Undo(),
    SetNotVisible("A", "2.jpg"),
    RemoveMarks((("A", "1.jpg"),)),
    PlaceMarks((Mark("B", "1.jpg", (0.25, -1.0), None, 0.5, "circle", "2026-05-01T10:20:30Z", (7.0, 8.0), True),)),
    SetNotVisible("A", "2.jpg", True),
    AddPoint(SurveyedPoint("N")),
    Redo(),
)


def sealed(text: str) -> bytes:
    return f'{text[:-1]},"crc":"{zlib.crc32(text[:-1].encode()):08x}"}}\n'.encode()


def read_nothing(path: Path) -> bool:
    with closing(sqlite3.connect(path)) as database:
        return not database.execute("SELECT * FROM sqlite_master").fetchall()


def test_it_is_taken_over_once_and_stays(tmp_path: Path) -> None:
    path, text = tmp_path / "journal.sqlite", tmp_path / "journal.jsonl"
    shutil.copy(WRITTEN, text)
    assert read_journal(path) == ACTIONS
    assert not path.exists()
    with Journal(path) as journal:
        assert journal.earlier == ACTIONS
        assert journal.append(Undo()) == len(ACTIONS) + 1
    assert text.read_bytes() == WRITTEN.read_bytes()
    assert read_journal(path) == (*ACTIONS, Undo())


def test_a_start_that_was_killed_before_it_was_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    shutil.copy(WRITTEN, tmp_path / "journal.jsonl")
    path.touch()
    assert read_journal(path) == ACTIONS
    with Journal(path) as journal:
        assert journal.earlier == ACTIONS


def test_every_truncation_gives_the_actions_before_it(tmp_path: Path) -> None:
    data = WRITTEN.read_bytes()
    text = tmp_path / "journal.jsonl"
    for size in range(0, len(data) + 1, 7):
        text.write_bytes(data[:size])
        assert read_journal(tmp_path / "journal.sqlite") == ACTIONS[: max(data[:size].count(b"\n") - 1, 0)]


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([b"my notes\n"], r"jsonl:1: corrupt record inside the journal: restore a copy"),
        ([sealed('{"n":0}'), b"x\n", sealed('{"n":1}')], r"jsonl:2: corrupt record inside the journal: restore a copy"),
        ([sealed('{"n":0}'), sealed('{"n":2}')], r"jsonl:2: lines are missing before it: restore a copy"),
        ([sealed('{"n":0}'), sealed('{"n":1}')], r"jsonl:2: 'at': restore a copy"),
        (
            [sealed('{"n":0}'), sealed('{"n":1,"at":"","do":"mark","marks":3}')],
            r"jsonl:2: 'int' object is not iterable",
        ),
        ([sealed('{"n":0}'), sealed('{"n":1,"at":"","do":"dance"}')], r"sqlite: action 1: unknown action 'dance'"),
        ([sealed('{"n":0}'), sealed("[" * 10**5)], r"jsonl:2: "),
    ],
)
def test_what_is_damaged_is_named_and_nothing_taken_over(tmp_path: Path, lines: list[bytes], expected: str) -> None:
    (tmp_path / "journal.jsonl").write_bytes(b"".join(lines))
    for reader in (read_journal, Journal):
        with pytest.raises(WorkspaceError, match=expected):
            reader(tmp_path / "journal.sqlite")
    assert read_nothing(tmp_path / "journal.sqlite")
