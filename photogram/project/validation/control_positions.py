"""Positions of control points that cannot be theirs: one position of several points, and those of the cameras."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from photogram.project.control.points import ProjectControlPoint
from photogram.project.findings import Finding
from photogram.project.measured.measured_survey import MeasuredSurvey
from photogram.project.project import Project
from photogram.wording import some

FEWEST = 3
"""Positions that place a survey, and cameras among control points from which these are no ground points."""

SAME_M = 1e-4
AT_THE_CENTRE = 0.02
"""Of the diagonal of a picture, within which a mark is at its centre."""

NEAR_CAMERA = 0.2
"""Of the flying height, within which a point lies at a camera; less than its sigmas only where these are worse."""


def _where(points: Sequence[ProjectControlPoint]) -> str:
    """Return the points by their names, and the file and line of the first."""
    names = f"{'points' if len(points) > 1 else 'point'} {some([p.name for p in points])}"
    return f"{points[0].line}: {names}" if points[0].line else names


def shared_positions(points: Sequence[ProjectControlPoint]) -> list[Finding]:
    """Return the points that have one position; an error where three or more have, and fewer than three are left."""
    places: defaultdict[tuple[int, ...], list[ProjectControlPoint]] = defaultdict(list)
    for point in points:
        if np.isfinite(point.position_map_m).all():
            places[tuple(np.round(point.position_map_m / SAME_M).astype(np.int64).tolist())].append(point)
    findings = []
    for own in places.values():
        if len(own) > 1:
            figures = ", ".join(f"{x:.3f}" for x in own[0].position_map_m)
            text = f"{len(own)} points of different names have one position, {figures}"
            remedy = "give each the coordinates of its own, or its marks to one name"
            is_all = len(own) >= FEWEST > len(places)
            findings.append(Finding("error" if is_all else "warning", _where(own), text, remedy))
    return findings


def _is_camera(point: ProjectControlPoint, project: Project, survey: MeasuredSurvey) -> bool:
    """Return whether a point is marked once, at the centre of the photograph at whose position it lies, if that has
    one."""
    if len(point.mark_photograph) != 1 or not np.isfinite(point.position_map_m).all():
        return False
    i = int(point.mark_photograph[0])
    camera = project.cameras[project.photographs[i].camera]
    size_px = np.array([camera.width_px, camera.height_px])
    if np.linalg.norm(point.mark_pixel[0] - (size_px - 1.0) / 2.0) > AT_THE_CENTRE * np.linalg.norm(size_px):
        return False
    if not survey.positioned[i]:
        return True
    apart = np.abs(point.position_map_m - survey.gnss_map_m[i])
    sigma_m = 4.0 * np.hypot(survey.gnss_sigma_m[i], project.gnss_offset_sigma_m)
    near_m = NEAR_CAMERA * float(np.nan_to_num(survey.flying_height_m[i]))
    return bool(np.all(apart <= np.maximum(np.nan_to_num(sigma_m), near_m)))


def cameras_as_control(project: Project, survey: MeasuredSurvey) -> list[Finding]:
    """Return the points that are the positions of photographs; an error where they are most of the points."""
    points = [p for p in project.control_points if p.role == "control"]
    cameras = [p for p in points if _is_camera(p, project, survey)]
    if len(cameras) < FEWEST or 2 * len(cameras) <= len(points):
        return []
    text = f"{len(cameras)} of {len(points)} control points are positions of cameras: each is marked once, at the "
    text += "centre of the photograph that was taken there"
    remedy = "give them under photographs.positions, and points on the ground as control_points"
    return [Finding("error", _where(cameras), text, remedy)]


def control_position_findings(project: Project, survey: MeasuredSurvey | None) -> list[Finding]:
    """Return everything that this module finds."""
    cameras = [] if survey is None else cameras_as_control(project, survey)
    return [*shared_positions(project.control_points), *cameras]
