"""Receivers that have stopped, and those that only stand still."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from photogram.project.positions.frozen import frozen_positions

NOON = datetime(2024, 5, 1, 12)
RNG = np.random.default_rng(4)
FLOWN = RNG.uniform(0.0, 200.0, (20, 3))


def times(number: int, step_s: float = 2.0) -> list[datetime | None]:
    return [NOON + timedelta(seconds=step_s * i) for i in range(number)]


def test_measured_positions_are_not_frozen() -> None:
    assert not frozen_positions(FLOWN, times(20)).any()
    hovering = np.zeros((20, 3)) + RNG.normal(0.0, 0.05, (20, 3))
    assert not frozen_positions(hovering, times(20)).any()


def test_a_receiver_that_stops_on_the_way() -> None:
    position = FLOWN.copy()
    position[12:] = position[12] + RNG.uniform(-0.004, 0.004, (8, 3))
    position[15] = np.nan
    expected = np.arange(20) > 12  # the first of them was measured
    expected[15] = False
    np.testing.assert_array_equal(frozen_positions(position, times(20)), expected)


@pytest.mark.parametrize("number", [2, 3])
def test_it_takes_three_at_different_times(number: int) -> None:
    position = FLOWN.copy()
    position[:number] = position[0]
    assert frozen_positions(position, times(20)).sum() == (number - 1 if number >= 3 else 0)


def test_cameras_of_one_aircraft_may_share_positions() -> None:
    position = np.repeat(FLOWN[:4], 5, axis=0)
    assert not frozen_positions(position, [NOON + timedelta(seconds=2.0 * (i // 5)) for i in range(20)]).any()


def test_without_times_only_a_whole_block_is_frozen() -> None:
    nobody = [None] * 20
    assert frozen_positions(np.zeros((20, 3)), nobody).all()
    position = FLOWN.copy()
    position[:5] = position[0]
    assert not frozen_positions(position, nobody).any()


def test_clocks_with_and_without_a_zone_are_compared() -> None:
    mixed = [t.replace(tzinfo=UTC) if t and i % 2 else t for i, t in enumerate(times(20))]
    assert frozen_positions(np.zeros((20, 3)), mixed).all()


def test_thousands_that_are_frozen_take_no_time() -> None:
    assert frozen_positions(np.zeros((20_000, 3)), times(20_000)).all()
    assert not frozen_positions(np.zeros((0, 3)), []).any()


def test_cameras_triggered_together_are_one_moment_whatever_their_clocks_say() -> None:
    """Five bands of four exposures, some milliseconds apart: their positions are the same, and were measured."""
    position = np.repeat(FLOWN[:4], 5, axis=0)
    captures = [f"exposure {i // 5}" for i in range(20)]
    assert frozen_positions(position, times(20, 0.01)).sum() == 16
    assert not frozen_positions(position, times(20, 0.01), captures).any()
    standing = np.repeat(FLOWN[:1], 20, axis=0)
    assert frozen_positions(standing, times(20, 0.01), captures).all()


def test_a_receiver_slower_than_the_camera_has_measured_the_first_of_each() -> None:
    position = np.repeat(FLOWN[:5], 4, axis=0)
    backwards = times(20)[::-1]
    np.testing.assert_array_equal(frozen_positions(position, times(20)), np.arange(20) % 4 > 0)
    np.testing.assert_array_equal(frozen_positions(position, backwards), np.arange(20) % 4 < 3)
    bands = np.repeat(position, 2, axis=0)
    captures = [f"exposure {i // 2}" for i in range(40)]
    np.testing.assert_array_equal(frozen_positions(bands, times(40, 0.01), captures), np.arange(40) % 8 > 1)
