"""Heaps over the ground around them, of one simulated survey."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from changed_surveys import OUTLINES, write_epochs, write_polygons
from lib.simulated_changes import CORNER, Errors, Heap, epoch, grid_at
from seeds import limit, seeds

from photogram.change.rim_base import base_of, over_level, rim_of
from photogram.change.surface_change import SurfaceRequest, compare_surfaces
from photogram.change.volumes import Volume, VolumeSums
from photogram.errors import PhotogramError, ProjectError
from photogram.files.maps.polygon_files import SitePolygon
from photogram.grid import Window

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


def test_one_epoch_on_disk(tmp_path: Path) -> None:
    _, later = write_epochs(tmp_path)
    write_polygons(tmp_path / "heaps.gpkg", OUTLINES, ["heap", "pit"])
    request = SurfaceRequest(later, None, tmp_path / "heaps.gpkg")
    change = compare_surfaces(request, tmp_path / "out")
    assert change.reference == "the plane through the rim"
    assert len(change.bases) == 2
    assert change.bases[0].value[0] == pytest.approx(40.0, abs=0.7)
    heap, pit = change.volumes
    assert heap.fill_m3 > 5 * heap.cut_m3
    assert pit.cut_m3 > 5 * pit.fill_m3
    assert change.cells < 1.02 * (heap.area_m2 + pit.area_m2) / 0.04 + 400
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ProjectError, match="name the polygons"):
        compare_surfaces(replace(request, polygons=None), tmp_path / "none")
    corner = shapely.box(CORNER[0] - 14.9, CORNER[1] + 14.0, CORNER[0] - 14.7, CORNER[1] + 14.4)
    write_polygons(tmp_path / "out" / "rim.gpkg", [corner.buffer(60.0)], ["all"])
    with pytest.raises(PhotogramError, match="base of 'all', in a strip around it: stable ground"):
        compare_surfaces(replace(request, polygons=tmp_path / "out" / "rim.gpkg"), tmp_path / "none")
    assert sorted(tmp_path.rglob("*")) == sorted([*before, tmp_path / "out" / "rim.gpkg"])
