"""Ground points that lie kilometres from the photographs: which other reading of their figures puts them there."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import FloatArray
from photogram.errors import FrameError
from photogram.geodesy.crs import plan_of
from photogram.geodesy.frames import map_from_crs
from photogram.project.control.points import ProjectControlPoint
from photogram.project.findings import Finding
from photogram.project.misplaced import other_reading
from photogram.project.project import Project
from photogram.wording import some


def _read_otherwise(
    project: Project, points: Sequence[ProjectControlPoint], gnss_map_m: FloatArray
) -> tuple[str, str] | None:
    """Return how else the figures of ground points far from all GNSS positions (F, 3) may be read to lie among these,
    and the remedy; None where no other reading puts them there. Figures are read in the CRS that
    they were given in, where that is one for all."""
    position_m = np.array([p.position_map_m for p in points])
    own = {p.crs or project.crs for p in points}
    crs = own.pop() if len(own) == 1 else project.crs
    if crs != project.crs:
        try:
            position_m, gnss_map_m = (map_from_crs(project.crs, plan_of(crs), x) for x in (position_m, gnss_map_m))
        except FrameError:
            return None  # no map grid, so no zone was mistaken for another
    reading = other_reading(crs, position_m, gnss_map_m)
    if reading is not None:
        return f"{reading[0]} they would lie among them", reading[1]
    reading = other_reading(crs, gnss_map_m, position_m)
    if reading is None:
        return None
    return f"the GNSS positions: {reading[0]} they would lie among the control points", reading[1]


def foreign_control(project: Project, points: Sequence[ProjectControlPoint], gnss_map_m: FloatArray) -> Finding | None:
    """Return the finding for ground points that lie far from all GNSS positions (F, 3); None for some of them that no
    other reading puts among these."""
    position_m = np.array([p.position_map_m for p in points])
    distance_m = float(np.min(cKDTree(gnss_map_m[:, :2]).query(position_m[:, :2])[0]))
    reading = _read_otherwise(project, points, gnss_map_m)
    every = len(points) == len(project.control_points)
    if reading is None and not every:
        return None
    text = f"they lie {distance_m / 1000:.3g} km or more from the GNSS positions of the photographs"
    remedy = "check crs, the points' own CRS, and that both are from the same site"
    if reading is not None:
        words, remedy = reading
        text += f"; {words}"
    where = "control_points" if every else f"points {some([p.name for p in points])}"
    return Finding("error", where, text, remedy)
