from datetime import datetime, timedelta, timezone

import numpy as np
import pytest
from pyproj import CRS, Geod
from scipy.cluster.hierarchy import fcluster, linkage

from photogram.errors import FrameError
from photogram.project.draft.sites import (
    Exposure,
    gap_between_sites_m,
    group_sites,
    local_metres,
    middle_of,
    separate_flights,
    utm_crs,
)

NOON = datetime(2024, 5, 1, 12, 0, 0)


def grid(columns: int, rows: int, spacing_m: float, centre_m: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    east, north = np.meshgrid(np.arange(columns) * spacing_m, np.arange(rows) * spacing_m)
    return np.column_stack([east.ravel(), north.ravel()]) + centre_m


def test_sites_are_the_single_linkage_clusters() -> None:
    rng = np.random.default_rng(3)
    position_m = np.concatenate(
        [rng.normal(c, 300.0, (n, 2)) for c, n in (((0, 0), 40), ((4000, 0), 60), ((0, 9000), 7))]
    )
    shuffled = rng.permutation(len(position_m))
    labels = group_sites(position_m[shuffled], 1000.0)
    reference = fcluster(linkage(position_m[shuffled], "single"), 1000.0, "distance")
    for label in np.unique(labels):
        assert len(set(reference[labels == label])) == 1
    assert np.bincount(labels).tolist() == [60, 40, 7]


def test_sites_are_numbered_by_size_then_by_order() -> None:
    position_m = np.array([[0.0, 0.0], [9e3, 0.0], [9e3, 10.0], [5e4, 0.0], [5e4, 10.0]])
    assert group_sites(position_m, 500.0).tolist() == [2, 0, 0, 1, 1]


@pytest.mark.parametrize(("distance_m", "sites"), [(430.0, 1), (570.0, 2)])
def test_gap_between_sites_is_kept_within_a_tenth_or_so(distance_m: float, sites: int) -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        angle = rng.uniform(0, 2 * np.pi)
        step = distance_m * np.array([np.cos(angle), np.sin(angle)])
        position_m = rng.uniform(-1e4, 1e4, 2) + np.array([np.zeros(2), step])
        assert len(set(group_sites(position_m, 500.0).tolist())) == sites


@pytest.mark.parametrize(
    ("position_m", "gap_m"),
    [
        (grid(6, 4, 20.0), 500.0),
        (grid(6, 4, 300.0), 1500.0),
        (grid(3, 3, 40_000.0), 5000.0),
        (np.zeros((1, 2)), 500.0),
        (np.zeros((0, 2)), 500.0),
        (np.zeros((4, 2)), 500.0),
    ],
)
def test_gap_grows_with_the_distance_between_photographs(position_m: np.ndarray, gap_m: float) -> None:
    assert gap_between_sites_m(position_m) == pytest.approx(gap_m)


def test_thousands_of_photographs_are_grouped_quickly() -> None:
    position_m = np.concatenate([grid(100, 80, 5.0), grid(3, 3, 5.0, (3000.0, 0.0))])
    assert np.bincount(group_sites(position_m, gap_between_sites_m(position_m))).tolist() == [8000, 9]


@pytest.mark.parametrize(("longitude", "latitude"), [(8.4, 47.3), (-179.9995, -17.0), (179.9995, 64.0), (0.0, 0.0)])
def test_local_metres_agree_with_geodesics(longitude: float, latitude: float) -> None:
    rng = np.random.default_rng(2)
    lon = (longitude + rng.uniform(-0.01, 0.01, 20) + 180.0) % 360.0 - 180.0
    lat = latitude + rng.uniform(-0.01, 0.01, 20)
    position_m = local_metres(lon, lat)
    _, _, distance_m = Geod(ellps="WGS84").inv(lon[:-1], lat[:-1], lon[1:], lat[1:])
    assert np.hypot(*np.diff(position_m, axis=0).T) == pytest.approx(distance_m, rel=0.01)
    middle = middle_of(lon, lat)
    assert abs((middle[0] - longitude + 180.0) % 360.0 - 180.0) < 0.01
    assert abs(middle[1] - latitude) < 0.01


# ---- flights ---------------------------------------------------------------------------------------------------------


def exposure(minute: float | None, east_m: float | None = 0.0, body: str = "a", name: str = "") -> Exposure:
    time = None if minute is None else NOON + timedelta(minutes=minute)
    return Exposure(name or f"{minute}", body, time, None if east_m is None else (east_m, 0.0))


def test_a_pause_of_more_than_ten_minutes_ends_a_flight() -> None:
    minutes = [0.0, 0.1, 10.0, 20.1, 20.2, 31.0]
    assert separate_flights([exposure(m) for m in minutes], 500.0) == ["1", "1", "1", "2", "2", "3"]


def test_flights_are_told_whatever_the_order_of_the_photographs() -> None:
    minutes = [40.0, 0.1, 41.0, 0.0]
    assert separate_flights([exposure(m) for m in minutes], 500.0) == ["2", "1", "2", "1"]


def test_two_drones_at_once_are_two_flights_by_their_bodies_or_their_places() -> None:
    by_body = [exposure(0.1 * i, 0.0, "ab"[i % 2]) for i in range(10)]
    by_place = [exposure(0.1 * i, 2000.0 * (i % 2) + i) for i in range(10)]
    for exposures in (by_body, by_place):
        assert separate_flights(exposures, 500.0) == ["1", "2"] * 5


def test_photographs_without_a_clock_are_one_flight_or_join_the_one_before() -> None:
    assert separate_flights([exposure(None, name=n) for n in "abc"], 500.0) == ["1"] * 3
    mixed = [exposure(0, name="a"), exposure(60, name="c"), exposure(None, name="b"), exposure(None, name="d")]
    assert separate_flights(mixed, 500.0) == ["1", "2", "1", "2"]


def test_clocks_with_and_without_a_zone_are_compared_by_their_figures() -> None:
    zone = timezone(timedelta(hours=2))
    exposures = [Exposure("a", "x", NOON, None), Exposure("b", "x", NOON.replace(tzinfo=zone), None)]
    assert separate_flights(exposures, 500.0) == ["1", "1"]


# ---- map grid --------------------------------------------------------------------------------------------------------


def test_utm_zones_are_made_for_their_places() -> None:
    rng = np.random.default_rng(4)
    for lon, lat in zip(rng.uniform(-180, 180, 200), rng.uniform(-79, 55, 200), strict=True):
        crs = CRS.from_user_input(utm_crs(float(lon), float(lat)))
        area = crs.area_of_use
        assert area is not None
        assert crs.name.startswith("WGS 84 / UTM zone")
        assert area.west <= lon <= area.east
        assert area.south <= lat <= area.north


@pytest.mark.parametrize(
    ("longitude", "latitude", "code"),
    [
        (12.5, 55.8, 32633),
        (-92.0, 46.8, 32615),
        (-74.2, -10.9, 32718),
        (180.0, 10.0, 32601),
        (-180.0, 10.0, 32601),
        (179.99, 10.0, 32660),
        (5.3, 60.4, 32632),
        (15.6, 78.2, 32633),
        (8.9, 75.0, 32631),
        (9.1, 75.0, 32633),
        (33.1, 80.0, 32637),
    ],
)
def test_utm_zones_that_are_known(longitude: float, latitude: float, code: int) -> None:
    assert utm_crs(longitude, latitude) == f"EPSG:{code}"


@pytest.mark.parametrize("latitude", [-81.0, 85.0])
def test_utm_ends_near_the_poles(latitude: float) -> None:
    with pytest.raises(FrameError, match="--crs"):
        utm_crs(0.0, latitude)
