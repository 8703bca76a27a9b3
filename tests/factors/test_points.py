"""Elimination of points against the dense normal equations, and the band against dense linear algebra."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import FloatArray
from photogram.factors.elimination import points as elimination
from photogram.factors.elimination.kernels import BEHIND_PX
from photogram.factors.elimination.loss import KINDS, Loss, RobustLoss, robust_terms, steer, steering
from photogram.factors.elimination.points import (
    Points,
    Rays,
    eliminate,
    first_observations,
    lay_out,
    observation_cost,
    point_covariances,
    substitute,
)
from photogram.factors.elimination.reduced import Layout, NormalEquations, SingularError, make_layout, scale_matrix
from photogram.factors.elimination.reprojection import Observations, linearise, residuals
from photogram.projection import PARAMETERS
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block

PLAN = SurveyPlan(strips=2, photographs_per_strip=4, control_points=4, check_points=0)
STRAIGHT = np.zeros((4, 3))
HUBER = Loss(KINDS["huber"], 2.0)


class Case:
    """Eight photographs of two cameras, one of which is fixed and read row by row; the photograph 3 is held."""

    def __init__(self, tie_points: int = 60, twice: bool = False) -> None:
        made = simulate_block(
            PLAN, 4, tie_points=tie_points, mismatches=0.05, start_position_sigma_m=0.05, start_attitude_sigma_deg=0.1,
            start_point_sigma_m=0.1,
        )  # fmt: skip
        problem = make_problem(made.block, AdjustmentSettings())
        state, tie = start_state(problem), problem.tie
        photograph = tie.photograph.copy()
        if twice:
            first = first_observations(tie.point, tie_points)
            many = first[np.argmax(np.diff(first))]
            photograph[many + 1] = photograph[many]
        self.tie = replace(tie, photograph=photograph)
        other = np.array([9.0, 2.0, -1.0, 0.001, *[0.0] * 5, 7.0, -4.0, 0.02])
        self.cameras = state.cameras._replace(
            camera=np.arange(len(state.position)) % 2,
            velocity=np.random.default_rng(3).normal(0.0, 5.0, state.position.shape),
            model=np.zeros(2, np.int64),
            parameters=np.vstack([state.parameters, state.parameters + other]),
            largest_radius=np.tile(state.cameras.largest_radius, 2),
            size_px=np.tile(state.cameras.size_px, (2, 1)),
        )
        self.points = Points.unknown(state.tie_point)
        self.unit = np.zeros((2, PARAMETERS))
        self.unit[0] = [3.0, 2.0, 0.0, 5e-4, 5e-4, 5e-4, 0.0, 5e-4, 0.0, 1.0, 1.0, 1e-3]
        self.held = np.arange(8) == 3
        self.layout = self.lay(self.unit)
        self.rays = lay_out(self.tie, np.arange(tie_points), self.layout)

    def lay(self, unit: FloatArray) -> Layout:
        first = first_observations(self.tie.point, len(self.points.position))
        return make_layout([(first, self.tie.photograph)], self.held, self.cameras.position, unit, offsets=1)

    def jacobian(self, loss: Loss = HUBER) -> tuple[FloatArray, FloatArray]:
        """The dense weighted Jacobian on poses, border and points, and the weighted residuals."""
        tie, layout, X = self.tie, self.layout, self.points.position
        linear = linearise(tie, self.cameras, X)
        kind = {number: name for name, number in KINDS.items()}[loss.kind]
        turn, residual = steer(linear.residual, kind, loss.threshold, loss.least_curvature)
        edge = layout.columns + layout.border
        J = np.zeros((len(tie), 2, edge + 3 * len(X)))
        for i, (p, k, n) in enumerate(zip(tie.photograph, linear.camera, tie.point, strict=True)):
            at = 6 * layout.place[p]
            if at >= 0:
                J[i, :, at : at + 6] = linear.pose[i]
            free = np.flatnonzero(layout.unit[k] > 0)
            columns = layout.columns + layout.camera_column[k] + np.arange(len(free))
            J[i, :, columns] = (linear.calibration[i] * layout.unit[k])[:, free].T
            J[i, :, edge + 3 * n : edge + 3 * n + 3] = linear.point[i]
        return (turn @ J).reshape(2 * len(tie), -1), residual.ravel()


def dense(normal: NormalEquations) -> tuple[FloatArray, FloatArray]:
    """The reduced normal matrix and its right-hand side."""
    layout, m = normal.layout, normal.layout.columns
    A = lower(layout, normal.damped_poses(0.0))
    return np.block([[A, normal.B], [normal.B.T, normal.E]]), np.concatenate([normal.g, normal.h])[: m + layout.border]


def lower(layout: Layout, flat: FloatArray) -> FloatArray:
    """The symmetric matrix of which ``flat`` holds the lower part."""
    A, m = np.zeros((layout.columns, layout.columns)), layout.columns
    for c in range(m):
        rows = np.arange(c, m if layout.dense else min(m, c + layout.stride + 1))
        A[rows, c] = flat[c * layout.stride + rows]
    return A + np.tril(A, -1).T


def schur(H: FloatArray, g: FloatArray, edge: int) -> tuple[FloatArray, FloatArray]:
    W, V = H[:edge, edge:], H[edge:, edge:]
    return H[:edge, :edge] - W @ np.linalg.solve(V, W.T), g[:edge] - W @ np.linalg.solve(V, g[edge:])


@pytest.mark.parametrize("twice", [False, True])
@pytest.mark.parametrize("damping", [0.0, 1e-2])
@pytest.mark.parametrize("loss", [HUBER, steering("huber", 2.0), steering("cauchy", 2.0), steering("none", 1.0)])
def test_elimination_is_the_schur_complement(loss: Loss, damping: float, twice: bool) -> None:
    case = Case(twice=twice)
    normal = NormalEquations.zero(case.layout)
    failed = eliminate(case.rays, case.cameras, case.points, normal, loss, damping)
    J, r = case.jacobian(loss)
    H, g, edge = J.T @ J, -J.T @ r, case.layout.columns + case.layout.border
    diagonal = np.diag(H).copy()
    H[np.arange(edge, len(H)), np.arange(edge, len(H))] *= 1.0 + damping
    expected, right = schur(H, g, edge)
    found, found_right = dense(normal)
    size = np.sqrt(diagonal[:edge]) + 1e-12
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found_right / size, right / size, rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.concatenate([normal.D, normal.F]), diagonal[:edge], rtol=1e-9)
    assert failed == -1


def test_the_cost_is_the_sum_of_the_losses() -> None:
    case = Case()
    c = case.cameras
    whitened = residuals(case.tie, c, case.points.position)
    cost = observation_cost(case.rays, c, case.points.position, HUBER)
    assert cost == pytest.approx(0.5 * robust_terms(whitened, "huber", HUBER.threshold)[0].sum(), rel=1e-12)


def test_rays_from_behind_cost_much_and_pull_at_nothing() -> None:
    case = Case()
    at = case.points.position.copy()
    at[7, 2] += 500.0  # above all photographs
    before, after = (NormalEquations.zero(case.layout) for _ in range(2))
    rest = case.tie.select(case.tie.point != 7)
    others = lay_out(rest, np.delete(np.arange(60), 7), case.layout)
    assert eliminate(case.rays, case.cameras, Points.unknown(at), before, HUBER, 1e-3) == -1
    assert eliminate(others, case.cameras, Points.unknown(at), after, HUBER, 1e-3) == -1
    for found, expected in ((before.A, after.A), (before.Q, after.Q), (before.H, after.H)):
        np.testing.assert_array_equal(found, expected)
    costs = [observation_cost(r, case.cameras, at, HUBER) for r in (case.rays, others)]
    rays = case.tie.point == 7
    penalty = robust_terms(np.column_stack([BEHIND_PX / case.tie.sigma_px[rays], np.zeros(rays.sum())]), "huber", 2.0)
    assert costs[0] - costs[1] == pytest.approx(0.5 * penalty[0].sum(), rel=1e-12)
    step = np.zeros(case.layout.columns), np.zeros(case.layout.border)
    moved, _, _ = substitute(
        case.rays, case.cameras, Points.unknown(at), case.layout, HUBER, 1e-3, step, case.cameras, STRAIGHT
    )
    np.testing.assert_array_equal(moved[7], at[7])


def test_a_step_solves_marquardts_equations_of_everything() -> None:
    case, damping, wide = Case(), 1e-3, Loss(KINDS["huber"], 1e4)  # points with mismatches would go farther
    layout, edge = case.layout, case.layout.columns + case.layout.border
    J, r = case.jacobian(wide)
    H, g = J.T @ J, -J.T @ r
    damped = H + damping * np.diag(np.diag(H))
    unseen = np.diag(H) == 0
    damped[unseen, unseen] = 1.0
    expected = np.asarray(np.linalg.solve(damped, g), dtype=np.float64)
    poses, border = expected[: layout.columns], expected[layout.columns : edge]
    moved = case.cameras._replace(parameters=case.cameras.parameters * 1.0001, position=case.cameras.position + 0.01)
    X, predicted, cost = substitute(
        case.rays, case.cameras, case.points, layout, wide, damping, (poses, border), moved, STRAIGHT
    )
    step = expected[edge:].reshape(-1, 3)
    np.testing.assert_allclose(X - case.points.position, step, rtol=0, atol=1e-6 * np.abs(step).max())
    normal = NormalEquations.zero(layout)
    eliminate(case.rays, case.cameras, case.points, normal, wide, damping)
    normal.H[[9, 10, 11], [9, 10, 11]] = 1.0  # the offset, which no image point knows
    found = normal.factor(damping).solve(normal.g, normal.h)
    np.testing.assert_allclose(np.concatenate(found), expected[:edge], rtol=0, atol=1e-6 * np.abs(expected).max())
    saved = g @ expected - 0.5 * expected @ H @ expected
    cameras = 0.5 * damping * np.sum(np.diag(H)[:edge] * expected[:edge] ** 2)
    assert predicted + cameras == pytest.approx(saved, rel=1e-6)
    whitened = residuals(case.tie, moved, X)
    assert cost == pytest.approx(0.5 * robust_terms(whitened, "huber", wide.threshold)[0].sum(), rel=1e-12)


def test_a_bend_of_the_block_is_added_to_the_steps_of_its_points() -> None:
    case, square = Case(), Loss(KINDS["none"], 1.0)
    bend = 1e-3 * np.random.default_rng(8).normal(size=(4, 3))
    step = np.zeros(case.layout.columns), np.zeros(case.layout.border)
    straight, bending = (
        substitute(case.rays, case.cameras, case.points, case.layout, square, 1e-3, step, case.cameras, each)[0]
        for each in (STRAIGHT, bend)
    )
    added = (case.points.position - bend[3]) @ bend[:3].T
    np.testing.assert_allclose(bending - straight, added, rtol=0, atol=1e-9)


def test_points_with_mismatches_go_down_their_own_cost_while_the_cameras_rest() -> None:
    """From some metres off, where each residual is beyond the threshold, to where exact rays meet, by damping that lets
    a common step move nothing."""
    case, loss = Case(), Loss(KINDS["huber"], 2.0)
    true, still = case.points.position, (np.zeros(case.layout.columns), np.zeros(case.layout.border))
    exact = case.tie
    for _ in range(4):  # the row that is read has moved with the pixel
        misfit_px = residuals(exact, case.cameras, true) * exact.sigma_px[:, None]
        exact = replace(exact, pixel=exact.pixel + misfit_px)
    rays = lay_out(exact, np.arange(60), case.layout)
    start = Points.unknown(true + np.random.default_rng(6).normal(0.0, 2.0, true.shape))
    assert observation_cost(rays, case.cameras, start.position, loss) > 1e3
    moved, _, cost = substitute(rays, case.cameras, start, case.layout, loss, 1e9, still, case.cameras, STRAIGHT)
    np.testing.assert_allclose(moved, true, rtol=0, atol=1e-6)
    assert cost < 1e-9


@pytest.mark.parametrize("twice", [False, True])
def test_points_have_the_covariance_of_the_whole_normal_matrix(twice: bool) -> None:
    case = Case(twice=twice)
    layout, edge = case.layout, case.layout.columns + case.layout.border
    J, _ = case.jacobian()
    H = J.T @ J
    H[:edge, :edge] += np.eye(edge) * np.diag(H)[:edge].max() * 1e-3  # what else is known of the cameras
    covariance = np.linalg.inv(H)
    normal = NormalEquations.zero(layout)
    eliminate(case.rays, case.cameras, case.points, normal, HUBER, 0.0)
    known = np.diag(J.T @ J)[:edge].max() * 1e-3
    factor = normal.factor(shift=known)
    border = factor.border_covariance()
    found, failed = point_covariances(
        case.rays, case.cameras, case.points, layout, HUBER, (factor.inverse_within_band(), factor.T, border)
    )
    assert failed == -1
    for p, block in enumerate(found):
        at = edge + 3 * p
        expected = covariance[at : at + 3, at : at + 3]
        np.testing.assert_allclose(block, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_what_is_known_of_a_point_counts_as_more_rays() -> None:
    case = Case()
    information = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 2.0]])
    count = len(case.points.position)
    right = np.random.default_rng(0).standard_normal((count, 3))
    prior = np.concatenate([np.tile(information.ravel(), (count, 1)), right], axis=1)
    normal = NormalEquations.zero(case.layout)
    eliminate(case.rays, case.cameras, Points(case.points.position, prior), normal, HUBER, 0.0)
    J, r = case.jacobian()
    H, g, edge = J.T @ J, -J.T @ r, case.layout.columns + case.layout.border
    for p in range(count):
        at = slice(edge + 3 * p, edge + 3 * p + 3)
        H[at, at] += information
        g[at] += right[p]
    expected, expected_right = schur(H, g, edge)
    found, found_right = dense(normal)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(found_right, expected_right, rtol=0, atol=1e-9 * np.abs(expected_right).max())


def test_a_point_that_its_rays_cannot_fix_is_told() -> None:
    case = Case()
    first = first_observations(case.tie.point, 60)
    keep = np.ones(len(case.tie), dtype=bool)
    keep[first[17] + 1 : first[18]] = False
    rays = lay_out(case.tie.select(keep), np.arange(60), case.layout)
    assert eliminate(rays, case.cameras, case.points, NormalEquations.zero(case.layout), HUBER, 0.0) == 17


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elimination, "MANY_OBSERVATIONS", 1000)
    case = Case(tie_points=800)
    assert len(case.rays.chunks) == 4
    found = []
    for threads in (None, 1, 2, 4):
        normal = NormalEquations.zero(case.layout)
        with ThreadPoolExecutor(threads or 1) as pool:
            given = None if threads is None else pool
            eliminate(case.rays, case.cameras, case.points, normal, HUBER, 1e-4, given)
            cost = observation_cost(case.rays, case.cameras, case.points.position, HUBER, given)
        found.append((cost, normal))
    for cost, normal in found[1:]:
        assert cost == found[0][0]
        np.testing.assert_array_equal(dense(normal)[0], dense(found[0][1])[0])
    whole: Rays = replace(case.rays, chunks=((0, 800),))
    normal = NormalEquations.zero(case.layout)
    eliminate(whole, case.cameras, case.points, normal, HUBER, 1e-4)
    np.testing.assert_allclose(dense(normal)[0], dense(found[0][1])[0], rtol=0, atol=1e-6)


def test_points_without_observations_are_between_the_others() -> None:
    assert first_observations(np.array([0, 0, 2, 2, 2]), 4).tolist() == [0, 2, 2, 5, 5]


# ---- the band -------------------------------------------------------------------------------------------------------


def strip(photographs: int, reach: int, rng: np.random.Generator) -> tuple[Layout, int]:
    """A layout of photographs in random order, each of which shares points with the next ``reach``."""
    name = rng.permutation(photographs)
    tracks = [name[i : i + reach + 1] for i in range(photographs - reach)]
    first = np.cumsum([0, *(len(t) for t in tracks)])
    position = np.empty((photographs, 3))
    position[name] = np.arange(photographs)[:, None] * np.array([10.0, 3.0, 0.0]) + rng.normal(0, 1, (photographs, 3))
    layout = make_layout(
        [(first, np.concatenate(tracks))], np.zeros(photographs, bool), position, np.ones((1, PARAMETERS)), offsets=1
    )
    return layout, reach


def filled(layout: Layout, rng: np.random.Generator) -> NormalEquations:
    """Positive definite normal equations with everything that the layout has room for."""
    normal = NormalEquations.zero(layout)
    n, m, k = layout.free, layout.columns, layout.border
    for a in range(n):
        normal.Q[a, :36] = (20.0 * (layout.reach + 1) * np.eye(6)).ravel()
        for b in range(a):
            block = layout.block_at[b, a - b] if a - b <= layout.reach else -1
            if block >= 0:
                normal.A[block] = rng.standard_normal(36)
    normal.Q[:, 48:] = rng.standard_normal((n, 6 * k))
    normal.H[:-2] = m * np.eye(k)
    normal.Q[:, 42:48], normal.H[-1] = rng.standard_normal((n, 6)), rng.standard_normal(k)
    return normal


@pytest.mark.parametrize(("photographs", "reach"), [(40, 3), (31, 11), (9, 1), (12, 11), (1, 0)])
def test_the_band_gives_what_dense_matrices_give(photographs: int, reach: int) -> None:
    rng = np.random.default_rng(photographs)
    layout, _ = strip(photographs, reach, rng)
    assert layout.reach == reach
    assert layout.dense == (2 * (reach + 1) > photographs)
    normal = filled(layout, rng)
    S, right = dense(normal)
    factor = normal.factor()
    np.testing.assert_allclose(np.concatenate(factor.solve(normal.g, normal.h)), np.linalg.solve(S, right), atol=1e-12)
    m = layout.columns
    np.testing.assert_allclose(factor.border_covariance(), np.linalg.inv(S)[m:, m:], atol=1e-12)
    inverse = np.linalg.inv(S[:m, :m])
    found = lower(layout, factor.inverse_within_band())
    within = np.ones((m, m), bool) if layout.dense else np.abs(np.subtract.outer(range(m), range(m))) <= layout.stride
    np.testing.assert_allclose(found, np.where(within, inverse, 0.0), rtol=0, atol=1e-13)


def test_scaling_and_damping_are_those_of_the_dense_matrix() -> None:
    rng = np.random.default_rng(3)
    layout, _ = strip(30, 4, rng)
    normal = filled(layout, rng)
    normal.Q[:, 36:42], normal.H[-2] = rng.uniform(1, 2, (30, 6)), rng.uniform(1, 2, layout.border)
    S, right = dense(normal)
    raised = S + 0.1 * np.diag(np.concatenate([normal.D, normal.F]))
    found = np.concatenate(normal.factor(0.1).solve(normal.g, normal.h))
    np.testing.assert_allclose(found, np.linalg.solve(raised, right), atol=1e-12)
    scale = np.sqrt(normal.diagonal())
    np.testing.assert_allclose(scale**2, np.diag(S))
    factor = normal.factor(scale=scale)
    m = layout.columns
    solved = np.concatenate(factor.solve(normal.g / scale[:m], normal.h / scale[m:])) / scale
    np.testing.assert_allclose(solved, np.linalg.solve(S, right), atol=1e-12)
    flat = factor.inverse_within_band()
    scale_matrix(flat, scale, layout)
    np.testing.assert_allclose(np.diag(lower(layout, flat)), np.diag(np.linalg.inv(S[:m, :m])), rtol=1e-12)


def test_a_matrix_that_is_not_positive_definite_names_the_column() -> None:
    rng = np.random.default_rng(5)
    layout, _ = strip(30, 2, rng)
    normal = filled(layout, rng)
    normal.Q[7, :36] = 0.0
    with pytest.raises(SingularError) as fault:
        normal.factor()
    assert fault.value.column == 42
    normal = filled(layout, rng)
    normal.H[9, 9] = -1.0
    with pytest.raises(SingularError) as fault:
        normal.factor()
    assert fault.value.column == 180 + 9


def test_photographs_far_apart_do_not_widen_the_band() -> None:
    # Two strips that share nothing, their photographs named alternately.
    tracks = [np.array([i, i + 2]) for i in range(18)]
    first = np.arange(0, 37, 2)
    layout = make_layout(
        [(first, np.concatenate(tracks))], np.zeros(20, bool), np.full((20, 3), np.nan), np.zeros((1, PARAMETERS))
    )
    assert layout.reach == 1
    assert layout.border == 0
    assert sorted(layout.place.tolist()) == list(range(20))


def test_held_photographs_and_fixed_cameras_have_no_columns() -> None:
    case = Case()
    assert case.layout.free == 7
    assert case.layout.place[3] == -1
    assert case.layout.camera_column.tolist() == [0, -1]
    camera, parameter = case.layout.free_parameters
    assert camera.tolist() == [0] * 9
    assert parameter.tolist() == [0, 1, 3, 4, 5, 7, 9, 10, 11]
    assert case.layout.border == 9 + 3
    assert case.layout.free_of.tolist() == [
        [0, 9, 0, 0, 1, 3, 4, 5, 7, 9, 10, 11, 0, 0, 0], [-1, 0, 0, *[0] * PARAMETERS]
    ]  # fmt: skip
    empty = lay_out(case.tie.select(np.zeros(len(case.tie), bool)), np.arange(60), case.layout)
    assert isinstance(case.tie, Observations)
    assert len(empty) == 0


@pytest.mark.parametrize("loss", ["none", "huber", "cauchy"])
def test_a_residual_of_zero_has_no_direction(loss: RobustLoss) -> None:
    turn, residual = steer(np.zeros((1, 2)), loss, 2.0, 0.1)
    np.testing.assert_array_equal(turn, np.eye(2)[None])
    np.testing.assert_array_equal(residual, 0.0)
