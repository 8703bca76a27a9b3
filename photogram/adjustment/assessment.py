"""What a solved block is worth: covariances, reliability, sigma0, variance components, and the scatter of groups."""

from dataclasses import dataclass, replace

import numpy as np

from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.reliability import reliability
from photogram.adjustment.rounds import Solved
from photogram.adjustment.stochastic_model.assumed_sigmas import AssumedScatter, assumed_scatters
from photogram.adjustment.stochastic_model.estimated_sigmas import TieGroups, TieScatter, tie_scatter
from photogram.adjustment.stochastic_model.variance_components import variance_components
from photogram.arrays import BoolArray
from photogram.camera import Pose
from photogram.factors.common_errors import with_values
from photogram.factors.consider import with_considered
from photogram.factors.covariance import Covariances, covariances
from photogram.factors.elimination.loss import robust_terms
from photogram.factors.elimination.reprojection import Observations, residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem, cost, ground_factors
from photogram.factors.joint_covariance import points_redundancy
from photogram.factors.rigs.exposures import with_rig_values
from photogram.results import Reliability, VarianceComponents
from photogram.survey import Block


def sigma0_and_redundancy(problem: Problem, state: State) -> tuple[float, int]:
    """Return sigma0 = sqrt(vᵀPv / r) of the minimised squares, and the redundancy r."""
    block = problem.block
    factors = ground_factors(problem)
    image = 2 * (len(problem.tie) + len(problem.marks))
    ground = sum(alike.rows * len(alike) for alike in factors) - int(np.isinf(problem.control_sigma_m).sum())
    points = 3 * (int(np.count_nonzero(np.bincount(problem.tie.point))) + len(state.control) + len(state.offset))
    unknowns = 6 * len(block.photographs) + points + len(state.common) + sum(len(f) for f in problem.free)
    redundancy = image + ground - unknowns
    tie = residuals(problem.tie, state.cameras, state.tie_point)
    robust, weight, _ = robust_terms(tie, problem.robust_loss, problem.robust_threshold)
    known = cost(problem, factors, state) - 0.5 * float(robust.sum())
    squares = 2.0 * known + float(np.sum(weight[:, None] * tie**2))
    return float(np.sqrt(squares / redundancy)) if redundancy > 0 else float("nan"), redundancy


@dataclass(frozen=True, eq=False)
class Assessed:
    """A solved block with only what took part, (P,) of whose tie points are ``kept``: its covariances with focal
    lengths as ``fixed`` and with those ``counted`` that are considered, reliability with both and with the fixed ones
    alone, and what scatters by how much."""

    block: Block
    kept: BoolArray
    problem: Problem
    state: State
    fixed: Covariances
    counted: Problem
    covariances: Covariances
    tested: Reliability
    tested_fixed: Reliability
    sigma0: float
    redundancy: int
    components: VarianceComponents
    ties: TieScatter | None
    assumed: list[AssumedScatter]


def assessed(solved: Solved, stated: Block, settings: AdjustmentSettings) -> Assessed:
    """Return a solved block with its covariances, and what its observations scatter by; ``stated`` is the block with
    all its observations and the sigmas as stated."""
    whole, state = solved.whole.block, solved.minimum.state
    kept = np.bincount(whole.tie_points.point[solved.used], minlength=len(whole.tie_points)) >= 2
    mine = kept[whole.tie_points.point] & solved.used
    tie = replace(whole.tie_points, position_world_m=state.tie_point).select(kept, solved.used)
    cameras = tuple(c.with_parameters(q) for c, q in zip(whole.cameras, state.parameters, strict=True))
    poses = tuple(Pose(R, C, v) for R, C, v in zip(state.rotation, state.position, state.velocity, strict=True))
    common = with_values(whole, state.common)
    rigs = with_rig_values(whole, state.common)
    adjusted = replace(whole, cameras=cameras, poses=poses, tie_points=tie, common_errors=common, rigs=rigs)
    state = replace(state, tie_point=tie.position_world_m)
    problem = solved.problem.with_tie_observations(Observations(tie.photograph, tie.point, tie.pixel, tie.sigma_px))
    fixed = covariances(problem, state)
    counted = with_considered(problem, state)
    considered = fixed if counted is problem else covariances(counted, state)
    tested = reliability(problem, state, fixed, counted, considered)
    tested_fixed = tested if counted is problem else reliability(problem, state, fixed)
    sigma0, redundancy = sigma0_and_redundancy(problem, state)
    groups = solved.groups.select(mine)
    names = _median_sigmas(stated, groups) if settings.estimate_sigmas else None
    components = variance_components(problem, state, fixed, tested, redundancy, names)
    ties, scatters = None, list[AssumedScatter]()
    if settings.estimate_sigmas:
        # what is considered changes no estimate, so it changes no sigma either
        plain = (
            components if counted is problem else variance_components(problem, state, fixed, tested_fixed, redundancy)
        )
        of_ties = float(plain.redundancy[plain.group == "tie_points"].sum())
        taken = float(points_redundancy(problem, state).sum()) - of_ties
        ties = tie_scatter(problem, state, groups, solved.limit_px[mine], taken)
        scatters = assumed_scatters(problem, tested_fixed, stated)
    return Assessed(
        adjusted,
        kept,
        problem,
        state,
        fixed,
        counted,
        considered,
        tested,
        tested_fixed,
        sigma0,
        redundancy,
        components,
        ties,
        scatters,
    )


def _median_sigmas(stated: Block, groups: TieGroups) -> dict[str, float]:
    """Return the medians of the stated sigmas of the groups of variance components for which others are estimated."""
    medians = {"tie_points": float(np.median(groups.stated_px))} if len(groups.stated_px) else {}
    gnss = [p.gnss_sigma_m for p in stated.photographs if p.gnss_sigma_m is not None]
    if gnss:
        plan_and_height = np.array(gnss)
        medians["gnss_plan"] = float(np.median(plan_and_height[:, :2]))
        medians["gnss_height"] = float(np.median(plan_and_height[:, 2]))
    points = stated.control_points
    marks = points.mark_sigma_assumed[points.mark_point] & np.isfinite(points.mark_sigma_px)
    for name, values in (
        ("control_plan", points.sigma_m[:, :2][points.sigma_assumed[:, None] & points.used[:, :2]]),
        ("control_height", points.sigma_m[:, 2][points.sigma_assumed & points.used[:, 2]]),
        (
            "marks",
            points.mark_sigma_px[marks],
        ),
    ):
        if len(values):
            medians[name] = float(np.median(values))
    return medians
