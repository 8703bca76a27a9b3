"""What an adjustment predicts for measurements that it did not have, against these measurements.

Ground points and GNSS positions are left out a part at a time; each time all decisions are made again without them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.stochastic_model.estimated_sigmas import with_assumed_sigmas
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.arrays import BoolArray, FloatArray
from photogram.errors import AdjustmentError
from photogram.survey import Block, Photograph, Role

FOLDS = 5
ONE_BY_ONE = ", one by one"
"""Ends the kind of what one adjustment would predict without a measurement that it had."""
AXES = ("easting", "northing", "height")


@dataclass(frozen=True)
class Predicted:
    """One coordinate of a measurement that took no part: its error, predicted minus measured, and the standard
    deviation of that, with the measurement's own part ``own`` of it, in its unit."""

    kind: str
    name: str
    axis: str
    error: float
    sigma: float
    own: float
    unit: str = "m"

    @property
    def z(self) -> float:
        """Return the error in standard deviations."""
        return self.error / self.sigma


@dataclass(frozen=True)
class Start:
    """What an adjustment is given beside its block."""

    settings: AdjustmentSettings
    parameters: Sequence[FloatArray] = ()
    readings_px: Sequence[Sequence[float]] = ()

    def adjusted(self, block: Block) -> Verdict:
        """Adjust a block and decide what is in its model."""
        return adjust_with_snooping(block, self.settings, self.parameters, readings_px=self.readings_px)


def folds(count: int) -> list[BoolArray]:
    """Return masks (count,) that part what is left out: every fifth, or one by one where there are few."""
    parts = min(FOLDS, count) if count > 2 * FOLDS else count
    return [np.arange(count) % parts == k for k in range(parts)]


def with_checks(block: Block, left_out: BoolArray) -> Block:
    """Return a block whose ground points of the mask (G,) are check points."""
    points = block.control_points
    roles: list[Role] = ["check" if out else role for out, role in zip(left_out, points.role, strict=True)]
    return replace(block, control_points=points.with_roles(roles))


def _factors(verdict: Verdict, plan: str, height: str, of: str) -> FloatArray:
    """Return by what the adjustment multiplies assumed standard deviations (3,), 1 where it does not."""
    sigmas = verdict.result.decisions.sigmas

    def factor(kind: str) -> float:
        found = sigmas.factors(kind)  # type: ignore[arg-type]
        return found.get(of, next(iter(found.values()), 1.0))

    return np.array([factor(plan), factor(plan), factor(height)])


def at_points(verdict: Verdict, chosen: BoolArray, kind: str) -> list[Predicted]:
    """Return what is predicted for the ground points of the mask (G,), in a block whose world is its map."""
    result, points = verdict.result, verdict.block.control_points
    adjusted = result.estimates.ground_world_m
    found = []
    for g in np.flatnonzero(chosen & np.isfinite(adjusted).all(axis=1)).tolist():
        assumed = bool(points.sigma_assumed[g])
        factors = _factors(verdict, "control_plan", "control_height", "") if assumed else np.ones(3)
        own = points.sigma_m[g] * factors
        variance = np.diagonal(result.covariances.ground_m2[g]) + own**2
        error = adjusted[g] - points.position_world_m[g]
        found += [
            Predicted(kind, points.name[g], axis, float(error[k]), float(np.sqrt(variance[k])), float(own[k]))
            for k, axis in enumerate(AXES)
            if np.isfinite(error[k]) and np.isfinite(variance[k])
        ]
    return found


def at_positions(verdict: Verdict, own_m: Mapping[str, FloatArray], measured: Block) -> list[Predicted]:
    """Return what is predicted for the GNSS positions of photographs, by name with their own standard deviations (3,),
    of a block as ``measured``, in a block whose world is its map."""
    result, found = verdict.result, []
    oriented = np.flatnonzero(result.block.registered).tolist()
    for row, i in enumerate(oriented):
        photograph, pose = measured.photographs[i], result.block.poses[i]
        assert pose is not None
        centre = photograph.measured_centre_world_m(pose.rotation_world_from_camera)
        if centre is None or photograph.name not in own_m:
            continue
        own = own_m[photograph.name]
        sigma = np.sqrt(np.diagonal(result.covariances.position_m2[row]) + own**2)
        error = pose.position_world_m - centre
        found += [
            Predicted("GNSS positions", photograph.name, axis, float(error[k]), float(sigma[k]), float(own[k]))
            for k, axis in enumerate(AXES)
        ]
    return found


def _about_their_offset(block: Block, verdict: Verdict) -> Block:
    """Return a block whose positions are known to what they scatter by about the offset of their flight, which is none
    then: it is in those that are predicted as well."""
    used = with_assumed_sigmas(block, verdict.result.decisions.sigmas)
    photographs = tuple(replace(p, gnss_sigma_assumed=False) for p in used.photographs)
    return replace(
        block, photographs=photographs, gnss_offset_sigma_m=np.zeros(3), datum_sigma_m=0.0, undeclared_heights=None
    )


def control_left_out(block: Block, start: Start) -> tuple[list[Predicted], list[str]]:
    """Return what everything else predicts for the control points, and what could not be adjusted without them."""
    points = block.control_points
    marks = np.bincount(points.mark_point, minlength=len(points))
    fit = np.flatnonzero(points.controlled.all(axis=1) & (marks >= 2))
    found, failed = list[Predicted](), list[str]()
    for fold in folds(len(fit)):
        left_out = np.zeros(len(points), dtype=bool)
        left_out[fit[fold]] = True
        try:
            found += at_points(start.adjusted(with_checks(block, left_out)), left_out, "control points")
        except AdjustmentError as error:
            failed.append(str(error))
    return found, failed


def positions_left_out(block: Block, start: Start) -> tuple[list[Predicted], list[str]]:
    """Return what the photographs and the other positions predict for the GNSS positions, without control, and what
    could not be adjusted without them. Assumed standard deviations are those that the others scatter by."""
    block = with_checks(block, np.ones(len(block.control_points), dtype=bool))
    there = np.flatnonzero([p.gnss_world_m is not None for p in block.photographs])
    found, failed = list[Predicted](), list[str]()
    for fold in folds(len(there)):
        left_out = {block.photographs[i] for i in there[fold]}
        held = tuple(
            replace(p, gnss_world_m=None, gnss_sigma_m=None) if p in left_out else p for p in block.photographs
        )
        try:
            others = replace(block, photographs=held)
            first = start.adjusted(others)
            second = start.adjusted(_about_their_offset(others, first))
        except AdjustmentError as error:
            failed.append(str(error))
            continue
        own_m = {p.name: _own_sigma_m(p, first) for p in left_out}
        found += at_positions(second, own_m, block)
    return found, failed


def one_by_one(block: Block, start: Start) -> list[Predicted]:
    """Return what one adjustment of the whole block predicts for each mark of control points, and each GNSS position,
    without it (Q⁻¹v, Förstner & Wrobel 2016, sec. 4.6): all decisions are made with it."""
    verdict = start.adjusted(block)
    result, points, tested = verdict.result, block.control_points, verdict.result.tests.reliability
    found = list[Predicted]()
    for m in np.flatnonzero(np.isfinite(tested.mark_left_out_px).all(axis=1)).tolist():
        sigma = np.sqrt(np.diagonal(tested.mark_left_out_covariance_px2[m]))
        own = np.sqrt(np.diagonal(result.block.control_points.mark_covariance_px2[m]))
        name = f"{points.name[points.mark_point[m]]} in {block.photographs[points.mark_photograph[m]].name}"
        found += [
            Predicted(f"marks{ONE_BY_ONE}", name, axis, float(off), float(whole), float(part), "px")
            for axis, off, whole, part in zip("uv", tested.mark_left_out_px[m], sigma, own, strict=True)
        ]
    for i in np.flatnonzero(np.isfinite(tested.gnss_left_out_m).all(axis=1)).tolist():
        sigma = np.sqrt(np.diagonal(tested.gnss_left_out_covariance_m2[i]))
        own = _own_sigma_m(block.photographs[i], verdict)
        found += [
            Predicted(f"positions{ONE_BY_ONE}", block.photographs[i].name, axis, float(off), float(whole), float(part))
            for axis, off, whole, part in zip(AXES, tested.gnss_left_out_m[i], sigma, own, strict=True)
        ]
    return found


def _own_sigma_m(photograph: Photograph, verdict: Verdict) -> FloatArray:
    """Return the standard deviations (3,) of a position that was left out: as stated, or by what others scatter."""
    assert photograph.gnss_sigma_m is not None
    if not photograph.gnss_sigma_assumed:
        return photograph.gnss_sigma_m
    return np.asarray(photograph.gnss_sigma_m * _factors(verdict, "gnss_plan", "gnss_height", photograph.flight))
