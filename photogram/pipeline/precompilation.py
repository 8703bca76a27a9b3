"""Kernels of orientation, adjustment and orthophoto, compiled by a process of its own while the first stages work.

numba compiles in one thread at a time, and on a machine where photogram has not run yet that takes longer than the
photographs of a small survey do. The kernels of a small simulated block are those of every survey; numba keeps them in
files, from which the process that works on the survey takes them. What it needs before they are there it compiles
itself: the results do not depend on who was first.
"""

import logging
import subprocess
import sys
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.self_calibration import with_priors
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.arrays import BoolArray, ByteArray, Float32Array
from photogram.grid import MapGrid, Window
from photogram.machine import cores
from photogram.pipeline.costs.forecast import compiled_share
from photogram.pipeline.sample_block import sample_block
from photogram.pipeline.stages.adjustment import ADJUSTMENT
from photogram.sfm.orientation import OrientationSettings, orient
from photogram.surface.ortho.closed_surface import close_surface
from photogram.surface.ortho.orthophoto import OrthophotoSettings, plan_orthophoto
from photogram.surface.ortho.outline import cells_inside, rim_of, sides_of
from photogram.surface.ortho.visibility import WindowedSurface
from photogram.surface.views import Views
from photogram.survey import Block

COMMAND = (sys.executable, "-P", "-m", "photogram.pipeline.precompilation")  # -P: nothing is imported from the survey

CELL_M = 0.5
"""Side of the cells of surface and orthophoto: several pixels."""

_LOG = logging.getLogger(__name__)

KEPT = 0.5
"""Share of the adjustment's kernels that are compiled where it is not worth while any more."""


@contextmanager
def compiling_early() -> Iterator[None]:
    """Let another process compile during the block, where there are two cores and little is compiled yet; it ends with
    the block at the latest."""
    process = None if cores() < 2 or compiled_share([ADJUSTMENT])["adjustment"] >= KEPT else _started()
    try:
        yield
    finally:
        if process is not None:
            process.terminate()
            process.wait()


def _started() -> subprocess.Popen[bytes] | None:
    """Return the process that compiles, None where the machine refuses one: the survey goes on without."""
    nowhere = subprocess.DEVNULL
    try:
        return subprocess.Popen(COMMAND, stdin=nowhere, stdout=nowhere, stderr=nowhere)
    except OSError as error:
        _LOG.debug("kernels are not compiled early: %s", error)
        return None


def compile_all() -> None:
    """Adjust and orient a small simulated block and make an orthophoto of it, which compiles whatever that takes."""
    block = sample_block()
    # in the order in which they are needed, but for the orientation, which needs most of what the adjustment does
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        adjust_with_snooping(_with_priors(block), AdjustmentSettings())
        nowhere = np.full_like(block.tie_points.position_world_m, np.nan)
        points = replace(block.tie_points, position_world_m=nowhere)
        orient(replace(block, poses=(None,) * len(block.poses), tie_points=points), OrientationSettings())
        look_down(block)


def look_down(block: Block) -> None:
    """Make an orthophoto of photographs of noise, on a level surface without holes."""
    ground = block.frame.map_from_world(block.tie_points.position_world_m)
    grid, views = MapGrid.around(ground, CELL_M), Views.of(block)
    height = np.full((grid.rows, grid.columns), np.median(ground[:, 2]), dtype=np.float32)
    closed, sigma = np.empty_like(height), np.empty_like(height)

    def part(window: Window) -> tuple[Float32Array, BoolArray, Float32Array]:
        known = height[window.slices]
        return known, np.isfinite(known), np.full_like(known, 0.1)

    def write(window: Window, values: Float32Array, sigmas: Float32Array) -> None:
        closed[window.slices], sigma[window.slices] = values, sigmas

    def pixels(view: int) -> ByteArray:
        width, rows = views.size_px[view].tolist()
        return np.random.default_rng(view).integers(0, 256, (rows, width, 3), dtype=np.uint8)

    with ThreadPoolExecutor(1) as executor:
        close_surface(grid, part, executor, write)
        surface = WindowedSurface.of(grid.raster(closed), sigma)
        orthophoto = plan_orthophoto(views, block.frame, surface, pixels, executor, OrthophotoSettings(cell_m=CELL_M))
        rim = rim_of(orthophoto.seams.looks, orthophoto.seams.label >= 0, orthophoto.blocks)
        for window, _ in orthophoto.tiles(pixels, executor):
            if rim is not None:
                cells_inside(sides_of(rim), orthophoto.grid, window)


def _with_priors(block: Block) -> Block:
    return replace(block, cameras=tuple(with_priors(camera) for camera in block.cameras))


if __name__ == "__main__":
    compile_all()
