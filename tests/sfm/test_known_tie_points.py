"""Key points and matches of known tie points lead to the same tie points again."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from foreign import small_solution
from hypothesis import given
from hypothesis import strategies as st

from photogram.sfm.tie_points.known_tie_points import (
    known_features,
    known_matches,
    known_pairs,
    numbered_in_photographs,
)
from photogram.sfm.tie_points.tracks import join_matches
from photogram.survey import TiePoints

PICTURE = np.random.default_rng(1).integers(0, 256, (482, 640, 3)).astype(np.uint8)


def tie_points(rays: list[set[int]]) -> TiePoints:
    """Tie points, each seen by a set of photographs, at places of their own."""
    photograph = np.array([i for seen in rays for i in sorted(seen)], dtype=np.int64)
    point = np.repeat(np.arange(len(rays)), [len(seen) for seen in rays])
    n = len(photograph)
    pixel = np.random.default_rng(2).uniform(0, 400, (n, 2))
    return TiePoints(
        photograph, point, np.arange(n), pixel, np.ones(n), np.full((len(rays), 3), np.nan),
        np.zeros((len(rays), 3), dtype=np.uint8),
    )  # fmt: skip


@given(st.lists(st.sets(st.integers(0, 6), min_size=2), min_size=1, max_size=30))
def test_joined_again_they_are_the_same(rays: list[set[int]]) -> None:
    given_points = tie_points(rays)
    features = [known_features(given_points, i, PICTURE) for i in range(7)]
    matches = known_matches(given_points)
    joined = join_matches(features, matches, [np.ones(len(f)) for f in features])
    assert joined.conflicts == 0
    again = joined.tie_points

    def sets(ties: TiePoints) -> set[frozenset[tuple[int, float, float]]]:
        seen = zip(ties.photograph.tolist(), *ties.pixel.T.tolist(), strict=True)
        whole = list(seen)
        return {frozenset(whole[a:b]) for a, b in pairwise(ties.first_observation.tolist())}

    assert sets(again) == sets(given_points)
    pairs = {(i, j) for seen in rays for i in seen for j in seen if i < j}
    assert [(m.first, m.second) for m in matches] == sorted(pairs)
    assert known_pairs(given_points).pairs == tuple(sorted(pairs))


def test_key_points_are_the_observations_of_a_photograph_coloured_as_it_is() -> None:
    ties = small_solution().tie_points
    number = numbered_in_photographs(ties)
    for i in (0, 1, 2, 4):
        mine = ties.photograph == i
        np.testing.assert_array_equal(number[mine], np.arange(mine.sum()))
        found = known_features(ties, i, PICTURE)
        np.testing.assert_array_equal(found.pixel, ties.pixel[mine])
        column, row = np.clip(np.rint(ties.pixel[mine]).astype(int), 0, [639, 481]).T
        np.testing.assert_array_equal(found.colour, PICTURE[row, column])
    assert len(known_features(ties, 3, PICTURE)) == 0


def test_none_have_no_matches() -> None:
    assert known_matches(tie_points([])) == ()
