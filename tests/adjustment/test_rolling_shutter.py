"""Rolling shutters in the adjustment: read-out times against simulated truth, none where there is none, velocities."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.adjustment.self_calibration import held_parameters
from photogram.adjustment.shutters.rolling_shutter import (
    SURE,
    as_decided,
    in_motion,
    is_clear,
    requested,
    unmoved,
    weighed_anew,
    without_rolling,
)
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.arrays import FloatArray
from photogram.factors.elimination.reprojection import predicted
from photogram.factors.graph import cost, ground_factors
from photogram.projection import B1, B2, FOCAL, READOUT
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import Block
from photogram.triangulation import intersect

SETTINGS = AdjustmentSettings()
PLAN = SurveyPlan(
    width_px=1600, height_px=1200, focal_px=1333.0, flying_height_m=60.0, forward_overlap=0.8, side_overlap=0.7,
    strips=4, photographs_per_strip=5, crossing=True, control_points=6, check_points=8, speed_m_s=8.0,
    gnss_offset_sigma_m=(0.0, 0.0, 0.0), velocity_tags=True, radial=(0.0, 0.0, 0.0, 0.0), tangential=(0.0, 0.0),
    calibration_sigmas=(40.0, 16.0, 16.0, 0.1, 0.1, 0.05, 0.0, 0.003, 0.003, 0.0, 0.0),
)  # fmt: skip
ROLLING = replace(PLAN, readout_s=0.033, readout_sigma_s=0.05)
GLOBAL = replace(PLAN, readout_sigma_s=0.05)
SEEDS = range(1, 7)


@cache
def simulated(plan: SurveyPlan, seed: int) -> SimulatedBlock:
    return simulate_block(plan, seed, tie_points=600, sigma_px=0.4)


@cache
def adjusted(plan: SurveyPlan, seed: int) -> Adjustment:
    return adjust(simulated(plan, seed).block, SETTINGS)


def check_error_m(plan: SurveyPlan, seed: int) -> FloatArray:
    result, made = adjusted(plan, seed), simulated(plan, seed)
    check = np.array([role == "check" for role in result.block.control_points.role])
    error = (result.estimates.ground_world_m - made.truth.control_position_world_m)[check]
    return np.asarray(error[np.isfinite(error).all(axis=1)])


def test_the_read_out_time_comes_back_with_its_sigma() -> None:
    normalised = []
    for seed in SEEDS:
        result = adjusted(ROLLING, seed)
        camera, sigma = result.block.cameras[0], result.decisions.readout_sigma_s[0]
        assert abs(camera.readout_s - 0.033) < 0.001
        assert result.decisions.readout_s[0] == camera.readout_s
        assert result.covariances.calibration[0, READOUT, READOUT] == pytest.approx(sigma**2)
        normalised.append((camera.readout_s - 0.033) / sigma)
    assert 0.3 < np.sqrt(np.mean(np.square(normalised))) < 1.7


def test_check_points_are_as_good_as_under_a_global_shutter() -> None:
    rolling, plain = (np.concatenate([check_error_m(plan, s) for s in SEEDS]) for plan in (ROLLING, PLAN))
    blind = np.concatenate([check_error_m(replace(PLAN, readout_s=0.033), s) for s in SEEDS])
    rms = [float(np.sqrt(np.mean(e**2))) for e in (rolling, plain, blind)]
    assert rms[0] < 1.15 * rms[1]
    assert rms[2] > 2.0 * rms[1], "without it the block is strained"


@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize(("plan", "there"), [(ROLLING, True), (GLOBAL, False)])
def test_a_rolling_shutter_is_seen_between_the_rounds(plan: SurveyPlan, there: bool, number: int) -> None:
    asked = np.array([True])
    problem = make_problem(without_rolling(simulated(plan, 1).block, asked), SETTINGS)
    state = minimise(problem, start_state(problem), SETTINGS).state
    assert is_clear(problem, state, asked, number).tolist() == [there]
    assert is_clear(problem, state, ~asked, number).tolist() == [False]


def test_a_global_shutter_among_mismatches_is_not_taken_for_a_rolling_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the first round, poses and choice of observations unsettled, its statistic is in the hundreds."""
    block = simulate_block(
        GLOBAL,
        1,
        tie_points=600,
        sigma_px=0.4,
        mismatches=0.2,
        start_position_sigma_m=5.0,
        start_attitude_sigma_deg=4.0,
    ).block
    said = list[str]()
    adjust(block, SETTINGS, lambda _done, _total, text: said.append(text))
    assert not any("rolling" in line for line in said)
    monkeypatch.setitem(SURE, 1, 1e2)
    adjust(block, SETTINGS, lambda _done, _total, text: said.append(text))
    assert any("rolling" in line for line in said), "which the bound is for"


def of_cameras(readouts_s: tuple[float, ...], seed: int) -> Block:
    """Return a block whose photographs were taken in turn by cameras of these read-out times, all looked for."""
    made = simulated(replace(GLOBAL, control_points=0, check_points=0), seed)
    photographs = tuple(
        replace(photograph, camera=i % len(readouts_s)) for i, photograph in enumerate(made.block.photographs)
    )
    cameras = tuple(replace(made.block.cameras[0], name=f"camera {c + 1}") for c in range(len(readouts_s)))
    true = tuple(
        replace(made.truth.camera, name=camera.name, readout_s=readout)
        for camera, readout in zip(cameras, readouts_s, strict=True)
    )
    tie = made.block.tie_points
    exact = replace(made.block, photographs=photographs, cameras=true, poses=made.truth.poses)
    true_points = intersect(replace(made.block, cameras=(made.truth.camera,), poses=made.truth.poses))
    shown = predicted(tie.photograph, tie.point, exact.oriented_cameras(), true_points)
    pixel = shown.pixel + 0.4 * np.random.default_rng(seed).standard_normal(shown.pixel.shape)
    return replace(made.block, photographs=photographs, cameras=cameras, tie_points=replace(tie, pixel=pixel))


def test_cameras_of_one_block_are_judged_each_by_itself() -> None:
    """A read-out of 33 ms, one of 1.4 ms that only the end of the rounds shows, and a global shutter."""
    readouts = np.array([0.033, 0.0014, 0.0])
    block = of_cameras(tuple(readouts.tolist()), 1)
    said = list[str]()
    result = adjust(block, SETTINGS, lambda _done, _total, text: said.append(text))
    assert sum("rolling" in line for line in said) == 2
    used = np.array([camera.readout_s for camera in result.block.cameras])
    assert (used != 0.0).tolist() == [True, True, False]
    np.testing.assert_array_equal(used[:2], result.decisions.readout_s[:2])
    assert (np.abs(result.decisions.readout_s - readouts) < 3.5 * result.decisions.readout_sigma_s).all()
    assert (result.decisions.readout_sigma_s < 0.0005).all()


@pytest.mark.parametrize("stated", [0.0, 0.033])
def test_a_global_shutter_has_no_read_out_time_whatever_its_source_states(stated: float) -> None:
    for seed in SEEDS:
        block = simulated(GLOBAL, seed).block
        camera = replace(block.cameras[0], readout_s=stated)
        result = adjust(replace(block, cameras=(camera,)), SETTINGS) if stated else adjusted(GLOBAL, seed)
        assert result.block.cameras[0].readout_s == 0.0
        assert result.covariances.calibration[0, READOUT].tolist() == [0.0] * (READOUT + 1)
        assert abs(result.decisions.readout_s[0]) < 3.0 * result.decisions.readout_sigma_s[0]
        why = held_parameters((camera,), result)[camera.name]["readout_s"]
        assert "no rolling shutter: held at 0" in why


def test_what_is_looked_for_in_vain_changes_no_bit() -> None:
    plain, looked = adjusted(PLAN, 1), adjusted(GLOBAL, 1)
    np.testing.assert_array_equal(plain.estimates.ground_world_m, looked.estimates.ground_world_m)
    np.testing.assert_array_equal(plain.covariances.position_m2, looked.covariances.position_m2)
    assert plain.cost == looked.cost
    assert np.isnan(plain.decisions.readout_s).all()
    assert requested(simulated(GLOBAL, 1).block.cameras).tolist() == [True]
    assert requested(simulated(PLAN, 1).block.cameras).tolist() == [False]


def test_a_known_read_out_time_is_used_as_it_is() -> None:
    block = simulated(replace(PLAN, readout_s=0.033), 1).block
    result = adjust(replace(block, cameras=(replace(block.cameras[0], readout_s=0.033),)), SETTINGS)
    assert result.block.cameras[0].readout_s == 0.033
    assert result.sigma0 == pytest.approx(1.0, abs=0.03)
    np.testing.assert_array_equal(result.covariances.calibration[0, READOUT], 0.0)


def test_velocities_come_from_the_tags_else_from_the_neighbours_and_only_where_a_shutter_rolls() -> None:
    made = simulated(ROLLING, 2)
    truth = np.array([pose.velocity_world_m_s for pose in made.truth.poses])
    tagged = in_motion(made.block, made.block.oriented_cameras()).velocity
    np.testing.assert_allclose(tagged, truth, atol=0.051)
    bare = replace(
        made.block, photographs=tuple(replace(p, velocity_world_m_s=None) for p in made.block.photographs),
        poses=made.truth.poses,
    )  # fmt: skip
    found = in_motion(bare, bare.oriented_cameras()).velocity
    assert np.sqrt(np.mean((found - truth) ** 2)) < 0.5  # positions scatter by 0.5 m about the plan
    still = simulated(PLAN, 2).block
    np.testing.assert_array_equal(in_motion(still, still.oriented_cameras()).velocity, 0.0)
    timeless = replace(bare, photographs=tuple(replace(p, time=None) for p in bare.photographs))
    kept = in_motion(timeless, timeless.oriented_cameras()).velocity
    np.testing.assert_array_equal(kept, truth)


def test_neighbours_alone_will_do_and_their_errors_count() -> None:
    plan = replace(ROLLING, velocity_tags=False)
    errors = np.array([adjusted(plan, s).block.cameras[0].readout_s - 0.033 for s in SEEDS])
    sigmas = np.array([adjusted(plan, s).decisions.readout_sigma_s[0] for s in SEEDS])
    assert np.abs(errors).max() < 0.001
    assert np.median(sigmas) > 1.3 * np.median([adjusted(ROLLING, s).decisions.readout_sigma_s[0] for s in SEEDS])
    assert np.abs(errors / sigmas).max() < 3.5


def test_both_engines_reach_the_same_minimum() -> None:
    block = simulate_block(replace(ROLLING, strips=2, photographs_per_strip=3), 3, tie_points=80).block
    camera = replace(block.cameras[0], readout_s=0.02)
    problem = make_problem(replace(block, cameras=(camera,)), replace(SETTINGS, robust_threshold=200.0))
    start = start_state(problem)
    fast, slow = (minimise(problem, start, replace(SETTINGS, engine=e)) for e in ("fast", "reference"))
    assert fast.cost == pytest.approx(slow.cost, rel=1e-9)
    assert fast.cost == pytest.approx(cost(problem, ground_factors(problem), fast.state), rel=1e-12)
    assert fast.state.parameters[0, READOUT] == pytest.approx(slow.state.parameters[0, READOUT], rel=1e-5)
    assert fast.state.parameters[0, FOCAL] == pytest.approx(slow.state.parameters[0, FOCAL], rel=1e-6)
    np.testing.assert_array_equal(fast.state.parameters[0, [B1, B2]], 0.0)


def test_a_read_out_time_of_photographs_that_do_not_tell_how_they_moved_is_warned_of() -> None:
    made = simulated(PLAN, 1).block
    camera, stated = made.cameras[0], made.cameras[0].sigmas.copy()
    stated[READOUT] = 0.012
    rolling = (replace(camera, readout_s=0.033, sigmas=stated),)
    still = tuple(replace(p, velocity_world_m_s=np.zeros(3), time=None) for p in made.photographs)
    silent = adjust(replace(made, cameras=rolling, photographs=still), SETTINGS)
    assert any("none of its photographs tells how it moved" in said for said in silent.warnings)
    untold = tuple(replace(p, velocity_world_m_s=None, time=None) for p in made.photographs[:3])
    some = (*untold, *made.photographs[3:])
    block = adjusted(replace(PLAN, readout_s=0.033), 1).block  # as good a block as any: only what is told counts
    block = replace(block, cameras=rolling, photographs=some)
    (said,) = unmoved(block)
    assert "3 of its photographs do not tell how they moved" in said
    assert unmoved(adjusted(ROLLING, 1).block) == ()
    assert unmoved(adjusted(GLOBAL, 1).block) == ()


def test_a_prior_counts_for_more_where_photographs_scatter_more_than_their_covariance_says() -> None:
    """Against both written as observations: the prior, and what the photographs say without it, down-weighted."""
    prior = np.array([[0.033, 0.012], [0.0, 0.03], [0.03, 0.01]])
    told, sigma, inflation = (
        np.array([-0.06, -0.054, 0.031]),
        np.array([0.002, 0.0018, 0.004]),
        np.array([10.0, 10.0, 1.0]),
    )
    weight = 1.0 / sigma**2 + 1.0 / prior[:, 1] ** 2
    adjusted_s = (told / sigma**2 + prior[:, 0] / prior[:, 1] ** 2) / weight
    found, found_sigma = weighed_anew(adjusted_s, weight**-0.5, inflation, prior)
    for k in range(3):
        A, y = np.ones((2, 1)), np.array([told[k], prior[k, 0]])
        P = np.diag([1.0 / (inflation[k] * sigma[k]) ** 2, 1.0 / prior[k, 1] ** 2])
        N = A.T @ P @ A
        assert found[k] == pytest.approx(float(np.linalg.solve(N, A.T @ P @ y)[0]), rel=1e-9)
        assert found_sigma[k] == pytest.approx(float(N[0, 0] ** -0.5), rel=1e-9)
    assert found[2] == pytest.approx(adjusted_s[2], rel=1e-9), "nothing changes where nothing is inflated"
    assert (found_sigma[:2] > 3.0 * sigma[:2]).all()


def test_one_round_is_enough_for_a_read_out_time() -> None:
    found = adjust(simulated(ROLLING, 1).block, replace(SETTINGS, maximum_rounds=1))
    assert found.block.cameras[0].readout_s == pytest.approx(0.033, abs=0.001)


SLOW = SurveyPlan(
    width_px=1200, height_px=900, focal_px=1000.0, flying_height_m=60.0, forward_overlap=0.8, side_overlap=0.7,
    strips=3, photographs_per_strip=5, control_points=4, control_sigma_m=(0.03, 0.03, 0.03), check_points=10,
    speed_m_s=5.0, readout_s=0.033, readout_sigma_s=0.03, gnss_offset_sigma_m=(0.0, 0.0, 0.0),
    gnss_sigma_m=(2.0, 2.0, 3.0), calibration_source="exif",
    calibration_sigmas=(36.0, 12.0, 12.0, 0.1, 0.1, 0.05, 0.0, 0.003, 0.003, 0.0, 0.0),
)  # fmt: skip


def test_a_rolling_shutter_is_not_taken_for_wrong_control_points() -> None:
    """In parallel strips it stretches the block along them, which four control points alone resist. Velocities from
    neighbours are wrong by 0.4 of 5 m/s: images of a tenth of a pixel would rather have no read-out time than these."""
    z = list[float]()
    for seed in (1, 5, 24):
        made = simulate_block(SLOW, seed, tie_points=3000, sigma_px=0.1)
        verdict = adjust_with_snooping(made.block, SETTINGS)
        assert verdict.blunders == ()
        result = verdict.result
        assert result.block.cameras[0].readout_s == result.decisions.readout_s[0]
        assert 0.02 < result.decisions.readout_s[0] < 0.06
        z.append((result.decisions.readout_s[0] - 0.033) / result.decisions.readout_sigma_s[0])
        check = np.array([role == "check" for role in result.block.control_points.role])
        error = (result.estimates.ground_world_m - made.truth.control_position_world_m)[check]
        assert np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1))) < 0.09  # 0.13 to 0.16 m with one of them rejected
    assert float(np.sqrt(np.mean(np.square(z)))) < 2.5


def test_a_read_out_time_that_is_none_is_held_at_zero_and_others_stay() -> None:
    made = simulated(ROLLING, 1).block
    rolling = replace(made.cameras[0], readout_s=0.03)
    block = without_rolling(replace(made, cameras=(rolling, replace(rolling, name="other"))), np.array([True, False]))
    assert [camera.readout_s for camera in block.cameras] == [0.0, 0.03]
    assert block.cameras[0].sigmas[READOUT] == 0.0
    assert block.cameras[1].sigmas[READOUT] == rolling.sigmas[READOUT] > 0.0
    np.testing.assert_array_equal(np.delete(block.cameras[0].sigmas, READOUT), np.delete(rolling.sigmas, READOUT))


def test_what_was_decided_of_read_out_times_is_known_again() -> None:
    made = simulated(ROLLING, 1).block
    held = made.cameras[0].sigmas.copy()
    held[READOUT] = 0.0
    cameras = (made.cameras[0], replace(made.cameras[0], name="held", sigmas=held))
    decided = SimpleNamespace(readout_s=np.array([0.03, 0.001]), readout_sigma_s=np.array([0.002, 0.003]))
    result = SimpleNamespace(block=replace(made, cameras=cameras), decisions=decided)
    readouts = as_decided(cast(Adjustment, result)).readouts
    np.testing.assert_array_equal(readouts.estimate_s, decided.readout_s)
    np.testing.assert_array_equal(readouts.sigma_s, decided.readout_sigma_s)
    assert readouts.none.tolist() == [False, True]
    nothing = SimpleNamespace(readout_s=np.zeros(0), readout_sigma_s=np.zeros(0))
    unknown = as_decided(cast(Adjustment, SimpleNamespace(block=result.block, decisions=nothing))).readouts
    assert np.isnan(unknown.estimate_s).tolist() == [True, True]
    assert not unknown.none.any()


def test_a_read_out_time_is_looked_for_where_it_begins_at_zero_and_is_free() -> None:
    camera = simulated(ROLLING, 1).block.cameras[0]
    held = camera.sigmas.copy()
    held[READOUT] = 0.0
    cameras = [
        replace(camera, readout_s=T, sigmas=sigmas) for T in (0.0, 1.0, 0.03) for sigmas in (camera.sigmas, held)
    ]
    assert camera.sigmas[READOUT] > 0.0
    assert requested(cameras).tolist() == [True, False, False, False, False, False]
