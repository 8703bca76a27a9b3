"""Standard deviations of lengths and areas in plan: what all places share of the errors of photographs and calibration
drops out, as far as they share it.

A figure f of places x_i has Σ_i ∂f/∂x_i δx_i as its error; δx_i = L_i ε + n_i with L_i the factors of ground errors
(photogram.quality.ground_errors), ε of variance 1, and n_i what a place of the orthophoto scatters by itself.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.files.maps.rasters import open_raster
from photogram.grid import Window
from photogram.report.reading import read_report
from photogram.report.view.distances import ground_errors_at
from photogram.result_files import result_path

SHARED_SHARE = 0.8
"""Of a total variance: where all places share more of it, what is left tells nothing of their own errors."""


@dataclass(frozen=True, eq=False)
class PlanErrors:
    """Errors of places (N) in plan: ``factor_m`` (N, 2, R) of what they share, ``own_m`` (N,) standard deviations per
    axis of each by itself."""

    factor_m: FloatArray
    own_m: FloatArray

    def sigma(self, gradient: FloatArray) -> float:
        """Return the standard deviation of a figure with the derivatives (N, 2) by its places."""
        shared = np.einsum("na,nar->r", gradient, self.factor_m)
        own = (gradient**2).sum(axis=1) @ self.own_m**2
        return float(np.sqrt(shared @ shared + own))


def plan_errors(results: Path, place_map_m: FloatArray) -> PlanErrors | None:
    """Return the errors of places (N, 2) of the results' map, None where nothing tells them. Raises ReportError where
    the report is missing or damaged."""
    report = read_report(result_path(results, "report.json"))
    shared = ground_errors_at(report, place_map_m)
    east, north, _ = report["diagnosis"]["intersection_sigma_m"]
    if shared is None or east is None or north is None:
        return None
    usual = np.full(len(place_map_m), np.sqrt(0.5 * (east**2 + north**2)))
    total = _total_m(results, place_map_m)
    common = 0.5 * (shared[:, :2, 0] ** 2).sum(axis=1)
    rest = np.sqrt(np.maximum(total**2 - common, 0.0))
    known = np.isfinite(total) & (common <= SHARED_SHARE * total**2)
    return PlanErrors(shared[:, :2, 1:], np.where(known, rest, usual))


def _total_m(results: Path, place_map_m: FloatArray) -> FloatArray:
    """Return the standard deviations (N,) per axis of the orthophoto's pixels at places, NaN where there is none."""
    path = result_path(results, "orthophoto_sigma.tif")
    if not path.is_file():
        return np.full(len(place_map_m), np.nan)
    raster = open_raster(path, local=True)
    row, column = raster.grid.cells_at(place_map_m)
    values = [
        float(raster.read(Window(r, c, r + 1, c + 1))[0, 0]) if r >= 0 else np.nan
        for r, c in zip(row.tolist(), column.tolist(), strict=True)
    ]
    return np.array(values)


def length_gradient(corners: FloatArray) -> FloatArray:
    """Return the derivatives (N, D) of the length of a line by its corners: (N, 2) in plan, (N, 3) along the slope."""
    step = np.diff(corners, axis=0)
    unit = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
    gradient = np.zeros_like(corners)
    gradient[:-1] -= unit
    gradient[1:] += unit
    return gradient


def area_gradient(corners: FloatArray) -> FloatArray:
    """Return the derivatives (N, 2) of the area of an outline by its corners (N, 2)."""
    after, before = np.roll(corners, -1, axis=0), np.roll(corners, 1, axis=0)
    x, y = corners.T
    turn = 1.0 if (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() > 0 else -1.0
    return np.asarray(0.5 * turn * np.column_stack([after[:, 1] - before[:, 1], before[:, 0] - after[:, 0]]))
