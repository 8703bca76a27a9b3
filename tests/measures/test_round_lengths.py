"""Round lengths: the nearest, the next below and the next above."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.measures.round_lengths import CELL_STEPS, STEPS, round_down, round_near, round_up


@pytest.mark.parametrize(
    ("length", "down", "up"),
    [(1.0, 1.0, 1.0), (1.99, 1.0, 2.0), (0.049, 0.02, 0.06), (730.0, 500.0, 800.0), (0.0005, 0.0005, 0.0006),
     (2000.0, 2000.0, 2000.0), (0.95, 0.5, 1.0)],
)  # fmt: skip
def test_the_next_below_and_the_next_above(length: float, down: float, up: float) -> None:
    assert round_down(length) == pytest.approx(down, rel=1e-12)
    assert round_up(length) == pytest.approx(up, rel=1e-12)


@pytest.mark.parametrize(
    ("length", "near"), [(0.0612, 0.06), (0.117, 0.125), (0.0099, 0.01), (1.04, 1.0), (23.0, 25.0), (0.07, 0.08)]
)
def test_sides_of_cells_have_finer_steps(length: float, near: float) -> None:
    assert round_near(length, CELL_STEPS) == near


@given(st.floats(1e-4, 1e5))
def test_the_nearest_is_a_step_and_no_other_is_nearer(length: float) -> None:
    near = round_near(length)
    assert float(f"{near:e}"[:8]) in STEPS
    assert max(near / length, length / near) <= 2.5**0.5 * (1 + 1e-12)
