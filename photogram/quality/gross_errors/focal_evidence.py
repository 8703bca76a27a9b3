"""What photographs, and control points left out, say of a focal length whose source they contradict.

Parts of the pictures are adjusted by themselves; see photogram.quality.gross_errors.focal_length for its use.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from photogram.adjustment.effort import during
from photogram.arrays import BoolArray
from photogram.camera import Camera
from photogram.errors import PhotogramError
from photogram.quality.gross_errors.data_snooping import Search, without
from photogram.quality.gross_errors.focal_length import WRONG_BY, model_sigma_px, picture_parts, settled, without_prior
from photogram.quality.gross_errors.solutions import Solutions
from photogram.results import Adjustment, FocalDecision, FocalLength, PhotographsSay
from photogram.survey import Block, TiePoints
from photogram.wording import Progress

FEWEST_RAYS = 20
"""Rays of a photograph from which it takes part in the adjustment of a part of the pictures."""

FEWEST_CONTROL = 3
"""Control points that, left out one after the other, speak for one focal length or another."""


def _restricted(solved: Adjustment, keep: BoolArray) -> Adjustment:
    """Return an adjustment with the observations ``keep`` (N,) of its tie points alone."""
    block = solved.block
    ties = _of_two_rays(block.tie_points, keep)
    rays = np.bincount(ties.photograph, minlength=len(block.photographs))
    ties = _of_two_rays(ties, (rays >= FEWEST_RAYS)[ties.photograph])
    poses = tuple(pose if n >= FEWEST_RAYS else None for pose, n in zip(block.poses, rays, strict=True))
    return replace(solved, block=replace(block, tie_points=ties, poses=poses))


def _of_two_rays(ties: TiePoints, keep: BoolArray) -> TiePoints:
    ties = ties.select(np.ones(len(ties), dtype=bool), keep)
    return ties.select(ties.rays >= 2)


def _focal_of(result: Adjustment, camera: Camera, c: int) -> tuple[float, float]:
    """Return the focal length of a camera and its standard deviation without the prior of ``camera``, px."""
    sigma = float(np.sqrt(result.covariances.calibration[c, 0, 0]))
    return without_prior(result.block.cameras[c].focal_px, sigma, camera.focal_px, float(camera.sigmas[0]))


def photographs_say(block: Block, free: Adjustment, c: int, solutions: Solutions) -> PhotographsSay:
    """Return what the photographs say of the focal length of camera ``c`` in ``block``, whose prior is wide; ``free``
    is its adjustment, near which those of the parts are."""
    camera = block.cameras[c]
    focal_px, sigma_px = _focal_of(free, camera, c)
    ties = free.block.tie_points
    camera_of = block.camera_of
    parts: list[tuple[float, float]] = []
    for keep in picture_parts(ties, camera_of[ties.photograph] == c, camera.width_px, camera.height_px):
        try:
            part = _focal_of(solutions.part(_restricted(free, keep), block, c), camera, c)
        except PhotogramError:
            continue  # too little is left in this part of the pictures: the others speak
        if np.isfinite(part[1]):
            parts.append(part)
    values = np.array(parts).reshape(-1, 2)
    model_px = min(model_sigma_px(focal_px, sigma_px, values[:, 0], values[:, 1]), WRONG_BY * camera.focal_px)
    return PhotographsSay(focal_px, sigma_px, model_px)


def prediction(result: Adjustment) -> float:
    """Return the logarithm of the likelihood of the control points, each predicted by all the rest
    (cross-validation)."""
    r, total = result.tests.reliability, 0.0
    for off, covariance in zip(r.ground_left_out_m, r.ground_left_out_covariance_m2, strict=True):
        known = np.flatnonzero(np.isfinite(off))
        if len(known):
            C = covariance[np.ix_(known, known)]
            total -= 0.5 * (off[known] @ np.linalg.solve(C, off[known]) + np.linalg.slogdet(C)[1])
    return float(total)


def _fixed_at(camera: Camera, focal: FocalLength) -> Camera:
    """Return the camera with a focal length that is held and whose uncertainty counts in every covariance."""
    sigmas = np.concatenate([[0.0], camera.sigmas[1:]])
    return replace(camera, focal_px=focal.focal_px, sigmas=sigmas, considered_focal_sigma_px=focal.sigma_px)


def _evidence(block: Block, c: int, says: PhotographsSay, adjuster: Callable[[Block], Adjustment]) -> float:
    """Return the logarithm of the likelihood ratio of the control points, of what photographs say over the source."""
    if len(block.control_points.with_role("control")) < FEWEST_CONTROL or not np.isfinite(says.sigma_px):
        return 0.0
    given, likelihood = block.cameras[c], []
    for value, sigma in ((says.focal_px, says.sigma_px), (given.focal_px, float(given.sigmas[0]))):
        camera = _fixed_at(given, FocalLength(value, sigma, 0.0))
        cameras = tuple(camera if k == c else other for k, other in enumerate(block.cameras))
        try:
            likelihood.append(prediction(adjuster(replace(block, cameras=cameras))))
        except PhotogramError:
            return 0.0
    return likelihood[0] - likelihood[1]


@during("focal length", everything=True)
def settle_focal_lengths(
    block: Block,
    explanation: Search,
    solutions: Solutions,
    progress: Progress,
    readings_px: Sequence[Sequence[float]],
) -> tuple[Block | None, dict[str, FocalDecision]]:
    """Return the block with the focal lengths settled whose source the ``explanation`` rejects, and the decisions by
    camera.

    None in place of the block where what the
    photographs say stands as it is: ``explanation`` is then the result.
    """
    rejected = {a.name for a in explanation.rejected if a.kind == "focal length"}
    decisions: dict[str, FocalDecision] = {}
    cameras, changed = list(block.cameras), False
    for c, given in enumerate(block.cameras):
        if given.name not in rejected:
            continue
        progress(0, 0, f"focal length of {given.name}")
        wide = without(block, explanation.rejected)
        says = photographs_say(wide, explanation.result, c, solutions)
        others = without(block, [a for a in explanation.rejected if a.name != given.name])
        evidence = (
            0.0
            if says.trustworthy
            else _evidence(others, c, says, partial(solutions.compared, near=explanation.result))
        )
        readings = (given.focal_px, *(readings_px[c] if len(readings_px) else ()))
        focal = settled(readings, float(given.sigmas[0]), says, evidence)
        decisions[given.name] = FocalDecision(given.focal_px, float(given.sigmas[0]), says, focal, evidence)
        if not says.trustworthy:
            cameras[c], changed = _fixed_at(given, focal), True
    return (replace(block, cameras=tuple(cameras)) if changed else None), decisions
