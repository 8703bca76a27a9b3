"""The steps of dense matching in pictures, for docs/dense-matching.md, from a simulated survey that has been adjusted.

    python docs/pictures/dense_steps.py PROJECT.yaml WEST SOUTH EAST NORTH EASTING NORTHING

draws the part of the map between the four edges level by level, and the correlation over the height of the place at
EASTING, NORTHING.
"""

import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import cv2
import matplotlib.pyplot as plt
import numpy as np
from dense_matching import HERE, save
from matplotlib.axes import Axes
from matplotlib.colors import LightSource, Normalize
from numpy.typing import NDArray

from photogram.arrays import FloatArray
from photogram.files.photographs.images import read_grey
from photogram.grid import Window
from photogram.pipeline.pipeline import load_project, open_run
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted, stored_cloud
from photogram.pipeline.stages.surfaces.surface import FILL_CELLS
from photogram.pipeline.store.run import Run
from photogram.surface.dense.pyramid import (
    MINIMUM_RAYS,
    Level,
    correlation_histogram,
    default_cell_m,
    finer_prior,
    first_prior,
    known_ground,
    least_correlation_of,
    mapped_ground,
    plan_levels,
)  # fmt: skip
from photogram.surface.dense.resolution import choose_views
from photogram.surface.dense.tile_matching import MARGIN_CELLS, Heights, Scene, match_block
from photogram.surface.dsm import filled_heights, filtered_heights
from photogram.surface.views import Views, places_in_view

HALF, REACH_M = 3, 2.5
Array = FloatArray


class Pictures:
    """Grey pictures of the photographs, reduced by powers of two, held in memory."""

    def __init__(self, paths: list[Path]) -> None:
        self.paths, self.held = paths, {}

    def __call__(self, view: int, reduction: int) -> NDArray[np.generic]:
        """Return the picture of a view."""
        if (view, reduction) not in self.held:
            smaller = cv2.pyrDown(self(view, reduction // 2)) if reduction > 1 else None
            grey = read_grey(self.paths[view]).astype(np.float32) if smaller is None else smaller
            self.held[view, reduction] = grey
        return self.held[view, reduction]


def window_of(level: Level, box: tuple[float, float, float, float]) -> Window:
    """Return the cells of a level between west, south, east and north."""
    grid, (west, south, east, north) = level.grid, box
    row, row_end = (int((grid.north_map_m - y) / grid.cell_m) for y in (north, south))
    column, column_end = (int((x - grid.west_map_m) / grid.cell_m) for x in (west, east))
    return Window(max(row, 0), max(column, 0), min(row_end + 1, grid.rows), min(column_end + 1, grid.columns))


def matched_levels(
    run: Run, scene: Scene, box: tuple[float, float, float, float]
) -> tuple[list[Level], list[Array], Heights, float]:
    """Match one window of every level, as the stage does block by block: the heights that each found to begin with, and
    those of the finest."""
    settings, points = run.project.dense, stored_cloud(run, "adjusted").position_map_m
    known = known_ground(points, scene.frame.world_from_map(points), scene.views, settings.photographs)
    cell_m = run.project.surface.cell_m or default_cell_m(known.gsd_m)
    grid = mapped_ground(scene.frame, known, scene.views, cell_m, MINIMUM_RAYS).grid
    levels = list(plan_levels(known, scene.views, grid))
    base, found, block = scene.frame.origin_map_m[2], [], None
    inner = []
    for number, level in enumerate(levels):
        # as much more than the box as the finer level needs around its own
        more = (MARGIN_CELLS // 2 + 16) * level.grid.cell_m
        wide = window_of(level, (box[0] - more, box[1] - more, box[2] + more, box[3] + more))
        outer, last = level.grid.around_window(wide, MARGIN_CELLS), number == len(levels) - 1
        prior = first_prior(known, level, outer, base)
        if block is not None:
            prior = finer_prior(found[-1].start_m, found[-1].agreement, block, level, outer, prior, widely=not last)
        found.append(match_block(scene, level, wide, prior, settings, refined=last))
        block, part = wide, window_of(level, box)
        inner.append((slice(part.row - wide.row, part.row_end - wide.row),
                      slice(part.column - wide.column, part.column_end - wide.column)))  # fmt: skip
    finest = found[-1].heights
    assert finest is not None
    return levels, [f.start_m[part] for f, part in zip(found, inner, strict=True)], finest.part(*inner[-1]), base


def correlations(scene: Scene, place: tuple[float, float], heights: Array, count: int) -> Array:
    """Return the mean correlation of all pairs of ``count`` photographs at heights of a place: level windows of
    (2 HALF + 1)² samples, a pixel apart, each looked up exactly."""
    middle = scene.frame.world_from_map(np.array([[*place, float(np.median(heights))]]))
    views = choose_views(scene.views, middle, count)[0][0]
    gsd = float((scene.views.position_world_m[views[0], 2] - middle[0, 2]) / scene.views.focal_px[views[0]])
    y, x = np.mgrid[HALF : -HALF - 1 : -1, -HALF : HALF + 1] * gsd
    s = np.empty(len(heights))
    for k, height in enumerate(heights):
        ground = np.column_stack([place[0] + x.ravel(), place[1] + y.ravel(), np.full(x.size, height)])
        world, samples = scene.frame.world_from_map(ground), []
        for view in views:
            pixel = places_in_view(scene.views, int(view), world).astype(np.float32)
            grey = cv2.remap(scene.picture(int(view), 1), pixel[:, :1], pixel[:, 1:], cv2.INTER_LINEAR).ravel()
            samples.append((grey - grey.mean()) / np.linalg.norm(grey - grey.mean()))
        s[k] = (np.linalg.norm(np.sum(samples, axis=0)) ** 2 - count) / (count * (count - 1))
    return s


def draw_heights(axis: Axes, height: Array, cell_m: float, scale: Normalize, title: str) -> None:
    """Draw shaded heights, white where there are none."""
    light = LightSource(315, 45)
    shade = light.hillshade(np.nan_to_num(height, nan=np.nanmedian(height)), dx=cell_m, dy=cell_m)[..., None]
    rgb = mpl.colormaps["viridis"](scale(height))[..., :3] * (0.55 + 0.45 * shade)
    rgb[np.isnan(height)] = 1.0
    axis.imshow(rgb, interpolation="nearest")
    axis.set_title(title, fontsize=9)
    axis.set_xticks([])
    axis.set_yticks([])


def main() -> None:
    """Draw the picture."""
    west, south, east, north, *place = (float(text) for text in sys.argv[2:8])
    with open_run(load_project(Path(sys.argv[1]))) as run:
        block = block_as_adjusted(run)
        views = Views.of(block)
        scene = Scene(block.frame, views, Pictures([run.project.photographs[i].path for i in views.photograph]))
        levels, starts, last, base = matched_levels(run, scene, (west, south, east, north))
    cell_m = levels[-1].grid.cell_m
    least = least_correlation_of(correlation_histogram(last.correlation))
    kept = filtered_heights(last.height_m, last.sigma_m, last.correlation, last.rays, last.seen, cell_m, least)
    # the outermost cells have no neighbours here
    kept[[0, -1]], kept[:, [0, -1]] = last.height_m[[0, -1]], last.height_m[:, [0, -1]]
    filled = filled_heights(kept, cell_m, FILL_CELLS)
    scale = Normalize(*np.nanpercentile(last.height_m, [1, 99]))
    figure, axes = plt.subplots(2, 4, figsize=(10, 6.6), layout="constrained")
    places = iter(axes.ravel())
    for number, (level, height) in enumerate(zip(levels[:-1], starts[:-1], strict=True), 1):
        cell = level.grid.cell_m
        draw_heights(next(places), height, cell, scale, f"{number}. level of {cell:.2f} m cells")
    number = len(levels)
    draw_heights(next(places), last.height_m, cell_m, scale, f"{number}. finest level, {cell_m:.2f} m, every cell")
    axis = next(places)
    axis.imshow(last.correlation, cmap="cividis", vmin=0.3, vmax=1.0)
    axis.set_title(f"{number + 1}. agreement (dark: poor)", fontsize=9)
    axis.set_xticks([])
    axis.set_yticks([])
    draw_heights(next(places), kept, cell_m, scale, f"{number + 2}. kept: dsm.tif")
    axis = next(places)
    draw_heights(axis, filled, cell_m, scale, f"{number + 3}. filled (orange): dsm_filled.tif")
    axis.imshow(np.where(np.isnan(kept) & np.isfinite(filled), 1.0, np.nan), cmap="Oranges", vmin=0, vmax=1.6)
    axis = next(places)
    column, row = int((place[0] - west) / cell_m), int((north - place[1]) / cell_m)
    middle = base + float(last.height_m[row, column])
    h = np.linspace(middle - REACH_M, middle + REACH_M, 401)
    for count, colour in ((2, "#e69f00"), (6, "#0072b2")):
        axis.plot(
            correlations(scene, (place[0], place[1]), h, count), h - middle, color=colour, lw=1.2, label=f"{count}"
        )
    axis.axhline(0.0, color="0.6", lw=0.7)
    axis.set_xlim(-0.4, 1.05)
    axis.set_title("one cell: agreement over height", fontsize=9)
    axis.set_xlabel("mean correlation", fontsize=8)
    axis.set_ylabel("m from the height found", fontsize=8)
    axis.tick_params(labelsize=7)
    axis.legend(title="photographs", fontsize=7, title_fontsize=7, loc="lower right")
    save(figure, HERE / "dense_steps.png")


if __name__ == "__main__":
    main()
