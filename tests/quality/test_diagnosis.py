"""What a finished block is weak in, from simulated surveys that are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.projection import CX, FOCAL, K1, K2, PARAMETERS
from photogram.quality.deformation import CENTRES, parameters_of, rotations_of
from photogram.quality.diagnosis import (
    Remedy,
    _groups,
    diagnose,
    fitted_dome,
    height_differences_m,
    hidden,
    undetermined,
    weaknesses,
)
from photogram.quality.improvements import block_deformation
from photogram.report.numbers.diagnosis import diagnosis_numbers
from photogram.results import Adjustment, Deformation
from photogram.simulation.simulated_survey import SurveyPlan, rtk_plan, simulate_block
from photogram.survey import Block

NADIR = SurveyPlan(
    focal_px=1000.0, strips=4, photographs_per_strip=5, control_points=5, check_points=20, forward_overlap=0.8,
    side_overlap=0.7, relief_m=3.0, gnss_sigma_m=(2.0, 2.0, 2.0), gnss_offset_sigma_m=(1.0, 1.0, 2.0),
)  # fmt: skip


RTK_NADIR = replace(
    rtk_plan(), relief_m=0.0, attitude_noise_deg=0.05, position_noise_m=0.05,
    calibration_sigmas=(30.0, 5.0, 5.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0),
)  # fmt: skip


def adjusted(plan: SurveyPlan, seed: int = 1, *, k1_wrong_by: float | None = None) -> Adjustment:
    """Simulate the observations of a plan and adjust them; with the whole calibration held, right but for k1, where
    that is given."""
    made = simulate_block(
        plan, seed, tie_points=900, start_position_sigma_m=0.1, start_attitude_sigma_deg=0.1, start_point_sigma_m=0.1
    )
    block = made.block
    if k1_wrong_by is not None:
        radial = made.truth.camera.radial + np.array([k1_wrong_by, 0.0, 0.0, 0.0])
        block = replace(block, cameras=(replace(made.truth.camera, radial=radial),))
    return finished(block)


def finished(block: Block) -> Adjustment:
    settings = AdjustmentSettings(robust_loss="none", outlier_threshold=100.0)
    result = adjust(block, settings)
    given = [camera.parameters for camera in block.cameras]
    return replace(
        result, covariances=replace(result.covariances, deformation=block_deformation(result, settings, given))
    )


def test_focal_length_and_height_of_a_nadir_flight_without_control() -> None:
    weak = diagnose(adjusted(RTK_NADIR))
    focal = weak.focal_height["simulated"]
    assert abs(focal.ground) > 0.95
    assert focal.height_sigma_m > 0.1
    assert any("focal length of simulated and the height of the block cannot be separated" in w for w in weak.warnings)
    assert any("The block as a whole may be shifted by" in w for w in weak.warnings)
    best = weak.remedies[0]
    assert best.sigma_height_after_m < 0.5 * best.sigma_height_before_m
    strong = diagnose(adjusted(replace(RTK_NADIR, oblique_strip=True, oblique_photographs=7, oblique_angle_deg=25.0)))
    assert strong.focal_height["simulated"].height_sigma_m < 0.3 * focal.height_sigma_m


def test_a_dome_from_a_wrong_calibration_is_measured() -> None:
    """k1 is held at a value that is wrong by 0.05: check points must show the dome."""
    found = diagnose(adjusted(NADIR, 3, k1_wrong_by=0.05))
    assert found.dome.significant
    assert abs(found.dome.measured_m) > 3 * found.dome.sigma_m
    assert any("grow with the distance from the centre" in w for w in found.warnings)
    assert np.isnan(found.correlation["simulated"]).all()
    right = diagnose(adjusted(NADIR, 3, k1_wrong_by=0.0))
    assert not right.dome.significant
    assert abs(right.dome.measured_m) < 0.5 * abs(found.dome.measured_m)
    assert (right.dome.points, right.dome.control_points) == (25, 5)


def test_predicted_dome_is_what_domes_scatter_by() -> None:
    """The adjustment's own prediction of the dome, against the dome of its tie points over the truth."""
    calibration = (10.0, 3.0, 3.0, 0.01, 0.01, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0)
    plan = replace(NADIR, check_points=0, calibration_sigmas=calibration)
    domes, sigmas = [], []
    for seed in range(12):
        made = simulate_block(
            plan, seed, tie_points=300, start_position_sigma_m=0.1, start_attitude_sigma_deg=0.1,
            start_point_sigma_m=0.1,
        )  # fmt: skip
        result = finished(made.block)
        assert len(result.block.tie_points) == len(made.tie_point_position_world_m)
        error = result.block.tie_points.position_world_m[:, 2] - made.tie_point_position_world_m[:, 2]
        known = result.covariances.deformation
        xy = made.tie_point_position_world_m[:, :2]
        dome, _, _ = fitted_dome(xy, error, np.ones(len(xy)), known.centre_world_m, known.radius_m)
        domes.append(dome)
        sigmas.append(np.sqrt(known.covariance[5, 5]))
    ratio = np.sqrt(np.mean(np.square(domes))) / np.sqrt(np.mean(np.square(sigmas)))
    assert 0.45 < ratio < 1.75  # 99.9 % of a χ² with 12 degrees of freedom, and a sample of points for the prediction


@given(
    st.integers(7, 40), st.floats(-0.5, 0.5), st.floats(-0.3, 0.3), st.floats(-0.2, 0.2), st.integers(0, 1000)
)  # fmt: skip
def test_a_dome_is_fitted_exactly_whatever_the_height_and_the_tilt(
    n: int, dome: float, height: float, tilt: float, seed: int
) -> None:
    place = np.random.default_rng(seed).uniform(-100, 100, (n, 2))
    offset = (place - [5.0, -3.0]) / 70.0
    difference = height + tilt * offset[:, 0] + dome * np.sum(offset**2, axis=1)
    found, sigma, _ = fitted_dome(place, difference, np.full(n, 0.02), np.array([5.0, -3.0]), 70.0)
    assert found == pytest.approx(dome, abs=1e-9)
    assert sigma < 1e-9


def test_false_domes_are_one_in_a_thousand() -> None:
    rng = np.random.default_rng(5)
    place = rng.uniform(-100, 100, (12, 2))
    # a tilt and a shift that all have in common do not count, and the scatter is not as stated
    common = 0.2 + 0.003 * place[:, 0]
    alarms = [
        fitted_dome(place, common + 0.05 * rng.standard_normal(12), np.full(12, 0.02), np.zeros(2), 100.0)[2]
        for _ in range(10_000)
    ]
    assert 0.0001 < np.mean(alarms) < 0.002


def test_too_few_points_or_all_at_one_distance_show_no_dome() -> None:
    square = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1], [-1, 1], [1, 1]])
    for place in (square[:3], square):
        dome, sigma, significant = fitted_dome(
            place, np.arange(len(place), dtype=np.float64), np.ones(len(place)), np.zeros(2), 1.0
        )
        assert np.isnan(dome)
        assert np.isnan(sigma)
        assert not significant


def test_points_that_took_no_part() -> None:
    result = adjusted(NADIR)
    place, difference, sigma, left = height_differences_m(result)
    points = result.block.control_points
    assert left == points.role.count("control") == 5
    assert len(place) == len(points)
    check = [g for g, role in enumerate(points.role) if role == "check"]
    expected = result.estimates.ground_world_m[check, 2] - points.position_world_m[check, 2]
    np.testing.assert_allclose(difference[: len(check)], expected, atol=1e-4)
    assert np.all(sigma > points.sigma_m[:, 2].min())


def test_what_is_not_determined_is_said_in_words() -> None:
    result = adjusted(RTK_NADIR)
    said = undetermined(
        result.covariances.deformation, result.block.cameras, result.estimates.flights, result.block.gnss_offset_sigma_m
    )
    assert any("focal length" in s and "height of the ground" in s and "not separable" in s for s in said)
    assert not any(s.startswith("correlated") and s.count("k1") and "k2" in s and s.count("±") == 2 for s in said)


def test_the_numbers_of_the_report() -> None:
    result = adjusted(NADIR)
    numbers = diagnosis_numbers(result, [None] * len(result.block.photographs))
    camera = numbers["cameras"]["simulated"]
    n = len(camera["parameters"])
    assert camera["parameters"][:2] == ["focal_px", "cx_px"]
    correlation = np.array(camera["correlation"])
    assert correlation.shape == (n, n) == (len(camera["sigma"]),) * 2
    np.testing.assert_allclose(np.diag(correlation), 1.0)
    np.testing.assert_allclose(correlation, correlation.T)
    assert set(numbers["dome"]) >= {"measured_m", "sigma_m", "significant", "predicted_sigma_m", "points"}
    for remedy in numbers["remedies"]:
        assert f"{remedy['sigma_height_after_m']:.3f} m with it" in remedy["sentence"]
    sigmas = [r["sigma_height_after_m"] for r in numbers["remedies"] if r["what"] != "control_in_the_middle"]
    assert sigmas == sorted(sigmas)


def test_nothing_is_said_of_a_block_that_nothing_is_known_of() -> None:
    result = adjusted(NADIR)
    unknown = replace(result, covariances=replace(result.covariances, deformation=Deformation.unknown()))
    numbers = diagnosis_numbers(unknown, [None] * len(result.block.photographs))
    assert numbers["dome"]["predicted_sigma_m"] is None
    assert numbers["dome"]["measured_m"] is None
    assert numbers["warnings"] == numbers["undetermined"] == []
    assert numbers["remedies"] == []
    assert numbers["resections"] == []
    assert weaknesses(unknown.covariances.deformation, result.block.cameras, result.estimates.flights) == []


def test_a_pair_is_a_group_but_for_radial_terms_and_for_a_centre_with_its_offset() -> None:
    camera = simulate_block(NADIR, 1, tie_points=10).block.cameras[0]
    start = parameters_of(0, 1).start
    size = start + PARAMETERS + 3
    height, offset, focal, k1, k2 = CENTRES.stop - 1, size - 1, start + FOCAL, start + K1, start + K2
    words = {k: str(k) for k in (height, offset, focal, k1, k2)}

    def groups(*pairs: tuple[int, int]) -> list[tuple[list[int], float]]:
        covariance = np.eye(size)
        for a, b in pairs:
            covariance[a, b] = covariance[b, a] = -0.97
        known = replace(Deformation.unknown(), covariance=covariance)
        return _groups(known, words, start, [camera])

    assert groups() == groups((k1, k2)) == groups((height, offset)) == []
    assert groups((height, focal)) == [([height, focal], 0.97)]
    assert groups((focal, k1), (k1, k2)) == [([focal, k1, k2], 0.97)]


@pytest.mark.parametrize(("of_cx", "plan"), [((0.6, 0.5), 0.15), ((0.9, 0.5), 0.18), ((0.01, 0.01), None)])
def test_what_a_principal_point_costs_in_plan_is_its_part_of_the_shift(
    of_cx: tuple[float, float], plan: float | None
) -> None:
    camera = simulate_block(NADIR, 1, tie_points=10).block.cameras[0]
    at, turn = parameters_of(0, 1), rotations_of(0)
    sigma, correlation = np.full(at.stop, 1e-4), np.eye(at.stop)
    sigma[:2], sigma[at.start + CX], sigma[turn.start + 1] = (0.2, 0.3), 2.0, 1e-3
    for other, r in ((0, of_cx[0]), (1, -of_cx[1]), (turn.start + 1, -0.98)):
        correlation[at.start + CX, other] = correlation[other, at.start + CX] = r
    known = replace(
        Deformation.unknown(),
        covariance=correlation * np.outer(sigma, sigma),
        intersection_sigma_m=np.array([0.01, 0.01, 0.02]),
    )
    said = [sentence for sentence in weaknesses(known, [camera], []) if "principal point" in sentence]
    if plan is None:
        assert said == []
    else:
        assert len(said) == 1
        assert f"in x and the tilt of the photographs cannot be separated (correlation 0.980): {plan:.3f} m" in said[0]


@pytest.mark.parametrize(
    ("now_m", "then_m", "precise_m", "said"),
    [(0.03, 0.08, 0.02, True), (0.03, 0.08, 0.10, False), (0.08, 0.085, 0.001, False), (0.03, 0.029, 0.001, False)],
)
def test_what_a_fixed_calibration_hides_is_said_where_it_is_much(
    now_m: float, then_m: float, precise_m: float, said: bool
) -> None:
    known = replace(
        Deformation.unknown(),
        intersection_sigma_m=np.array([0.01, 0.01, precise_m]),
        height_sigma_m=np.full(5, now_m),
        freed_height_sigma_m=np.array([0.5, then_m, 0.04]),
    )
    sentences = hidden(known)
    assert bool(sentences) is said
    if said:
        assert "known to 0.080 m instead of 0.030 m, and the dome to 0.040 m" in sentences[0]


@pytest.mark.parametrize(
    ("height_m", "dome_m", "helps"), [(0.05, 0.10, True), (0.10, 0.05, True), (0.05, 0.05, True), (0.099, 0.099, False)]
)
def test_a_remedy_helps_heights_or_the_dome(height_m: float, dome_m: float, helps: bool) -> None:
    assert Remedy("control_in_the_middle", 0.10, height_m, 0.10, dome_m).helps is helps
