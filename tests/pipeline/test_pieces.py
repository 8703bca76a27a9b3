"""Pieces of a stage: results in order, from threads and processes; what fails says so, what is lost is done again."""

import pickle
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from losing_workers import FAILING, SQUARES, UnpicklableError

from photogram.errors import DamagedStageError, PhotogramError, SettingError, WorkspaceError
from photogram.pipeline.pipeline import load_project, open_run
from photogram.pipeline.store import pieces
from photogram.pipeline.store.pieces import PieceType, StageWork, portable, run_pieces, stage_work
from photogram.pipeline.store.pools import ProcessPool
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.work_orders import open_order


@contextmanager
def stage_of(survey: Path, pool: ProcessPool | None) -> Iterator[tuple[Run, Path]]:
    """Give a run of a survey and the folder of a stage at work."""
    folder = survey / "work/some.stage.partial"
    folder.mkdir(parents=True)
    with open_run(load_project(survey / "project.yaml"), pool=pool) as run, open_order(run, folder):
        yield run, folder


def test_results_come_in_order_from_threads_and_never_more_at_once_than_asked_for(survey: Path) -> None:
    lock, busy, most = threading.Lock(), 0, 0

    def count(_work: StageWork, item: int) -> int:
        nonlocal busy, most
        with lock:
            busy += 1
            most = max(most, busy)
        time.sleep(0.01 * (item % 3))
        with lock:
            busy -= 1
        return -item

    with stage_of(survey, None) as (run, folder):
        assert list(run_pieces(run, folder, PieceType(stage_work, count), range(20), at_once=1)) == [
            -n for n in range(20)
        ]
        assert most == 1
        assert list(run_pieces(run, folder, PieceType(stage_work, count), range(20))) == [-n for n in range(20)]


def test_processes_prepare_once_fail_clearly_and_are_given_up_when_lost_again_and_again(
    survey: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pieces, "MOST_LOSSES", 0)
    with ProcessPool(2) as pool, stage_of(survey, pool) as (run, folder):
        assert list(run_pieces(run, folder, SQUARES, range(9))) == [4000 + n**2 for n in range(9)]
        assert 1 <= len(list(folder.glob("*.txt"))) <= 2
        assert run.taken_memory() > 10_000_000
        with pytest.raises(RuntimeError, match="UnpicklableError: 1 and 2"):
            list(run_pieces(run, folder, FAILING, range(5)))
        assert list(run_pieces(run, folder, FAILING, range(3))) == [0, 1, 4]
        with pytest.raises(WorkspaceError, match="use fewer workers; what is done is kept"):
            list(run_pieces(run, folder, FAILING, [1, 5]))


@pytest.mark.parametrize(
    "fault",
    [
        DamagedStageError("dense", Path("/work/dense.stage/grid.json"), "is missing"),
        SettingError("workers", "must be 1"),
        WorkspaceError("no room"),
        ValueError("plain"),
    ],
)
def test_errors_travel_between_processes_as_they_are(fault: Exception) -> None:
    assert portable(fault) is fault
    other = pickle.loads(pickle.dumps(fault))
    assert type(other) is type(fault)
    assert str(other) == str(fault)
    assert vars(other) == vars(fault)
    assert isinstance(other, PhotogramError) == isinstance(fault, PhotogramError)


def test_an_error_that_cannot_travel_is_said_by_one_that_can() -> None:
    said = portable(UnpicklableError(1, 2))
    assert isinstance(said, RuntimeError)
    assert str(said) == "UnpicklableError: 1 and 2"
