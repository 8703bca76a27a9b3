"""What is measured on the map of a finished survey: heights, distances, profiles, areas and volumes, each with its
standard deviation.

Heights are those of the cells of `dsm.tif`; their errors are those that `photogram compare` takes: own errors of the
cells and the patterns that all cells share, which drop out of differences as far as both ends share them. Volumes are
those of `photogram compare` over the rim of a polygon.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import shapely
from typing_extensions import TypedDict

from photogram.arrays import FloatArray
from photogram.desk.plan_errors import PlanErrors, area_gradient, length_gradient, plan_errors
from photogram.errors import SettingError, SurfaceError
from photogram.files.maps.polygon_files import SitePolygon
from photogram.grid import Window
from photogram.languages.said import Figures, Said
from photogram.report.surveyed_surfaces import open_surface
from photogram.volumes.differences import Difference
from photogram.volumes.measured_volumes import measured_volumes, over_rim
from photogram.volumes.rim_base import over_level
from photogram.wording import percent

Kind = Literal["height", "distance", "profile", "area", "volume"]
KINDS: tuple[Kind, ...] = ("height", "distance", "profile", "area", "volume")
OUTLINES: tuple[Kind, ...] = ("area", "volume")
"""Those whose corners close an outline."""

MOST_CORNERS = 500
MOST_SAMPLES = 2000
"""Of a profile; longer ones are sampled every so many cells."""

_LEAST_CORNERS = {"height": 1, "distance": 2, "profile": 2, "area": 3, "volume": 3}


class Figure(TypedDict):
    """One figure with its unit."""

    name: str
    value: float | None
    sigma: float | None
    unit: str


class Sample(TypedDict):
    """A place of a profile."""

    along_m: float
    height_m: float | None
    sigma_m: float | None


class Measurement(TypedDict):
    """What was measured."""

    kind: Kind
    corners_map_m: list[list[float]]
    figures: list[Figure]
    profile: list[Sample]
    note: str
    """What the figures leave out, empty where they leave out nothing."""


def measure(results: Path, kind: Kind, corners_map_m: Sequence[Sequence[float]]) -> Measurement:
    """Measure on the surface of a folder of results; ``corners_map_m`` are easting and northing of one place or more.

    Raises SettingError where there are too few or too many, SurfaceError where the surface has no height there,
    ProjectError where its files are missing or damaged.
    """
    corners = np.array(corners_map_m, dtype=np.float64).reshape(-1, 2)
    least = _LEAST_CORNERS[kind]
    if not least <= len(corners) <= MOST_CORNERS or not np.isfinite(corners).all():
        raise SettingError(
            "corners",
            Said(
                "{least} to {most} places are expected, found {found}",
                least=least,
                most=MOST_CORNERS,
                found=len(corners),
            ),
        )
    difference = over_level(open_surface(results, None, None))
    figures, profile = _MEASURES[kind](difference, corners, plan_errors(results, corners))
    return {
        "kind": kind,
        "corners_map_m": corners.tolist(),
        "figures": figures,
        "profile": profile,
        "note": note_of(kind, figures, profile),
    }


def note_of(kind: Kind, figures: Sequence[Figure], profile: Sequence[Sample]) -> str:
    """Return what the figures of a measurement leave out, empty where they leave out nothing."""
    if kind == "distance":
        if len(figures) == 1:
            return Said("No measured height at one of the places: no slope distance.")
        return Said("How exactly the places were clicked is not in the standard deviation.")
    if kind == "area":
        return Said("In the plane of the map grid. How exactly the corners were clicked is not in it.")
    if kind == "volume":
        return Said("Over the plane through the ground around the outline.")
    missing = sum(sample["height_m"] is None for sample in profile)
    if not missing:
        return ""
    share = Figures(percent(missing / len(profile)))
    return Said("No measured height along {share} of the line.", share=share)


_Outcome = tuple[list[Figure], list[Sample]]


class _Heights:
    """Heights at places (N, 2): ``height_m`` (N,) NaN where there is none, ``own_m`` (N,), ``pattern_m`` (N, M)."""

    def __init__(self, difference: Difference, places: FloatArray) -> None:
        grid = difference.grid
        column = np.floor((places[:, 0] - grid.west_map_m) / grid.cell_m).astype(np.int64)
        row = np.floor((grid.north_map_m - places[:, 1]) / grid.cell_m).astype(np.int64)
        inside = (row >= 0) & (row < grid.rows) & (column >= 0) & (column < grid.columns)
        self.height_m: FloatArray = np.full(len(places), np.nan)
        self.own_m: FloatArray = np.full(len(places), np.nan)
        self.pattern_m: FloatArray = np.zeros((len(places), 0))
        if not inside.any():
            return
        window = Window(
            int(row[inside].min()), int(column[inside].min()),
            int(row[inside].max()) + 1, int(column[inside].max()) + 1,
        )  # fmt: skip
        for part in window.tiles(1024):
            here = (
                inside & (row >= part.row) & (row < part.row_end) & (column >= part.column) & (column < part.column_end)
            )
            if not here.any():
                continue
            cells = difference.cells(part.around(difference.margin), None)
            at = row[here] - part.row + difference.margin, column[here] - part.column + difference.margin
            self.height_m[here], self.own_m[here] = cells.difference_m[at], cells.own[1][at]
            if not self.pattern_m.shape[1]:
                self.pattern_m = np.zeros((len(places), len(cells.pattern_m)))
            self.pattern_m[here] = cells.pattern_m[(slice(None), *at)].T

    @property
    def sigma_m(self) -> FloatArray:
        """Return their standard deviations (N,) in the map."""
        return np.asarray(np.sqrt(self.own_m**2 + (self.pattern_m**2).sum(axis=1)))

    def sigma_of(self, gradient: FloatArray) -> float:
        """Return the standard deviation of a figure with the derivatives (N,) by the heights, all of them known."""
        shared = gradient @ self.pattern_m
        return float(np.sqrt(gradient**2 @ self.own_m**2 + shared @ shared))

    def step_sigma_m(self, first: int, last: int) -> float:
        """Return the standard deviation of the difference of two."""
        shared = self.pattern_m[first] - self.pattern_m[last]
        return float(np.sqrt(self.own_m[first] ** 2 + self.own_m[last] ** 2 + shared @ shared))


def _figure(name: str, value: float, sigma: float | None, unit: str) -> Figure:
    known = [None if v is None or not np.isfinite(v) else float(v) for v in (value, sigma)]
    return {"name": name, "value": known[0], "sigma": known[1], "unit": unit}


def _in_plan(name: str, value: float, gradient: FloatArray, errors: PlanErrors | None, unit: str) -> Figure:
    return _figure(name, value, None if errors is None else errors.sigma(gradient), unit)


def _height(difference: Difference, corners: FloatArray, _: PlanErrors | None) -> _Outcome:
    heights = _Heights(difference, corners[:1])
    if np.isnan(heights.height_m[0]):
        raise SurfaceError(Said("the surface has no measured height there: choose a place beside it"))
    return (
        [
            _figure(Said("easting"), corners[0, 0], None, "m"),
            _figure(Said("northing"), corners[0, 1], None, "m"),
            _figure(Said("height"), heights.height_m[0], heights.sigma_m[0], "m"),
        ],
        [],
    )


def _distance(difference: Difference, corners: FloatArray, errors: PlanErrors | None) -> _Outcome:
    heights = _Heights(difference, corners)
    plan = np.hypot(*np.diff(corners, axis=0).T)
    figures = [_in_plan(Said("length in plan"), float(plan.sum()), length_gradient(corners), errors, "m")]
    if np.isnan(heights.height_m).any():
        return figures, []
    step = float(heights.height_m[-1] - heights.height_m[0])
    slope = float(np.hypot(plan, np.diff(heights.height_m)).sum())
    gradient = length_gradient(np.column_stack([corners, heights.height_m]))
    upright = heights.sigma_of(gradient[:, 2])
    sigma = None if errors is None else float(np.hypot(errors.sigma(gradient[:, :2]), upright))
    return (
        [
            *figures,
            _figure(Said("slope distance"), slope, sigma, "m"),
            _figure(Said("height difference"), step, heights.step_sigma_m(0, len(corners) - 1), "m"),
        ],
        [],
    )


def _profile(difference: Difference, corners: FloatArray, errors: PlanErrors | None) -> _Outcome:
    length = np.concatenate([[0.0], np.hypot(*np.diff(corners, axis=0).T).cumsum()])
    count = int(np.clip(np.ceil(length[-1] / difference.grid.cell_m), 1, MOST_SAMPLES - 1)) + 1
    along = np.linspace(0.0, length[-1], count)
    places = np.column_stack([np.interp(along, length, corners[:, k]) for k in (0, 1)])
    heights = _Heights(difference, places)
    known = np.flatnonzero(np.isfinite(heights.height_m))
    if not len(known):
        raise SurfaceError(Said("the surface has no measured height along the line: draw it over the surface"))
    samples: list[Sample] = [
        {
            "along_m": float(a),
            "height_m": float(h) if np.isfinite(h) else None,
            "sigma_m": float(s) if np.isfinite(h) else None,
        }
        for a, h, s in zip(along, heights.height_m, heights.sigma_m, strict=True)
    ]
    low, high = (int(known[k]) for k in (np.argmin(heights.height_m[known]), np.argmax(heights.height_m[known])))
    figures = [
        _in_plan(Said("length in plan"), float(length[-1]), length_gradient(corners), errors, "m"),
        _figure(Said("lowest"), heights.height_m[low], heights.sigma_m[low], "m"),
        _figure(Said("highest"), heights.height_m[high], heights.sigma_m[high], "m"),
        _figure(
            Said("height difference"),
            heights.height_m[high] - heights.height_m[low],
            heights.step_sigma_m(low, high),
            "m",
        ),
    ]
    return figures, samples


def _polygon(corners: FloatArray) -> shapely.Polygon:
    polygon = shapely.Polygon(corners)
    if not polygon.is_valid or not polygon.area > 0.0:
        raise SettingError("corners", Said("the outline crosses itself: draw it again"))
    return polygon


def _area(_: Difference, corners: FloatArray, errors: PlanErrors | None) -> _Outcome:
    polygon, around = _polygon(corners), length_gradient(np.vstack([corners, corners[:1]]))
    perimeter = around[:-1]
    perimeter[0] += around[-1]
    figures = [
        _in_plan(Said("area in plan"), polygon.area, area_gradient(corners), errors, "m²"),
        _in_plan(Said("perimeter in plan"), polygon.length, perimeter, errors, "m"),
    ]
    return figures, []


def _volume(difference: Difference, corners: FloatArray, errors: PlanErrors | None) -> _Outcome:
    based = over_rim(difference, SitePolygon("volume", _polygon(corners)))
    volume = measured_volumes(difference, [based])[0].volume()
    if not volume.measured_m2 + volume.interpolated_m2 > 0.0:
        raise SurfaceError(Said("the surface has no height in the outline: draw it over the surface"))
    figures = [
        _figure(Said("volume"), volume.net_m3, volume.net_sigma_m3, "m³"),
        _figure(Said("fill"), volume.fill_m3, volume.fill_sigma_m3, "m³"),
        _figure(Said("cut"), volume.cut_m3, volume.cut_sigma_m3, "m³"),
        _in_plan(Said("area in plan"), volume.area_m2, area_gradient(corners), errors, "m²"),
        _figure(Said("of it measured"), volume.measured_m2, None, "m²"),
    ]
    return figures, []


_MEASURES = {"height": _height, "distance": _distance, "profile": _profile, "area": _area, "volume": _volume}
