"""The block that another program has adjusted: its measurements, and its own result as the start."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.self_calibration import with_priors
from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Pose, Similarity
from photogram.errors import AdjustmentError, ExchangeError, FrameError, OrientationError
from photogram.exchange.draft import freed
from photogram.files.solutions.solution import ForeignSolution
from photogram.geodesy.crs import NO_CRS, is_geographic, metric_only
from photogram.geodesy.frames import (
    LocalFrame,
    geodetic_from_geocentric,
    geodetic_from_topocentric,
    map_from_crs,
    map_from_geodetic,
)
from photogram.project.draft.positions import AUTONOMOUS_M
from photogram.project.draft.sites import utm_crs
from photogram.project.project import in_world
from photogram.sfm.georeference import georeference
from photogram.sfm.marked_points import with_marks_as_tie_points
from photogram.sfm.orientation import OrientationSettings
from photogram.sfm.reconstruction import Structure
from photogram.sfm.similarity import fit_similarity
from photogram.survey import Block, ControlPoints, Photograph
from photogram.wording import shortened

NOBODY = ControlPoints(
    (),
    (),
    np.zeros((0, 3)),
    np.zeros((0, 3)),
    *(np.zeros(0, dtype=np.int64),) * 2,
    np.zeros((0, 2)),
    np.zeros((0, 2, 2)),
)


@dataclass(frozen=True, eq=False)
class ForeignBlock:
    """A foreign solution as a block in a frame of its own."""

    block: Block
    """Measurements, with poses and tie points to start from; interior orientations are theirs, free to move within wide
    priors."""
    theirs: Block
    """The same with poses and tie points as the program left them."""
    is_placed: bool
    """Whether the files say where the solution lies, so that its poses can be compared as they are; otherwise it was
    brought to its control points or positions by a similarity, or lies nowhere."""
    parameters: tuple[FloatArray, ...] = ()
    """Interior orientation (12,) of each camera to start from, where it is not theirs."""


def foreign_block(solution: ForeignSolution, crs: str | None = None) -> ForeignBlock:
    """Return the block of a foreign solution.

    ``crs`` is that of its ground points and measured positions, in place of what the files say. Raises ExchangeError
    where nothing was oriented or observed, the coordinates do not fit the CRS, or do not determine where the
    solution lies.
    """
    if all(photograph.pose is None for photograph in solution.photographs):
        raise ExchangeError(f"{solution.program}: no photograph is oriented, so there is no solution to audit")
    marks = 0 if solution.ground_points is None else len(solution.ground_points.mark_point)
    if not len(solution.tie_points.point) and not marks:
        raise ExchangeError(
            f"{solution.program}: the solution holds {solution.contents}, so there is nothing to adjust again: "
            "photogram import starts a project from its poses"
        )
    try:
        return _placed(_measured(solution, crs or solution.crs), solution)
    except FrameError as error:
        raise _no_crs(solution, error) from error
    except OrientationError as error:
        raise ExchangeError(f"{solution.program}: {error}") from error


def with_their_model(start: ForeignBlock, solution: ForeignSolution) -> Block:
    """Return the block as the program adjusted it, as far as its files say it: what it held of interior orientations
    is held where they are, and marks of check points that it used are tie points."""
    block, stated = start.block, solution.stated
    if stated.held is not None:
        block = replace(
            block,
            cameras=tuple(
                replace(camera, sigmas=np.where(fixed, 0.0, camera.sigmas))
                for camera, fixed in zip(block.cameras, stated.held, strict=True)
            ),
        )
    if not stated.uses_check_marks:
        return block
    return with_marks_as_tie_points(block, np.asarray(~block.control_points.controlled.any(axis=1)))


def map_points(solution: ForeignSolution, crs: str | None) -> tuple[str | None, FloatArray]:
    """Return the map of a solution and its ground points (G, 3) in it, NaN for those without a survey."""
    try:
        crs, _, ground = _map_points(solution, crs)
    except FrameError as error:
        raise _no_crs(solution, error) from error
    return crs, ground


def _no_crs(solution: ForeignSolution, error: FrameError) -> ExchangeError:
    return ExchangeError(f"{solution.program}: {error}: give the CRS of the coordinates with --crs")


def _map_points(solution: ForeignSolution, crs: str | None) -> tuple[str | None, FloatArray, FloatArray]:
    """Return the map and, in it, the measured positions (F, 3) and the ground points (G, 3), NaN where unknown."""
    nowhere = np.full(3, np.nan)
    measured = np.array([nowhere if p.measured is None else p.measured for p in solution.photographs]).reshape(-1, 3)
    ground = (solution.ground_points or NOBODY).position_world_m
    known = np.concatenate([measured, ground])
    known = known[np.isfinite(known).all(axis=1)]
    if crs is None or not len(known) or not is_geographic(crs):
        return crs, measured, ground
    largest = np.abs(known[:, :2]).max(axis=0)
    if largest[0] > 360.0 or largest[1] > 90.0:
        raise FrameError(
            f"crs: {shortened(crs)} has longitude and latitude, the coordinates reach {largest[0]:.6g} and "
            f"{largest[1]:.6g}"
        )
    zone = utm_crs(float(np.median(known[:, 0])), float(np.median(known[:, 1])))
    return zone, _through(crs, zone, measured), _through(crs, zone, ground)


def _through(source: str, target: str, points: FloatArray) -> FloatArray:
    moved, known = np.full(points.shape, np.nan), np.isfinite(points).all(axis=1)
    if known.any():
        moved[known] = map_from_crs(source, target, points[known])
    return moved


def _frame(crs: str | None, known: FloatArray, solution: ForeignSolution) -> LocalFrame:
    if len(known) and crs is not None:
        metric_only(crs)
        return LocalFrame.near(crs, known)
    if len(known):
        middle = np.round(known.mean(axis=0), -1)
        return LocalFrame(NO_CRS, (float(middle[0]), float(middle[1]), float(middle[2])), "grid")
    if solution.frame in ("topocentric", "geocentric"):
        geodetic = _geodetic(solution, _centres(solution))
        zone = utm_crs(float(np.median(geodetic[:, 0])), float(np.median(geodetic[:, 1])))
        return LocalFrame.near(zone, map_from_geodetic(zone, geodetic))
    return LocalFrame.local()


def _centres(solution: ForeignSolution) -> FloatArray:
    return np.array([p.pose.position_world_m for p in solution.photographs if p.pose is not None]).reshape(-1, 3)


def _geodetic(solution: ForeignSolution, points: FloatArray) -> FloatArray:
    """Return longitude, latitude and height (N, 3) of points (N, 3) of a topocentric or geocentric solution."""
    if solution.origin_lla is not None:
        return geodetic_from_topocentric(solution.origin_lla, points)
    return geodetic_from_geocentric(points)


def _measured(solution: ForeignSolution, crs: str | None) -> Block:
    """Return what was measured, in the frame of it, with the poses as the files have them."""
    crs, measured, ground = _map_points(solution, crs)
    known = np.concatenate([measured, ground])
    frame = _frame(crs, known[np.isfinite(known).all(axis=1)], solution)
    photographs = []
    for photograph, position in zip(solution.photographs, measured, strict=True):
        there = bool(np.isfinite(position).all())
        stated = photograph.measured_sigma_m is not None and bool(np.all(np.isfinite(photograph.measured_sigma_m)))
        sigma = photograph.measured_sigma_m if stated else np.array(AUTONOMOUS_M)
        photographs.append(
            Photograph(
                photograph.name,
                photograph.camera,
                gnss_world_m=frame.world_from_map(position[None])[0] if there else None,
                gnss_sigma_m=sigma if there else None,
                gnss_sigma_assumed=there and not stated,
            )
        )
    points = solution.ground_points or NOBODY
    ground_world_m = in_world(frame, ground)
    surveyed: BoolArray = np.asarray(np.isfinite(ground_world_m).all(axis=1))
    ties = solution.tie_points
    stated_px = solution.stated_tie_sigma_px
    if stated_px is not None:
        ties = replace(ties, sigma_px=np.full(len(ties.sigma_px), stated_px))
    return Block(
        frame,
        tuple(with_priors(freed(camera)) for camera in solution.cameras),
        tuple(photographs),
        tuple(photograph.pose for photograph in solution.photographs),
        ties.select(ties.rays >= 2),
        replace(points, position_world_m=ground_world_m).select(surveyed),
    )


def _placed(block: Block, solution: ForeignSolution) -> ForeignBlock:
    """Bring poses and tie points from the solution's coordinates to the frame of the block."""
    if solution.frame in ("topocentric", "geocentric") and not block.frame.is_local:
        centres = _centres(solution)
        reach = max(float(np.ptp(centres, axis=0).max()), 100.0)
        corners = centres.mean(axis=0) + reach * np.array(
            [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64
        )
        there = block.frame.world_from_map(map_from_geodetic(block.frame.crs, _geodetic(solution, corners)))
        return _as_it_is(moved_by(fit_similarity(corners, there), block), is_placed=True)
    if solution.frame == "map":
        poses = tuple(None if pose is None else _from_map(block.frame, pose) for pose in block.poses)
        ties = replace(block.tie_points, position_world_m=in_world(block.frame, block.tie_points.position_world_m))
        return _as_it_is(replace(block, poses=poses, tie_points=ties), is_placed=True)
    if block.is_free:
        return _as_it_is(block, is_placed=False)
    structure = Structure.oriented(block.tie_points, block.cameras, block.camera_of, OrientationSettings(), block.poses)
    try:
        fit = georeference(structure, block)
    except OrientationError:
        # control points that are wrong have bent the block, until it agrees with none of them: tie points straighten it
        unbent = _by_tie_points(block)
        poses, parameters = unbent.poses, tuple(camera.parameters for camera in unbent.cameras)
        structure = Structure.oriented(
            block.tie_points, unbent.cameras, block.camera_of, OrientationSettings(), unbent.poses
        )
        start = replace(block, poses=poses)
        start = moved_by(georeference(structure, start), start)
        theirs = moved_by(similarity_of_poses(block.poses, start.poses), block)
        return ForeignBlock(start, theirs, is_placed=False, parameters=parameters)
    return _as_it_is(moved_by(fit, block), is_placed=False)


def _as_it_is(block: Block, *, is_placed: bool) -> ForeignBlock:
    return ForeignBlock(block, block, is_placed)


def similarity_of_poses(source: Sequence[Pose | None], target: Sequence[Pose | None]) -> Similarity:
    """Return the similarity that takes the projection centres of photographs to those of others, where both are known.

    Raises OrientationError where they lie in one line.
    """
    pairs = zip(source, target, strict=True)
    both = [(a.position_world_m, b.position_world_m) for a, b in pairs if a is not None and b is not None]
    centres = np.array(both).reshape(-1, 2, 3)
    return fit_similarity(centres[:, 0], centres[:, 1])


def _by_tie_points(block: Block) -> Block:
    """Return the block adjusted as a free network."""
    photographs = tuple(replace(p, gnss_world_m=None, gnss_sigma_m=None) for p in block.photographs)
    free = replace(block, frame=LocalFrame.local(), photographs=photographs, control_points=NOBODY)
    try:
        return adjust(free, AdjustmentSettings(estimate_sigmas=False)).block
    except AdjustmentError as error:
        raise OrientationError(str(error)) from error


def _from_map(frame: LocalFrame, pose: Pose) -> Pose:
    position = frame.world_from_map(pose.position_world_m[None])[0]
    return Pose(frame.rotation_world_from_map(position) @ pose.rotation_world_from_camera, position)


def moved_by(fit: Similarity, block: Block) -> Block:
    """Return a block whose poses and tie points are moved by a similarity."""
    ties = block.tie_points
    return replace(
        block,
        poses=tuple(None if pose is None else fit.pose(pose) for pose in block.poses),
        tie_points=replace(ties, position_world_m=fit.points(ties.position_world_m)),
    )
