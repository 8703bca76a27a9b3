"""What a survey asks of the disk and the memory, known before the work from project and tags.

Key points by their number, the dense surface and the orthophoto by the ground that the photographs show and the cells
it is cut into. The bytes of a cell are those of the files' own layout where nothing compresses them, else measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from photogram.arrays import FloatArray
from photogram.camera import Camera, rotation_from_gimbal
from photogram.errors import FrameError
from photogram.files.photographs.tags import PhotographTags
from photogram.measures.ground_sampling import ground_sampling_m
from photogram.project.findings import Finding
from photogram.project.measured.measured_survey import MeasuredSurvey, usable_survey
from photogram.project.project import Project
from photogram.project.schema import REDUCTIONS
from photogram.sfm.tie_points.features import picture_scale
from photogram.surface.contours import MAXIMUM_CELLS as CONTOURED_CELLS
from photogram.surface.dense.pyramid import CELL_GSD, MINIMUM_RAYS, MOST_LEVELS, default_cell_m, reductions_of
from photogram.surface.ortho.orthophoto import HELD_BYTES, LEAST_HELD
from photogram.surface.ortho.seamlines import LARGEST_LATTICE, SMALLEST_BLOCK

BYTES_PER_KEY_POINT = 163
"""On disk and in memory: pixel 16, size and angle 16, descriptor 128, colour 3."""

BYTES_PER_OBSERVATION = 350
"""Of the adjustment in memory: two rows of 17 derivatives, residual, weight and indices; a third of the key points
becomes an observation."""

BYTES_PER_PX = 12
"""Of a photograph in memory: its colours, its grey values, and a copy of each at work."""

BYTES_PER_TILE_PX = 240
"""Of the search for key points in one tile (OpenCV's SIFT, whose scale space is twice as wide and high), measured on
tiles of 800 and of 1728 px."""

AT_ONCE = 0.7
"""Share of the workers that hold the most at the same time while key points are looked for."""

MATCHED_BYTES, COARSER_BYTES, LAYER_BYTES = 14.0, 22.0, 27.0
"""On disk for a cell of the surface: what the matching writes of it, and of one of a coarser level, and what the
surface is made of."""

RASTER_BYTES, RELIEF_BYTES, POINT_BYTES = 11.0, 4.0, 6.0
"""On disk for a cell of the surface, compressed: the rasters of the DSM, terrain or contour lines, and its point in the
dense cloud. Measured on two real surveys and a simulated one: 5 to 8 (and, on the latter,
3 for the relative standard deviations), 1 to 3 (contour lines), and 5."""

PICTURE_BYTES, SCRATCH_BYTES, CLOSED_BYTES = 2.9, 4.0, 16.0
"""On disk for a cell of the orthophoto: compressed, measured at 1.1 to 2.9, and before that; and for a cell of the
surface while it is closed for it: heights and standard deviations, before and after."""

PROGRAM_BYTES = 540e6
"""In memory for the program with its libraries and kernels, before it does anything."""

MATCHING_BYTES, TILE_BYTES, LATTICE_BYTES = 200e6, 190e6, 600.0
"""In memory for one worker that matches heights, or makes tiles of the orthophoto, the photographs apart, measured at
150 to 200 and at 170 to 190 MB; and for a block of the lattice of seams, candidates with their costs, grey
values and messages, counted."""

TERRAIN_BYTES, CONTOUR_BYTES, REPORT_BYTES = 30.0, 70.0, 54.0
"""In memory for a cell of the surface: of the terrain model, of the contour lines for a cell that is contoured, of the
report. Measured on seven million cells, lines included; the report holds the relative standard deviations besides."""

LIBRARIES_BYTES, FIGURES_BYTES = 50e6, 140e6
"""In memory for GTSAM, GDAL and compiled kernels once they are loaded, and for figures."""

MATCHED_CELL_BYTES = 1200.0
"""The same for a cell, where all cells together are fewer than those of a block."""

PAIR_BYTES = 4800.0
"""In memory for a key point of two photographs that are compared: descriptors as floats, and 1024 rows of products."""

ALLOCATED_SHARE = 0.8
"""Of what a stage held at its peak in small pieces, the share that stays with the process; measured on a survey of 18
photographs at 0.79 to 0.82."""

MATCH_BYTES, TIE_POINT_BYTES, ADJUSTED_BYTES = 10.0, 25.0, 65.0
"""On disk for a key point: what matching, tie points and the adjustment write; measured at half of it over a beach, and
at twice over ground with texture everywhere and much overlap."""

REPORT_DISK_BYTES = 14e6
"""On disk for the report, its figures and pictures."""

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


def _seen_area_m2(project: Project, survey: MeasuredSurvey, known: NDArray[np.bool_]) -> tuple[float, float]:
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
        shown = np.zeros((last - first)[::-1], np.uint8)
        cv2.fillConvexPoly(shown, cv2.convexHull(corner - first), (1,))
        count[first[1] : last[1], first[0] : last[0]] += shown
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


def sparse_disk_bytes(project: Project) -> float:
    """Return about how much key points, matches and clouds of tie points take on disk."""
    return len(project.photographs) * project.features.maximum * BYTES_PER_KEY_POINT * 1.5


def surface_disk_bytes(project: Project, size: SurfaceSize) -> float:
    """Return about how much surface and orthophoto of a ``size`` take on disk, in the working folder and among the
    results, when they take most: while heights are matched, while the orthophoto is made, or in the end."""
    dense, cells, picture = project.dense.enabled, size.surface_cells, size.orthophoto_cells
    rasters = cells * (RASTER_BYTES + RELIEF_BYTES * (project.terrain.enabled + project.contours.enabled))
    matching = cells * _matched_bytes(project, size) + _reduced_bytes(project, size) if dense else 0.0
    made = rasters + picture * PICTURE_BYTES + (cells * (_matched_bytes(project, size) + LAYER_BYTES) if dense else 0.0)
    results = rasters + picture * PICTURE_BYTES + (cells * POINT_BYTES if dense else 0.0)
    closing = cells * CLOSED_BYTES if project.orthophoto.enabled else 0.0
    return float(max(matching, made + picture * SCRATCH_BYTES + closing, made + results))


def _shorter_px(project: Project) -> int:
    """Return the shorter side of the smallest photograph."""
    return min(min(camera.width_px, camera.height_px) for camera in project.cameras)


def _matched_bytes(project: Project, size: SurfaceSize) -> float:
    """Return what matching leaves of a cell of the surface, with those of coarser levels that cover it."""
    _, coarser = reductions_of(size.cell_gsd, _shorter_px(project))
    return MATCHED_BYTES + COARSER_BYTES * sum(0.25**level for level in range(1, coarser + 1))


def _reduced_bytes(project: Project, size: SurfaceSize) -> float:
    """Return what the pictures take in which heights are matched: a byte for a pixel of the photograph itself, two for
    one of those that are reduced, as many as there are levels at most."""
    finest, _ = reductions_of(size.cell_gsd, _shorter_px(project))
    reduced = sum(2.0 / 4**step for step in range(max(finest, 1), finest + MOST_LEVELS))
    return _pixels(project) * float(reduced + (finest == 0))


def kept_disk_bytes(project: Project, size: SurfaceSize) -> dict[str, float]:
    """Return about how much the stages leave on disk, in the working folder and, the stage `results`, beside it."""
    dense, cells, picture = project.dense.enabled, size.surface_cells, size.orthophoto_cells
    key_points = len(project.photographs) * project.features.maximum
    relief = RELIEF_BYTES * (project.terrain.enabled + project.contours.enabled)
    shown = picture * size.covered_share
    kept = {
        "features": BYTES_PER_KEY_POINT * key_points,
        "matches": MATCH_BYTES * key_points,
        "tie_points": TIE_POINT_BYTES * key_points,
        "transfer": TIE_POINT_BYTES * key_points,
        "adjustment": ADJUSTED_BYTES * key_points,
        "dense": cells * _matched_bytes(project, size) if dense else 0.0,
        "surface": cells * (RASTER_BYTES + LAYER_BYTES * dense),
        "relief": cells * relief,
        "orthophoto": shown * PICTURE_BYTES,
    }
    copied = kept["relief"] + kept["orthophoto"] + cells * (RASTER_BYTES + POINT_BYTES * dense)
    return {**kept, "results": copied + REPORT_DISK_BYTES + 2.0 * ADJUSTED_BYTES * key_points}


def _tile_px(project: Project, camera: Camera) -> float:
    """Return how many pixels the largest tile has in which key points of a photograph are looked for."""
    features = project.features
    scale = picture_scale(camera.width_px * camera.height_px, features, REDUCTIONS[project.quality])
    sides = [side / scale for side in (camera.width_px, camera.height_px)]
    tiles = [max(1.0, np.ceil(side / features.tile_px)) for side in sides]
    beyond = [features.overlap_px * min(count - 1.0, 2.0) for count in tiles]
    return float(np.prod([side / count + more for side, count, more in zip(sides, tiles, beyond, strict=True)]))


def stage_memory_bytes(project: Project, size: SurfaceSize, workers: int) -> dict[str, tuple[float, str]]:
    """Return about the most that the process holds in each stage, in bytes, the program included, and what lowers it.

    What a stage takes in small pieces stays with the process (ALLOCATED_SHARE of it) and serves the next stages; whole
    rasters come on top of that and are given back.
    """
    fewer, coarser = "lower features.maximum or quality", "choose a larger surface.cell_m"
    largest_px = max(c.width_px * c.height_px for c in project.cameras)
    one = max(
        BYTES_PER_PX * c.width_px * c.height_px + BYTES_PER_TILE_PX * _tile_px(project, c) for c in project.cameras
    )
    key_points = len(project.photographs) * project.features.maximum
    block = key_points * (BYTES_PER_KEY_POINT + BYTES_PER_OBSERVATION / 3)
    cells, dense = size.surface_cells, project.dense.enabled
    contoured = cells / np.ceil(np.sqrt(max(cells, 1.0) / CONTOURED_CELLS)) ** 2  # blocks of cells beyond that
    relief = cells * max(
        TERRAIN_BYTES * project.terrain.enabled,
        (4.0 + CONTOUR_BYTES * contoured / max(cells, 1.0)) * project.contours.enabled,
    )
    held = min(3.0 * len(project.photographs) * largest_px, max(3.0 * LEAST_HELD * largest_px, HELD_BYTES))
    lattice = LATTICE_BYTES * min(size.orthophoto_cells / SMALLEST_BLOCK**2, LARGEST_LATTICE)
    matching = min(workers * MATCHING_BYTES, MATCHED_CELL_BYTES * cells) + BYTES_PER_PX * workers * largest_px
    tiles = min(workers * TILE_BYTES, MATCHED_CELL_BYTES * (size.orthophoto_cells + cells))
    report = REPORT_BYTES * cells * dense
    orthophoto = (4.0 * cells + lattice + held + tiles) * project.orthophoto.enabled
    pieces_and_rasters: dict[str, tuple[float, float, str]] = {
        "photographs": (3.0 * workers * largest_px, 0.0, fewer),
        "features": (one * max(1.0, AT_ONCE * workers), 0.0, fewer),
        "pairs": (0.0, 0.0, fewer),
        "matches": (PAIR_BYTES * workers * project.features.maximum, 0.0, fewer),
        "tie_points": (block, 0.0, fewer),
        "orientation": (LIBRARIES_BYTES + block, 0.0, fewer),
        "transfer": (LIBRARIES_BYTES + block + 4.0 * workers * largest_px, 0.0, fewer),
        "intersection": (0.0, 0.0, fewer),
        "adjustment": (LIBRARIES_BYTES + block, 0.0, fewer),
        "dense": (LIBRARIES_BYTES + matching * dense, 0.0, "set dense.enabled to false"),
        "surface": (LIBRARIES_BYTES + tiles * dense, 0.0, coarser),
        "relief": (LIBRARIES_BYTES, relief, coarser),
        "orthophoto": (LIBRARIES_BYTES + orthophoto, 0.0, "set orthophoto.enabled to false"),
        "comparison": (0.0, 0.0, fewer),
        "results": (LIBRARIES_BYTES + FIGURES_BYTES, report, coarser),
    }
    found, stays, lower = dict[str, tuple[float, str]](), 0.0, fewer
    for stage, (pieces, rasters, remedy) in pieces_and_rasters.items():
        taken = max(pieces, stays + rasters)
        lower = remedy if max(pieces, rasters) > stays else lower
        found[stage] = (PROGRAM_BYTES + taken, lower)
        stays = max(stays, ALLOCATED_SHARE * taken)
    return found


@dataclass(frozen=True)
class MachineNeeds:
    """About how much disk and memory a survey takes, in bytes, and what in the project lowers it."""

    disk_bytes: int
    memory_bytes: int
    disk_remedy: str
    memory_remedy: str


def machine_needs(project: Project, tags: Sequence[PhotographTags | None], workers: int = 1) -> MachineNeeds:
    """Return what the survey needs of a machine on which ``workers`` threads work at once; ``tags`` are those of
    ``project.photographs``."""
    size = surface_size(project, tags)
    sparse, surface = sparse_disk_bytes(project), surface_disk_bytes(project, size)
    memory, remedy = max(stage_memory_bytes(project, size, workers).values())
    coarser = "choose a larger surface.cell_m or orthophoto.cell_m"
    lower = coarser if surface > sparse else "lower features.maximum"
    disk = max(sparse + surface, sum(kept_disk_bytes(project, size).values()))
    return MachineNeeds(int(disk), int(memory), lower, remedy)


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
