"""What photographs, and control points left out, say of a focal length whose source they contradict.

Parts of the pictures are adjusted by themselves; see photogram.amendments.focal_length for its use.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.stats import chi2

from photogram.amendments.amendment import Proposal, Solution
from photogram.amendments.focal_length import WRONG_BY, model_sigma_px, picture_parts, settled, without_prior
from photogram.amendments.gross_errors.data_snooping import without
from photogram.amendments.solutions import Solutions, attempted
from photogram.arrays import BoolArray
from photogram.camera import Camera
from photogram.errors import PhotogramError
from photogram.results import Adjustment, Decision, FocalDecision, FocalLength, PhotographsSay
from photogram.survey import Block, TiePoints

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


NOT_SETTLED = (
    "The focal length of {names} contradicts its source and could not be settled: the adjustment between the two "
    "failed ({error}). The result rejects the source: calibrate the camera"
)


class FocalLengths:
    """The focal lengths whose source is rejected as a gross error; ``readings_px`` are other readings of the source of
    each. ``decisions`` are those that were made, by camera."""

    about = "focal length"

    def __init__(self, solutions: Solutions, readings_px: Sequence[Sequence[float]]) -> None:
        self.decisions: dict[str, FocalDecision] = {}
        self._solutions = solutions
        self._readings_px = readings_px

    def propose(self, solution: Solution) -> Proposal | None:
        """Return the block with the focal lengths settled whose source was rejected, None where there are none, and
        where what the photographs say stands as it is."""
        rejected = {a.name for a in solution.rejected if a.kind == "focal length"} - self.decisions.keys()
        if not rejected:
            return None
        cameras, changed = list(solution.block.cameras), False
        for c, given in enumerate(solution.block.cameras):
            if given.name in rejected:
                self._solutions.progress(0, 0, f"focal length of {given.name}")
                decision = self._decided(solution, c)
                self.decisions[given.name] = decision
                if not decision.says.trustworthy:
                    cameras[c], changed = _fixed_at(given, decision.settled), True
        if not changed:
            return None
        sure = {name for name, decision in self.decisions.items() if decision.says.trustworthy}
        others = tuple(a for a in solution.rejected if a.kind != "focal length" or a.name in sure)
        block = replace(solution.block, cameras=tuple(cameras))
        near = attempted(lambda: self._solutions.alternative(without(block, others)))
        return Proposal(block, others, near or solution.result)

    def judged(self, before: Solution, after: Solution | PhotogramError) -> Solution:
        """Return the solution with what was settled, and the one before with a warning where there is none."""
        if not isinstance(after, PhotogramError):
            return after
        warning = NOT_SETTLED.format(names=", ".join(self.decisions), error=after)
        self.decisions = {}
        return before.warned(warning)

    def decided(self, solution: Solution) -> Iterator[Decision]:  # noqa: ARG002
        """Yield the focal lengths that were settled."""
        for name, decision in self.decisions.items():
            about, says = f"focal length of {name}", decision.says
            spread_px = float(np.hypot(decision.given_sigma_px, says.sigma_px))
            statistic = ((says.focal_px - decision.given_px) / spread_px) ** 2
            yield Decision(about, True, f"{about}: {decision.sentence}", statistic, 1, float(chi2.sf(statistic, 1)))

    def _decided(self, solution: Solution, c: int) -> FocalDecision:
        block, given = solution.block, solution.block.cameras[c]
        says = photographs_say(without(block, solution.rejected), solution.result, c, self._solutions)
        evidence = 0.0
        if not says.trustworthy:
            others = without(block, [a for a in solution.rejected if a.name != given.name])
            evidence = _evidence(others, c, says, partial(self._solutions.compared, near=solution.result))
        readings = (given.focal_px, *(self._readings_px[c] if len(self._readings_px) else ()))
        focal = settled(readings, float(given.sigmas[0]), says, evidence)
        return FocalDecision(given.focal_px, float(given.sigmas[0]), says, focal, evidence)
