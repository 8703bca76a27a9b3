"""Surface and orthophoto of a small block in memory, for a notebook: surveys go through the stages, tile by tile."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, Float32Array
from photogram.grid import MapGrid, Window
from photogram.machine import cores
from photogram.surface.dense.pyramid import (
    AROUND_CELLS,
    MINIMUM_RAYS,
    default_cell_m,
    finer_prior,
    first_prior,
    known_ground,
    mapped_ground,
    plan_levels,
)
from photogram.surface.dense.tile_matching import BLOCK_CELLS, MARGIN_CELLS, DenseSettings, Heights, Scene, match_block
from photogram.surface.ortho.orthophoto import OrthophotoSettings, plan_orthophoto
from photogram.surface.views import Views
from photogram.survey import Block, Raster


@dataclass(frozen=True, eq=False)
class MatchedSurface:
    """Heights of a block, matched in its photographs; NaN where there are none."""

    height: Raster
    """Heights of the map, m."""
    sigma: Raster
    """Their standard deviations as far as the matching goes, m, without those of the adjustment."""
    correlation: Raster
    """Mean correlation of the photographs that agree on a height."""


def match_surface(
    block: Block,
    grey: Callable[[int], ByteArray],
    settings: DenseSettings | None = None,
    *,
    cell_m: float | None = None,
) -> MatchedSurface:
    """Match heights for every cell of the ground that an adjusted block shows.

    ``grey`` gives the photograph of a number in the block as grey values (height_px, width_px); ``cell_m`` is the side
    of a cell, 2 GSD where it is None. Heights are those of the finest level alone, unfiltered: the stage `surface` of a
    survey rejects, joins levels and fills. Raises PhotogramError with fewer than three tie points or two photographs.
    """
    settings = settings or DenseSettings()
    frame = block.frame
    views = Views.of(block)
    points = block.tie_points.position_world_m
    points = points[np.isfinite(points).all(axis=1)]
    points_map_m = frame.map_from_world(points)
    known = known_ground(points_map_m, points, views, settings.photographs)
    views = replace(views, coarsest_m=known.coarsest_m)
    ground = mapped_ground(frame, known, views, cell_m or default_cell_m(known.gsd_m), MINIMUM_RAYS)
    levels = plan_levels(known, views, ground.grid)

    @cache
    def picture(view: int, reduction: int) -> NDArray[np.generic]:
        if reduction == 1:
            return grey(int(views.photograph[view]))
        return np.asarray(cv2.pyrDown(picture(view, reduction // 2).astype(np.float32)), np.float16)

    scene, base_map_m = Scene(frame, views, picture), frame.origin_map_m[2]
    start = agreement = np.zeros((0, 0), np.float32)
    for number, level in enumerate(levels):
        coarse = start
        coarse_agreement = agreement
        coarser = levels[number - 1].grid
        start, agreement = (np.full((level.grid.rows, level.grid.columns), np.nan, np.float32) for _ in range(2))
        last = number == len(levels) - 1
        heights = {name: start.copy() for name in ("height_m", "sigma_m", "correlation")} if last else {}
        for tile in level.grid.tiles(BLOCK_CELLS):
            outer = level.grid.around_window(tile, MARGIN_CELLS)
            prior = first_prior(known, level, outer, base_map_m)
            if number:
                at = coarser.around_window(outer.coarser(2), AROUND_CELLS + 3)
                about = coarse[at.slices], coarse_agreement[at.slices]
                prior = finer_prior(*about, at, level, outer, prior)
            matched = match_block(scene, level, tile, prior, settings, refined=last)
            start[tile.slices], agreement[tile.slices] = matched.start_m, matched.agreement
            _enter(heights, tile, matched.heights)
    grid = levels[-1].grid
    return MatchedSurface(
        grid.raster(heights["height_m"] + np.float32(base_map_m)),
        grid.raster(heights["sigma_m"]),
        grid.raster(heights["correlation"]),
    )


def _enter(whole: dict[str, Float32Array], tile: Window, part: Heights | None) -> None:
    if part is not None:
        for name, values in whole.items():
            values[tile.slices] = getattr(part, name)


@dataclass(frozen=True, eq=False)
class OrthophotoImage:
    """An orthophoto in memory, its grid in m of the map."""

    grid: MapGrid
    """Where its cells lie in the map."""
    colour: ByteArray
    """Red, green, blue and alpha (rows, columns, 4); alpha 0 where no photograph shows the surface."""


def make_orthophoto(
    block: Block,
    surface: Raster,
    pixels: Callable[[int], ByteArray],
    settings: OrthophotoSettings | None = None,
) -> OrthophotoImage:
    """Make the orthophoto of an adjusted block on a surface, heights of the map in m, NaN where there is none.

    ``pixels`` gives the photograph of a number in the block as red, green, blue (height_px, width_px, 3); it may be
    asked from several threads at once. Raises PhotogramError where no photograph is above the surface.
    """
    views = Views.of(block)

    def pixels_of(view: int) -> ByteArray:
        return pixels(int(views.photograph[view]))

    with ThreadPoolExecutor(cores()) as executor:
        camera = views.cameras.camera
        plan = plan_orthophoto(
            views, block.frame, surface, pixels_of, executor, settings or OrthophotoSettings(), camera=camera
        )
        colour = np.zeros((plan.grid.rows, plan.grid.columns, 4), np.uint8)
        for window, part in plan.tiles(pixels_of, executor):
            colour[window.slices] = part
    return OrthophotoImage(plan.grid, colour)
