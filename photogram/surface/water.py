"""Moving water in a matched surface: level places that photographs see well, and on which they agree in nothing.

Waves and glitter differ from one exposure to the next, so key points on water find no partner, and windows of no size
agree. One of these alone says little: asphalt has no key points to match, and of those in crowns and high grass, which
move too, only some do; but windows of some cells agree on crowns, and on the asphalt around. So water is what all of
this holds for, in cells CELLS times as large as those of the surface:

- most of the cell is shown by SEEN_BY photographs, and no more than MEASURED_SHARE of it was measured at any level;
- around it, key points that lie there have matched less often than UNMATCHED times what is to be expected of them;
- it belongs to an area of LEAST_AREA_M2 whose key points say so together with significance SIGNIFICANCE;
- it is neither green nor as rich in key points as the land: their median is no greener than GREENEST, and there are
  no more than RICHEST times as many of them in a photograph as where the surface is well measured. In wind, or from
  close above, a wood matches no better than water;
- the shore of the area lies level: SHORE of its heights, but for the lowest, do not differ by more than LEVEL_SHARE of
  the flying height.

What is to be expected of a key point is the share of those of its photograph that matched, where the surface was
measured, times that of the ground that as many photographs show, over that of all: a blurred photograph, and the rim
of a survey, prove nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.stats import poisson

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IntArray
from photogram.camera import Camera, Pose, image_plane_or_nan
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid, Window
from photogram.survey import Features

CELLS = 8
"""Side of the cells in which water is looked for, in cells of the surface."""

SEEN_BY, SHOWN_SHARE = 3, 0.9
"""So many photographs must show this share of a cell."""

MEASURED_SHARE = 0.25
"""Share of a cell that may have been measured: some windows on water agree by chance."""

AROUND_CELLS = 1
"""Cells to each side of one whose key points count for it."""

UNMATCHED, SIGNIFICANCE = 0.15, 1e-4
"""Key points on water match less often than this times what is to be expected; and how seldom it may be that chance
alone makes a whole area look so."""

EDGE_CELLS = 2
"""How far windows of the coarsest level carry the shore onto the water, in cells."""

ENCLOSED_BY = 5
"""So many of the eight cells around one enclose it."""

LEAST_EXPECTED = 3.0
"""Matches to be expected around a cell, at least, for their absence to say anything."""

GREENEST, RICHEST = 0.12, 0.7
"""Of crowns on a real survey, of which no key point matched, the greenness was 0.15 to 0.39, and they were 0.85 to 1.2
times as rich in key points as the rest; simulated water has 0.01 to 0.08 and 0.1 to 0.4."""

LEAST_AREA_M2 = 50.0
"""What is smaller may be cars that have moved."""

SHORE_CELLS, LEAST_SHORE = 2, 10
"""Cells to each side of an area in which its shore lies, and how many of them must have a height."""

SHORE, LEVEL_SHARE = (0.10, 0.35), 0.005
"""Between these shares of the shore's heights, in their order, the water's level lies in their middle, and they differ
by this share of the flying height at most: higher ones are banks and trees, lower ones wrong."""

WELL_MEASURED = 0.5
"""Share of a cell that was measured from which on its key points tell what is to be expected of others."""

_STEADYING = 20.0
"""Key points of the whole block that are added to those of each photograph and each number of photographs."""

LEAST_SINE = 0.25
"""Sine of the least angle below the horizon of rays whose ground is looked for."""

LOW = 0.2
"""Share of a cell's heights that lie lower than its low height."""

_STEPS = 6


@dataclass(frozen=True, eq=False)
class SurfaceCells:
    """What the surface says of larger cells (R, C): which share was ``measured``, and which at the ``finest`` level,
    the mean number of photographs that show it (``seen``), whether enough show most of it (``shown``), and a low height
    of the map, NaN where there is none."""

    measured: Float32Array
    finest: Float32Array
    seen: Float32Array
    shown: BoolArray
    low_m: Float32Array


@dataclass(frozen=True, eq=False)
class KeyPoints:
    """Key points (K,) on the ground: the ``photograph``, the larger ``cell`` of a grid, counted row by row, whether
    they are ``matched``, and how ``green`` they are, (2 G − R − B) / (R + G + B)."""

    photograph: IntArray
    cell: IntArray
    matched: BoolArray
    green: FloatArray

    @staticmethod
    def joined(parts: Sequence[KeyPoints]) -> KeyPoints:
        """Return the key points of several photographs as one, of one or more."""
        return KeyPoints(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(KeyPoints)))


@dataclass(frozen=True, eq=False)
class Water:
    """Areas of water: the number of the area (R, C) of each larger cell of a grid, from 1, 0 on land; and their levels
    (A,) in the map."""

    grid: MapGrid
    area: IntArray
    level_m: FloatArray

    @property
    def area_m2(self) -> list[float]:
        """Return the size of each area."""
        cells = np.bincount(self.area.ravel(), minlength=len(self.level_m) + 1)[1:]
        return [float(n) * self.grid.cell_m**2 for n in cells]

    def levels_m(self, window: Window) -> Float32Array:
        """Return the level (r, c) of the water in the cells of a window of the surface, NaN on land."""
        level = np.concatenate([[np.nan], self.level_m]).astype(np.float32)
        row, column = (np.arange(a, b) // CELLS for a, b in
                       ((window.row, window.row_end), (window.column, window.column_end)))  # fmt: skip
        return np.asarray(level[self.area[np.ix_(row, column)]])


def surface_cells(height_m: Float32Array, finest: BoolArray, seen: ByteArray) -> SurfaceCells:
    """Return the larger cells of a part of a surface whose first cell begins one: from its measured heights (r, c), NaN
    where there are none, which of them are of the finest level, and how many photographs show each cell."""
    size = _blocks(np.ones(height_m.shape, np.float32), 0.0).sum(axis=2)
    ordered = np.sort(_blocks(height_m, np.nan), axis=2)  # NaN last
    count = np.isfinite(ordered).sum(axis=2)
    low = np.take_along_axis(ordered, (LOW * count).astype(np.int64)[..., None], axis=2)[..., 0]
    fine, looked, enough = (
        (_blocks(of.astype(np.float32), 0.0).sum(axis=2) / size).astype(np.float32)
        for of in (finest, seen, seen >= SEEN_BY)
    )
    return SurfaceCells((count / size).astype(np.float32), fine, looked, enough >= SHOWN_SHARE, low)


def joined_cells(grid: MapGrid, parts: Sequence[tuple[Window, SurfaceCells]]) -> SurfaceCells:
    """Return the larger cells of a grid from those of parts that cover it; the windows of these are of the surface."""
    out = SurfaceCells(*(np.empty((grid.rows, grid.columns), getattr(parts[0][1], f.name).dtype)
                         for f in fields(SurfaceCells)))  # fmt: skip
    for window, part in parts:
        for f in fields(SurfaceCells):
            getattr(out, f.name)[window.coarser(CELLS).slices] = getattr(part, f.name)
    return out


def _blocks(values: Float32Array, beyond: float) -> Float32Array:
    """Return values (r, c) by the larger cells that hold them (R, C, CELLS²), ``beyond`` where there are none."""
    rows, columns = (-(-n // CELLS) * CELLS for n in values.shape)
    whole = np.full((rows, columns), beyond, np.float32)
    whole[: values.shape[0], : values.shape[1]] = values
    parted = whole.reshape(rows // CELLS, CELLS, columns // CELLS, CELLS).swapaxes(1, 2)
    return parted.reshape(rows // CELLS, columns // CELLS, CELLS**2)


def key_points_on_ground(
    photograph: int,
    camera: Camera,
    pose: Pose,
    frame: LocalFrame,
    features: Features,
    matched: IntArray,
    grid: MapGrid,
    cells: SurfaceCells,
) -> KeyPoints:
    """Return the key points (N) of a photograph that lie on the larger cells of a grid, of which those in ``matched``,
    by number, are matched. The ground is as low as the cells, and where these have no height as the
    nearest one that has."""
    place = _places_map_m(camera, pose, frame, features.pixel, grid, _everywhere(cells.low_m))
    row, column = grid.cells_at(place)
    inside = row >= 0
    cell = row[inside] * grid.columns + column[inside]
    of_match = np.zeros(len(features), dtype=bool)
    of_match[matched] = True
    red, green, blue = features.colour[inside].astype(np.float64).T
    excess = (2.0 * green - red - blue) / np.maximum(red + green + blue, 1.0)
    return KeyPoints(np.full(len(cell), photograph, dtype=np.int64), cell, of_match[inside], excess)


def _places_map_m(
    camera: Camera, pose: Pose, frame: LocalFrame, pixel: FloatArray, grid: MapGrid, ground_m: Float32Array
) -> FloatArray:
    """Return the places (N, 3) in the map at which rays of pixels (N, 2) meet the ground (R, C) of a grid, NaN for rays
    that are too flat; a ray is as straight in the map as in the world."""
    out = np.full((len(pixel), 3), np.nan)
    ray = np.column_stack([image_plane_or_nan(camera, pixel), np.ones(len(pixel))]) @ pose.rotation_world_from_camera.T
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    down = -(ray @ frame.rotation_world_from_map(pose.position_world_m)[:, 2])
    start = frame.map_from_world(pose.position_world_m[None])[0]
    depth_m, steep = start[2] - float(np.median(ground_m)), np.flatnonzero(down > LEAST_SINE)
    if not depth_m > 0.0 or not len(steep):
        return out
    end = frame.map_from_world(pose.position_world_m + ray[steep] * (depth_m / down[steep])[:, None])
    share = np.ones(len(steep))  # of the way from the photograph to that end
    for _ in range(_STEPS):
        place = start + share[:, None] * (end - start)
        row = np.clip(np.floor((grid.north_map_m - place[:, 1]) / grid.cell_m), 0, grid.rows - 1).astype(np.int64)
        column = np.clip(np.floor((place[:, 0] - grid.west_map_m) / grid.cell_m), 0, grid.columns - 1).astype(np.int64)
        share = share + (ground_m[row, column] - place[:, 2]) / (end[:, 2] - start[2])
    out[steep] = start + share[:, None] * (end - start)
    return out


def _everywhere(values: Float32Array) -> Float32Array:
    """Return values (R, C), of which some are known, with those of the nearest known cell where they are not."""
    at = distance_transform_edt(~np.isfinite(values), return_distances=False, return_indices=True)
    return np.asarray(values[tuple(at)])


def expected_matches(cells: SurfaceCells, points: KeyPoints) -> FloatArray:
    """Return the chance (K,) of each key point to have matched, by its photograph and by how many photographs show the
    ground there, had it lain where the surface is well measured; 0 where nothing tells."""
    tells = (cells.shown & (cells.measured >= WELL_MEASURED)).ravel()[points.cell]
    if not tells.any():
        return np.zeros(len(points.cell))
    mean = float(points.matched[tells].mean())

    def shares(group: IntArray) -> FloatArray:
        count = int(group.max()) + 1
        matched = np.bincount(group[tells & points.matched], minlength=count)
        return np.asarray((matched + _STEADYING * mean) / (np.bincount(group[tells], minlength=count) + _STEADYING))

    by_seen = np.rint(cells.seen).astype(np.int64).ravel()[points.cell]
    return np.minimum(shares(points.photograph)[points.photograph] * shares(by_seen)[by_seen] / max(mean, 1e-9), 1.0)


def find_water(grid: MapGrid, cells: SurfaceCells, points: KeyPoints, flying_height_m: float) -> Water:
    """Return the areas of water among the larger cells, none of which touches another."""
    expected, matched = (
        np.bincount(points.cell, weights=of, minlength=cells.shown.size).astype(np.float64).reshape(cells.shown.shape)
        for of in (expected_matches(cells, points), points.matched.astype(np.float64))
    )
    side = (2 * AROUND_CELLS + 1,) * 2
    around = [cv2.boxFilter(a, -1, side, normalize=False, borderType=cv2.BORDER_CONSTANT) for a in (expected, matched)]
    empty = cells.shown & (cells.measured <= MEASURED_SHARE)
    silent = (around[0] >= LEAST_EXPECTED) & (around[1] <= UNMATCHED * around[0])
    core = cv2.morphologyEx((empty & silent).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    # beside land, its key points count too
    grown = (_widened(core, AROUND_CELLS + 1) > 0) & empty
    label = np.asarray(cv2.connectedComponents(grown.astype(np.uint8), connectivity=8)[1], np.int64)
    area, levels = np.zeros_like(label), list[float]()
    for number in range(1, int(label.max()) + 1):
        own = label == number
        level = _level_m(cells, own, flying_height_m)
        if own.sum() * grid.cell_m**2 < LEAST_AREA_M2 or level is None:
            continue
        inner = own & (core > 0)
        chance = UNMATCHED * float(expected[inner].sum())
        if poisson.cdf(round(float(matched[inner].sum())), chance) > SIGNIFICANCE:
            continue
        if _greenness(points, inner) > GREENEST or _richness(cells, points, inner) > RICHEST:
            continue
        levels.append(level)
        area[own | _waters_edge(cells, own, matched, level + LEVEL_SHARE * flying_height_m)] = len(levels)
    return Water(grid, area, np.array(levels))


def _greenness(points: KeyPoints, area: BoolArray) -> float:
    """Return the median greenness of the key points in an area (R, C)."""
    return float(np.median(points.green[area.ravel()[points.cell]]))


def _richness(cells: SurfaceCells, points: KeyPoints, area: BoolArray) -> float:
    """Return how many key points a photograph has in a cell of an area (R, C), in those of well-measured ground."""
    count = np.bincount(points.cell, minlength=area.size).reshape(area.shape)
    land = cells.shown & (cells.measured >= WELL_MEASURED)
    in_area, on_land = (float(count[of].sum()) / float(cells.seen[of].sum()) for of in (area, land))
    return in_area / on_land


def _waters_edge(cells: SurfaceCells, area: BoolArray, matched: FloatArray, highest_m: float) -> BoolArray:
    """Return the cells (R, C) beside an area that only larger windows have measured, and in which no key point matched:
    those no higher than ``highest_m``, for windows that hold the shore agree on it and carry it onto the water; and,
    however high, those between the water and a well-measured shore that is no higher, or enclosed by water."""
    silent = cells.shown & (cells.finest <= MEASURED_SHARE) & (matched == 0.0)
    lies_low = ~(cells.low_m > highest_m)
    shore = (cells.finest >= WELL_MEASURED) & lies_low
    between = _widened(shore.astype(np.uint8), EDGE_CELLS) > 0
    grown = area
    for edge in (silent & lies_low, silent & (lies_low | between)):
        for _ in range(EDGE_CELLS):
            around = cv2.boxFilter(grown.astype(np.uint8), cv2.CV_16S, (3, 3), normalize=False, borderType=0)
            grown = grown | ((around > 0) & edge) | ((around >= ENCLOSED_BY) & silent)
    return np.asarray(grown & ~area)


def _widened(area: ByteArray, by: int) -> ByteArray:
    return np.asarray(cv2.dilate(area, np.ones((2 * by + 1, 2 * by + 1), np.uint8)))


def _level_m(cells: SurfaceCells, area: BoolArray, flying_height_m: float) -> float | None:
    """Return the level of an area (R, C), by its shore, None where that does not lie level."""
    shore = (_widened(area.astype(np.uint8), SHORE_CELLS) > 0) & ~area & np.isfinite(cells.low_m)
    heights = cells.low_m[shore & (cells.measured >= WELL_MEASURED)]
    if len(heights) < LEAST_SHORE:
        return None
    low, high = np.quantile(heights, SHORE)
    return float((low + high) / 2) if high - low <= LEVEL_SHARE * flying_height_m else None
