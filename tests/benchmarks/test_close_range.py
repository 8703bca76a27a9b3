"""Close-range photographs without any georeference: relative precision is what errors show, from both sides, and one
known distance gives the scale. The figures of fifty surveys are in benchmarks/free_network.py."""

from dataclasses import replace

import numpy as np
import pytest
from lib.simulated.close_range import CloseRange, simulate_close_range

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.adjustment.solvability import check_determined
from photogram.arrays import FloatArray
from photogram.constraints.between_points import Distance
from photogram.errors import AdjustmentError
from photogram.factors.covariance import covariances
from photogram.factors.graph import IndeterminateError
from photogram.geodesy.frames import LocalFrame
from photogram.results import Adjustment

SEEDS = 12
BAR_SIGMA_M = 0.002
SETTINGS = AdjustmentSettings(robust_loss="none", outlier_threshold=20.0, estimate_sigmas=False)


def normalised_square(error: FloatArray, covariance: FloatArray) -> float:
    solved = np.linalg.solve(covariance, error[..., None])[..., 0]
    return float(np.mean(np.einsum("ni,ni->n", error, solved)) / error.shape[1])


def adjusted(sigma_m: float | None) -> list[tuple[CloseRange, Adjustment]]:
    made = [simulate_close_range(seed, distance_sigma_m=sigma_m, tie_points=60) for seed in range(SEEDS)]
    return [(survey, adjust(survey.block, SETTINGS)) for survey in made]


@pytest.mark.parametrize("sigma_m", [None, BAR_SIGMA_M], ids=["without scale", "one distance"])
def test_relative_precision_is_what_errors_show(sigma_m: float | None) -> None:
    squares, z = np.zeros((SEEDS, 4)), np.zeros(SEEDS)
    for n, (survey, result) in enumerate(adjusted(sigma_m)):
        assert result.converged
        # the conditions of the datum add what the open directions take; the calibration has four priors
        photographs, points = 8, 64
        image = 2 * photographs * points
        assert result.redundancy == image - 6 * photographs - 3 * points + 7
        pose, tie, marked = survey.errors(result)
        R = np.array([p.rotation_world_from_camera for p in result.block.poses if p is not None])
        centre = np.einsum("nij,nj->ni", R, pose[:, 3:])
        squares[n] = (
            normalised_square(centre, result.covariances.position_m2),
            normalised_square(pose[:, :3], result.covariances.rotation_rad2),
            normalised_square(tie, result.covariances.tie_point_m2),
            normalised_square(marked, result.covariances.ground_m2),
        )
        joint = result.covariances.ground_joint_m2.reshape(4, 3, 4, 3)
        apart = result.estimates.ground_world_m[2] - result.estimates.ground_world_m[3]
        along = apart / np.linalg.norm(apart)
        C = joint[2, :, 2] + joint[3, :, 3] - joint[2, :, 3] - joint[3, :, 2]
        true_m = float(np.linalg.norm(survey.marked_m[2] - survey.marked_m[3]))
        z[n] = (np.linalg.norm(apart) - true_m) / np.sqrt(along @ C @ along)
    mean, sigma = squares.mean(axis=0), squares.std(axis=0) / np.sqrt(SEEDS)
    assert np.all(np.abs(mean - 1.0) < 3.5 * sigma), (mean, sigma)
    # by poses, attitudes, tie points, marked points; with a distance all of a survey share its scale
    assert np.all(sigma < ([0.15, 0.35, 0.06, 0.2] if sigma_m is None else [0.2, 0.35, 0.2, 0.25]))
    if sigma_m is not None:
        assert 0.5 < np.std(z) < 1.6
        assert abs(np.mean(z)) < 3.0 / np.sqrt(SEEDS)


def test_the_unit_of_the_start_changes_nothing() -> None:
    small, large = (
        adjust(simulate_close_range(3, distance_sigma_m=BAR_SIGMA_M, tie_points=60, unit_m=unit).block, SETTINGS)
        for unit in (0.05, 20.0)
    )
    for result in (small, large):
        length = float(np.linalg.norm(result.estimates.ground_world_m[0] - result.estimates.ground_world_m[1]))
        (measured,) = result.block.constraints
        assert isinstance(measured, Distance)
        assert length == pytest.approx(measured.length_m, abs=1e-6)
    sigmas = [np.linalg.eigvalsh(result.covariances.tie_point_m2) for result in (small, large)]
    np.testing.assert_allclose(sigmas[0], sigmas[1], rtol=1e-2)


def test_a_distance_between_photographs_gives_the_scale_as_well() -> None:
    survey = simulate_close_range(5, tie_points=60)
    length_m = float(np.linalg.norm(survey.centre_m[0] - survey.centre_m[-1]))
    bar = Distance(ends=("photograph1", "photograph8"), of_photographs=True, length_m=length_m, sigma_m=0.001)
    block = adjust(replace(survey.block, constraints=(bar,)), SETTINGS).block
    first, last = (pose.position_world_m for pose in (block.poses[0], block.poses[-1]) if pose is not None)
    assert np.linalg.norm(last - first) == pytest.approx(length_m, abs=1e-6)


def test_two_distances_that_contradict_each_other_show_in_their_group() -> None:
    survey = simulate_close_range(5, distance_sigma_m=BAR_SIGMA_M, tie_points=60)
    true_m = float(np.linalg.norm(survey.marked_m[2] - survey.marked_m[3]))
    for off_m, significant in ((0.0, False), (0.05, True)):
        second = Distance(ends=("C", "D"), length_m=true_m + off_m, sigma_m=BAR_SIGMA_M)
        result = adjust(replace(survey.block, constraints=(*survey.block.constraints, second)), SETTINGS)
        number = result.tests.components.group.tolist().index("distances")
        assert result.tests.components.observations[number] == 2
        assert result.tests.components.redundancy[number] == pytest.approx(1.0, abs=0.05)
        assert (result.tests.components.squares[number] > 15.0) == significant


def test_attitudes_do_not_strain_a_free_network() -> None:
    survey = simulate_close_range(2, tie_points=60)
    tilted = tuple(
        replace(p, attitude_world_from_camera=np.eye(3), attitude_sigma_rad=0.01) for p in survey.block.photographs
    )
    result = adjust(replace(survey.block, photographs=tilted), SETTINGS)
    assert result.sigma0 == pytest.approx(adjust(survey.block, SETTINGS).sigma0, rel=1e-9)


@pytest.mark.parametrize(
    ("known", "parts"),
    [
        (0, "its position in plan, its height, its heading, its scale and its tilt"),
        (1, "its heading, its scale and its tilt"),
        (2, "its tilt about the line between them"),
    ],
)
def test_the_fault_of_a_block_with_too_little_control_names_what_is_open(known: int, parts: str) -> None:
    survey = simulate_close_range(1, tie_points=60)
    points = survey.block.control_points
    position, sigma = points.position_world_m.copy(), points.sigma_m.copy()
    position[:known], sigma[:known] = survey.marked_m[:known], 0.01
    placed = replace(
        survey.block,
        frame=LocalFrame("EPSG:25832", (5e5, 5.7e6, 0.0), "grid"),
        control_points=replace(points, position_world_m=position, sigma_m=sigma),
    )
    with pytest.raises(AdjustmentError) as fault:
        check_determined(make_problem(placed, SETTINGS))
    assert f"leave {parts} open" in str(fault.value)


def test_without_its_conditions_a_free_network_has_no_solution() -> None:
    survey = simulate_close_range(1, tie_points=60)
    result = adjust(survey.block, SETTINGS)
    problem = make_problem(replace(result.block, cameras=survey.block.cameras), SETTINGS)
    with pytest.raises(IndeterminateError):
        covariances(replace(problem, further=()), start_state(problem))
