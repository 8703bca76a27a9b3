"""Where rays leave cells: against the sides of the cell, for rays of any direction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.simulation.ray_cells import leave_cell


@given(st.integers(-50, 50), st.floats(0.1, 10.0), st.floats(0.0, 1.0), st.floats(0.01, 5.0), st.booleans())
def test_a_ray_leaves_through_the_side_ahead(cell: int, side: float, part: float, speed: float, back: bool) -> None:
    """From anywhere in the cell, forwards or backwards along the axis."""
    origin, step = (cell + part) * side, -speed if back else speed
    ahead = cell if back else cell + 1
    leaves = leave_cell(cell, side, origin, step)
    assert leaves >= -1e-9
    assert origin + leaves * step == pytest.approx(ahead * side, abs=1e-9 * max(1.0, abs(cell) * side))


def test_a_ray_along_the_cell_never_leaves_it() -> None:
    """Nor does one that stands still on its side."""
    assert leave_cell(3, 2.0, 7.0, 0.0) == np.inf
    assert leave_cell(3, 2.0, 6.0, -0.0) == np.inf
