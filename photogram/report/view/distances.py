"""What view.html knows of the errors of distances: those of photographs and calibration on a grid over the cloud.

An error that two places share drops out of the distance between them: the grid holds L (3, R) at its nodes, and the
difference of the errors at i and j has the covariance (L_i − L_j)(L_i − L_j)ᵀ, see photogram.quality.ground_errors.
"""

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.spatial import QhullError
from typing_extensions import TypedDict

from photogram.arrays import FloatArray
from photogram.report.record.report import Report

NODES = 9
"""Of the grid, along each side."""

_DIGITS = 6  # of a metre


class ErrorGrid(TypedDict):
    """Errors of the ground on a grid over the cloud, NODES by NODES, nodes east by east within north by north."""

    low_m: list[float]
    """First node: east, north from the origin."""
    step_m: list[float]
    """Distance between neighbouring nodes to the east and to the north."""
    nodes: int
    """Number of nodes along each side."""
    rank: int
    """Columns R of the factors."""
    sigma_m: list[list[float]]
    """Standard deviations (nodes, 3) of the ground without what its points scatter by themselves."""
    factor_m: list[list[list[float]]]
    """Factors (nodes, 3, R) of them for differences."""
    own_m: list[float | None]
    """What points of the cloud scatter by themselves in the median, in plan and in height; None where not known."""


def error_grid(
    report: Report, origin_map_m: FloatArray, low_m: FloatArray, high_m: FloatArray, in_plan: bool
) -> ErrorGrid | None:
    """Return the grid over the cloud, whose corners are given relative to the origin; None where nothing is known.

    What points of the cloud scatter by themselves is that of tie points where the cloud tells sigmas ``in_plan``, else
    that of the dense surface.
    """
    east, north = (np.linspace(low_m[k], max(high_m[k], low_m[k] + 1e-3), NODES) for k in (0, 1))
    nodes = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2)
    on_grid = ground_errors_at(report, nodes + origin_map_m[:2])
    if on_grid is None:
        return None
    return {
        "low_m": [float(east[0]), float(north[0])],
        "step_m": [float(east[1] - east[0]), float(north[1] - north[0])],
        "nodes": NODES,
        "rank": on_grid.shape[2] - 1,
        "sigma_m": np.round(on_grid[:, :, 0], _DIGITS).tolist(),
        "factor_m": np.round(on_grid[:, :, 1:], _DIGITS).tolist(),
        "own_m": _own_m(report, in_plan),
    }


def ground_errors_at(report: Report, place_map_m: FloatArray) -> FloatArray | None:
    """Return of places (N, 2) in the map the standard deviations along easting, northing and height of the ground
    without what its points scatter by themselves, and the factors of differences behind them (N, 3, 1 + R); None where
    nothing is known."""
    errors = report["diagnosis"]["ground_errors"]
    if not errors or not errors["position_map_m"]:
        return None
    places = np.array(errors["position_map_m"])[:, :2]
    values = np.concatenate([np.array(errors["sigma_m"])[:, :, None], np.array(errors["factor_m"])], axis=2)
    middle = places.mean(axis=0)
    found = _interpolated(places - middle, values.reshape(len(places), -1), place_map_m - middle)
    return found.reshape(len(place_map_m), 3, -1)


def _own_m(report: Report, in_plan: bool) -> list[float | None]:
    if not in_plan:
        dense = report.get("dense")
        return [None, None if dense is None else dense["matching_sigma_m"]]
    east, north, height = report["diagnosis"]["intersection_sigma_m"]
    return [None if east is None or north is None else float(np.hypot(east, north)), height]


def _interpolated(places: FloatArray, values: FloatArray, nodes: FloatArray) -> FloatArray:
    """Return values (N, K) at nodes (N, 2): linear between the places (Q, 2), those of the nearest beyond them."""
    nearest: FloatArray = np.asarray(NearestNDInterpolator(places, values)(nodes))
    try:
        linear: FloatArray = np.asarray(LinearNDInterpolator(places, values, rescale=True)(nodes))
    except (QhullError, ValueError):  # too few places, or all in one line
        return nearest
    return np.where(np.isfinite(linear), linear, nearest)
