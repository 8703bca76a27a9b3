"""How large a survey's surface and orthophoto become, from the ground that its photographs show, and whether disk and
memory of the machine will do."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import shapely

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import rotation_from_gimbal
from photogram.errors import FrameError, PhotogramError
from photogram.files.maps.polygon_files import read_polygons
from photogram.files.photographs.tags import PhotographTags
from photogram.measures.ground_sampling import ground_sampling_m
from photogram.project.findings import Finding
from photogram.project.measured.measured_survey import MeasuredSurvey, usable_survey
from photogram.project.project import Project
from photogram.surface.dense.pyramid import CELL_GSD, MINIMUM_RAYS, OBLIQUE, default_cell_m
from photogram.surface.dense.resolution import COARSEST_GSD, STEEP_TANGENT

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
    sampling distances a cell of the surface is wide, which share of the cells photographs show, and the side of a cell
    of the surface in m, None where the flying height is not known."""

    surface_cells: float
    orthophoto_cells: float
    cell_gsd: float
    covered_share: float = 1.0
    cell_m: float | None = None


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
    vertical_m = ground_sampling_m(survey.flying_height_m[known], focal_px[known])
    ground = _seen_ground(project, survey, known)
    gsd_m = ground.sampling_m if ground.sampling_m > OBLIQUE * vertical_m else vertical_m
    area_m2, share = ground.mapped(COARSEST_GSD * gsd_m if project.surface.area is None else np.inf)
    if project.surface.area is not None:
        area_m2, share = _asked_m2(project, area_m2, share)
    return _sized(project, area_m2 / gsd_m**2, gsd_m, share)


def _asked_m2(project: Project, seen_m2: float, share: float) -> tuple[float, float]:
    """Return the rectangle around the area that a surface is asked for, no larger than that which photographs show, and
    which share of it is the area's, or shown; of a file that cannot be read, which its own check says, the latter."""
    assert project.surface.area is not None
    try:
        polygons = read_polygons(Path(project.surface.area), project.crs)
    except PhotogramError:
        return seen_m2, share
    area = shapely.union_all([polygon.polygon for polygon in polygons])
    around_m2 = float(area.envelope.area)
    return (around_m2, float(area.area) / around_m2) if around_m2 < seen_m2 else (seen_m2, share)


def _sized(project: Project, area_gsd2: float, gsd_m: float | None, covered_share: float) -> SurfaceSize:
    """Return the size for a ground of so many squares of the ground sampling distance, itself None if not known."""
    surface_gsd, picture_gsd = CELL_GSD, 1.0
    if gsd_m is not None:
        surface_gsd = (project.surface.cell_m or default_cell_m(gsd_m)) / gsd_m
        picture_gsd = (project.orthophoto.cell_m or gsd_m) / gsd_m
    # without dense matching a surface has about as many cells as there are tie points, unless it is told otherwise
    made = project.dense.enabled or project.surface.cell_m is not None
    apart = bool(project.epochs) and not project.epoch  # each epoch has its own, which another command makes
    return SurfaceSize(
        area_gsd2 / surface_gsd**2 if made and not apart else 0.0,
        area_gsd2 / picture_gsd**2 if project.orthophoto.enabled and not apart else 0.0,
        surface_gsd,
        covered_share,
        None if gsd_m is None else surface_gsd * gsd_m,
    )


def _pixels(project: Project) -> float:
    """Return how many pixels all photographs have together."""
    cameras = [project.cameras[p.camera] for p in project.photographs]
    return float(sum(camera.width_px * camera.height_px for camera in cameras))


@dataclass(frozen=True, eq=False)
class _SeenGround:
    """Level ground on a lattice (rows, columns) along the axes of the world, ``node_m`` apart: the side of a pixel in
    the photographs that resolve each node best (most, rows, columns), in ascending order, infinite where no more see
    it, how many ``pixels`` show it, and in how many photographs it is seen by STEEP_TANGENT or steeper."""

    node_m: float
    finest_m: FloatArray
    pixels: FloatArray
    steep: IntArray

    @property
    def sampling_m(self) -> float:
        """Return what the photographs that are matched resolve, the median over their pixels; 0 without any."""
        known = np.isfinite(self.finest_m)
        if not known.any():
            return 0.0
        value, weight = self.finest_m[known], np.broadcast_to(self.pixels, self.finest_m.shape)[known]
        order = np.argsort(value)
        reached = np.cumsum(weight[order])
        return float(value[order][np.searchsorted(reached, reached[-1] / 2.0)])

    def mapped(self, coarsest_m: float) -> tuple[float, float]:
        """Return the area of the rectangle around all ground that MINIMUM_RAYS photographs show, steeply or at
        ``coarsest_m`` or better, in m², and the share of it that they show so."""
        resolved = np.isfinite(self.finest_m[MINIMUM_RAYS - 1]) & (self.finest_m[MINIMUM_RAYS - 1] <= coarsest_m)
        row, column = np.nonzero(resolved | (self.steep >= MINIMUM_RAYS))
        if not len(row):
            return 0.0, 1.0
        nodes = (np.ptp(row) + 1) * (np.ptp(column) + 1)
        return float(np.ptp(row) * np.ptp(column)) * self.node_m**2, len(row) / float(nodes)


def _seen_ground(project: Project, survey: MeasuredSurvey, known: BoolArray) -> _SeenGround:
    """Return the level ground that photographs show, those that are ``known`` to be over it."""
    numbers = np.flatnonzero(known).tolist()
    corners = np.array([_footprint_m(project, survey, i) for i in numbers])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    flying_m = float(np.median(survey.flying_height_m[known]))
    node_m = max(_NODE_SHARE * flying_m, float((high - low).max()) / _MOST_NODES)
    columns, rows = np.ceil((high - low) / node_m).astype(int) + 1
    finest = np.full((max(MINIMUM_RAYS, project.dense.photographs), rows, columns), np.inf)
    pixels, steep = np.zeros((rows, columns)), np.zeros((rows, columns), np.int64)
    for number, corner in zip(numbers, np.rint((corners - low) / node_m).astype(np.int32), strict=True):
        first, last = corner.min(axis=0), corner.max(axis=0) + 1
        footprint = np.zeros((last - first)[::-1], np.uint8)
        cv2.fillConvexPoly(footprint, cv2.convexHull(corner - first), (1,))
        row, column = np.nonzero(footprint)
        plan = low + node_m * (np.column_stack([column, row]) + first) - survey.gnss_world_m[number, :2]
        height_m = survey.flying_height_m[number]
        axis = _rotation(survey, number)[:, 2]
        depth_m = np.maximum(plan @ axis[:2] - height_m * axis[2], 1e-6)
        focal_px = project.cameras[project.photographs[number].camera].focal_px
        pixel_m = np.sqrt(depth_m**3 / height_m) / focal_px
        at = row + first[1], column + first[0]
        pixels[at] += 1.0 / pixel_m**2
        steep[at] += np.hypot(*plan.T) <= STEEP_TANGENT * height_m
        for best in finest:
            best[at], pixel_m = np.minimum(best[at], pixel_m), np.maximum(best[at], pixel_m)
    return _SeenGround(node_m, finest, pixels, steep)


def _rotation(survey: MeasuredSurvey, photograph: int) -> FloatArray:
    """Return the rotation (3, 3) of a photograph, straight down where its attitude is not known."""
    rotation = survey.rotation[photograph]
    return rotation if np.isfinite(rotation).all() else rotation_from_gimbal(0.0, -90.0, 0.0)


def _footprint_m(project: Project, survey: MeasuredSurvey, photograph: int) -> FloatArray:
    """Return the corners (4, 2) in the world of what a photograph shows of flat ground, straight down where its
    attitude is not known, without distortion; not further than _REACH flying heights away."""
    camera = project.cameras[project.photographs[photograph].camera]
    u, v = camera.width_px - 0.5, camera.height_px - 0.5
    corner = np.array([[-0.5, -0.5], [u, -0.5], [u, v], [-0.5, v]])
    ray = np.column_stack([(corner - camera.principal_point_px) / camera.focal_px, np.ones(4)])
    direction = ray @ _rotation(survey, photograph).T
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
