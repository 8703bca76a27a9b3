"""Where ground points of files lie: the order of their figures, longitude and latitude beside easting and northing,
height systems of columns, all through a whole project file."""

from pathlib import Path

import numpy as np
import pytest
from makers import no_matlab

from photogram.errors import ProjectError
from photogram.geodesy.frames import geodetic_from_map, map_from_crs
from photogram.project.project import Project, read_project

CRS = "EPSG:25832"
TRUTH = np.array([[720_010.0, 6_192_000.0, 63.0], [720_110.0, 6_192_020.0, 64.0], [720_050.0, 6_192_090.0, 61.5]])
PROJECT = """\
photogram: 1
crs: CRS
cameras:
  c: {width_px: 400, height_px: 300, focal_px: 250, principal_point_px: [199.5, 149.5]}
photographs:
  folder: images
control_points:
  sigma_m: [0.02, 0.02, 0.03]
  mark_sigma_px: 1
  files:
    - {path: points.csv, MORE}
"""


def project(folder: Path, text: str, more: str = "role: control", crs: str = CRS) -> Project:
    (folder / "images").mkdir(exist_ok=True)
    (folder / "images" / "a.jpg").touch()
    (folder / "points.csv").write_text(text, encoding="utf-8")
    path = folder / "project.yaml"
    path.write_text(PROJECT.replace("MORE", more).replace("crs: CRS", f"crs: {crs}"))
    return read_project(path, read_matlab_camera=no_matlab)


def places(made: Project) -> np.ndarray:
    return np.array([p.position_map_m for p in made.control_points])


def warnings(made: Project) -> str:
    return "\n".join(f"{w.text}: {w.remedy}" for w in made.warnings)


def rows(points: np.ndarray, order: tuple[int, int, int] = (0, 1, 2), more: str = "") -> str:
    return "".join(f"P{n}," + ",".join(f"{p[k]:.9g}" for k in order) + more + "\n" for n, p in enumerate(points))


@pytest.mark.parametrize("header", ["", "name,x,y,height\n"])
@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2)])
def test_the_area_of_the_crs_decides_the_order(tmp_path: Path, header: str, order: tuple[int, int, int]) -> None:
    made = project(tmp_path, header + rows(TRUTH, order, "" if header else ",nail"))
    assert places(made) == pytest.approx(TRUTH)
    said = "points.csv: read as northing, easting, height: the other way round its points lie outside EPSG:25832"
    assert (said in warnings(made)) == (order[0] == 1)


def test_where_nothing_decides_it_is_asked(tmp_path: Path) -> None:
    near_equator = np.array([[500_100.0, 300_200.0, 20.0], [500_200.0, 300_300.0, 20.0], [500_150.0, 300_400.0, 21.0]])
    with pytest.raises(ProjectError) as raised:
        project(tmp_path, rows(near_equator), crs="EPSG:32632")
    assert "points.csv:1: no line names the columns, and 500100 and 300200 may be easting and northing" in str(
        raised.value
    )
    assert "give columns: [name, easting, northing, height], or northing before easting" in str(raised.value)
    given = project(tmp_path, rows(near_equator), "columns: [name, northing, easting, height]", "EPSG:32632")
    assert places(given) == pytest.approx(near_equator[:, [1, 0, 2]])
    # a line that says x and y says which is which, by everybody's convention
    named = project(tmp_path, "name,x,y,z\n" + rows(near_equator), crs="EPSG:32632")
    assert places(named) == pytest.approx(near_equator)


def test_degrees_in_a_map_grid_are_named(tmp_path: Path) -> None:
    degrees = geodetic_from_map(CRS, TRUTH)
    for header in ("name,x,y,z\n", "name,lon,lat,z\n"):
        with pytest.raises(ProjectError, match="longitude and latitude, but EPSG:25832 is a map grid: give crs"):
            project(tmp_path, header + rows(degrees))
    made = project(tmp_path, "name,x,y,z\n" + rows(degrees), "crs: EPSG:4258")
    assert places(made) == pytest.approx(TRUTH, abs=0.5), "nine digits of a degree"


def both(points: np.ndarray, more: str = "") -> str:
    degrees = geodetic_from_map(CRS, TRUTH)
    head = "Name,Easting,Northing,Elevation,Longitude,Latitude,Ellipsoidal height,Solution status,CS name\n"
    return head + "".join(
        f"P{n},{p[0]:.4f},{p[1]:.4f},{p[2]:.4f},{d[0]:.9f},{d[1]:.9f},{p[2] + 36.0:.4f},FIX{more},GK 3\n"
        for n, (p, d) in enumerate(zip(points, degrees, strict=True))
    )


def test_easting_and_northing_of_another_grid_are_seen_by_longitude_and_latitude(tmp_path: Path) -> None:
    assert places(project(tmp_path, both(TRUTH))) == pytest.approx(TRUTH)
    foreign = map_from_crs(CRS, "EPSG:31467", TRUTH)
    with pytest.raises(ProjectError) as raised:
        project(tmp_path, both(foreign))
    assert (
        "km from longitude and latitude of the same rows, read in EPSG:25832; the file calls their system 'GK 3'"
        in str(raised.value)
    )
    by_degrees = project(tmp_path, both(foreign), "crs: EPSG:4258")
    assert places(by_degrees)[:, :2] == pytest.approx(TRUTH[:, :2], abs=1e-3)
    # a localisation of some metres is the surveyor's own, and said
    moved = project(tmp_path, both(TRUTH + np.array([30.0, 40.0, 0.0])))
    assert places(moved)[:, :2] == pytest.approx(TRUTH[:, :2] + [30.0, 40.0])
    assert "lie 50 m from longitude and latitude" in warnings(moved)


def test_points_without_a_fixed_solution_are_named(tmp_path: Path) -> None:
    made = project(tmp_path, both(TRUTH).replace("FIX,", "FLOAT,", 1))
    assert "1 point without a fixed GNSS solution: P0 float" in warnings(made)


def test_heights_that_a_column_calls_ellipsoidal(tmp_path: Path) -> None:
    text = "name,easting,northing,ellipsoidal height\n" + rows(TRUTH)
    assert {p.heights for p in project(tmp_path, text).control_points} == {"ellipsoidal"}
    with pytest.raises(ProjectError, match=r"is orthometric, but points\.csv has ellipsoidal heights"):
        project(tmp_path, text, "heights: orthometric", "EPSG:25832+7837")
    plain = "name,easting,northing,height\n" + rows(TRUTH)
    assert {p.heights for p in project(tmp_path, plain).control_points} == {None}


def test_columns_and_grids_that_do_not_go_together(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match="the columns are easting and northing, but EPSG:4326 has longitude"):
        project(tmp_path, "name,easting,northing,height\n" + rows(TRUTH), "crs: EPSG:4326")
    with pytest.raises(ProjectError, match=r"columns: needs a name for each column, .* found the text 'name'"):
        project(tmp_path, "name,easting,northing,height\n" + rows(TRUTH), "columns: name")


def test_the_zone_of_the_other_hemisphere_is_proposed(tmp_path: Path) -> None:
    """A latitude band, 32S, read as the south of zone 32."""
    text = "name,easting,northing,height\n" + rows(TRUTH)
    with pytest.raises(
        ProjectError, match=r"outside the area of use of EPSG:25832 .*: correct EPSG:32732 to EPSG:32632"
    ):
        project(tmp_path, text, "crs: EPSG:32732")
    assert places(project(tmp_path, text, "crs: EPSG:32632"))[:, :2] == pytest.approx(TRUTH[:, :2], abs=1.0)
