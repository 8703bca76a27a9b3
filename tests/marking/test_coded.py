"""Coded targets: their codes, their centres, and what is none."""

import cv2
import numpy as np
import pytest
from lib.target_pictures import render, texture

from photogram.marking.targets.coded import find_coded, picture


@pytest.mark.parametrize(("shape", "family"), [("april", "apriltag 36h11"), ("aruco", "aruco 4x4")])
def test_centres_are_where_the_diagonals_meet(shape: str, family: str) -> None:
    rng = np.random.default_rng(8)
    for tilt in (0.0, 45.0):
        shown = render(rng, shape, 56.0, tilt, 0.5)
        found = find_coded(shown.grey)
        assert [f.code[0] for f in found if f.code] == [family]
        error = found[0].centre_px - shown.centre_px
        assert np.abs(error).max() < 0.05
        assert (np.abs(error) < 4.0 * found[0].sigma_px).all()


def test_a_code_is_drawn_where_its_fields_are() -> None:
    fields = np.array([[1.0, 0.0], [0.0, 1.0]])
    theta = np.array([10.0, 10.0, 0.1, 0.0, 0.0, 0.1, 0.0, 0.0, 0.5, 20.0, 220.0])
    place = np.array([[5.0, 5.0], [15.0, 5.0], [5.0, 15.0], [15.0, 15.0], [10.0, 10.0]])
    np.testing.assert_allclose(picture(fields, theta, place), [220.0, 20.0, 20.0, 220.0, 120.0], atol=1e-6)


def test_ground_holds_no_code() -> None:
    rng = np.random.default_rng(9)
    for kind in ("gravel", "shrubs", "cars"):
        assert find_coded(texture(rng, 120, 120, kind).astype(np.float32)) == []


def test_codes_that_a_blur_has_made_hard_to_read_are_read() -> None:
    """Fields of 3 to 3.5 px under a blur of 1.7 px: most are read, each for what it is."""
    rng = np.random.default_rng(10)
    read = 0
    for _ in range(8):
        shown = render(rng, "april", 33.0, 10.0, 1.7)
        for found in find_coded(shown.grey):
            assert found.code is not None
            assert found.code[0] == "apriltag 36h11"
            assert np.abs(found.centre_px - shown.centre_px).max() < 0.1
            read += 1
    assert read >= 6


def test_what_is_too_small_for_a_code_is_none() -> None:
    """Three rectangles, of a car, are an ArUco code that is white inside: fields must be large enough to be told."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    for field_px, count in ((4, 1), (2, 0)):
        tag = cv2.aruco.generateImageMarker(dictionary, 1023, 7 * field_px).astype(np.float64)
        grey = np.full((70, 70), 220.0)
        grey[20 : 20 + len(tag), 20 : 20 + len(tag)] = 40.0 + 180.0 / 255.0 * tag
        found = find_coded(np.round(cv2.GaussianBlur(grey, (0, 0), 0.6)).astype(np.uint8))
        assert len(found) == count
