"""How large a survey's surface and orthophoto become, from the ground that its photographs show, and whether disk and
memory of the machine will do."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import rotation_from_gimbal
from photogram.errors import FrameError
from photogram.files.photographs.tags import PhotographTags
from photogram.measures.ground_sampling import ground_sampling_m
from photogram.project.findings import Finding
from photogram.project.measured.measured_survey import MeasuredSurvey, usable_survey
from photogram.project.project import Project
from photogram.surface.dense.pyramid import CELL_GSD, MINIMUM_RAYS, default_cell_m

SPARE = 1.5
"""How far a prediction may be off: less free disk than so many times what is predicted is warned of."""

USUAL_RAYS = 4.0
"""Photographs that show a place, taken where nothing says how high they were flown."""

_NODE_SHARE, _MOST_NODES = 1 / 40, 1000  # of the lattice on which footprints are counted: in flying heights; along it
_REACH = 2.0  # in flying heights, as far as ground is looked for that a photograph shows


# ---- size of the surface -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SurfaceSize:
    """About how many cells the dense surface and the orthophoto have, 0 where they are not made, how many ground
    sampling distances a cell of the surface is wide, and which share of the cells photographs show."""

    surface_cells: float
    orthophoto_cells: float
    cell_gsd: float
    covered_share: float = 1.0


def surface_size(project: Project, tags: Sequence[PhotographTags | None]) -> SurfaceSize:
    """Return how large surface and orthophoto become; ``tags`` are those of ``project.photographs``.

    The ground is taken as flat, and as seen by the photographs that have a position and a height above it. Where fewer
    than half of them have, USUAL_RAYS are taken to show each place, and cells of the default size.
    """
    try:
        survey = usable_survey(project, tags)
    except FrameError:
        survey = None  # the geometry's own check says so
    focal_px = np.array([project.cameras[p.camera].focal_px for p in project.photographs])
    known = np.zeros(len(focal_px), dtype=bool)
    if survey is not None:
        known = survey.positioned & np.isfinite(survey.flying_height_m)
    if survey is None or 2 * np.count_nonzero(known) < len(known):
        return _sized(project, _pixels(project) / USUAL_RAYS, None, 1.0)
    gsd_m = ground_sampling_m(survey.flying_height_m[known], focal_px[known])
    area_m2, share = _seen_area_m2(project, survey, known)
    return _sized(project, area_m2 / gsd_m**2, gsd_m, share)


def _sized(project: Project, area_gsd2: float, gsd_m: float | None, covered_share: float) -> SurfaceSize:
    """Return the size for a ground of so many squares of the ground sampling distance, itself None if not known."""
    surface_gsd, picture_gsd = CELL_GSD, 1.0
    if gsd_m is not None:
        surface_gsd = (project.surface.cell_m or default_cell_m(gsd_m)) / gsd_m
        picture_gsd = (project.orthophoto.cell_m or gsd_m) / gsd_m
    # without dense matching a surface has about as many cells as there are tie points, unless it is told otherwise
    made = project.dense.enabled or project.surface.cell_m is not None
    return SurfaceSize(
        area_gsd2 / surface_gsd**2 if made else 0.0,
        area_gsd2 / picture_gsd**2 if project.orthophoto.enabled else 0.0,
        surface_gsd,
        covered_share,
    )


def _pixels(project: Project) -> float:
    """Return how many pixels all photographs have together."""
    cameras = [project.cameras[p.camera] for p in project.photographs]
    return float(sum(camera.width_px * camera.height_px for camera in cameras))


def _seen_area_m2(project: Project, survey: MeasuredSurvey, known: BoolArray) -> tuple[float, float]:
    """Return the area of the rectangle, along the axes of the world, around all ground that MINIMUM_RAYS photographs
    show, in m², and the share of it that they show."""
    corners = np.array([_footprint_m(project, survey, i) for i in np.flatnonzero(known).tolist()])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    flying_m = float(np.median(survey.flying_height_m[known]))
    node_m = max(_NODE_SHARE * flying_m, float((high - low).max()) / _MOST_NODES)
    columns, rows = np.ceil((high - low) / node_m).astype(int) + 1
    count = np.zeros((rows, columns), np.int32)
    for corner in np.rint((corners - low) / node_m).astype(np.int32):
        first, last = corner.min(axis=0), corner.max(axis=0) + 1
        footprint = np.zeros((last - first)[::-1], np.uint8)
        cv2.fillConvexPoly(footprint, cv2.convexHull(corner - first), (1,))
        count[first[1] : last[1], first[0] : last[0]] += footprint
    row, column = np.nonzero(count >= MINIMUM_RAYS)
    if not len(row):
        return 0.0, 1.0
    nodes = (np.ptp(row) + 1) * (np.ptp(column) + 1)
    return float(np.ptp(row) * np.ptp(column)) * node_m**2, len(row) / float(nodes)


def _footprint_m(project: Project, survey: MeasuredSurvey, photograph: int) -> FloatArray:
    """Return the corners (4, 2) in the world of what a photograph shows of flat ground, straight down where its
    attitude is not known, without distortion; not further than _REACH flying heights away."""
    camera = project.cameras[project.photographs[photograph].camera]
    u, v = camera.width_px - 0.5, camera.height_px - 0.5
    corner = np.array([[-0.5, -0.5], [u, -0.5], [u, v], [-0.5, v]])
    ray = np.column_stack([(corner - camera.principal_point_px) / camera.focal_px, np.ones(4)])
    rotation = survey.rotation[photograph]
    if not np.isfinite(rotation).all():
        rotation = rotation_from_gimbal(0.0, -90.0, 0.0)
    direction = ray @ rotation.T
    plan, height_m = direction[:, :2], survey.flying_height_m[photograph]
    # what looks above the horizon ends at the reach as well
    fall = np.maximum(-direction[:, 2:], np.linalg.norm(plan, axis=1, keepdims=True) / _REACH)
    return np.asarray(survey.gnss_world_m[photograph, :2] + height_m * plan / fall)


# ---- disk and memory -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MachineNeeds:
    """About how much disk and memory a survey takes, in bytes, and what in the project lowers it."""

    disk_bytes: int
    memory_bytes: int
    disk_remedy: str
    memory_remedy: str


def gigabytes(count: int) -> str:
    """Return a number of bytes in words."""
    return f"{count / 1e9:.1f} GB" if count >= 1e8 else f"{count / 1e6:.0f} MB"


def machine_findings(
    project: Project, needs: MachineNeeds, free_disk_bytes: int | None, memory_bytes: int | None
) -> list[Finding]:
    """Return whether the disk of the working folder and the memory will do, None where they are not known."""
    findings = []
    if free_disk_bytes is not None and free_disk_bytes < SPARE * needs.disk_bytes:
        text = f"{gigabytes(free_disk_bytes)} free for {project.work}, about {gigabytes(needs.disk_bytes)} are needed"
        remedy = f"free some space, give another folder under work, or {needs.disk_remedy}"
        findings.append(Finding("warning", "disk", text, remedy))
    if memory_bytes is not None and memory_bytes < needs.memory_bytes:
        text = f"{gigabytes(memory_bytes)} of memory free, about {gigabytes(needs.memory_bytes)} are needed"
        remedy = f"{needs.memory_remedy}, or use a machine with more memory"
        findings.append(Finding("warning", "memory", text, remedy))
    return findings
