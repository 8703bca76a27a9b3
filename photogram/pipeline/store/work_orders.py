"""Work orders: how a process that is not the run's own comes to the same run of a project.

It is told the project file and the folders. A note in the work folder, written before the first piece of a stage and
removed when the stage ends, holds what must be the same for both: the version of photogram and of what it computes
with, what the project file says, and the content of every photograph. A process that does not find it does not see the
work folder, or comes too late, and writes nothing.
"""

import os
import platform
import re
import secrets
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
from threadpoolctl import threadpool_limits

from photogram import __version__
from photogram.errors import WorkspaceError
from photogram.files.matlab import read_camera
from photogram.files.npz_json import fingerprint, read_json, write_json
from photogram.pipeline.store.memory import reset_highest_memory
from photogram.pipeline.store.pools import WorkOrder
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.stage_files import journalled, own_journal
from photogram.pipeline.store.workspace import Workspace
from photogram.project.project import Project, read_project
from photogram.report.versions import versions

_NOTE = re.compile(r"\.photogram-order-[0-9a-f]{16}\.json")


def programs() -> dict[str, str | None]:
    """Return the versions of photogram and of all that pieces are computed with, and the kind of the processor."""
    used = {name: version for name, version in versions().items() if name != "gtsam"}
    return {"photogram": __version__, **used, "processor": platform.machine()}


def place() -> str:
    """Return the machine and the process, as messages name them."""
    return f"{socket.gethostname()}, process {os.getpid()}"


def different_programs(expected: dict[str, str | None], there: dict[str, str | None]) -> str:
    """Return what differs between two of ``programs``, empty where nothing does."""
    names = [name for name in {**expected, **there} if expected.get(name) != there.get(name)]
    return ", ".join(f"{name} {there.get(name)} in place of {expected.get(name)}" for name in names)


def _project_mark(project: Project) -> str:
    """Return the fingerprint of what a project says, wherever it was read from."""
    photographs = tuple(replace(p, path=p.path.absolute()) for p in project.photographs)
    path = project.path.absolute()
    return fingerprint(replace(project, path=path, photographs=photographs, photographs_folder=None, warnings=()))


def new_order(run: Run, folder: Path) -> WorkOrder:
    """Return an order for the stage that works in a partial folder; its note is not written yet."""
    project = run.project
    photographs = None if project.photographs_folder is None else project.photographs_folder.absolute()
    note = run.workspace.folder.absolute() / f".photogram-order-{secrets.token_hex(8)}.json"
    return WorkOrder(project.path.absolute(), photographs, folder.absolute(), note)


def _remove_notes(work: Path) -> None:
    """Remove from a work folder, which this process holds, the notes of runs that were killed."""
    for entry in tuple(os.scandir(work)):
        if _NOTE.fullmatch(entry.name):
            with suppress(OSError):
                os.unlink(entry.path)


def check_pool(run: Run) -> None:
    """Remove what a killed run has left of its orders. Raises WorkspaceError where a process of the pool does not see
    the survey, or has other programs."""
    if run.pool is None:
        return
    _remove_notes(run.workspace.folder)
    order = new_order(run, run.workspace.folder)
    write_json(order.note, {})
    try:
        run.pool.check(order, [order.project, *[p.path.absolute() for p in run.project.photographs[:1]]])
    finally:
        order.note.unlink()


@contextmanager
def open_order(run: Run, folder: Path) -> Iterator[None]:
    """Let the processes of a run's pool do pieces of the stage that works in ``folder`` while the block runs; without a
    pool nothing happens."""
    if run.pool is None:
        yield
        return
    order = run.orders[folder] = new_order(run, folder)
    try:
        yield
    finally:
        del run.orders[folder]
        with suppress(OSError):
            order.note.unlink(missing_ok=True)


def written_order(run: Run, folder: Path) -> WorkOrder:
    """Return the order of the stage that works in ``folder``, with its note written."""
    order = run.orders[folder]
    if not order.note.is_file():
        marks = {"photographs": run.photograph_fingerprints, "masks": run.mask_fingerprints}
        write_json(order.note, {"programs": programs(), "project": _project_mark(run.project), **marks})
    return order


@dataclass(frozen=True)
class RemoteRun:
    """An order as a process carries it out: its run, and what was prepared for its pieces, by the function that did."""

    order: WorkOrder
    run: Run
    prepared: dict[Any, Any] = field(default_factory=dict)
    closing: ExitStack = field(default_factory=ExitStack)


_open: dict[str, RemoteRun] = {}
_lock = Lock()


def remote_run(order: WorkOrder) -> RemoteRun:
    """Return the order of a stage as this process carries it out, opened once. Raises WorkspaceError where the work
    folder is not there, the order has ended, the project file has changed, or the programs are of other versions."""
    with _lock:
        kept = _open.get(str(order.note))
        if kept is None:
            for former in tuple(_open.values()):
                former.closing.close()
            _open.clear()
            kept = _opened(order)
            _open[str(order.note)] = kept
        elif not order.note.is_file():
            raise _ended(order)
        return kept


def prepared(kept: RemoteRun, prepare: Any) -> Any:  # noqa: ANN401 - whatever the kind of pieces needs
    """Return what ``prepare`` makes of a remote run and its folder, once in this process while pieces need it."""
    with _lock:
        if prepare not in kept.prepared:
            kept.prepared.clear()  # a stage does one kind of pieces after the other
            kept.prepared[prepare] = prepare(kept.run, kept.order.folder)
        return kept.prepared[prepare]


def missing_paths(order: WorkOrder, paths: list[str]) -> list[str]:
    """Return which of some paths this process does not see; the order's note is one of them."""
    return [path for path in [str(order.note), *paths] if not os.path.exists(path)]


def not_seen(paths: list[str], where: str) -> WorkspaceError:
    """Return the error that a process does not see files of a survey."""
    return WorkspaceError(
        f"{paths[0]}: not there for the worker on {where}: every worker needs the project, its photographs and its "
        "work folder under the same path, on a shared file system"
    )


def _ended(order: WorkOrder) -> WorkspaceError:
    return not_seen([str(order.note)], place())


def _opened(order: WorkOrder) -> RemoteRun:
    if not order.note.is_file() or not order.folder.is_dir():
        raise _ended(order)
    note = read_json(order.note)
    other = different_programs(note["programs"], programs())
    if other:
        raise other_programs(other, place())
    project = read_project(order.project, order.photographs, read_matlab_camera=read_camera)
    if _project_mark(project) != note["project"]:
        raise WorkspaceError(
            f"{order.project}: what it says, or a file that it names, has changed since the run began: start it again"
        )
    cv2.setNumThreads(1)
    threadpool_limits(1)
    reset_highest_memory()
    closing = ExitStack()
    run = Run(project, Workspace(order.note.parent), closing.enter_context(ThreadPoolExecutor(1)))
    run.__dict__["photograph_fingerprints"] = tuple(note["photographs"])
    run.__dict__["mask_fingerprints"] = tuple(tuple(marks) for marks in note["masks"])

    def still_ordered() -> None:
        if not order.note.is_file():
            raise _ended(order)

    closing.enter_context(journalled(order.folder, own_journal(f"{socket.gethostname()}-{os.getpid()}"), still_ordered))
    return RemoteRun(order, run, closing=closing)


def other_programs(different: str, where: str) -> WorkspaceError:
    """Return the error that a process has other versions of the programs."""
    return WorkspaceError(
        f"the worker on {where} has {different}: results would not be the same: install the same versions everywhere"
    )
