"""The journal of marking: what is read after any crash, and the state that follows from actions, undone and redone."""

import os
import re
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing, suppress
from importlib import import_module
from pathlib import Path
from random import Random
from threading import Thread

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from photogram.errors import ControlPointError, WorkspaceError
from photogram.files.tables.surveyed_points import UNSTATED, Mark, Proposal, SurveyedPoint
from photogram.marking.files import journal as module
from photogram.marking.files.actions import (
    Action,
    AddPoint,
    ConfirmProposals,
    MarkState,
    PlaceMarks,
    Redo,
    RemoveMarks,
    SetNotVisible,
    SetRole,
    Undo,
    state_of,
)
from photogram.marking.files.journal import Journal, read_journal

names = st.text(st.characters(categories=("L", "N"), include_characters="-_.,;\"' #"), min_size=1, max_size=8).filter(
    lambda text: text == text.strip() and text.isprintable()
)
few = st.sampled_from(["A", "B", "C"])
pictures = st.sampled_from(["1.jpg", "2.jpg"])
pixels = st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
sigmas = st.floats(1e-3, 100.0)
marks = st.builds(
    Mark,
    few,
    pictures,
    pixels,
    st.none() | st.tuples(sigmas, sigmas),
    st.floats(-0.99, 0.99),
    st.sampled_from(["raw", "checker", "circle", "matched", "coded", "imported"]),
    st.sampled_from(["", "2026-05-01T10:20:30Z", "2026-05-01T10:20:30.125Z"]),
    st.none() | pixels,
    st.booleans(),
)
three = st.tuples(*[st.floats(-1e7, 1e7)] * 3)
new_points = st.builds(
    SurveyedPoint, names, st.none() | three, st.just(UNSTATED) | st.tuples(*[sigmas] * 3), crs=st.none() | names
)
deeds: st.SearchStrategy[Action] = st.one_of(
    st.builds(PlaceMarks, st.lists(marks, max_size=3).map(tuple)),
    st.builds(RemoveMarks, st.lists(st.tuples(few, pictures), max_size=2).map(tuple)),
    st.builds(SetNotVisible, few, pictures, st.booleans()),
    st.builds(SetRole, few, st.sampled_from(["control", "check", "tie"])),
    st.builds(AddPoint, new_points),
    st.builds(ConfirmProposals, st.lists(st.builds(Proposal, marks, st.floats(-10.0, 10.0)), max_size=2).map(tuple)),
)
actions = deeds | st.builds(Undo) | st.builds(Redo)
quick = settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])


def content(state: MarkState) -> tuple[object, ...]:
    """What a state says, without how many actions can be undone."""
    return state.marks, state.not_visible, state.roles, state.points


def place(point: str, photograph: str = "1.jpg", u: float = 1.5, v: float = 2.25) -> PlaceMarks:
    return PlaceMarks((Mark(point, photograph, (u, v)),))


def written(path: Path, done: list[Action]) -> bytes:
    with Journal(path) as journal:
        for action in done:
            journal.append(action)
    return path.read_bytes()


SOME: list[Action] = [
    place("A"),
    AddPoint(SurveyedPoint("Ø 1", (1.0, 2.0, 3.0), (0.01, 0.01, 0.02), crs="EPSG:25832")),
    SetRole("A", "check"),
    ConfirmProposals((Proposal(Mark("A", "2.jpg", (3.0, 4.0), (0.2, 0.3), 0.5, "matched"), 0.875),)),
    Undo(),
    SetNotVisible("A", "2.jpg"),
    RemoveMarks((("A", "1.jpg"),)),
]


# -- state ------------------------------------------------------------------------------------------------------------


def test_what_each_action_does() -> None:
    mark, other = Mark("A", "1.jpg", (1.0, 2.0)), Mark("A", "1.jpg", (5.0, 6.0), (0.2, 0.3), 0.1, "checker")
    assert dict(state_of([PlaceMarks((mark,)), PlaceMarks((other,))]).marks) == {("A", "1.jpg"): other}
    assert not state_of([PlaceMarks((mark,)), RemoveMarks((mark.key,))]).marks
    hidden = state_of([PlaceMarks((mark,)), SetNotVisible("A", "1.jpg")])
    assert (len(hidden.marks), set(hidden.not_visible)) == (0, {("A", "1.jpg")})
    assert not state_of([SetNotVisible("A", "1.jpg"), SetNotVisible("A", "1.jpg", True)]).not_visible
    seen = state_of([SetNotVisible("A", "1.jpg"), PlaceMarks((mark,))])
    assert (len(seen.marks), seen.not_visible) == (1, frozenset())
    assert dict(state_of([SetRole("A", "check"), SetRole("A", "tie")]).roles) == {"A": "tie"}
    assert state_of([AddPoint(SurveyedPoint("N"))]).points["N"].position is None
    assert dict(state_of([ConfirmProposals((Proposal(mark, 0.5),))]).marks) == {mark.key: mark}


def test_a_state_cannot_be_changed() -> None:
    state = state_of([place("A")])
    with pytest.raises(TypeError):
        state.marks["A", "1.jpg"] = Mark("A", "1.jpg", (0.0, 0.0))  # type: ignore[index]


@quick
@given(done=st.lists(deeds, max_size=12), undone=st.integers(0, 14), redone=st.integers(0, 14))
def test_undo_is_as_if_it_was_never_done_and_redo_as_if_it_was(done: list[Action], undone: int, redone: int) -> None:
    steps = []  # those that change something
    for i, action in enumerate(done):
        if content(state_of(done[: i + 1])) != content(state_of(done[:i])):
            steps.append(action)
    after = state_of([*done, *[Undo()] * undone, *[Redo()] * redone])
    left = min(max(len(steps) - undone, 0) + redone, len(steps))
    assert content(after) == content(state_of(steps[:left]))
    assert (after.undoable, after.redoable) == (left, len(steps) - left)


def test_what_is_done_after_an_undo_leaves_nothing_to_redo() -> None:
    state = state_of([place("A"), place("B"), Undo(), place("C"), Redo(), Undo(), Undo(), Undo(), Redo()])
    assert {point for point, _ in state.marks} == {"A"}
    assert (state.undoable, state.redoable) == (1, 1)


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: Mark("", "1.jpg", (0.0, 0.0)), "point '': must be 1 to 255 printable characters"),
        (lambda: Mark("A", " 1.jpg", (0.0, 0.0)), "photograph ' 1.jpg': must be"),
        (lambda: Mark("A\x1b", "1.jpg", (0.0, 0.0)), "point 'A\\\\x1b': must be"),
        (lambda: Mark("A", "1", (float("nan"), 0.0)), "mark of A in 1: u and v must be from"),
        (lambda: Mark("A", "1", (0.0, 0.0), raw_pixel=(0.0, float("inf"))), "raw_u and raw_v must be from"),
        (lambda: Mark("A", "1", (0.0, 0.0), (0.1, 0.0)), r"standard deviations (px) must be from 0.0001 to 1000"),
        (lambda: Mark("A", "1", (0.0, 0.0), (0.1, 0.1), 1.0), "rho must lie between -1 and 1, found 1.0"),
        (lambda: Mark("A", "1", (0.0, 0.0), kind="By Hand"), "kind must be a word in lower case, found 'By Hand'"),
        (lambda: Mark("A", "1", (0.0, 0.0), time="1 May"), "time must be UTC as 2026-05-01T10:20:30Z, found '1 May'"),
        (lambda: SetRole("A", "chek"), "role must be control, check or tie, found 'chek'"),  # type: ignore[arg-type]
        (lambda: AddPoint(SurveyedPoint("A", (0.0, 0.0, float("nan")))), "position of A must be from"),
        (lambda: Proposal(Mark("A", "1", (0.0, 0.0)), float("nan")), "proposal of A in 1: score must be from"),
    ],
)
def test_what_no_action_may_hold(make: Callable[[], object], expected: str) -> None:
    with pytest.raises(ControlPointError, match=re.escape(expected)):
        make()


# -- on disk ----------------------------------------------------------------------------------------------------------


def killed(path: Path, done: list[Action]) -> tuple[bytes, bytes]:
    """Return database and log as a process that was killed after these actions leaves them."""
    with Journal(path) as journal:
        for action in done:
            journal.append(action)
        return path.read_bytes(), log_of(path).read_bytes()


def log_of(path: Path) -> Path:
    return path.with_name(f"{path.name}-wal")


def changed(path: Path, *statements: str) -> None:
    """Change a database behind photogram's back."""
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        for statement in statements:
            database.execute(statement)


@quick
@given(done=st.lists(actions, max_size=8))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, done: list[Action]) -> None:
    path = tmp_path_factory.mktemp("round") / "journal.sqlite"
    written(path, done)
    assert list(read_journal(path)) == done
    with Journal(path) as journal:
        assert (journal.state, list(journal.earlier)) == (state_of(done), done)


def test_every_truncation_of_the_log_gives_the_actions_before_it(tmp_path: Path) -> None:
    database, log = killed(tmp_path / "whole.sqlite", SOME)
    path = tmp_path / "cut.sqlite"
    counts = []
    for size in sorted({*range(0, len(log), 509), len(log) - 1, len(log)}):
        path.write_bytes(database)
        log_of(path).write_bytes(log[:size])
        read = read_journal(path)
        counts.append(len(read))
        assert list(read) == SOME[: len(read)]
        with Journal(path) as journal:  # goes on where the whole actions end
            assert journal.append(Redo()) == len(read) + 1
        assert read_journal(path) == (*read, Redo())
    assert sorted(counts) == counts
    assert set(counts) == set(range(len(SOME) + 1))


def test_no_flipped_bit_changes_what_is_read(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    data = written(path, SOME)
    random = Random(1)
    begin = data.rindex(b"not_visible") - 200  # rows are at the end of a page; half of the flips hit them
    harmless = 0
    for i in range(400):
        spoilt = bytearray(data)
        spoilt[random.randrange(begin if i % 2 else 0, len(data))] ^= 1 << random.randrange(8)
        path.write_bytes(spoilt)
        with suppress(WorkspaceError):
            assert list(read_journal(path)) == SOME
            harmless += 1
        log_of(path).unlink(missing_ok=True)
    assert 100 < harmless < 300


def test_blocks_of_nonsense_are_refused_or_harmless(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    database, log = killed(path, SOME)
    random = Random(2)
    for i in range(150):
        spoilt = bytearray(log if i % 2 else database)
        begin, length = random.randrange(len(spoilt)), random.randrange(1, 300)
        spoilt[begin : begin + length] = random.randbytes(length)
        path.write_bytes(database if i % 2 else spoilt)
        log_of(path).write_bytes(spoilt if i % 2 else log)
        with suppress(WorkspaceError), Journal(path) as journal:
            assert list(journal.earlier) == SOME[: len(journal.earlier)]


def test_what_was_changed_from_outside_is_named(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    for statement, expected in (
        (
            "UPDATE actions SET fields = replace(fields, '0.8', '0.9')",
            "corrupt record inside the journal, action 4",
        ),
        ("UPDATE actions SET at = x'ff' WHERE number = 3", "corrupt record inside the journal, action 3"),
        ("UPDATE actions SET number = 9 WHERE number = 5", "action 5 is missing"),
        ("DELETE FROM actions WHERE number = 1", "action 1 is missing"),
    ):
        written(path, SOME)
        changed(path, statement)
        for reader in (read_journal, Journal):
            with pytest.raises(WorkspaceError, match=re.escape(expected) + r"\): restore a copy of it.*marks\.csv"):
                reader(path)
        path.unlink()


@pytest.mark.parametrize(
    ("kind", "fields", "expected"),
    [
        ("dance", "{}", "unknown action 'dance'"),
        ("mark", '{"marks":[{"point":"A"}]}', "required"),
        ("mark", '{"marks":[],"more":1}', "Unexpected keyword argument"),
        ("mark", "[" * 100_000, "Invalid JSON"),
        ("mark", "{}],[{}", "Invalid JSON"),
        ("role", '{"point":"A","role":"king"}', "Input should be 'control', 'check' or 'tie'"),
        ("not_visible", '{"point":"","photograph":"1"}', "point '': must be 1 to 255"),
        ("point", '{"point":{"name":"A","position":[1,2]}}', "required"),
        ("point", '{"point":{"name":"A","position":[1,true,2]}}', "Input should be a valid number"),
        ("remove", '{"keys":[["A"]]}', "required"),
    ],
)
def test_what_another_version_wrote(tmp_path: Path, kind: str, fields: str, expected: str) -> None:
    path = tmp_path / "journal.sqlite"
    written(path, [])
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute(module._INSERT, module._row(1, "", kind, fields))
    with pytest.raises(WorkspaceError, match=rf"journal\.sqlite: action 1: .*({expected}).*: install the photogram"):
        read_journal(path)
    changed(path, "PRAGMA user_version = 9")
    with pytest.raises(WorkspaceError, match=r"has format 9, this photogram reads 1: install a newer"):
        read_journal(path)


@pytest.mark.parametrize(
    "statement",
    [
        "CREATE TABLE more (x)",
        "CREATE VIEW more AS SELECT 1",
        "CREATE TRIGGER more AFTER INSERT ON actions BEGIN DELETE FROM actions; END",
        "CREATE INDEX more ON actions (upper(kind))",
        "ALTER TABLE actions ADD COLUMN more AS (zeroblob(1000000000))",
        "DROP TABLE actions",
        "PRAGMA application_id = 7",
    ],
)
def test_a_database_of_another_form_is_refused(tmp_path: Path, statement: str) -> None:
    path = tmp_path / "journal.sqlite"
    written(path, SOME)
    changed(path, statement)
    data = path.read_bytes()
    for reader in (Journal, read_journal):
        with pytest.raises(WorkspaceError, match=r"journal\.sqlite: is not a journal of marks"):
            reader(path)
    assert path.read_bytes() == data


def test_what_is_no_journal_is_not_touched(tmp_path: Path) -> None:
    path = tmp_path / "notes.sqlite"
    for text in ("my notes", "my notes\nof today\n" * 100):
        path.write_text(text)
        with pytest.raises(WorkspaceError, match=r"notes\.sqlite: .* is damaged \(file is not a database"):
            Journal(path)
        assert path.read_text() == text
    changed(tmp_path / "other.sqlite", "CREATE TABLE mine (x)")
    data = (tmp_path / "other.sqlite").read_bytes()
    with pytest.raises(WorkspaceError, match="is not a journal of marks"):
        Journal(tmp_path / "other.sqlite")
    assert (tmp_path / "other.sqlite").read_bytes() == data


def test_links_pipes_and_too_large_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    with pytest.raises(WorkspaceError, match="cannot be opened or written"):
        Journal(tmp_path / "none" / "journal.sqlite")
    target = tmp_path / "target"
    for suffix in (".lock", ".sqlite", ".sqlite-wal", ".sqlite-shm", ".sqlite-journal"):
        for make in (lambda link: link.symlink_to(target), os.mkfifo, Path.mkdir):
            strange = path.with_suffix(suffix)
            strange.unlink(missing_ok=True)
            make(strange)
            with pytest.raises(WorkspaceError, match=f"{strange.name}: is no regular file"):
                Journal(path)
            strange.rmdir() if strange.is_dir() else strange.unlink()
    assert not target.exists()
    path.with_suffix(".lock").write_bytes(b"something")
    with pytest.raises(WorkspaceError, match="is not the empty file that locks the journal"):
        Journal(path)
    path.with_suffix(".lock").unlink()
    with path.open("wb") as stream:
        stream.truncate(module.MOST_BYTES + 1)
    with pytest.raises(WorkspaceError, match="at most 1000 MB are read here"):
        Journal(path)


_HOLDER = """
import sys
from pathlib import Path
from photogram.marking.files.journal import Journal
with Journal(Path(sys.argv[1])) as journal:
    print(len(journal.earlier), flush=True)
    sys.stdin.read()
"""


def test_one_process_at_a_time_while_others_may_read(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    written(path, SOME)
    with subprocess.Popen(
        [sys.executable, "-c", _HOLDER, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert int(holder.stdout.readline()) == len(SOME)
        with pytest.raises(WorkspaceError, match=r"journal\.sqlite: another process has it open"):
            Journal(path)
        assert list(read_journal(path)) == SOME
        holder.kill()
    with Journal(path) as journal:
        with pytest.raises(WorkspaceError, match="another process has it open"):
            Journal(path)
        journal.append(place("A"))
    with pytest.raises(WorkspaceError, match="the journal is closed"):
        journal.append(place("B"))
    assert read_journal(path) == (*SOME, place("A"))


def test_threads_append_at_the_same_time(tmp_path: Path) -> None:
    numbers: list[int] = []

    def work(name: str) -> None:
        numbers.extend(journal.append(place(name, f"{i}.jpg")) for i in range(50))

    with Journal(tmp_path / "journal.sqlite") as journal:
        threads = [Thread(target=work, args=(name,)) for name in "ABCD"]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        state = journal.state
    assert sorted(numbers) == list(range(1, 201))
    assert len(state.marks) == 200
    assert state_of(read_journal(tmp_path / "journal.sqlite")) == state


def test_a_full_disk_leaves_no_part_of_an_action(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    resource = pytest.importorskip("resource", reason="this system limits no files")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Journal(path) as journal:
        journal.append(place("A"))
        resource.setrlimit(resource.RLIMIT_FSIZE, (log_of(path).stat().st_size + 100, hard))
        try:
            with pytest.raises(WorkspaceError, match=r"cannot be opened or written.*free space"):
                journal.append(place("B"))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert read_journal(path) == (place("A"),)
        assert journal.append(place("C")) == 2
    assert read_journal(path) == (place("A"), place("C"))


_WRITER = """
import sys
from pathlib import Path
from photogram.files.tables.surveyed_points import Mark
from photogram.marking.files.actions import PlaceMarks
from photogram.marking.files.journal import Journal
from photogram.files.marks.mark_table import write_marks
folder = Path(sys.argv[1])
with Journal(folder / "journal.sqlite") as journal:
    number = len(journal.earlier)
    while True:
        number = journal.append(PlaceMarks((Mark("A", f"{number}.jpg", (1.5, 2.5)),)))
        print(number, flush=True)
        write_marks(folder / "marks.csv", journal.state.marks.values())
"""


def test_a_killed_process_leaves_no_half_file(tmp_path: Path) -> None:
    from photogram.files.marks.mark_table import read_marks

    told = 0
    for lines in (1, 5, 12, 30):
        writer = subprocess.Popen([sys.executable, "-c", _WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True)
        assert writer.stdout is not None
        for _ in range(lines):
            told = int(writer.stdout.readline())
        os.kill(writer.pid, signal.SIGKILL)
        told = max([told, *map(int, writer.stdout.read().split("\n")[:-1])])
        writer.stdout.close()
        writer.wait()
        done = read_journal(tmp_path / "journal.sqlite")
        assert len(done) >= told  # whatever was told to be on the disk is there
        if (tmp_path / "marks.csv").exists():
            held = {mark.key for mark in read_marks(tmp_path / "marks.csv")}
            assert held <= set(state_of(done).marks)
            assert len(held) >= told - 1


# -- disks that are full ----------------------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform == "win32", reason="there is no limit of the size of files")
@pytest.mark.parametrize("room", [0, 1000, 3000, 5000, 9000, 20_000])
def test_an_action_that_finds_no_room_is_refused_and_the_others_are_there(tmp_path: Path, room: int) -> None:
    resource = import_module("resource")
    path, done = tmp_path / "marks.sqlite", list[Action]()
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Journal(path) as journal:
        for number in range(5):
            done.append(place(f"P{number}"))
            journal.append(done[-1])
        most = max(file.stat().st_size for file in tmp_path.iterdir()) + room
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
        try:
            with suppress(WorkspaceError):
                for number in range(5, 100):
                    action = place(f"P{number}")
                    journal.append(action)
                    done.append(action)
            with pytest.raises(WorkspaceError, match=r"cannot be opened or written .* has free space"):
                journal.append(place("one more"))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
        assert list(read_journal(path)) == done
        done.append(place("last"))
        assert journal.append(done[-1]) == len(done)
    assert list(read_journal(path)) == done
    assert len(done) > 5 or room < 5000
