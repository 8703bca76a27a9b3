"""The stage of dense matching: levels from coarse to fine, block by block, resumed where it was killed."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, as_completed
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from photogram.files.atomic import make_folder, replacing
from photogram.files.npz_json import write_json
from photogram.grid import Window
from photogram.pipeline.stages.surface_frame import fitted_frame
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.stage import Progress
from photogram.pipeline.store.stage_summary import StageSummary
from photogram.pipeline.store.tiles import BlockFiles
from photogram.surface.dense.pyramid import (
    AROUND_CELLS,
    CELL_GSD,
    MINIMUM_RAYS,
    KnownGround,
    Level,
    Prior,
    finer_prior,
    first_prior,
    known_ground,
    plan_levels,
    round_cell_m,
    survey_grid,
)
from photogram.surface.dense.tile_matching import BLOCK_CELLS, MARGIN_CELLS, DenseSettings, Scene, match_block
from photogram.surface.views import Views


class ReducedPictures:
    """Grey pictures of the photographs, reduced by powers of two, as files that are mapped, not held, in memory."""

    def __init__(self, folder: Path, grey: Callable[[int], NDArray[np.uint8]], reductions: tuple[int, ...]) -> None:
        self.folder, self.grey, self.reductions = folder, grey, reductions
        make_folder(folder)

    def _file(self, view: int, reduction: int) -> Path:
        return self.folder / f"{view:05d}_{reduction}.npy"

    def make(self, view: int) -> None:
        """Decode a photograph and write its reduced pictures; those that are there are kept."""
        if all(self._file(view, reduction).is_file() for reduction in self.reductions):
            return
        grey = self.grey(view)
        if 1 in self.reductions:
            self._write(view, 1, grey)
        picture = grey.astype(np.float32)
        for step in range(1, max(self.reductions).bit_length()):
            picture = cv2.pyrDown(picture)
            if 2**step in self.reductions:
                self._write(view, 2**step, picture.astype(np.float16))

    def _write(self, view: int, reduction: int, picture: NDArray[np.generic]) -> None:
        with replacing(self._file(view, reduction)) as temporary, temporary.open("wb") as stream:
            np.save(stream, picture, allow_pickle=False)

    def __call__(self, view: int, reduction: int) -> NDArray[np.generic]:
        """Return the picture of a view, mapped from its file."""
        picture: NDArray[np.generic] = np.load(self._file(view, reduction), mmap_mode="r", allow_pickle=False)
        return picture


def match_surface(run: Run, folder: Path, progress: Progress) -> StageSummary:
    """Match heights for every cell of the surface, level by level; blocks that an interrupted run has finished are
    kept."""
    settings: DenseSettings = run.project.dense
    site = fitted_frame(run) if settings.enabled else ""
    if isinstance(site, str):
        return {}
    block = site.block()
    frame, views = block.frame, Views.of(block)
    points = site.cloud().position_map_m
    known = known_ground(points, frame.world_from_map(points), views, settings.photographs)
    cell_m = run.project.surface.cell_m or round_cell_m(CELL_GSD * known.gsd_m)
    grid = survey_grid(frame, known, views, cell_m, MINIMUM_RAYS)
    levels = plan_levels(known, views, grid)
    reductions = tuple(sorted({level.reduction for level in levels}))
    pictures = ReducedPictures(folder / "pictures", lambda view: run.grey(int(views.photograph[view])), reductions)
    for done, _ in enumerate(run.executor.map(pictures.make, range(len(views)))):
        progress(done + 1, len(views), "reduced pictures")
    scene = Scene(frame, views, pictures)
    names = [*(f"level{n}" for n in range(len(levels) - 1)), "heights"]
    stores = [BlockFiles(folder / name, level.grid, BLOCK_CELLS) for name, level in zip(names, levels, strict=True)]
    total, done = sum(len(store.windows) for store in stores), 0
    for number in range(len(levels)):
        for _ in _matched(run.executor, scene, known, levels, stores, number, settings):
            done += 1
            progress(done, total, f"cells of {levels[number].grid.cell_m:g} m")
    shutil.rmtree(pictures.folder)
    for store in stores[:-1]:
        shutil.rmtree(store.folder)
    note = {"side": BLOCK_CELLS, "base_map_m": frame.origin_map_m[2], "flying_height_m": known.flying_height_m}
    write_json(folder / "grid.json", {**asdict(grid), **note})
    return {"rows": grid.rows, "columns": grid.columns, "cell_m": grid.cell_m, "levels": len(levels)}


def _matched(
    executor: Executor,
    scene: Scene,
    known: KnownGround,
    levels: tuple[Level, ...],
    stores: list[BlockFiles],
    number: int,
    settings: DenseSettings,
) -> Iterator[Window]:
    """Match all blocks of a level that are not there yet, and yield each when it is."""
    level, store, last = levels[number], stores[number], number == len(levels) - 1
    base = scene.frame.origin_map_m[2]

    def match(block: Window) -> Window:
        if not store.has(block):
            outer = level.grid.around_window(block, MARGIN_CELLS)
            prior = first_prior(known, level, outer, base)
            if number:
                prior = _around_coarser(stores[number - 1], level, outer, prior, widely=not last)
            found = match_block(scene, level, block, prior, settings, last=last)
            store.write(block, {k: v for k, v in asdict(found).items() if last or k in ("height_m", "correlation")})
        return block

    futures = [executor.submit(match, block) for block in store.windows]
    for future in as_completed(futures):
        yield future.result()


def _around_coarser(coarser: BlockFiles, level: Level, outer: Window, first: Prior, *, widely: bool) -> Prior:
    """Return the range of a window from the coarser level."""
    half = Window(outer.row // 2, outer.column // 2, -(-outer.row_end // 2), -(-outer.column_end // 2))
    at = coarser.grid.around_window(half, AROUND_CELLS + 3)
    height, correlation = coarser.read(at, "height_m", "correlation")
    return finer_prior(height, correlation, at, level, outer, first, widely=widely)
