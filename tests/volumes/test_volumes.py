"""Volumes of simulated heaps: exact without errors, and off by what their standard deviations say, from both sides."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from lib.simulated_changes import CORNER, Errors, Heap, MemoryRaster, epoch, grid_at, uneven
from seeds import limit, seeds

from photogram.grid import Window
from photogram.volumes.differences import Difference, difference_of
from photogram.volumes.surfaces import SurfaceFiles
from photogram.volumes.volumes import Volume, VolumeSums, total, volume_label

NONE = Errors(own_m=(0.0, 0.0), shift_m=(0.0, 0.0, 0.0), tilt_m=0.0, dome_m=0.0)
OWN = replace(NONE, own_m=(0.05, 0.05))
COMMON = replace(Errors(), own_m=(0.0, 0.0))
HEAP = Heap(30.0, -20.0, 5.0, 0.6)
POLYGON = shapely.Point(CORNER[0] + HEAP.east_m, CORNER[1] + HEAP.north_m).buffer(6.3)


def with_heap(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return uneven(x, y) + HEAP.height(x, y)


def surveys(errors: Errors, seed: int, cell_m: float = 0.2) -> tuple[SurfaceFiles, SurfaceFiles]:
    rng = np.random.default_rng(seed)
    grid = grid_at(HEAP.east_m, HEAP.north_m, 16.0, cell_m)
    return epoch(uneven, grid, errors, rng), epoch(with_heap, grid, errors, rng)


def sums_of(difference: Difference, polygon: object = POLYGON, outline_m: float = 0.0, tile: int = 1000) -> VolumeSums:
    sums = VolumeSums("heap", polygon, difference.grid, difference.patterns(), outline_m)
    margin = difference.margin
    for window in difference.grid.tiles(tile):
        outer = Window(window.row - margin, window.column - margin, window.row_end + margin, window.column_end + margin)
        sums.add(difference, difference.cells(outer), outer, window)
    return sums


def volume_of(errors: Errors, seed: int) -> Volume:
    return sums_of(difference_of(*surveys(errors, seed))).volume()


def true_m3() -> float:
    x, y = np.meshgrid(*(np.arange(-8.0, 8.0, 0.02) + at + 0.01 for at in (HEAP.east_m, HEAP.north_m)))
    return float(HEAP.height(x, y).sum() * 0.02**2)


def test_without_errors_the_volume_is_the_true_one() -> None:
    volume = volume_of(NONE, 1)
    assert volume.net_m3 == pytest.approx(true_m3(), rel=2e-3)
    assert volume.fill_m3 == pytest.approx(volume.net_m3 + volume.cut_m3, rel=1e-9)
    assert volume.cut_m3 < 1e-3 * volume.fill_m3
    assert volume.area_m2 == pytest.approx(volume.measured_m2, rel=1e-6)
    assert (volume.unmeasured_m2, volume.interpolated_m2, volume.net_sigma_m3) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("errors", [OWN, COMMON, Errors()], ids=["own", "common", "both"])
def test_volumes_are_off_by_what_their_standard_deviations_say(errors: Errors) -> None:
    truth = true_m3()
    volumes = [volume_of(errors, seed) for seed in seeds(200, few=40)]
    z = np.array([(v.net_m3 - truth) / v.net_sigma_m3 for v in volumes])
    assert abs(z.mean()) < limit(0.25, 200, few=40)
    assert abs(np.sqrt(np.mean(z**2)) - 1.0) < limit(0.13, 200, few=40)  # 5 % by chance, 1 sigma
    fill = np.array([(v.fill_m3 - truth) / v.fill_sigma_m3 for v in volumes])
    assert np.mean(np.abs(fill) < 2.0) > 1.0 - limit(0.07, 200, few=40)


def test_the_own_part_would_be_too_small_without_what_neighbours_share() -> None:
    earlier, later = surveys(OWN, 3)
    alone = difference_of(replace(earlier, correlation_m=0.01), replace(later, correlation_m=0.01))
    ratio = volume_of(OWN, 3).own_sigma_m3 / sums_of(alone).volume().own_sigma_m3
    assert 4.5 < ratio < 5.0  # a window is 5 cells wide, a rim less


def test_tiles_make_the_same_volume() -> None:
    difference = difference_of(*surveys(Errors(), 4))
    whole, pieces = (sums_of(difference, outline_m=0.1, tile=tile).volume() for tile in (1000, 17))
    for name, value in vars(whole).items():
        if name != "name":
            assert getattr(pieces, name) == pytest.approx(value, rel=1e-9, abs=1e-12), name


def test_cells_measured_in_larger_ones_are_alike_over_as_many_more() -> None:
    earlier, later = surveys(OWN, 5)
    grid = later.heights.grid
    codes = MemoryRaster(later.heights.path, grid, later.heights.crs, values=np.full((80, 80), 4, np.float32))
    once = sums_of(difference_of(earlier, later)).own_m6[0] / 2
    larger = sums_of(difference_of(earlier, replace(later, source=codes))).own_m6[0]
    assert larger == pytest.approx(once * (1 + 4**2), rel=1e-2)


def test_corners_of_the_polygon_add_what_moved_polygons_scatter_by() -> None:
    difference = difference_of(*surveys(NONE, 6))
    corners = shapely.get_coordinates(shapely.Point(POLYGON.centroid).buffer(3.0, quad_segs=2))[:-1]
    predicted = sums_of(difference, shapely.Polygon(corners), 0.05).volume()
    rng = np.random.default_rng(70)
    moved = [
        sums_of(difference, shapely.Polygon(corners + 0.05 * rng.standard_normal(corners.shape))).volume().net_m3
        for _ in range(800)
    ]
    assert predicted.outline_sigma_m3 == pytest.approx(float(np.std(moved)), rel=0.08)
    assert predicted.net_sigma_m3 == predicted.outline_sigma_m3


def test_unmeasured_and_filled_cells_are_counted_and_said() -> None:
    earlier, later = surveys(Errors(), 8)
    assert isinstance(later.heights, MemoryRaster)
    assert later.sigma is not None
    assert isinstance(later.sigma, MemoryRaster)
    height, sigma = later.heights.values.copy(), later.sigma.values.copy()  # type: ignore[union-attr]
    height[30:35, 30:40] = np.nan
    sigma[40:44, 40:45] = np.nan  # as in dsm_filled.tif beside dsm_sigma.tif
    holes = replace(later, heights=replace(later.heights, values=height), sigma=replace(later.sigma, values=sigma))
    volume = sums_of(difference_of(earlier, holes)).volume()
    whole = sums_of(difference_of(earlier, later)).volume()
    assert volume.unmeasured_m2 == pytest.approx(50 * 0.04, rel=1e-6)
    assert volume.interpolated_m2 == pytest.approx(20 * 0.04, rel=1e-6)
    assert volume.area_m2 == pytest.approx(volume.measured_m2 + volume.unmeasured_m2 + volume.interpolated_m2)
    assert volume.interpolated_m3 > 0.5
    assert volume.net_m3 < whole.net_m3 - 1.0


def test_the_volumes_of_all_polygons_share_the_common_errors() -> None:
    difference = difference_of(*surveys(COMMON, 9))
    halves = [shapely.intersection(POLYGON, half) for half in (
        shapely.box(0.0, 0.0, POLYGON.centroid.x, 1e8), shapely.box(POLYGON.centroid.x, 0.0, 1e8, 1e8)
    )]  # fmt: skip
    whole = sums_of(difference).volume()
    both = total([sums_of(difference, half) for half in halves])
    assert both.net_m3 == pytest.approx(whole.net_m3, rel=1e-9)
    assert both.common_sigma_m3 == pytest.approx(whole.common_sigma_m3, rel=1e-9)
    assert both.area_m2 == pytest.approx(whole.area_m2)


@pytest.mark.parametrize(
    ("volume", "text"),
    [((1234.567, 6.78), "+1234.6 ± 6.8 m³"), ((-87.7, 0.27), "−87.70 ± 0.27 m³"), ((-1234.0, 45.0), "−1234 ± 45 m³"),
     ((12.3, 0.0), "+12.3 m³")],
)  # fmt: skip
def test_a_volume_is_said_to_the_second_digit_of_its_sigma(volume: tuple[float, float], text: str) -> None:
    assert volume_label(*volume) == text
