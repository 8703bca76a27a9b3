"""The CRS of a local grid through PROJ, beside formulae of another hand."""

import numpy as np
import pytest
from pyproj import CRS, Transformer

from photogram.errors import FrameError
from photogram.geodesy.crs import crs_label, height_system_of, map_units, plan_of, vertical_of
from photogram.geodesy.frames import LocalFrame, map_from_crs
from photogram.geodesy.height_systems import Geoid
from photogram.local_grids.calibration import HeightFit, PlaneSimilarity
from photogram.local_grids.definition import UNITS, local_grid, site_map
from photogram.local_grids.tested_fit import fit

A, F = 6378137.0, 1.0 / 298.257223563
MIDDLES = ((12.57, 55.68), (-74.0, 40.7), (151.2, -33.9), (25.0, 0.01))
SIMILARITY = PlaneSimilarity(np.array([5000.0, 1000.0]), 0.3, 1.00012)
NO_FIT = fit(np.ones((1, 1)), np.zeros(1), np.ones(1))


def transverse_mercator(place_deg: np.ndarray, middle_deg: np.ndarray) -> np.ndarray:
    """Return x and y (N, 2) of a transverse Mercator with scale 1 by Krüger's series (Karney 2011, eqs. 7–12, 35)."""
    n = F / (2.0 - F)
    big = A / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    alpha = (
        n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16 + 41 * n**4 / 180,
        13 * n**2 / 48 - 3 * n**3 / 5 + 557 * n**4 / 1440,
        61 * n**3 / 240 - 103 * n**4 / 140,
        49561 * n**4 / 161280,
    )
    e = np.sqrt(F * (2 - F))

    def plane(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        t = np.tan(lat)
        sigma = np.sinh(e * np.arctanh(e * t / np.hypot(1, t)))
        tau = t * np.hypot(1, sigma) - sigma * np.hypot(1, t)
        xi = np.arctan2(tau, np.cos(lon))
        eta = np.arcsinh(np.sin(lon) / np.hypot(tau, np.cos(lon)))
        x = eta + sum(a * np.cos(2 * j * xi) * np.sinh(2 * j * eta) for j, a in enumerate(alpha, 1))
        y = xi + sum(a * np.sin(2 * j * xi) * np.cosh(2 * j * eta) for j, a in enumerate(alpha, 1))
        return big * np.column_stack([x, y])

    lon, lat = np.deg2rad(place_deg[:, 0] - middle_deg[0]), np.deg2rad(place_deg[:, 1])
    origin = plane(np.zeros(1), np.deg2rad(middle_deg[1:]))
    return np.asarray(plane(lon, lat) - origin)


def site(middle: tuple[float, float], reach_km: float = 5.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the middle of a site and longitudes, latitudes (N, 2) and heights (N,) of points around it."""
    rng = np.random.default_rng(4)
    at = np.array(middle)
    reach = reach_km / 111.0 * np.array([1.0 / np.cos(np.deg2rad(at[1])), 1.0])
    return at, at + rng.uniform(-1.0, 1.0, (60, 2)) * reach, rng.uniform(-20.0, 300.0, 60)


def plane_under(middle: np.ndarray) -> HeightFit:
    return HeightFit(middle, -36.5, 4e-5, -7e-5, np.zeros(3), NO_FIT)


def lowered(place_deg: np.ndarray, height_m: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return local heights by the formula of EPSG:1046 (IOGP 373-7-2, sec. 4.6.3)."""
    e2, sin2 = F * (2 - F), np.sin(np.deg2rad(middle[1])) ** 2
    rho, nu = A * (1 - e2) / (1 - e2 * sin2) ** 1.5, A / np.sqrt(1 - e2 * sin2)
    lon, lat = np.deg2rad(place_deg - middle).T
    return np.asarray(height_m - 36.5 + 4e-5 * rho * lat - 7e-5 * nu * lon * np.cos(np.deg2rad(place_deg[:, 1])))


def turned(xy: np.ndarray) -> np.ndarray:
    k, a = SIMILARITY.scale, SIMILARITY.rotation_rad
    z = (5000.0 + 1000.0j) + k * np.exp(1j * a) * (xy[:, 0] + 1j * xy[:, 1])
    return np.column_stack([z.real, z.imag])


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("middle", MIDDLES)
def test_the_loop_through_proj_is_closed_and_that_of_another_formula(middle: tuple[float, float], unit: str) -> None:
    at, place, height = site(middle)
    wkt = local_grid("Quarry north", "EPSG:4326", at, SIMILARITY, plane_under(at), UNITS[unit])
    crs = CRS.from_wkt(wkt)
    assert crs == CRS.from_wkt(crs.to_wkt())
    there = Transformer.from_crs("EPSG:4979", crs, always_xy=True)
    local = np.column_stack(there.transform(*place.T, height))
    expected = np.column_stack([turned(transverse_mercator(place, at)), lowered(place, height, at)])
    assert np.abs(local * UNITS[unit].factors - expected).max() < 1e-6
    back = np.column_stack(there.transform(*local.T, direction="INVERSE"))
    assert np.abs(back[:, :2] - place).max() * 111e3 < 1e-7
    assert np.abs(back[:, 2] - height).max() < 1e-7


@pytest.mark.parametrize(("reach_km", "off_m"), [(17.0, 1e-6), (50.0, 1e-4)])
def test_how_far_it_is_a_transverse_mercator(reach_km: float, off_m: float) -> None:
    for middle in MIDDLES[:3]:
        at, place, _ = site(middle, reach_km)
        flat = np.column_stack([place, np.zeros(len(place))])
        x = map_from_crs("EPSG:4326", site_map("EPSG:4326", at), flat)[:, :2]
        assert np.abs(x - transverse_mercator(place, at)).max() < off_m


@pytest.mark.parametrize(("given", "middle"), [("EPSG:25832", (9.4, 55.68)), ("EPSG:2263", (-74.0, 40.7))])
def test_a_similarity_of_a_given_map(given: str, middle: tuple[float, float]) -> None:
    """A map in feet is taken in metres: the similarity is of lengths."""
    at, place, height = site(middle)
    with pytest.raises(FrameError, match="does not compute a grid in foot"):
        local_grid("Site", "EPSG:4326", at, SIMILARITY, None, UNITS["ft"], given)
    wkt = local_grid("Site", "EPSG:4326", at, SIMILARITY, plane_under(at), UNITS["m"], given)
    plan = Transformer.from_crs("EPSG:4326", given, always_xy=True).transform(*place.T)
    factor = CRS(given).axis_info[0].unit_conversion_factor
    there = Transformer.from_crs("EPSG:4326", CRS.from_wkt(plan_of(wkt)), always_xy=True)
    local = np.column_stack(there.transform(*place.T))
    assert np.abs(local - turned(np.column_stack(plan) * factor)).max() < 1e-6
    back = np.column_stack(there.transform(*local.T, direction="INVERSE"))
    assert np.abs(back - place).max() * 111e3 < 1e-7
    heights = Geoid(str(vertical_of(wkt)))
    frame = LocalFrame(plan_of(wkt), (5000.0, 1000.0, 0.0), "tangent", heights)
    points = np.column_stack([local, lowered(place, height, at)])
    assert np.abs(points[:, 2] + frame.geoid_height_m(points) - height).max() < 1e-6
    assert np.abs(frame.map_from_world(frame.world_from_map(points)) - points).max() < 1e-6
    assert frame.units == UNITS["m"]


def test_what_photogram_reads_of_it() -> None:
    at, place, height = site(MIDDLES[0])
    wkt = local_grid('Quarry "north"', "EPSG:4326", at, SIMILARITY, plane_under(at), UNITS["ftUS"])
    assert height_system_of(wkt)[0] == "orthometric"
    assert crs_label(wkt) == "Quarry north"
    assert map_units(wkt) == UNITS["ftUS"]
    heights = Geoid(str(vertical_of(wkt)))
    assert heights.is_plane
    assert heights.name == "of Quarry north height"
    frame = LocalFrame(wkt, (5000.0, 1000.0, 0.0), "tangent", heights)
    points = np.column_stack([turned(transverse_mercator(place, at)), lowered(place, height, at)])
    assert np.abs(points[:, 2] + frame.geoid_height_m(points) - height).max() < 1e-7
    flat = local_grid("flat", "EPSG:4326", at, SIMILARITY, None, UNITS["m"])
    assert vertical_of(flat) is None
    assert CRS.from_wkt(flat).to_wkt("WKT1_GDAL").startswith("PROJCS")
    # the point scale of a similarity of a map with scale 1 in the middle
    assert frame.grid_scale(np.array([5000.0, 1000.0, 0.0])) == pytest.approx(1.00012, abs=1e-9)
