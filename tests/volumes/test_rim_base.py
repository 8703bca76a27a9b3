"""Heaps over the ground around them, of one simulated survey."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from lib.simulated_changes import CORNER, Errors, Heap, epoch, grid_at
from seeds import limit, seeds

from photogram.files.maps.polygon_files import SitePolygon
from photogram.grid import Window
from photogram.volumes.rim_base import base_of, over_level, rim_of
from photogram.volumes.volumes import Volume, VolumeSums

HEAP = Heap(30.0, -20.0, 5.0, 0.6)
POLYGON = SitePolygon("sand", shapely.Point(CORNER[0] + HEAP.east_m, CORNER[1] + HEAP.north_m).buffer(6.0))


def leaning(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(40.0 + 0.05 * x - 0.03 * y + HEAP.height(x, y))


def volume_of(errors: Errors, seed: int) -> Volume:
    grid = grid_at(HEAP.east_m, HEAP.north_m, 20.0, 0.2)
    difference = over_level(epoch(leaning, grid, errors, np.random.default_rng(seed)))
    _, correction = base_of(difference, POLYGON)
    sums = VolumeSums(POLYGON.name, POLYGON.polygon, grid, difference.patterns(correction))
    margin = difference.margin
    outer = Window(-margin, -margin, grid.rows + margin, grid.columns + margin)
    sums.add(difference, difference.cells(outer, correction), outer, grid.whole)
    return sums.volume()


def true_m3() -> float:
    x, y = np.meshgrid(*(np.arange(-8.0, 8.0, 0.02) + at + 0.01 for at in (HEAP.east_m, HEAP.north_m)))
    return float(HEAP.height(x, y).sum() * 0.02**2)


def test_the_volume_over_the_rim_is_off_by_what_its_standard_deviation_says() -> None:
    truth = true_m3()
    volumes = [volume_of(Errors(), seed) for seed in seeds(150, few=40)]
    z = np.array([(v.net_m3 - truth) / v.net_sigma_m3 for v in volumes])
    assert abs(z.mean()) < limit(0.3, 150, few=40)
    assert abs(np.sqrt(np.mean(z**2)) - 1.0) < limit(0.2, 150, few=40)


def test_a_shift_of_the_block_leaves_the_volume_alone() -> None:
    far = replace(Errors(own_m=(0.0, 0.0)), shift_m=(0.0, 0.0, 10.0), dome_m=0.0)
    volume = volume_of(far, 3)
    assert volume.net_m3 == pytest.approx(true_m3(), rel=2e-3)
    assert volume.net_sigma_m3 < 0.01 * true_m3()


def test_the_rim_lies_outside_of_the_polygon() -> None:
    rim = rim_of(POLYGON.polygon, 2.0)
    assert rim.intersection(POLYGON.polygon).area < 1e-9
    assert rim.area == pytest.approx(np.pi * (8.0**2 - 6.0**2), rel=0.01)
