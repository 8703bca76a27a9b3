"""Zeros in all photographs of a camera."""

from dataclasses import replace

import numpy as np

from photogram.files.photographs.placeholders import (
    stray_zero_heights,
    without_zero_attitudes,
    zero_attitudes,
    zero_heights,
)
from photogram.files.photographs.tags import PhotographTags

ZEROS = PhotographTags(
    make="A", model="one", longitude_deg=7.0, latitude_deg=46.0, height_m=0.0,
    gimbal_yaw_deg=0.0, gimbal_pitch_deg=0.0, gimbal_roll_deg=0.0,
)  # fmt: skip


def test_zeros_of_all_photographs_of_a_camera_are_none() -> None:
    other = replace(ZEROS, model="two", height_m=300.0, gimbal_pitch_deg=-90.0)
    tags = [ZEROS, ZEROS, None, other, ZEROS, replace(other, height_m=0.0)]
    np.testing.assert_array_equal(zero_attitudes(tags), [True, True, False, False, True, False])
    np.testing.assert_array_equal(zero_heights(tags), [True, True, False, False, True, False])
    kept = without_zero_attitudes(tags)
    assert [own is None or own.gimbal_pitch_deg for own in kept] == [None, None, True, -90.0, None, -90.0]


def test_one_that_is_not_zero_makes_all_of_them_measurements() -> None:
    tags = [ZEROS, ZEROS, ZEROS, replace(ZEROS, gimbal_yaw_deg=0.1, height_m=0.5)]
    assert not zero_attitudes(tags).any()
    assert not zero_heights(tags).any()


def test_few_photographs_tell_nothing() -> None:
    assert not zero_attitudes([ZEROS, ZEROS]).any()


def test_what_is_not_there_is_no_zero() -> None:
    bare = replace(ZEROS, longitude_deg=None, gimbal_roll_deg=None)
    assert not zero_heights([bare] * 4).any()
    assert not zero_attitudes([bare] * 4).any()


def test_a_zero_among_heights_far_from_it_is_none() -> None:
    at = [replace(ZEROS, height_m=h) for h in (0.0, 150.0, 153.0, None, 149.0)]
    np.testing.assert_array_equal(stray_zero_heights([*at, None]), [True, *[False] * 5])
    assert not stray_zero_heights([*at[:2], at[0], *at[2:4]]).any()  # as many zeros as others
    assert not stray_zero_heights([at[0], *[replace(ZEROS, height_m=h) for h in (4.0, 150.0, -9.0)]]).any()
