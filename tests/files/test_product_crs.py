"""The CRS of rasters with ellipsoidal heights, as rasterio, GDAL and PROJ read it; units, descriptions and colours."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
import rasterio.shutil
import rasterio.warp
from pyproj.crs import ProjectedCRS
from pyproj.crs.coordinate_operation import TransverseMercatorConversion
from rio_cogeo import cog_validate

from photogram.files.maps.cogs import CATEGORY_SUFFIX, Category, write_cog, write_cog_codes, write_cog_rgba
from photogram.files.maps.geo_keys import drop_vertical_keys, has_vertical_keys, set_vertical_key
from photogram.files.maps.rasters import picture_on_grid, read_raster
from photogram.geodesy.crs import height_system_of, plan_of, product_crs
from photogram.geodesy.height_systems import DeclaredHeights, Geoid
from photogram.grid import MapGrid, Window
from photogram.local_grids.calibration import HeightFit, PlaneSimilarity
from photogram.local_grids.definition import UNITS, local_grid
from photogram.local_grids.tested_fit import fit

LOCAL = ProjectedCRS(TransverseMercatorConversion(50.0, 9.0), "grid of the site", geodetic_crs="EPSG:4258").to_wkt()
PLACES = {
    "EPSG:25832": (602_300.0, 5_794_140.0),
    "EPSG:32632": (602_300.0, 5_794_140.0),
    "EPSG:28356": (334_000.0, 6_252_000.0),
    "EPSG:7856": (334_000.0, 6_252_000.0),
    "EPSG:6339": (550_000.0, 4_180_000.0),
    "EPSG:2193": (1_749_000.0, 5_428_000.0),
}


def grid_at(place: tuple[float, float]) -> MapGrid:
    return MapGrid(place[0], place[1], 0.5, 300, 280)


def write(path: Path, crs: str, place: tuple[float, float]) -> None:
    grid = grid_at(place)
    write_cog(path, grid, crs, [(grid.whole, np.full((grid.rows, grid.columns), 100.0, np.float32))], True, "height")


@pytest.mark.parametrize("plan", PLACES)
def test_ellipsoidal_heights_are_a_third_axis_that_leads_to_the_globe(tmp_path: Path, plan: str) -> None:
    path, (easting, northing) = tmp_path / "dsm.tif", PLACES[plan]
    crs = product_crs(plan, DeclaredHeights(output="ellipsoidal"))
    write(path, crs, (easting, northing))
    assert list(tmp_path.iterdir()) == [path], "nothing stands in a file beside"
    assert cog_validate(path, strict=True) == (True, [], [])
    with rasterio.open(path) as dataset:
        written = dataset.crs
        assert dataset.read(1).max() == 100.0
    found = pyproj.CRS.from_wkt(written.to_wkt(version="WKT2_2019"))
    assert not found.is_compound
    assert [axis.direction for axis in found.axis_info][-1] == "up"
    expected = pyproj.Transformer.from_crs(pyproj.CRS(plan).to_3d(), "EPSG:4979", always_xy=True)
    longitude, latitude, height = expected.transform(easting, northing, 100.0)
    of_proj = pyproj.Transformer.from_crs(found, "EPSG:4979", always_xy=True).transform(easting, northing, 100.0)
    xs, ys, zs = rasterio.warp.transform(written, "EPSG:4979", [easting], [northing], [100.0])
    for lon, lat, h in (of_proj, (xs[0], ys[0], zs[0])):
        assert abs(h - height) < 1e-3
        assert abs(lon - longitude) * 111_320 < 1e-3
        assert abs(lat - latitude) * 111_320 < 1e-3
    back = pyproj.Transformer.from_crs("EPSG:4979", found, always_xy=True).transform(*of_proj)
    assert np.abs(np.array(back) - [easting, northing, 100.0]).max() < 1e-3
    _, name = read_raster(path)
    assert height_system_of(name) == ("ellipsoidal", None)


def test_orthometric_heights_stay_compound(tmp_path: Path) -> None:
    heights = DeclaredHeights(output="orthometric", geoid=Geoid("EPSG:5799"))
    write(tmp_path / "dsm.tif", product_crs("EPSG:25832", heights), PLACES["EPSG:25832"])
    with rasterio.open(tmp_path / "dsm.tif") as dataset:
        found = pyproj.CRS.from_wkt(dataset.crs.to_wkt(version="WKT2_2019"))
    assert found.sub_crs_list[1].name == "DVR90 height"


@pytest.mark.parametrize("plan", ["EPSG:25832", "EPSG:2193"])
@pytest.mark.parametrize("vertical", [None, "ellipsoidal", "EPSG:5773", "EPSG:5799", "EPSG:7839"])
def test_the_code_of_the_plan_and_that_of_the_heights_can_be_told(
    tmp_path: Path, plan: str, vertical: str | None
) -> None:
    """EPSG:25832+5799 has a code of its own, EPSG:7416; EPSG:2193 names its northing first, which no raster does."""
    heights = DeclaredHeights()
    if vertical == "ellipsoidal":
        heights = DeclaredHeights(output="ellipsoidal")
    elif vertical is not None:
        heights = DeclaredHeights(output="orthometric", geoid=Geoid(vertical))
    write(tmp_path / "dsm.tif", product_crs(plan, heights), PLACES[plan])
    with rasterio.open(tmp_path / "dsm.tif") as dataset:
        found = pyproj.CRS(dataset.crs)
        corner = dataset.transform.c, dataset.transform.f
    assert corner == PLACES[plan], "easting, northing"
    assert f"EPSG:{found.to_2d().to_epsg()}" == plan
    if vertical is not None and vertical.startswith("EPSG"):
        assert [f"EPSG:{part.to_epsg()}" for part in found.sub_crs_list] == [plan, vertical]
    assert plan_of(product_crs(plan, heights)) == plan


def test_a_map_without_a_code_keeps_a_vertical_crs_that_says_ellipsoidal(tmp_path: Path) -> None:
    for plan, name in ((LOCAL, "GRS 1980"), ("+proj=tmerc +lat_0=50 +lon_0=9 +datum=WGS84 +units=m", "WGS 84")):
        write(tmp_path / "dsm.tif", product_crs(plan, DeclaredHeights(output="ellipsoidal")), (0.0, 0.0))
        with rasterio.open(tmp_path / "dsm.tif") as dataset:
            found = pyproj.CRS.from_wkt(dataset.crs.to_wkt(version="WKT2_2019"))
        assert found.sub_crs_list[1].name == f"ellipsoidal height ({name})"


def test_a_file_without_the_key_is_named(tmp_path: Path) -> None:
    write(tmp_path / "dsm.tif", "EPSG:25832", PLACES["EPSG:25832"])
    with pytest.raises(OSError, match="no vertical geo key"):
        set_vertical_key(tmp_path / "dsm.tif", 4937)


@pytest.mark.parametrize("big", ["YES", "NO"])
@pytest.mark.parametrize("endianness", ["LITTLE", "BIG"])
def test_the_key_is_found_in_every_kind_of_tiff(tmp_path: Path, big: str, endianness: str) -> None:
    path = tmp_path / "dsm.tif"
    compound = rasterio.crs.CRS.from_wkt(pyproj.CRS("EPSG:25832+5773").to_wkt())
    shape = {"width": 16, "height": 16, "count": 1, "dtype": "uint8", "transform": rasterio.Affine(1, 0, 5, 0, -1, 9)}
    with rasterio.open(path, "w", driver="GTiff", crs=compound, bigtiff=big, endianness=endianness, **shape) as dataset:
        dataset.write(np.ones((1, 16, 16), np.uint8))
    set_vertical_key(path, 4937)
    with rasterio.open(path) as dataset:
        found = pyproj.CRS.from_wkt(dataset.crs.to_wkt(version="WKT2_2019"))
    assert (found.is_compound, len(found.axis_info)) == (False, 3)


@pytest.mark.parametrize("heights", [None, "ellipsoidal", "EPSG:5773"])
def test_a_raster_is_brought_to_the_map_grid_alone_and_stays_as_it_is(tmp_path: Path, heights: str | None) -> None:
    declared = {
        None: DeclaredHeights(),
        "ellipsoidal": DeclaredHeights(output="ellipsoidal"),
        "EPSG:5773": DeclaredHeights(output="orthometric", geoid=Geoid("EPSG:5773")),
    }[heights]
    path = tmp_path / "dsm.tif"
    write(path, product_crs("EPSG:25832", declared), (600_000.0, 5_800_000.0))
    with rasterio.open(path) as raster:
        before = raster.read(), raster.transform, raster.overviews(1)
    assert has_vertical_keys(path) == (heights is not None)
    drop_vertical_keys(path)
    assert not has_vertical_keys(path)
    with rasterio.open(path) as raster:
        assert raster.crs.to_epsg() == 25832
        assert np.array_equal(raster.read(), before[0])
        assert (raster.transform, raster.overviews(1)) == before[1:]
    assert cog_validate(path)[0]


def test_bands_have_units_and_descriptions(tmp_path: Path) -> None:
    grid = grid_at(PLACES["EPSG:25832"])
    for crs in ("EPSG:25832", "EPSG:25832+5799", product_crs("EPSG:25832", DeclaredHeights(output="ellipsoidal"))):
        write(tmp_path / "dsm.tif", crs, PLACES["EPSG:25832"])
        with rasterio.open(tmp_path / "dsm.tif") as dataset:
            assert (dataset.units, dataset.descriptions) == (("m",), ("height",))
    picture = np.full((grid.rows, grid.columns, 4), 255, np.uint8)
    write_cog_rgba(tmp_path / "picture.tif", grid, "EPSG:25832", [(grid.whole, picture)])
    with rasterio.open(tmp_path / "picture.tif") as dataset:
        assert dataset.descriptions == ("red", "green", "blue", "alpha")


def test_codes_have_colours_and_names(tmp_path: Path) -> None:
    grid, path = grid_at(PLACES["EPSG:25832"]), tmp_path / "source.tif"
    codes = (np.arange(grid.rows * grid.columns) % 3).reshape(grid.rows, grid.columns).astype(np.uint8)
    kinds = (Category(0, "hole", (255, 255, 255)), Category(2, "filled", (230, 120, 20)))
    write_cog_codes(path, grid, "EPSG:25832", [(grid.whole, codes)], categories=kinds)
    assert cog_validate(path, strict=True) == (True, [], [])
    assert {p.name for p in tmp_path.iterdir()} == {path.name, path.name + CATEGORY_SUFFIX}
    with rasterio.open(path) as dataset:
        colours = dataset.colormap(1)
        assert (colours[0], colours[2]) == ((255, 255, 255, 255), (230, 120, 20, 255))
        assert dataset.descriptions == ("0 hole, 2 filled",)
        np.testing.assert_array_equal(dataset.read(1), codes)
    rasterio.shutil.copy(path, tmp_path / "view.vrt", driver="VRT")  # GDAL copies what it has read of the names
    text = (tmp_path / "view.vrt").read_text(encoding="utf-8")
    assert "<Category>hole</Category>" in text
    assert "<Category>filled</Category>" in text


# ---- feet ------------------------------------------------------------------------------------------------------------

US_FOOT = 1200.0 / 3937.0


@pytest.mark.parametrize(
    ("crs", "heights", "unit_m"),
    [
        ("EPSG:2263", DeclaredHeights("ellipsoidal"), US_FOOT),
        ("EPSG:2222", DeclaredHeights("ellipsoidal"), 0.3048),
        ("EPSG:2263+6360", DeclaredHeights("orthometric", geoid=Geoid("EPSG:6360")), US_FOOT),
        ("EPSG:2222+8228", DeclaredHeights("orthometric", geoid=Geoid("EPSG:8228")), 0.3048),
        ("EPSG:26918+6360", DeclaredHeights("orthometric", geoid=Geoid("EPSG:6360")), US_FOOT),
        ("EPSG:2263+5703", DeclaredHeights("orthometric", geoid=Geoid("EPSG:5703")), 1.0),
    ],
)
def test_a_raster_in_feet_is_read_back_in_metres(
    tmp_path: Path, crs: str, heights: DeclaredHeights, unit_m: float
) -> None:
    path, grid = tmp_path / "dsm.tif", MapGrid(300_000.0, 60_000.0, 0.5, 40, 50)
    values = np.random.default_rng(0).uniform(10.0, 90.0, (40, 50)).astype(np.float32)
    values[3, 4] = np.nan
    write_cog(path, grid, product_crs(crs, heights), [(grid.whole, values)])
    assert list(tmp_path.iterdir()) == [path]
    plan_m = 1.0 if crs.startswith("EPSG:26918") else US_FOOT if crs.startswith("EPSG:2263") else 0.3048
    with rasterio.open(path) as dataset:
        assert dataset.transform.a * plan_m == pytest.approx(0.5, rel=1e-12)
        assert dataset.read(1)[0, 0] * unit_m == pytest.approx(values[0, 0], rel=1e-6)
        found = pyproj.CRS.from_wkt(dataset.crs.to_wkt())
        assert found.axis_info[0].unit_conversion_factor == pytest.approx(plan_m)
        assert found.axis_info[-1].unit_conversion_factor == pytest.approx(unit_m)
    raster, _ = read_raster(path)
    assert raster.cell_m == pytest.approx(0.5, rel=1e-12)
    assert (raster.west_map_m, raster.north_map_m) == pytest.approx((300_000.0, 60_000.0), abs=1e-6)
    np.testing.assert_allclose(raster.values, values, rtol=3e-7)


# ---- local grids -----------------------------------------------------------------------------------------------------

SIMILARITY = PlaneSimilarity(np.array([5000.0, 1000.0]), 0.3, 1.00012)
PLANE = HeightFit(np.array([9.5, 52.3]), -36.5, 4e-5, -7e-5, np.zeros(3), fit(np.ones((1, 1)), np.zeros(1), np.ones(1)))


@pytest.mark.parametrize("given_map", [None, "EPSG:25832"])
@pytest.mark.parametrize("height", [None, PLANE])
def test_rasters_of_a_local_grid_have_their_whole_crs_beside_them(
    tmp_path: Path, given_map: str | None, height: HeightFit | None
) -> None:
    crs = local_grid("Site", "EPSG:4258", np.array([9.5, 52.3]), SIMILARITY, height, UNITS["m"], given_map)
    grid = MapGrid(4900.0, 1100.0, 0.5, 300, 280)
    picture = np.full((grid.rows, grid.columns, 4), 200, np.uint8)
    codes = (Category(1, "measured", (1, 2, 3)),)
    values = np.full((grid.rows, grid.columns), 7.5, np.float32)
    write_cog(tmp_path / "dsm.tif", grid, crs, [(grid.whole, values)])
    write_cog_codes(tmp_path / "source.tif", grid, crs, [(grid.whole, picture[..., 0])], categories=codes)
    write_cog_rgba(tmp_path / "picture.tif", grid, plan_of(crs), [(grid.whole, picture)])
    in_keys = given_map is None
    whole = in_keys and height is None
    assert (tmp_path / "dsm.tif.aux.xml").exists() != whole
    assert (tmp_path / "picture.tif.aux.xml").exists() != in_keys
    expected = pyproj.CRS.from_wkt(crs)
    raster, name = read_raster(tmp_path / "dsm.tif")
    assert pyproj.CRS.from_wkt(name).equals(expected) or whole
    assert (raster.west_map_m, raster.cell_m, float(raster.values.max())) == (4900.0, 0.5, 7.5)
    there = [
        pyproj.Transformer.from_crs("EPSG:4258", pyproj.CRS(n), always_xy=True).transform(9.51, 52.31)[:2]
        for n in (name, crs)
    ]
    assert there[0] == pytest.approx(there[1], abs=1e-6)
    shown = picture_on_grid(tmp_path / "picture.tif", grid, Window(10, 20, 30, 40))
    assert shown.shape == (20, 20, 4)
    assert shown.min() == shown.max() == 200
    with rasterio.open(tmp_path / "source.tif") as dataset:
        assert dataset.read(1).max() == 200
        assert dataset.crs
    with rasterio.Env(GDAL_GEOREF_SOURCES="INTERNAL"), rasterio.open(tmp_path / "dsm.tif") as dataset:
        assert bool(dataset.crs) == in_keys
