"""Steps of a whole block: exact for a similarity, of the second order, and few where nothing but GNSS holds it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.arrays import FloatArray
from photogram.factors.elimination.similarity_steps import LARGEST_SCALE, bend_of, bent
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block

PLAN = SurveyPlan(
    width_px=1600, height_px=1200, focal_px=1333.0, flying_height_m=60.0, strips=2, photographs_per_strip=6,
    control_points=0, check_points=0, gnss_sigma_m=(5.0, 5.0, 10.0),
)  # fmt: skip


def places(seed: int, count: int) -> FloatArray:
    return np.asarray(np.random.default_rng(seed).normal((100.0, -50.0, 60.0), 30.0, (count, 3)))


@given(
    turn=st.tuples(*[st.floats(-0.5, 0.5)] * 3), scale=st.floats(-0.4, 0.4), shift=st.tuples(*[st.floats(-9, 9)] * 3)
)
def test_a_step_that_begins_a_similarity_goes_along_it(
    turn: tuple[float, ...], scale: float, shift: tuple[float, ...]
) -> None:
    centres, points, w = places(1, 7), places(2, 20), np.array(turn)
    middle = centres.mean(axis=0)

    def step(X: FloatArray) -> FloatArray:
        return np.asarray(shift + np.cross(w, X - middle) + scale * (X - middle))

    bend = bend_of(centres, step(centres), np.tile(w, (7, 1)))
    for X in (centres, points):
        exact = middle + shift + (1.0 + scale) * (X - middle) @ Rotation.from_rotvec(w).as_matrix().T
        np.testing.assert_allclose(X + step(X) + bent(bend, X), exact, atol=1e-9)


def test_it_is_of_the_second_order() -> None:
    random, centres, points = np.random.default_rng(3), places(1, 7), places(2, 20)
    moved, turned = random.normal(0.0, 1.0, (7, 3)), random.normal(0.0, 0.03, (7, 3))
    whole, half = (bent(bend_of(centres, s * moved, s * turned), points) for s in (1e-3, 5e-4))
    assert np.abs(whole).max() > 0.0
    np.testing.assert_allclose(half, whole / 4.0, atol=2e-3 * np.abs(whole).max())


def test_what_is_no_turn_adds_nothing() -> None:
    centres, nothing = places(1, 7), np.zeros((7, 3))
    for bend in (
        bend_of(centres, np.tile([3.0, 4.0, 5.0], (7, 1)), nothing),
        bend_of(centres[:1], np.ones((1, 3)), np.ones((1, 3))),
        bend_of(np.tile(centres[0], (3, 1)), centres[:3], centres[:3]),
        bend_of(centres, 2.0 * LARGEST_SCALE * (centres - centres.mean(axis=0)), nothing),
    ):
        np.testing.assert_allclose(bent(bend, places(2, 20)), 0.0, atol=1e-12)


@pytest.mark.parametrize("engine", ["fast", "reference"])
def test_a_block_that_lies_far_off_gets_there_in_few_steps(engine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Turned by 8° about an axis in plan, which GNSS of some metres notices, and the photographs hardly."""
    made = simulate_block(PLAN, 1, tie_points=150, sigma_px=0.4)
    settings = AdjustmentSettings(engine=engine)  # type: ignore[arg-type]
    problem = make_problem(made.block, settings)
    start = start_state(problem)
    middle, R = start.position.mean(axis=0), Rotation.from_euler("xyz", [8.0, -6.0, 5.0], degrees=True).as_matrix()
    turned = replace(
        start,
        cameras=start.cameras._replace(
            rotation=R @ start.rotation, position=np.ascontiguousarray((start.position - middle) @ R.T + middle)
        ),
        tie_point=(start.tie_point - middle) @ R.T + middle,
    )
    found = minimise(problem, turned, settings)
    name = {"fast": "elimination.bundle", "reference": "reference.graph"}[engine]
    monkeypatch.setattr(f"photogram.factors.{name}.bend_of", lambda *_: np.zeros((4, 3)))
    linear = minimise(problem, turned, settings)
    assert found.converged
    assert found.cost <= linear.cost * (1.0 + 1e-6)
    assert found.iterations < linear.iterations
