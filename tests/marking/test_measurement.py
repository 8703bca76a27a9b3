"""Targets of all kinds in rendered photographs, measured near a rough place and without one; and ground without any."""

import numpy as np
import pytest
from lib.target_pictures import bare, render

from photogram.marking.targets.kinds import Kind
from photogram.marking.targets.measurement import propose, snap

KINDS = {
    "checker disc": Kind.CHECKER,
    "checker square": Kind.CHECKER,
    "chequered": Kind.CHEQUERED,
    "cross": Kind.CROSS,
    "corner": Kind.CORNER,
    "circle": Kind.CIRCLE,
    "ring": Kind.RING,
    "april": Kind.CODED,
}


@pytest.mark.parametrize("shape", KINDS)
def test_a_target_is_measured_from_a_rough_place(shape: str) -> None:
    rng = np.random.default_rng(11)
    for tilt in (5.0, 40.0):
        shown = render(rng, shape, 40.0, tilt, 0.6, ground="asphalt")
        found = snap(shown.grey, shown.centre_px + rng.uniform(-3, 3, 2))
        assert found is not None
        assert found.kind == KINDS[shape]
        error = found.centre_px - shown.centre_px
        assert np.abs(error).max() < 0.15
        assert (np.abs(error) < 5.0 * found.sigma_px).all()


@pytest.mark.parametrize("shape", ["checker disc", "cross", "ring"])
def test_a_target_is_proposed_where_it_is(shape: str) -> None:
    shown = render(np.random.default_rng(12), shape, 30.0, 20.0, 0.6, ground="asphalt")
    found = propose(shown.grey)
    assert [f.kind for f in found] == [KINDS[shape]]
    assert np.abs(found[0].centre_px - shown.centre_px).max() < 0.15


def test_a_shift_of_the_patch_is_one_of_the_centre() -> None:
    shown = render(np.random.default_rng(13), "ring", 30.0, 20.0, 0.6)
    whole, part = snap(shown.grey, shown.centre_px), snap(shown.grey[4:, 3:], shown.centre_px - np.array([3.0, 4.0]))
    assert whole is not None
    assert part is not None
    np.testing.assert_allclose(part.centre_px + np.array([3.0, 4.0]), whole.centre_px, atol=0.01)


@pytest.mark.parametrize("ground", ["asphalt", "gravel", "grass", "shadow"])
def test_ground_has_no_target(ground: str) -> None:
    rng = np.random.default_rng(14)
    for _ in range(3):
        grey = bare(rng, ground, 64)
        assert snap(grey, np.array([32.0, 32.0])) is None
        assert propose(grey) == []


def test_a_target_beyond_the_reach_is_not_taken() -> None:
    shown = render(np.random.default_rng(15), "ring", 20.0, 0.0, 0.6, ground="asphalt")
    assert snap(shown.grey, shown.centre_px + 9.0) is None
    assert snap(shown.grey, shown.centre_px + 6.0) is not None


@pytest.mark.parametrize(("shape", "width_px", "seed"), [("aruco", 12.4, 2), ("aruco", 11.8, 57), ("april", 11.9, 6)])
def test_a_code_too_small_to_be_read_is_no_corner_of_its_frame(shape: str, width_px: float, seed: int) -> None:
    for turn in range(6):
        shown = render(np.random.default_rng([16, seed, turn]), shape, width_px, 8.0, 0.6, ground="asphalt")
        found = snap(shown.grey, shown.centre_px + 1.0)
        assert found is None or np.hypot(*(found.centre_px - shown.centre_px)) < 1.0


def test_what_is_no_patch_or_place_has_no_target() -> None:
    assert snap(np.zeros((4, 4), np.uint8), np.array([2.0, 2.0])) is None
    assert snap(np.zeros((40, 40), np.uint8), np.array([np.nan, 2.0])) is None
    assert snap(np.zeros((40, 40), np.uint8), np.array([500.0, 2.0])) is None
    assert propose(np.zeros((4, 4), np.uint8)) == []
