"""Which photographs come first, and when marks suffice."""

import numpy as np
import pytest

from photogram.camera import Camera, Pose
from photogram.marking.page.ordering import azimuth_rad, best_first, in_words, is_enough, length, share_gained

CAMERA = Camera("c", 1000, 800, 1000.0, np.array([499.5, 399.5]))
DOWN = np.diag([1.0, -1.0, -1.0])


def test_the_middle_of_a_picture_comes_before_its_edge_and_both_before_what_lies_beside() -> None:
    pixel = np.array([[990.0, 400.0], [500.0, 400.0], [-40.0, 400.0], [30.0, 20.0]])
    size = np.tile([1000.0, 800.0], (4, 1))
    inside, marked = np.array([True, True, False, True]), np.array([False, False, False, True])
    assert best_first(pixel, size, np.zeros(4), inside, marked) == [3, 1, 0, 2]


def test_the_other_side_of_a_point_comes_before_the_same_side() -> None:
    pixel = np.array([[500.0, 400.0], [520.0, 400.0], [560.0, 400.0]])
    azimuth = np.radians([0.0, 5.0, 180.0])
    everywhere = np.ones(3, dtype=bool)
    assert best_first(pixel, np.tile([1000.0, 800.0], (3, 1)), azimuth, everywhere, ~everywhere) == [0, 2, 1]


def test_azimuths_are_clockwise_from_north() -> None:
    pose = Pose(DOWN, np.array([10.0, 0.0, 50.0]))
    assert azimuth_rad(np.zeros(3), pose) == pytest.approx(np.pi / 2)


def test_a_mark_takes_away_what_kalman_says() -> None:
    """Of a point 100 m below, 0.1 m on the ground are 1 px; the pose is known to 2 px, the mark to 1 px."""
    pose = Pose(DOWN, np.array([0.0, 0.0, 100.0]))
    point_px2, pose_px2 = 9.0, 4.0
    covariance = np.diag([0.09, 0.09, 0.0])
    gained = share_gained(CAMERA, pose, np.zeros(3), covariance, (point_px2 + pose_px2) * np.eye(2), 1.0)
    assert gained == pytest.approx(point_px2 / (point_px2 + pose_px2 + 1.0), rel=1e-6)


def test_marks_suffice_where_no_other_photograph_gains() -> None:
    assert is_enough(5, [0.1, 0.2])
    assert not is_enough(5, [0.1, 0.6])
    assert not is_enough(3, [0.1])
    assert is_enough(2, [])
    assert not is_enough(1, [])


def test_words() -> None:
    assert in_words(7, np.array([0.002, 0.003, 0.0041])) == "7 marks, sigma of the point 4.1 mm"
    assert in_words(1, None) == "1 mark"
    assert [length(v) for v in (0.0234, 0.234, 2.34)] == ["23 mm", "23 cm", "2.3 m"]
