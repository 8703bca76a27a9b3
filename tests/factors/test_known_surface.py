"""A known surface: both engines, derivatives against differences, and the rows against points that are variables."""

from dataclasses import replace

import numpy as np
import pytest
from makers import simulated
from referees import whole_normal_equations
from scipy.spatial.transform import Rotation

from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.arrays import FloatArray, IntArray
from photogram.constraints.known_surface import SurfaceControl
from photogram.factors.covariance import covariances
from photogram.factors.elimination.reprojection import Observations, predicted
from photogram.factors.elimination.state import State
from photogram.factors.graph import GroundValues, Problem, cost, ground_factors
from photogram.factors.ground_terms import GroundTerms
from photogram.factors.surfaces.known_surface import KnownSurfaceFactors, _intersected, intersected_distances
from photogram.factors.variables import CALIBRATION, COMMON_ERROR, POSE, TIE_POINT, key
from photogram.projection import recalibrated
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=3, control_points=3, check_points=0,
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0002, np.inf, 0.0, 0.0),
)  # fmt: skip
SETTINGS = AdjustmentSettings(robust_loss="none")
SIGMA_M, COMMON_M, HIGHER_M = 0.05, 0.2, 0.3


def surface_of(made: SimulatedBlock, tie: IntArray, place_world_m: FloatArray, sigma_m: FloatArray) -> SurfaceControl:
    """The tie points with these numbers on facets that lean by up to 30 degrees."""
    rng = np.random.default_rng(5)
    normal = np.column_stack([np.tan(np.radians(rng.uniform(-21, 21, (len(tie), 2)))), np.ones(len(tie))])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    xy = place_world_m[:, :2] - place_world_m[:, :2].mean(axis=0)
    edge = np.sqrt(np.mean(np.sum(xy**2, axis=1)))
    ties = made.block.tie_points
    rays = np.isin(ties.point, tie)
    return SurfaceControl(
        "made", ties.photograph[rays], np.searchsorted(tie, ties.point[rays]), ties.pixel[rays], ties.sigma_px[rays],
        place_world_m, place_world_m, normal,
        np.column_stack([normal[:, 2], normal[:, 2:] * xy / edge, -normal[:, :2]]), sigma_m, np.full(5, COMMON_M),
    )  # fmt: skip


def surveyed(off: float = 0.2) -> tuple[SimulatedBlock, IntArray, Problem, State]:
    """A block whose tie points of three rays and more lie on a surface that is too high by HIGHER_M."""
    made = simulated(PLAN, 3, off=off, tie_points=120)
    tie = np.flatnonzero(made.block.tie_points.rays >= 3)
    place = made.tie_point_position_world_m[tie] + [0.0, 0.0, HIGHER_M]
    surface = surface_of(made, tie, place, np.full(len(tie), SIGMA_M))
    problem = make_problem(replace(made.block, known_surface=surface), SETTINGS)
    return made, tie, problem, start_state(problem)


def factors_of(problem: Problem) -> list[KnownSurfaceFactors]:
    return [factors for factors in ground_factors(problem) if isinstance(factors, KnownSurfaceFactors)]


def test_both_engines_reach_the_same_minimum_by_the_same_steps() -> None:
    made, _, problem, start = surveyed()
    assert len({len(factors.kinds) for factors in factors_of(problem)}) > 1
    fast, slow = (minimise(problem, start, replace(SETTINGS, engine=engine)) for engine in ("fast", "reference"))
    assert (fast.iterations, fast.converged) == (slow.iterations, slow.converged) == (fast.iterations, True)
    assert fast.cost == pytest.approx(slow.cost, rel=1e-8)
    assert fast.cost == pytest.approx(cost(problem, ground_factors(problem), fast.state), rel=1e-12)
    for name in ("rotation", "position", "parameters", "tie_point", "common"):
        np.testing.assert_allclose(getattr(fast.state, name), getattr(slow.state, name), rtol=1e-8, atol=1e-7)
    without = make_problem(made.block, SETTINGS)
    alone = minimise(without, start_state(without), SETTINGS)
    assert (
        np.abs(fast.state.position - alone.state.position).max() > 0.01
    )  # a factor that changes nothing proves nothing


def exact(problem: Problem, state: State) -> Problem:
    """The problem whose rays are exactly those of the state."""
    surface = problem.block.known_surface
    assert surface is not None
    seen = predicted(surface.photograph, surface.point, state.cameras, surface.start_world_m)
    return replace(problem, block=replace(problem.block, known_surface=replace(surface, pixel=seen.pixel)))


def moved(problem: Problem, state: State, variable: int, step: FloatArray) -> State:
    kind, index = chr(variable >> 56), variable & ((1 << 56) - 1)
    if kind == POSE:
        rotation, position = state.rotation.copy(), state.position.copy()
        rotation[index] = rotation[index] @ Rotation.from_rotvec(step[:3]).as_matrix()
        position[index] += state.rotation[index] @ step[3:]
        return replace(state, cameras=state.cameras._replace(rotation=rotation, position=position))
    if kind == CALIBRATION:
        parameters = state.parameters.copy()
        parameters[index, problem.free[index]] += step * problem.scale[index][problem.free[index]]
        return replace(state, cameras=recalibrated(state.cameras, parameters))
    common = state.common.copy()
    common[-5:] += step
    return replace(state, common=common)


def test_jacobians_are_those_of_differences() -> None:
    _, _, problem, start = surveyed(off=0.0)
    problem = exact(problem, start)
    for factors in factors_of(problem):
        linear = factors.linearised(GroundValues(problem, start))
        column = 0
        for variable in factors.variables[0].tolist():
            size = {POSE: 6, CALIBRATION: len(problem.free[0]), COMMON_ERROR: 5}[chr(variable >> 56)]
            for k in range(size):
                step = np.zeros(size)
                step[k] = 1e-4 if chr(variable >> 56) == CALIBRATION else 1e-6
                plus, minus = (
                    factors.linearised(GroundValues(problem, moved(problem, start, variable, sign * step))).misfit[0]
                    for sign in (1.0, -1.0)
                )
                found = (plus - minus) / (2.0 * step[k])
                np.testing.assert_allclose(linear.jacobian[0, :, column], found, rtol=1e-5, atol=2e-4)
                column += 1
        assert column == linear.jacobian.shape[2]


def test_rows_on_cameras_are_points_that_the_surface_observes() -> None:
    """One row on the cameras for a point is the same as the point itself observed, and eliminated with its rays."""
    made, tie, problem, _ = surveyed()
    surface = problem.block.known_surface
    assert surface is not None
    bare = replace(problem, block=replace(problem.block, known_surface=None))
    state = minimise(bare, start_state(bare), replace(SETTINGS, relative_tolerance=1e-16)).state
    _, _, own_m2 = intersected_distances(surface, state.cameras)
    within = replace(surface, sigma_m=np.sqrt(SIGMA_M**2 + own_m2))
    rowed = replace(problem, block=replace(problem.block, known_surface=within))
    information, _, place = whole_normal_equations(bare, state)
    for k, p in enumerate(tie.tolist()):
        row = np.zeros(len(information))
        row[place[key(TIE_POINT, p)]] = surface.normal_world[k] / SIGMA_M
        row[place[key(COMMON_ERROR, len(bare.block.common_errors) - 1)]] = surface.common[k] / SIGMA_M
        information += np.outer(row, row)
    scale = np.sqrt(np.diag(information))
    expected = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    found = covariances(rowed, state)
    np.testing.assert_allclose(
        found.common(len(bare.block.common_errors) - 1),
        expected[place[key(COMMON_ERROR, len(bare.block.common_errors) - 1)]][
            :, place[key(COMMON_ERROR, len(bare.block.common_errors) - 1)]
        ],
        rtol=1e-6,
    )
    for i in range(len(made.block.photographs)):
        at = place[key(POSE, i)]
        sigma = np.sqrt(np.diag(expected[at, at]))
        np.testing.assert_allclose(found.pose(i) / np.outer(sigma, sigma), expected[at, at] / np.outer(sigma, sigma),
                                   atol=1e-6)  # fmt: skip


def test_rows_of_a_kind_are_those_of_its_factors() -> None:
    _, tie, problem, start = surveyed()
    layout = covariances(problem, start).layout
    misfits, rows = GroundTerms(problem, layout).rows_of(start, KnownSurfaceFactors)
    whole = sum(float(np.sum(f.linearised(GroundValues(problem, start)).misfit ** 2)) for f in factors_of(problem))
    assert (misfits.shape, rows.shape) == ((len(tie),), (len(tie), layout.columns + layout.border))
    assert float(misfits @ misfits) == pytest.approx(whole)
    assert np.count_nonzero(rows[0]) >= 3 * 6


def test_points_go_with_the_photographs_that_see_them() -> None:
    _, _, problem, _ = surveyed()
    surface = problem.block.known_surface
    assert surface is not None
    number = np.array([0, 1, 2, -1, 3, 4])
    part = surface.in_photographs(number)
    assert part is not None
    assert 0 < len(part) < len(surface)
    assert set(part.photograph.tolist()) <= {0, 1, 2, 3, 4}
    assert surface.in_photographs(np.full(6, -1)) is None
    with pytest.raises(ValueError, match="start_world_m"):
        replace(surface, sigma_m=surface.sigma_m[1:])


def test_points_behind_their_photographs_stay_and_pull_at_nothing() -> None:
    _, _, _, state = surveyed()
    above = np.array([[0.0, 0.0, state.position[:, 2].max() + 200.0]])
    pixel = np.full((2, 2), 500.0)
    rays = Observations(np.array([0, 1]), np.zeros(2, np.int64), pixel, np.ones(2))
    X, _, turned = _intersected(rays, state.cameras, above, np.array([[0.0, 0.0, 1.0]]))
    np.testing.assert_array_equal(X, above)
    np.testing.assert_array_equal(turned, 0.0)
