"""Site calibrations of simulated pairs, whose truth and noise are known."""

from dataclasses import replace

import numpy as np
import pytest

from photogram.errors import ControlPointError
from photogram.local_grids.calibration import (
    CalibrationSettings,
    SiteCalibration,
    calibrate,
    fit_plan,
    predictions,
    radii_m,
    slopes_design,
)
from photogram.local_grids.pairs import SitePairs

MIDDLE = np.array([12.57, 55.68])
RADII = radii_m(55.68, 6378137.0, 6356752.3141)
ORIGIN, ROTATION, SCALE = np.array([5000.0, 1000.0]), 0.3, 1.00012
PLANE = np.array([-36.5, 4e-5, -7e-5])
SIGMA_PLAN_M, SIGMA_HEIGHT_M = 0.012, 0.02


def to_map(place_deg: np.ndarray) -> np.ndarray:
    """Return places on a plane that stands for the map."""
    lon, lat = np.deg2rad(place_deg - MIDDLE).T
    return np.column_stack([RADII[1] * np.cos(np.deg2rad(MIDDLE[1])) * lon, RADII[0] * lat])


def simulated(seed: int, n: int = 8, noise: float = 1.0, scale: float = SCALE) -> SitePairs:
    rng = np.random.default_rng(seed)
    place = MIDDLE + rng.uniform(-0.01, 0.01, (n, 2)) * [1.7, 1.0]
    height = rng.uniform(30.0, 60.0, n)
    z = to_map(place) @ [1.0, 1j] * scale * np.exp(1j * ROTATION) + ORIGIN @ [1.0, 1j]
    local = np.column_stack([z.real, z.imag, height + slopes_design(place, MIDDLE, RADII) @ PLANE])
    local[:, :2] += rng.normal(0.0, noise * SIGMA_PLAN_M, (n, 2))
    local[:, 2] += rng.normal(0.0, noise * SIGMA_HEIGHT_M, n)
    every, sigma = np.ones(n, dtype=bool), np.tile([SIGMA_PLAN_M, SIGMA_HEIGHT_M], (n, 1))
    return SitePairs(tuple(f"P{i}" for i in range(n)), place, height, local, sigma, every, every)


def with_error(pairs: SitePairs, index: int, error_m: tuple[float, float, float]) -> SitePairs:
    local = pairs.local_m.copy()
    local[index] += error_m
    return replace(pairs, local_m=local)


def calibrated(pairs: SitePairs, settings: CalibrationSettings | None = None) -> SiteCalibration:
    return calibrate(pairs, to_map, MIDDLE, RADII, settings)


def test_exact_pairs_give_the_truth() -> None:
    found = calibrated(simulated(1, noise=0.0))
    assert np.abs(found.residual_m).max() < 1e-8
    assert found.plan.origin_m == pytest.approx(ORIGIN, abs=1e-8)
    assert found.plan.rotation_rad == pytest.approx(ROTATION, abs=1e-12)
    assert found.plan.scale == pytest.approx(SCALE, abs=1e-12)
    assert found.height is not None
    assert [found.height.offset_m, found.height.slope_north, found.height.slope_east] == pytest.approx(PLANE, abs=1e-9)
    assert found.suspicions == ()
    assert found.warnings == ()


@pytest.mark.parametrize("turn", [0.0, np.pi / 2, -np.pi + 1e-9, 3.0])
def test_every_rotation_comes_back(turn: float) -> None:
    x = np.random.default_rng(0).uniform(-500.0, 500.0, (5, 2))
    z = x @ [1.0, 1j] * np.exp(1j * turn)
    found = fit_plan(x, np.column_stack([z.real, z.imag]), np.ones(5), None)
    assert np.exp(1j * found.rotation_rad) == pytest.approx(np.exp(1j * turn))
    assert found.local_m(x) == pytest.approx(np.column_stack([z.real, z.imag]), abs=1e-9)


def test_a_scale_that_is_held_stays() -> None:
    found = calibrated(simulated(2, scale=1.0), CalibrationSettings(scale=1.0))
    assert found.plan.scale == 1.0
    assert found.plan.sigma[3] == 0.0
    assert found.plan.fit.degrees_of_freedom == 2 * 8 - 3
    assert found.plan.rotation_rad == pytest.approx(ROTATION, abs=5 * found.plan.sigma[2])
    # a scale that is not the grid's contradicts, in all pairs at once
    assert calibrated(simulated(2, n=12, scale=1.0005), CalibrationSettings(scale=1.0)).warnings


def test_sigmas_are_those_of_the_estimates() -> None:
    """Over 200 simulated sites the errors over their sigmas have a standard deviation of 1 in each parameter."""
    errors = []
    for seed in range(200):
        found = calibrated(simulated(seed))
        assert found.height is not None
        x = found.plan.centre_m
        here = found.plan.local_m(x[None])[0] - PlaneTruth.local_m(x)
        plan = [*here, found.plan.rotation_rad - ROTATION, found.plan.scale - SCALE]
        height = np.array([found.height.offset_m, found.height.slope_north, found.height.slope_east]) - PLANE
        errors.append([*(plan / found.plan.sigma), *(height / found.height.sigma)])
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(np.abs(spread - 1.0) < 4.0 / np.sqrt(2 * 200)), spread


class PlaneTruth:
    """The simulated similarity."""

    @staticmethod
    def local_m(x: np.ndarray) -> np.ndarray:
        """Return easting and northing of x and y (2,)."""
        z = complex(*x) * SCALE * np.exp(1j * ROTATION)
        return np.asarray(ORIGIN + np.array([z.real, z.imag]))


@pytest.mark.parametrize("error", [(0.2, 0.0, 0.0), (-0.1, 0.17, 0.0), (0.0, 0.0, 0.2)])
def test_a_wrong_pair_is_named_and_no_other(error: tuple[float, float, float]) -> None:
    alone = 0
    for seed in range(20):
        index = seed % 8
        found = calibrated(with_error(simulated(seed), index, error))
        assert len(found.suspicions) == 1, seed
        suspicion = found.suspicions[0]
        assert index in suspicion.pairs, seed
        if len(suspicion.pairs) > 1:
            assert found.used is found.pairs
            continue
        alone += 1
        assert suspicion.part == ("height" if error[2] else "plan")
        size = error[2] if error[2] else float(np.hypot(*error[:2]))
        assert suspicion.off_m[0] == pytest.approx(size, abs=0.1)
        assert not (found.used.in_height if error[2] else found.used.in_plan)[index]
        assert (found.used.in_plan if error[2] else found.used.in_height)[index]
    assert alone >= 16


def test_two_wrong_pairs_are_both_named() -> None:
    pairs = with_error(with_error(simulated(3, n=10), 2, (0.3, 0.0, 0.0)), 7, (0.0, -0.2, 0.0))
    assert sorted(s.pairs for s in calibrated(pairs).suspicions) == [(2,), (7,)]


def test_three_pairs_cannot_tell_which_is_wrong() -> None:
    found = calibrated(with_error(simulated(4, n=3), 1, (0.5, 0.0, 0.0)), CalibrationSettings(heights="offset"))
    assert [sorted(s.pairs) for s in found.suspicions] == [[0, 1, 2]]
    assert found.used.in_plan.all()


def test_sigmas_that_are_too_small_accuse_nobody() -> None:
    pairs = simulated(5, n=12, noise=12.0)
    found = calibrated(pairs)
    assert found.suspicions == ()
    assert found.used is pairs
    assert "none is named" in found.warnings[-1]


def test_left_out_pairs_are_those_of_a_calibration_without() -> None:
    pairs = simulated(6)
    found = calibrated(pairs)
    difference, sigma = predictions(found, to_map(pairs.place_deg), RADII)
    other = calibrated(pairs.without(2, plan=True, height=True))
    assert difference[2] == pytest.approx(other.residual_m[2], abs=1e-8)
    own, own_sigma = predictions(other, to_map(pairs.place_deg), RADII)
    assert own[2] == pytest.approx(difference[2], abs=1e-8)
    assert own_sigma[2] == pytest.approx(sigma[2], rel=1e-6)


def only(pairs: SitePairs, index: list[int]) -> SitePairs:
    """Return the pairs of which those of an index alone serve."""
    serving = np.isin(np.arange(len(pairs)), index)
    return replace(pairs, in_plan=serving, in_height=serving)


def test_what_is_too_little_is_refused() -> None:
    pairs = simulated(7)
    with pytest.raises(ControlPointError, match="needs two pairs"):
        calibrated(only(pairs, [3]))
    with pytest.raises(ControlPointError, match="heights: plane needs 3 pairs with both heights, found 2"):
        calibrated(only(pairs, [3, 4]))
    same = replace(pairs, place_deg=np.tile(MIDDLE, (8, 1)))
    with pytest.raises(ControlPointError, match="at one place"):
        calibrated(same)
    line = replace(pairs, place_deg=MIDDLE + np.outer(np.linspace(-0.01, 0.01, 8), [1.7, 1.0]))
    with pytest.raises(ControlPointError, match="in a line"):
        calibrated(line)


def test_what_proves_nothing_is_said() -> None:
    found = calibrated(only(simulated(8), [0, 1]), CalibrationSettings(heights="offset"))
    assert "without redundancy" in found.warnings[0]
    assert np.abs(found.residual_m[:2, :2]).max() < 1e-9
    three = calibrated(only(simulated(8), [0, 1, 2]))
    assert "fix the heights without redundancy" in three.warnings[0]
    assert calibrated(only(simulated(8), [0, 1]), CalibrationSettings(scale=SCALE, heights="none")).warnings == ()
