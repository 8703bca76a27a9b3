"""What is true of a site with cover, cell by cell of a lattice: heights of the ground and of crowns, and what is there.

Each cell is sampled by upright rays, SAMPLES × SAMPLES of them, with leaves at rest. Where there are leaves there is no
one height: the highest leaf of a cell, and the crown's envelope, which is the mean of those over a window, are what a
surface model may show that sees single leaves, or a window of them. How leaves scatter within a window stands beside.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from scipy.ndimage import binary_closing, correlate1d, distance_transform_edt

from photogram.arrays import BoolArray, ByteArray, FloatArray
from photogram.simulation.cover.hits import leaves_over
from photogram.simulation.cover.leaves import Lines, PlantKind
from photogram.simulation.scene import Material, Scene

SAMPLES = 4
"""Upright rays per cell, along each axis."""

WINDOWS_CELLS = (1, 2, 4, 8)
"""Sides of the windows of the crown's envelope, in cells."""

GAP_M = 0.6
"""Gaps in a crown or hedge up to this width belong to it."""


class Kind(IntEnum):
    """What a cell shows from above."""

    OPEN = 0
    BUILDING = 1
    CANOPY = 2
    HEDGE = 3
    GRASS = 4
    WATER = 5


@dataclass(frozen=True, eq=False)
class CoverTruth:
    """The truth of cells (R, C); heights in the world frame."""

    ground_m: FloatArray
    """Height at the centre of the cell of what is solid: terrain, roofs, the tufts of grass, the level of water."""
    highest_m: FloatArray
    """Height of the highest leaf over the cell, NaN where there is none."""
    envelope_m: FloatArray
    """Envelope (W, R, C) of leaves for windows of WINDOWS_CELLS: mean of ``highest_m`` over the cells of the window
    that have leaves, those at its rim by half; NaN where they are less than half of the window."""
    spread_m: FloatArray
    """Standard deviation (W, R, C) of what is seen from above, leaves and gaps, over the same windows."""
    kind: ByteArray
    """Kind of each cell. Gaps of a crown belong to it."""
    edge_m: FloatArray
    """Distance (R, C) from the nearest rim of a building, in m."""
    line_m: FloatArray
    """Height of the highest wire or rail over the cell or its neighbours, NaN where there is none."""
    post: BoolArray
    """Cells with a post or pole, or beside one (R, C)."""

    @property
    def top_m(self) -> FloatArray:
        """Return the height (R, C) of the surface: the highest leaf, or the ground where there is none."""
        return np.asarray(np.fmax(self.highest_m, self.ground_m))

    def near_building(self, cells: int, cell_m: float) -> BoolArray:
        """Return which cells lie within so many cells of a building's edge, inside or out."""
        return np.asarray(self.edge_m <= cells * cell_m)


def windowed(values: FloatArray, side: int) -> FloatArray:
    """Return the sums of values (R, C) over square windows of ``side`` cells around each, cut cells at the rim by their
    share; zero beyond the edge."""
    weight = np.ones(side) if side % 2 else np.concatenate([[0.5], np.ones(side - 1), [0.5]])
    for axis in (0, 1):
        values = correlate1d(values, weight, axis=axis, mode="constant")
    return np.asarray(values)


def _line_cells(
    lines: Lines, corner: FloatArray, step: FloatArray, shape: tuple[int, int]
) -> tuple[FloatArray, BoolArray]:
    """Return the height of wires and rails over cells, and which cells have posts; both with their neighbours.

    ``corner`` (2,) is the centre of the first cell, ``step`` (2, 2) the way to the next column and to the next row.
    """
    height, post = np.full(shape, -np.inf), np.zeros(shape, bool)
    for share in np.linspace(0.0, 1.0, 9):
        place = lines.start_m + share * (lines.end_m - lines.start_m)
        column, row = np.rint((place[:, :2] - corner) @ np.linalg.inv(step)).astype(int).T
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                r, c = row + down, column + right
                inside = (r >= 0) & (r < shape[0]) & (c >= 0) & (c < shape[1])
                flat, hung = inside & lines.upright, inside & ~lines.upright
                post[r[flat], c[flat]] = True
                np.maximum.at(height, (r[hung], c[hung]), place[hung, 2])
    return np.where(np.isfinite(height), height, np.nan), post


def _closed(covered: BoolArray, cell_m: float) -> BoolArray:
    reach = max(1, round(GAP_M / 2 / cell_m))
    disc = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) <= reach
    padded = np.pad(covered, reach)
    return np.asarray(binary_closing(padded, disc)[reach:-reach, reach:-reach] | covered)


def cover_truth(scene: Scene, centres_m: FloatArray) -> CoverTruth:
    """Return the truth at cells with centres (R, C, 2) in the world frame: a lattice of squares, turned or not.

    A scene without cover has domes for trees: they are CANOPY, and part of its ground. Needs two rows and columns.
    """
    shape = (centres_m.shape[0], centres_m.shape[1])
    flat = np.ascontiguousarray(centres_m.reshape(-1, 2), np.float64)
    step = np.stack([
        (centres_m[0, -1] - centres_m[0, 0]) / (shape[1] - 1), (centres_m[-1, 0] - centres_m[0, 0]) / (shape[0] - 1)
    ])  # fmt: skip
    cell_m = float(np.hypot(*step[0]))
    ground = scene.height(flat)
    column, row = np.rint((flat - [scene.west_m, scene.south_m]) / scene.cell_m).astype(int).T
    rows, columns = scene.height_m.shape
    material = scene.material[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)].reshape(shape)
    kind = np.zeros(shape, np.uint8)
    kind[material == Material.GRASS], kind[material == Material.WATER] = Kind.GRASS, Kind.WATER
    kind[material == Material.TREE] = Kind.CANOPY
    built = material >= Material.ROOF_TILES
    kind[built] = Kind.BUILDING
    edge_m = _rim_distance(built) * cell_m
    height = ground.reshape(shape)
    if scene.cover is None:
        none, windows = np.full(shape, np.nan), (len(WINDOWS_CELLS), *shape)
        return CoverTruth(
            height, none, np.full(windows, np.nan), np.zeros(windows), kind, edge_m, none, np.zeros(shape, bool)
        )
    highest, leaf, mean, square = leaves_over(
        scene.cover.at_rest, flat[:, 0].copy(), flat[:, 1].copy(), ground, np.ascontiguousarray(step), SAMPLES
    )
    highest, mean, square = (a.reshape(shape) for a in (highest, mean, square))
    leaf = leaf.reshape(shape)
    plants, there = scene.cover.plants.kind[scene.cover.leaves.plant], leaf >= 0
    for plant, code in ((PlantKind.HEDGE, Kind.HEDGE), (PlantKind.CROWN, Kind.CANOPY)):
        own = there.copy()
        own[there] = plants[leaf[there]] == plant
        kind[_closed(own, cell_m) & ~built] = code
    level = height - ground.mean()
    moments = (level + mean, level**2 + 2 * level * mean + square)
    envelope, spread = [], []
    for side in WINDOWS_CELLS:
        count, total = windowed(there.astype(float), side), windowed(np.where(there, highest, 0.0), side)
        envelope.append(np.where(count >= 0.5 * side**2, total / np.maximum(count, 0.5), np.nan))
        first, second = (windowed(m, side) / windowed(np.ones(shape), side) for m in moments)
        spread.append(np.sqrt(np.maximum(second - first**2, 0.0)))
    line, post = _line_cells(scene.cover.lines, flat[0], step, shape)
    return CoverTruth(height, highest, np.array(envelope), np.array(spread), kind, edge_m, line, post)


def _rim_distance(built: BoolArray) -> FloatArray:
    """Return how far cells lie from the rim of buildings, in cells, infinity where there are none."""
    if not built.any():
        return np.full(built.shape, np.inf)
    outside, inside = distance_transform_edt(~built), distance_transform_edt(built)
    return np.asarray(np.where(built, inside, outside) - 0.5)
