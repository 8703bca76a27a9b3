"""Heights and surfaces of a survey are the same bytes whatever the workers, the order, the tiles, the interruptions."""

import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
import rasterio

from photogram.grid import MapGrid, Window
from photogram.pipeline.pipeline import load_project, open_run
from photogram.pipeline.stages import dense as dense_stages
from photogram.pipeline.stages.dense import match_surface
from photogram.pipeline.stages.publishing.products import CLOUD, write_dense_cloud
from photogram.pipeline.stages.surfaces import surface as surface_stages
from photogram.pipeline.stages.surfaces.surface import MatchedHeights, model_surface
from photogram.pipeline.store.stage_files import keep_whole_files
from photogram.pipeline.store.tiles import BlockFiles
from photogram.pipeline.store.workspace import Workspace
from photogram.surface.dense import tile_matching as dense_matching
from photogram.surface.dense.semi_global import regularised

Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
BLOCK_CELLS, CELL_M = 96, 0.15
OWN_NOTES = ("stage.json", "files.sha256", "made-by-photogram.txt")
SURFACES = (
    "dsm.tif", "dsm_filled.tif", "dsm_sigma.tif", "dsm_sigma_relative.tif", "dsm_sigma_own.tif", "dsm_source.tif",
)  # fmt: skip

KILLED = f"""
import os, signal, sys
from pathlib import Path
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.pipeline.stages import dense as dense_stages

dense_stages.BLOCK_CELLS = {BLOCK_CELLS}
project, place, number = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
rename, seen = os.replace, 0

def counted(source, target):
    global seen
    seen += Path(target).parent == project.parent / "work/dense.stage.partial" / place
    if seen == number:
        os.kill(os.getpid(), signal.SIGKILL)
    rename(source, target)

os.replace = counted
run_pipeline(load_project(project), until="dense")
"""


class AnyOrder(Executor):
    """One worker that does what waits in an order of its own; a future is done when something is, not what it is of."""

    def __init__(self, seed: int) -> None:
        self._pool, self._random = ThreadPoolExecutor(1), random.Random(seed)
        self._waiting: list[tuple[int, Callable[[], Any]]] = []
        self._count = 0
        self.order: list[int] = []

    def submit(self, function: Callable[..., Any], /, *values: Any, **named: Any) -> Future[Any]:
        self._waiting.append((self._count, partial(function, *values, **named)))
        self._count += 1
        return self._pool.submit(self._any)

    def _any(self) -> Any:
        time.sleep(0.01)  # the others come too
        number, call = self._waiting.pop(self._random.randrange(len(self._waiting)))
        self.order.append(number)
        return call()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


@pytest.fixture(scope="module")
def dense_survey(finished_survey: Path, edit: Edit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the adjusted survey, its cells of 15 cm in four blocks and more; not to be written to."""
    folder = tmp_path_factory.mktemp("dense") / "survey"
    shutil.copytree(finished_survey, folder)
    edit(folder / "project.yaml", lambda v: v.update(surface={"cell_m": CELL_M}))
    for part in (folder / "work/dense.stage").iterdir():
        if part.name != "stage.json":
            shutil.rmtree(part) if part.is_dir() else part.unlink()
    return folder


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dense_stages, "BLOCK_CELLS", BLOCK_CELLS)


def match(survey: Path, folder: Path, executor: Executor, progress: Any = lambda *_: None) -> dict[str, bytes]:
    """Run the stage in a folder and return the files that it has written."""
    folder.mkdir(exist_ok=True)
    with open_run(load_project(survey / "project.yaml"), executor) as run:
        match_surface(run, folder, progress)
    return contents(folder)


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files that a stage has written; the workspace's own note of what they are made from is left out."""
    files = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.name not in OWN_NOTES]
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in files}


@pytest.fixture(scope="module")
def matched_once(dense_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What one worker writes."""
    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(1) as one:
        patch.setattr(dense_stages, "BLOCK_CELLS", BLOCK_CELLS)
        return match(dense_survey, tmp_path_factory.mktemp("matched") / "dense", one)


def test_heights_do_not_depend_on_workers(dense_survey: Path, matched_once: dict[str, bytes], tmp_path: Path) -> None:
    assert sum(name.startswith("heights1/") for name in matched_once) >= 4
    assert {name.split("/")[0] for name in matched_once} <= {"grid.json", *(f"heights{n}" for n in (1, 2, 4, 8))}
    with ThreadPoolExecutor(3) as three:
        assert match(dense_survey, tmp_path / "three", three) == matched_once


def test_heights_do_not_depend_on_the_order_of_blocks(
    dense_survey: Path, matched_once: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And the cost volume is never larger than that of a block with its margin."""
    seen = []

    def noted(volume: Any, *settings: float) -> Any:
        seen.append(volume.shape)
        return regularised(volume, *settings)

    monkeypatch.setattr(dense_matching, "regularised", noted)
    with AnyOrder(1) as order:
        assert match(dense_survey, tmp_path / "any", order) == matched_once
    assert order.order != sorted(order.order)
    assert max(max(shape) for shape in seen) <= BLOCK_CELLS + 2 * dense_matching.MARGIN_CELLS


class StoppedError(Exception):
    pass


def test_an_interrupted_run_goes_on(dense_survey: Path, matched_once: dict[str, bytes], tmp_path: Path) -> None:
    """Interrupted again and again: what is whole stays as it is, and the end is the same."""
    interruptions = 0
    for limit in range(2, 100, 2):
        before = contents(tmp_path / "dense")

        def stop(done: int, total: int, text: str, limit: int = limit) -> None:  # noqa: ARG001
            if text.startswith("cells") and done >= limit:
                raise StoppedError

        with ThreadPoolExecutor(1) as one:
            try:
                found = match(dense_survey, tmp_path / "dense", one, stop)
                break
            except StoppedError:
                interruptions += 1
        after = contents(tmp_path / "dense")
        assert before.items() <= after.items(), f"after {limit} blocks"
    assert interruptions > 2
    assert found == matched_once


@pytest.mark.parametrize("call", ["rmtree", "write_json"])
def test_a_run_interrupted_while_it_tidies_up_goes_on(
    dense_survey: Path, matched_once: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    """In place of the pictures' folder, or of the note of the grid."""
    place = shutil if call == "rmtree" else dense_stages

    def stop(*values: Any) -> None:  # noqa: ARG001
        raise StoppedError

    with ThreadPoolExecutor(2) as two:
        with monkeypatch.context() as patch:
            patch.setattr(place, call, stop)
            with pytest.raises(StoppedError):
                match(dense_survey, tmp_path / "dense", two)
        assert match(dense_survey, tmp_path / "dense", two) == matched_once


@pytest.mark.parametrize("moment", [("heights2", 2), ("heights1", 2)])
def test_killed_and_resumed_it_writes_the_same(
    dense_survey: Path, matched_once: dict[str, bytes], tmp_path: Path, moment: tuple[str, int]
) -> None:
    survey = tmp_path / "survey"
    shutil.copytree(dense_survey, survey)
    place, number = moment
    command = [sys.executable, "-c", KILLED, str(survey / "project.yaml"), place, str(number)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == -signal.SIGKILL, done.stderr
    folder = survey / "work/dense.stage.partial"
    times = {p: p.stat().st_mtime_ns for p in folder.glob("heights2/*.npz")}
    assert times
    assert keep_whole_files(folder) == []
    with ThreadPoolExecutor(2) as two:
        kept: dict[Path, int] = {}

        def look(done: int, total: int, text: str) -> None:  # noqa: ARG001
            if text.startswith("cells"):
                kept.update({p: p.stat().st_mtime_ns for p in times if p.exists()})

        assert match(survey, folder, two, look) == matched_once
    assert kept.items() >= times.items(), "blocks that were whole are kept"


def test_surfaces_do_not_depend_on_tiles(
    dense_survey: Path, matched_once: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    survey = tmp_path / "survey"
    shutil.copytree(dense_survey, survey)
    workspace = Workspace(survey / "work")
    folder = workspace.begin("dense", "matched once")
    for name, content in matched_once.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    workspace.finish("dense", "matched once", {})
    made: list[dict[str, bytes]] = []
    for side, workers in ((1024, 2), (101, 3), (64, 1)):
        monkeypatch.setattr(surface_stages, "TILE_CELLS", side)
        folder = tmp_path / str(side)
        folder.mkdir()
        with (
            ThreadPoolExecutor(workers) as pool,
            open_run(load_project(survey / "project.yaml"), pool) as run,
        ):
            model_surface(run, folder, lambda *_: None)
        made.append({name: (folder / name).read_bytes() for name in SURFACES})
    assert made[1] == made[0]
    assert made[2] == made[0]
    with rasterio.open(tmp_path / "64/dsm.tif") as file:
        height = file.read(1, masked=True).filled(np.nan)
    with rasterio.open(survey / "truth_surface.tif") as file:
        truth = file.read(1)
    assert np.isfinite(height).mean() > 0.3
    assert np.nanmin(truth) - 2.0 < np.nanmin(height) < np.nanmax(height) < np.nanmax(truth) + 2.0


def test_weak_texture_correlates_less_and_has_no_larger_cells(tmp_path: Path) -> None:
    """The western half correlates by 0.1, which is as much as its texture lets expect; the grid is odd-sized."""
    grid = MapGrid(0.0, 0.0, 0.1, 61, 83)
    expected = np.where(np.arange(83) < 42, 0.2, 1.0) * np.ones((61, 1))
    levels = {cells: BlockFiles(tmp_path / str(cells), grid.coarser(cells), 50) for cells in (1, 2)}
    for cells, store in levels.items():
        for block in store.windows:
            of = np.ones(block.shape)
            correlation = (0.1 if cells == 1 else 0.9) * of
            texture = expected[block.slices] if cells == 1 else of
            layers: dict[str, Any] = {"height_m": of, "sigma_m": 0.01 * of, "correlation": correlation}
            layers = {name: layer.astype(np.float32) for name, layer in (layers | {"expected": texture}).items()}
            layers |= {"rays": (5 * of).astype(np.uint8), "seen": (5 * of).astype(np.uint8)}
            layers |= {"face": of < 0.0, "steep": of < 0.0, "pairs_m": np.full_like(layers["height_m"], np.nan)}
            store.write(block, layers)
    heights = MatchedHeights(levels, 0.0, 50.0)
    (fine, _), _ = heights.kept(Window(3, 1, 60, 80), {1: 0.3, 2: 0.3})
    assert np.isfinite(fine.height_m[2:-2, 2:38]).all()
    assert np.isnan(fine.height_m[:, 41:]).all()
    (_, coarse), (rough,) = heights.kept(grid.whole, {1: 0.3, 2: 0.3})
    for level in (coarse, rough):
        assert np.isnan(level.height_m[:, :21]).all()
        assert np.isfinite(level.height_m[2:-2, 23:-2]).all()


def test_the_dense_cloud_ends_with_the_work_beside_it(adjusted_survey: Path) -> None:
    """As when the user stops it: no file is left, not a part of one."""
    folder, ended = adjusted_survey / "beside", Event()
    cloud = folder / CLOUD
    folder.mkdir()
    with open_run(load_project(adjusted_survey / "project.yaml")) as run:
        assert write_dense_cloud(run, cloud, ended)
        cloud.unlink()
        ended.set()
        with pytest.raises(CancelledError):
            write_dense_cloud(run, cloud, ended)
    assert list(folder.iterdir()) == []
