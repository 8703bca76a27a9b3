"""A session of marking: what is done is kept at once, and told apart from what follows."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from makers import in_best_photograph, marks_of, wait_until_assessed, without_marks

from photogram.errors import ControlPointError, WorkspaceError
from photogram.files.marks.mark_table import read_marks
from photogram.files.tables.surveyed_points import IMPORTED, REMOVED, SurveyedPoint
from photogram.marking.files.journal import read_journal
from photogram.marking.page.assessment import marked_block
from photogram.marking.page.session import MarkingSession
from photogram.marking.page.snapping import Click, Snapped
from photogram.marking.tagged_block import tagged_block
from photogram.simulation.simulated_survey import simulate_block, whole_survey_plan
from photogram.survey import Block, Role

PLAN = replace(whole_survey_plan(), control_points=24, check_points=4)


@pytest.fixture(scope="module")
def whole() -> Block:
    return tagged_block(simulate_block(PLAN, 1).block)


@pytest.fixture
def session(whole: Block, tmp_path: Path) -> Iterator[MarkingSession]:
    opened = MarkingSession(without_marks(whole), tmp_path / "journal.sqlite", tmp_path / "marks.csv")
    yield opened
    opened.close()


def test_a_mark_is_in_journal_and_table_when_it_is_answered(session: MarkingSession, tmp_path: Path) -> None:
    name, photograph = session.block.control_points.name[0], session.block.photographs[0].name
    session.mark(name, photograph, (100.25, 50.5))
    (mark,) = read_marks(tmp_path / "marks.csv")
    assert (mark.key, mark.pixel, mark.raw_pixel, mark.kind) == (
        (name, photograph),
        (100.25, 50.5),
        (100.25, 50.5),
        "raw",
    )
    assert mark.sigma_px == (1.0, 1.0)
    assert len(read_journal(tmp_path / "journal.sqlite")) == 1
    session.set_doubtful(name, photograph, True)
    assert read_marks(tmp_path / "marks.csv")[0].is_doubtful
    session.set_visible(name, photograph, False)
    assert read_marks(tmp_path / "marks.csv") == ()
    session.undo()
    session.undo()
    assert read_marks(tmp_path / "marks.csv") == (mark,)
    session.undo()
    session.undo()
    assert read_marks(tmp_path / "marks.csv") == ()
    session.redo()
    assert read_marks(tmp_path / "marks.csv") == (mark,)
    session.remove(name, photograph)
    assert not session.snapshot().state.marks


def test_marks_of_the_project_are_taken_over_once_and_not_undone(whole: Block, tmp_path: Path) -> None:
    files = tmp_path / "journal.sqlite", tmp_path / "marks.csv"
    first = MarkingSession(whole, *files)
    assert len(first.snapshot().state.marks) == len(whole.control_points.mark_point)
    assert {mark.kind for mark in first.snapshot().state.marks.values()} == {IMPORTED}
    assert first.snapshot().undoable == 0
    (point, photograph, _), other, *_ = marks_of(whole, 0)
    first.remove(point, photograph)
    first.mark(*other)
    first.close()
    again = MarkingSession(whole, *files)
    state = again.snapshot().state
    assert (point, photograph) not in state.marks
    assert state.marks[other[:2]].kind == "raw"
    assert again.snapshot().undoable == 2
    for _ in range(5):
        again.undo()
    assert len(again.snapshot().state.marks) == len(whole.control_points.mark_point)
    again.close()


def test_marks_of_the_project_are_removed_in_the_table_and_corrected_ones_taken_over(
    whole: Block, tmp_path: Path
) -> None:
    files = tmp_path / "journal.sqlite", tmp_path / "marks.csv"
    first = MarkingSession(whole, *files)
    (point, photograph, _), other, *_ = marks_of(whole, 0)
    first.remove(point, photograph)
    first.mark(*other)
    first.close()
    kinds = {mark.key: mark.kind for mark in read_marks(tmp_path / "marks.csv")}
    assert (kinds[point, photograph], kinds[other[:2]]) == (REMOVED, "raw")
    moved = whole.control_points.mark_pixel + 0.5
    again = MarkingSession(replace(whole, control_points=replace(whole.control_points, mark_pixel=moved)), *files)
    assert again.set_aside is None
    marks = again.snapshot().state.marks
    assert (point, photograph) not in marks
    assert marks[other[:2]].kind == "raw"
    names, points = whole.photograph_names, whole.control_points
    for (u, v), g, i in zip(moved.tolist(), points.mark_point, points.mark_photograph, strict=True):
        key = points.name[g], names[i]
        if key not in ((point, photograph), other[:2]):
            assert marks[key].pixel == (u, v)
    again.close()


def test_a_table_of_somebody_else_is_kept_under_another_name(whole: Block, tmp_path: Path) -> None:
    table = tmp_path / "marks.csv"
    table.write_text("point,photograph,u,v\nmine,a.jpg,1,2\n")
    own = without_marks(whole)
    first = MarkingSession(own, tmp_path / "journal.sqlite", table)
    assert first.set_aside is not None
    assert "mine,a.jpg,1,2" in first.set_aside.read_text()
    name, photograph = own.control_points.name[0], own.photographs[0].name
    first.mark(name, photograph, (1.0, 2.0))
    stale = table.read_bytes()
    first.mark(name, photograph, (3.0, 4.0))
    first.close()
    again = MarkingSession(own, tmp_path / "journal.sqlite", table)
    again.close()
    assert again.set_aside is None
    table.write_bytes(stale)  # as a crash between journal and table leaves it
    again = MarkingSession(own, tmp_path / "journal.sqlite", table)
    again.close()
    assert again.set_aside is None
    assert read_marks(table)[0].pixel == (3.0, 4.0)


def test_a_table_of_an_earlier_version_is_the_sessions_own(whole: Block, tmp_path: Path) -> None:
    journal, table, own = tmp_path / "journal.sqlite", tmp_path / "marks.csv", without_marks(whole)
    first = MarkingSession(own, journal, table, lambda click: Snapped(click.pixel, np.eye(2), "checker"))
    first.mark(own.control_points.name[0], own.photographs[0].name, (100.0, 50.0))
    first.close()
    table.write_text(table.read_text().replace(",checker,", ",quartered,"))
    again = MarkingSession(own, journal, table)
    again.close()
    assert again.set_aside is None
    assert ",checker," in table.read_text()


def test_a_session_that_only_looks_changes_neither_table_nor_journal(whole: Block, tmp_path: Path) -> None:
    journal, table = tmp_path / "journal.sqlite", tmp_path / "marks.csv"
    table.write_text("point,photograph,u,v\nmine,a.jpg,1,2\n")
    before = table.read_bytes(), table.stat().st_mtime_ns
    looking = MarkingSession(whole, journal, None)
    assert len(looking.snapshot().state.marks) == len(whole.control_points.mark_point)
    looking.set_proposals(())
    with pytest.raises(ControlPointError, match="only looks"):
        looking.remove(*marks_of(whole, 0)[0][:2])
    looking.close()
    assert (table.read_bytes(), table.stat().st_mtime_ns) == before
    assert read_journal(journal) == ()
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix == ".csv") == ["marks.csv", "proposals.csv"]


def test_what_cannot_be_is_refused_and_not_kept(session: MarkingSession, tmp_path: Path) -> None:
    name, photograph = session.block.control_points.name[0], session.block.photographs[0].name
    for wrong in (("?", photograph, (1.0, 1.0)), (name, "?", (1.0, 1.0)), (name, photograph, (-1.0, 1.0))):
        with pytest.raises(ControlPointError):
            session.mark(*wrong)
    with pytest.raises(ControlPointError, match="mark it first"):
        session.set_doubtful(name, photograph, True)
    with pytest.raises(ControlPointError, match="already"):
        session.add_point(SurveyedPoint(name))
    with pytest.raises(ControlPointError, match="standard deviations"):
        session.add_point(SurveyedPoint("n", (1.0, 2.0, 3.0)))
    session.add_point(SurveyedPoint("tie"))
    with pytest.raises(ControlPointError, match="coordinates"):
        session.set_role("tie", "check")
    assert len(read_journal(tmp_path / "journal.sqlite")) == 1


def test_points_that_were_added_and_roles_are_in_the_block(session: MarkingSession) -> None:
    frame, own = session.block.frame, session.block.control_points
    place = frame.map_from_world(np.array([[1.0, 2.0, 3.0]]))[0]
    session.add_point(SurveyedPoint("new", (float(place[0]), float(place[1]), float(place[2])), (0.01, 0.01, 0.02)))
    session.add_point(SurveyedPoint("manual"))
    session.set_role(own.name[0], "check")
    session.mark("manual", session.block.photographs[1].name, (5.0, 6.0))
    snapshot = session.snapshot()
    made = marked_block(session.block, snapshot.state, snapshot.roles, session.numbers).control_points
    assert made.name == (*own.name, "new", "manual")
    assert made.role[0] == "check"
    np.testing.assert_allclose(made.position_world_m[len(own)], [1.0, 2.0, 3.0], atol=1e-6)
    assert np.isnan(made.position_world_m[len(own) + 1]).all()
    assert made.mark_point.tolist() == [len(own) + 1]


def test_predictions_follow_the_marks_and_a_wrong_one_is_named(whole: Block, session: MarkingSession) -> None:
    session.start()
    wait_until_assessed(session)
    first = session.snapshot().assessment
    assert first is not None
    assert first.places is not None
    for point in range(len(whole.control_points)):
        for mark in marks_of(whole, point):
            session.mark(*mark)
    name, photograph, (u, v) = in_best_photograph(whole)
    session.mark(name, photograph, (u + 30.0, v))
    wait_until_assessed(session)
    after = session.snapshot().assessment
    assert after is not None
    assert after.places is not None
    assert np.median(after.places.radius_px) < 0.7 * np.median(first.places.radius_px)
    assert [place for place, one in after.compared.items() if one.rejected] == [(name, photograph)]
    assert after.compared[name, photograph].distance_px == pytest.approx(30.0, rel=0.2)
    assert after.sigma_m(name) is not None


def test_a_click_is_snapped_where_there_is_something_to_snap_to(whole: Block, tmp_path: Path) -> None:
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])

    def snap(click: Click) -> Snapped | None:
        u, v = click.pixel
        return Snapped((u + 0.5, v - 0.25), covariance, "checker") if click.photograph else None

    session = MarkingSession(without_marks(whole), tmp_path / "j", tmp_path / "marks.csv", snap)
    name, photographs = session.block.control_points.name[0], session.block.photographs
    mark = session.mark(name, photographs[1].name, (200.3, 90.1))
    assert mark.pixel == pytest.approx((200.8, 89.85))
    assert mark.sigma_px == pytest.approx((0.2, 0.3))
    assert mark.rho == pytest.approx(0.01 / 0.06)
    assert (mark.kind, mark.raw_pixel) == ("checker", (200.3, 90.1))
    assert session.mark(name, photographs[1].name, (200.3, 90.1), raw=True).kind == "raw"
    assert session.mark(name, photographs[0].name, (200.3, 90.1)).kind == "raw", "nothing was found"
    session.close()


HAND = """
import sys
from pathlib import Path
from makers import without_marks
from photogram.marking.page.session import MarkingSession
from photogram.marking.tagged_block import tagged_block
from photogram.simulation.simulated_survey import simulate_block, whole_survey_plan
whole = tagged_block(simulate_block(whole_survey_plan(), 1).block)
session = MarkingSession(without_marks(whole), Path(sys.argv[1]) / "journal.sqlite", Path(sys.argv[1]) / "marks.csv")
number = 0
while True:
    for photograph in whole.photographs:
        number += 1
        session.mark(whole.control_points.name[0], photograph.name, (float(number % 100), 1.0))
        print(number, photograph.name, flush=True)
"""


def test_killed_at_any_moment_no_answered_mark_is_lost_and_no_file_is_half(tmp_path: Path, whole: Block) -> None:
    rng = np.random.default_rng(4)
    for _ in range(3):
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([*sys.path])}
        hand = subprocess.Popen(
            [sys.executable, "-c", HAND, str(tmp_path)], stdout=subprocess.PIPE, text=True, env=environment
        )
        assert hand.stdout is not None
        first = hand.stdout.readline()
        time.sleep(float(rng.uniform(0.02, 0.3)))
        hand.send_signal(signal.SIGKILL)
        said = [first, *hand.stdout.read().splitlines(keepends=True)]
        hand.wait()
        number, name = [line for line in said if line.endswith("\n")][-1].split()
        read_marks(tmp_path / "marks.csv")  # whole
        again = MarkingSession(without_marks(whole), tmp_path / "journal.sqlite", tmp_path / "marks.csv")
        kept = {m.photograph: m.pixel[0] for m in again.snapshot().state.marks.values()}
        table = {m.photograph: m.pixel[0] for m in read_marks(tmp_path / "marks.csv")}
        again.close()
        assert kept == table
        # one more may have been on its way
        assert kept[name] == int(number) % 100 or len(whole.photographs) == 1


def test_roles_of_the_project_are_kept_in_it_and_taken_back(session: MarkingSession, tmp_path: Path) -> None:
    kept: list[dict[str, str]] = []
    block = session.block
    name = block.control_points.name[0]
    before = block.control_points.role[0]
    other: Role = "check" if before == "control" else "control"

    def opened() -> MarkingSession:
        return MarkingSession(
            block, tmp_path / "roles" / "journal.sqlite", tmp_path / "roles" / "marks.csv",
            keep_roles=lambda roles: kept.append(dict(roles)),
        )  # fmt: skip

    (tmp_path / "roles").mkdir()
    with closing(opened()) as first:
        first.set_role(name, other)
        first.undo()
        first.redo()
        first.add_point(SurveyedPoint("heap", None))
        assert kept == [{name: other}, {name: before}, {name: other}]
        assert first.roles[name] == other
    with closing(opened()) as again:  # of a project in which somebody has changed the role back
        assert again.roles[name] == before
        again.set_role(name, other)
        assert again.roles[name] == other
    assert kept[3:] == [{name: other}]


def test_a_role_that_cannot_be_kept_is_not_taken(session: MarkingSession, tmp_path: Path) -> None:
    block = session.block
    name, before = block.control_points.name[0], block.control_points.role[0]
    other: Role = "check" if before == "control" else "control"
    writable = [True]

    def keep(_: Mapping[str, Role]) -> None:
        if not writable[0]:
            raise WorkspaceError("project.yaml: cannot be written")

    (tmp_path / "roles").mkdir()
    places = tmp_path / "roles" / "journal.sqlite", tmp_path / "roles" / "marks.csv"
    with closing(MarkingSession(block, *places, keep_roles=keep)) as marking:
        marking.set_role(name, other)
        writable[0] = False
        with pytest.raises(WorkspaceError, match="cannot be written"):
            marking.undo()
        assert marking.roles[name] == other
        with pytest.raises(WorkspaceError, match="cannot be written"):
            marking.set_role(name, before)
        assert marking.roles[name] == other
        writable[0] = True
        marking.set_role(name, before)
        assert marking.roles[name] == before
