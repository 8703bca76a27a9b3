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
from photogram.exchange.formats.assembly import ground_points_of, sentences
from photogram.files.marks.formats import read_points
from photogram.files.marks.gcp_list import write_gcp_list
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.files.tables.surveyed_points import Mark, SurveyedPoint
from photogram.geodesy.crs import NO_CRS, is_geographic
from photogram.geodesy.frames import map_from_crs
from photogram.survey import ControlPoints
from photogram.wording import things

FILE = "gcp_list.txt"
SIGMA_M, MARK_SIGMA_PX = (0.01, 0.01, 0.1), 1.0


def read_ground_control(path: Path, photographs: Sequence[ForeignPhotograph]) -> tuple[ControlPoints, str, list[str]]:
    """Return the points of a gcp_list.txt, their CRS, and sentences on what is left out. Raises ExchangeError where the
    file is damaged or names no CRS."""
    try:
        file = read_points(path)
    except ControlPointError as error:
        raise ExchangeError(str(error)) from error
    if file.crs is None:
        raise ExchangeError(f"{path}: the first line must name the CRS, EPSG:32617 for example: add it")
    numbers = {photograph.name: i for i, photograph in enumerate(photographs)}
    names = {point.name: g for g, point in enumerate(file.points)}
    marks = [
        (numbers[mark.photograph], names[mark.point], *mark.pixel, MARK_SIGMA_PX)
        for mark in file.marks
        if mark.photograph in numbers
    ]
    positions = [np.array(point.position) for point in file.points]
    points = ground_points_of(list(names), ["control"] * len(names), positions, [SIGMA_M] * len(names), marks)
    strange = len(file.marks) - len(marks)
    text = f"{things(strange, 'mark')} of {FILE} in photographs without orientation."
    return points, file.crs, sentences((strange, text))


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


def write_ground_control(folder: Path, solution: ForeignSolution) -> list[str]:
    """Write the gcp_list.txt of a solution in the folder and return sentences on what has no place in it: all of its
    points where it has no CRS or name that the file can hold."""
    points = solution.ground_points
    if points is None:
        return []
    surveyed: BoolArray = np.asarray(np.isfinite(points.position_world_m).all(axis=1))
    marked = np.isin(np.arange(len(points)), points.mark_point)
    written = np.flatnonzero(surveyed & marked)
    if solution.crs is None or solution.crs == NO_CRS or not len(written):
        return ["Ground points and their marks."]
    rows = [SurveyedPoint(points.name[g], tuple(points.position_world_m[g].tolist())) for g in written]
    marks = [
        Mark(points.name[g], solution.photographs[i].name, (u, v))
        for g, i, (u, v), sigma in zip(
            points.mark_point.tolist(),
            points.mark_photograph.tolist(),
            points.mark_pixel.tolist(),
            points.mark_sigma_px.tolist(),
            strict=True,
        )
        if surveyed[g] and np.isfinite(sigma)
    ]
    try:
        write_gcp_list(folder / FILE, solution.crs, rows, marks)
    except ControlPointError as error:
        return [f"Ground points and their marks: {str(error).removeprefix(f'{folder / FILE}: ')}."]
    others = len(points) - len(written)
    return sentences(
        (True, f"Standard deviations and roles of ground points: in {FILE} all of them are control points."),
        (others, f"{things(others, 'ground point')} without coordinates or marks."),
    )
