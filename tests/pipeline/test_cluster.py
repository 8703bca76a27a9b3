"""Clusters: workers that cannot do pieces of a survey are refused before any work; what is lost is said."""

from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

import pytest

from photogram.errors import WorkspaceError
from photogram.pipeline.store import cluster as clusters
from photogram.pipeline.store.cluster import Cluster, cluster, look_around
from photogram.pipeline.store.pools import WorkOrder

ADDRESS = "tcp://127.0.0.1:1"


class Client:
    """A client of no scheduler, whose workers say what they are given to say."""

    status = "running"

    def __init__(self, said: dict[str, Any], threads: dict[str, int] | None = None) -> None:
        self.said, self.threads = said, threads or {}

    def get_executor(self, *, pure: bool) -> None:
        assert not pure

    def nthreads(self) -> dict[str, int]:
        return self.threads

    def run(self, function: Any, order: WorkOrder, paths: list[str], *, on_error: str) -> dict[str, Any]:
        assert function is look_around
        assert on_error == "return"
        seen = look_around(order, paths)
        return {name: {**seen, **said} if isinstance(said, dict) else said for name, said in self.said.items()}


@pytest.fixture
def order(tmp_path: Path) -> WorkOrder:
    """An order that this process sees."""
    (tmp_path / "note.json").touch()
    return WorkOrder(tmp_path / "project.yaml", None, tmp_path, tmp_path / "note.json")


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ({}, "has no workers: start 'dask worker tcp://127.0.0.1:1 --nthreads 1'"),
        ({"tcp://b": ModuleNotFoundError("No module named 'photogram'")}, "tcp://b cannot run photogram tasks"),
        ({"tcp://b": {"programs": {"photogram": "0.1"}}}, r"\(tcp://b\) has photogram 0.1 in place of"),
        ({"tcp://a": {"process": 1}, "tcp://b": {"process": 2, "missing": ["/x"]}}, "/x: not there for the worker on"),
        ({"tcp://b": {}}, "tcp://b is this process: start workers in processes of their own"),
    ],
)
def test_workers_that_cannot_work_are_refused(order: WorkOrder, said: dict[str, Any], expected: str) -> None:
    with pytest.raises(WorkspaceError, match=expected):
        Cluster(ADDRESS, Client(said)).check(order, [])


def test_workers_that_can_work_are_not(order: WorkOrder) -> None:
    Cluster(ADDRESS, Client({"tcp://b": {"process": 1}})).check(order, [order.folder])


def test_what_a_worker_does_not_see_is_named(order: WorkOrder) -> None:
    with pytest.raises(WorkspaceError, match="elsewhere: not there for the worker on"):
        Cluster(ADDRESS, Client({"tcp://b": {"process": 1}})).check(order, [order.folder / "elsewhere"])


def test_a_run_without_workers_ends_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    client = Client({}, {"tcp://b": 2})
    workers = Cluster(ADDRESS, client)
    assert workers.size == 2
    workers.wait_on()
    client.threads = {}
    workers.wait_on()
    monkeypatch.setattr(clusters, "WITHOUT_WORKERS_S", -1.0)
    with pytest.raises(WorkspaceError, match="no worker is left: start 'dask worker"):
        workers.wait_on()
    client.status = "closed"
    with pytest.raises(WorkspaceError, match="the connection to the scheduler is lost"):
        assert workers.size
    with pytest.raises(WorkspaceError, match="the connection to the scheduler is lost"):
        workers.wait_on()


def test_a_scheduler_that_gives_up_or_is_lost_is_said() -> None:
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: pip install 'photogram[cluster]'")
    workers = Cluster(ADDRESS, Client({}))
    assert not workers.was_lost(ValueError("of the piece"))
    with pytest.raises(WorkspaceError, match="the connection to the scheduler is lost"):
        workers.was_lost(CancelledError())
    with pytest.raises(WorkspaceError, match="start fewer workers on each machine; finished work is kept"):
        workers.was_lost(distributed.KilledWorker("piece", None, 3))


def test_an_address_without_a_scheduler_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed: pip install 'photogram[cluster]'")
    monkeypatch.setattr(clusters, "CONNECT_S", 1)
    with pytest.raises(WorkspaceError, match="no Dask scheduler answers there"), cluster(ADDRESS):
        pass
