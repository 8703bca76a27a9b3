"""A surface whose heights are known: its cells, and what they say of height and slope at a place.

Height and slope at a place are those of the quadratic that fits the WINDOW × WINDOW cells around it best, so that the
noise of single cells is averaged and the curvature of the ground is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.survey import Raster

WINDOW = 5
"""Cells along each side of what stands for a place."""

ROUGH = 2.0
"""Scatter of a window's cells about its quadratic, in standard deviations of a cell, from which it is no smooth
ground: a wall, a tree, or cells too coarse for the relief."""

_STEP = np.arange(WINDOW) - WINDOW // 2
_X, _Y = (part.ravel().astype(np.float64) for part in np.meshgrid(_STEP, -_STEP))  # east, north, in cells


def _basis(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


_DESIGN = _basis(_X, _Y)
_COFACTOR = np.linalg.inv(_DESIGN.T @ _DESIGN)
_FIT = _COFACTOR @ _DESIGN.T
REDUNDANCY = len(_X) - _DESIGN.shape[1]


@dataclass(frozen=True, eq=False)
class LocalHeights:
    """What a known surface says at places (P,), NaN where its cells do not tell."""

    height_m: FloatArray
    """Heights (P,)."""
    slope: FloatArray
    """Slopes (P, 2) east and north, m per m."""
    sigma_m: FloatArray
    """Standard deviations (P,) of the heights, from those of the cells."""
    scatter_m: FloatArray
    """Standard deviations (P,) of the cells about the quadratic."""


@dataclass(frozen=True, eq=False)
class KnownSurface:
    """A height model that is known: laser, or official."""

    name: str
    """What it is called, its file's name."""
    raster: Raster
    """Heights of its cells in the map; NaN where it has none, or the ground is not stable."""
    sigma_m: float
    """Standard deviation of a cell, independent from cell to cell."""
    common_sigma_m: float
    """Standard deviation of what all of it is off by together."""
    common_assumed: bool = False
    """Whether nobody has stated the latter."""

    def __post_init__(self) -> None:
        if not (self.sigma_m > 0.0 and self.common_sigma_m > 0.0):
            raise ValueError("the standard deviations of a known surface must be positive")

    def at(self, places_map_m: FloatArray) -> LocalHeights:
        """Return heights and slopes at places (P, 2 or more) of the map."""
        raster, cell = self.raster, self.raster.cell_m
        values = raster.values
        x = (places_map_m[:, 0] - raster.west_map_m) / cell - 0.5
        y = (raster.north_map_m - places_map_m[:, 1]) / cell - 0.5
        finite = np.isfinite(x) & np.isfinite(y)
        column, row = (np.rint(np.where(finite, part, -1e6)).astype(np.int64) for part in (x, y))
        half = WINDOW // 2
        inside = (row >= half) & (row < values.shape[0] - half) & (column >= half) & (column < values.shape[1] - half)
        rows = np.where(inside, row, half)[:, None, None] + _STEP[:, None]
        columns = np.where(inside, column, half)[:, None, None] + _STEP
        if min(values.shape) < WINDOW:
            inside[:] = False
            window = np.full((len(x), WINDOW * WINDOW), np.nan)
        else:
            window = values[rows, columns].reshape(len(x), -1).astype(np.float64)
        known = inside & np.isfinite(window).all(axis=1)
        middle = np.where(known, window[:, len(_X) // 2], 0.0)[:, None]
        c = np.where(known[:, None], window - middle, 0.0) @ _FIT.T
        left = np.where(known[:, None], window - middle, 0.0) - c @ _DESIGN.T
        dx, dy = x - column, row - y
        a = _basis(dx, dy)
        east = (c[:, 1] + 2.0 * c[:, 3] * dx + c[:, 4] * dy) / cell
        north = (c[:, 2] + c[:, 4] * dx + 2.0 * c[:, 5] * dy) / cell
        cofactor = np.einsum("pi,ij,pj->p", a, _COFACTOR, a)
        return LocalHeights(
            np.where(known, middle[:, 0] + np.einsum("pi,pi->p", a, c), np.nan),
            np.where(known[:, None], np.column_stack([east, north]), np.nan),
            np.where(known, self.sigma_m * np.sqrt(cofactor), np.nan),
            np.where(known, np.sqrt(np.sum(left**2, axis=1) / REDUNDANCY), np.nan),
        )

    def smooth(self, there: LocalHeights) -> BoolArray:
        """Return which places (P,) have a height, and ground around them that a quadratic describes."""
        return np.asarray(np.nan_to_num(there.scatter_m, nan=np.inf) < ROUGH * self.sigma_m)
