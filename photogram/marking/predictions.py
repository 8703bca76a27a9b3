"""Where photographs show ground points, with the covariance of each place, as far as a block knows.

The block is adjusted with the marks that there are; a place that nobody has marked is then a function of its unknowns
like any other (Förstner & Wrobel 2016, sec. 15.4). Without tie points that takes tenths of a second: two marks of two
points show a compass that is off, and all circles shrink at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photogram.adjustment.oriented_subset import registered_block
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.adjustment.solvability import undetermined
from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera, Pose, project_points
from photogram.errors import AdjustmentError
from photogram.factors.covariance import covariances, predicted_marks
from photogram.factors.graph import IndeterminateError
from photogram.marking.tagged_block import with_all_points
from photogram.survey import Block

SURE = float(-2.0 * np.log(0.05))
"""Square of the radius of the ellipse, in standard deviations, that holds a place in 95 of 100."""

NEAR_SHARE = 0.25
"""Of the longer side of a picture, how far outside of it a place may be predicted and still be looked at."""


@dataclass(frozen=True, eq=False)
class PredictedPlaces:
    """Where photographs show ground points (K), sorted by point, then by photograph."""

    point: IntArray
    """Number (K,) of the point among the block's ground points."""
    photograph: IntArray
    """Number (K,) of the photograph."""
    pixel: FloatArray
    """Its place (K, 2), px; it may lie outside of the picture."""
    covariance_px2: FloatArray
    """Covariance (K, 2, 2) of the place."""
    inside: BoolArray
    """Whether the place (K,) lies within the picture."""

    def of_point(self, point: int) -> IntArray:
        """Return the numbers of the places of one point."""
        return np.flatnonzero(self.point == point).astype(np.int64)

    @property
    def radius_px(self) -> FloatArray:
        """Return the longer semi-axis (K,) of the ellipses that hold the places in 95 of 100, px."""
        return np.asarray(np.sqrt(SURE * np.linalg.eigvalsh(self.covariance_px2)[:, 1]))


def predicted_places(block: Block, settings: AdjustmentSettings | None = None) -> PredictedPlaces:
    """Return where the photographs of a block that have a pose show its ground points.

    ``block`` is a ``tagged_block``, or an adjusted one with its tie points. All its ground points count, check points
    too; points that nothing places are left out, and photographs that show nothing near. Raises AdjustmentError where
    the block is not determined.
    """
    settings = settings or AdjustmentSettings(estimate_sigmas=False)
    known, kept = registered_block(with_all_points(block))
    if not len(kept):
        raise AdjustmentError(
            "no photograph has a position and an attitude, so nothing says where points are to be looked for: mark them"
        )
    numbers = {name: g for g, name in enumerate(block.control_points.name)}
    problem = make_problem(known, settings)
    try:
        state = minimise(problem, start_state(problem), settings).state
        joint = covariances(problem, state)
    except IndeterminateError as error:
        raise undetermined(problem, error) from error
    cameras = [c.with_parameters(q) for c, q in zip(known.cameras, state.parameters, strict=True)]
    poses = [Pose(R, C, v) for R, C, v in zip(state.rotation, state.position, state.velocity, strict=True)]
    photograph, point, inside = _pairs(known, cameras, poses, state.control)
    pixel, covariance = predicted_marks(problem, state, joint, photograph, point)
    whole = np.array([numbers[name] for name in known.control_points.name], dtype=np.int64)
    return PredictedPlaces(whole[point], kept[photograph], pixel, covariance, inside)


def _pairs(
    block: Block, cameras: Sequence[Camera], poses: Sequence[Pose], position_world_m: FloatArray
) -> tuple[IntArray, IntArray, BoolArray]:
    """Return photographs (K,), points (K,) and whether it is inside, of every point that lies in or near a picture."""
    near_photographs = []
    for i, (own, pose) in enumerate(zip(block.camera_of.tolist(), poses, strict=True)):
        camera = cameras[own]
        pixel = project_points(camera, pose, position_world_m)
        margin_px = NEAR_SHARE * max(camera.width_px, camera.height_px)
        size = np.array([camera.width_px, camera.height_px])
        with np.errstate(invalid="ignore"):
            near = np.flatnonzero(np.all((pixel >= -margin_px) & (pixel <= size + margin_px), axis=1))
        near_photographs.append(np.column_stack([np.full(len(near), i), near, camera.contains(pixel[near])]))
    rows = np.concatenate(near_photographs) if near_photographs else np.zeros((0, 3), dtype=np.int64)
    rows = rows[np.lexsort((rows[:, 0], rows[:, 1]))].astype(np.int64)
    return rows[:, 0], rows[:, 1], rows[:, 2].astype(np.bool_)
