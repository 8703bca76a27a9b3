import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import CRS, Proj, Transformer

from photogram.errors import FrameError
from photogram.geodesy.crs import projected_crs
from photogram.geodesy.frames import (
    LocalFrame,
    geocentric_from_geodetic,
    geocentric_from_topocentric,
    geodetic_from_geocentric,
    geodetic_from_map,
    geodetic_from_topocentric,
    map_from_geodetic,
    topocentric_from_geodetic,
)

SITES = {
    "EPSG:25832": (719950.0, 6191960.0, 80.0),
    "EPSG:32615": (268000.0, 4750000.0, 320.0),
    "EPSG:2056": (2683000.0, 1248000.0, 1900.0),
    "EPSG:31370": (150000.0, 170000.0, 60.0),
    "EPSG:32733": (262000.0, 6243000.0, 40.0),
    "EPSG:27561": (1000000.0, 112400.0, 140.0),  # its geographic CRS counts grads from Paris
}
sites = pytest.mark.parametrize("crs", SITES)
offsets = st.tuples(st.floats(-5000.0, 5000.0), st.floats(-5000.0, 5000.0), st.floats(-300.0, 3000.0))


def units_per_degree(crs: str) -> float:
    """How many of the units of its geographic CRS are a degree."""
    geodetic = CRS(crs).geodetic_crs
    assert geodetic is not None
    return float(np.deg2rad(1.0) / geodetic.axis_info[0].unit_conversion_factor)


def geocentric(crs: str, points_map_m: np.ndarray) -> np.ndarray:
    """Geocentric coordinates (N, 3) of map points, by PROJ alone: the independent truth of all distances."""
    geodetic = CRS(crs).geodetic_crs
    assert geodetic is not None
    assert geodetic.ellipsoid is not None
    lon, lat = Transformer.from_crs(crs, geodetic, always_xy=True).transform(points_map_m[:, 0], points_map_m[:, 1])
    lon, lat = lon / units_per_degree(crs), lat / units_per_degree(crs)
    a, b = geodetic.ellipsoid.semi_major_metre, geodetic.ellipsoid.semi_minor_metre
    degrees = "+step +proj=unitconvert +xy_in=deg +xy_out=rad"
    cart = Transformer.from_pipeline(f"+proj=pipeline {degrees} +step +proj=cart +a={a} +b={b}")
    return np.column_stack(cart.transform(lon, lat, points_map_m[:, 2]))


def scattered(crs: str, count: int, reach_m: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.array(SITES[crs]) + rng.uniform(-1, 1, (count, 3)) * [reach_m, reach_m, 0.1 * reach_m]


def distances(points: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(points[:, None] - points[None], axis=2))


@settings(max_examples=60, deadline=None)
@given(
    crs=st.sampled_from(sorted(SITES)),
    places=st.lists(offsets, min_size=1, max_size=5),
    kind=st.sampled_from(["tangent", "grid"]),
)
def test_map_to_world_and_back(crs: str, places: list[tuple[float, float, float]], kind: str) -> None:
    frame = LocalFrame(crs, SITES[crs], "grid" if kind == "grid" else "tangent")
    points = np.array(SITES[crs]) + np.array(places)
    np.testing.assert_allclose(frame.map_from_world(frame.world_from_map(points)), points, rtol=0, atol=1e-6)


@sites
def test_distances_in_the_world_are_true_lengths(crs: str) -> None:
    points = scattered(crs, 25, 4000.0)
    world = LocalFrame(crs, SITES[crs]).world_from_map(points)
    np.testing.assert_allclose(distances(world), distances(geocentric(crs, points)), rtol=0, atol=1e-6)


@sites
def test_axes_at_the_origin_are_true_east_north_and_up(crs: str) -> None:
    frame = LocalFrame(crs, SITES[crs])
    np.testing.assert_allclose(frame.world_from_map(np.array([SITES[crs]])), np.zeros((1, 3)), atol=1e-6)
    lon, lat, height = geodetic_from_map_datum(crs, np.array(SITES[crs]))
    step = 1e-6
    to_map = Transformer.from_crs(CRS(crs).geodetic_crs, crs, always_xy=True)
    for axis, moved in enumerate([(lon + step, lat, height), (lon, lat + step, height), (lon, lat, height + 1.0)]):
        unit = units_per_degree(crs)
        easting, northing = to_map.transform(unit * moved[0], unit * moved[1])
        world = frame.world_from_map(np.array([[easting, northing, moved[2]]]))[0]
        np.testing.assert_allclose(world / np.linalg.norm(world), np.eye(3)[axis], atol=1e-5)


def geodetic_from_map_datum(crs: str, point_map_m: np.ndarray) -> tuple[float, float, float]:
    lon, lat = Transformer.from_crs(crs, CRS(crs).geodetic_crs, always_xy=True).transform(
        point_map_m[0], point_map_m[1]
    )
    return float(lon) / units_per_degree(crs), float(lat) / units_per_degree(crs), float(point_map_m[2])


@sites
def test_the_scale_factor_and_the_height_explain_the_difference_between_map_and_world(crs: str) -> None:
    frame = LocalFrame(crs, SITES[crs])
    ellipsoid = CRS(crs).ellipsoid
    assert ellipsoid is not None
    _, lat, height = geodetic_from_map_datum(crs, np.array(SITES[crs]))
    a, e2 = ellipsoid.semi_major_metre, 1 - (ellipsoid.semi_minor_metre / ellipsoid.semi_major_metre) ** 2
    s2 = np.sin(np.deg2rad(lat)) ** 2
    meridian, vertical = a * (1 - e2) / (1 - e2 * s2) ** 1.5, a / (1 - e2 * s2) ** 0.5
    east, north = np.array([[50.0, 0, 0], [-50.0, 0, 0]]), np.array([[0, 50.0, 0], [0, -50.0, 0]])
    for ends in (east, north):
        world = frame.world_from_map(np.array(SITES[crs]) + ends)
        ratio = 100.0 / np.linalg.norm(world[0] - world[1])
        # Heights stretch lengths by 1 + h / R; the two radii of curvature, 0.7 % apart at most, bound the ratio.
        low, high = sorted((1 + height / meridian, 1 + height / vertical))
        scale = frame.grid_scale(np.array(SITES[crs]))
        assert scale / high - 1e-8 < ratio < scale / low + 1e-8


def test_a_map_whose_geographic_crs_counts_grads_is_as_its_twin_in_degrees() -> None:
    """NTF (Paris) / Lambert Nord France is Lambert I of the same datum, whose PROJ string counts degrees."""
    twin = (
        "+proj=lcc +lat_1=49.5 +lat_0=49.5 +lon_0=0 +k_0=0.999877341 +x_0=600000 +y_0=200000 +a=6378249.2 "
        "+b=6356515 +pm=paris +units=m"
    )
    place = np.array([600000.0, 200000.0, 100.0])
    points = place + np.random.default_rng(0).uniform(-2000.0, 2000.0, (20, 3))
    worlds = [LocalFrame(crs, (600000.0, 200000.0, 100.0)).world_from_map(points) for crs in ("EPSG:27561", twin)]
    np.testing.assert_allclose(worlds[0], worlds[1], rtol=0, atol=1e-5)
    # a metre of this map, hardly reduced, is a metre on the ground: not 0.9 or 1.1 of one
    np.testing.assert_allclose(distances(worlds[0]), distances(points), rtol=5e-4)


def test_the_scale_of_utm_is_known_at_its_central_meridian() -> None:
    frame = LocalFrame("EPSG:25832", (500000.0, 5800000.0, 0.0))
    assert frame.grid_scale(np.array([500000.0, 5800000.0, 0.0])) == pytest.approx(0.9996, abs=1e-9)
    assert frame.grid_scale(np.array([680000.0, 5800000.0, 0.0])) == pytest.approx(1.0, abs=1e-5)


@sites
def test_map_axes_turn_by_the_meridian_convergence(crs: str) -> None:
    frame = LocalFrame(crs, SITES[crs])
    rotation = frame.rotation_world_from_map(np.zeros(3))
    lon, lat, _ = geodetic_from_map_datum(crs, np.array(SITES[crs]))
    # Positive convergence: grid north lies east of true north.
    gamma = np.deg2rad(Proj(crs).get_factors(lon, lat).meridian_convergence)
    c, s = np.cos(gamma), np.sin(gamma)
    expected = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(np.linalg.norm(rotation, axis=0), 1.0, atol=1e-12)
    np.testing.assert_allclose(rotation, expected, atol=2e-7)


@sites
def test_map_axes_away_from_the_origin_are_those_of_a_frame_there(crs: str) -> None:
    frame = LocalFrame(crs, SITES[crs])
    origin, up_100_m = np.array(SITES[crs]), np.array([0.0, 0.0, 100.0])
    there = origin + np.array([3000.0, -2000.0, 50.0])
    position = frame.world_from_map(there[None])[0]
    rotation = frame.rotation_world_from_map(position)
    up = geocentric(crs, np.array([there, there + up_100_m, origin, origin + up_100_m]))
    tilt = np.arccos((up[1] - up[0]) @ (up[3] - up[2]) / 1e4)
    assert np.arccos(rotation[2, 2]) == pytest.approx(tilt, abs=1e-6)
    ends = frame.world_from_map(there + np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    np.testing.assert_allclose((ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0]), rotation[:, 1], atol=1e-6)


@sites
def test_a_grid_frame_is_the_map_less_its_origin(crs: str) -> None:
    frame = LocalFrame(crs, SITES[crs], "grid")
    points = scattered(crs, 10, 2000.0)
    np.testing.assert_array_equal(frame.world_from_map(points), points - np.array(SITES[crs]))
    np.testing.assert_array_equal(frame.rotation_world_from_map(np.array([5.0, 6.0, 7.0])), np.eye(3))
    lon, lat, _ = geodetic_from_map_datum(crs, np.array(SITES[crs]))
    gamma = np.deg2rad(Proj(crs).get_factors(lon, lat).meridian_convergence)
    true_north_in_grid = frame.rotation_world_from_true(np.zeros(3)) @ [0.0, 1.0, 0.0]
    np.testing.assert_allclose(true_north_in_grid, [-np.sin(gamma), np.cos(gamma), 0.0], atol=2e-7)
    np.testing.assert_array_equal(LocalFrame(crs, SITES[crs]).rotation_world_from_true(np.zeros(3)), np.eye(3))


def test_no_points_and_unknown_points_pass_through() -> None:
    for kind in ("tangent", "grid"):
        frame = LocalFrame("EPSG:25832", SITES["EPSG:25832"], "grid" if kind == "grid" else "tangent")
        assert frame.world_from_map(np.zeros((0, 3))).shape == (0, 3)
        assert frame.map_from_world(np.zeros((0, 3))).shape == (0, 3)
        some = frame.map_from_world(np.array([[np.nan, 0.0, 0.0], [10.0, 20.0, 30.0]]))
        assert np.isnan(some[0]).any()
        assert np.isfinite(some[1]).all()


def test_a_frame_near_points_has_a_round_origin_at_their_centre() -> None:
    frame = LocalFrame.near("EPSG:25832", np.array([[719900.0, 6191900.0, 60.0], [719990.0, 6192011.0, 125.0]]))
    assert frame == LocalFrame("EPSG:25832", (719940.0, 6191960.0, 90.0))


@sites
def test_geodetic_coordinates_agree_with_proj_and_come_back(crs: str) -> None:
    points = scattered(crs, 8, 1000.0)
    geodetic = geodetic_from_map(crs, points)
    lon, lat = Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(points[:, 0], points[:, 1])
    np.testing.assert_array_equal(geodetic, np.column_stack([lon, lat, points[:, 2]]))
    # A datum shift by the small-angle Helmert formula and its published inverse part by about a millimetre (EPSG:2056).
    np.testing.assert_allclose(map_from_geodetic(crs, geodetic), points, rtol=0, atol=2e-3)


def _geocentric(geodetic: np.ndarray) -> np.ndarray:
    """Geocentric coordinates in closed form (Hofmann-Wellenhof, Lichtenegger & Wasle 2008, eq. 8.5)."""
    flattening = 1 / 298.257223563
    e2 = flattening * (2 - flattening)
    lon, lat = np.radians(geodetic[:, :2].T)
    h = geodetic[:, 2]
    N = 6378137.0 / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    level = (N + h) * np.cos(lat)
    return np.column_stack([level * np.cos(lon), level * np.sin(lon), (N * (1 - e2) + h) * np.sin(lat)])


@pytest.mark.parametrize(
    "origin", [(50.1, 8.7, 120.0), (-33.9, 151.2, -30.0), (0.0, -180.0, 0.0), (89.9, 45.0, 3000.0)]
)
def test_east_north_and_up_at_an_origin_follow_their_formula_and_come_back(origin: tuple[float, float, float]) -> None:
    enu = np.random.default_rng(4).normal(0.0, [3000.0, 3000.0, 300.0], (200, 3))
    lat, lon = np.radians(origin[:2])
    s, c, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    axes = np.array([[-sl, cl, 0.0], [-s * cl, -s * sl, c], [c * cl, c * sl, s]])
    place = np.array([[origin[1], origin[0], origin[2]]])
    expected = enu @ axes + _geocentric(place)
    geodetic = geodetic_from_topocentric(origin, enu)
    np.testing.assert_allclose(geocentric_from_topocentric(origin, enu), expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(_geocentric(geodetic), expected, rtol=0, atol=2e-8)
    np.testing.assert_allclose(geocentric_from_geodetic(geodetic), expected, rtol=0, atol=2e-8)
    np.testing.assert_allclose(_geocentric(geodetic_from_geocentric(expected)), expected, rtol=0, atol=2e-8)
    np.testing.assert_allclose(topocentric_from_geodetic(origin, geodetic), enu, rtol=0, atol=2e-8)


def test_a_known_place_lands_where_its_grid_says() -> None:
    # The intersection of the central meridian of zone 32 with the equator is 500 km east, 0 km north by definition.
    np.testing.assert_allclose(
        map_from_geodetic("EPSG:32632", np.array([[9.0, 0.0, 12.5]])), [[500000.0, 0.0, 12.5]], atol=1e-6
    )


def test_a_compound_crs_counts_by_its_horizontal_part() -> None:
    assert projected_crs("EPSG:5555").to_epsg() == 25832
    points = scattered("EPSG:25832", 5, 500.0)
    compound, plain = (LocalFrame(crs, SITES["EPSG:25832"]) for crs in ("EPSG:5555", "EPSG:25832"))
    np.testing.assert_array_equal(compound.world_from_map(points), plain.world_from_map(points))


@pytest.mark.parametrize(
    ("crs", "says"),
    [
        ("EPSG:4326", "is not a projected CRS: choose a map grid, for example"),
        ("EPSG:4979", "is not a projected CRS"),
        ("EPSG:24571", "is in British chain"),
        ("EPSG:999999", "'EPSG:999999': not a CRS known to PROJ"),
        ("UTM zone 32", "'UTM zone 32': not a CRS known to PROJ"),
    ],
)
def test_unfit_reference_systems_are_refused(crs: str, says: str) -> None:
    with pytest.raises(FrameError, match=says):
        projected_crs(crs)
    with pytest.raises(FrameError, match=says):
        LocalFrame.near(crs, np.zeros((1, 3)))


def test_positions_outside_the_crs_are_named() -> None:
    frame = LocalFrame("EPSG:25832", SITES["EPSG:25832"])
    centimetres = np.array([SITES["EPSG:25832"], (71995747.88, 619196955.5, 124.5)])
    with pytest.raises(
        FrameError, match=r"easting 71995747\.88, northing 619196955\.50 lies outside EPSG:25832: check"
    ):
        frame.world_from_map(centimetres)
    with pytest.raises(FrameError, match="outside EPSG:25832"):
        LocalFrame.near("EPSG:25832", centimetres[1:])
    with pytest.raises(FrameError, match="is not defined at longitude"):
        map_from_geodetic("EPSG:25832", np.array([[np.inf, 48.0, 0.0]]))
