"""Another program's result minus photogram's adjustment, in standard deviations of the adjustment.

Of exterior orientations and calibrations, where both have the photograph or the camera.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera, Pose
from photogram.errors import OrientationError
from photogram.exchange.audit.foreign_block import ForeignBlock, moved_by, similarity_of_poses
from photogram.files.solutions.solution import ForeignSolution
from photogram.geodesy.frames import LocalFrame
from photogram.projection import PARAMETERS
from photogram.results import Adjustment
from photogram.survey import Block


@dataclass(frozen=True, eq=False)
class PoseDifference:
    """A photograph's exterior orientation, theirs minus ours."""

    photograph: str
    position_m: FloatArray
    """Of the projection centre (3,) in the world."""
    rotation_rad: FloatArray
    """About the camera's axes (3,)."""
    sigmas: float
    """Root of the mean square of the six over their predicted covariance: 1 where they differ by chance alone."""


def brought(start: ForeignBlock, of: IntArray, result: Adjustment, *, is_same_map: bool = True) -> Block | None:
    """Return a program's block in the world of an adjustment: as its files place it where they do so in the same map,
    else by the similarity of the projection centres that both have.

    ``of`` (photographs of the adjustment,) are the numbers of its photographs, −1 for those that it has not. Where
    their centres lie in one line, which leaves a turn about it open, it is where its control points put it; None in
    another map.
    """
    frame, theirs = result.block.frame, start.theirs
    if start.is_placed and is_same_map:
        return _in_frame(theirs, frame)
    try:
        fit = similarity_of_poses(poses_of(theirs, of), result.block.poses)
    except OrientationError:
        return _in_frame(theirs, frame) if is_same_map else None
    return moved_by(fit, theirs)


def _in_frame(block: Block, frame: LocalFrame) -> Block:
    """Return the block in another frame of the same map; its tie points without positions, which nobody asks for."""
    if block.frame == frame:
        return block
    moved: list[Pose | None] = []
    for pose in block.poses:
        if pose is None:
            moved.append(None)
            continue
        to_map = block.frame.rotation_world_from_map(pose.position_world_m).T
        position = frame.world_from_map(block.frame.map_from_world(pose.position_world_m[None]))[0]
        turn = frame.rotation_world_from_map(position) @ to_map
        moved.append(Pose(turn @ pose.rotation_world_from_camera, position))
    nowhere = np.full(block.tie_points.position_world_m.shape, np.nan)
    ties = replace(block.tie_points, position_world_m=nowhere)
    return replace(block, frame=frame, poses=tuple(moved), tie_points=ties)


def poses_of(block: Block, of: IntArray) -> list[Pose | None]:
    """Return the poses of the photographs ``of`` (N,), None for −1."""
    return [None if i < 0 else block.poses[i] for i in of.tolist()]


def pose_differences(poses: Sequence[Pose | None], result: Adjustment) -> list[PoseDifference]:
    """Return the differences of poses, one of each photograph of the adjustment, from the adjusted ones."""
    differences = []
    for i, (a, b) in enumerate(zip(poses, result.block.poses, strict=True)):
        if a is None or b is None:
            continue
        position = a.position_world_m - b.position_world_m
        turn = b.rotation_world_from_camera.T @ a.rotation_world_from_camera
        rotation = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        squares = position @ np.linalg.pinv(result.covariances.position_m2[i]) @ position
        squares += rotation @ np.linalg.pinv(result.covariances.rotation_rad2[i]) @ rotation
        name = result.block.photographs[i].name
        differences.append(PoseDifference(name, position, rotation, float(np.sqrt(squares / 6.0))))
    return differences


def cameras_of(solution: ForeignSolution, of: IntArray, block: Block) -> list[Camera | None]:
    """Return for each camera of a block the solution's: the one of most of its photographs; None where it has another
    size or model, or no photograph of it."""
    cameras: list[Camera | None] = []
    for c, camera in enumerate(block.cameras):
        shared = [i for i, own in zip(of.tolist(), block.camera_of.tolist(), strict=True) if own == c and i >= 0]
        votes = Counter(solution.photographs[i].camera for i in shared)
        theirs = solution.cameras[votes.most_common(1)[0][0]] if votes else None
        cameras.append(theirs if theirs is not None and _kind(theirs) == _kind(camera) else None)
    return cameras


def _kind(camera: Camera) -> tuple[int, int, str]:
    return camera.width_px, camera.height_px, camera.model


def calibration_differences(cameras: Sequence[Camera | None], result: Adjustment) -> tuple[FloatArray, FloatArray]:
    """Return interior orientations (cameras, 12), theirs minus ours, and the same over the standard deviations of ours;
    NaN where there is none."""
    own = np.array([camera.parameters for camera in result.block.cameras])
    given = np.array([np.full(PARAMETERS, np.nan) if camera is None else camera.parameters for camera in cameras])
    off = given.reshape(own.shape) - own
    sigma = np.sqrt(np.einsum("ckk->ck", result.covariances.calibration))
    return off, np.divide(off, sigma, out=np.full(off.shape, np.nan), where=sigma > 0.0)
