"""Contour lines with fewer vertices, and where their labels stand."""

from dataclasses import dataclass

import numpy as np
import shapely

from photogram.arrays import FloatArray
from photogram.survey import Contours

DEFAULT_TOLERANCE_CELLS = 0.5
"""A contour line leaves the traced one by so much of a cell at most, where nothing else is asked for."""


@dataclass(frozen=True, eq=False)
class LineLabels:
    """Labels (N) on lines."""

    position_map_m: FloatArray
    """Their middles (N, 2)."""
    angle_deg: FloatArray
    """Their directions (N,), counter-clockwise from east, so that they are read from the south."""
    height_m: FloatArray
    """The heights (N,) that they show."""


def thinned(contours: Contours, tolerance_m: float) -> Contours:
    """Return the lines with the vertices that Douglas & Peucker (1973) leave within ``tolerance_m`` of the traced ones;
    ends stay where they are, and closed lines closed."""
    if not len(contours):
        return contours
    lines = shapely.simplify(_lines(contours), tolerance_m, preserve_topology=False)
    first = np.concatenate([[0], np.cumsum(shapely.get_num_coordinates(lines))]).astype(np.int64)
    return Contours(contours.height_m, shapely.get_coordinates(lines), first, contours.interval_m, contours.cell_m)


def _lines(contours: Contours) -> np.ndarray[tuple[int], np.dtype[np.object_]]:
    of_line = np.repeat(np.arange(len(contours)), np.diff(contours.first))
    return np.asarray(shapely.linestrings(contours.vertex_map_m, indices=of_line))


def index_labels(contours: Contours, text_m: float, spacing: float = 120.0, least: float = 10.0) -> LineLabels:
    """Return labels of the index contours for texts ``text_m`` high: one every ``spacing`` text heights along a line,
    none on lines shorter than ``least``."""
    chosen = np.flatnonzero(contours.is_index)
    if not len(chosen):
        return LineLabels(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    lines = _lines(contours)[chosen]
    length = shapely.length(lines)
    count = np.where(length < least * text_m, 0, np.maximum(1, np.rint(length / (spacing * text_m)))).astype(np.int64)
    line = np.repeat(np.arange(len(lines)), count)
    number = np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count)
    along = (number + 0.5) * length[line] / count[line]
    at, before, after = (
        shapely.get_coordinates(shapely.line_interpolate_point(lines[line], np.clip(along + step, 0.0, length[line])))
        for step in (0.0, -1.5 * text_m, 1.5 * text_m)
    )
    chord = after - before
    angle = np.rad2deg(np.arctan2(chord[:, 1], chord[:, 0]))
    upright = np.where(angle > 90.0, angle - 180.0, np.where(angle <= -90.0, angle + 180.0, angle))
    return LineLabels(at, upright, contours.height_m[chosen][line])
