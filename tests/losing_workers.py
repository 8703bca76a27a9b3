"""Workers that are lost: imported by the processes of pools too, which a test module is not."""

import os
import signal
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from photogram.pipeline.store.pieces import PieceType, StageWork, stage_work
from photogram.pipeline.store.pools import WorkOrder
from photogram.pipeline.store.run import Run


def end(marker: Path) -> None:
    """End this process as the system ends one that takes too much memory, once for each marker."""
    marker.touch()
    os.kill(os.getpid(), signal.SIGKILL)


def lost_once(markers: Path, work: Callable[..., Any], order: WorkOrder, *values: Any) -> Any:
    """Do a piece; the first process that is at a stage is lost before its file takes its name, or else before it
    returns."""
    marker = markers / order.folder.name
    if marker.exists():
        return work(order, *values)
    rename = os.replace

    def killed(source: Any, target: Any) -> None:
        if Path(target).is_relative_to(order.folder):
            end(marker)
        rename(source, target)

    os.replace = killed  # type: ignore[assignment]
    work(order, *values)
    end(marker)


def losing(pool: Any, markers: Path) -> Any:
    """Have a pool lose a process in each stage; ``markers`` is a folder that then names them."""
    markers.mkdir()
    submit = pool.submit

    def submitted(work: Callable[..., Any], *values: Any) -> Future[Any]:
        future: Future[Any] = submit(lost_once, markers, work, *values)
        return future

    pool.submit = submitted
    return pool


class UnpicklableError(Exception):
    """An error that cannot be sent to another process."""

    def __init__(self, first: int, second: int) -> None:
        super().__init__(f"{first} and {second}")

    def __reduce__(self) -> str:
        raise TypeError("it holds what cannot be pickled")


def _fail(_work: StageWork, item: int) -> int:
    if item == 3:
        raise UnpicklableError(1, 2)
    if item == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    return item**2


def _count(run: Run, folder: Path) -> list[int]:
    (folder / f"{os.getpid()}.txt").touch()
    return [1000 * len(run.names)]


def _square(prepared: list[int], item: int) -> int:
    return prepared[0] + item**2


FAILING = PieceType(stage_work, _fail)
SQUARES = PieceType(_count, _square)
