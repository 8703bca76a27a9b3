"""The fast engine against the reference graph and against itself: equal minima, from anywhere, on any machine."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import bal
import numpy as np
import pytest
from makers import SharedData
from seeds import seeds

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.assessment import sigma0_and_redundancy
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.camera import Camera, oriented_by
from photogram.factors.covariance import covariances
from photogram.factors.elimination.bundle import SingularPointError, _System
from photogram.factors.elimination.levenberg_marquardt import Trial, _saved, remaining
from photogram.factors.elimination.levenberg_marquardt import minimise as levenberg_marquardt
from photogram.factors.elimination.solvers import SOLVERS
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError, Problem
from photogram.factors.ground_terms import bundle_of
from photogram.factors.variables import CONTROL_POINT, TIE_POINT
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block, whole_survey_plan

ROOT = Path(__file__).resolve().parents[2]
EVERYTHING = SurveyPlan(
    strips=2, photographs_per_strip=3, control_points=5, check_points=2, flights=2, gnss_offset_sigma_m=(0.3, 0.3, 0.5),
    calibration_sigmas=(5.0, 3.0, 3.0, 0.004, 0.002, 0.0, 0.0, 0.0002, np.inf, 0.0, 0.0),
)  # fmt: skip
TIGHT = AdjustmentSettings(relative_tolerance=1e-18, maximum_iterations=300)


def block(seed: int, plan: SurveyPlan = EVERYTHING, tie_points: int = 80) -> tuple[Problem, State]:
    made = simulate_block(
        plan, seed, tie_points=tie_points, mismatches=0.02, start_position_sigma_m=0.3, start_attitude_sigma_deg=0.3,
        start_point_sigma_m=0.3,
    )  # fmt: skip
    problem = make_problem(made.block, AdjustmentSettings())
    return problem, start_state(problem)


@pytest.mark.parametrize("seed", range(10))
def test_both_engines_and_solvers_reach_the_same_minimum(seed: int) -> None:
    problem, start = block(seed)
    assert problem.flights
    assert len(problem.control_world_m)
    assert all(p.gnss_world_m is not None and p.attitude_sigma_rad is not None for p in problem.block.photographs)
    known = covariances(problem, minimise(problem, start, TIGHT).state)
    sigma = {
        "position": np.sqrt(np.einsum("naa->na", known.poses)[:, 3:].max(axis=1))[:, None],
        "rotation": np.sqrt(np.einsum("naa->na", known.poses)[:, :3].max(axis=1))[:, None, None],
        "parameters": np.sqrt(np.diag(known.calibration(0)))[None],
        "tie_point": np.sqrt(np.einsum("naa->na", known.tie_point)),
        "control": np.sqrt(np.einsum("naa->na", known.control_point)),
        "offset": np.sqrt([np.diag(known.offset(f)) for f in range(2)]),
    }
    fast = {s: minimise(problem, start, replace(TIGHT, solver=s)) for s in ("banded", "gtsam")}
    rng, near = np.random.default_rng(seed), fast["banded"].state  # the reference is slow from afar
    moved = {
        n: getattr(near, n) + 0.3 * unit * rng.standard_normal(getattr(near, n).shape) for n, unit in sigma.items()
    }
    cameras = near.cameras._replace(position=moved.pop("position"), parameters=moved.pop("parameters"))
    del moved["rotation"]
    reference = minimise(problem, replace(near, cameras=cameras, **moved), replace(TIGHT, engine="reference"))
    assert reference.converged
    for solver, found in fast.items():
        for name, unit in sigma.items():
            error = np.abs(getattr(found.state, name) - getattr(reference.state, name))
            assert np.all(error <= 2e-6 * unit), (solver, name, float((error / np.maximum(unit, 1e-30)).max()))
        expected, redundancy = sigma0_and_redundancy(problem, reference.state)
        sigma0, again = sigma0_and_redundancy(problem, found.state)
        assert sigma0 == pytest.approx(expected, rel=1e-6)
        assert again == redundancy


def test_solvers_take_the_same_steps_on_a_band() -> None:
    plan = SurveyPlan(strips=1, photographs_per_strip=40, control_points=6, check_points=0, forward_overlap=0.7)
    problem, start = block(3, plan, 400)

    def costs_with(solver: Literal["banded", "gtsam"]) -> list[float]:
        costs = list[float]()
        settings = AdjustmentSettings(solver=solver)
        minimise(problem, start, settings, lambda _done, _total, text: costs.append(float(text.split()[-1])))
        return costs

    banded = costs_with("banded")
    assert len(banded) > 3
    np.testing.assert_allclose(costs_with("gtsam"), banded, rtol=1e-9)


@pytest.mark.parametrize("ratio", [0.0, 0.01, 0.5, 0.9])
def test_what_remains_is_the_rest_of_a_geometric_series(ratio: float) -> None:
    saved = 100.0 * ratio ** np.arange(1, 400)
    assert remaining(float(saved[0]), 100.0) == pytest.approx(float(saved[1:].sum()), rel=1e-12)


def test_decreases_that_grow_are_no_sign_of_a_minimum() -> None:
    assert remaining(2.0, 1.0) == np.inf


GROSS = replace(
    whole_survey_plan(), strips=3, photographs_per_strip=4, check_points=0, calibration_source="maker",
    calibration_sigmas=(50.0, 5.0, 5.0, 0.01, 0.01, 0.0, 0.0, 0.0005, 0.0005, 0.0, 0.0),
)  # fmt: skip


@pytest.mark.parametrize("first", seeds(100, 30)[::10])
def test_gross_starting_errors_lead_to_the_minimum_reached_from_the_truth(first: int) -> None:
    """Poses off by 5 m and 5°, the focal length by 5 %, 2 % mismatches, points unknown: ten blocks, all of them."""
    for seed in range(first, first + 10):
        made = simulate_block(
            GROSS, seed, tie_points=500, mismatches=0.02, start_position_sigma_m=5.0, start_attitude_sigma_deg=5.0
        )
        tie, truth = made.block.tie_points, made.truth
        camera = truth.camera.parameters.copy()
        camera[0] *= 1.05
        unknown = replace(tie, position_world_m=np.full_like(tie.position_world_m, np.nan))
        found = adjust(replace(made.block, tie_points=unknown), AdjustmentSettings(), start=[camera])
        expected = adjust(replace(made.block, poses=truth.poses, tie_points=unknown), AdjustmentSettings())
        assert abs(found.decisions.rejected_observations - expected.decisions.rejected_observations) <= 3, seed
        kept, common = found.block.tie_points, found.block.common_errors
        problem = make_problem(replace(made.block, tie_points=kept, common_errors=common), AdjustmentSettings())
        right = replace(problem.block, poses=truth.poses, tie_points=kept, cameras=(truth.camera,))
        start = start_state(replace(problem, block=right))
        minimum = minimise(problem, start, AdjustmentSettings())
        assert found.cost == pytest.approx(minimum.cost, rel=1e-6), seed
        sigma = np.sqrt(np.einsum("naa->na", found.covariances.position_m2))
        position = np.array([pose.position_world_m for pose in found.block.poses if pose is not None])
        assert np.all(np.abs(position - minimum.state.position) <= 1e-2 * sigma), seed


def test_ladybug_of_bundle_adjustment_in_the_large(shared_data: SharedData) -> None:
    """The published problem, plain least squares, f k1 k2 of every photograph: ½ Σ r² by its own formula."""
    ladybug = shared_data("bal/problem-49-7776-pre.txt")
    observations, start = bal.read_bal(ladybug)
    assert bal.half_squares(observations, start) == pytest.approx(850_912.46, abs=0.01)
    found = bal.solve(observations, start)
    assert found.converged
    assert bal.half_squares(observations, found) == pytest.approx(13_344.24, abs=0.5)
    assert found.cost == pytest.approx(bal.half_squares(observations, found), rel=1e-9)


@pytest.mark.parametrize("lost", [-5.0, np.nan])
def test_a_step_to_a_focal_length_that_cannot_be_is_refused(lost: float) -> None:
    """An undamped step leads to a smaller cost with a negative focal length, or out of the numbers."""
    start = state_of(100.0)

    class Slope:
        def cost(self, state: State) -> float:
            return float((state.parameters[0, 0] - 20.0) ** 2)

        def linearise(self, state: State, near: bool) -> Callable[[float], Trial]:  # noqa: ARG002
            f = state.parameters[0, 0]

            def step(damping: float) -> Trial:
                moved = state_of(lost if damping < 1e-3 else f + (20.0 - f) / (1.0 + damping))
                return Trial(moved, -1.0 if damping < 1e-3 else self.cost(moved), self.cost(state))

            return step

    found = levenberg_marquardt(Slope(), start, 50, 1e-9)
    assert found.state.parameters[0, 0] == pytest.approx(20.0, abs=1.0)


def state_of(focal_px: float) -> State:
    """One camera and nothing else."""
    none = np.zeros((0, 3))
    cameras = oriented_by([Camera("c", 10, 10, 1.0, np.zeros(2))], np.zeros(0, np.int64), [])
    parameters = np.zeros((1, 12))
    parameters[0, 0] = focal_px
    return State(cameras._replace(parameters=parameters), none, none, none)


def test_what_rounding_hides_is_believed_on_the_word_of_the_linear_model() -> None:
    _, state = block(0)
    wrong = replace(state, cameras=state.cameras._replace(parameters=-state.parameters))
    for cost, predicted, saved in (
        (1.0, 1e-13, 1e-13),  # nothing is to be seen, and nothing else was predicted
        (1.0 + 1e-13, 1e-13, 1e-13),
        (1.0, 1e-3, 0.0),  # a thousandth would be seen
        (1.0, 0.0, 0.0),
        (0.9, 1e-13, 0.1),  # what is seen counts
        (1.1, 1e-13, -0.1),
    ):
        assert _saved(1.0, Trial(state, cost, predicted)) == pytest.approx(saved, rel=1e-9, abs=0), (cost, predicted)
    assert _saved(1.0, Trial(wrong, 0.5, 0.5)) == -np.inf
    assert _saved(1.0, Trial(state, np.nan, 0.5)) == -np.inf


@pytest.mark.parametrize(("kind", "named"), [("tie", TIE_POINT), ("control", CONTROL_POINT)])
def test_a_point_that_its_rays_do_not_fix_is_named(kind: str, named: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def parallel(*_: object) -> None:
        raise SingularPointError(kind, 3)

    problem, start = block(0)
    monkeypatch.setattr("photogram.factors.minimisation.minimise_bundle", parallel)
    with pytest.raises(IndeterminateError) as error:
        minimise(problem, start, TIGHT)
    assert error.value.variable == (named, 3)


@pytest.mark.parametrize("damping", [1e-6, 0.3])
def test_what_a_damped_step_saves_is_what_is_predicted_near_the_minimum(damping: float) -> None:
    made = simulate_block(EVERYTHING, 1, tie_points=60)
    problem = make_problem(made.block, AdjustmentSettings(robust_loss="none"))
    minimum = minimise(problem, start_state(problem), replace(TIGHT, robust_loss="none")).state
    off = np.random.default_rng(0).normal(0.0, 1e-3, minimum.position.shape)
    state = replace(minimum, cameras=minimum.cameras._replace(position=minimum.position + off))
    system = _System(bundle_of(problem, state), SOLVERS["banded"](), None, True)
    before, trial = system.cost(state), system.linearise(state, True)(damping)
    assert before - trial.cost == pytest.approx(trial.predicted, rel=2e-3)
