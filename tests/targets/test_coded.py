"""Coded targets: their codes, their centres, and what is none."""

from __future__ import annotations

import numpy as np
import pytest
from lib.target_pictures import render, texture

from photogram.targets.coded import find_coded, picture


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
