"""Height systems and geoids: grids written here with a known surface, PROJ's own geocentric chain as the referee."""

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st
from makers import SharedData
from pyproj import CRS, Transformer
from pyproj.transformer import TransformerGroup

from photogram.arrays import FloatArray
from photogram.errors import FrameError
from photogram.files.clouds.points import write_laz
from photogram.files.maps.rasters import read_raster, write_raster
from photogram.geodesy.crs import product_crs, written_crs
from photogram.geodesy.frames import LocalFrame, map_heights
from photogram.geodesy.height_systems import (
    DeclaredHeights,
    Geoid,
    HeightSystem,
    crs_name,
    first_wkt,
    full_crs,
    geoid_height_m,
    is_gnss_ellipsoid,
    vertical_crs,
)
from photogram.survey import PointCloud, Raster

SITE = (602340.0, 5794120.0, 120.0)
UTM = "EPSG:25832"


@pytest.fixture(scope="session")
def grid(sloping_geoid: Any) -> str:
    return str(sloping_geoid.path)


# ---- geoid ---------------------------------------------------------------------------------------------------------


def test_egm96_at_the_places_of_its_readme(shared_data: SharedData) -> None:
    egm96 = str(shared_data("geoid/egm96_15.gtx"))
    places = np.array([[0.0, 0.0], [7.6205, 45.0315]])
    for vertical in (None, "EPSG:5773"):
        for crs in ("EPSG:32632", UTM):
            found = geoid_height_m(CRS(crs), Geoid(vertical, egm96), places)
            np.testing.assert_allclose(found, [17.16, 48.42], rtol=0, atol=0.01)


def test_a_grid_is_read_bilinearly_and_has_an_edge(grid: str, sloping_geoid: Any) -> None:
    rng = np.random.default_rng(1)
    places = np.column_stack([rng.uniform(8.1, 13.9, 200), rng.uniform(50.1, 53.9, 200)])
    found = geoid_height_m(CRS(UTM), Geoid(grid=grid), places)
    np.testing.assert_allclose(found, sloping_geoid.height_m(*places.T), rtol=0, atol=2e-5)
    assert np.isnan(geoid_height_m(CRS(UTM), Geoid(grid=grid), np.array([[20.0, 52.0], [np.nan, 52.0]]))).all()


def test_a_crs_on_another_ellipsoid_reads_the_grid_in_the_datum_of_gnss(grid: str, sloping_geoid: Any) -> None:
    # Bessel's ellipsoid: 100 m and more between its longitudes and those of WGS 84
    potsdam, place = CRS("EPSG:31468"), np.array([[11.0, 52.0]])
    assert not is_gnss_ellipsoid(potsdam)
    expected = sloping_geoid.height_m(
        *Transformer.from_crs("EPSG:4314", "EPSG:4326", always_xy=True).transform(*place[0])
    )
    assert abs(expected - sloping_geoid.height_m(*place[0])) > 1e-3
    np.testing.assert_allclose(geoid_height_m(potsdam, Geoid(grid=grid), place), expected, rtol=0, atol=2e-5)


@pytest.mark.filterwarnings("ignore:Best transformation:UserWarning")
def test_a_missing_grid_is_named_with_what_to_do() -> None:
    target = CRS("EPSG:25832+7837")
    if TransformerGroup(CRS("EPSG:4937"), target, always_xy=True, allow_ballpark=False).transformers:
        pytest.skip("PROJ has the grid of DHHN2016 here")
    with pytest.raises(
        FrameError, match=r"DHHN2016 \(EPSG:7837\): PROJ lacks its grid .*\.tif.*projsync.*heights\.grid"
    ):
        geoid_height_m(CRS(UTM), Geoid("EPSG:7837"), np.array([[10.0, 52.0]]))


def test_what_is_no_geoid_is_refused(tmp_path: Path) -> None:
    for name, words in (
        ("EGM97", "not a geoid known to PROJ"),
        (UTM, "not a vertical CRS"),
        ("EPSG:5715", "upwards"),
    ):
        with pytest.raises(FrameError, match=words):
            vertical_crs(name)
    (tmp_path / "x.gtx").write_text("no grid")
    for path, words in ((tmp_path / "x.gtx", "cannot read it"), (tmp_path / "a,b.gtx", "comma")):
        with pytest.raises(FrameError, match=words):
            geoid_height_m(CRS(UTM), Geoid(grid=str(path)), np.array([[10.0, 52.0]]))
    with pytest.raises(FrameError, match="has no transformation to it from"):  # the Danish zero, in a Swiss map
        geoid_height_m(CRS("EPSG:2056"), Geoid("EPSG:5799"), np.array([[7.4, 46.9]]))


# ---- frame ---------------------------------------------------------------------------------------------------------

offsets = st.tuples(st.floats(-5000.0, 5000.0), st.floats(-5000.0, 5000.0), st.floats(-300.0, 3000.0))


@settings(max_examples=40, deadline=None)
@given(places=st.lists(offsets, min_size=1, max_size=5), kind=st.sampled_from(["tangent", "grid"]))
def test_map_to_world_and_back_over_a_geoid(grid: str, places: list[tuple[float, float, float]], kind: str) -> None:
    frame = LocalFrame(UTM, SITE, "grid" if kind == "grid" else "tangent", Geoid(grid=grid))
    points = np.array(SITE) + np.array(places)
    np.testing.assert_allclose(frame.map_from_world(frame.world_from_map(points)), points, rtol=0, atol=1e-6)


def test_the_world_is_that_of_ellipsoidal_heights(grid: str, sloping_geoid: Any) -> None:
    rng = np.random.default_rng(2)
    points = np.array(SITE) + rng.uniform(-1, 1, (50, 3)) * [4000.0, 4000.0, 200.0]
    world = LocalFrame(UTM, SITE, "tangent", Geoid(grid=grid)).world_from_map(points)
    cart = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=GRS80"
    )
    lon, lat = Transformer.from_crs(UTM, "EPSG:4258", always_xy=True).transform(*points[:, :2].T)
    true = np.column_stack(cart.transform(lon, lat, points[:, 2] + sloping_geoid.at(UTM, points)))
    between = np.linalg.norm(world[:, None] - world, axis=2)
    np.testing.assert_allclose(between, np.linalg.norm(true[:, None] - true, axis=2), rtol=0, atol=1e-4)


def test_axes_and_scale_are_those_without_a_geoid(grid: str) -> None:
    frame, plain = LocalFrame(UTM, SITE, "tangent", Geoid(grid=grid)), LocalFrame(UTM, SITE)
    place = np.array([1500.0, -800.0, 50.0])
    np.testing.assert_allclose(frame.rotation_world_from_map(place), plain.rotation_world_from_map(place), atol=1e-8)
    assert frame.grid_scale(np.array(SITE)) == plain.grid_scale(np.array(SITE))


@pytest.mark.parametrize("kind", ["tangent", "grid"])
def test_beyond_the_grid_there_is_no_height(grid: str, kind: str) -> None:
    frame = LocalFrame(UTM, SITE, "grid" if kind == "grid" else "tangent", Geoid(grid=grid))
    far = np.array([SITE, (602340.0, 6394120.0, 120.0)])  # 57.7° north
    with pytest.raises(FrameError, match=r"lies outside the grid of geoid slope\.gtx"):
        frame.world_from_map(far)
    world = LocalFrame(UTM, SITE, frame.kind).world_from_map(far)
    assert np.isfinite(frame.map_from_world(world)[:, 2]).tolist() == [True, False]


def test_heights_are_brought_to_those_of_the_map(grid: str, sloping_geoid: Any) -> None:
    points, geoid = np.array([SITE, (610000.0, 5800000.0, 30.0)]), Geoid(grid=grid)
    n = sloping_geoid.at(UTM, points)
    cases: dict[tuple[HeightSystem | None, HeightSystem | None], FloatArray] = {
        ("ellipsoidal", "orthometric"): n, ("orthometric", "ellipsoidal"): -n, ("orthometric", "orthometric"): 0 * n,
        ("ellipsoidal", "ellipsoidal"): 0 * n, (None, "orthometric"): 0 * n, ("ellipsoidal", None): 0 * n,
    }  # fmt: skip
    for (output, given_as), raised in cases.items():
        moved = map_heights(UTM, DeclaredHeights(output, geoid=geoid), given_as, points)
        np.testing.assert_allclose(moved - points, np.column_stack([0 * n, 0 * n, raised]), rtol=0, atol=2e-5)


# ---- products ------------------------------------------------------------------------------------------------------

SYSTEMS = {
    "not declared": (DeclaredHeights(), None),
    "ellipsoidal": (DeclaredHeights("ellipsoidal"), "ellipsoid"),
    "DVR90": (DeclaredHeights("orthometric", geoid=Geoid("EPSG:5799")), "DVR90 height"),
    "EGM96": (DeclaredHeights("orthometric", geoid=Geoid("EPSG:5773")), "EGM96 height"),
    "a grid": (DeclaredHeights("orthometric", geoid=Geoid(grid="/nowhere/slope.gtx")), "height above geoid slope.gtx"),
}
systems = pytest.mark.parametrize("system", SYSTEMS)
grids = pytest.mark.parametrize("crs", [UTM, "EPSG:32633", "+proj=utm +zone=32 +ellps=GRS80 +units=m"])


@systems
@grids
def test_geotiff_says_what_its_heights_are(tmp_path: Path, system: str, crs: str) -> None:
    heights, name = SYSTEMS[system]
    raster = Raster(np.zeros((3, 4), dtype=np.float32), 5e5, 6e6, 1.0)
    write_raster(tmp_path / "dsm.tif", raster, product_crs(crs, heights))
    with rasterio.open(tmp_path / "dsm.tif") as dataset:
        found = CRS.from_wkt(dataset.crs.to_wkt(version="WKT2_2019"))
    assert [p.name for p in tmp_path.iterdir()] == ["dsm.tif"]  # all of it within the file
    assert (
        found.to_2d().equals(CRS(crs), ignore_axis_order=True) or found.sub_crs_list[0].to_epsg() == CRS(crs).to_epsg()
    )
    if name is None:
        assert len(found.axis_info) == 2
    else:
        coded = crs.startswith("EPSG:")
        assert found.is_compound == (heights.output == "orthometric" or not coded)
        if found.is_compound:
            assert name in found.sub_crs_list[1].name
        else:
            assert found.axis_info[2].name.lower().startswith(name)
        assert found.axis_info[2].direction == "up"
        assert found.axis_info[2].unit_name == "metre"
    back, crs_again = read_raster(tmp_path / "dsm.tif")
    write_raster(tmp_path / "again.tif", back, crs_again)
    assert read_raster(tmp_path / "again.tif")[1] == crs_again


@systems
@grids
def test_laz_says_what_its_heights_are(tmp_path: Path, system: str, crs: str) -> None:
    heights, name = SYSTEMS[system]
    write_laz(tmp_path / "cloud.laz", PointCloud(np.array([SITE])), product_crs(crs, heights))
    with laspy.open(tmp_path / "cloud.laz") as reader:
        found = reader.header.parse_crs()
    assert found is not None
    assert len(found.axis_info) == (2 if name is None else 3)
    assert found.equals(written_crs(product_crs(crs, heights)), ignore_axis_order=True)
    if name is not None and heights.output == "orthometric":
        assert found.sub_crs_list[1].name == name
    elif name is not None:
        assert found.axis_info[2].name.lower().startswith("ellipsoidal height")


@systems
def test_names_of_crs_are_read_back_to_the_same(system: str) -> None:
    heights, _ = SYSTEMS[system]
    crs = full_crs(CRS(UTM), heights.output, heights.geoid)
    assert CRS.from_user_input(crs_name(crs)) == crs
    assert CRS.from_wkt(first_wkt(crs)).equals(crs, ignore_axis_order=True)


def test_known_codes_stay_codes() -> None:
    assert product_crs(UTM, SYSTEMS["DVR90"][0]) == "EPSG:7416"
    assert product_crs(UTM, SYSTEMS["EGM96"][0]) == "EPSG:25832+5773"
    assert product_crs(UTM, DeclaredHeights()) == UTM


def test_heights_of_a_grid_in_feet_that_is_bound_to_another_datum_are_in_feet() -> None:
    crs = "+proj=utm +zone=32 +ellps=GRS80 +towgs84=1,2,3 +units=us-ft +type=crs"
    full = CRS.from_user_input(product_crs(crs, DeclaredHeights("ellipsoidal")))
    assert [axis.unit_name for axis in full.axis_info] == ["US survey foot"] * 3


def test_a_geoid_whose_network_counts_feet(sloping_geoid: Any) -> None:
    """The CRS names the network and its unit, the file gives its heights, in metres as all such files."""
    crs = "+proj=utm +zone=32 +ellps=GRS80 +units=us-ft +type=crs"
    frame = LocalFrame(crs, (600_000.0, 5_790_000.0, 0.0), "tangent", Geoid("EPSG:6360", sloping_geoid.path))
    assert frame.units.height == frame.units.plan == "US survey foot"
    points = np.array([[600_100.0, 5_790_100.0, 25.0], [600_900.0, 5_789_500.0, 60.0]])
    expected = sloping_geoid.at("EPSG:25832", points)
    np.testing.assert_allclose(frame.geoid_height_m(points), expected, rtol=0, atol=1e-4)
    np.testing.assert_allclose(frame.map_from_world(frame.world_from_map(points)), points, rtol=0, atol=1e-6)
    np.testing.assert_allclose(frame.unit_from_map(points) * (1200.0 / 3937.0), points, rtol=1e-12)
