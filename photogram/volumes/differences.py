"""The difference of two surfaces, later minus earlier, cell by cell, with the standard deviations of both."""

from dataclasses import dataclass

import numpy as np

from photogram.arrays import BoolArray, ByteArray, FloatArray
from photogram.errors import FrameError
from photogram.geodesy.crs import crs_label, height_system_of, same_plan
from photogram.grid import MapGrid, Window
from photogram.volumes.correlation import gathered, reach_cells
from photogram.volumes.extents import extent_of, no_overlap
from photogram.volumes.joint_errors import JointErrors
from photogram.volumes.surfaces import (
    PATTERNS,
    SLOPE_STEPS,
    SurfaceCells,
    SurfaceFiles,
    same_cells,
    slopes,
    surface_cells,
)

LEVEL = 1.959964
"""Standard deviations beyond which a normal variable lies in 5 % of all cases."""

UNCHANGED, LOWERED, RAISED = 0, 1, 2
"""Codes of a cell by its level of detection."""


@dataclass(frozen=True, eq=False)
class Correction:
    """What was found on stable ground and is taken off: height errors β₀ + β₁ x + β₂ y of the later surface.

    ``centre_map_m`` (2,) is where x and y are 0; ``coefficient`` (P,), P = 1 or 3; ``noise`` (P, K) columns whose outer
    products add up to the covariance of the coefficients by noise; ``pattern_fit`` (M, P) what the fit makes of each
    common pattern.
    """

    centre_map_m: FloatArray
    coefficient: FloatArray
    noise: FloatArray
    pattern_fit: FloatArray
    remaining_m: float
    """Standard deviation of what the stable ground still shows beside it, alike everywhere."""

    def shapes(self, grid: MapGrid, window: Window) -> FloatArray:
        """Return 1, x and y (P, rows, columns) at the cells of a window."""
        return shapes_at(*grid.centres_map_m(window), self.centre_map_m)[: len(self.coefficient)]


def shapes_at(east: FloatArray, north: FloatArray, centre_map_m: FloatArray) -> FloatArray:
    """Return 1, x and y (3, rows, columns) at eastings (columns,) and northings (rows,)."""
    x, y = np.meshgrid(east - centre_map_m[0], north - centre_map_m[1])
    return np.stack([np.ones_like(x), x, y])


@dataclass(frozen=True, eq=False)
class DifferenceCells:
    """A window of a difference, (rows, columns) each, NaN where one of the surfaces has no height."""

    difference_m: FloatArray
    """Later minus earlier."""
    own: tuple[FloatArray, FloatArray]
    """Own standard deviations of the earlier and the later surface, 0 where none is known, m."""
    width: tuple[FloatArray, FloatArray]
    """Widths of their correlation, in those of the surfaces."""
    pattern_m: FloatArray
    """Common errors (M, rows, columns) of the difference, later minus earlier, each of standard deviation 1 times
    this."""
    interpolated: BoolArray
    """Filled in one of them, or without a standard deviation."""

    @property
    def known(self) -> BoolArray:
        """Return where there is a difference."""
        return np.isfinite(self.difference_m)

    @property
    def own_m(self) -> FloatArray:
        """Return the own standard deviation of the difference."""
        return np.hypot(*self.own)

    @property
    def sigma_m(self) -> FloatArray:
        """Return the standard deviation of the difference, NaN where there is none or a height was interpolated."""
        sigma = np.sqrt(self.own[0] ** 2 + self.own[1] ** 2 + np.sum(self.pattern_m**2, axis=0))
        return np.where(self.known & ~self.interpolated, sigma, np.nan)

    @property
    def codes(self) -> ByteArray:
        """Return UNCHANGED, LOWERED or RAISED by the level of detection, 255 where sigma is not known."""
        sigma, difference = self.sigma_m, np.nan_to_num(self.difference_m)
        changed = np.where(difference > 0.0, RAISED, LOWERED)
        codes = np.where(np.abs(difference) > LEVEL * np.nan_to_num(sigma), changed, UNCHANGED)
        return np.where(np.isnan(sigma), 255, codes).astype(np.uint8)


@dataclass(frozen=True)
class Difference:
    """Two surfaces on a grid."""

    earlier: SurfaceFiles
    later: SurfaceFiles
    grid: MapGrid
    """The grid of the finer one over what both cover."""
    joint: JointErrors | None = None
    """What their photographs do to the difference, where one adjustment has both; None: errors of two adjustments."""

    @property
    def resampled(self) -> tuple[str, ...]:
        """Return the names of the surfaces that are interpolated on this grid."""
        surfaces = (self.earlier, self.later)
        return tuple(s.heights.path.name for s in surfaces if not same_cells(s.heights.grid, self.grid))

    @property
    def undeclared_heights(self) -> tuple[str, ...]:
        """Return the name of the surface that does not say what its heights count from, where the other one does."""
        surfaces = (self.earlier, self.later)
        undeclared = [s.heights.path.name for s in surfaces if height_system_of(s.heights.crs)[0] is None]
        return tuple(undeclared) if len(undeclared) == 1 else ()

    @property
    def zeros_without_data(self) -> tuple[str, ...]:
        """Return the names of the surfaces whose zeros stand for no data, which they do not declare."""
        surfaces = (self.earlier, self.later)
        return tuple(s.heights.path.name for s in surfaces if s.heights.zeros_are_none)

    @property
    def impossible_heights(self) -> tuple[str, ...]:
        """Return the names of the surfaces that hold heights beyond all ground, which they do not declare as none."""
        surfaces = (self.earlier, self.later)
        return tuple(s.heights.path.name for s in surfaces if s.heights.holds_impossible)

    @property
    def correlation_m(self) -> tuple[float, float]:
        """Return the widths over which errors of the earlier and the later surface correlate."""
        return self.earlier.correlation_m, self.later.correlation_m

    @property
    def margin(self) -> int:
        """Return how many cells around a window its sums need."""
        return max(*(reach_cells(length, self.grid.cell_m) for length in self.correlation_m), SLOPE_STEPS)

    def patterns(self, correction: Correction | None = None) -> int:
        """Return how many common patterns its cells have."""
        common = 2 * PATTERNS if self.joint is None else self.joint.causes
        return common + (0 if correction is None else correction.noise.shape[1] + 1)

    def cells(self, window: Window, correction: Correction | None = None) -> DifferenceCells:
        """Return a window, which may reach beyond the grid; common patterns are right from SLOPE_STEPS cells within."""
        before, after = (surface_cells(s, self.grid, window) for s in (self.earlier, self.later))
        difference = after.height_m - before.height_m
        if self.joint is None:
            pattern = np.concatenate([-before.pattern_m, after.pattern_m])
        else:
            pattern = self.joint.patterns(self.grid, window, *slopes(after.height_m, self.grid.cell_m))
        if correction is not None:
            shape = correction.shapes(self.grid, window)
            difference = difference - np.tensordot(correction.coefficient, shape, 1)
            left = pattern - np.tensordot(correction.pattern_fit, shape, 1)
            noise = np.tensordot(correction.noise.T, shape, 1)
            rest = np.full((1, *difference.shape), correction.remaining_m)
            pattern = np.concatenate([left, noise, rest])
        return DifferenceCells(
            difference, (_own(before), _own(after)), (before.width, after.width), pattern,
            before.interpolated | after.interpolated,
        )  # fmt: skip


def _own(cells: SurfaceCells) -> FloatArray:
    return np.nan_to_num(cells.own_m)


def own_variance(
    weight: FloatArray,
    cells: DifferenceCells,
    correlation_m: tuple[float, float],
    cell_m: float,
    inner: tuple[slice, slice],
) -> float:
    """Return the part of the variance of Σ w d, w (rows, columns), that own errors make, Σ w s (ρ ∗ w s) over the
    ``inner`` cells: sums over windows that lie side by side add up.

    An error that is alike over k times the width counts k times as much: its area is k² as large.
    """
    total = 0.0
    for own, width, length in zip(cells.own, cells.width, correlation_m, strict=True):
        weighted = weight * own * width
        total += float(np.sum(weighted[inner] * gathered(weighted, length, cell_m)[inner]))
    return total


def difference_of(earlier: SurfaceFiles, later: SurfaceFiles, joint: JointErrors | None = None) -> Difference:
    """Return two surfaces on the grid of the finer one; ``joint`` are the errors of their difference where one
    adjustment has both. Raises FrameError where they lie in different CRS, their heights count from different surfaces,
    or nothing of them is common."""
    a, b = earlier.heights, later.heights
    where = f"surfaces {b.path} and {a.path}"
    if not same_plan(a.crs, b.crs):
        raise FrameError(
            f"{where}: their CRS differ, {crs_label(b.crs)} and {crs_label(a.crs)}: reproject one to the other's "
            "(gdalwarp -t_srs CRS IN.tif OUT.tif)"
        )
    systems = [height_system_of(raster.crs) for raster in (a, b)]
    if None not in (systems[0][0], systems[1][0]) and systems[0] != systems[1]:
        words = [f"{system}{f' ({vertical})' if vertical else ''}" for system, vertical in systems]
        raise FrameError(f"{where}: their heights differ, {words[1]} and {words[0]}: bring one to the other's first")
    fine, other = (a.grid, b.grid) if a.grid.cell_m <= b.grid.cell_m * (1 + 1e-9) else (b.grid, a.grid)
    grid = _overlap(fine, other)
    if grid is None:
        raise FrameError(no_overlap((str(b.path), extent_of(b.grid)), (str(a.path), extent_of(a.grid))))
    return Difference(earlier, later, grid, joint)


def _overlap(fine: MapGrid, other: MapGrid) -> MapGrid | None:
    """Return the cells of a grid whose centres lie on another one, None without any."""
    cell = fine.cell_m
    column = np.ceil((other.west_map_m - fine.west_map_m) / cell - 0.5 - 1e-6)
    row = np.ceil((fine.north_map_m - other.north_map_m) / cell - 0.5 - 1e-6)
    column_end = np.floor((other.west_map_m + other.columns * other.cell_m - fine.west_map_m) / cell + 0.5 + 1e-6)
    row_end = np.floor((fine.north_map_m - other.north_map_m + other.rows * other.cell_m) / cell + 0.5 + 1e-6)
    window = fine.common(Window(int(row), int(column), int(row_end), int(column_end)))
    if window is None:
        return None
    west, north = fine.west_map_m + window.column * cell, fine.north_map_m - window.row * cell
    return MapGrid(west, north, cell, *window.shape)
