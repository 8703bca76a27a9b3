"""The gcp_list.txt beside a reconstruction of OpenSfM: its ground points, all of them control, and their marks.

It states no standard deviations; those of OpenSfM's own configuration stand in their place (config.py,
``gcp_horizontal_sd``, ``gcp_vertical_sd``).
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from photogram.arrays import BoolArray
from photogram.errors import ControlPointError, ExchangeError, FrameError
from photogram.files.marks.formats import read_points
from photogram.files.marks.gcp_list import write_gcp_list
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.files.tables.surveyed_points import Mark, SurveyedPoint
from photogram.geodesy.crs import NO_CRS, is_geographic
from photogram.geodesy.frames import map_from_crs
from photogram.measures.mark_covariances import isotropic_px2
from photogram.survey import ControlPoints, Role
from photogram.wording import things

FILE = "gcp_list.txt"
SIGMA_M, MARK_SIGMA_PX = (0.01, 0.01, 0.1), 1.0
_CONTROL: tuple[Role, ...] = ("control",)


def read_ground_control(
    path: Path, photographs: Sequence[ForeignPhotograph]
) -> tuple[ControlPoints, str, tuple[str, ...]]:
    """Return the points of a gcp_list.txt, their CRS, and sentences on what is left out. Raises ExchangeError where the
    file is damaged or names no CRS."""
    try:
        held = read_points(path)
    except ControlPointError as error:
        raise ExchangeError(str(error)) from error
    if held.crs is None:
        raise ExchangeError(f"{path}: the first line must name the CRS, EPSG:32617 for example: add it")
    numbers = {photograph.name: i for i, photograph in enumerate(photographs)}
    names = {point.name: g for g, point in enumerate(held.points)}
    marks = [mark for mark in held.marks if mark.photograph in numbers]
    strange = len(held.marks) - len(marks)
    points = ControlPoints(
        tuple(names),
        _CONTROL * len(names),
        np.array([point.position for point in held.points]).reshape(-1, 3),
        np.tile(SIGMA_M, (len(names), 1)),
        np.array([numbers[mark.photograph] for mark in marks], dtype=np.int64),
        np.array([names[mark.point] for mark in marks], dtype=np.int64),
        np.array([mark.pixel for mark in marks], dtype=np.float64).reshape(-1, 2),
        isotropic_px2(np.full(len(marks), MARK_SIGMA_PX)),
    )
    left_out = (f"{things(strange, 'mark')} of {FILE} in photographs without orientation.",) if strange else ()
    return points, held.crs, left_out


def in_crs_of_control(
    path: Path, photographs: Sequence[ForeignPhotograph], measured: str, crs: str
) -> tuple[ForeignPhotograph, ...]:
    """Return photographs whose measured positions, in the CRS ``measured``, are in that of the ground points. Raises
    ExchangeError where there is no way from one to the other."""
    known = [i for i, photograph in enumerate(photographs) if photograph.measured is not None]
    if not known or crs == measured:
        return tuple(photographs)
    given = np.array([photographs[i].measured for i in known])
    try:
        moved = given if is_geographic(crs) else map_from_crs(measured, crs, given)
    except FrameError as error:
        raise ExchangeError(f"{path}: {error}") from error
    places = dict(zip(known, moved, strict=True))
    return tuple(replace(p, measured=places[i]) if i in places else p for i, p in enumerate(photographs))


def write_ground_control(folder: Path, solution: ForeignSolution) -> tuple[str, ...]:
    """Write the gcp_list.txt of a solution in the folder and return sentences on what has no place in it: all of its
    points where it has no CRS or name that the file can hold."""
    points = solution.ground_points
    if points is None:
        return ()
    surveyed: BoolArray = np.asarray(np.isfinite(points.position_world_m).all(axis=1))
    marked = np.isin(np.arange(len(points)), points.mark_point)
    held = np.flatnonzero(surveyed & marked)
    if solution.crs is None or solution.crs == NO_CRS or not len(held):
        return ("Ground points and their marks.",)
    rows = [SurveyedPoint(points.name[g], tuple(points.position_world_m[g].tolist())) for g in held]
    marks = [
        Mark(points.name[g], solution.photographs[i].name, (u, v))
        for g, i, (u, v), sigma in zip(
            points.mark_point.tolist(), points.mark_photograph.tolist(), points.mark_pixel.tolist(),
            points.mark_sigma_px.tolist(), strict=True,
        )
        if surveyed[g] and np.isfinite(sigma)
    ]  # fmt: skip
    try:
        write_gcp_list(folder / FILE, solution.crs, rows, marks)
    except ControlPointError as error:
        return (f"Ground points and their marks: {str(error).removeprefix(f'{folder / FILE}: ')}.",)
    said = [f"Standard deviations and roles of ground points: in {FILE} all of them are control points."]
    if len(held) < len(points):
        said.append(f"{things(len(points) - len(held), 'ground point')} without coordinates or marks.")
    return tuple(said)
