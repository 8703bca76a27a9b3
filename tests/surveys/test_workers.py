"""A survey done by processes, here or of a cluster, is the same bytes as one done in threads."""

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from losing_workers import losing
from makers import EMPTY_PICTURES
from seeds import ALL

from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.pipeline.store.cluster import Cluster, cluster
from photogram.pipeline.store.pools import ProcessPool

OWN_NOTES = ("stage.json", "files.sha256", "made-by-photogram.txt", "photogram.lock")
VOLATILE = ("report.json", "report.html", "checksums.sha256")  # seconds and memory
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]


def contents(survey: Path) -> dict[str, bytes]:
    """Return what a run has written, but for what it says of its own time and memory."""
    files = [p for part in ("work", "results") for p in sorted((survey / part).rglob("*")) if p.is_file()]
    return {p.relative_to(survey).as_posix(): p.read_bytes() for p in files if p.name not in (*OWN_NOTES, *VOLATILE)}


def said_of(figures: bytes) -> list[dict[str, str]]:
    """Return what the page has of each figure; of the picture only with all seeds, which are drawn."""
    return [{key: text for key, text in figure.items() if key != "uri" or ALL} for figure in json.loads(figures)]


@contextmanager
def local_cluster() -> Iterator[Cluster]:
    """Two workers of a Dask cluster on this machine, each a process of its own."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: pip install 'photogram[cluster]'")
    import dask
    from distributed.utils import get_mp_context

    settings = {
        # a local cluster closes for good what is being replaced a quarter of a minute after it was lost once
        "distributed.deploy.lost-worker-timeout": "1h",
        # workers are forks of a process that has imported what they need, and is none of them
        "distributed.worker.multiprocessing-method": "forkserver",
    }
    with dask.config.set(settings):
        get_mp_context().set_forkserver_preload(["distributed", "photogram.pipeline.pipeline"])
    with (
        dask.config.set(settings),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=None
        ) as workers,
        cluster(workers.scheduler_address) as pool,
    ):
        yield pool


@pytest.mark.usefixtures("undrawn")
def test_two_processes_give_the_bytes_of_threads(
    survey: Path, finished_survey: Path, photogram: Callable[..., Any]
) -> None:
    said = photogram("adjust", survey / "project.yaml", "--workers", 2)
    assert said.code == 0, said.err
    made, whole = contents(survey), contents(finished_survey)
    assert made.keys() == whole.keys()
    figures = "work/results.stage/figures.json"
    assert said_of(made.pop(figures)) == said_of(whole.pop(figures))
    # figures are drawn by the process that was called, after all others have ended
    drawn = {name: content for name, content in made.items() if content not in EMPTY_PICTURES.values()}
    assert [name for name in drawn if drawn[name] != whole[name]] == []


def test_a_cluster_that_loses_a_worker_in_each_stage_gives_the_bytes_of_threads(
    survey: Path, finished_survey: Path, tmp_path: Path
) -> None:
    with local_cluster() as pool:
        run_pipeline(load_project(survey / "project.yaml"), pool=losing(pool, tmp_path / "lost"), until="orthophoto")
    made, whole = contents(survey), contents(finished_survey)
    assert made == {name: content for name, content in whole.items() if name in made}
    left = {Path(name).parts[1] for name in set(whole) - set(made) if name.startswith("work/")}
    assert left == {"comparison.stage", "results.stage"}
    lost = {path.name.removesuffix(".stage.partial") for path in (tmp_path / "lost").iterdir()}
    assert {"photographs", "features", "matches", "dense", "surface", "orthophoto"} <= lost


def test_the_transfer_goes_on_where_a_process_is_lost(survey: Path, edit: Edit, tmp_path: Path) -> None:
    edit(survey / "project.yaml", lambda v: v.update(orientation={"method": "growth"}))
    other = Path(shutil.copytree(survey, tmp_path / "other"))
    run_pipeline(load_project(other / "project.yaml"), until="transfer")
    run_pipeline(load_project(survey / "project.yaml"), until="orientation")
    with ProcessPool(2) as pool:
        run_pipeline(load_project(survey / "project.yaml"), until="transfer", pool=losing(pool, tmp_path / "lost"))
    assert contents(survey) == contents(other)
    assert (tmp_path / "lost/transfer.stage.partial").exists()
    assert not list((survey / "work").glob(".photogram-*"))
