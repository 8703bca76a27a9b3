"""Calibration in the field against the true camera: recovered where the geometry tells it, held where it does not."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2
from seeds import seeds

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.self_calibration import Held, _not_rolling, held_parameters, with_priors
from photogram.arrays import FloatArray
from photogram.camera import Camera, rotation_from_gimbal
from photogram.projection import PARAMETER_NAMES, READOUT, USUAL
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block, whole_survey_plan
from photogram.survey import Block

SETTINGS = AdjustmentSettings()
WIDE = (0.03 * 800 / 1.2, 8.0, 8.0, 0.1, 0.05, 0.02, 0.0, 0.002, 0.002, 0.0, 0.0)
LEVEL = replace(
    whole_survey_plan(800), strips=3, photographs_per_strip=5, calibration_source="laboratory",
    calibration_sigmas=WIDE, control_points=0, check_points=0, relief_m=0.0, attitude_noise_deg=0.5,
    position_noise_m=0.3,
)  # fmt: skip
OBLIQUE = replace(
    LEVEL, oblique_strip=True, oblique_angle_deg=30.0, relief_m=8.0, attitude_noise_deg=2.5, position_noise_m=1.0
)
SEEDS = seeds(25)
Z_99 = 2.576


@cache
def simulated(plan: SurveyPlan, seed: int) -> SimulatedBlock:
    return simulate_block(plan, seed, tie_points=250, start_position_sigma_m=0.5, start_attitude_sigma_deg=0.5)


def calibrate(
    block: Block, settings: AdjustmentSettings, kinds: Sequence[str], start: Sequence[FloatArray] = ()
) -> tuple[Adjustment, Held]:
    """The adjustment with the priors of a calibration in the field where ``kinds`` says auto, and what was held."""
    cameras = [with_priors(c) if kind == "auto" else c for c, kind in zip(block.cameras, kinds, strict=True)]
    result = adjust(replace(block, cameras=tuple(cameras)), settings, start=start)
    return result, held_parameters(cameras, result)


@cache
def calibrated(plan: SurveyPlan, seed: int) -> tuple[Adjustment, Held]:
    return calibrate(simulated(plan, seed).block, SETTINGS, ("auto",))


def sigma_of(result: Adjustment) -> FloatArray:
    return np.asarray(np.sqrt(np.diag(result.covariances.calibration[0]))[USUAL])


def error_of(plan: SurveyPlan, seed: int) -> FloatArray:
    result = calibrated(plan, seed)[0]
    return np.asarray((result.block.cameras[0].parameters - simulated(plan, seed).truth.camera.parameters)[USUAL])


def within_99(normalised: FloatArray) -> bool:
    low, high = (float(chi2.ppf(share, normalised.size)) for share in (0.005, 0.995))
    return bool(low < np.sum(normalised**2) < high)


# ---- where the geometry tells it -------------------------------------------------------------------------------------


def test_oblique_photographs_tell_a_camera_that_was_hardly_known() -> None:
    """3 % of the focal length, 0.1 of k1, which is 28 px in the corners: found to a fraction, and as well as
    predicted."""
    normalised = []
    for seed in SEEDS:
        result, held = calibrated(OBLIQUE, seed)
        sigma, error = sigma_of(result), error_of(OBLIQUE, seed)
        assert result.converged
        # k3 is small beside k1 and k2: that the photographs hardly tell it is so
        assert set(held["simulated"]) <= {"k3"}
        assert np.all(sigma[[0, 1, 2, 3, 6, 7]] < 0.3 * np.array([*WIDE, 0.0])[USUAL][[0, 1, 2, 3, 6, 7]])
        assert abs(error[0]) < 0.01 * OBLIQUE.focal_px
        assert abs(error[3]) < 0.02
        normalised.append(error / sigma)
    for k, name in enumerate(np.array(PARAMETER_NAMES)[USUAL]):
        assert within_99(np.array(normalised)[:, k]), name
    given = [abs(simulated(OBLIQUE, s).block.cameras[0].radial[0] - OBLIQUE.radial[0]) for s in SEEDS]
    assert max(given) > 0.1, "what was given was far off"


def test_an_exif_focal_length_without_distortion_is_enough() -> None:
    for seed in (1, 2, 3):
        plan = replace(OBLIQUE, calibration_source="exif", calibration_sigmas=whole_survey_plan(800).calibration_sigmas)
        block = simulated(plan, seed)
        assert block.block.cameras[0].parameters[3:].tolist() == [0.0] * 9
        result, _ = calibrated(plan, seed)
        sigma, error = sigma_of(result), error_of(plan, seed)
        assert np.abs(error / sigma).max() < 4.0
        assert abs(error[3]) < 0.02
        assert 0.9 < result.sigma0 < 1.1


def test_control_and_exact_positions_tell_the_focal_length_of_a_nadir_block() -> None:
    plan = replace(LEVEL, control_points=6, gnss_sigma_m=(0.02, 0.02, 0.03), gnss_offset_sigma_m=(0.0, 0.0, 0.0))
    result, held = calibrated(plan, 1)
    assert "focal_px" not in held["simulated"]
    assert sigma_of(result)[0] < 0.1 * WIDE[0]
    assert abs(error_of(plan, 1)[0]) < Z_99 * sigma_of(result)[0]


# ---- where it does not -----------------------------------------------------------------------------------------------


def test_the_focal_length_of_a_nadir_block_over_level_ground_is_held_by_its_prior() -> None:
    normalised = []
    for seed in SEEDS:
        result, held = calibrated(LEVEL, seed)
        reason = held["simulated"]["focal_px"]
        assert "in nadir imagery it cannot be separated from the flying height" in reason
        assert f"known to {WIDE[0]:.3g} beforehand, to {sigma_of(result)[0]:.3g} now" in reason
        assert 0.7 < sigma_of(result)[0] / WIDE[0] <= 1.0
        assert {"k1", "cx_px"}.isdisjoint(held["simulated"])
        normalised.append(error_of(LEVEL, seed)[0] / sigma_of(result)[0])
    # not told, but not run away either: the error is that of the prior
    assert within_99(np.array(normalised))


def test_what_is_held_stays_in_the_predicted_height() -> None:
    """The flying height over the ground is as uncertain as the focal length leaves it."""
    result, _ = calibrated(LEVEL, 1)
    tie = result.block.tie_points
    sigma = np.sqrt(np.median(result.covariances.tie_point_m2[:, 2, 2]))
    share = sigma_of(result)[0] / LEVEL.focal_px
    assert sigma > 0.8 * share * LEVEL.flying_height_m
    block = simulated(LEVEL, 1).block
    camera = replace(block.cameras[0], sigmas=np.zeros(12))
    known, _ = calibrate(replace(block, cameras=(camera,)), SETTINGS, ("auto",))
    assert len(tie) > 100
    assert np.sqrt(np.median(known.covariances.tie_point_m2[:, 2, 2])) < 0.8 * sigma


def test_parallel_strips_hold_what_they_cannot_tell() -> None:
    """A principal point that is known to half a pixel beforehand is no better known afterwards."""
    sigmas = (2.0, 0.5, 0.5, 0.004, 0.004, 0.0, 0.0, 0.00002, 0.00002, 0.0, 0.0)
    plan = replace(LEVEL, calibration_sigmas=sigmas)
    result, held = calibrated(plan, 1)
    assert np.all(sigma_of(result)[1:3] > 0.7 * 0.5)
    for name in ("cx_px", "cy_px", "p1", "p2"):
        assert "in parallel strips it cannot be separated from the attitudes" in held["simulated"][name]
    assert held["simulated"]["k3"] == "fixed at its given value"
    assert result.block.cameras[0].radial[2] == simulated(plan, 1).block.cameras[0].radial[2]
    crossed = replace(plan, oblique_strip=True, oblique_angle_deg=0.0)
    for name, reason in calibrated(crossed, 1)[1]["simulated"].items():
        assert "parallel strips" not in reason, name


# ---- priors and starts -----------------------------------------------------------------------------------------------


def test_priors_take_the_place_of_none() -> None:
    sigmas = np.array([np.inf, 3.0, np.inf, np.inf, 0.0, np.inf, 0.0, 0.001, np.inf, 0.0, 0.0, 0.0])
    camera = Camera("c", 4000, 3000, 3500.0, np.array([2000.0, 1500.0]), sigmas=sigmas)
    np.testing.assert_allclose(with_priors(camera).sigmas[USUAL], [350.0, 3.0, 200.0, 0.3, 0.0, 0.3, 0.001, 0.01])
    np.testing.assert_array_equal(with_priors(camera).parameters, camera.parameters)


def freed(block: Block) -> Block:
    """The same block, nothing known of its camera but the values it starts from."""
    return replace(block, cameras=(replace(block.cameras[0], sigmas=np.where(USUAL, np.inf, 0.0)),))


def test_given_sigmas_are_taken_as_they_are() -> None:
    block = freed(simulated(OBLIQUE, 2).block)
    given, held = calibrate(block, SETTINGS, ("given",))
    assert held == {"simulated": {}}
    auto, _ = calibrate(block, SETTINGS, ("auto",))
    assert np.all(sigma_of(auto) < sigma_of(given))
    prior = with_priors(block.cameras[0]).sigmas[USUAL]
    # information of the photographs and of the prior add up
    for k in (5,):
        assert sigma_of(auto)[k] ** -2 == pytest.approx(sigma_of(given)[k] ** -2 + prior[k] ** -2, rel=0.3)
    fixed = replace(block, cameras=(replace(block.cameras[0], sigmas=np.zeros(12)),))
    result, held = calibrate(fixed, SETTINGS, ("auto",))
    assert set(held["simulated"]) == set(np.array(PARAMETER_NAMES)[USUAL]), "k4, b1 and b2 take no part at all"
    np.testing.assert_array_equal(result.block.cameras[0].parameters, block.cameras[0].parameters)


@pytest.mark.parametrize("plan", [OBLIQUE, LEVEL])
def test_where_it_starts_does_not_matter_what_is_known_does(plan: SurveyPlan) -> None:
    """The prior stays that of the given camera, not of what growth made of it."""
    block, (plain, _) = simulated(plan, 3), calibrated(plan, 3)
    start = block.truth.camera.parameters * [1.02, 1, 1, 0.8, *[1] * 8]
    result, held = calibrate(block.block, SETTINGS, ("auto",), (start,))
    assert result.converged
    difference = (result.block.cameras[0].parameters - plain.block.cameras[0].parameters)[USUAL]
    assert np.abs(difference / sigma_of(plain)).max() < 0.02
    assert held.keys() == {"simulated"}


def test_each_camera_is_judged_by_its_own_photographs() -> None:
    """Nadir photographs by one camera, oblique ones by the other."""
    block = simulated(replace(OBLIQUE, relief_m=0.0, attitude_noise_deg=0.5), 1).block
    first = replace(block.cameras[0], name="nadir")
    second = replace(block.cameras[0], name="oblique")
    photographs = tuple(replace(p, camera=int(i >= 15)) for i, p in enumerate(block.photographs))
    result, held = calibrate(replace(block, cameras=(first, second), photographs=photographs), SETTINGS, ("auto",) * 2)
    assert result.converged
    assert set(held) == {"nadir", "oblique"}
    for reason in held["oblique"].values():
        assert "nadir imagery" not in reason
    assert result.block.cameras[0].focal_px != result.block.cameras[1].focal_px


def test_a_camera_without_photographs_is_held() -> None:
    block = simulated(LEVEL, 1).block
    spare = replace(block.cameras[0], name="spare")
    result, held = calibrate(replace(block, cameras=(*block.cameras, spare)), SETTINGS, ("auto", "auto"))
    np.testing.assert_allclose(result.block.cameras[1].parameters, spare.parameters)
    assert set(held["spare"]) == set(PARAMETER_NAMES)
    for reason in held["spare"].values():
        assert "no photograph" in reason


def test_a_photograph_left_out_does_not_make_a_nadir_block_oblique() -> None:
    block = simulated(LEVEL, 1).block
    oblique = rotation_from_gimbal(0.0, -40.0, 0.0)
    poses = (None, *block.poses[1:])
    tagged = replace(block.photographs[0], attitude_world_from_camera=oblique)
    result, held = calibrate(
        replace(block, poses=poses, photographs=(tagged, *block.photographs[1:])), SETTINGS, ("auto",)
    )
    assert result.block.poses[0] is None
    assert "nadir imagery" in held["simulated"]["focal_px"]


def test_a_read_out_time_that_is_none_is_said_in_milliseconds() -> None:
    result = calibrated(LEVEL, 0)[0]
    of_two = replace(result.decisions, readout_s=np.array([np.nan, 0.0004]), readout_sigma_s=np.array([1.0, 0.0015]))
    said = [_not_rolling(replace(result, decisions=of_two), camera) for camera in (0, 1)]
    assert "nothing tells how the photographs moved" in said[0]
    assert "0.4 ± 1.5 ms" in said[1]


def test_a_read_out_time_that_was_free_and_is_none_was_held() -> None:
    camera, result = simulated(LEVEL, 0).block.cameras[0], calibrated(LEVEL, 0)[0]
    sigmas, known = camera.sigmas.copy(), result.covariances.calibration.copy()
    sigmas[READOUT], known[0, READOUT] = 0.02, 0.0
    known[0, :, READOUT] = 0.0
    told = replace(result, covariances=replace(result.covariances, calibration=known))
    why = held_parameters([replace(camera, sigmas=sigmas)], told)[camera.name]
    assert why["readout_s"] == "nothing tells how the photographs moved: held at 0"
