"""Zeros in all photographs of a camera, and other figures that are the same in all of them."""

from dataclasses import replace

import numpy as np

from photogram.files.photographs.placeholders import (
    constant_flying_heights,
    constant_heights,
    stray_zero_heights,
    without_zero_attitudes,
    zero_attitudes,
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
    np.testing.assert_array_equal(constant_heights(tags), [True, True, False, False, True, False])
    kept = without_zero_attitudes(tags)
    assert [own is None or own.gimbal_pitch_deg for own in kept] == [None, None, True, -90.0, None, -90.0]


def test_one_that_is_not_zero_makes_all_of_them_measurements() -> None:
    tags = [ZEROS, ZEROS, ZEROS, replace(ZEROS, gimbal_yaw_deg=0.1, height_m=0.5)]
    assert not zero_attitudes(tags).any()
    assert not constant_heights(tags).any()


def test_few_photographs_tell_nothing() -> None:
    assert not zero_attitudes([ZEROS, ZEROS]).any()


def test_what_is_not_there_is_no_zero() -> None:
    bare = replace(ZEROS, longitude_deg=None, gimbal_roll_deg=None)
    assert not constant_heights([bare] * 4).any()
    assert not zero_attitudes([bare] * 4).any()


def test_a_zero_among_heights_far_from_it_is_none() -> None:
    at = [replace(ZEROS, height_m=h) for h in (0.0, 150.0, 153.0, None, 149.0)]
    np.testing.assert_array_equal(stray_zero_heights([*at, None]), [True, *[False] * 5])
    assert not stray_zero_heights([*at[:2], at[0], *at[2:4]]).any()  # as many zeros as others
    assert not stray_zero_heights([at[0], *[replace(ZEROS, height_m=h) for h in (4.0, 150.0, -9.0)]]).any()


def test_one_height_that_a_barometer_held_is_a_measurement_unless_the_tags_deny_it() -> None:
    flown_m = (50.0, 50.2, 49.8, 50.0, 50.1, 50.0)
    held = [replace(ZEROS, height_m=120.0, height_above_take_off_m=h) for h in flown_m]
    assert not constant_heights(held).any()
    assert not constant_heights([replace(t, height_above_take_off_m=None) for t in held]).any()
    assert constant_heights([*held[:5], replace(held[5], height_above_take_off_m=53.0)]).all()


def test_a_flying_height_from_which_neighbours_show_nothing_in_common_is_none() -> None:
    metre_deg = 1.0 / 111_195.0
    flown = [replace(ZEROS, latitude_deg=46.0 + 10.0 * i * metre_deg, height_above_take_off_m=1.0) for i in range(4)]
    assert constant_flying_heights(flown).all()
    assert not constant_flying_heights([replace(t, height_above_take_off_m=4.0) for t in flown]).any()
    assert not constant_flying_heights([*flown[:3], replace(flown[3], height_above_take_off_m=1.1)]).any()
    assert not constant_flying_heights([flown[0]] * 4).any()
    assert not constant_flying_heights([replace(t, latitude_deg=None) for t in flown]).any()
