"""What the report shows of a dense surface: data types, and heights between the centres of cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, check_shape
from photogram.report.record.ground import GroundPointRecord
from photogram.report.record.surfaces import RimRecord
from photogram.survey import Raster


@dataclass(frozen=True, eq=False)
class DenseSurface:
    """A dense surface and what is known of each of its cells; every array is (rows, columns) of the same grid.

    ``heights`` in m, NaN in holes; ``sigma`` their predicted standard deviations, m; ``filled`` the cells whose height
    was made up from their neighbours (``heights`` may hold it or not); ``level`` the side of the cells
    that a height was measured in, in those of the surface, 0 where it was not; ``rays`` how many photographs a height
    was matched in; ``confidence`` 0 to 1. ``seen`` says in how many photographs a cell was looked up, None that it was
    three or more in all; ``water`` are cells on water, which have no height, ``interpolated`` those closed from farther
    off, None for all that two photographs show and that are nothing else. ``photographs`` are the names of those
    that took part, ``settings`` what the matching was asked for.
    """

    heights: Raster
    sigma: Raster
    filled: BoolArray
    level: ByteArray
    rays: ByteArray
    confidence: Float32Array
    seen: ByteArray | None = None
    water: BoolArray | None = None
    photographs: tuple[str, ...] = ()
    settings: Mapping[str, bool | int | float | str | None] = field(default_factory=dict)
    interpolated: BoolArray | None = None

    def __post_init__(self) -> None:
        shape = self.heights.values.shape
        for name in ("filled", "level", "rays", "confidence", "seen", "water", "interpolated"):
            values = getattr(self, name)
            if values is not None:
                check_shape(name, values, shape)
        check_shape("sigma", self.sigma.values, shape)
        if any(
            getattr(self.sigma, name) != getattr(self.heights, name) for name in ("west_map_m", "north_map_m", "cell_m")
        ):
            raise ValueError("heights and sigma of a dense surface must lie on one grid")

    @property
    def cell_m(self) -> float:
        """Return the side of a cell in m."""
        return self.heights.cell_m

    def measured(self, rows: slice = slice(None)) -> BoolArray:
        """Return which cells of some rows hold a height that was measured, not filled in."""
        return np.asarray(np.isfinite(self.heights.values[rows]) & ~self.filled[rows])


@dataclass(frozen=True, eq=False)
class OrthophotoPicture:
    """An orthophoto small enough for a page: ``rgba`` (rows, columns, 4), alpha 0 where there is no photograph; outer
    corner and cell in the map, m. ``source_cell_m`` and ``source_shape`` are those of orthophoto.tif itself, and
    ``rim`` is its rim."""

    rgba: ByteArray
    west_map_m: float
    north_map_m: float
    cell_m: float
    source_cell_m: float
    source_shape: tuple[int, int]
    rim: RimRecord

    def __post_init__(self) -> None:
        check_shape("rgba", self.rgba, (None, None, 4))


@dataclass(frozen=True, eq=False)
class GroundMarks:
    """Surveyed ground points: ``name``, whether each is a check in height, ``place_map_m`` (G, 3) as surveyed,
    ``sigma_m`` (G, 3) of the survey, and whether that is only assumed."""

    name: tuple[str, ...]
    checks_height: BoolArray
    place_map_m: FloatArray
    sigma_m: FloatArray
    sigma_assumed: BoolArray

    def select(self, keep: NDArray[Any]) -> GroundMarks:
        """Keep the points of a mask or of indices."""
        names = tuple(np.asarray(self.name, dtype=object)[keep].tolist())
        return GroundMarks(
            names, self.checks_height[keep], self.place_map_m[keep], self.sigma_m[keep], self.sigma_assumed[keep]
        )


def ground_marks(control_points: Sequence[GroundPointRecord]) -> GroundMarks:
    """Return the ground points of report.json's list `control_points`."""
    return GroundMarks(
        tuple(p["name"] for p in control_points),
        np.array([p["axis_roles"][2] == "check" for p in control_points], dtype=bool),
        np.array([p["surveyed_map_m"] for p in control_points], dtype=np.float64).reshape(-1, 3),
        np.array([p["surveyed_sigma_m"] for p in control_points], dtype=np.float64).reshape(-1, 3),
        is_assumed(control_points),
    )


def is_assumed(points: Sequence[GroundPointRecord]) -> BoolArray:
    """Return of which points (N,) of report.json nobody has stated the accuracy of the survey; older reports do not
    say."""
    return np.array([p.get("surveyed_sigma_assumed", False) for p in points], dtype=bool)


@dataclass(frozen=True, eq=False)
class Sampled:
    """Heights of a dense surface at places (N,): ``height_m``, ``slope`` (N, 2) ∂h/∂E and ∂h/∂N, ``sigma_m``, all NaN
    where one of the four cells around is a hole or filled; ``inside`` the grid, and ``filled``: one of the four is."""

    height_m: FloatArray
    slope: FloatArray
    sigma_m: FloatArray
    inside: BoolArray
    filled: BoolArray


def sampled(dense: DenseSurface, places_map_m: FloatArray) -> Sampled:
    """Interpolate a dense surface bilinearly between the centres of cells at places (N, 2 or more).

    Nothing is interpolated across a hole: all four cells around a place must have been measured. The standard
    deviation is the weighted mean of those of the four cells, as if their errors were one: neighbouring cells share
    most of the pixels that they were matched by, so nothing averages out.
    """
    rows, columns = dense.heights.values.shape
    column = (places_map_m[:, 0] - dense.heights.west_map_m) / dense.cell_m - 0.5
    row = (dense.heights.north_map_m - places_map_m[:, 1]) / dense.cell_m - 0.5
    inside = (column >= 0) & (column <= columns - 1) & (row >= 0) & (row <= rows - 1)
    left = np.clip(np.floor(column), 0, max(columns - 2, 0)).astype(np.int64)
    top = np.clip(np.floor(row), 0, max(rows - 2, 0)).astype(np.int64)
    x, y = column - left, row - top
    corner = [(np.minimum(top + i, rows - 1), np.minimum(left + j, columns - 1)) for i in (0, 1) for j in (0, 1)]
    weight = np.stack([(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x])
    height = np.stack([dense.heights.values[c] for c in corner]).astype(np.float64)
    sigma = np.stack([dense.sigma.values[c] for c in corner]).astype(np.float64)
    filled = np.stack([dense.filled[c] for c in corner]).any(axis=0)
    known = inside & ~filled & np.isfinite(height).all(axis=0)
    east = ((height[1] - height[0]) * (1 - y) + (height[3] - height[2]) * y) / dense.cell_m
    north = ((height[0] - height[2]) * (1 - x) + (height[1] - height[3]) * x) / dense.cell_m
    return Sampled(
        np.where(known, np.sum(weight * height, axis=0), np.nan),
        np.where(known[:, None], np.column_stack([east, north]), np.nan),
        np.where(known, np.sum(weight * sigma, axis=0), np.nan),
        inside,
        inside & filled,
    )
