"""The photographs of a survey as its project and tags place and turn them over level ground."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera
from photogram.desk.coverage.overlaps import track_directions
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.frames import LocalFrame
from photogram.gnss import Solution
from photogram.marking.ground_level import levelled
from photogram.marking.tagged_block import ground_level_m, tagged_block
from photogram.project.measured.measured_positions import solution_of
from photogram.project.measured.measured_survey import tagged_survey, usable_positions
from photogram.project.project import Project
from photogram.survey import Block, ControlPoints


@dataclass(frozen=True, eq=False)
class TaggedFlight:
    """Photographs (F,) that have a position, in the order of their exposures where all have a time.

    ``rotation`` (F, 3, 3) world from camera, straight down along the track where ``turned`` (F,) says that nothing
    tells it; ``centre_world_m`` (F, 3); ``ground_world_m`` the height of the ground, by ground points or, where
    ``ground_by_tags``, by the heights above take-off. ``unplaced`` counts the photographs without a position. ``block``
    has these photographs with their poses, and ground points without marks.
    """

    frame: LocalFrame
    cameras: tuple[Camera, ...]
    camera: IntArray
    name: tuple[str, ...]
    flight: tuple[str, ...]
    rotation: FloatArray
    turned: BoolArray
    centre_world_m: FloatArray
    solution: tuple[Solution, ...]
    ground_world_m: float | None
    ground_by_tags: bool
    unplaced: int
    block: Block

    @property
    def height_m(self) -> FloatArray:
        """Return the heights (F,) above the ground, NaN where its height is not known."""
        level = np.nan if self.ground_world_m is None else self.ground_world_m
        return np.asarray(self.centre_world_m[:, 2] - level)


def tagged_flight(project: Project, tags: Sequence[PhotographTags | None]) -> TaggedFlight | None:
    """Return the photographs as project and ``tags`` have them, None where none has a position. Raises FrameError where
    positions lie outside the CRS."""
    block = tagged_survey(project, tags, usable_positions(project, tags))
    placed = [] if block is None else [i for i, p in enumerate(block.photographs) if p.gnss_world_m is not None]
    if block is None or not placed:
        return None
    if all(block.photographs[i].time_s is not None for i in placed):
        placed.sort(key=lambda i: (block.photographs[i].flight, block.photographs[i].time_s))
    photographs = [block.photographs[i] for i in placed]
    turned = np.array([p.attitude_world_from_camera is not None for p in photographs], dtype=bool)
    place = np.array([p.gnss_world_m for p in photographs], dtype=np.float64)
    flight = tuple(p.flight for p in photographs)
    track = track_directions(place, flight)
    photographs = [
        p if known else replace(p, attitude_world_from_camera=_down(track[k]), attitude_sigma_rad=np.pi)
        for k, (p, known) in enumerate(zip(photographs, turned.tolist(), strict=True))
    ]
    points = _unmarked(block.control_points)
    surveyed = points.position_world_m[np.isfinite(points.position_world_m).all(axis=1)]
    bare = replace(
        block,
        photographs=tuple(photographs),
        poses=(None,) * len(photographs),
        control_points=points,
        rigs=(),
        constraints=(),
    )
    posed = levelled(tagged_block(bare))
    poses = [pose for pose in posed.poses if pose is not None]
    return TaggedFlight(
        block.frame,
        block.cameras,
        np.array([p.camera for p in photographs], dtype=np.int64),
        tuple(p.name for p in photographs),
        flight,
        np.array([pose.rotation_world_from_camera for pose in poses]),
        turned,
        _centres(posed),
        tuple(solution_of(project.photographs[i], tags[i]) for i in placed),
        ground_level_m(posed, surveyed),
        not len(surveyed),
        len(block.photographs) - len(placed),
        posed,
    )


def _unmarked(points: ControlPoints) -> ControlPoints:
    none = np.zeros(0, dtype=np.int64)
    return replace(
        points,
        mark_photograph=none,
        mark_point=none,
        mark_pixel=np.zeros((0, 2)),
        mark_covariance_px2=np.zeros((0, 2, 2)),
    )


def _centres(block: Block) -> FloatArray:
    """Return the projection centres (F, 3), less the lever arms of antennas."""
    pairs = zip(block.photographs, block.poses, strict=True)
    centres = [p.measured_centre_world_m(pose.rotation_world_from_camera) for p, pose in pairs if pose is not None]
    return np.array(centres, dtype=np.float64)


def _down(track: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) of a camera that looks straight down, its top along a direction (2,) in plan."""
    forward = track if np.isfinite(track).all() else np.array([0.0, 1.0])
    right = np.array([forward[1], -forward[0], 0.0])
    return np.column_stack([right, [-forward[0], -forward[1], 0.0], [0.0, 0.0, -1.0]])
