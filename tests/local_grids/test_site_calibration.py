"""Calibration of a site from a table to a file: closed through PROJ, refused whole, and its scale factors."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import CRS, Transformer

from photogram.errors import ControlPointError, FrameError, PhotogramError, WorkspaceError
from photogram.local_grids.definition import UNITS
from photogram.local_grids.site_calibration import calibrate_site

SIGMAS: dict[str, Any] = {"sigma_plan_m": 0.012, "sigma_height_m": 0.02}
MIDDLE = (12.57, 55.68)


def pairs_of(folder: Path, unit: str = "m", n: int = 7, noise_m: float = 0.0, crs: str = "EPSG:4326") -> Path:
    """Write pairs of a local grid that is a turned, scaled and inclined UTM; those of feet in feet."""
    rng = np.random.default_rng(1)
    place = MIDDLE + rng.uniform(-0.01, 0.01, (n, 2)) * [1.7, 1.0]
    height = rng.uniform(30.0, 60.0, n)
    x, y = np.array(Transformer.from_crs("EPSG:4326", "EPSG:25833", always_xy=True).transform(*place.T))
    z = 5000 + 1000j + 1.0003 * np.exp(0.4j) * ((x - x.mean()) + 1j * (y - y.mean()))
    local = np.column_stack([z.real, z.imag, height - 36.0 + 5e-5 * (x - x.mean())])
    local = (local + rng.normal(0.0, noise_m, local.shape) if noise_m else local) / UNITS[unit].factors
    given = np.array(Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(*place.T)).T
    columns = "longitude,latitude" if crs == "EPSG:4326" else "easting,northing"
    rows = [f"name,{columns},height,local_easting,local_northing,local_height"]
    rows += [
        f"P{i},{a!r},{b!r},{h!r},{e!r},{n!r},{u!r}"
        for i, ((a, b), h, (e, n, u)) in enumerate(zip(given.tolist(), height.tolist(), local.tolist(), strict=True), 1)
    ]
    path = folder / "pairs.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("unit", UNITS)
def test_the_file_takes_pairs_to_the_grid_and_back_through_proj(tmp_path: Path, unit: str) -> None:
    path = pairs_of(tmp_path, unit)
    site = calibrate_site(path, tmp_path / "site.wkt2", unit=unit, **SIGMAS)
    assert site.closure_m < 1e-6
    crs = CRS.from_wkt((tmp_path / "site.wkt2").read_text(encoding="utf-8"))
    rows = np.loadtxt(path, delimiter=",", skiprows=1, usecols=range(1, 7))
    there = Transformer.from_crs("EPSG:4979", crs, always_xy=True)
    local = np.column_stack(there.transform(*rows[:, :3].T))
    expected = rows[:, 3:] + site.calibration.residual_m / UNITS[unit].factors
    assert np.abs((local - expected) * UNITS[unit].factors).max() < 1e-6
    back = np.column_stack(there.transform(*local.T, direction="INVERSE"))
    assert np.abs((back - rows[:, :3]) * [111e3, 111e3, 1.0]).max() < 1e-6
    # UTM's own scale bends over 2 km by some millimetres, which no similarity of another projection takes up
    assert np.abs(site.calibration.residual_m[:, :2]).max() < 0.01


def test_a_grid_derived_from_the_map_it_came_from_fits_exactly(tmp_path: Path) -> None:
    site = calibrate_site(pairs_of(tmp_path), tmp_path / "site.wkt2", projection="EPSG:25833", **SIGMAS)
    assert np.abs(site.calibration.residual_m[:, :2]).max() < 1e-6
    assert site.calibration.plan.scale == pytest.approx(1.0003, abs=1e-10)
    assert "DERIVEDPROJCRS" in (tmp_path / "site.wkt2").read_text(encoding="utf-8")


def test_easting_and_northing_of_a_map_serve_as_longitude_and_latitude_do(tmp_path: Path) -> None:
    first = calibrate_site(pairs_of(tmp_path), **SIGMAS)
    second = calibrate_site(pairs_of(tmp_path, crs="EPSG:25833"), crs="EPSG:25833", **SIGMAS)
    assert second.calibration.plan.rotation_rad == pytest.approx(first.calibration.plan.rotation_rad, abs=1e-9)
    np.testing.assert_allclose(second.calibration.residual_m, first.calibration.residual_m, atol=1e-6)


def test_the_combined_scale_factor_is_that_of_lengths(tmp_path: Path) -> None:
    """A level length at the mean height between two pairs, in space, beside the same in the grid."""
    path = pairs_of(tmp_path)
    site = calibrate_site(path, **SIGMAS)
    rows = np.loadtxt(path, delimiter=",", skiprows=1, usecols=range(1, 7))
    cart = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    level = np.column_stack(cart.transform(*rows[:, :2].T, np.full(len(rows), site.height_m)))
    ground = np.linalg.norm(level[1:] - level[0], axis=1)
    grid = np.linalg.norm(rows[1:, 3:5] - rows[0, 3:5], axis=1)
    assert np.mean(grid / ground) == pytest.approx(site.scale.combined, abs=3e-6)
    assert site.scale.combined == site.scale.grid * site.scale.height
    assert site.scale.height < 1.0


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({}, ControlPointError, "7 pairs .* without a standard deviation in plan"),
        ({**SIGMAS, "crs": "EPSG:25833"}, FrameError, "longitude and latitude, but EPSG:25833"),
        ({**SIGMAS, "crs": "EPSG:99999999"}, FrameError, "not a CRS known to PROJ"),
        ({**SIGMAS, "crs": "EPSG:9518"}, FrameError, "heights above a geoid"),
        ({**SIGMAS, "crs": "EPSG:4314"}, FrameError, "not on the ellipsoid of GNSS"),
        ({**SIGMAS, "projection": "EPSG:4326"}, FrameError, "is not a projected CRS"),
        ({**SIGMAS, "projection": "EPSG:25833", "unit": "ft"}, FrameError, "does not compute a grid in foot"),
        ({**SIGMAS, "scale": 3.0}, FrameError, "scale 3: must be from 0.5 to 2"),
        ({**SIGMAS, "unit": "yd"}, FrameError, "a local grid is in m, ft, ftUS"),
    ],
)
def test_what_does_not_serve_is_refused_and_nothing_written(
    tmp_path: Path, options: dict[str, Any], error: type[PhotogramError], says: str
) -> None:
    path = pairs_of(tmp_path)
    with pytest.raises(error, match=says):
        calibrate_site(path, tmp_path / "site.wkt2", **options)
    assert [p.name for p in tmp_path.iterdir()] == ["pairs.csv"]


def test_a_file_that_is_there_stays(tmp_path: Path) -> None:
    path, target = pairs_of(tmp_path), tmp_path / "site.wkt2"
    target.write_text("mine")
    with pytest.raises(WorkspaceError, match="is there already"):
        calibrate_site(path, target, **SIGMAS)
    with pytest.raises(WorkspaceError, match=r"ends in \.wkt2"):
        calibrate_site(path, tmp_path / "site.csv", **SIGMAS)
    assert target.read_text() == "mine"
    calibrate_site(path, target, overwrite=True, **SIGMAS)
    assert target.read_text().startswith("COMPOUNDCRS")
