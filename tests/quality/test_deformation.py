"""The block as a whole: its covariances against those of the whole linear system, and remedies against doing them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from referees import whole_covariance

from photogram.adjustment.ground_points import ground_points
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import FloatArray
from photogram.factors.covariance import covariances
from photogram.factors.elimination.reprojection import Observations
from photogram.factors.elimination.state import State
from photogram.factors.functionals import factored, functions_of_tie_points, intersected, intersected_covariances
from photogram.factors.graph import IndeterminateError, Problem
from photogram.factors.variables import CALIBRATION, GNSS_OFFSET, POSE, TIE_POINT, key
from photogram.projection import CAMERA_PARAMETERS, CX, FOCAL, K1, K2, PARAMETERS
from photogram.quality.deformation import (
    CENTRES,
    DOME,
    GROUND,
    SLOPES,
    Stiffness,
    cells_of,
    component_shifts,
    firm_points,
    height_modes,
    offset_of,
    parameters_of,
    places_of,
    rotations_of,
    shape_covariances,
    spread_points,
    stiffness,
)
from photogram.quality.fixed_parameters import ordinary_sigmas, with_fixed_released
from photogram.quality.flight_lines import Course
from photogram.quality.improvements import (
    HIGHER,
    _added_photographs,
    _site,
    deformation_and_remedies,
    strips,
    with_rtk,
    with_strip,
)
from photogram.results import Deformation
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block

PLAN = SurveyPlan(strips=2, photographs_per_strip=3, control_points=4, check_points=2, flights=2)
SETTINGS = AdjustmentSettings(robust_loss="huber")
SIGMAS = (5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0002, 0.0, 0.0, 0.0)


def small(seed: int = 1, plan: SurveyPlan = PLAN, ties: int = 60) -> tuple[Problem, State]:
    made = simulate_block(
        replace(plan, calibration_sigmas=SIGMAS), seed, tie_points=ties, start_position_sigma_m=0.02,
        start_attitude_sigma_deg=0.02, start_point_sigma_m=0.02,
    )  # fmt: skip
    problem = make_problem(made.block, SETTINGS)
    return problem, start_state(problem)


def rows_of_modes(problem: Problem, state: State, place: dict[int, slice], size: int) -> FloatArray:
    """The modes as rows on all variables, written down point by point."""
    places = places_of(problem, state)
    assert places is not None
    cameras, flights = len(problem.block.cameras), len(problem.flights)
    rows = np.zeros((offset_of(flights, cameras).start, size))
    weights = height_modes(state.tie_point[places.points, :2], places.centre_world_m, places.radius_m)
    for n, point in enumerate(places.points.tolist()):
        at = place[key(TIE_POINT, point)].start
        for axis in range(3):
            rows[GROUND.start + axis, at + axis] = 1 / len(places.points)
        for k, row in enumerate((SLOPES.start, SLOPES.start + 1, DOME)):
            rows[row, at + 2] = weights[k + 1, n]
    count = len(state.rotation)
    for i in range(count):
        at = place[key(POSE, i)].start
        rows[CENTRES, at + 3 : at + 6] = state.rotation[i] / count
        rows[rotations_of(0), at : at + 2] = np.eye(2) / count
    at, start = place[key(CALIBRATION, 0)].start, parameters_of(0, cameras).start
    for k, parameter in enumerate(problem.free[0].tolist()):
        rows[start + parameter, at + k] = problem.scale[0][parameter]
    for f in range(flights):
        rows[offset_of(f, cameras), place[key(GNSS_OFFSET, f)]] = np.eye(3)
    return rows


def test_modes_are_those_of_the_whole_linear_system() -> None:
    problem, state = small()
    covariance, place = whole_covariance(problem, state)
    rows = rows_of_modes(problem, state, place, len(covariance))
    places = places_of(problem, state)
    assert places is not None
    expected = rows @ covariance @ rows.T
    sigma = np.sqrt(np.maximum(np.diag(expected), 1e-30))
    for found in (covariances(problem, state), factored(problem, state)):
        modes = stiffness(problem, state, found, places).modes
        np.testing.assert_allclose(modes / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-6)
    assert np.count_nonzero(np.diag(modes)[parameters_of(0, 1)]) == np.count_nonzero(SIGMAS) < PARAMETERS


def test_components_are_placed_beside_each_other_as_the_whole_linear_system_says() -> None:
    problem, state = small(ties=120)
    strip = np.arange(6) // 3
    tie = problem.tie
    of_point = strip[tie.photograph]
    alone = np.bincount(tie.point, of_point) / np.maximum(np.bincount(tie.point), 1)
    covariance, place = whole_covariance(problem, state)
    component = np.where(strip == 0, 2, 5)
    found = component_shifts(problem, state, factored(problem, state), component)
    last = np.zeros(len(state.tie_point), dtype=np.int64)
    last[tie.point] = of_point
    rows = np.zeros((2, 3, len(covariance)))
    for of in (0, 1):
        firm = firm_points(problem, state, np.flatnonzero(last == of))
        for point in firm.tolist():
            rows[of, :, place[key(TIE_POINT, point)].start + np.arange(3)] = np.eye(3) / len(firm)
    assert 0.0 < np.mean(alone) < 1.0
    between = rows[1] - rows[0]
    assert not found[2].any()
    assert np.isnan(found[[0, 1, 3, 4]]).all()
    np.testing.assert_allclose(found[5], between @ covariance @ between.T, rtol=1e-6, atol=1e-12)
    assert component_shifts(problem, state, factored(problem, state), np.zeros(6, dtype=np.int64)).shape == (0, 3, 3)


def test_relative_sigmas_are_those_of_differences_from_the_mean_shift() -> None:
    """From the whole linear system: points less the mean of those that stand for the block, their own noise off."""
    problem, state = small()
    covariance, place = whole_covariance(problem, state)
    places = places_of(problem, state)
    assert places is not None
    stiff = stiffness(problem, state, covariances(problem, state), places)
    mean = rows_of_modes(problem, state, place, len(covariance))[GROUND]
    looked_at = [places.points[i] for i in (places.middle, *places.corners)]
    rows = np.zeros((len(looked_at), 3, len(covariance)))
    for n, point in enumerate(looked_at):
        rows[n, :, place[key(TIE_POINT, int(point))].start + np.arange(3)] = np.eye(3)
    own, count = stiff.own.diagonal().reshape(-1, 3).mean(axis=0), len(places.points)
    for k in (0, 1):
        absolute, relative = rows[:, k], rows[:, k] - mean[k]
        variance = [np.mean(np.diag(r @ covariance @ r.T)) for r in (absolute, relative)]
        # the own noise of points, which is in their mean too, here as if all had that of those looked at
        variance -= own[k] * np.array([1.0, 1.0 - 1.0 / count])
        np.testing.assert_allclose([stiff.absolute_sigma_m[k], stiff.relative_sigma_m[k]], np.sqrt(variance), rtol=0.06)


def test_relative_sigmas_leave_the_datum_out() -> None:
    """GNSS alone, and an offset known to 10 m: heights as such are worthless, the shape is as good as before."""
    plan = replace(PLAN, control_points=0, flights=1)
    found = []
    for offset_m in (0.1, 10.0):
        problem, state = small(plan=plan)
        block = replace(problem.block, gnss_offset_sigma_m=np.full(3, offset_m))
        problem = replace(problem, block=block)
        places = places_of(problem, state)
        assert places is not None
        stiff = stiffness(problem, state, factored(problem, state), places)
        found.append((stiff.absolute_sigma_m, stiff.relative_sigma_m))
    (_, shape), (far, same) = found
    assert (far > 9.9).all()
    assert (far < 10.5).all()
    np.testing.assert_allclose(same, shape, rtol=1e-3)
    assert (same < 0.5).all()


def test_the_shape_is_the_error_relative_to_the_mean() -> None:
    """Errors relative to their mean, against the whole linear system, of which the cameras' part is taken."""
    problem, state = small()
    covariance, place = whole_covariance(problem, state)
    places, found = places_of(problem, state), covariances(problem, state)
    assert places is not None
    shape = shape_covariances(problem, state, found, places)
    count = len(places.points)
    at = np.array([np.arange(place[key(TIE_POINT, p)].start, place[key(TIE_POINT, p)].stop) for p in places.points])
    rows = np.zeros((count, 3, len(covariance)))
    for n in range(count):
        rows[n, range(3), at[n]] = 1.0
    rows -= rows.mean(axis=0)
    a = np.tile(-np.eye(3) / count, (count, 1, 1))
    a = np.stack([np.where(np.arange(count)[:, None, None] == n, a + np.eye(3), a) for n in range(count)])
    for n in (0, count // 2, count - 1):
        own = functions_of_tie_points(problem, state, found.layout, places.points, a[n]).own
        np.testing.assert_allclose(shape[n] + own, rows[n] @ covariance @ rows[n].T, rtol=1e-5, atol=1e-10)


def test_a_datum_known_to_hundreds_of_metres_leaves_the_shape_as_it_is() -> None:
    shapes, datum = [], []
    for sigma_m in (1.0, 1000.0):
        plan = replace(PLAN, control_points=0, check_points=0, flights=1, gnss_offset_sigma_m=(sigma_m,) * 3)
        problem, state = small(plan=plan)
        places, found = places_of(problem, state), factored(problem, state)
        assert places is not None
        shapes.append(shape_covariances(problem, state, found, places))
        datum.append(np.sqrt(np.diag(stiffness(problem, state, found, places).modes)[GROUND]))
    assert np.all(datum[0] > 0.9)
    assert np.all(datum[1] > 900.0)
    sigma = [np.sqrt(np.einsum("pii->pi", shape)) for shape in shapes]
    assert np.all(sigma[0] > 0)
    np.testing.assert_allclose(sigma[1], sigma[0], rtol=1e-3)


def test_a_function_of_one_tie_point_is_its_own_covariance() -> None:
    problem, state = small(2)
    found = covariances(problem, state)
    points = np.array([7, 31])
    a = np.zeros((2, 3, 6))
    a[0, :, :3], a[1, :, 3:] = np.eye(3), np.eye(3)
    functions = functions_of_tie_points(problem, state, found.layout, points, a).covariance(found)
    np.testing.assert_allclose(functions[:3, :3], found.tie_point[7], rtol=1e-7)
    np.testing.assert_allclose(functions[3:, 3:], found.tie_point[31], rtol=1e-7)


def test_points_intersected_with_uncertain_cameras_are_check_points() -> None:
    problem, state = small(3, replace(PLAN, check_points=5))
    found = covariances(problem, state)
    position, expected = ground_points(problem, state, found)
    points = problem.block.control_points
    check = np.flatnonzero((np.array(points.role) == "check") & np.isfinite(position[:, 0]))
    assert len(check) >= 4
    rows = np.flatnonzero(np.isin(points.mark_point, check))
    rows = rows[np.argsort(points.mark_point[rows], kind="stable")]
    marks = Observations(
        points.mark_photograph[rows], np.searchsorted(check, points.mark_point[rows]), points.mark_pixel[rows],
        np.sqrt(points.mark_covariance_px2[rows, 0, 0]),
    )  # fmt: skip
    single = intersected_covariances(marks, position[check], state, found)
    np.testing.assert_allclose(single, expected[check], rtol=1e-6, atol=1e-9)
    first_ray = marks.point != 1
    first_ray[np.flatnonzero(marks.point == 1)[0]] = True
    joint = intersected(marks.select(first_ray), position[check], state, found.layout).joint(found)
    assert np.isnan(joint[3:6]).all()
    assert np.isnan(joint[:, 3:6]).all()
    np.testing.assert_allclose(joint[:3, :3], single[0], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(joint[6:9, 6:9], single[2], rtol=1e-9, atol=1e-15)
    assert np.isfinite(joint[:3, 6:9]).all()
    one_ray = marks.select(np.arange(len(marks)) == 0)
    assert np.isinf(intersected_covariances(one_ray, position[check], state, found)).all()


def test_a_control_point_more_is_as_good_as_surveying_it() -> None:
    problem, state = small(4)
    places = places_of(problem, state)
    assert places is not None
    point, sigma = int(places.points[places.middle]), np.array([0.01, 0.01, 0.02])
    stiff = stiffness(problem, state, covariances(problem, state), places)
    surveyed = stiff.surveyed(1, sigma)
    covariance, place = whole_covariance(problem, state)
    rows = rows_of_modes(problem, state, place, len(covariance))[:6]
    at = place[key(TIE_POINT, point)]
    gain = covariance[:, at] @ np.linalg.inv(covariance[at, at] + np.diag(sigma**2))
    after = covariance - gain @ covariance[at]
    expected = rows @ after @ rows.T
    # but for the share of a sixtieth that the point's own noise has in the modes
    own = stiff.modes[:6, :6] - stiff.ground[:6, :6]
    for mode in (GROUND.stop - 1, DOME):
        sigma_after = np.sqrt(surveyed.ground[mode, mode] + own[mode, mode])
        assert sigma_after == pytest.approx(np.sqrt(expected[mode, mode]), rel=0.05)
    assert np.all(surveyed.height_sigma_m <= stiff.height_sigma_m + 1e-12)


def test_a_strip_more_is_what_it_would_see() -> None:
    problem, state = small(5, replace(PLAN, strips=3, photographs_per_strip=4), 400)
    places = places_of(problem, state)
    assert places is not None
    course = strips(state, places)["oblique_strip"]
    extended = with_strip(problem, state, course)
    assert extended is not None
    more, moved = extended
    assert len(more.block.photographs) == len(moved.rotation) > len(problem.block.photographs)
    tilt = np.rad2deg(np.arccos(-moved.rotation[len(state.rotation) :, 2, 2]))
    np.testing.assert_allclose(tilt, course.tilt_deg)
    new = more.tie.photograph >= len(state.rotation)
    per_photograph = np.bincount(more.tie.photograph[new])[len(state.rotation) :]
    assert per_photograph.min() >= 12
    assert per_photograph.max() <= np.median(np.bincount(problem.tie.photograph))
    assert np.all(np.diff(more.tie.point) >= 0)
    before = stiffness(problem, state, factored(problem, state), places)
    after = stiffness(more, moved, factored(more, moved), places)
    f = parameters_of(0, 1).start
    assert after.modes[f, f] < 0.5 * before.modes[f, f]
    assert np.all(after.height_sigma_m <= before.height_sigma_m * (1 + 1e-6))


def test_a_strip_that_sees_nothing_is_none() -> None:
    problem, state = small()
    assert with_strip(problem, state, Course((5000.0, 0.0), 0.0, 3, 20.0, 80.0)) is None


def test_better_gnss_only_where_it_is_worse() -> None:
    problem, state = small()
    assert with_rtk(problem, state) is None  # 2 and 4 cm already
    consumer, state = small(1, replace(PLAN, gnss_sigma_m=(2.0, 2.0, 2.0)))
    better = with_rtk(consumer, state)
    assert better is not None
    assert all(p.gnss_sigma_m is not None and p.gnss_sigma_m[2] == 0.02 for p in better.block.photographs)


def weak_block(control: int = 4, gnss_m: float = 2.0) -> tuple[Problem, State]:
    """Nadir photographs from one height, positions good to 2 m, four control points: a dome and nothing against it."""
    plan = SurveyPlan(
        focal_px=1000.0, strips=4, photographs_per_strip=5, control_points=control, check_points=0, forward_overlap=0.8,
        side_overlap=0.7, gnss_sigma_m=(gnss_m,) * 3, gnss_offset_sigma_m=(gnss_m / 2,) * 3, relief_m=2.0,
    )  # fmt: skip
    made = simulate_block(
        replace(plan, calibration_sigmas=(20.0, 5.0, 5.0, 0.02, 0.02, 0.0, 0.0, 0.0005, 0.0005, 0.0, 0.0)), 1,
        tie_points=700,
        start_position_sigma_m=0.0, start_attitude_sigma_deg=0.0, start_point_sigma_m=0.0,
    )  # fmt: skip
    problem = make_problem(made.block, AdjustmentSettings(robust_loss="none"))
    return problem, start_state(problem)


def test_remedies_of_a_weak_block() -> None:
    problem, state = weak_block()
    found: Deformation = deformation_and_remedies(problem, state, covariances(problem, state))
    assert set(found.remedy.tolist()) == {
        "control_in_the_middle", "control_in_corners_and_middle", "oblique_strip", "higher_cross_strip", "rtk",
    }  # fmt: skip
    before, after = found.remedy_sigma_m[:, 0], found.remedy_sigma_m[:, 1]
    assert np.all(after <= before * (1 + 1e-6))
    gain = dict(zip(found.remedy.tolist(), after[:, 2] / before[:, 2], strict=True))
    assert gain["oblique_strip"] < 0.6
    assert gain["control_in_the_middle"] < 0.95
    assert gain["control_in_corners_and_middle"] <= gain["control_in_the_middle"] + 1e-9


def test_what_holding_the_calibration_hides() -> None:
    problem, state = weak_block(control=0, gnss_m=0.02)
    camera = problem.block.cameras[0]
    held = replace(problem, block=replace(problem.block, cameras=(replace(camera, sigmas=np.zeros(PARAMETERS)),)))
    places = places_of(held, state)
    assert places is not None
    known = deformation_and_remedies(held, state, factored(held, state))
    assert known.freed_height_sigma_m[1] > 2 * np.sqrt(np.mean(known.height_sigma_m**2))
    assert np.all((known.freed_prior > 0) == (camera.parameters != 0))
    assert np.all(known.freed_sigma <= known.freed_prior * (1 + 1e-9))
    free = deformation_and_remedies(problem, state, factored(problem, state))
    none_held = replace(problem, block=replace(problem.block, cameras=(replace(camera, sigmas=np.ones(PARAMETERS)),)))
    assert with_fixed_released(free, none_held, state, places) is free


def test_too_few_tie_points_say_nothing() -> None:
    problem, state = small(1, ties=60)
    few = problem.with_tie_observations(problem.tie.select(problem.tie.point < 8))
    found = deformation_and_remedies(few, state, covariances(few, state))
    assert not found.known
    assert found.given_parameters.shape == (1, PARAMETERS)


def test_height_modes_fit_what_they_are() -> None:
    rng = np.random.default_rng(3)
    xy = rng.uniform(-80, 40, (50, 2))
    centre, radius = np.array([-20.0, -10.0]), 60.0
    offset = (xy - centre) / radius
    error = 0.3 + 0.1 * offset[:, 0] - 0.2 * offset[:, 1] + 0.5 * np.sum(offset**2, axis=1)
    mean, east, north, dome = height_modes(xy, centre, radius) @ error
    assert (east, north, dome) == pytest.approx((0.1, -0.2, 0.5))
    assert mean == pytest.approx(error.mean())


def test_points_spread_over_a_block() -> None:
    rng = np.random.default_rng(1)
    xy = np.concatenate([rng.normal(0, 1, (900, 2)), rng.uniform(-10, 10, (100, 2))])
    chosen = spread_points(xy, 5)
    assert 22 <= len(chosen) <= 25
    assert np.mean(np.linalg.norm(xy[chosen], axis=1)) > 4


@pytest.mark.parametrize("heading_deg", [0.0, 65.0, -120.0])
def test_a_tilted_course_looks_ahead_at_the_ground_below_its_middle(heading_deg: float) -> None:
    ground, above, tilt = 30.0, 80.0, 25.0
    setback = above * np.tan(np.radians(tilt))
    course = Course((12.0, -7.0), heading_deg, 5, 10.0, ground + above, tilt, setback)
    rotation, centre = course.poses()
    np.testing.assert_allclose(rotation[2] @ rotation[2].T, np.eye(3), rtol=0, atol=1e-12)
    assert np.linalg.det(rotation[2]) == pytest.approx(1.0)
    axis = rotation[2][:, 2]
    np.testing.assert_allclose(centre[2] - axis * above / axis[2], [12.0, -7.0, ground], rtol=0, atol=1e-9)
    flight = (centre[-1] - centre[0]) / 40.0
    np.testing.assert_allclose(flight[:2], [np.sin(np.radians(heading_deg)), np.cos(np.radians(heading_deg))])
    assert flight @ axis > 0.0, "it looks where it goes"


def test_the_summary_is_of_the_middle_the_heights_looked_at_and_the_dome() -> None:
    sigma = np.arange(1.0, 6 + 15 + 12 + 1)
    stiff = Stiffness(np.eye(9), np.diag(sigma**2), np.zeros((15, 15)))
    np.testing.assert_allclose(stiff.summary, [sigma[8], np.sqrt(np.mean(sigma[21:] ** 2)), sigma[DOME]])
    np.testing.assert_allclose(stiff.height_sigma_m, sigma[21:])


def test_strips_are_as_long_as_the_block_and_no_longer() -> None:
    problem, state = small(5, replace(PLAN, strips=8, photographs_per_strip=9), 400)
    places = places_of(problem, state)
    assert places is not None
    site, courses = _site(state, places), strips(state, places)
    assert courses["oblique_strip"].forward @ courses["higher_cross_strip"].forward == pytest.approx(0.0, abs=1e-12)
    for name, length, base in (
        ("oblique_strip", site.along_m, site.base_m),
        ("higher_cross_strip", site.across_m, HIGHER * site.base_m),
    ):
        course = courses[name]
        assert course.photographs > 3
        assert course.base_m == pytest.approx(base)
        assert (course.photographs - 2) * base < length <= (course.photographs - 1) * base


def test_photographs_more_are_measured_as_most_of_the_block() -> None:
    block = small()[0].block
    bare = [replace(p, gnss_world_m=None, gnss_sigma_m=None) for p in block.photographs]
    half = len(bare) // 2
    for known in (half, half + 1):
        first = replace(block.photographs[0], flight="first")
        mixed = replace(block, photographs=(first, *block.photographs[1:known], *bare[known:]))
        (added,) = _added_photographs(mixed, 0, np.array([[1.0, 2.0, 3.0]]), 1)
        if 2 * known > len(bare):
            assert added.gnss_world_m is not None
            assert added.gnss_world_m.tolist() == [1.0, 2.0, 3.0]
            assert added.flight == "first"
        else:
            assert added.gnss_world_m is None


def test_what_nothing_fixes_releases_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def indeterminate(*_: object) -> None:
        raise IndeterminateError(None)

    problem, state = small()
    camera = problem.block.cameras[0]
    fixed = replace(problem, block=replace(problem.block, cameras=(replace(camera, sigmas=np.zeros(PARAMETERS)),)))
    places, known = places_of(problem, state), Deformation.unknown()
    assert places is not None
    monkeypatch.setattr("photogram.quality.fixed_parameters.factored", indeterminate)
    assert with_fixed_released(known, fixed, state, places) is known


def test_parameters_that_are_fixed_beside_zero_are_released_by_what_is_ordinary() -> None:
    camera = small()[0].block.cameras[0]
    sigmas, parameters = np.zeros(PARAMETERS), np.zeros(PARAMETERS)
    parameters[[FOCAL, CX, K1, K2]] = 1500.0, 700.0, 0.01, 0.02
    sigmas[K2] = 0.1
    given = replace(camera.with_parameters(parameters), sigmas=sigmas)
    found, of = ordinary_sigmas(given), CAMERA_PARAMETERS
    assert np.flatnonzero(found).tolist() == [FOCAL, CX, K1]
    for k in (FOCAL, CX, K1):
        assert found[k] == of[k].in_its_unit(of[k].ordinary, 1500.0, camera.width_px)


def test_cells_are_numbered_row_by_row_and_none_twice() -> None:
    grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0)), axis=-1).reshape(-1, 2) + 0.5
    xy = np.vstack([[[0.0, 0.0], [4.0, 4.0]], grid])
    cells = cells_of(xy, 4)
    assert cells[:2].tolist() == [0, 15]
    np.testing.assert_array_equal(cells[2:], (4 * np.floor(grid[:, 0]) + np.floor(grid[:, 1])).astype(int))


def test_parts_of_the_covariance_follow_each_other() -> None:
    """Nine modes, two rotations for each camera, the parameters of each camera, the offsets of each flight."""
    cameras = 3
    parts = [
        *(rotations_of(c) for c in range(cameras)),
        *(parameters_of(c, cameras) for c in range(cameras)),
        *(offset_of(f, cameras) for f in range(2)),
    ]
    assert parts[0].start == 9
    assert all(before.stop == after.start for before, after in pairwise(parts))
    assert [part.stop - part.start for part in parts] == [2] * cameras + [PARAMETERS] * cameras + [3] * 2
