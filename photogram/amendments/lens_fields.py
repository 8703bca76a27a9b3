"""Whether the cameras of a block have a lens field beside Brown's model, and the block adjusted with it.

A field is estimated only where all of this holds: the residuals of a camera have a significant pattern in common
(photogram.quality.residual_patterns); the pattern that one half of its photographs shows predicts the residuals of the
other half, and vice versa (cross-validation, Stone 1974), by more than the photographs differ; photographs and picture
are covered well enough to hold a field; and, adjusted jointly, the field is known to better than half of its size and
takes most of the pattern. Otherwise the block stays as it was adjusted without, and a sentence says why.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.amendment import Proposal, Solution
from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera
from photogram.errors import ImageError, PhotogramError
from photogram.lens.field_basis import FieldBasis, field_basis
from photogram.lens.fields import DEGREE, free_field, prior_sigmas, rms_px, rms_sigma_px
from photogram.quality.residual_patterns import ResidualPattern, residual_pattern, squares_of
from photogram.results import Adjustment, Decision, LensFieldDecision
from photogram.wording import Progress, percent, silent

EXPECTED = 2.0
"""RMS that a field is expected to have over that of the pattern which it has left in the residuals without: poses and
calibration take up as much again. Only the scale of a prior: the sigmas of most coefficients come out far below it."""

FEWEST_PHOTOGRAPHS = 12
"""Of a camera, for a field to be looked for: half of them must show it for themselves."""

COVERED = 0.7
"""Share of the squares of the picture with residuals enough, below which parts of a field would be a guess."""

SURE = 3.0
"""Standard errors by which the halves of the photographs must predict each other."""

KNOWN = 0.5
"""RMS of a field's standard deviation over that of the field, up to which a field counts as held by the block."""

TAKEN = 0.6
"""Of the RMS of the pattern, that may be left in the residuals with the field."""

MOST_RAYS = 40_000
"""Residuals of a camera of which the halves are made, evenly chosen."""


@dataclass(frozen=True)
class Gain:
    """What the field of other photographs takes from the residuals of photographs: its ``share`` of their square sum,
    and in how many standard errors that is above zero; negative where it adds to them."""

    share: float
    errors: float


def cross_validated(
    basis: FieldBasis, sigmas_px: FloatArray, photograph: IntArray, pixel: FloatArray, residual_px: FloatArray,
    sigma_px: FloatArray,
) -> Gain:  # fmt: skip
    """Return what is gained when residuals (N, 2), px, of ``photograph`` (N,) at ``pixel`` (N, 2), of standard
    deviations ``sigma_px`` (N,), are predicted from those of every other photograph of the camera, and the other way
    round; fields have priors of ``sigmas_px`` (K,)."""
    chosen = np.unique(np.linspace(0, len(photograph) - 1, min(len(photograph), MOST_RAYS)).astype(np.int64))
    number = np.unique(photograph[chosen], return_inverse=True)[1]
    count = int(number.max()) + 1
    weight = 1.0 / sigma_px[chosen, None]
    B = basis.at(pixel[chosen]) * weight[:, :, None]
    r = residual_px[chosen] * weight
    gained = np.zeros(count)
    for half in (0, 1):
        seen, other = number % 2 == half, number % 2 != half
        A, b = B[seen].reshape(-1, len(basis)), r[seen].ravel()
        c = np.linalg.solve(A.T @ A + np.diag(sigmas_px**-2.0), A.T @ b)
        left = r[other] - B[other] @ c
        gained += np.bincount(number[other], np.sum(r[other] ** 2 - left**2, axis=1), minlength=count)
    error = float(np.std(gained, ddof=1) * np.sqrt(count))
    return Gain(float(gained.sum() / np.sum(r**2)), float(gained.sum() / error) if error > 0.0 else 0.0)


def _covered(camera: Camera, pixel: FloatArray) -> float:
    """Return the share of the squares of a picture that have residuals enough to tell of a pattern."""
    square, squares = squares_of(camera, pixel)
    return float(np.mean(np.bincount(square, minlength=squares) >= 20))


def _assessed(result: Adjustment, c: int, given: Camera, *, always: bool) -> tuple[LensFieldDecision, float]:
    """Return the decision on the field of a camera before it is estimated, and the RMS that the field is expected to
    have, px, 0 where none is to be estimated."""
    block, tie = result.block, result.block.tie_points
    camera, name = block.cameras[c], given.name
    own = (block.camera_of[tie.photograph] == c) & np.isfinite(result.estimates.residual_px).all(axis=1)
    pixel, residual = tie.pixel[own], result.estimates.residual_px[own]
    pattern = residual_pattern(camera, pixel, residual) if own.any() else None
    decision = LensFieldDecision(name, photographs=len(np.unique(tie.photograph[own])))

    def refused(why: str) -> tuple[LensFieldDecision, float]:
        return replace(decision, why=why), 0.0

    if pattern is None:
        return refused("too few tie points say anything of a pattern")
    decision = replace(decision, pattern_px=pattern.pattern_px, covered=_covered(camera, pixel))
    if not (given.sigmas > 0.0).any():
        return refused("its calibration is fixed")
    if not pattern.significant and not always:
        return refused("the residuals have no significant pattern")
    if decision.photographs < FEWEST_PHOTOGRAPHS:
        return refused(f"{decision.photographs} photographs are too few to hold it, {FEWEST_PHOTOGRAPHS} are needed")
    if decision.covered < COVERED:
        return refused(f"tie points cover {percent(decision.covered)} of the picture, {percent(COVERED)} are needed")
    expected = EXPECTED * max(pattern.pattern_px, pattern.chance_px)
    try:
        basis = field_basis(replace(camera, field=None), DEGREE)
    except ImageError:
        return refused("the distortion cannot be undone all over the picture")
    gain = cross_validated(
        basis, prior_sigmas(basis.degree, expected), tie.photograph[own], pixel, residual, tie.sigma_px[own]
    )
    decision = replace(decision, gain=gain.share, gain_errors=gain.errors)
    if gain.errors < SURE and not always:
        return refused("the pattern of one half of the photographs does not predict that of the other half")
    return decision, expected


def _judged(result: Adjustment, c: int, decision: LensFieldDecision) -> LensFieldDecision:
    """Return the decision on the field of a camera that was estimated."""
    block, tie = result.block, result.block.tie_points
    camera = block.cameras[c]
    assert camera.field is not None
    own = (block.camera_of[tie.photograph] == c) & np.isfinite(result.estimates.residual_px).all(axis=1)
    after = residual_pattern(camera, tie.pixel[own], result.estimates.residual_px[own]) if own.any() else None
    count = len(camera.field.coefficients)
    decision = replace(
        decision,
        rms_px=rms_px(camera.field),
        sigma_px=rms_sigma_px(result.covariances.lens_field_px2[c, :count, :count]),
        largest_px=float(np.linalg.norm(camera.field.shift, axis=2).max()),
        left_px=float("nan") if after is None else after.pattern_px,
    )
    return replace(decision, estimated=True, why=_objection(decision, after))


def _objection(decision: LensFieldDecision, after: ResidualPattern | None) -> str:
    if after is None:
        return "too few tie points are left with it"
    if not decision.sigma_px < KNOWN * decision.rms_px:
        return (
            f"the block does not hold it: {decision.rms_px:.2g} ± {decision.sigma_px:.2g} px; more photographs, strips "
            "across the others or control points would"
        )
    if after.significant and after.pattern_px > TAKEN * decision.pattern_px:
        return f"it leaves {after.pattern_px:.2g} px of the pattern: what the photographs have in common is no lens"
    return ""


class LensFields:
    """The lens fields that the adjustment of a block shows and the block holds; ``decisions`` are those that were made
    on each camera, () where none are looked for."""

    about = "lens field"

    def __init__(self, settings: AdjustmentSettings, progress: Progress = silent) -> None:
        self.decisions: tuple[LensFieldDecision, ...] = ()
        self._settings = settings
        self._progress = progress
        self._wanted: dict[int, float] = {}
        self._decided = settings.lens_field == "none"

    def propose(self, solution: Solution) -> Proposal | None:
        """Return the block with fields of the cameras that show one, None where none does, or all was decided."""
        if self._decided:
            return None
        if not self.decisions:
            always = self._settings.lens_field == "always"
            cameras = enumerate(solution.block.cameras)
            assessed = [_assessed(solution.result, c, camera, always=always) for c, camera in cameras]
            self.decisions = tuple(decision for decision, _ in assessed)
            self._wanted = {c: expected_px for c, (_, expected_px) in enumerate(assessed) if expected_px > 0.0}
        if not self._wanted:
            self._decided = True
            return None
        self._progress(0, 0, "lens field: estimated with everything else")
        with_fields = list(solution.block.cameras)
        for c, expected_px in self._wanted.items():
            field = free_field(solution.result.block.cameras[c], expected_px)
            with_fields[c] = replace(with_fields[c], field=field)
        return Proposal(replace(solution.block, cameras=tuple(with_fields)), solution.rejected, solution.result)

    def judged(self, before: Solution, after: Solution | PhotogramError) -> Solution:
        """Return the solution with fields, the one before where the block does not hold them all."""
        decisions = list(self.decisions)
        for c in list(self._wanted):
            if isinstance(after, PhotogramError):
                decisions[c] = replace(decisions[c], why=f"the block cannot be adjusted with it: {after}")
            else:
                decisions[c] = _judged(after.result, c, decisions[c])
            if decisions[c].why:
                decisions[c] = replace(decisions[c], estimated=False)
                del self._wanted[c]
        lost = [c for c, decision in enumerate(self.decisions) if decision.why != decisions[c].why]
        self.decisions = tuple(decisions)
        if lost or isinstance(after, PhotogramError):
            return before
        self._decided = True
        return after

    def decided(self, solution: Solution) -> Iterator[Decision]:  # noqa: ARG002
        """Yield whether each camera has a field."""
        for decision in self.decisions:
            about = f"lens field of {decision.camera}"
            if decision.estimated:
                size = f"{decision.rms_px:.2g} ± {decision.sigma_px:.2g} px"
                sentence = f"{about}: estimated, {size}; {decision.left_px:.2g} px are left of the pattern"
            else:
                sentence = f"{about}: none, {decision.why}"
            if np.isfinite(decision.gain_errors):
                errors = decision.gain_errors
                yield Decision(about, decision.estimated, sentence, errors**2, 1, float(norm.sf(errors)))
            else:
                yield Decision(about, decision.estimated, sentence)
