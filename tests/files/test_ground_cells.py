"""Ground points of a laser survey in cells."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

from photogram.arrays import FloatArray
from photogram.errors import ProjectError
from photogram.files.clouds.ground_cells import GROUND, PER_CELL, GroundCells, read_ground_cells
from photogram.geodesy.crs import NO_CRS

CORNER = np.array([500_000.0, 5_800_000.0])
LOW, HIGH = CORNER - 1e3, CORNER + 1e3


def write(path: Path, points: FloatArray, classes: object = GROUND, crs: str | None = "EPSG:25832") -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-4), np.floor(points.min(axis=0))
    if crs is not None:
        header.add_crs(CRS.from_user_input(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.classification = np.broadcast_to(np.asarray(classes, dtype=np.uint8), len(points)).copy()
    las.write(str(path))
    return path


def ground(count: int = 20_000, side_m: float = 60.0, noise_m: float = 0.0, seed: int = 1) -> FloatArray:
    """Return points (N, 3) that fall where they like on a steep plane with a hill."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, side_m, (count, 2))
    return np.column_stack([CORNER + xy, surface(xy) + noise_m * rng.standard_normal(count)])


def surface(xy: FloatArray) -> FloatArray:
    return np.asarray(100.0 + 0.5 * xy[:, 0] - 0.3 * xy[:, 1] + 2.0 * np.sin(xy[:, 0] / 9.0))


def read(path: Path, crs: str = NO_CRS) -> GroundCells:
    found = read_ground_cells(path, LOW, HIGH, crs)
    assert found is not None
    return found


def errors_of(found: GroundCells) -> FloatArray:
    raster = found.raster
    row, column = np.nonzero(np.isfinite(raster.values))
    east = raster.west_map_m + (column + 0.5) * raster.cell_m - CORNER[0]
    north = raster.north_map_m - (row + 0.5) * raster.cell_m - CORNER[1]
    inside = (np.minimum(east, north) > raster.cell_m) & (np.maximum(east, north) < 60.0 - raster.cell_m)
    return np.asarray((raster.values[row, column] - surface(np.column_stack([east, north])))[inside])


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_relief_within_a_cell_is_no_noise(suffix: str, tmp_path: Path) -> None:
    found = read(write(tmp_path / f"ground.{suffix}", ground()))
    assert 20_000 / (60.0 / found.raster.cell_m) ** 2 == pytest.approx(PER_CELL, rel=0.25)
    off = errors_of(found)
    assert len(off) > 2000
    # a cell of 1.2 m on a slope of 0.58 m per m would scatter by 0.07 m, were its points not brought to its middle
    assert np.std(off) < 0.008
    assert abs(np.mean(off)) < 0.003


def test_the_noise_of_a_cell_is_that_of_its_points(tmp_path: Path) -> None:
    found = read(write(tmp_path / "ground.laz", ground(noise_m=0.1)))
    assert found.of_point == pytest.approx(0.38, abs=0.02)
    z = errors_of(found) / (0.1 * found.of_point)
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.07)


def test_ground_alone_counts_and_only_around_the_site(tmp_path: Path) -> None:
    bare, trees = ground(), ground(seed=2)
    trees[:, 2] += 15.0
    both = np.concatenate([bare, trees])
    path = write(tmp_path / "all.laz", both, np.repeat([GROUND, 5], len(bare)))
    np.testing.assert_array_equal(read(path).raster.values, read(write(tmp_path / "bare.laz", bare)).raster.values)
    part = read_ground_cells(path, CORNER + 20.0, CORNER + 40.0)
    assert part is not None
    assert part.raster.values.shape[0] * part.raster.cell_m == pytest.approx(20.0, abs=2.5)
    assert read_ground_cells(path, LOW + 5e3, HIGH + 5e3) is None


def test_feet_are_metres_afterwards(tmp_path: Path) -> None:
    foot = 1200.0 / 3937.0
    points = ground()
    in_feet = read(write(tmp_path / "feet.laz", points / foot, crs="EPSG:2229+6360"))
    assert np.nanmean(in_feet.raster.values) == pytest.approx(np.mean(points[:, 2]), abs=0.2)
    assert in_feet.raster.cell_m == pytest.approx(read(write(tmp_path / "m.laz", points)).raster.cell_m)


def test_the_crs_is_that_of_the_file(tmp_path: Path) -> None:
    assert "32N" in read(write(tmp_path / "a.laz", ground())).crs
    assert read(write(tmp_path / "b.laz", ground(), crs=None)).crs == NO_CRS


def test_a_few_points_are_no_ground_and_far_ones_no_huge_grid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("photogram.files.clouds.ground_cells.BESIDE", 0.0)
        assert read_ground_cells(write(tmp_path / "one.laz", ground(1)), LOW, HIGH) is None
    away = np.array([900.0, 900.0, 0.0])
    far = np.concatenate([ground(5000, 5.0), ground(5000, 5.0) + away])
    monkeypatch.setattr("photogram.files.clouds.ground_cells.MOST_CELLS", 10_000)
    few = read(write(tmp_path / "far.laz", far)).raster
    assert 5000 < few.values.size <= 11_000


def test_a_cloud_without_ground_or_damaged_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "trees.laz", ground(100), 5)
    with pytest.raises(ProjectError, match=r"no point of it is classified as ground \(class 2\)"):
        read_ground_cells(path, LOW, HIGH)
    with pytest.raises(ProjectError, match="file not found"):
        read_ground_cells(tmp_path / "none.laz", LOW, HIGH)
    whole = write(tmp_path / "whole.laz", ground(5000)).read_bytes()
    (tmp_path / "cut.laz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ProjectError, match=r"cut\.laz"):
        read_ground_cells(tmp_path / "cut.laz", LOW, HIGH)
