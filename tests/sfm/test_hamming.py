import cv2
import numpy as np
import pytest

from photogram.sfm.tie_points.matchers.hamming import Hamming


@pytest.mark.parametrize("size", [1, 8, 13, 32, 61])
@pytest.mark.parametrize(("n", "m"), [(2, 2), (300, 70), (70, 301)])
def test_nearest_are_those_of_opencv_and_the_first_of_those_equally_near(n: int, m: int, size: int) -> None:
    rng = np.random.default_rng(n * size)
    a, b = (rng.integers(0, 256, (k, size), dtype=np.uint8) for k in (n, m))
    near = Hamming().nearest(a, b)
    table = np.unpackbits(a[:, None] ^ b[None], axis=2).sum(axis=2, dtype=np.int64)
    np.testing.assert_array_equal(near.nearest, table.argmin(axis=1))
    np.testing.assert_array_equal(near.back, table.argmin(axis=0))
    np.testing.assert_array_equal(near.distance, np.sort(table, axis=1)[:, :2] ** 2)
    distance, _ = cv2.batchDistance(a, b, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=2)
    np.testing.assert_array_equal(near.distance, np.square(distance))


def test_coordinates_have_the_same_distances() -> None:
    rng = np.random.default_rng(1)
    a, b = (rng.integers(0, 256, (50, 32), dtype=np.uint8) for _ in range(2))
    points = [Hamming().coordinates(d).astype(float) for d in (a, b)]
    squared = np.square(points[0][:, None] - points[1]).sum(axis=2)
    np.testing.assert_array_equal(np.sort(squared, axis=1)[:, :2] ** 2, Hamming().nearest(a, b).distance)


@pytest.mark.parametrize(("n", "m", "size", "other"), [(1, 5, 32, 32), (5, 1, 32, 32), (5, 5, 32, 31)])
def test_what_cannot_be_compared_is_refused(n: int, m: int, size: int, other: int) -> None:
    with pytest.raises(ValueError, match=f"descriptors of .*{n}, {size}.* and .*{m}, {other}"):
        Hamming().nearest(np.zeros((n, size), np.uint8), np.zeros((m, other), np.uint8))
