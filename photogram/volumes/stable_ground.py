"""Co-registration of two surfaces on ground that has not moved: an offset in height, or an offset and a tilt.

d = β₀ + β₁ x + β₂ y by least squares over the cells of the stable ground, with weights from their own standard
deviations. The covariance of β counts that neighbours share errors: N⁻¹ Gᵀ W Σ W G N⁻¹. What is common to all cells of
an epoch is fitted too, so what remains of it elsewhere is known: a pattern g leaves g − G (GᵀWG)⁻¹ GᵀW g.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import shapely

from photogram.arrays import BoolArray, FloatArray, nmad
from photogram.errors import SurfaceError
from photogram.grid import MapGrid, Window
from photogram.volumes.correlation import gathered
from photogram.volumes.differences import Correction, Difference, shapes_at
from photogram.volumes.outlines import window_of
from photogram.volumes.surfaces import SLOPE_STEPS

Motion = Literal["offset", "tilt", "rigid"]
"""What one epoch may be moved by: in height; in height and leaning; in all three directions and turned."""

MOST_CELLS = 1_000_000
"""Cells of the whole grid that are looked at; of a larger one every second, third … along each axis."""

FEWEST_CELLS = 100
"""Stable cells below which nothing is said."""

AWAY = 3.0
"""Normalised median absolute deviations from the fit, in own standard deviations where there are any, beyond which a
cell is not stable ground: a car, a bush."""

PATCH_WIDTHS, FEWEST_PATCHES = 6.0, 10
"""Side of a patch of stable ground in widths of the correlation, and patches below which nobody looks at their
scatter."""

TILE_CELLS = 1024


@dataclass(frozen=True, eq=False)
class Registration:
    """How an epoch lies over the other on stable ground: later minus earlier."""

    motion: Motion
    """What was estimated."""
    names: tuple[str, ...]
    """The parameters: offsets in m, tilts in m per m, rotations in rad."""
    value: FloatArray
    """Their estimates (P,)."""
    sigma: FloatArray
    """Their standard deviations by the noise of the stable ground (P,)."""
    expected_sigma: FloatArray
    """Standard deviations (P,) that both epochs state for what was found; NaN where they state none."""
    centre_map_m: tuple[float, ...]
    """Where the offset counts, and what tilts and rotations turn about."""
    cells: int
    """Cells or points that took part."""
    rejected: int
    """Cells or points in the polygons that did not: they contradict the rest."""
    before_median_m: float
    """Median difference before."""
    before_nmad_m: float
    """Normalised median absolute deviation before."""
    after_rms_m: float
    """Root mean square of the residuals, in those that took part."""
    after_nmad_m: float
    """Normalised median absolute deviation of all residuals."""
    remaining_m: float
    """Standard deviation of means over patches beyond noise; 0 where noise explains them, or they are few."""
    patches: int
    """How many there were."""


@dataclass(frozen=True, eq=False)
class _Stable:
    """Every ``step``-th cell along each axis of a grid, (rows, columns) each, where ``known``."""

    grid: MapGrid
    known: BoolArray
    difference_m: FloatArray
    own: tuple[FloatArray, FloatArray]
    pattern_m: FloatArray


def registration_of(
    difference: Difference, polygons: Sequence[Any], motion: Literal["offset", "tilt"]
) -> tuple[Registration, Correction]:
    """Return how the later surface lies over the earlier one on stable polygons, and what takes that off.

    Raises SurfaceError where fewer than FEWEST_CELLS of them are measured in both.
    """
    stable = _stable_cells(difference, shapely.union_all(list(polygons)))
    count = int(stable.known.sum())
    if count < FEWEST_CELLS:
        raise SurfaceError(
            f"stable ground: {count} cells of it are measured in both epochs, {FEWEST_CELLS} are needed: "
            "draw larger polygons where both have heights"
        )
    centre, shape, keep = _fitted(stable, 1 if motion == "offset" else 3)
    weight = _weights(stable, keep)
    gain = _gain(shape, weight)
    d = np.where(stable.known, stable.difference_m, 0.0)
    coefficient = np.tensordot(gain, d, 2)
    covariance = _noise_covariance(gain, stable, difference.correlation_m)
    pattern_fit = np.einsum("prc,mrc->mp", gain, stable.pattern_m)
    residual = d - np.tensordot(coefficient, shape, 1)
    remaining, patches = _remaining_m(residual, keep, stable, difference.correlation_m)
    correction = Correction(centre, coefficient, _root(covariance), pattern_fit, remaining)
    before, after = d[stable.known], residual[stable.known]
    expected = np.sqrt(np.diag(covariance) + np.sum(pattern_fit**2, axis=0))
    names = ("offset_m", "tilt_east", "tilt_north")[: len(coefficient)]
    record = Registration(
        motion=motion,
        names=names,
        value=coefficient,
        sigma=np.sqrt(np.diag(covariance)),
        expected_sigma=expected,
        centre_map_m=(float(centre[0]), float(centre[1])),
        cells=int(keep.sum()),
        rejected=count - int(keep.sum()),
        before_median_m=float(np.median(before)),
        before_nmad_m=nmad(before),
        after_rms_m=float(np.sqrt(np.mean(residual[keep] ** 2))),
        after_nmad_m=nmad(after),
        remaining_m=remaining,
        patches=patches,
    )
    return record, correction


def _stable_cells(difference: Difference, polygon: Any) -> _Stable:  # noqa: ANN401 - of shapely
    """Return the cells whose centres lie in a polygon, of a large grid every second or third; read tile by tile."""
    window = window_of(polygon, difference.grid)
    if window is None:
        raise SurfaceError("stable ground: its polygons lie beyond what both epochs cover: check their CRS")
    whole, (rows, columns) = difference.grid, window.shape
    step = max(1, int(np.ceil(np.sqrt(rows * columns / MOST_CELLS))))
    shape = (-(-rows // step), -(-columns // step))
    west, north = whole.west_map_m + window.column * whole.cell_m, whole.north_map_m - window.row * whole.cell_m
    # the centres of the chosen cells, which are those at the north-west of each step × step
    shift = (step - 1) / 2 * whole.cell_m
    grid = MapGrid(west - shift, north + shift, step * whole.cell_m, *shape)
    stable = _Stable(
        grid, np.zeros(shape, dtype=bool), np.zeros(shape), (np.zeros(shape), np.zeros(shape)),
        np.zeros((difference.patterns(), *shape)),
    )  # fmt: skip
    shapely.prepare(polygon)
    for tile in grid.tiles(max(TILE_CELLS // step, 1)):
        inside = shapely.contains_xy(polygon, *np.meshgrid(*grid.centres_map_m(tile)))
        if not inside.any():
            continue
        fine = Window(
            window.row + tile.row * step, window.column + tile.column * step,
            window.row + (tile.row_end - 1) * step + 1, window.column + (tile.column_end - 1) * step + 1,
        )  # fmt: skip
        outer = fine.around(SLOPE_STEPS)
        cells = difference.cells(outer)
        at = tuple(slice(s.start, s.stop, step) for s in fine.within(outer))
        known = inside & cells.known[at] & ~cells.interpolated[at]
        stable.known[tile.slices] = known
        stable.difference_m[tile.slices] = np.where(known, cells.difference_m[at], 0.0)
        for own, of, width in zip(stable.own, cells.own, cells.width, strict=True):
            own[tile.slices] = (of * width)[at]
        stable.pattern_m[:, *tile.slices] = cells.pattern_m[:, *at]
    return stable


def _weights(stable: _Stable, keep: BoolArray) -> FloatArray:
    variance = stable.own[0] ** 2 + stable.own[1] ** 2
    floor = 1e-4 * float(np.median(variance[keep])) if keep.any() else 0.0
    return np.where(keep, 1.0 / np.maximum(variance, floor), 0.0) if floor > 0.0 else keep.astype(np.float64)


def _gain(shape: FloatArray, weight: FloatArray) -> FloatArray:
    """Return what turns values into coefficients (P, rows, columns): N⁻¹ Gᵀ W."""
    weighted = shape * weight
    normal = np.einsum("prc,qrc->pq", weighted, shape)
    return np.tensordot(np.linalg.inv(normal), weighted, 1)


def _fitted(stable: _Stable, parameters: int) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the centre (2,) of the stable cells, the shapes (P, rows, columns), and which cells fit them: from the
    median on, those within AWAY of the fit, until they stay the same."""
    east, north = stable.grid.centres_map_m(stable.grid.whole)
    row, column = np.nonzero(stable.known)
    centre = np.array([east[column].mean(), north[row].mean()])
    shape = shapes_at(east, north, centre)[:parameters]
    residual = stable.difference_m - np.median(stable.difference_m[stable.known])
    keep = stable.known
    weight = _weights(stable, keep)
    scale = 1.0 / np.sqrt(np.where(weight > 0.0, weight, 1.0))
    for _ in range(20):
        scaled = residual / scale
        limit = AWAY * nmad(scaled[keep])
        kept = stable.known & (np.abs(scaled - np.median(scaled[keep])) <= max(limit, 1e-9))
        coefficient = np.tensordot(_gain(shape, _weights(stable, kept)), stable.difference_m, 2)
        residual = stable.difference_m - np.tensordot(coefficient, shape, 1)
        if np.array_equal(kept, keep):
            break
        keep = kept
    return centre, shape, keep


def _noise_covariance(gain: FloatArray, stable: _Stable, correlation_m: tuple[float, float]) -> FloatArray:
    """Return the covariance (P, P) of the coefficients by the own errors of both epochs."""
    covariance = np.zeros((len(gain), len(gain)))
    for own, length in zip(stable.own, correlation_m, strict=True):
        spread = gain * own
        covariance += np.einsum("prc,qrc->pq", spread, gathered(spread, length, stable.grid.cell_m))
    return (covariance + covariance.T) / 2


def _root(covariance: FloatArray) -> FloatArray:
    """Return columns (P, P) whose outer products add up to a covariance."""
    value, vector = np.linalg.eigh(covariance)
    return np.asarray(vector * np.sqrt(np.maximum(value, 0.0)))


def _remaining_m(
    residual: FloatArray, keep: BoolArray, stable: _Stable, correlation_m: tuple[float, float]
) -> tuple[float, int]:
    """Return the scatter of the means of patches beyond that of noise, m, and how many patches there are.

    By the median of their squares; 0 unless it is beyond twice its own standard deviation by chance.
    """
    side = max(int(np.ceil(PATCH_WIDTHS * max(correlation_m) / stable.grid.cell_m)), 1)
    row, column = np.nonzero(keep)
    patch = row // side * (keep.shape[1] // side + 1) + column // side
    _, number, count = np.unique(patch, return_inverse=True, return_counts=True)
    mean = np.bincount(number, residual[keep]) / count
    noise = np.zeros(len(count))
    for own, length in zip(stable.own, correlation_m, strict=True):
        together = max((length / stable.grid.cell_m) ** 2, 1.0)
        noise += np.bincount(number, own[keep] ** 2) / count * np.minimum(together / count, 1.0)
    full = count >= side**2 / 4
    if full.sum() < FEWEST_PATCHES:
        return 0.0, int(full.sum())
    scatter, expected = nmad(mean[full]) ** 2, float(np.median(noise[full]))
    by_chance = 1.0 + 2.0 * np.sqrt(5.4 / full.sum())  # a squared NMAD has the variance 5.4/n times its square
    return (float(np.sqrt(scatter - expected)) if scatter > by_chance * expected else 0.0), int(full.sum())
