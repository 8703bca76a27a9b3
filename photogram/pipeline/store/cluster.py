"""Workers of a Dask cluster: the processes of a pool, on as many machines as there are.

A Dask scheduler runs whatever it is sent by anyone who reaches it; docs/cluster.md says how to close it to others.
"""

import os
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from photogram.errors import WorkspaceError
from photogram.pipeline.store.pools import WorkOrder
from photogram.pipeline.store.work_orders import different_programs, missing_paths, not_seen, other_programs, programs

ResultT = TypeVar("ResultT")

CONNECT_S = 20
"""After so long without an answer there is no scheduler."""

WITHOUT_WORKERS_S = 120.0
"""After so long without any worker the run ends; what is done is kept."""


@dataclass
class Cluster:
    """The workers of a Dask scheduler at ``address``, through a client of it."""

    address: str
    client: Any

    def __post_init__(self) -> None:
        self._executor = self.client.get_executor(pure=False)
        self._alone_since: float | None = None

    @property
    def size(self) -> int:
        """Return how many pieces are worked on at once."""
        return max(sum(self._threads().values()), 1)

    @property
    def here(self) -> bool:
        """Return that they have memory of their own."""
        return False

    def submit(self, work: Callable[..., ResultT], *values: object) -> Future[ResultT]:
        """Have ``work``, a function of a module, done by one of the workers."""
        future: Future[ResultT] = self._executor.submit(work, *values)
        return future

    def was_lost(self, error: BaseException) -> bool:
        """Return that nothing is to be submitted again: the scheduler does that itself where a worker is lost.

        Raises WorkspaceError where it has given up, or is lost itself.
        """
        from distributed import KilledWorker

        if isinstance(error, KilledWorker):
            raise WorkspaceError(
                f"{self.address}: several workers died on the same task, probably out of memory: start fewer workers "
                "on each machine; finished work is kept"
            ) from error
        if isinstance(error, CancelledError):
            raise self._lost() from error
        return False

    def wait_on(self) -> None:
        """Look for workers where no piece has ended for a while. Raises WorkspaceError where there have been none for
        long, or the scheduler is gone."""
        if self._threads():
            self._alone_since = None
            return
        now = time.monotonic()
        self._alone_since = self._alone_since or now
        if now - self._alone_since > WITHOUT_WORKERS_S:
            raise WorkspaceError(
                f"{self.address}: no worker is left: start 'dask worker {self.address} --nthreads 1' and run the same "
                "command again; what is done is kept"
            )

    def _threads(self) -> dict[str, int]:
        """Return how many threads each worker has. Raises WorkspaceError where the scheduler is gone."""
        try:
            workers = self.client.nthreads() if self.client.status == "running" else None
        except (OSError, TimeoutError) as error:
            raise self._lost() from error
        if workers is None:
            raise self._lost()
        return {str(worker): int(threads) for worker, threads in workers.items()}

    def _lost(self) -> WorkspaceError:
        return WorkspaceError(
            f"{self.address}: the connection to the scheduler is lost: run the same command again; what is done is kept"
        )

    def check(self, order: WorkOrder, paths: Sequence[Path]) -> None:
        """Raise WorkspaceError where there is no worker, or one does not see ``paths`` or has other programs."""
        answers = self.client.run(look_around, order, [str(path) for path in paths], on_error="return")
        if not answers:
            raise WorkspaceError(
                f"{self.address}: this scheduler has no workers: start 'dask worker {self.address} --nthreads 1' on "
                "every machine"
            )
        for worker, seen in answers.items():
            if isinstance(seen, BaseException):
                raise WorkspaceError(
                    f"the worker {worker} cannot run photogram tasks ({type(seen).__name__}: {seen}): install "
                    "there the version of photogram that is here"
                )
            where = f"{seen['machine']} ({worker})"
            other = different_programs(programs(), seen["programs"])
            if other:
                raise other_programs(other, where)
            if seen["missing"]:
                raise not_seen(seen["missing"], where)
            if (seen["machine"], seen["process"]) == (socket.gethostname(), os.getpid()):
                raise WorkspaceError(f"the worker {worker} is this process: start workers in processes of their own")


def look_around(order: WorkOrder, paths: list[str]) -> dict[str, Any]:
    """Return what a worker is and sees."""
    return {
        "machine": socket.gethostname(),
        "process": os.getpid(),
        "programs": programs(),
        "missing": missing_paths(order, paths),
    }


@contextmanager
def cluster(address: str) -> Iterator[Cluster]:
    """Connect to the Dask scheduler at an address, as tcp://host:8786; certificates for tls:// are those of Dask's own
    configuration.

    Raises WorkspaceError where distributed is not installed, or no scheduler answers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise WorkspaceError("a cluster needs Dask: pip install 'photogram[cluster]'") from error
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        raise WorkspaceError(
            f"{address}: no Dask scheduler answers there ({error}): start one with 'dask scheduler', and give the "
            "address that it prints"
        ) from error
    try:
        yield Cluster(address, client)
    finally:
        client.close(timeout=5)
