"""Heights whose sigmas count what the camera model leaves out."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.quality import improvements
from photogram.quality.deformation import DOME, height_modes, height_shapes
from photogram.quality.improvements import block_deformation
from photogram.quality.model_error import with_model_error
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block

PLAN = SurveyPlan(strips=3, photographs_per_strip=5, control_points=5, check_points=4)


@cache
def adjusted(pattern_px: float, seed: int = 3) -> Adjustment:
    """Adjust a block whose pictures share a wave of an amplitude, with its deformation as the stage computes it."""
    block = simulate_block(PLAN, seed, tie_points=1500, sigma_px=0.3, start_position_sigma_m=0.2).block
    tie, length = block.tie_points, PLAN.width_px / 2
    wave = pattern_px * np.sin(2 * np.pi * tie.pixel[:, ::-1] / length)
    block = replace(block, tie_points=replace(tie, pixel=tie.pixel + wave))
    result = adjust(block, AdjustmentSettings())
    known = [camera.parameters for camera in block.cameras]
    return replace(
        result,
        covariances=replace(result.covariances, deformation=block_deformation(result, AdjustmentSettings(), known)),
    )


def height_variances(result: Adjustment) -> FloatArray:
    return np.asarray(result.covariances.tie_point_m2[:, 2, 2])


def test_shapes_and_modes_are_inverse_to_each_other() -> None:
    xy = np.random.default_rng(1).uniform(-50.0, 80.0, (200, 2))
    centre = np.array([10.0, 5.0])
    shapes = height_shapes(xy, centre, 60.0, xy)
    np.testing.assert_allclose(height_modes(xy, centre, 60.0) @ shapes, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(shapes[:, 1:].mean(axis=0), 0.0, atol=1e-12)


def test_a_sound_camera_changes_nothing() -> None:
    result = adjusted(0.0)
    assert with_model_error(result) is result


def test_heights_count_a_pattern_and_nothing_else_does() -> None:
    result = adjusted(0.8)
    counted = with_model_error(result)
    pattern_m2 = result.covariances.deformation.model_error_covariance_m2
    assert np.all(np.diag(pattern_m2) > 0.0)
    np.testing.assert_allclose(pattern_m2, pattern_m2.T, rtol=1e-9)
    added = height_variances(counted) - height_variances(result)
    known = result.covariances.deformation
    shapes = height_shapes(
        result.block.tie_points.position_world_m[:, :2], known.centre_world_m, known.radius_m,
        known.place_world_m[:, :2],
    )  # fmt: skip
    np.testing.assert_allclose(added, np.einsum("pk,kl,pl->p", shapes, pattern_m2, shapes), rtol=1e-6)
    for name in ("tie_point_m2", "ground_m2"):
        before, after = getattr(result.covariances, name).copy(), getattr(counted.covariances, name).copy()
        before[:, 2, 2] = after[:, 2, 2] = 0.0
        np.testing.assert_array_equal(before, after)
    np.testing.assert_array_equal(result.estimates.ground_world_m, counted.estimates.ground_world_m)


def test_the_joint_covariance_is_that_of_each_point_and_holds_what_they_share() -> None:
    counted = with_model_error(adjusted(0.8))
    joint = counted.covariances.ground_joint_m2
    own = np.array([joint[3 * g : 3 * g + 3, 3 * g : 3 * g + 3] for g in range(len(counted.estimates.ground_world_m))])
    np.testing.assert_allclose(own, counted.covariances.ground_m2, rtol=1e-4, atol=1e-9)
    assert np.linalg.eigvalsh(joint).min() > 0.0
    before = adjusted(0.8).covariances.ground_joint_m2
    difference = np.zeros(len(joint))
    difference[2], difference[5] = 1.0, -1.0
    more, singly = joint - before, (joint - before)[[2, 5], [2, 5]].sum()
    assert difference @ more @ difference < 2.0 * singly  # far less than two independent errors with opposite signs


def test_the_deformation_holds_it_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modes, places, shape and their summaries grow by the same covariance, and the shape by that without its mean."""
    result = adjusted(0.8)
    counted = result.covariances.deformation
    monkeypatch.setattr(improvements, "pattern_covariance_m2", lambda *_: np.zeros((4, 4)))
    cameras = [camera.parameters for camera in result.block.cameras]
    plain = improvements.block_deformation(
        replace(result, covariances=replace(result.covariances, deformation=counted)), AdjustmentSettings(), cameras
    )
    pattern_m2 = counted.model_error_covariance_m2
    relative_m2 = pattern_m2.copy()
    relative_m2[0], relative_m2[:, 0] = 0.0, 0.0
    modes = np.zeros_like(plain.covariance)
    modes[2 : DOME + 1, 2 : DOME + 1] = pattern_m2
    np.testing.assert_allclose(counted.covariance - plain.covariance, modes, atol=1e-12)

    def shapes(xy: FloatArray) -> FloatArray:
        return height_shapes(xy, counted.centre_world_m, counted.radius_m, counted.place_world_m[:, :2])

    at = shapes(counted.place_world_m[:, :2])
    more = counted.shape_covariance_m2 - plain.shape_covariance_m2
    np.testing.assert_allclose(more[:, 2, 2], np.einsum("pk,kl,pl->p", at, relative_m2, at), atol=1e-12)
    ground = counted.ground_covariance_m2 - plain.ground_covariance_m2
    at = shapes(counted.ground_place_world_m[:, :2])
    np.testing.assert_allclose(ground[2::3, 2::3], at @ pattern_m2 @ at.T, atol=1e-12)
    absolute, relative = (
        getattr(counted, name)[2] ** 2 - getattr(plain, name)[2] ** 2
        for name in ("absolute_sigma_m", "relative_sigma_m")
    )
    mean_square = np.mean(counted.height_sigma_m**2 - plain.height_sigma_m**2)
    assert absolute == pytest.approx(mean_square, rel=1e-9)
    assert 0.0 < relative < absolute
    np.testing.assert_array_equal(counted.absolute_sigma_m[:2], plain.absolute_sigma_m[:2])
