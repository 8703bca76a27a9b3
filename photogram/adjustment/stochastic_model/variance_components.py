"""Whether observations scatter as stated: one variance factor for every group of them.

With the whitened residuals v of a group and the sum r of its redundancy numbers, vᵀv / r estimates the factor by which
the group's variances are off (Förstner 1979; Förstner & Wrobel 2016, sec. 4.2.4): 1 where the sigmas are right. It is
taken at the sigmas that were used and shown; what of it is applied, and how, is in estimated_sigmas and assumed_sigmas.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from photogram.adjustment.constraint_tests import constraint_tests
from photogram.adjustment.ground_points import of_control
from photogram.adjustment.rigs.exposure_tests import exposure_tests
from photogram.arrays import FloatArray, IntArray
from photogram.camera import calibration_sigmas, calibrations
from photogram.constraints.between_points import CONSTRAINT_KINDS, observations
from photogram.constraints.rigs import exposure_sigmas
from photogram.factors.common_errors import attitude_groups
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.loss import robust_terms
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.ground_terms import GroundTerms
from photogram.factors.priors import NO_HEADING_SIGMA_RAD, common_offset_prior
from photogram.factors.rigs.exposures import estimated, values_by_rig
from photogram.factors.surfaces.known_surface import KnownSurfaceFactors
from photogram.projection import PARAMETERS
from photogram.results import Reliability, VarianceComponents

SIGNIFICANCE = 0.01  # two-sided, of a group whose sigmas are right
LEAST_REDUNDANCY = 1.0  # below it a group says nothing about its own sigmas
NO_OBSERVATION = "unknown_heading"  # a weight so small that it only keeps the equations solvable
GROUP_OF_KIND = {
    "distance": "distances",
    "height difference": "height_differences",
    "level surface": "level_surfaces",
    "plane": "planes",
}
RELATIVE_POSES = "relative_poses"  # of cameras on one body, as given
COMMON_ERRORS, LENS_FIELDS = "common_errors", "lens_fields"
ASSUMED = COMMON_ERRORS, LENS_FIELDS  # whose priors are wide and nobody's statement


@dataclass(frozen=True)
class _Group:
    """One group: its name, number of observations, redundancy, vᵀPv and the sigmas that were used."""

    name: str
    observations: int
    redundancy: float
    squares: float
    sigma: FloatArray


def _tested(name: str, redundancy: FloatArray, w: FloatArray, sigma: FloatArray) -> _Group:
    """Return a group of which redundancy numbers and w-tests are known, NaN for what is no observation."""
    known = np.isfinite(redundancy)
    squares = np.nan_to_num(w[known]) ** 2 * redundancy[known]
    return _Group(name, int(known.sum()), float(redundancy[known].sum()), float(squares.sum()), sigma[known])


def _attitude_errors(
    problem: Problem, state: State, covariances: Covariances, index: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the residuals (n, 3) of the attitudes of photographs (n,), rad, and the covariances (n, 3, 3) of the
    adjusted ones, their common errors among them."""
    error, covariance = np.zeros((len(index), 3)), np.zeros((len(index), 3, 3))
    for group in attitude_groups(problem.block, state.rotation, state.common):
        n, J = np.searchsorted(index, group.photograph), group.of_turn
        error[n] = group.misfit_rad
        if group.error < 0:
            covariance[n] = J @ covariances.poses[group.photograph, :3, :3] @ np.swapaxes(J, 1, 2)
            continue
        at = np.concatenate([np.arange(3), 6 + covariances.layout.columns_of_common(group.error)])
        joint = np.array([covariances.joint(np.array([i]))[np.ix_(at, at)] for i in group.photograph.tolist()])
        A = np.concatenate([J, group.of_bias], axis=2)
        covariance[n] = A @ joint @ np.swapaxes(A, 1, 2)
    return error, covariance


def _attitudes(problem: Problem, state: State, covariances: Covariances) -> list[_Group]:
    """Return the measured attitudes, and apart from them the headings that are not known."""
    photographs = problem.block.photographs
    stated = [
        (i, p.attitude_world_from_camera, p.attitude_sigma_rad, p.heading_known)
        for i, p in enumerate(photographs)
        if p.attitude_world_from_camera is not None and p.attitude_sigma_rad is not None
    ]
    if not stated:
        return []
    index = np.array([i for i, *_ in stated])
    measured, sigma = np.array([R for _, R, *_ in stated]), np.array([s for *_, s, _ in stated])
    unknown = np.array([not known for *_, known in stated])
    error, covariance = _attitude_errors(problem, state, covariances, index)
    vertical = measured[:, 2] * unknown[:, None]  # the world's up axis in the camera frame
    kept = np.eye(3) - vertical[:, :, None] * vertical[:, None, :]
    counted = 3 - unknown
    spread = np.einsum("nij,nji->n", kept, covariance) / sigma**2
    squares = np.einsum("ni,nij,nj->n", error, kept, error) / sigma**2
    groups = [_Group("attitude", int(counted.sum()), float(np.sum(counted - spread)), float(squares.sum()), sigma)]
    if unknown.any():
        around = np.einsum("ni,nij,nj->n", vertical, covariance, vertical) / NO_HEADING_SIGMA_RAD**2
        turned = np.einsum("ni,ni->n", vertical, error) / NO_HEADING_SIGMA_RAD
        n = int(unknown.sum())
        groups.append(
            _Group(NO_OBSERVATION, n, float(n - around.sum()), float(turned @ turned), np.full(n, NO_HEADING_SIGMA_RAD))
        )
    return groups


def _priors(problem: Problem, state: State, covariances: Covariances, axes: FloatArray) -> list[_Group]:
    """Return what was known beforehand of common errors, calibrations and lens fields."""
    groups = []
    if problem.flights:
        sigma = np.maximum(problem.block.gnss_offset_sigma_m, 1e-6)
        spread = np.array([np.diag(axes.T @ covariances.offset(f) @ axes) for f in range(len(problem.flights))])
        redundancy, residual = 1.0 - spread / sigma**2, state.offset @ axes / sigma
        if problem.block.datum_sigma_m > 0.0 and len(residual) > 1:
            prior = common_offset_prior(len(residual), sigma, problem.block.datum_sigma_m, axes)
            W, o = np.concatenate(prior.matrices, axis=2)[0], covariances.layout.offset_column
            joint = covariances.border[o : o + residual.size, o : o + residual.size]
            redundancy, residual = 1.0 - np.diag(W @ joint @ W.T), (W @ state.offset.ravel()).reshape(residual.shape)
        groups.append(
            _Group("gnss_offset", residual.size, float(redundancy.sum()), float(np.sum(residual**2)),
                   np.tile(sigma, len(residual)))
        )  # fmt: skip
    if errors := problem.block.common_errors:
        sigma = np.concatenate([error.sigma for error in errors])
        spread = np.concatenate([np.diag(covariances.common(k)) for k in range(len(errors))])
        redundancy, residual = 1.0 - spread / sigma**2, state.common[: len(sigma)] / sigma
        groups.append(_Group(COMMON_ERRORS, len(sigma), float(redundancy.sum()), float(residual @ residual), sigma))
    sigmas = calibration_sigmas(problem.block.cameras)
    interior = np.arange(sigmas.shape[1]) < PARAMETERS
    given = calibrations(problem.block.cameras)
    spread = np.array([np.diag(covariances.lens(c)) for c in range(len(sigmas))])
    for name, part in (("calibration", interior), (LENS_FIELDS, ~interior)):
        stated = (sigmas > 0) & np.isfinite(sigmas) & part
        if stated.any():
            off = (state.parameters - given)[stated] / sigmas[stated]
            redundancy = 1.0 - spread[stated] / sigmas[stated] ** 2
            groups.append(_Group(name, len(off), float(redundancy.sum()), float(off @ off), sigmas[stated]))
    return groups


def _constraints(problem: Problem, state: State, covariances: Covariances) -> list[_Group]:
    """Return the constraints between points, a group for each kind."""
    constraints = problem.block.constraints
    tests = constraint_tests(problem, state, covariances, problem, covariances, of_control(problem, state))
    kind = np.array([o.kind for o in observations(constraints)], dtype=np.str_)
    sigma = np.array([sigma for constraint in constraints for sigma in constraint.sigmas_m])
    return [
        _tested(GROUP_OF_KIND[k], tests.redundancy[kind == k], tests.w[kind == k], sigma[kind == k])
        for k in CONSTRAINT_KINDS
    ]


def _rigs(problem: Problem, state: State, covariances: Covariances) -> list[_Group]:
    """Return the exposures of cameras on one body, turns and shifts apart, and the relative poses that are given."""
    block = problem.block
    if not block.rigs:
        return []
    tests, sigma = exposure_tests(problem, state, covariances, problem, covariances), exposure_sigmas(block.rigs)
    values, own = values_by_rig(block, state.common), estimated(block)
    prior = np.array([rig.sigma for rig in block.rigs])
    given = np.isfinite(prior) & np.isin(np.arange(len(prior)), own)[:, None]
    spread = np.einsum("kaa->ka", tests.relative_covariance)[given] / prior[given] ** 2
    residual = values[given] / prior[given]
    return [
        *(
            _tested(f"exposure_{name}", tests.redundancy[:, part], tests.w[:, part], sigma[:, part])
            for name, part in (("rotation", slice(0, 3)), ("offset", slice(3, 6)))
        ),
        _Group(RELATIVE_POSES, len(residual), float(np.sum(1.0 - spread)), float(residual @ residual), prior[given]),
    ]


def _surface(problem: Problem, state: State, covariances: Covariances) -> list[_Group]:
    """Return the distances from a known surface, if there is one."""
    surface = problem.block.known_surface
    if surface is None:
        return []
    misfit, rows = GroundTerms(problem, covariances.layout).rows_of(state, KnownSurfaceFactors)
    adjusted = float(np.sum(rows.T * covariances.solve(rows.T)))
    return [_Group("known_surface", len(misfit), len(misfit) - adjusted, float(misfit @ misfit), surface.sigma_m)]


def variance_components(
    problem: Problem,
    state: State,
    covariances: Covariances,
    tested: Reliability,
    redundancy: int,
    stated_sigma: Mapping[str, float] | None = None,
) -> VarianceComponents:
    """Return what every group of observations scatters by on the final linearisation.

    ``redundancy`` is that of the whole adjustment: since all redundancy numbers sum to it, the tie points have what
    the others leave. Tie points count with their robust weights, in vᵀPv as in the redundancy numbers. ``stated_sigma``
    are the medians of the stated sigmas of the groups for which others were estimated and used.
    """
    points, photographs = problem.block.control_points, problem.block.photographs
    axes = problem.block.frame.rotation_world_from_map(np.zeros(3))
    none = np.full(3, np.nan)
    gnss = np.array([none if p.gnss_sigma_m is None else p.gnss_sigma_m for p in photographs]).reshape(-1, 3)
    plan, height = slice(0, 2), slice(2, 3)
    groups = [
        _tested("marks", tested.mark_redundancy, tested.mark_w, np.repeat(points.mark_sigma_px[:, None], 2, axis=1)),
        *(
            _tested(f"{name}_{part}", r[:, axis], w[:, axis], sigma[:, axis])
            for name, r, w, sigma in (
                ("control", tested.ground_redundancy, tested.ground_w, points.sigma_m),
                ("gnss", tested.gnss_redundancy, tested.gnss_w, gnss),
            )
            for part, axis in (("plan", plan), ("height", height))
        ),
        *_attitudes(problem, state, covariances),
        *_priors(problem, state, covariances, axes),
        *_constraints(problem, state, covariances),
        *_rigs(problem, state, covariances),
        *_surface(problem, state, covariances),
    ]
    whitened = residuals(problem.tie, state.cameras, state.tie_point)
    _, weight, _ = robust_terms(whitened, problem.robust_loss, problem.robust_threshold)
    ties = _Group(
        "tie_points", 2 * len(problem.tie), redundancy - sum(g.redundancy for g in groups),
        float(np.sum(weight[:, None] * whitened**2)), problem.tie.sigma_px,
    )  # fmt: skip
    groups = [g for g in (ties, *groups) if g.observations]
    used = {g.name: float(np.median(g.sigma)) for g in groups}
    stated = {**used, **(stated_sigma or {})}
    return VarianceComponents(
        np.array([g.name for g in groups], dtype=np.str_),
        np.array([g.observations for g in groups], dtype=np.int64),
        np.array([g.redundancy for g in groups], dtype=np.float64),
        np.array([g.squares for g in groups], dtype=np.float64),
        np.array([stated[g.name] for g in groups], dtype=np.float64),
        np.array([used[g.name] for g in groups], dtype=np.float64),
    )


@dataclass(frozen=True)
class Scatter:
    """What a group scatters by: ``sigma_factor`` sqrt(vᵀPv / r), by which the sigmas that were used would have to be
    multiplied, with its own standard deviation; not a number without redundancy. ``significant`` where stated sigmas
    are refuted that were used; those that were estimated are not tested by the residuals that they come from."""

    observations: int
    redundancy: float
    stated_sigma: float
    used_sigma: float
    sigma_factor: float
    sigma_factor_sd: float
    significant: bool


def scatters(components: VarianceComponents) -> dict[str, Scatter]:
    """Return the scatter of every group of observations by its name.

    sigma_factor_sd is σ̂ / sqrt(2 r), that of σ̂² being sqrt(2/r) σ̂². Significant is what lies outside of the two-sided
    bounds of χ² with r degrees of freedom at SIGNIFICANCE.
    """
    by_name = {}
    c = components
    for k, name in enumerate(c.group.tolist()):
        if name == NO_OBSERVATION:
            continue
        n = int(c.observations[k])
        r = float(c.redundancy[k])
        squares = float(c.squares[k])
        factor = float(np.sqrt(squares / r)) if r >= LEAST_REDUNDANCY else float("nan")
        tail = min(chi2.sf(squares, r), chi2.cdf(squares, r)) if r >= LEAST_REDUNDANCY else 1.0
        sd = factor / float(np.sqrt(2.0 * r)) if r >= LEAST_REDUNDANCY else float("nan")
        stated, used = float(c.stated_sigma[k]), float(c.used_sigma[k])
        refuted = bool(tail < SIGNIFICANCE / 2) and used == stated and name not in ASSUMED
        by_name[name] = Scatter(n, r, stated, used, factor, sd, refuted)
    return by_name
