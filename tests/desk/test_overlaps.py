"""Strips and overlaps of flights that were planned with known ones."""

import numpy as np
import pytest

from photogram.arrays import FloatArray
from photogram.desk.coverage.overlaps import overlaps, strips_of, track_directions
from photogram.quality.flight_lines import Course, flown

LONG_M, WIDE_M = 60.0, 80.0


def lawn(forward: float, side: float, heading_deg: float, skip: tuple[int, ...] = ()) -> tuple[FloatArray, FloatArray]:
    """Return places (F, 3) of four strips of seven, flown to and fro, and the sides (F, 2, 2) of their ground."""
    heading = np.radians(heading_deg)
    right = np.array([np.cos(heading), -np.sin(heading)])
    apart, base = (1 - side) * WIDE_M, (1 - forward) * LONG_M
    courses = [
        Course((float(k * apart * right[0]), float(k * apart * right[1])), heading_deg + 180.0 * (k % 2), 7, base, 90.0)
        for k in range(4)
        if k not in skip
    ]
    rotation, place = flown(courses)
    sides = np.stack([WIDE_M * rotation[:, :2, 0], -LONG_M * rotation[:, :2, 1]], axis=1)
    return place, sides


@pytest.mark.parametrize("heading_deg", [0.0, 37.0, 90.0, 200.0])
def test_overlaps_are_those_of_the_plan(heading_deg: float) -> None:
    place, sides = lawn(0.8, 0.65, heading_deg)
    known = overlaps(place, ["1"] * len(place), sides)
    assert known.strips == 4
    np.testing.assert_allclose(known.forward, 0.8)
    assert len(known.forward) == 24
    np.testing.assert_allclose(known.side, 0.65)
    assert len(known.side) == 7 * 2 * 3
    np.testing.assert_array_equal(strips_of(place, ["1"] * len(place)), np.repeat([0, 1, 2, 3], 7))


def test_a_lost_photograph_and_a_lost_strip_show() -> None:
    place, sides = lawn(0.6, 0.65, 0.0, skip=(2,))
    kept = np.delete(np.arange(len(place)), 3)
    known = overlaps(place[kept], ["1"] * len(kept), sides[kept])
    assert known.forward.min() == pytest.approx(0.2)
    assert known.pair[np.argmin(known.forward)].tolist() == [2, 3]
    assert known.side.min() == pytest.approx(0.3)


def test_strips_farther_apart_than_their_ground_overlap_by_nothing() -> None:
    place, sides = lawn(0.7, -0.5, 0.0)
    known = overlaps(place, ["1"] * len(place), sides)
    assert known.side.max() == 0.0


def test_flights_are_no_strip_together_and_few_photographs_are_none() -> None:
    place, sides = lawn(0.8, 0.6, 0.0)
    assert strips_of(place[:7], ["1"] * 3 + ["2"] * 4).tolist() == [0, 0, 0, 1, 1, 1, 1]
    for count in (0, 1, 2):
        known = overlaps(place[:count], ["1"] * count, sides[:count])
        assert (len(known.forward), len(known.side), known.strips) == (0, 0, 0)
    assert np.isnan(track_directions(place[:1], ["1"])).all()
    np.testing.assert_allclose(track_directions(place[:2], ["1"] * 2), [[0.0, 1.0]] * 2)


def test_ground_that_is_not_seen_overlaps_nothing() -> None:
    place, sides = lawn(0.8, 0.65, 0.0)
    sides[7:14] = np.nan
    known = overlaps(place, ["1"] * len(place), sides)
    assert len(known.forward) == 18
    assert not set(range(7, 14)) & set(known.pair.reshape(-1).tolist())


def test_cameras_on_one_body_are_one_station() -> None:
    place, sides = lawn(0.8, 0.65, 90.0)
    both = np.repeat(place, 2, axis=0) + np.tile([[0.0, 0.0, 0.0], [0.05, 0.02, 0.0]], (len(place), 1))
    shown = np.repeat(sides, 2, axis=0)
    shown[::2] = np.nan  # the first camera looks at the horizon
    known = overlaps(both, ["1"] * len(both), shown)
    np.testing.assert_allclose(known.forward, 0.8)
    np.testing.assert_allclose(known.side, 0.65)
    assert (known.pair % 2 == 1).all()
    track = track_directions(both, ["1"] * len(both))
    np.testing.assert_allclose(track, np.repeat(track_directions(place, ["1"] * len(place)), 2, axis=0), atol=1e-9)
