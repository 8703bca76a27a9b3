"""The journal of marking: what is read after any crash, and the state that follows from actions, undone and redone."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from random import Random
from threading import Thread

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from photogram.errors import ControlPointError, WorkspaceError
from photogram.files.marks.marks import Mark, NewPoint, Proposal
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
    st.sampled_from(["raw", "quartered", "circle", "matched", "coded", "imported"]),
    st.sampled_from(["", "2026-05-01T10:20:30Z", "2026-05-01T10:20:30.125Z"]),
    st.none() | pixels,
    st.booleans(),
)
three = st.tuples(*[st.floats(-1e7, 1e7)] * 3)
new_points = st.builds(NewPoint, names, st.none() | three, st.none() | st.tuples(*[sigmas] * 3), st.none() | names)
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
    return state.marks, state.not_visible, state.roles, state.points, state.confirmed


def place(point: str, photograph: str = "1.jpg", u: float = 1.5, v: float = 2.25) -> PlaceMarks:
    return PlaceMarks((Mark(point, photograph, (u, v)),))


def written(path: Path, done: list[Action]) -> bytes:
    with Journal(path) as journal:
        for action in done:
            journal.append(action)
    return path.read_bytes()


SOME: list[Action] = [
    place("A"),
    AddPoint(NewPoint("Ø 1", (1.0, 2.0, 3.0), (0.01, 0.01, 0.02), "EPSG:25832")),
    SetRole("A", "check"),
    ConfirmProposals((Proposal(Mark("A", "2.jpg", (3.0, 4.0), (0.2, 0.3), 0.5, "matched"), 0.875),)),
    Undo(),
    SetNotVisible("A", "2.jpg"),
    RemoveMarks((("A", "1.jpg"),)),
]


# -- state ------------------------------------------------------------------------------------------------------------


def test_what_each_action_does() -> None:
    mark, other = Mark("A", "1.jpg", (1.0, 2.0)), Mark("A", "1.jpg", (5.0, 6.0), (0.2, 0.3), 0.1, "quartered")
    assert dict(state_of([PlaceMarks((mark,)), PlaceMarks((other,))]).marks) == {("A", "1.jpg"): other}
    assert not state_of([PlaceMarks((mark,)), RemoveMarks((mark.place,))]).marks
    hidden = state_of([PlaceMarks((mark,)), SetNotVisible("A", "1.jpg")])
    assert (len(hidden.marks), set(hidden.not_visible)) == (0, {("A", "1.jpg")})
    assert not state_of([SetNotVisible("A", "1.jpg"), SetNotVisible("A", "1.jpg", True)]).not_visible
    seen = state_of([SetNotVisible("A", "1.jpg"), PlaceMarks((mark,))])
    assert (len(seen.marks), seen.not_visible) == (1, frozenset())
    assert dict(state_of([SetRole("A", "check"), SetRole("A", "tie")]).roles) == {"A": "tie"}
    assert state_of([AddPoint(NewPoint("N"))]).points["N"].position is None
    confirmed = state_of([ConfirmProposals((Proposal(mark, 0.5),))])
    assert (confirmed.marks[mark.place], dict(confirmed.confirmed)) == (mark, {mark.place: 0.5})
    assert not state_of([ConfirmProposals((Proposal(mark, 0.5),)), PlaceMarks((other,))]).confirmed


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
        (lambda: NewPoint("A", (0.0, 0.0, float("nan"))), "position of A must be from"),
        (lambda: Proposal(Mark("A", "1", (0.0, 0.0)), float("nan")), "proposal of A in 1: score must be from"),
    ],
)
def test_what_no_action_may_hold(make: Callable[[], object], expected: str) -> None:
    with pytest.raises(ControlPointError, match=re.escape(expected)):
        make()


# -- on disk ----------------------------------------------------------------------------------------------------------


@quick
@given(done=st.lists(actions, max_size=8))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, done: list[Action]) -> None:
    path = tmp_path_factory.mktemp("round") / "journal.jsonl"
    written(path, done)
    read = read_journal(path)
    assert (list(read.actions), read.torn) == (done, None)
    with Journal(path) as journal:
        assert (journal.state, journal.sequence, journal.torn) == (state_of(done), len(done), None)


def test_every_truncation_gives_the_actions_before_it(tmp_path: Path) -> None:
    data = written(tmp_path / "whole", SOME)
    path = tmp_path / "cut"
    for size in range(len(data) + 1):
        path.write_bytes(data[:size])
        read = read_journal(path)
        whole = max(data[:size].count(b"\n") - 1, 0)
        assert list(read.actions) == SOME[:whole]
        assert (read.torn is None) == (size == 0 or data[size - 1 : size] == b"\n")
        with Journal(path) as journal:  # goes on where the whole records end
            assert journal.torn == read.torn
            assert journal.append(Redo()) == whole + 1
        assert list(read_journal(path).actions) == [*SOME[:whole], Redo()]


def test_what_was_dropped_is_told(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    data = written(path, SOME)
    path.write_bytes(data[:-5] + b"\0\0")
    read = read_journal(path)
    assert list(read.actions) == SOME[:-1]
    assert str(read.torn).startswith("line 8 was cut off when it was written")


@pytest.mark.parametrize("count", [0, 1, len(SOME)])
def test_every_flipped_bit_of_the_last_record_is_noticed(tmp_path: Path, count: int) -> None:
    path = tmp_path / "journal.jsonl"
    data = written(path, SOME[:count])
    begin = data[:-1].rfind(b"\n") + 1
    for place_of_byte in range(begin, len(data)):
        for bit in range(8):
            spoilt = bytearray(data)
            spoilt[place_of_byte] ^= 1 << bit
            path.write_bytes(spoilt)
            if not count:  # nothing is left that says what the file is
                with pytest.raises(WorkspaceError, match=r"journal\.jsonl:1: is not a journal of marks"):
                    read_journal(path)
                continue
            read = read_journal(path)
            assert list(read.actions) == SOME[: count - 1]
            assert read.torn is not None


def test_damage_in_the_middle_is_an_error_and_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    data = written(path, SOME)
    random = Random(1)
    second, last = data.index(b"\n") + 1, data[:-1].rfind(b"\n")
    for _ in range(200):
        spoilt = bytearray(data)
        spoilt[random.randrange(second, last - 1)] ^= 1 << random.randrange(8)
        path.write_bytes(spoilt)
        for reader in (read_journal, Journal):
            with pytest.raises(
                WorkspaceError, match=r"journal\.jsonl:\d: the record is damaged, and whole ones follow"
            ):
                reader(path)
        assert path.read_bytes() == spoilt


def test_a_missing_line_and_a_doubled_one_are_noticed(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    lines = written(path, SOME).splitlines(keepends=True)
    for other in ([*lines[:3], *lines[4:]], [*lines[:4], *lines[3:]]):
        path.write_bytes(b"".join(other))
        with pytest.raises(WorkspaceError, match=r"journal\.jsonl:[45]: has not the number [34], so lines are missing"):
            read_journal(path)


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        ({"n": 1, "do": "dance"}, "2: no action that this photogram knows"),
        ({"n": 1, "do": "mark", "marks": [{"point": "A"}]}, "2: no action that this photogram knows"),
        ({"n": 1, "do": "role", "point": "A", "role": "king"}, "2: no action that this photogram knows"),
        ({"n": 1, "do": "not_visible", "point": "", "photograph": "1"}, "2: point '': must be 1 to 255"),
        ({"n": 1, "do": "point", "name": "A", "position": [1, 2]}, "2: no action that this photogram knows"),
        ({"n": 1, "do": "point", "name": "A", "position": [1, True, 2]}, "2: no action that this photogram knows"),
        ({"n": 1, "do": "remove", "places": [["A"]]}, "2: no action that this photogram knows"),
    ],
)
def test_what_another_version_wrote(tmp_path: Path, record: dict[str, object], expected: str) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(module._HEADER + module._sealed(record))
    with pytest.raises(WorkspaceError, match=r"journal\.jsonl:" + expected):
        read_journal(path)
    path.write_bytes(module._sealed({"n": 0, "journal": "photogram marks", "format": 9}))
    with pytest.raises(
        WorkspaceError, match=r"journal\.jsonl:1: has format 9, this photogram reads 1: install a newer"
    ):
        read_journal(path)


def test_what_is_no_journal_is_not_touched(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    for text in ("my notes", "my notes\nof today\n", '{"n":0}\n'):
        path.write_text(text)
        with pytest.raises(WorkspaceError, match=r"notes\.txt:1: is not a journal of marks"):
            Journal(path)
        assert path.read_text() == text
    with pytest.raises(WorkspaceError, match="No such file"):
        read_journal(tmp_path / "none")
    with pytest.raises(WorkspaceError, match="cannot be written"):
        Journal(tmp_path / "none" / "journal.jsonl")
    (tmp_path / "link").symlink_to(path)
    with pytest.raises(WorkspaceError, match="cannot be written"):
        Journal(tmp_path / "link")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(WorkspaceError, match="is no ordinary file"):
        Journal(tmp_path / "pipe")


def test_one_process_at_a_time(tmp_path: Path) -> None:
    with Journal(tmp_path / "journal.jsonl") as journal:
        with pytest.raises(WorkspaceError, match="another process has it open"):
            Journal(tmp_path / "journal.jsonl")
        journal.append(place("A"))
    with pytest.raises(WorkspaceError, match="the journal is closed"):
        journal.append(place("B"))
    with Journal(tmp_path / "journal.jsonl") as journal:
        assert journal.sequence == 1


def test_threads_append_at_the_same_time(tmp_path: Path) -> None:
    numbers: list[int] = []

    def work(name: str) -> None:
        numbers.extend(journal.append(place(name, f"{i}.jpg")) for i in range(50))

    with Journal(tmp_path / "journal.jsonl") as journal:
        threads = [Thread(target=work, args=(name,)) for name in "ABCD"]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        state = journal.state
    assert sorted(numbers) == list(range(1, 201))
    assert len(state.marks) == 200
    assert state_of(read_journal(tmp_path / "journal.jsonl").actions) == state


def test_a_full_disk_leaves_no_part_of_a_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, write = tmp_path / "journal.jsonl", os.write
    with Journal(path) as journal:
        journal.append(place("A"))
        before = path.read_bytes()

        def full(file: int, data: bytes) -> int:
            if len(data) > 40:
                return write(file, data[:40])
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "write", full)
        with pytest.raises(WorkspaceError, match=r"No space left on device.*free space"):
            journal.append(place("B"))
        monkeypatch.undo()
        assert path.read_bytes() == before
        assert journal.append(place("C")) == 2
    assert list(read_journal(path).actions) == [place("A"), place("C")]


_WRITER = """
import sys
from pathlib import Path
from photogram.files.marks.marks import Mark
from photogram.marking.files.actions import PlaceMarks
from photogram.marking.files.journal import Journal
from photogram.files.marks.mark_table import write_marks
folder = Path(sys.argv[1])
with Journal(folder / "journal.jsonl") as journal:
    while True:
        number = journal.append(PlaceMarks((Mark("A", f"{journal.sequence}.jpg", (1.5, 2.5)),)))
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
        done = read_journal(tmp_path / "journal.jsonl").actions
        assert len(done) >= told  # whatever was told to be on the disk is there
        if (tmp_path / "marks.csv").exists():
            held = {mark.place for mark in read_marks(tmp_path / "marks.csv")}
            assert held <= set(state_of(done).marks)
            assert len(held) >= told - 1
