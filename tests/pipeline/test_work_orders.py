"""Work orders: a process that is not the run's own works on the same survey with the same programs, or says why not."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from photogram.errors import WorkspaceError
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.store import work_orders
from photogram.pipeline.store.pools import ProcessPool, WorkOrder
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.work_orders import check_pool, missing_paths, open_order, remote_run, written_order
from photogram.pipeline.store.workspace import Workspace

Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]


@pytest.fixture
def run(survey: Path) -> Run:
    """A run of the small survey whose pool is never used."""
    (survey / "work/some.stage.partial").mkdir(parents=True)
    none: Any = None
    return Run(load_project(survey / "project.yaml"), Workspace(survey / "work"), none, ProcessPool(1))


def order_of(run: Run) -> tuple[Path, Any]:
    folder = run.workspace.folder / "some.stage.partial"
    return folder, open_order(run, folder)


def test_an_order_ends_with_its_stage(run: Run) -> None:
    folder, at_work = order_of(run)
    with at_work:
        assert not run.orders[folder].note.exists()
        order = written_order(run, folder)
        assert order.note.is_file()
        assert missing_paths(order, [str(folder), "/no/where"]) == ["/no/where"]
    assert not run.orders
    with pytest.raises(WorkspaceError, match="under the same path, on a shared file system"):
        remote_run(order)


def test_a_project_file_that_has_changed_is_not_worked_on(run: Run, edit: Edit) -> None:
    folder, at_work = order_of(run)
    with at_work:
        order = written_order(run, folder)
        edit(run.project.path, lambda v: v.update(matching={"ratio": 0.7}))
        with pytest.raises(WorkspaceError, match="has changed since the run began"):
            remote_run(order)


def test_other_programs_are_refused(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, at_work = order_of(run)
    found = work_orders.programs()
    with at_work:
        order = written_order(run, folder)
        monkeypatch.setattr(work_orders, "programs", lambda: {**found, "photogram": "0.1", "opencv": "3.0"})
        with pytest.raises(WorkspaceError, match=r"photogram 0\.1 in place of .*, opencv 3\.0 in place of"):
            remote_run(order)


def test_what_a_killed_run_has_left_is_removed_and_nothing_else(run: Run) -> None:
    work = run.workspace.folder
    (work / ".photogram-order-0123456789abcdef.json").touch()
    (work / ".photogram-order-mine.json").touch()
    check_pool(run)
    assert [path.name for path in work.glob(".photogram*")] == [".photogram-order-mine.json"]


def test_the_same_project_is_known_wherever_it_was_read_from(survey: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(survey)
    mark = work_orders._project_mark
    here = load_project(Path("project.yaml"), Path("photographs"))
    none: Any = None
    order = work_orders.new_order(Run(here, Workspace(here.work), none), survey)
    assert order == WorkOrder(survey / "project.yaml", survey / "photographs", survey, order.note)
    assert mark(load_project(order.project, order.photographs)) == mark(here)
