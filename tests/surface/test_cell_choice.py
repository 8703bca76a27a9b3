"""Hidden slivers and the tips of what is wider; whole orthophotos are in test_orthophoto."""

import numpy as np

from photogram.surface.ortho.cell_choice import slivers_of


def test_slivers_of_what_is_hidden_are_not_the_tips_of_what_is_wider() -> None:
    hidden = np.zeros((60, 90), dtype=bool)
    hidden[20:40, 10:30] = True  # wide
    hidden[30:33, 30:60] = True  # its tail, of which the far end is a sliver
    hidden[50, 70] = hidden[5:8, 40:80] = True
    slivers = slivers_of(hidden, 2)
    expected = hidden.copy()
    expected[20:40, 10:34] = False
    np.testing.assert_array_equal(slivers, expected)
    part = np.s_[3:40, 25:75]
    inner = np.s_[8:-8, 8:-8]
    np.testing.assert_array_equal(slivers_of(hidden[part], 2)[inner], slivers[part][inner])
    assert not slivers_of(np.zeros((3, 3), dtype=bool), 2).any()
