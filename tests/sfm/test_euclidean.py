import numpy as np
import pytest

from photogram.sfm.tie_points.matchers.byte_distances import usable_tiles
from photogram.sfm.tie_points.matchers.euclidean import LONGEST, nearest_descriptors

WAYS = [True, False] if usable_tiles() else [True]


def assert_those_of_brute_force(a: np.ndarray, b: np.ndarray, *, by_blas: bool) -> None:
    """In whole numbers; of those equally near the first one counts."""
    a, b = a.astype(np.uint8), b.astype(np.uint8)
    near = nearest_descriptors(a, b, by_blas=by_blas)
    wide, other = a.astype(np.int64), b.astype(np.int64)
    table = (wide**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2 * wide @ other.T
    np.testing.assert_array_equal(near.nearest, table.argmin(axis=1))
    np.testing.assert_array_equal(near.distance, np.sort(table, axis=1)[:, :2])
    np.testing.assert_array_equal(near.back, table.argmin(axis=0))


@pytest.mark.parametrize("by_blas", WAYS)
@pytest.mark.parametrize("size", [1, 2, 7, 128])
@pytest.mark.parametrize(("n", "m"), [(2, 2), (11, 33), (12, 32), (13, 31), (1000, 70), (70, 1000)])
def test_nearest_are_those_of_brute_force(n: int, m: int, size: int, by_blas: bool) -> None:
    rng = np.random.default_rng(n * size)
    # short ones repeat, so that many are equally near
    assert_those_of_brute_force(rng.integers(0, 256, (n, size)), rng.integers(0, 256, (m, size)), by_blas=by_blas)
    assert_those_of_brute_force(rng.integers(0, 3, (n, size)), rng.integers(0, 3, (m, size)), by_blas=by_blas)


@pytest.mark.parametrize("by_blas", WAYS)
def test_the_longest_distances_there_are_fit(by_blas: bool) -> None:
    black, white = np.zeros((40, LONGEST)), np.full((50, LONGEST), 255)
    for a, b in ((black, white), (white, black), (black, black), (white, white), (white, np.vstack([white, black]))):
        assert_those_of_brute_force(a, b, by_blas=by_blas)


@pytest.mark.parametrize("by_blas", WAYS)
@pytest.mark.parametrize(("n", "m"), [(30, 8200), (8200, 30), (2100, 4200)])
def test_more_columns_than_are_numbered_at_once(n: int, m: int, by_blas: bool) -> None:
    rng = np.random.default_rng(n)
    assert_those_of_brute_force(rng.integers(0, 2, (n, 8)), rng.integers(0, 2, (m, 8)), by_blas=by_blas)
    assert_those_of_brute_force(rng.integers(0, 256, (n, 16)), rng.integers(0, 256, (m, 16)), by_blas=by_blas)


@pytest.mark.parametrize(("n", "m", "size", "other"), [(1, 5, 8, 8), (5, 1, 8, 8), (5, 5, 8, 9), (5, 5, 129, 129)])
def test_what_cannot_be_compared_is_refused(n: int, m: int, size: int, other: int) -> None:
    with pytest.raises(ValueError, match=rf"descriptors of \({n}, {size}\) and \({m}, {other}\)"):
        nearest_descriptors(np.zeros((n, size), np.uint8), np.zeros((m, other), np.uint8))
