"""Heights met in eight directions, against walking there cell by cell."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photogram.arrays import Float32Array
from photogram.surface.nearest_heights import DIRECTIONS, MOST_STEPS, steps_to_heights


def walked(height: Float32Array, row: int, column: int, way: tuple[int, int], reach: int) -> int:
    for step in range(1, reach + 1):
        r, c = row + step * way[0], column + step * way[1]
        if not (0 <= r < height.shape[0] and 0 <= c < height.shape[1]):
            return 0
        if np.isfinite(height[r, c]):
            return step
    return 0


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 14), st.integers(1, 14), st.floats(0.0, 0.6), st.integers(1, 20))
def test_steps_are_those_of_a_walk(seed: int, rows: int, columns: int, share: float, reach: int) -> None:
    rng = np.random.default_rng(seed)
    height = np.where(rng.random((rows, columns)) < share, np.float32(1.0), np.float32(np.nan))
    steps = steps_to_heights(height, reach)
    for k, way in enumerate(DIRECTIONS):
        expected = [[walked(height, r, c, way, reach) for c in range(columns)] for r in range(rows)]
        assert steps[k].tolist() == expected


def test_what_is_too_far_to_be_counted_is_refused() -> None:
    line = np.full((1, MOST_STEPS + 2), np.nan, np.float32)
    line[0, 0] = 0.0
    west = steps_to_heights(line, MOST_STEPS)[DIRECTIONS.index((0, -1)), 0]
    assert west.tolist() == [0, *range(1, MOST_STEPS + 1), 0]
    with pytest.raises(ValueError, match="at most 255"):
        steps_to_heights(line, MOST_STEPS + 1)
