"""Processes that do pieces of a survey: what the stages know of them, and such a pool of processes on this machine.

Threads share arrays and one copy of the program, and are the default. Processes need no shared memory: they read and
write the work folder, and any of them may be lost.
"""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self, TypeVar

from photogram.errors import check_range

ResultT = TypeVar("ResultT")

MOST_PROCESSES = 61 if sys.platform == "win32" else 1024
"""A process of Windows waits for 63 others at most, of which the pool takes two."""


@dataclass(frozen=True)
class WorkOrder:
    """What a process is told of a stage that works: the project file and the folder of photographs in place of the
    file's own, the partial folder of the stage, and the file of the work folder that says what else holds for it."""

    project: Path
    photographs: Path | None
    folder: Path
    note: Path


class Pool(Protocol):
    """Processes that do pieces of work, on this machine or on others."""

    @property
    def size(self) -> int:
        """Return how many pieces are worked on at once, 1 at least."""

    @property
    def here(self) -> bool:
        """Return whether all of them share the memory of this machine."""

    def submit(self, work: Callable[..., ResultT], *values: object) -> Future[ResultT]:
        """Have ``work``, a function of a module, done by one of the processes."""

    def was_lost(self, error: BaseException) -> bool:
        """Return whether a piece ended so because its process was lost, so that it is to be submitted again.

        Raises WorkspaceError where nothing can be submitted any more.
        """

    def wait_on(self) -> None:
        """Be told that no piece has ended for a while. Raises WorkspaceError where none will."""

    def check(self, order: WorkOrder, paths: Sequence[Path]) -> None:
        """Raise WorkspaceError where one of the processes cannot carry out orders: it does not see ``paths``, or has
        another version of photogram."""


class _Spawning(SpawnContext):
    """Processes that begin anew, and which were made: a forked copy of a process with threads may wait for ever for one
    of them."""

    def __init__(self) -> None:
        super().__init__()
        self.made: list[SpawnProcess] = []

    def Process(self, *values: Any, **named: Any) -> SpawnProcess:  # type: ignore[override] # noqa: ANN401, N802
        """Return a process that is not started yet."""
        process = SpawnProcess(*values, **named)
        self.made.append(process)
        return process


@dataclass
class ProcessPool:
    """Processes of this machine; those that were lost are replaced. A context manager, which ends them."""

    size: int

    def __post_init__(self) -> None:
        check_range("workers", self.size, 1, MOST_PROCESSES)
        self._executor: ProcessPoolExecutor | None = None
        self._context = _Spawning()

    @property
    def here(self) -> bool:
        """Return that all of them share the memory of this machine."""
        return True

    def submit(self, work: Callable[..., ResultT], *values: object) -> Future[ResultT]:
        """Have ``work``, a function of a module, done by one of the processes."""
        if self._executor is not None:
            try:
                return self._executor.submit(work, *values)
            except (BrokenProcessPool, ValueError, OSError):  # of another that is started while one is lost
                self._end(at_once=True)
        self._context = _Spawning()
        self._executor = ProcessPoolExecutor(self.size, self._context, _begin)
        return self._executor.submit(work, *values)

    def was_lost(self, error: BaseException) -> bool:
        """Return whether a piece ended so because its process was lost: then all that waited have ended so."""
        return isinstance(error, BrokenProcessPool)

    def wait_on(self) -> None:
        """Do nothing: where a process is lost, its pieces end."""

    def check(self, order: WorkOrder, paths: Sequence[Path]) -> None:
        """Do nothing: the processes see what this one sees."""

    def _end(self, *, at_once: bool) -> None:
        """End the processes: when they have done what they are at, or ``at_once``, since it will be done again."""
        if self._executor is None:
            return
        if at_once:
            for process in self._context.made:
                if process.pid is not None:
                    process.kill()
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._executor = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end(at_once=error is not None)


def _begin() -> None:
    """Prepare a process of the pool: Ctrl-C is its parent's, and it does not outlive that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)
