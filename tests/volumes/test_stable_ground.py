"""Co-registration of simulated surfaces on stable ground, with a shift and with none."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from lib.simulated_changes import CORNER, Drawn, Errors, MemoryRaster, epoch, grid_at, uneven

from photogram.errors import PhotogramError
from photogram.grid import Window
from photogram.volumes.differences import Difference, difference_of
from photogram.volumes.stable_ground import MOST_CELLS, registration_of
from photogram.volumes.surfaces import PATTERNS

STILL = Drawn(np.zeros(3), np.zeros(2), 0.0)


def box(west: float, south: float, east: float, north: float) -> object:
    return shapely.box(CORNER[0] + west, CORNER[1] + south, CORNER[0] + east, CORNER[1] + north)


STABLE = [box(-24, -24, 24, -12), box(-24, 12, 24, 24)]


def surveys(seed: int, moved: Drawn, errors: Errors | None = None) -> Difference:
    rng = np.random.default_rng(seed)
    grid = grid_at(0.0, 0.0, 50.0, 0.25)
    used = errors or Errors()
    return difference_of(epoch(uneven, grid, used, rng, STILL), epoch(uneven, grid, used, rng, moved))


def test_a_shift_and_a_tilt_are_found_within_their_standard_deviations() -> None:
    moved = Drawn(np.array([0.0, 0.0, 0.08]), np.array([4e-4, -3e-4]), 0.0)
    z = []
    for seed in range(40):
        found, _ = registration_of(surveys(seed, moved), STABLE, "tilt")
        true = [0.08 + 4e-4 * (found.centre_map_m[0] - CORNER[0]) - 3e-4 * (found.centre_map_m[1] - CORNER[1]), 4e-4]
        z.append((found.value - [*true, -3e-4]) / found.sigma)
    assert np.all(np.abs(np.mean(z, axis=0)) < 0.6)
    np.testing.assert_allclose(np.std(z, axis=0), 1.0, atol=0.35)


def test_surveys_that_lie_right_are_left_where_they_are() -> None:
    found, _ = registration_of(surveys(50, STILL), STABLE, "offset")
    assert abs(found.value[0]) < 3.0 * found.sigma[0]
    assert found.sigma[0] < 0.003
    assert found.expected_sigma[0] == pytest.approx(np.sqrt(2) * 0.02, rel=0.1)  # what both state for their heights
    assert found.rejected < 0.01 * found.cells
    assert found.remaining_m == 0.0


def test_what_is_taken_off_takes_the_common_errors_with_it() -> None:
    moved = Drawn(np.array([0.0, 0.0, 0.08]), np.zeros(2), 0.0)
    difference = surveys(51, moved)
    _, correction = registration_of(difference, STABLE, "offset")
    window = Window(60, 60, 140, 140)
    before, after = difference.cells(window), difference.cells(window, correction)
    assert before.pattern_m.shape[0] == 2 * PATTERNS
    assert after.pattern_m.shape[0] == difference.patterns(correction)
    assert np.mean(before.difference_m) == pytest.approx(0.08, abs=0.01)
    assert np.mean(after.difference_m) == pytest.approx(0.0, abs=0.005)
    inner = slice(5, -5)
    common = [np.sqrt(np.sum(c.pattern_m[:, inner, inner] ** 2, axis=0)).mean() for c in (before, after)]
    assert common[1] < 0.1 * common[0]
    assert common[1] > 1e-4


def test_a_car_on_stable_ground_is_left_out() -> None:
    difference = surveys(52, STILL)
    later = difference.later
    assert isinstance(later.heights, MemoryRaster)
    assert later.heights.values is not None
    values = later.heights.values.copy()
    values[20:40, 20:60] += 1.5
    with_car = difference_of(difference.earlier, replace(later, heights=replace(later.heights, values=values)))
    found, _ = registration_of(with_car, STABLE, "offset")
    assert found.rejected >= 800
    assert abs(found.value[0]) < 0.004
    assert found.before_nmad_m < 0.05


def test_ground_that_is_bent_between_its_parts_is_told() -> None:
    errors = Errors()
    bent = Drawn(np.zeros(3), np.zeros(2), 2.0)  # 2 m at 100 m: 0.1 m at 22 m
    found, correction = registration_of(surveys(53, bent, errors), STABLE, "offset")
    assert found.patches >= 10
    assert 0.01 < found.remaining_m < 0.1
    assert correction.remaining_m == found.remaining_m


def test_of_a_large_grid_every_second_cell_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    moved = Drawn(np.array([0.0, 0.0, 0.05]), np.array([4e-4, 0.0]), 0.0)
    every, _ = registration_of(surveys(54, moved), STABLE, "tilt")
    monkeypatch.setattr("photogram.volumes.stable_ground.MOST_CELLS", 12_000)
    some, _ = registration_of(surveys(54, moved), STABLE, "tilt")
    assert MOST_CELLS > 12_000
    assert some.cells == pytest.approx(every.cells / 4, rel=0.03)
    assert np.all(np.abs(some.value - every.value) < 2.0 * every.sigma)
    np.testing.assert_allclose(some.sigma, every.sigma, rtol=0.1)


def test_too_little_ground_is_refused() -> None:
    difference = surveys(55, STILL)
    with pytest.raises(PhotogramError, match=r"stable ground: \d+ cells of it are measured in both epochs, 100 are"):
        registration_of(difference, [box(0, 0, 1, 1)], "offset")
    with pytest.raises(PhotogramError, match="its polygons lie beyond what both epochs cover"):
        registration_of(difference, [box(900, 0, 901, 1)], "offset")
