from dataclasses import replace

import numpy as np
import pytest
from makers import LEAST_SQUARES, WIDE, simulated
from referees import gtsam_marginals

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import make_problem, minimise, start_state
from photogram.arrays import FloatArray
from photogram.camera import (
    Camera,
    LensField,
    Pose,
    calibration_sigmas,
    calibrations,
    distort,
    field_at,
    oriented_by,
    project_points,
    undistort,
    unproject,
)
from photogram.factors.covariance import covariances
from photogram.factors.elimination.reprojection import Observations, linearise, residuals
from photogram.factors.graph import Problem
from photogram.factors.variables import CALIBRATION, POSE, TIE_POINT, key
from photogram.lens.fields import COLUMNS, ROWS, free_field, nodes_px, rms_px, rms_sigma_px
from photogram.projection import PARAMETERS, without_fields
from photogram.simulation.simulated_survey import SimulatedBlock
from photogram.simulation.survey_plan import SurveyPlan

POSE_ABOVE = Pose(np.diag([1.0, -1.0, -1.0]), np.array([3.0, 4.0, 60.0]))


def with_field(camera: Camera, seed: int = 1, expected_px: float = 0.3) -> Camera:
    """Return a camera with a field that its own prior draws."""
    field = free_field(camera, expected_px)
    drawn = field.sigmas * np.random.default_rng(seed).standard_normal(len(field.sigmas))
    return replace(camera, field=replace(field, coefficients=drawn))


def anywhere(camera: Camera, count: int = 500, seed: int = 3) -> FloatArray:
    return np.random.default_rng(seed).uniform(-0.5, [camera.width_px - 0.5, camera.height_px - 0.5], (count, 2))


def test_a_field_has_the_rms_of_its_coefficients_and_is_bilinear_between_its_nodes() -> None:
    camera = with_field(WIDE)
    assert camera.field is not None
    nodes = nodes_px(camera)
    at_nodes = field_at(camera, nodes.reshape(-1, 2)).reshape(ROWS, COLUMNS, 2)
    np.testing.assert_allclose(at_nodes, camera.field.shift, atol=1e-12)
    middles = 0.25 * (nodes[:-1, :-1] + nodes[1:, :-1] + nodes[:-1, 1:] + nodes[1:, 1:])
    means = 0.25 * (at_nodes[:-1, :-1] + at_nodes[1:, :-1] + at_nodes[:-1, 1:] + at_nodes[1:, 1:])
    np.testing.assert_allclose(field_at(camera, middles.reshape(-1, 2)), means.reshape(-1, 2), atol=1e-12)
    over_the_picture = field_at(camera, anywhere(camera, 40_000))
    assert np.sqrt(np.mean(over_the_picture**2)) == pytest.approx(rms_px(camera.field), rel=0.03)
    beyond = np.array([[-100.0, 1500.0], [4100.0, 3100.0]])
    edge = np.array([[-0.5, 1500.0], [3999.5, 2999.5]])
    np.testing.assert_array_equal(field_at(camera, beyond), field_at(camera, edge))


def test_a_point_is_shown_where_the_measured_pixel_less_the_field_is_its_projection() -> None:
    camera = with_field(WIDE)
    bare, pixel = replace(camera, field=None), anywhere(camera)
    ray = unproject(camera, pixel)
    points = POSE_ABOVE.world_from_camera(50.0 * ray / ray[:, 2:])
    np.testing.assert_allclose(project_points(camera, POSE_ABOVE, points), pixel, atol=2e-5)
    np.testing.assert_allclose(project_points(bare, POSE_ABOVE, points), pixel - field_at(camera, pixel), atol=1e-8)
    np.testing.assert_allclose(distort(camera, undistort(camera, pixel)), pixel, atol=2e-5)
    assert np.abs(field_at(camera, pixel)).max() > 0.3


def test_measurements_less_the_fields_of_their_cameras() -> None:
    cameras, pixel = [WIDE, with_field(WIDE)], anywhere(WIDE, 40)
    measured, photograph = np.column_stack([pixel, np.full(40, 2.0)]), np.arange(40) % 2
    shown = oriented_by(cameras, np.array([0, 1]), [POSE_ABOVE, POSE_ABOVE])
    expected = pixel - np.where(photograph[:, None] == 1, field_at(cameras[1], pixel), 0.0)
    found = without_fields(shown, photograph, measured)
    np.testing.assert_array_equal(found[:, :2], expected)
    np.testing.assert_array_equal(found[:, 2], 2.0)
    without = oriented_by(cameras[:1], np.zeros(2, np.int64), [POSE_ABOVE, POSE_ABOVE])
    assert without_fields(without, photograph, measured) is measured


def test_a_fixed_field_of_zero_changes_no_bit() -> None:
    field = free_field(WIDE, 0.3)
    zero = replace(WIDE, field=field.fixed)
    pixel = anywhere(WIDE)
    ray = unproject(WIDE, pixel)
    points = POSE_ABOVE.world_from_camera(50.0 * ray)
    np.testing.assert_array_equal(project_points(zero, POSE_ABOVE, points), project_points(WIDE, POSE_ABOVE, points))
    np.testing.assert_array_equal(undistort(zero, pixel), undistort(WIDE, pixel))


def test_residuals_are_linear_in_the_coefficients_and_their_jacobian_is_that_of_differences() -> None:
    camera = with_field(WIDE)
    assert camera.field is not None
    pixel = anywhere(camera, 30)
    points = POSE_ABOVE.world_from_camera(50.0 * unproject(WIDE, pixel))
    zero = np.zeros(30, dtype=np.int64)
    observed = Observations(zero, np.arange(30), pixel, np.full(30, 0.5))

    def whitened(camera: Camera) -> FloatArray:
        return residuals(observed, oriented_by([camera], zero[:1], [POSE_ABOVE]), points)

    linear = linearise(observed, oriented_by([camera], zero[:1], [POSE_ABOVE]), points)
    np.testing.assert_allclose(linear.residual, whitened(camera), atol=1e-12)
    for k in (0, 7, len(camera.field.coefficients) - 1):
        moved = camera.field.coefficients.copy()
        moved[k] += 0.8
        change = whitened(replace(camera, field=replace(camera.field, coefficients=moved))) - whitened(camera)
        np.testing.assert_allclose(0.8 * linear.calibration[:, :, PARAMETERS + k], change, atol=1e-10)


def test_parameters_of_cameras_with_and_without_a_field_stand_in_one_table() -> None:
    cameras = with_field(WIDE), replace(WIDE, name="other")
    assert cameras[0].field is not None
    table, sigmas = calibrations(cameras), calibration_sigmas(cameras)
    count = len(cameras[0].field.coefficients)
    assert table.shape == sigmas.shape == (2, PARAMETERS + count)
    np.testing.assert_array_equal(table[0, PARAMETERS:], cameras[0].field.coefficients)
    assert not table[1, PARAMETERS:].any()
    assert not sigmas[1, PARAMETERS:].any()
    again = cameras[0].with_parameters(2.0 * table[0])
    assert again.field is not None
    np.testing.assert_array_equal(again.field.coefficients, 2.0 * cameras[0].field.coefficients)
    assert cameras[1].with_parameters(table[1]).field is None
    with pytest.raises(ValueError, match="coefficients of a lens field, expected 0"):
        cameras[1].with_parameters(table[0])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"coefficients": np.zeros(2)}, "as many coefficients"),
        ({"sigmas": np.append(np.zeros(5), 1.0)}, "all fixed or all free"),
        ({"functions": np.zeros((1, 4, 2, 6))}, "at least 2"),
    ],
)
def test_a_field_that_is_none_is_refused(change: dict[str, FloatArray], said: str) -> None:
    field = LensField(np.zeros((3, 4, 2, 6)), np.zeros(6), np.ones(6))
    with pytest.raises(ValueError, match=said):
        replace(field, **change)


# ---- the joint adjustment -------------------------------------------------------------------------------------------

PLAN = SurveyPlan(strips=2, photographs_per_strip=4, control_points=5, check_points=2)


def bent(made: SimulatedBlock, camera: Camera) -> SimulatedBlock:
    """Return a simulated block as a lens with the field of ``camera`` shows it, whose cameras have that field free."""
    assert camera.field is not None
    block, tie, points = made.block, made.block.tie_points, made.block.control_points
    free = replace(camera.field, coefficients=np.zeros_like(camera.field.coefficients))
    return replace(
        made,
        block=replace(
            block,
            cameras=tuple(replace(c, field=free) for c in block.cameras),
            tie_points=replace(tie, pixel=tie.pixel + field_at(camera, tie.pixel)),
            control_points=replace(points, mark_pixel=points.mark_pixel + field_at(camera, points.mark_pixel)),
        ),
    )


def small(seed: int = 1, tie_points: int = 120) -> tuple[Problem, SimulatedBlock, Camera]:
    made = simulated(PLAN, seed, tie_points=tie_points)
    camera = with_field(made.block.cameras[0], seed)
    made = bent(made, camera)
    return make_problem(made.block, LEAST_SQUARES), made, camera


def test_both_engines_reach_the_same_minimum_with_a_field() -> None:
    problem, _, _ = small()
    start = start_state(problem)
    fast, slow = (
        minimise(problem, start, replace(LEAST_SQUARES, engine=engine, relative_tolerance=1e-14))
        for engine in ("fast", "reference")
    )
    assert fast.converged
    assert slow.converged
    assert fast.cost == pytest.approx(slow.cost, rel=1e-9)
    sigma = np.sqrt(np.diag(covariances(problem, fast.state).lens(0)))
    assert np.all(sigma[PARAMETERS:] > 0.0)
    off = np.abs(fast.state.parameters[0] - slow.state.parameters[0])
    assert np.all(off <= 1e-4 * sigma)
    np.testing.assert_allclose(fast.state.position, slow.state.position, atol=1e-6)
    np.testing.assert_allclose(fast.state.tie_point, slow.state.tie_point, atol=1e-5)


def test_covariances_with_a_field_are_gtsams_marginals() -> None:
    problem, _, _ = small(2, 60)
    state = minimise(problem, start_state(problem), LEAST_SQUARES).state
    found = covariances(problem, state)
    marginals = gtsam_marginals(problem, state)
    free, unit = problem.free[0], problem.scale[0]
    lens = marginals.marginalCovariance(key(CALIBRATION, 0)) * np.outer(unit[free], unit[free])
    assert len(free) > 20
    np.testing.assert_allclose(found.lens(0)[np.ix_(free, free)], lens, rtol=1e-5, atol=1e-9 * np.abs(lens).max())
    for i in (0, 5):
        expected = marginals.marginalCovariance(key(POSE, i))
        np.testing.assert_allclose(found.pose(i), expected, rtol=1e-5, atol=1e-8 * np.abs(expected).max())
    for p in np.unique(problem.tie.point)[[0, 20]].tolist():
        expected = marginals.marginalCovariance(key(TIE_POINT, p))
        np.testing.assert_allclose(found.tie_point[p], expected, rtol=1e-5, atol=1e-8 * np.abs(expected).max())


def test_coefficients_are_as_uncertain_as_predicted() -> None:
    squares, count = 0.0, 0
    for seed in range(1, 7):
        problem, _, camera = small(seed, 300)
        assert camera.field is not None
        state = minimise(problem, start_state(problem), LEAST_SQUARES).state
        covariance = covariances(problem, state).lens(0)[PARAMETERS:, PARAMETERS:]
        off = state.parameters[0, PARAMETERS:] - camera.field.coefficients
        squares += float(off @ np.linalg.solve(covariance, off))
        count += len(off)
        assert rms_sigma_px(covariance) < 0.6 * rms_px(camera.field)
    assert squares / count == pytest.approx(1.0, abs=0.35)


def test_residuals_and_ground_follow_a_lens_that_only_a_field_describes() -> None:
    made = simulated(replace(PLAN, strips=3, photographs_per_strip=6), 4, tie_points=500)
    camera = with_field(made.block.cameras[0], seed=5, expected_px=1.2)
    made = bent(made, camera)
    bare = replace(made.block, cameras=tuple(replace(c, field=None) for c in made.block.cameras))
    without, found = adjust(bare, LEAST_SQUARES), adjust(made.block, LEAST_SQUARES)
    assert found.sigma0 == pytest.approx(1.0, abs=0.05)
    assert without.sigma0 > 1.3
    truth = made.tie_point_position_world_m
    off = [np.sqrt(np.mean((r.block.tie_points.position_world_m - truth) ** 2)) for r in (without, found)]
    assert off[1] < 0.5 * off[0]
    sigma = np.sqrt(np.einsum("pii->pi", found.covariances.tie_point_m2))
    z = np.sqrt(np.mean(((found.block.tie_points.position_world_m - truth) / sigma) ** 2))
    assert 0.6 < z < 1.4
    assert found.covariances.lens_field_px2.shape[0] == len(made.block.cameras)
    assert without.covariances.lens_field_px2.shape == (0, 0, 0)
