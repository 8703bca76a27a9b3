"""Fisheyes, affinity and k4 through the whole adjustment: both engines, GTSAM, truth, cameras per flight."""

from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from referees import gtsam_marginals
from scipy.spatial.transform import Rotation

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.adjustment.self_calibration import with_priors
from photogram.camera import Camera, Pose, oriented_by, project_points
from photogram.factors.covariance import covariances
from photogram.factors.elimination.kernels import CALIBRATION, linearise_point, point_cost
from photogram.factors.elimination.reprojection import linearise
from photogram.factors.graph import cost, ground_factors
from photogram.factors.variables import CALIBRATION as CALIBRATION_KIND
from photogram.factors.variables import POSE, TIE_POINT, key
from photogram.projection import (
    B1,
    CAMERA_PARAMETERS,
    FISHEYE,
    K4,
    MODELS,
    PARAMETER_NAMES,
    PARAMETERS,
    Model,
    project_point_jacobians,
)
from photogram.results import Adjustment
from photogram.sfm.reconstruction import Structure, StructureSettings
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import Block

EYE = SurveyPlan(
    camera_model="fisheye", focal_px=750.0, radial=(0.02, -0.012, 0.006, -0.002), affinity_px=(1.5, -0.8),
    calibration_sigmas=(5.0, 3.0, 3.0, 0.01, 0.01, 0.01, 0.005, 0.0, 0.0, 2.0, 2.0), strips=3, photographs_per_strip=4,
    forward_overlap=0.75, side_overlap=0.65, flying_height_m=50.0, control_points=10, check_points=2, relief_m=15.0,
)  # fmt: skip
AFFINE = SurveyPlan(
    focal_px=900.0, radial=(-0.08, 0.06, -0.01, 0.002), affinity_px=(2.5, 1.2),
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.004, 0.004, 0.002, 0.0002, 0.0002, 4.0, 4.0), strips=3,
    photographs_per_strip=4, control_points=10, check_points=2, relief_m=15.0,
)  # fmt: skip
PLANS = {"fisheye": EYE, "affine": AFFINE}


@cache
def simulated(name: str, seed: int, tie_points: int) -> SimulatedBlock:
    return simulate_block(
        PLANS[name], seed, tie_points=tie_points, start_position_sigma_m=0.2, start_attitude_sigma_deg=0.2,
        start_point_sigma_m=0.2,
    )  # fmt: skip


@cache
def adjusted(name: str, seed: int) -> Adjustment:
    return adjust(simulated(name, seed, 800).block, AdjustmentSettings())


small = st.floats(-1.0, 1.0)


@settings(max_examples=100, deadline=None)
@given(
    model=st.sampled_from(sorted(MODELS)),
    terms=st.lists(small, min_size=9, max_size=9),
    place=st.tuples(small, small, st.floats(0.3, 3.0)),
    free=st.lists(st.booleans(), min_size=PARAMETERS, max_size=PARAMETERS),
)
def test_the_kernel_of_the_engine_is_that_of_the_camera(
    model: Model, terms: list[float], place: tuple[float, float, float], free: list[bool]
) -> None:
    q = np.array([1000.0, 3.0, 4.0, *(np.array(terms) * [0.1, 0.05, 0.02, 0.01, 0.003, 0.003, 20.0, 20.0, 0.05])])
    R = Rotation.from_rotvec([0.1, 0.2, -0.3]).as_matrix()
    C = np.array([1.0, 2.0, 3.0])
    X = C + R @ (10.0 * np.array(place))
    J_pose, J_camera, J_point = np.zeros((2, 6)), np.zeros((2, PARAMETERS)), np.zeros((2, 3))
    camera = Camera("c", 1000, 1000, 1000.0, np.zeros(2), model=model).with_parameters(q)
    cameras = oriented_by([camera], np.zeros(1, np.int64), [Pose(R, C, np.array([0.8, -0.5, 0.1]))])
    u, v = 0.0, 0.0
    for _ in range(20):  # the row at which it is measured decides where the camera was
        before = u, v
        u, v, _ = project_point_jacobians(cameras, 0, X, v + 4.0, J_pose, J_camera, J_point)
    assume(np.hypot(u - before[0], v - before[1]) < 1e-9)  # else it crosses the picture faster than it is read
    chosen, unit = np.flatnonzero(free), np.linspace(0.5, 1.5, PARAMETERS)
    free_of = np.zeros((1, 3 + PARAMETERS), np.int64)
    free_of[0, 1], free_of[0, 3 : 3 + len(chosen)] = len(chosen), chosen
    measured = np.array([[u - 3.0, v + 4.0, 2.0]])
    J, V = np.zeros((2, CALIBRATION + PARAMETERS)), np.zeros(12)
    ray, of_free = (0, 1, np.zeros(1, np.int64), measured, measured, cameras), np.where(free, unit, 0.0)[None]
    assert linearise_point(*ray, of_free, X[None], 0, free_of, 0, 1.0, 1.0, J, V) == 0
    np.testing.assert_allclose(J[:, 9], [6.0, -8.0], rtol=1e-9)
    cost, bad = point_cost(*ray, X[None], 0, 0, 1.0)
    assert cost == pytest.approx(50.0)
    assert bad == 0
    for part, expected in ((J[:, :6], J_pose), (J[:, 6:9], J_point)):
        np.testing.assert_allclose(part, 2.0 * expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    own = 2.0 * (J_camera * unit)[:, chosen]
    found, least = J[:, CALIBRATION : CALIBRATION + len(chosen)], 1e-9 * (1.0 + np.abs(own).max(initial=0.0))
    np.testing.assert_allclose(found, own, rtol=1e-9, atol=least)


@pytest.mark.parametrize("name", PLANS)
def test_both_engines_take_the_same_steps(name: str) -> None:
    block = simulated(name, 1, 150).block
    problem = make_problem(block, AdjustmentSettings(robust_threshold=200.0))  # none is a mismatch
    start = start_state(problem)
    fast, slow = (minimise(problem, start, AdjustmentSettings(engine=engine)) for engine in ("fast", "reference"))
    assert (fast.iterations, fast.converged) == (slow.iterations, True)
    assert fast.cost == pytest.approx(slow.cost, rel=1e-9)
    assert fast.cost == pytest.approx(cost(problem, ground_factors(problem), fast.state), rel=1e-12)
    for part in ("rotation", "position", "parameters", "tie_point", "control", "offset"):
        np.testing.assert_allclose(getattr(fast.state, part), getattr(slow.state, part), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("name", PLANS)
def test_covariances_are_gtsams_marginals(name: str) -> None:
    block = simulated(name, 2, 60).block
    problem = make_problem(block, AdjustmentSettings(robust_loss="none"))
    state = minimise(problem, start_state(problem), AdjustmentSettings(robust_loss="none")).state
    found = covariances(problem, state)
    marginals = gtsam_marginals(problem, state)
    free, scale = problem.free[0], problem.scale[0]
    expected = marginals.marginalCovariance(key(CALIBRATION_KIND, 0)) * np.outer(scale[free], scale[free])
    calibration = found.calibration(0)
    assert np.flatnonzero(np.diag(calibration)).tolist() == free.tolist()
    pairs = [(calibration[np.ix_(free, free)], expected)]
    pairs += [(found.pose(i), marginals.marginalCovariance(key(POSE, i))) for i in range(3)]
    pairs += [(found.tie_point[p], marginals.marginalCovariance(key(TIE_POINT, p))) for p in range(0, 60, 7)]
    for own, other in pairs:
        sigma = np.sqrt(np.diag(other))
        np.testing.assert_allclose(own / np.outer(sigma, sigma), other / np.outer(sigma, sigma), rtol=0, atol=1e-6)


def test_gtsams_own_fisheye_gives_the_same_errors_and_jacobians() -> None:
    # Cal3Fisheye: fx fy s u0 v0 k1 k2 k3 k4, so b1 = fx − fy and b2 = s · (its skew multiplies y).
    block = simulated("fisheye", 2, 60).block
    problem = make_problem(
        replace(block, cameras=(replace(block.cameras[0], tangential=np.zeros(2)),)), AdjustmentSettings()
    )
    state, tie = start_state(problem), problem.tie
    f, cx, cy, k1, k2, k3, k4, p1, p2, b1, b2, _ = state.parameters[0]
    assert p1 == p2 == 0.0
    calibration = gtsam.Cal3Fisheye(f + b1, f, b2, cx, cy, k1, k2, k3, k4)
    linear = linearise(tie, state.cameras, state.tie_point)
    for i in range(0, len(tie), 9):
        p, x = int(tie.photograph[i]), state.tie_point[tie.point[i]]
        local = state.rotation[p].T @ (x - state.position[p])
        D_calibration, D_point = np.zeros((2, 9), order="F"), np.zeros((2, 2), order="F")
        uv = calibration.uncalibrate(local[:2] / local[2], D_calibration, D_point)
        np.testing.assert_allclose((uv - tie.pixel[i]) / tie.sigma_px[i], linear.residual[i], rtol=0, atol=1e-8)
        # K's derivatives: f moves both focal lengths, b1 the first alone, b2 is the skew
        names = ("cx_px", "cy_px", "k1", "k2", "k3", "k4", "b1", "b2")
        own = linear.calibration[i][:, [PARAMETER_NAMES.index(n) for n in names]] * tie.sigma_px[i]
        np.testing.assert_allclose(own, D_calibration[:, [3, 4, 5, 6, 7, 8, 0, 2]], rtol=1e-7, atol=1e-7)
        focal = linear.calibration[i][:, 0] * tie.sigma_px[i]
        np.testing.assert_allclose(focal, D_calibration[:, 0] + D_calibration[:, 1], rtol=1e-7, atol=1e-7)
        perspective = np.array([[1.0, 0.0, -local[0] / local[2]], [0.0, 1.0, -local[1] / local[2]]]) / local[2]
        expected = D_point @ perspective @ state.rotation[p].T
        np.testing.assert_allclose(linear.point[i] * tie.sigma_px[i], expected, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("name", PLANS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_adjustment_recovers_the_camera(name: str, seed: int) -> None:
    result, truth = adjusted(name, seed), simulated(name, seed, 800).truth.camera
    camera = result.block.cameras[0]
    assert result.converged
    assert camera.model == truth.model
    assert result.sigma0 == pytest.approx(1.0, abs=0.05)
    sigma = np.sqrt(np.diag(result.covariances.calibration[0]))
    free = sigma > 0
    assert free.tolist() == [s > 0 for s in (*PLANS[name].calibration_sigmas, 0.0)]
    normalised = (camera.parameters - truth.parameters)[free] / sigma[free]
    assert np.abs(normalised).max() < 3.0, dict(zip(np.array(PARAMETER_NAMES)[free], normalised, strict=True))
    np.testing.assert_array_equal(camera.parameters[~free], truth.parameters[~free])
    affinity = [PARAMETER_NAMES.index(n) for n in ("b1", "b2")]
    assert np.all(np.abs(truth.parameters[affinity]) > 3.0 * sigma[affinity]), "the affinity is told from none"


def test_a_fisheye_is_no_brown_camera() -> None:
    """The observations of a fisheye do not fit the other model, so neither engine can have ignored it."""
    block = simulated("fisheye", 1, 800).block
    wrong = replace(block, cameras=(replace(block.cameras[0], model="brown"),))
    problem, other = (make_problem(b, AdjustmentSettings()) for b in (block, wrong))
    state, brown = start_state(problem), start_state(other)
    assert cost(other, ground_factors(other), brown) > 5.0 * cost(problem, ground_factors(problem), state)
    assert state.cameras.model.tolist() == [FISHEYE]


def test_a_growing_block_of_a_fisheye() -> None:
    made = simulated("fisheye", 1, 800)
    camera_of = np.zeros(len(made.block.photographs), dtype=np.int64)
    structure = Structure.empty(made.block.tie_points, [made.truth.camera], camera_of, StructureSettings())
    for i in (0, 1):
        structure.register(i, made.truth.poses[i])
    structure.intersect()
    assert structure.known.sum() > 100
    assert structure.resect(2)
    assert np.linalg.norm(structure.position[2] - made.truth.poses[2].position_world_m) < 0.3
    structure.adjust(calibrate=False)
    good = structure.good & structure.known[made.block.tie_points.point]
    assert np.median(structure.residual_px(good)) < 1.0


def test_parameters_left_free_get_wide_priors() -> None:
    camera = Camera("c", 4000, 3000, 3500.0, np.array([2000.0, 1500.0]), sigmas=np.full(PARAMETERS, np.inf))
    sigmas = dict(zip(PARAMETER_NAMES, with_priors(camera).sigmas.tolist(), strict=True))
    assert sigmas["b1"] == sigmas["b2"] == CAMERA_PARAMETERS[B1].weakest * 3500.0
    assert sigmas["k4"] == CAMERA_PARAMETERS[K4].weakest


# ---- a camera per flight --------------------------------------------------------------------------------------------


def two_flights(longer_px: float) -> tuple[SimulatedBlock, Block]:
    """A block whose second flight has a longer focal length; each has a camera of its own, alike at the start."""
    plan = SurveyPlan(  # known heights: nothing else tells the focal length of photographs that look straight down
        strips=4, flights=2, control_points=12, check_points=2, relief_m=15.0, gnss_offset_sigma_m=(0.0, 0.0, 0.0)
    )
    made = simulate_block(
        plan, 5, tie_points=1500, start_position_sigma_m=0.2, start_attitude_sigma_deg=0.2, start_point_sigma_m=0.2
    )
    block, truth = made.block, made.truth
    second = np.array([p.flight == "2" for p in block.photographs])
    other = replace(truth.camera, focal_px=truth.camera.focal_px + longer_px)
    tie, control = block.tie_points, block.control_points
    pixel, marks = tie.pixel.copy(), control.mark_pixel.copy()
    for i in np.flatnonzero(second):
        for pixels, photograph, X in (
            (pixel, tie.photograph, made.tie_point_position_world_m[tie.point]),
            (marks, control.mark_photograph, truth.control_position_world_m[control.mark_point]),
        ):
            own = photograph == i
            pixels[own] += project_points(other, truth.poses[i], X[own]) - project_points(
                truth.camera, truth.poses[i], X[own]
            )
    camera = block.cameras[0]
    return made, replace(
        block,
        cameras=(replace(camera, name="c (flight 1)"), replace(camera, name="c (flight 2)")),
        photographs=tuple(replace(p, camera=int(s)) for p, s in zip(block.photographs, second, strict=True)),
        tie_points=replace(tie, pixel=pixel),
        control_points=replace(control, mark_pixel=marks),
    )


def test_two_flights_with_focal_lengths_of_their_own_are_told_apart() -> None:
    made, block = two_flights(3.0)
    result = adjust(block, AdjustmentSettings())
    focal = np.array([camera.focal_px for camera in result.block.cameras])
    sigma = np.sqrt(result.covariances.calibration[:, 0, 0])
    truth = made.truth.camera.focal_px + np.array([0.0, 3.0])
    assert np.all(np.abs(focal - truth) < 3.0 * sigma)
    assert focal[1] - focal[0] > 3.0 * np.hypot(*sigma)
    assert result.sigma0 == pytest.approx(1.0, abs=0.05)
