"""The stage `surface`: the DSM from matched heights or tie points, and the same closed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import reduce
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, Float32Array, IntArray
from photogram.files.maps.cogs import Category, write_cog, write_cog_codes
from photogram.files.maps.rasters import write_raster
from photogram.files.npz_json import read_json, write_arrays, write_json
from photogram.grid import MapGrid, Window
from photogram.measures.ground_sampling import photographs_ground_sampling_m
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import (
    COARSER,
    LAYER_BYTES,
    LIBRARIES_BYTES,
    MATCHED_CELL_BYTES,
    TILE_BYTES,
    Costs,
    Extent,
    Memory,
    Rate,
)
from photogram.pipeline.stages.dense import asked_area, heights_folder
from photogram.pipeline.stages.features import starts_from_tie_points, stored_features
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted
from photogram.pipeline.stages.stored_surface import LEFT_OUT, PLANE
from photogram.pipeline.stages.surface_frame import GridSummary, SurfaceFrame, cells_in_words, fitted_frame
from photogram.pipeline.stages.surfaces.closing import CLOSED_BYTES, close_within_rim, closed_tiles, measured_parts
from photogram.pipeline.store.pieces import PieceType, run_pieces
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.tiles import BlockFiles
from photogram.surface.dense.pyramid import correlation_histogram, least_correlation_of
from photogram.surface.dsm import (
    FILLED,
    HOLE,
    INTERPOLATED,
    KEPT_MARGIN_CELLS,
    MEASURED,
    MEASURED_IN,
    SURE_SHARE,
    WATER,
    SharedError,
    filled_heights,
    filtered_heights,
    rough_heights,
    shared_error,
    surface_sigma_m,
)
from photogram.surface.islands import REACH_CELLS, without_islands
from photogram.surface.levels import (
    HALF,
    LevelHeights,
    agreed_level,
    confirmed,
    margin_cells,
    surface_of_levels,
    told_by_pairs,
)
from photogram.surface.tin_dsm import NEAREST_PLACES, SPIKE_GSD, surface_with_sigma
from photogram.surface.water import (
    CELLS,
    KeyPoints,
    SurfaceCells,
    Water,
    find_water,
    joined_cells,
    key_points_on_ground,
    surface_cells,
)
from photogram.survey import TRANSFERRED
from photogram.wording import Progress, things


class SurfaceSummary(GridSummary, total=False):
    """What the stage `surface` says of itself."""

    measured_of_grid: int
    """Number of cells that were matched."""
    filled_of_grid: int
    """Number of cells that were filled."""
    interpolated_of_grid: int
    """Number of cells that were interpolated from farther off."""
    water_of_grid: int
    """Number of cells that lie on water, where that is asked for."""
    least_correlation: float
    """Least correlation of a cell that is kept."""
    left_out: str
    """Why there is none."""


HEIGHT, SIGMA = "height of the surface", "standard deviation of the height"
CLOSED = f"{HEIGHT}, holes closed"
RELATIVE_SIGMA = "standard deviation of the height relative to the survey's mean height, without the datum"
RELATIVE_SIGMA_FILE = "dsm_sigma_relative.tif"
OWN_SIGMA = "standard deviation of the height by the noise of its own, without what neighbours share"
OWN_SIGMA_FILE = "dsm_sigma_own.tif"
"""Descriptions of the bands of `dsm.tif`, `dsm_sigma.tif`, RELATIVE_SIGMA_FILE and OWN_SIGMA_FILE."""

TILE_CELLS = 1024
FILES_AT_ONCE = 2
"""Rasters that are written at once: GDAL compresses in threads of its own, but makes overviews in one."""
FILL_CELLS, MOST_FILL_CELLS = 25, 100
SOURCES = (
    Category(HOLE, "hole", (255, 255, 255)),
    Category(MEASURED, "measured", (70, 130, 180)),
    Category(FILLED, "filled", (230, 120, 20)),
    Category(MEASURED_IN[2], "measured at 2 cells", (95, 175, 170)),
    Category(MEASURED_IN[4], "measured at 4 cells", (140, 195, 120)),
    Category(MEASURED_IN[8], "measured at 8 cells", (215, 205, 110)),
    Category(WATER, "water", (40, 60, 150)),
    Category(INTERPOLATED, "interpolated", (176, 122, 184)),
)
"""What the codes of `dsm_source.tif` mean, and their colours."""

WATER_FILE = "water.json"
"""File of the stage `surface` with area and level of each area of water; not there where none was looked for."""

_SHARED_SPACING_SHARE = 0.05


@dataclass(frozen=True)
class MatchedHeights:
    """The heights of the stage `dense` on disk: the blocks of its levels, by the side of their cells in cells of the
    finest, fine to coarse, what heights count from, and the flying height over them."""

    levels: Mapping[int, BlockFiles]
    base_map_m: float
    flying_height_m: float

    @staticmethod
    def of(run: Run) -> MatchedHeights:
        """Return what the stage `dense` has written."""
        note = read_json(run.workspace.file("dense", "grid.json"))
        finest = MapGrid(*(note[name] for name in ("west_map_m", "north_map_m", "cell_m", "rows", "columns")))
        levels = {}
        for cells in note["levels"]:
            folder = run.workspace.stage("dense") / heights_folder(cells)
            levels[cells] = BlockFiles(folder, finest.coarser(cells), note["side"], run.workspace.checked)
        return MatchedHeights(levels, note["base_map_m"], note["flying_height_m"])

    @property
    def blocks(self) -> BlockFiles:
        """Return the blocks of the finest level."""
        return self.levels[1]

    @property
    def grid(self) -> MapGrid:
        """Return the grid of the finest level, which is that of the surface."""
        return self.blocks.grid

    def least_correlations(self) -> dict[int, float]:
        """Return the correlation below which heights of each level are doubtful."""
        return {
            cells: least_correlation_of(
                np.asarray(sum(correlation_histogram(store.read(b, "correlation")[0]) for b in store.windows))
            )
            for cells, store in self.levels.items()
        }

    def kept(self, window: Window, least: Mapping[int, float]) -> tuple[list[LevelHeights], list[LevelHeights]]:
        """Return the heights of the levels that are kept, and those of the coarser ones that are where the surface is
        rough, around a window of the finest; what they need from beyond the edge is read. ``least`` are the
        correlations below which a level's heights are doubtful."""
        inner = {
            cells: store.grid.around_window(window.coarser(cells), 3 if cells > 1 else 0)
            for cells, store in self.levels.items()
        }
        outer = {cells: self.levels[cells].grid.around_window(of, KEPT_MARGIN_CELLS) for cells, of in inner.items()}
        expected = self._expected(outer)
        levels = [self._kept(inner[n], outer[n], n, least[n], expected[n]) for n in self.levels]
        return [level for level, *_ in levels], [level for _, *rough in levels for level in rough]

    def _kept(
        self, window: Window, outer: Window, cells: int, least: float, expected: Float32Array
    ) -> tuple[LevelHeights, ...]:
        """Return the heights of a level that are kept, and of a coarser one those that are where the surface is rough,
        in a window of its own grid; larger cells have none of weak texture. ``expected`` are the correlations of
        ``_expected`` in the ``outer`` window, which filters need."""
        store = self.levels[cells]
        height, sigma, correlation, rays, seen = store.read(outer, "height_m", "sigma_m", "correlation", "rays", "seen")
        face, steep, pairs_m = self._steep(outer, cells)
        at, at_m = window.within(outer), store.grid.cell_m
        told = told_by_pairs(height, pairs_m, at_m)
        if cells > 1:
            height = np.where(expected < 1.0, np.float32(np.nan), height)
        smooth = filtered_heights(height, sigma, correlation, rays, seen, face, told, at_m, least * expected)
        level = LevelHeights(
            smooth[at], sigma[at], correlation[at], rays[at], seen[at], cells, window.row, window.column,
            face[at], steep[at], pairs_m[at],
        )  # fmt: skip
        if cells == 1:
            return (level,)
        rough = rough_heights(height, sigma, correlation, rays, seen, at_m, least * expected)
        return level, replace(level, height_m=rough[at])

    def _steep(self, window: Window, cells: int) -> tuple[NDArray[Any], ...]:
        """Return where ground is a face, where it is steep, and what pairs tell there, in a window of a level: nothing
        but of the finest one."""
        if cells == 1:
            return self.blocks.read(window, "face", "steep", "pairs_m")
        no = np.zeros(window.shape, np.bool_)
        return no, no, np.full(window.shape, np.nan, np.float32)

    def _expected(self, windows: Mapping[int, Window]) -> dict[int, Float32Array]:
        """Return the least correlation that is to be expected in each cell (rows, columns) of a window of each level,
        by the texture of the finest cells in it, in that of textured ground. The coarsest reaches furthest."""
        last, window = list(windows.items())[-1]
        fine = Window(*(last * edge for edge in (window.row, window.column, window.row_end, window.column_end)))
        inner = self.grid.common(fine)
        assert inner is not None
        values = np.ones(fine.shape, np.float32)
        values[inner.within(fine)] = self.blocks.read(inner, "expected")[0]
        expected, side = {}, 1
        for cells, window in windows.items():
            n, side = cells // side, cells
            values = reduce(np.minimum, [values[i::n, j::n] for i in range(n) for j in range(n)])
            expected[cells] = values[window.within(fine.coarser(cells))]
        return expected


@dataclass(frozen=True, eq=False)
class _Tile:
    """What a tile of the surface holds, (rows, columns) each: heights of the map, the same with holes closed, standard
    deviations, with the datum's part, without, and of the matching alone, what each cell is, how it was matched, and in
    how many photographs it could be."""

    height: Float32Array
    filled: Float32Array
    sigma: Float32Array
    relative: Float32Array
    own: Float32Array
    source: ByteArray
    confidence: Float32Array
    rays: ByteArray
    seen: ByteArray


def matched(run: Run) -> bool:
    """Return whether heights were matched, or the surface comes from tie points alone."""
    return run.workspace.has("dense", "grid.json")


def model_surface(run: Run, folder: Path, progress: Progress) -> SurfaceSummary:
    """Make the DSM, the standard deviations of its heights and its version without holes, tile by tile; from tie points
    alone where nothing was matched, and none where the survey has none: ``left_out.json`` says why."""
    site = fitted_frame(run)
    if isinstance(site, str):
        write_json(folder / LEFT_OUT, {"left_out": site})
        return {"left_out": site}
    if not matched(run):
        return interpolate_surface(run, site, folder, progress)
    heights = MatchedHeights.of(run)
    grid = heights.grid
    least = heights.least_correlations()
    gap_m = run.project.surface.maximum_gap_m
    reach = FILL_CELLS if gap_m is None else min(round(gap_m / grid.cell_m), MOST_FILL_CELLS)

    modelling = _Modelling.of(heights, site, folder)
    store, counts = modelling.store, np.zeros(len(SOURCES), np.int64)
    tiles = [(window, least, reach) for window in store.windows]
    for done, count in enumerate(run_pieces(run, folder, _TILES, tiles, state=modelling), 1):
        counts += count
        progress(done, len(tiles), f"{grid.columns} × {grid.rows} cells of {grid.cell_m:g} m")
    water: SurfaceSummary = {}
    wet = "water" in run.project.masks.auto and not starts_from_tie_points(run.project)
    if wet and site.plane is None:
        progress(0, 0, "water")
        lakes = _found_water(run, modelling)
        counts += sum((_flood(store, lakes, window) for window in store.windows), np.zeros_like(counts))
        areas = [{"area_m2": a, "level_map_m": h} for a, h in zip(lakes.area_m2, lakes.level_m.tolist(), strict=True)]
        write_json(folder / WATER_FILE, areas)
        water = {"water_of_grid": int(counts[WATER])}
    progress(0, 0, "surface without holes")
    area = asked_area(run) if site.plane is None else None
    rim = close_within_rim(run, site, folder, grid, measured_parts(store), area)
    crs, plan, note = site.crs, site.plan, site.note
    rasters = (
        ("dsm.tif", _layer(store, "height"), crs, HEIGHT),
        ("dsm_filled.tif", ((w, filled) for w, filled, _ in closed_tiles(store, folder, rim, area)), crs, CLOSED),
        ("dsm_sigma.tif", _layer(store, "sigma"), plan, SIGMA),
        (OWN_SIGMA_FILE, _layer(store, "own"), plan, OWN_SIGMA),
        *(
            []
            if len(modelling.shared) == 1
            else [(RELATIVE_SIGMA_FILE, _layer(store, "relative"), plan, RELATIVE_SIGMA)]
        ),
    )

    def write(raster: tuple[str, Iterator[tuple[Window, Float32Array]], str, str]) -> None:
        name, values, of, description = raster
        write_cog(folder / name, grid, of, values, description=description, note=note)

    def sources() -> Iterator[tuple[Window, ByteArray]]:
        for window, _, source in closed_tiles(store, folder, rim, area):
            counts[INTERPOLATED] += np.count_nonzero(source == INTERPOLATED)
            yield window, source

    with ThreadPoolExecutor(FILES_AT_ONCE) as writers:
        list(writers.map(write, rasters))
    write_cog_codes(folder / "dsm_source.tif", grid, plan, sources(), categories=SOURCES, note=note)
    site.write(folder, grid)
    write_arrays(folder / "held_out.npz", {"held_out_m": np.zeros(0)})
    write_json(folder / "mask.json", {"least_correlation": least[1], "fill_cells": reach})
    measured = {n: int(counts[code]) for n, code in MEASURED_IN.items()}
    return {
        "rows": grid.rows, "columns": grid.columns, "cell_m": grid.cell_m,
        "measured_of_grid": sum(measured.values()), "filled_of_grid": int(counts[FILLED]),
        "interpolated_of_grid": int(counts[INTERPOLATED]),
        "least_correlation": round(least[1], 3), **water,
    }  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Modelling:
    """What every tile of the surface is made from: matched heights, and the errors that neighbours share, with the
    datum's part and, where they are known, without."""

    heights: MatchedHeights
    shared: list[SharedError]
    store: BlockFiles

    @staticmethod
    def of(heights: MatchedHeights, site: SurfaceFrame, folder: Path) -> _Modelling:
        """Return it from the adjustment."""
        grid, shape = heights.grid, site.shape()
        spacing_m = _SHARED_SPACING_SHARE * heights.flying_height_m
        shared = [shared_error(site.cloud().position_map_m, site.precision().cameras_m2, grid, spacing_m)]
        if shape is not None:
            shared.append(shared_error(shape.place_map_m, shape.covariance_m2, grid, spacing_m, NEAREST_PLACES))
        return _Modelling(heights, shared, BlockFiles(folder / "tiles", grid, TILE_CELLS))

    @staticmethod
    def read(run: Run, folder: Path) -> _Modelling:
        """Return it in another process than the one that began the stage, which has looked at the frame."""
        site = fitted_frame(run)
        assert not isinstance(site, str)
        return _Modelling.of(MatchedHeights.of(run), site, folder)


def _make_tile(modelling: _Modelling, item: tuple[Window, Mapping[int, float], int]) -> IntArray:
    """Make and write a tile of the surface; returns how many cells are of each of SOURCES."""
    window, least, reach = item
    made = _tile(modelling.heights, modelling.shared, window, least, reach)
    modelling.store.write(window, vars(made))
    return np.bincount(made.source.ravel(), minlength=len(SOURCES))


_TILES = PieceType(_Modelling.read, _make_tile)


def _found_water(run: Run, modelling: _Modelling) -> Water:
    """Return the water in the surface as its tiles have it."""
    store, block = modelling.store, block_as_adjusted(run)
    grid = store.grid.coarser(CELLS)

    def part(window: Window) -> SurfaceCells:
        height, source, seen = store.read(window, "height", "source", "seen")
        return surface_cells(height, source == MEASURED, seen)

    cells = joined_cells(grid, list(zip(store.windows, run.executor.map(part, store.windows), strict=True)))
    tie = block.tie_points

    def key_points(index: int) -> KeyPoints:
        pose, camera = block.poses[index], block.cameras[block.photographs[index].camera]
        assert pose is not None
        own = tie.feature[(tie.photograph == index) & (tie.feature != TRANSFERRED)]
        return key_points_on_ground(index, camera, pose, block.frame, stored_features(run, index), own, grid, cells)

    oriented = [index for index, pose in enumerate(block.poses) if pose is not None]
    points = KeyPoints.joined(list(run.executor.map(key_points, oriented)))
    return find_water(grid, cells, points, modelling.heights.flying_height_m)


def _flood(store: BlockFiles, water: Water, window: Window) -> IntArray:
    """Write a tile of the surface anew where it has water; returns by how many cells each of SOURCES grows."""
    level = water.levels_m(window)
    wet = np.isfinite(level)
    if not wet.any():
        return np.zeros(len(SOURCES), np.int64)
    names = [field.name for field in fields(_Tile)]
    was = _Tile(**dict(zip(names, store.read(window, *names), strict=True)))
    none, nothing = np.float32(np.nan), np.uint8(0)
    tile = replace(
        was,
        filled=np.where(wet, level, was.filled),
        source=np.where(wet, np.uint8(WATER), was.source),
        confidence=np.where(wet, np.float32(0.0), was.confidence),
        rays=np.where(wet, nothing, was.rays),
        **{name: np.where(wet, none, getattr(was, name)) for name in ("height", "sigma", "relative", "own")},
    )
    store.write(window, vars(tile))
    before, after = (np.bincount(t.source.ravel(), minlength=len(SOURCES)) for t in (was, tile))
    return np.asarray(after - before)


def surface_layers(run: Run) -> BlockFiles:
    """Return the layers of the matched surface by their names in _Tile. Needs the stage `surface`, with `dense` on."""
    folder = run.workspace.stage("surface") / "tiles"
    return BlockFiles(folder, MatchedHeights.of(run).grid, TILE_CELLS, run.workspace.checked)


def _layer(store: BlockFiles, name: str) -> Iterator[tuple[Window, NDArray[Any]]]:
    return ((window, store.read(window, name)[0]) for window in store.windows)


def _tile(
    heights: MatchedHeights, shared: Sequence[SharedError], window: Window, least: Mapping[int, float], reach: int
) -> _Tile:
    """Return one tile of the surface; what it needs from beyond its edge it reads itself. ``shared`` are the errors
    that neighbours share, with the datum's part and, where they are known, without; ``least`` the correlations below
    which a level's heights are doubtful."""
    grid = heights.grid
    outer = grid.around_window(window, reach + 3 + REACH_CELLS + margin_cells([*heights.levels][1:] * 2))
    kept, coarse = heights.kept(outer, least)
    if len(kept) > 1:
        kept = [*(confirmed(*of, grid.cell_m) for of in pairwise(kept)), agreed_level(kept[-1], SURE_SHARE)]
    rough = [agreed_level(level, HALF) for level in coarse]
    near = grid.around_window(window, reach + 3)
    surface = surface_of_levels(kept[0], [*kept[1:], *rough], grid.cell_m)
    joined = without_islands(surface, grid.cell_m, near.within(outer))
    filled = filled_heights(joined.height_m, grid.cell_m, reach)
    known = np.isfinite(joined.height_m)
    none, own = np.float32(np.nan), np.where(known, joined.sigma_m, np.float32(0.0))
    whole, *relative = (np.where(known, surface_sigma_m(s, grid, near, joined.height_m, own), none) for s in shared)
    source = np.where(np.isfinite(filled), FILLED, HOLE).astype(np.uint8)
    for cells, code in MEASURED_IN.items():
        source[joined.cells == cells] = code
    base, at = np.float32(heights.base_map_m), window.within(near)
    return _Tile(
        height=(joined.height_m + base)[at],
        filled=(filled + base)[at],
        sigma=whole[at],
        relative=relative[0][at] if relative else np.full_like(whole[at], none),
        own=np.where(known, joined.sigma_m, none)[at],
        source=source[at],
        confidence=joined.correlation[at],
        rays=joined.rays[at],
        seen=kept[0].seen[window.within(outer)],
    )


def interpolate_surface(run: Run, site: SurfaceFrame, folder: Path, progress: Progress) -> SurfaceSummary:
    """Make the DSM from the adjusted tie points alone, and the standard deviations of its heights."""
    settings = run.project.surface
    if settings.spike_minimum_m is None:
        gsd_m = photographs_ground_sampling_m(block_as_adjusted(run))
        settings = replace(settings, spike_minimum_m=SPIKE_GSD * float(np.nanmedian(gsd_m)))
    surface = surface_with_sigma(site.cloud(), site.precision(), settings, site.shape())
    raster, note = surface.heights, site.note
    write_raster(folder / "dsm.tif", raster, site.crs, description=HEIGHT, note=note)
    write_raster(folder / "dsm_sigma.tif", surface.sigma, site.plan, description=SIGMA, note=note)
    write_raster(folder / OWN_SIGMA_FILE, surface.own, site.plan, description=OWN_SIGMA, note=note)
    if surface.relative is not None:
        path = folder / RELATIVE_SIGMA_FILE
        write_raster(path, surface.relative, site.plan, description=RELATIVE_SIGMA, note=note)
    grid, known = MapGrid.of(raster), np.isfinite(raster.values)
    whole = grid.whole, raster.values, np.where(known, np.float32(0.0), np.float32(np.nan))
    close_within_rim(run, site, folder, grid, [whole])
    site.write(folder, grid)
    write_arrays(folder / "held_out.npz", {"held_out_m": surface.held_out_m})
    rows, columns = raster.values.shape
    progress(1, 1, f"{columns} × {rows} cells of {raster.cell_m:g} m")
    return {"rows": rows, "columns": columns, "cell_m": raster.cell_m}


def _surface_settings(run: Run) -> object:
    surface = replace(run.project.surface, area=None)  # the heights of the stage before are those in it
    return [surface, "water"] if "water" in run.project.masks.auto else surface


def _surface_words(summary: SurfaceSummary) -> str:
    wet = summary.get("water_of_grid")
    water = "" if wet is None else ", no water found" if not wet else f", {things(wet, 'cell')} on water"
    return f"{cells_in_words(summary)}{water}"


def _surface_memory(extent: Extent) -> Memory:
    picture = extent.size.orthophoto_cells
    tiles = min(extent.workers * TILE_BYTES, MATCHED_CELL_BYTES * (picture + extent.cells))
    return Memory(LIBRARIES_BYTES + tiles * extent.project.dense.enabled, remedy=COARSER)


SURFACE: Stage = Stage(
    "surface",
    "Surface model",
    ("adjustment", "dense"),
    _surface_settings,
    model_surface,
    line_of(SurfaceSummary, _surface_words),
    Costs(
        0.15,
        (Rate("raster_mcells", 0.6),),
        3.5,
        (
            "photogram.surface.dsm",
            "photogram.surface.dtm",
            "photogram.surface.islands",
            "photogram.surface.levels",
            "photogram.surface.planes",
        ),
        disk_bytes=lambda extent: (
            extent.raster_bytes + LAYER_BYTES * extent.matched_cells + CLOSED_BYTES * extent.cells
        ),
        memory=_surface_memory,
    ),
    products=(
        "dsm.tif",
        "dsm_sigma.tif",
        RELATIVE_SIGMA_FILE,
        OWN_SIGMA_FILE,
        "dsm_filled.tif",
        "dsm_source.tif",
        "dsm_source.tif.aux.xml",
        PLANE,
    ),
)
