"""The end of an adjustment, and its result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photogram.adjustment.assessment import Assessed
from photogram.adjustment.common_errors import estimates, residual_lever_arm
from photogram.adjustment.constraint_tests import constraint_tests
from photogram.adjustment.gnss_offsets import implied_offsets
from photogram.adjustment.ground_points import ground_points, mark_residuals_px, unmet
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.rigs.exposure_tests import exposure_tests
from photogram.adjustment.rounds import Solved
from photogram.adjustment.shutters.rolling_shutter import Shutters
from photogram.adjustment.solutions.unknowns import Unknowns
from photogram.adjustment.solvability import weak_parts
from photogram.adjustment.stochastic_model.assumed_sigmas import assumed_table
from photogram.adjustment.stochastic_model.estimated_sigmas import joined, scattering, table
from photogram.arrays import FloatArray
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.free_network import relative_covariances
from photogram.factors.graph import Problem
from photogram.factors.joint_covariance import joint_ground_covariance, ray_covariances
from photogram.projection import PARAMETERS
from photogram.results import Adjustment, AdjustmentCovariances, Decisions, EstimatedSigmas, Estimates, StatisticalTests
from photogram.survey import Block


@dataclass(frozen=True, eq=False)
class Ended:
    """The end of an adjustment of a ``block``: the problem as stated, its solution, what that is worth, and the
    shutters as they were found."""

    block: Block
    whole: Problem
    solved: Solved
    assessment: Assessed
    unknowns: Unknowns
    shutters: Shutters


def _field_covariances(covariances: Covariances, cameras: int) -> FloatArray:
    """Return the covariances (cameras, K, K) of the coefficients of lens fields, (0, 0, 0) without any."""
    if covariances.layout.unit.shape[1] == PARAMETERS:
        return np.zeros((0, 0, 0))
    return np.array([covariances.lens(c)[PARAMETERS:, PARAMETERS:] for c in range(cameras)])


def adjustment_of(ended: Ended, settings: AdjustmentSettings) -> Adjustment:
    """Return the result of an adjustment, with what it is worth."""
    block, solved, assessment = ended.block, ended.solved, ended.assessment
    final, final_state = assessment.problem, assessment.state
    state, tie = solved.minimum.state, assessment.block.tie_points
    fixed, covariances, counted = assessment.fixed, assessment.covariances, assessment.counted
    ground, ground_covariance = ground_points(final, final_state, covariances)
    estimated = EstimatedSigmas.none()
    if settings.estimate_sigmas:
        groups = solved.groups.select(assessment.kept[solved.whole.tie.point] & solved.used)
        ties = table(block, groups, solved.factors, assessment.ties)
        estimated = joined(ties, assumed_table(block, assessment.block, assessment.assumed))
    poses, tie_covariance = covariances.poses, covariances.tie_point
    joint = joint_ground_covariance(counted, final_state, covariances, ground)
    if block.is_free:
        relative = relative_covariances(counted, final_state, covariances, ground, joint)
        poses, tie_covariance = relative.poses, relative.tie_point
        joint = relative.ground
        own = np.arange(3 * len(ground)).reshape(-1, 3)
        ground_covariance = joint[own[:, :, None], own[:, None, :]]
    R = state.rotation
    flights_without_offset, implied, implied_covariance = implied_offsets(final, final_state, fixed)
    arm = residual_lever_arm(final, final_state, fixed)
    tie_residual = residuals(final.tie, state.cameras, tie.position_world_m)
    return Adjustment(
        block=assessment.block,
        sigma0=assessment.sigma0,
        redundancy=assessment.redundancy,
        iterations=solved.iterations,
        rounds=solved.rounds,
        converged=solved.minimum.converged,
        cost=solved.minimum.cost,
        estimates=Estimates(
            residual_px=tie_residual * tie.sigma_px[:, None],
            mark_residual_px=mark_residuals_px(block, ground, state),
            ground_world_m=ground,
            flights=final.flights,
            offset_world_m=state.offset,
            held_world_m=final.control_world_m,
            held_axes=final.control_axes,
        ),
        covariances=AdjustmentCovariances(
            position_m2=R @ poses[:, 3:, 3:] @ R.transpose(0, 2, 1),
            rotation_rad2=poses[:, :3, :3],
            calibration=np.array([covariances.calibration(c) for c in range(len(block.cameras))]),
            tie_point_m2=tie_covariance,
            tie_point_ray_m2=ray_covariances(final, final_state),
            ground_m2=ground_covariance,
            ground_joint_m2=joint,
            offset_m2=np.array([covariances.offset(f) for f in range(len(final.flights))]).reshape(-1, 3, 3),
            lens_field_px2=_field_covariances(covariances, len(block.cameras)),
        ),
        tests=StatisticalTests(
            reliability=assessment.tested,
            components=assessment.components,
            constraints=constraint_tests(final, final_state, fixed, counted, covariances, ground),
            exposures=exposure_tests(final, final_state, fixed, counted, covariances),
            implied_offset_world_m=implied,
            implied_offset_covariance_m2=implied_covariance,
            residual_lever_arm_m=arm.arm_camera_m,
            residual_lever_arm_sigma_m=arm.sigma_m,
            residual_lever_arm_p=arm.p,
        ),
        decisions=Decisions(
            flights_without_offset=flights_without_offset,
            common_errors=estimates(final, final_state, fixed, covariances, dict(ended.unknowns.as_well)),
            sigmas=estimated,
            rejected_observations=int(np.count_nonzero(~solved.used)),
            rejected_points=int(np.count_nonzero(~assessment.kept)),
        ),
        warnings=(*unmet(block, ground), *weak_parts(counted, final_state, covariances), *scattering(estimated)),
    )
