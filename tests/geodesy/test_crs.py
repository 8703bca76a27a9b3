import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from photogram.errors import FrameError
from photogram.geodesy.crs import (
    WGS84,
    changes_datum,
    crs_in_metres,
    crs_in_words,
    crs_of_wkt,
    datum_change,
    is_geographic,
    map_units,
    metric_crs,
    metric_only,
    middle_deg,
    neighbouring_zones,
    product_crs,
    projected_crs,
    same_plan,
)
from photogram.geodesy.frames import LocalFrame, geodetic_from_map, map_from_crs, map_from_geodetic
from photogram.geodesy.height_systems import DeclaredHeights, Geoid

GRID = str(Path(__file__).parents[1] / "data/BETA2007.gsb")

# A point of the BKG's test data of BeTA2007 (BETA2007testdaten.csv).
ETRS89_DEG = (10.332117283303, 48.832327188640)
ETRS89_UTM32_M = (597759.898637, 5409672.239612)
DHDN_GK3_M = (3597874.421966, 5411397.512092)

SITES = {
    "EPSG:27700": (-1.5, 52.5),
    "EPSG:31467": (10.3, 48.8),
    "EPSG:5514": (14.4, 50.0),
    "EPSG:2193": (174.7, -41.3),
    "EPSG:7856": (151.2, -33.8),
}
"""Map grids, and a longitude and latitude in each."""


@pytest.mark.parametrize(
    ("crs", "accuracy_m", "grid"),
    [
        ("EPSG:27700", 2.0, "uk_os_OSTN15_NTv2_OSGBtoETRS.tif"),
        ("EPSG:31467", 3.0, "de_adv_BETA2007.tif"),
        ("EPSG:5514", 1.0, None),
        ("EPSG:2193", 1.0, None),
        ("EPSG:7856", 3.0, None),
    ],
)
def test_the_best_operation_is_used_or_its_grid_is_named(crs: str, accuracy_m: float, grid: str | None) -> None:
    change = datum_change(WGS84, crs, SITES[crs])
    assert change.accuracy_m == accuracy_m
    assert crs in change.target
    assert (None if change.missing is None else change.missing.name) == grid
    if change.missing is not None:
        assert change.missing.package == "proj-data"
        assert change.missing.accuracy_m == 1.0
        assert f"{grid} of the package proj-data" in change.loss
        assert "to 1 m" in change.loss
        assert f"right to {accuracy_m:g} m" in change.loss
        assert f"projsync --file {grid}" in change.missing.remedy


@pytest.mark.parametrize(
    ("crs", "changes"), [("EPSG:32632", False), ("EPSG:25832", True), ("EPSG:31467", True), ("EPSG:32632+5773", False)]
)
def test_whether_a_datum_changes(crs: str, changes: bool) -> None:
    assert changes_datum(WGS84, crs) is changes
    assert changes_datum("EPSG:4979", crs) is changes
    assert not changes_datum(crs, crs)


def test_a_grid_brings_a_published_point_to_2_mm_and_back() -> None:
    geodetic = np.array([[*ETRS89_DEG, 500.0]])
    here = map_from_geodetic("EPSG:31467", geodetic, GRID)
    np.testing.assert_allclose(here[0], [*DHDN_GK3_M, 500.0], atol=0.002)
    np.testing.assert_allclose(geodetic_from_map("EPSG:31467", here, GRID), geodetic, atol=2e-9)
    from_utm = map_from_crs("EPSG:25832", "EPSG:31467", np.array([[*ETRS89_UTM32_M, 500.0]]), GRID)
    np.testing.assert_allclose(from_utm[0], [*DHDN_GK3_M, 500.0], atol=0.002)
    # without it, by less than PROJ states and more than a survey bears
    off_m = np.hypot(*(map_from_geodetic("EPSG:31467", geodetic)[0, :2] - DHDN_GK3_M))
    assert 0.3 < off_m < 3.0
    assert datum_change(WGS84, "EPSG:31467", SITES["EPSG:31467"], GRID).missing is None


def test_a_grid_in_the_folder_of_proj_is_used(tmp_path: Path) -> None:
    shutil.copy(GRID, tmp_path / "BETA2007.gsb")
    code = (
        "import numpy as np\n"
        "from photogram.geodesy.crs import *\n"
        "from photogram.geodesy.frames import map_from_geodetic\n"
        f"print(datum_change(WGS84, 'EPSG:31467', {SITES['EPSG:31467']}).missing,"
        f" *map_from_geodetic('EPSG:31467', np.array([[*{ETRS89_DEG}, 0.0]]))[0])"
    )
    environment = os.environ | {"PROJ_USER_WRITABLE_DIRECTORY": str(tmp_path)}
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    missing, *place = run.stdout.split()
    assert missing == "None"
    np.testing.assert_allclose([float(x) for x in place[:2]], DHDN_GK3_M, atol=0.002)


def test_a_grid_that_does_not_serve_is_refused(tmp_path: Path) -> None:
    here = np.array([[*ETRS89_DEG, 0.0]])
    with pytest.raises(FrameError, match="knows no operation with this grid from EPSG:4326 to EPSG:25832"):
        map_from_geodetic("EPSG:25832", here, GRID)
    with pytest.raises(FrameError, match=r"give uk_os_OSTN15_NTv2_OSGBtoETRS\.tif, under its own name"):
        map_from_geodetic("EPSG:27700", np.array([[-1.5, 52.5, 0.0]]), GRID)
    with pytest.raises(FrameError, match=r"position 10\.33211\d*, 50\.83\d* of EPSG:4326 lies outside"):
        map_from_geodetic("EPSG:31467", np.vstack([here, here, here + np.array([0.0, 2.0, 0.0])]), GRID)
    (tmp_path / "BETA2007.gsb").write_text("no grid")
    with pytest.raises(FrameError, match="PROJ cannot read it"):
        map_from_geodetic("EPSG:31467", here, str(tmp_path / "BETA2007.gsb"))
    with pytest.raises(FrameError, match="comma"):
        map_from_geodetic("EPSG:31467", here, str(tmp_path / "a,BETA2007.gsb"))


def test_a_grid_whose_shifts_no_datum_has_is_refused(tmp_path: Path) -> None:
    data = bytearray(Path(GRID).read_bytes())
    shifts = np.frombuffer(data, dtype="<f4", count=4 * 36, offset=352)
    shifts += 60.0  # seconds of arc
    (tmp_path / "BETA2007.gsb").write_bytes(data)
    with pytest.raises(FrameError, match=r"moves positions by 2\d{3} m here, which no datum does"):
        map_from_geodetic("EPSG:31467", np.array([[*ETRS89_DEG, 0.0]]), str(tmp_path / "BETA2007.gsb"))


def test_the_middle_of_positions() -> None:
    places = np.array([[10.0, 48.0], [10.26, 48.44], [11.0, 49.0], [np.nan, 3.0]])
    assert middle_deg(WGS84, places) == (10.3, 48.4)
    assert middle_deg("EPSG:25832", np.array([ETRS89_UTM32_M])) == (10.3, 48.8)
    assert middle_deg(WGS84, np.full((2, 2), np.nan)) is None
    assert middle_deg(WGS84, np.array([[500_000.0, 5_000_000.0]])) is None


@pytest.mark.parametrize(
    ("wkt", "expected"),
    [
        ("", None),
        ('LOCAL_CS["x"]', None),
        ('ENGCRS["x"]', None),
        ('PROJCS["a", AUTHORITY["EPSG","25832"]]', "EPSG:25832"),
        ('PROJCRS["a",\n  ID["EPSG",25832]]', "EPSG:25832"),
        ('PROJCS["a"]', 'PROJCS["a"]'),
        ("EPSG:25832+7837", "EPSG:25832+7837"),
    ],
)
def test_a_crs_is_known_by_its_code(wkt: str, expected: str | None) -> None:
    assert crs_of_wkt(wkt) == expected


@pytest.mark.parametrize(
    ("crs", "expected"),
    [("EPSG:4326", True), ("EPSG:4979", True), ("EPSG:4326+5773", True), ("EPSG:25832", False),
     ("EPSG:25832+7837", False), ("EPSG:4978", False)],
)  # fmt: skip
def test_whether_a_crs_is_geographic(crs: str, expected: bool) -> None:
    assert is_geographic(crs) is expected


# ---- feet ------------------------------------------------------------------------------------------------------------

US_FOOT = 1200.0 / 3937.0


@pytest.mark.parametrize(
    ("crs", "plan_m", "height_m", "words"),
    [
        ("EPSG:25832", 1.0, 1.0, "metre"),
        ("EPSG:2263", US_FOOT, US_FOOT, "US survey foot"),
        ("EPSG:2263+6360", US_FOOT, US_FOOT, "US survey foot"),
        ("EPSG:2263+5703", US_FOOT, 1.0, "US survey foot, heights in metre"),
        ("EPSG:26918+6360", 1.0, US_FOOT, "metre, heights in US survey foot"),
        ("EPSG:2222+8228", 0.3048, 0.3048, "foot"),
        ("EPSG:2314", 0.3047972654, 0.3047972654, "Clarke's foot"),
        ("none", 1.0, 1.0, "metre"),
    ],
)
def test_units_of_maps(crs: str, plan_m: float, height_m: float, words: str) -> None:
    units = map_units(crs)
    assert units.plan_m == pytest.approx(plan_m, rel=1e-15)
    assert units.height_m == pytest.approx(height_m, rel=1e-15)
    assert units.words == words
    assert units.is_metric == (plan_m == height_m == 1.0)


@pytest.mark.parametrize(("feet", "metres"), [("EPSG:2263", "EPSG:32118"), ("EPSG:2222", "EPSG:26948")])
def test_a_map_in_feet_is_computed_as_the_same_in_metres(feet: str, metres: str) -> None:
    """The EPSG registry has the same State Plane zone in feet and in metres; Arizona's false origins are whole metres
    in one and whole feet in the other."""
    place = np.array([[-74.0, 40.7, 12.0], [-73.5, 40.9, 0.0]] if feet == "EPSG:2263" else [[-110.2, 33.0, 5.0]])
    own, other = map_from_geodetic(feet, place), map_from_geodetic(metres, place)
    np.testing.assert_allclose(own, other, rtol=0, atol=1e-3)
    np.testing.assert_allclose(geodetic_from_map(feet, own), place, rtol=0, atol=1e-11)
    frame = LocalFrame(feet, (float(own[0, 0]), float(own[0, 1]), 0.0))
    np.testing.assert_allclose(frame.map_from_world(frame.world_from_map(own)), own, rtol=0, atol=1e-8)
    np.testing.assert_allclose(frame.map_from_unit(frame.unit_from_map(own)), own, rtol=1e-15)
    assert metric_crs(feet).axis_info[0].unit_name == "metre"
    assert metric_crs("EPSG:25832").to_epsg() == 25832


def test_points_of_another_crs_come_to_a_map_in_feet_in_metres() -> None:
    given = np.array([[984250.0, 200000.0, 100.0]])
    moved = map_from_crs("EPSG:2263+6360", "EPSG:32118", given)
    np.testing.assert_allclose(moved, given * US_FOOT, rtol=0, atol=1e-6)
    back = map_from_crs("EPSG:32118", "EPSG:2263", moved)
    np.testing.assert_allclose(back, moved, rtol=0, atol=1e-6)


def test_products_name_their_units() -> None:
    ellipsoidal = DeclaredHeights("ellipsoidal")
    assert map_units(product_crs("EPSG:2263", ellipsoidal)).height == "US survey foot"
    assert crs_in_words("EPSG:2263", ellipsoidal) == "EPSG:2263, heights above the ellipsoid, in US survey foot"
    orthometric = DeclaredHeights("orthometric", geoid=Geoid("EPSG:5703"))
    assert product_crs("EPSG:2263", orthometric) == "EPSG:2263+5703"
    assert crs_in_words("EPSG:25832", ellipsoidal) == "EPSG:25832, heights above the ellipsoid"
    assert crs_in_metres("EPSG:25832") == "EPSG:25832"
    assert crs_in_metres("EPSG:2263") == "EPSG:32118", "the same zone, which the registry has in metres too"
    assert "in metres" in crs_in_metres("+proj=tmerc +lat_0=40 +lon_0=-74 +units=us-ft +datum=NAD83 +type=crs")
    with pytest.raises(FrameError, match="is in US survey foot: choose a map grid in metres"):
        metric_only("EPSG:2263")


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("EPSG:25832", "EPSG:25832+7837", True),
        ("EPSG:25832", "ellipsoidal", True),  # three axes, as products carry it
        ("EPSG:25832+7837", "ellipsoidal", True),
        ("EPSG:25832", "EPSG:25833", False),
        ("EPSG:25833", "ellipsoidal", False),
        ("EPSG:32632", "EPSG:25832", False),
    ],
)
def test_a_plan_is_the_same_whatever_is_said_of_heights(first: str, second: str, expected: bool) -> None:
    if second == "ellipsoidal":
        second = product_crs("EPSG:25832", DeclaredHeights("ellipsoidal", "ellipsoidal", "ellipsoidal", None))
        assert "ellipsoidal height" in second
    assert same_plan(first, second) is expected
    assert same_plan(second, first) is expected


@pytest.mark.parametrize(
    ("grid", "beside", "across"),
    [
        ("EPSG:32632", ["EPSG:32633", "EPSG:32631"], ["EPSG:32732"]),
        ("EPSG:32732", ["EPSG:32733", "EPSG:32731"], ["EPSG:32632"]),
        ("EPSG:31982", ["EPSG:31983", "EPSG:31981"], ["EPSG:31976"]),  # codes in no order across the equator
        ("EPSG:25832", ["EPSG:25833", "EPSG:25831"], []),  # of the north alone
        ("EPSG:2056", [], []),  # no zone
    ],
)
def test_a_zone_is_mistaken_for_those_beside_it_and_across_the_equator(
    grid: str, beside: list[str], across: list[str]
) -> None:
    zones = list(neighbouring_zones(grid))
    assert zones[:2] == beside
    assert [zone for zone in zones if projected_crs(zone).name[-1:] != projected_crs(grid).name[-1:]] == across
