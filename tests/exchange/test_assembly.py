"""Values of other programs' files as rotations, cameras and tie points, and what is refused as such."""

from pathlib import PurePosixPath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import (
    camera_of,
    check_names,
    index_in,
    pose_of,
    rotation_of_quaternion,
    tie_points_of,
)


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.diag([1.0, 1.0, -1.0]), 1.002 * np.eye(3), np.full((3, 3), np.nan), 1e200 * np.eye(3)],
)
def test_what_is_no_rotation_is_refused(matrix: FloatArray) -> None:
    with pytest.raises(ExchangeError, match=r"^a\.xml:1: .*(the rotation is none|not finite)"):
        pose_of("a.xml:1", matrix, np.zeros(3))


@pytest.mark.parametrize(
    ("size", "focal", "radial"),
    [((0, 10), 5.0, ()), ((2**63, 10), 5.0, ()), ((10.5, 10), 5.0, ()), ((10, 10), 0.0, ()), ((10, 10), -1.0, ()),
     ((10, 10), 5.0, (1e300,)), ((10, 10), np.nan, ())],
)  # fmt: skip
def test_what_is_no_camera_is_refused(size: tuple[float, float], focal: float, radial: tuple[float, ...]) -> None:
    with pytest.raises(ExchangeError, match=r"^here: "):
        camera_of("here", "a", size, focal, (5.0, 5.0), radial)


def test_observations_are_sorted_by_point_then_photograph() -> None:
    tie = tie_points_of(
        "here",
        np.array([2, 0, 1, 0]),
        np.array([1, 1, 0, 0]),
        np.arange(8.0).reshape(4, 2),
        np.zeros((2, 3)),
        feature=np.array([9, 8, 7, 6]),
    )
    assert tie.point.tolist() == [0, 0, 1, 1]
    assert tie.photograph.tolist() == [0, 1, 0, 2]
    assert tie.feature.tolist() == [6, 7, 8, 9]
    assert tie.pixel[:, 0].tolist() == [6, 4, 2, 0]


def test_two_photographs_of_one_name_are_named() -> None:
    with pytest.raises(ExchangeError, match=r"^file: 0/a\.jpg and 1/a\.jpg have the same file name"):
        check_names("file", [PurePosixPath("b.jpg"), PurePosixPath("0/a.jpg"), PurePosixPath("1/a.jpg")])


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.integers(4, 17))
def test_a_rotation_written_with_few_digits_is_orthogonal_again(
    vector: tuple[float, float, float], digits: int
) -> None:
    true = Rotation.from_rotvec(vector).as_matrix()
    pose = pose_of("here", np.round(true, digits), np.zeros(3))
    R = pose.rotation_world_from_camera
    np.testing.assert_allclose(R.T @ R, np.eye(3), rtol=0, atol=1e-14)
    np.testing.assert_allclose(R, true, rtol=0, atol=10.0**-digits + 1e-14)


def test_a_quaternion_is_scipys() -> None:
    turn = Rotation.from_rotvec([0.3, -1.2, 0.7])
    quaternion = turn.as_quat(scalar_first=True)
    np.testing.assert_allclose(rotation_of_quaternion("here", quaternion), turn.as_matrix(), rtol=0, atol=1e-15)
    for wrong in (1.01 * quaternion, 1e300 * quaternion, np.full(4, np.nan)):
        with pytest.raises(ExchangeError, match=r"^here: .*quaternion"):
            rotation_of_quaternion("here", wrong)


def test_what_is_not_among_the_numbers_has_no_index() -> None:
    ids = np.array([70, 30, 50])
    assert index_in(np.argsort(ids), ids, np.array([30, 31, 70, 80, 1])).tolist() == [1, -1, 0, -1, -1]
    assert index_in(np.argsort(ids[:0]), ids[:0], np.array([30])).tolist() == [-1]
