"""Clouds with the standard deviations of their heights, and distances as LAZ."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray

from photogram.change.files.compared_clouds import read_compared, write_distances
from photogram.errors import ProjectError
from photogram.files.clouds.points import write_laz, write_xyz
from photogram.geodesy.crs import NO_CRS
from photogram.survey import PointCloud

POINTS = np.array(
    [[500_000.123, 6_000_000.456, 12.345], [500_007.5, 6_000_003.25, 13.0], [500_001.0, 6_000_009.0, 9.5]]
)


def test_sigmas_and_crs_come_with_the_points(tmp_path: Path) -> None:
    sigma = np.array([[0.01, 0.02, 0.03]] * 3)
    write_laz(tmp_path / "a.laz", PointCloud(POINTS, None, sigma), "EPSG:25832+5799")
    found = read_compared(tmp_path / "a.laz")
    np.testing.assert_allclose(found.points.position_map_m, POINTS, atol=6e-4)
    assert found.sigma_height_m is not None
    np.testing.assert_allclose(found.sigma_height_m, 0.03)
    assert found.crs is not None
    assert "UTM zone 32N" in found.crs
    write_xyz(tmp_path / "a.txt", PointCloud(POINTS))
    plain = read_compared(tmp_path / "a.txt")
    assert (plain.sigma_height_m, plain.crs) == (None, None)


@pytest.mark.parametrize("crs", ["EPSG:25832", NO_CRS])
def test_distances_are_read_again(tmp_path: Path, crs: str) -> None:
    values = np.array([0.1, -0.2, np.nan], dtype=np.float32)
    fields: dict[str, tuple[NDArray[np.generic], str]] = {
        "distance": (values, "later minus earlier [m]"),
        "significant": (np.array([1, 0, 0], np.uint8), "1: yes"),
    }
    write_distances(tmp_path / "d.laz", POINTS, crs, fields)
    found = laspy.read(tmp_path / "d.laz")
    np.testing.assert_allclose(np.asarray(found.xyz), POINTS, atol=6e-4)
    np.testing.assert_array_equal(found["distance"], values)
    assert found["significant"].tolist() == [1, 0, 0]


def test_feet_are_read_and_written(tmp_path: Path) -> None:
    """State Plane in US survey feet, 1200/3937 m each: metres within, feet in the files."""
    place = np.array([[300_000.0, 60_000.0, 12.0], [300_030.0, 60_005.0, 13.5]])
    write_laz(tmp_path / "a.laz", PointCloud(place, None, np.full((2, 3), 0.05)), "EPSG:2263+6360")
    assert np.asarray(laspy.read(tmp_path / "a.laz").xyz)[0, 0] == pytest.approx(300_000.0 * 3937 / 1200, abs=1e-3)
    found = read_compared(tmp_path / "a.laz")
    np.testing.assert_allclose(found.points.position_map_m, place, atol=4e-4)
    assert found.sigma_height_m is not None
    np.testing.assert_allclose(found.sigma_height_m, 0.05, rtol=1e-6)
    write_distances(tmp_path / "d.laz", place, "EPSG:2263+6360", {"distance": (np.zeros(2, np.float32), "[m]")})
    np.testing.assert_allclose(np.asarray(laspy.read(tmp_path / "d.laz").xyz), place * 3937 / 1200, atol=6e-4)


def test_what_is_no_sigma_is_refused(tmp_path: Path) -> None:
    sigma = np.array([[0.01, 0.02, 0.03], [0.01, 0.02, -1.0], [0.01, 0.02, 0.03]])
    write_laz(tmp_path / "a.laz", PointCloud(POINTS, None, sigma), "EPSG:25832")
    with pytest.raises(ProjectError, match="'sigma z' holds what is no standard deviation"):
        read_compared(tmp_path / "a.laz")
    with pytest.raises(ProjectError, match="file not found"):
        read_compared(tmp_path / "none.laz")
