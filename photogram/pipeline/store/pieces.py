"""Pieces of a stage: one photograph, one pair, one tile each, done in threads or by other processes.

A kind of pieces is two plain functions of modules. ``prepare`` makes of a run and the folder of a stage what all pieces
need; ``do`` does one of them. Threads share what was prepared; another process prepares it itself, from files, once for
each stage. A piece writes its files whole or not at all and returns little; done twice it writes the same bytes. So a
process that is lost costs no more than its pieces.
"""

import pickle
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from photogram.errors import PhotogramError, WorkspaceError
from photogram.pipeline.store.memory import highest_memory
from photogram.pipeline.store.pools import Pool, WorkOrder
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.work_orders import prepared, remote_run, written_order

StateT = TypeVar("StateT")
ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")

AHEAD = 64
"""Pieces that are submitted and not done, at least."""

MOST_LOSSES = 3
"""Times that the process of one piece may be lost."""

PATIENCE_S = 20.0
"""After so long without a result the pool is asked whether there will be one."""


@dataclass(frozen=True)
class PieceType(Generic[StateT, ItemT, ResultT]):
    """A kind of pieces: ``prepare`` what they all need, ``do`` one of them. Both are functions of modules, and items
    and results are small and can be pickled."""

    prepare: Callable[[Run, Path], StateT]
    do: Callable[[StateT, ItemT], ResultT]


StageWork = tuple[Run, Path]


def stage_work(run: Run, folder: Path) -> StageWork:
    """Return the run and the folder of the stage: what pieces need that need nothing else."""
    return run, folder


def run_pieces(
    run: Run,
    folder: Path,
    kind: PieceType[StateT, ItemT, ResultT],
    items: Iterable[ItemT],
    *,
    state: StateT | None = None,
    at_once: int | None = None,
) -> Iterator[ResultT]:
    """Do the pieces of a stage in the run's processes, or in its threads where it has none, and yield their results in
    the order of ``items``.

    ``state`` is what ``prepare`` would return here, where it is known already; ``at_once`` is how many pieces the
    memory of one machine holds. Raises what the first piece raises that fails, WorkspaceError where processes are lost
    again and again.
    """
    pool, listed = run.pool, list(items)
    if pool is None:
        shared = kind.prepare(run, folder) if state is None else state
        yield from _in_order(lambda item: run.executor.submit(kind.do, shared, item), listed, at_once or AHEAD, None)
        return
    order = written_order(run, folder)
    most = max(AHEAD, 4 * pool.size)
    if at_once is not None and pool.here:
        most = min(most, at_once)
    for result, memory in _in_order(lambda item: pool.submit(_done, order, kind, item), listed, most, pool):
        run.note_memory(memory)
        yield result


def _done(order: WorkOrder, kind: PieceType[StateT, ItemT, ResultT], item: ItemT) -> tuple[ResultT, int | None]:
    """Do a piece in this process, which has nothing but the order, and return with its result the most memory taken."""
    try:
        kept = remote_run(order)
        return kind.do(prepared(kept, kind.prepare), item), highest_memory()
    except PhotogramError:
        raise
    except Exception as error:
        raise portable(error) from error


def portable(error: Exception) -> Exception:
    """Return an error that can be sent to another process: itself, or one that says the same."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # noqa: BLE001 - classes of libraries fail in their own ways
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _in_order(
    submit: Callable[[ItemT], Future[ResultT]], items: list[ItemT], most: int, pool: Pool | None
) -> Iterator[ResultT]:
    """Yield the results of items in their order, ``most`` of them submitted at a time."""
    waiting, ended = dict[Future[ResultT], int](), dict[int, Future[ResultT]]()
    again, losses, begun, given = list[int](), dict[int, int](), 0, 0
    try:
        while given < len(items):
            while len(waiting) < most and (again or begun < min(len(items), given + 4 * most)):
                number = again.pop() if again else begun
                begun = max(begun, number + 1)
                waiting[submit(items[number])] = number
            done = wait(waiting, None if pool is None else PATIENCE_S, FIRST_COMPLETED).done
            if pool is not None and not done:
                pool.wait_on()
            for future in done:
                number = waiting.pop(future)
                error = CancelledError() if future.cancelled() else future.exception()
                if pool is not None and error is not None and pool.was_lost(error):
                    losses[number] = losses.get(number, 0) + 1
                    if losses[number] > MOST_LOSSES:
                        raise lost_for_good(number, len(items)) from error
                    again.append(number)
                else:
                    ended[number] = future
            while given in ended:
                yield ended.pop(given).result()
                given += 1
    finally:
        for future in waiting:
            future.cancel()


def lost_for_good(number: int, total: int) -> WorkspaceError:
    """Return the error that the process of a piece was lost too often."""
    return WorkspaceError(
        f"piece {number + 1} of {total}: {MOST_LOSSES + 1} worker processes ended while they were at it, probably "
        "because the memory was full: use fewer workers; what is done is kept"
    )
