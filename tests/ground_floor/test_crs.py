from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from photogram.crs import WGS84, changes_datum, crs_of_wkt, datum_change, is_geographic, middle_deg
from photogram.errors import FrameError
from photogram.frames import geodetic_from_map, map_from_crs, map_from_geodetic

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
        "import numpy as np; from photogram.crs import *; from photogram.frames import map_from_geodetic\n"
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
