"""Ground points that project.yaml takes from files, and the other keys of whole surveys."""

from pathlib import Path

import numpy as np
import pytest
from makers import SharedData, no_matlab

from photogram.errors import FrameError, ProjectError
from photogram.files.marks.mark_table import write_marks, write_proposals
from photogram.files.tables.surveyed_points import Mark, Proposal
from photogram.geodesy.frames import LocalFrame, map_from_crs, map_from_geodetic
from photogram.project.control.points import ProjectControlPoint
from photogram.project.project import Project, photograph_paths, read_project
from photogram.sfm.orientation import OrientationSettings
from photogram.survey import rms_sigma_px

GOOD = """\
photogram: 1
crs: EPSG:25832
quality: medium
cameras:
  big: {width_px: 800, height_px: 600, focal_px: 500, principal_point_px: [400, 299], source: EXIF, calibration: auto}
  small: {width_px: 400, height_px: 300, focal_px: 250, principal_point_px: [199.5, 149.5]}
photographs:
  folder: images
  camera: big
  height_above_ground_m: 50
  list:
    - {name: a.jpg, height_above_ground_m: 40.5}
    - {name: b.jpg}
    - {name: c.jpg, camera: small}
control_points:
  sigma_m: [0.02, 0.02, 0.03]
  mark_sigma_px: 1
  files:
    - path: gcp_list.txt
      picture_size_px: [4000, 3000]
    - path: control.csv
      marks: marks.csv
      sigma_m: [0.1, 0.2, 0.3]
      mark_sigma_px: 0.5
    - path: check.csv
      role: check
      marks: marks.csv
      crs: EPSG:4326
  list:
    - {name: L1, position_m: [720000, 6192000, 60], marks: {a.jpg: [1, 2]}}
orientation: {method: growth}
"""
GCP_LIST = """\
EPSG:25832
720000 6192010 61 99.5 199.5 a.jpg G1
720000 6192010 61 2000 1500 c.jpg G1
720020 6192010 62 3000 100 b.jpg
"""
CONTROL = """\
name,easting,northing,height,sigma_plan,role
C1,720010,6192000,63,,
C2,720010,6192020,64,0.01,check
"""
CHECK = """\
name;lon;lat;h
K1;12.5116;55.8231;65
"""
MARKS = """\
name,photograph,u,v,sigma_px
C1,a.jpg,10,20,
K1,a.jpg,30,40,
K1,b.jpg,50,60,2
C2,c.jpg,399,299,
"""
FILES = {"gcp_list.txt": GCP_LIST, "control.csv": CONTROL, "check.csv": CHECK, "marks.csv": MARKS}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "images").mkdir()
    for name in "abc":
        (tmp_path / "images" / f"{name}.jpg").touch()
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "project.yaml").write_text(GOOD)
    return tmp_path


def read(folder: Path) -> Project:
    return read_project(folder / "project.yaml", read_matlab_camera=no_matlab)


def change(folder: Path, name: str, *changes: tuple[str, str]) -> None:
    path = folder / name
    for old, new in changes:
        text = path.read_text()
        assert text.count(old) >= 1, old
        path.write_text(text.replace(old, new, 1))


def faults(folder: Path) -> list[str]:
    """The faults of the project file as ``line: message``."""
    with pytest.raises(ProjectError) as raised:
        read(folder)
    path = folder / "project.yaml"
    lines = [line for line in str(raised.value).splitlines() if not line.endswith("errors:")]
    assert all(line.startswith(f"{path}:") for line in lines)
    return [line.removeprefix(f"{path}:") for line in lines]


def points_of(project: Project) -> dict[str, ProjectControlPoint]:
    return {point.name: point for point in project.control_points}


# -- what is read -----------------------------------------------------------------------------------------------------


def test_keys_of_whole_surveys_arrive(folder: Path) -> None:
    project = read(folder)
    assert (project.quality, project.calibration, project.camera_source) == ("medium", ("auto", "given"), ("EXIF", ""))
    assert [p.height_above_ground_m for p in project.photographs] == [40.5, 50.0, 50.0]
    assert project.orientation == OrientationSettings(method="growth")


def test_their_defaults(folder: Path) -> None:
    change(folder, "project.yaml", ("quality: medium\n", ""), (", source: EXIF, calibration: auto", ""))
    change(folder, "project.yaml", ("  height_above_ground_m: 50\n", ""), (", height_above_ground_m: 40.5", ""))
    change(folder, "project.yaml", (GOOD[GOOD.index("  files:") : GOOD.index("  list:\n    - {name: L1")], ""))
    project = read(folder)
    assert (project.quality, project.calibration, project.camera_source) == ("high", ("given", "given"), ("", ""))
    assert [p.height_above_ground_m for p in project.photographs] == [None] * 3
    assert [p.name for p in project.control_points] == ["L1"]


def test_points_of_files_follow_those_of_the_list(folder: Path) -> None:
    project = read(folder)
    assert [(p.name, p.role) for p in project.control_points] == [
        ("L1", "control"),
        ("G1", "control"),
        ("p1", "control"),
        ("C1", "control"),
        ("C2", "check"),
        ("K1", "check"),
    ]
    points = points_of(project)
    assert points["G1"].position_map_m.tolist() == [720000.0, 6192010.0, 61.0]
    assert points["C1"].position_map_m.tolist() == [720010.0, 6192000.0, 63.0]
    expected = map_from_geodetic("EPSG:25832", np.array([[12.5116, 55.8231, 65.0]]))[0]
    np.testing.assert_allclose(points["K1"].position_map_m, expected, atol=1e-6)


def test_sigmas_of_column_entry_and_all_points(folder: Path) -> None:
    points = points_of(read(folder))
    assert points["G1"].sigma_m.tolist() == [0.02, 0.02, 0.03]
    assert points["C1"].sigma_m.tolist() == [0.1, 0.2, 0.3]
    assert points["C2"].sigma_m.tolist() == [0.01, 0.01, 0.3]
    assert points["K1"].sigma_m.tolist() == [0.02, 0.02, 0.03]
    assert rms_sigma_px(points["G1"].mark_covariance_px2).tolist() == [1.0, 1.0]
    assert rms_sigma_px(points["C1"].mark_covariance_px2).tolist() == [0.5]
    assert rms_sigma_px(points["K1"].mark_covariance_px2).tolist() == [1.0, 2.0]


def assumed_of(folder: Path) -> tuple[set[str], set[str]]:
    """The points whose sigmas are assumed, and those whose marks' are, as they stand in the block."""
    points = read(folder).control_points_in(LocalFrame("EPSG:25832", (720000.0, 6192000.0, 0.0), "grid"))
    rows = list(zip(points.name, points.sigma_assumed, points.mark_sigma_assumed, strict=True))
    return {name for name, own, _ in rows if own}, {name for name, _, marks in rows if marks}


def test_assumed_sigmas_of_a_file_are_those_of_its_entry(folder: Path) -> None:
    assert assumed_of(folder) == (set(), set())
    change(
        folder, "project.yaml", ("      mark_sigma_px: 0.5\n", "      sigma_assumed: true\n      mark_sigma_px: 0.5\n")
    )
    change(
        folder, "project.yaml", ("    - path: check.csv\n", "      mark_sigma_assumed: true\n    - path: check.csv\n")
    )
    # C2 has a column of its own in plan, its height is of the entry
    assert assumed_of(folder) == ({"C1", "C2"}, {"C1", "C2"})


def test_a_sigma_of_the_table_itself_is_not_assumed(folder: Path) -> None:
    whole = CONTROL.replace("sigma_plan,role", "sigma_plan,sigma_height,role")
    whole = whole.replace("63,,", "63,,,").replace("64,0.01,check", "64,0.01,0.02,check")
    (folder / "control.csv").write_text(whole)
    (folder / "marks.csv").write_text(MARKS.replace("C1,a.jpg,10,20,", "C1,a.jpg,10,20,0.7"))
    change(
        folder, "project.yaml", ("      mark_sigma_px: 0.5\n", "      sigma_assumed: true\n      mark_sigma_px: 0.5\n")
    )
    change(
        folder, "project.yaml", ("    - path: check.csv\n", "      mark_sigma_assumed: true\n    - path: check.csv\n")
    )
    assert assumed_of(folder) == ({"C1"}, {"C2"})


def test_assumed_sigmas_of_all_points_reach_files_that_state_none(folder: Path) -> None:
    change(folder, "project.yaml", ("  mark_sigma_px: 1\n", "  sigma_assumed: true\n  mark_sigma_px: 1\n"))
    change(folder, "project.yaml", ("  mark_sigma_px: 1\n", "  mark_sigma_px: 1\n  mark_sigma_assumed: true\n"))
    own, marks = assumed_of(folder)
    assert own == {"L1", "G1", "p1", "K1"}
    assert marks == {"L1", "G1", "p1"}, "one mark of K1 has a sigma in its table"


def test_marks_of_another_picture_size_keep_pixel_centres(folder: Path) -> None:
    points = points_of(read(folder))
    assert points["G1"].mark_photograph.tolist() == [0, 2]
    # 4000 px to 800 px and to 400 px: edges stay edges
    expected = [[(99.5 + 0.5) / 5 - 0.5, (199.5 + 0.5) / 5 - 0.5], [(2000 + 0.5) / 10 - 0.5, (1500 + 0.5) / 10 - 0.5]]
    np.testing.assert_allclose(points["G1"].mark_pixel, expected, atol=1e-12)
    assert points["C2"].mark_pixel.tolist() == [[399.0, 299.0]]


def test_origin_of_the_marks_holds_for_files_too(folder: Path) -> None:
    change(folder, "project.yaml", ("  mark_sigma_px: 1\n", "  mark_sigma_px: 1\n  pixel_origin: matlab\n"))
    points = points_of(read(folder))
    np.testing.assert_allclose(points["G1"].mark_pixel[0], [(98.5 + 0.5) / 5 - 0.5, (198.5 + 0.5) / 5 - 0.5])
    assert points["C1"].mark_pixel.tolist() == [[9.0, 19.0]]


def test_sheffield(tmp_path: Path, shared_data: SharedData) -> None:
    sheffield = shared_data("sheffield_cross").resolve()
    camera = "{width_px: 800, height_px: 600, focal_px: 463, principal_point_px: [399.5, 299.5]}"
    text = (
        f"photogram: 1\ncrs: EPSG:32617\ncameras: {{p3: {camera}}}\n"
        f"photographs: {{folder: {sheffield / 'images'}}}\n"
        "control_points:\n  sigma_m: [0.5, 0.5, 0.5]\n  mark_sigma_px: 1\n  files:\n"
        f"    - path: {sheffield / 'gcp_file.txt'}\n"
    )
    (tmp_path / "project.yaml").write_text(text)
    (fault,) = faults(tmp_path)
    assert fault.startswith("9: control_points.files[")
    assert fault.endswith(
        "gcp_file.txt:2: 25 of 25 marks are outside their photographs, which are 800 × 600 px: they would "
        "fit pictures of 4000 × 3000 px: give picture_size_px: [4000, 3000]"
    )
    (tmp_path / "project.yaml").write_text(text + "      picture_size_px: [4000, 3000]\n")
    project = read(tmp_path)
    assert len(project.photographs) == 41
    first = project.control_points[0]
    np.testing.assert_allclose(first.position_map_m, [333158.20, 3102916.18, 3.0], atol=1e-6)
    assert project.photographs[first.mark_photograph[0]].name == "DJI_0065.JPG"
    np.testing.assert_allclose(first.mark_pixel[0], [(2699.43 + 0.5) / 5 - 0.5, (1668.72 + 0.5) / 5 - 0.5], atol=1e-9)
    assert sum(len(p.mark_photograph) for p in project.control_points) == 25


def test_marks_of_photographs_that_take_no_part_are_left_out_with_a_warning(folder: Path) -> None:
    change(folder, "gcp_list.txt", ("a.jpg", "aa.JPG"))
    change(folder, "marks.csv", ("K1,b.jpg", "K1,IMG_9.png"))
    project = read(folder)
    assert [len(p.mark_photograph) for p in project.control_points] == [1, 1, 1, 1, 1, 1]
    first, second = project.warnings
    assert (first.severity, first.where) == ("warning", "project.yaml:19")
    assert first.text == (
        f"{G}: gcp_list.txt:2: 1 of 3 marks is in a photograph that is not in the project and is left out: aa.JPG (1)"
    )
    assert first.remedy == "add the photographs to the project, or remove their marks"
    assert second.text.startswith(f"{K}: marks.csv:4: 1 of 2 marks is in a photograph that is not in the project")
    assert second.text.endswith("IMG_9.png (1)")
    assert second.remedy == "add the photographs to the project, or remove their marks"


def test_photograph_paths_in_spite_of_faults(folder: Path) -> None:
    change(folder, "project.yaml", ("quality: medium", "quality: best"), ("crs: EPSG:25832", "crs: none"))
    assert [p.name for p in photograph_paths(folder / "project.yaml")] == ["a.jpg", "b.jpg", "c.jpg"]
    assert photograph_paths(folder / "project.yaml", folder)[0] == folder / "a.jpg"


# -- faults -----------------------------------------------------------------------------------------------------------

Change = tuple[str, str, str]
G, C, K = (f"control_points.files[{name}]" for name in ("gcp_list.txt", "control.csv", "check.csv"))
FAULTS: dict[str, tuple[list[Change], list[str]]] = {
    "quality": (
        [("project.yaml", "quality: medium", "quality: hihg")],
        ["3: quality: must be high, medium or low, found the text 'hihg': did you mean 'high'?"],
    ),
    "calibration": (
        [("project.yaml", "calibration: auto", "calibration: free")],
        ["5: cameras.big.calibration: must be given or auto, found the text 'free'"],
    ),
    "height above ground": (
        [("project.yaml", "height_above_ground_m: 40.5", "height_above_ground_m: 0")],
        ["12: photographs.list[a.jpg].height_above_ground_m: must be from 0.1 to 50000 m, found 0"],
    ),
    "no path": (
        [("project.yaml", "- path: gcp_list.txt\n     ", "-")],
        ["19: control_points.files[#1].path: is missing: give the file with the points, relative to this file"],
    ),
    "no file": (
        [("project.yaml", "path: control.csv", "path: contrl.csv")],
        ["21: control_points.files[contrl.csv]: contrl.csv:1: cannot be read (No such file or directory): check its"],
    ),
    "no file of marks": (
        [("project.yaml", "marks: marks.csv", "marks: mark.csv")],
        [
            f"21: {C}: mark.csv:1: cannot be read (No such file or directory): check its name and folder",
            # nobody else has the points whose marks the other entry shares
            f"25: {K}: marks.csv:2: no point 'C1' in check.csv",
            f"25: {K}: marks.csv:5: no point 'C2' in check.csv",
        ],
    ),
    "every fault of a file, with its lines": (
        [("gcp_list.txt", "720000 6192010 61 2000", "720000 6192010 6l 2000"), ("gcp_list.txt", " b.jpg", "")],
        [
            f"19: {G}: gcp_list.txt:3: z must be a number, found '6l'",
            f"19: {G}: gcp_list.txt:4: 5 fields, expected x y z u v photograph [name]",
        ],
    ),
    "picture size": (
        [("project.yaml", "[4000, 3000]", "[4000, 3000.5]")],
        [
            f"19: {G}: gcp_list.txt:3: 2 of 3 marks are outside their photographs, which are 400 × 300 px: they would",
            f"20: {G}.picture_size_px: needs 2 whole numbers [width, height] from 1 to 200000 px, found [4000, 3000.5]",
        ],
    ),
    "shape of the picture": (
        [("project.yaml", "[4000, 3000]", "[4000, 2250]")],
        [
            f"20: {G}.picture_size_px: a picture of 4000 × 2250 px has another aspect ratio than the "
            "photographs of camera b",
            f"20: {G}.picture_size_px: a picture of 4000 × 2250 px has another aspect ratio than the "
            "photographs of camera s",
        ],
    ),
    "mark outside the picture": (
        [("gcp_list.txt", "3000 100 b.jpg", "3000 3100 b.jpg")],
        [
            f"19: {G}: gcp_list.txt:4: the mark of p1 in b.jpg at pixel (3000, 3100) is outside a picture of 4000 × "
            "3000 px: check the order (u right, v down)"
        ],
    ),
    "mark outside its photograph": (
        [("marks.csv", "399,299", "399,300")],
        [f"21: {C}: marks.csv:5: the mark of C2 in c.jpg at pixel (399, 300) is outside the photograph, which is 400 "],
    ),
    "no photograph of any mark": (
        [("project.yaml", ", marks: {a.jpg: [1, 2]}", "")]
        + [("gcp_list.txt", f" {name}", f" x_{name}") for name in ("a.jpg", "b.jpg", "c.jpg")]
        + [("marks.csv", f",{name}", f",x_{name}") for name in ("a.jpg", "a.jpg", "b.jpg", "c.jpg")],
        [
            f"19: {G}: gcp_list.txt:2: all 3 marks are in photographs that are not in the project: x_a.jpg (1), ",
            f"21: {C}: marks.csv:2: both marks are in photographs that are not in the project: x_a.jpg (1), ",
            f"25: {K}: marks.csv:3: both marks are in photographs that are not in the project: x_a.jpg (1), ",
        ],
    ),
    "name of list and file": (
        [("project.yaml", "name: L1", "name: G1")],
        [f"19: {G}: gcp_list.txt:2: 'G1' is used twice, first in line 30 of project.yaml: give each point its own"],
    ),
    "name of two files": (
        [("control.csv", "C1", "G1"), ("marks.csv", "C1", "G1")],
        [f"21: {C}: control.csv:2: 'G1' is used twice, first in gcp_list.txt:2: give each point its own name"],
    ),
    "mark of no point": (
        [("marks.csv", "C1,a", "C11,a")],
        [
            f"21: {C}: marks.csv:2: no point 'C11' in control.csv: did you mean 'C1'?",
            f"25: {K}: marks.csv:2: no point 'C11' in check.csv",
        ],
    ),
    "no sigma": (
        [("project.yaml", "  sigma_m: [0.02, 0.02, 0.03]\n", ""), ("project.yaml", "  mark_sigma_px: 1\n", "")],
        [
            f"17: {G}: 2 points (G1, p1) without a standard deviation: give sigma_m here or for all points",
            f"17: {G}: marks without a standard deviation (3): give mark_sigma_px here or for all points",
            f"23: {K}: 1 point (K1) without a standard deviation: give sigma_m here or for all points, or a column",
            f"23: {K}: marks without a standard deviation (3): give mark_sigma_px here or for all points, or a column",
            "28: control_points.list[L1]: the point has no standard deviation: give sigma_m",
            "28: control_points.list[L1]: the point has no standard deviation of its marks",
        ],
    ),
    "no crs of a gcp list": (
        [("gcp_list.txt", "EPSG:25832\n", "")],
        [f"19: {G}: gcp_list.txt:1: the first line must name the CRS, EPSG:32617 for example: add it, or give crs"],
    ),
    "two crs": (
        [("project.yaml", "path: gcp_list.txt\n", "path: gcp_list.txt\n      crs: EPSG:25833\n")],
        [f"20: {G}.crs: gcp_list.txt names EPSG:25832 in its first line: keep one of the two"],
    ),
    "crs that is none": (
        [("gcp_list.txt", "EPSG:25832", "UTM zone 32")],
        [f"19: {G}: gcp_list.txt: 'UTM zone 32': not a CRS known to PROJ"],
    ),
    "longitude in a grid": (
        [("project.yaml", "      crs: EPSG:4326\n", "")],
        [f"25: {K}: the columns are longitude and latitude, but EPSG:25832 is a map grid: give crs: EPSG:4326"],
    ),
    "marks beside a gcp list": (
        [("project.yaml", "path: gcp_list.txt\n", "path: gcp_list.txt\n      marks: marks.csv\n")],
        [
            f"20: {G}.marks: gcp_list.txt contains its own marks: name the marks.csv that photogram mark writes, or "
            "remove this key",
        ],
    ),
    "swapped": (
        [("control.csv", "720010,6192000", "6192000,720010")],
        [f"21: {C}: control.csv:2: C1: easting and northing look swapped: found easting 6192000.00, northing "],
    ),
    "latitude before longitude": (
        [("check.csv", "12.5116;55.8231", "55.8231;12.5116")],
        [f"25: {K}: check.csv:2: K1: longitude and latitude look swapped: found easting "],
    ),
    "swapped in a whole file": (
        [("gcp_list.txt", "720000 6192010", "6192010 720000")] * 2
        + [("gcp_list.txt", "720020 6192010", "6192010 720020")],
        [f"19: {G}: gcp_list.txt:2: G1: easting and northing look swapped in all 2, the first: found easting 6192010"],
    ),
    "height of another kind": (
        [("control.csv", "6192000,63", "6192000,-9999")],
        [f"21: {C}: control.csv:2: C1: height -9999 m is impossible on Earth or a placeholder"],
    ),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_each_fault_names_line_file_and_remedy(folder: Path, kind: str) -> None:
    changes, expected = FAULTS[kind]
    for name, old, new in changes:
        change(folder, name, (old, new))
    found = faults(folder)
    assert len(found) == len(expected), "\n".join(found)
    for start in expected:
        assert any(line.startswith(start) for line in found), (start, "\n".join(found))


def test_points_in_another_crs_are_moved_exactly(folder: Path) -> None:
    text = "EPSG:25833\n344470.7 6192600.1 61 100 100 a.jpg G1\n"
    (folder / "gcp_list.txt").write_text(text)
    expected = map_from_crs("EPSG:25833", "EPSG:25832", np.array([[344470.7, 6192600.1, 61.0]]))[0]
    np.testing.assert_allclose(points_of(read(folder))["G1"].position_map_m, expected, atol=1e-9)
    assert abs(expected[0] - 344470.7) > 300_000


# -- positions of any CRS ---------------------------------------------------------------------------------------------


def test_utm_neighbours_agree_through_longitude_and_latitude() -> None:
    geodetic = np.array([[12.5, 55.8, 10.0], [11.0, 56.5, -3.0]])
    west, east = (map_from_crs("EPSG:4258", zone, geodetic) for zone in ("EPSG:25832", "EPSG:25833"))
    np.testing.assert_allclose(map_from_crs("EPSG:25833", "EPSG:25832", east), west, atol=1e-6)
    np.testing.assert_allclose(map_from_crs("EPSG:25832", "EPSG:25832", west), west, atol=1e-6)
    # an independent formula: on its central meridian a transverse Mercator has its false easting
    on_meridian = map_from_crs("EPSG:4258", "EPSG:25832", np.array([[9.0, 55.0, 0.0]]))[0]
    assert abs(on_meridian[0] - 500_000.0) < 1e-6


def test_heights_go_through_but_for_their_unit() -> None:
    point = np.array([[6480000.0, 1840000.0, 300.0]])
    moved = map_from_crs("EPSG:2229+6360", "EPSG:32611", point)[0]
    np.testing.assert_allclose(moved[2], 300.0 * 1200 / 3937, rtol=1e-12)
    assert map_from_crs("EPSG:25833+7837", "EPSG:25832+7837", np.array([[319958.0, 6191969, 70]]))[0, 2] == 70.0
    assert map_from_crs("EPSG:4326", "EPSG:25832", np.zeros((0, 3))).shape == (0, 3)


@pytest.mark.parametrize(
    ("source", "target", "point", "message"),
    [
        ("EPSG:99999", "EPSG:25832", [1, 2, 3], "'EPSG:99999': not a CRS known to PROJ"),
        ("EPSG:4978", "EPSG:25832", [1, 2, 3], "has no easting and northing, nor longitude and latitude"),
        ("EPSG:5773", "EPSG:25832", [1, 2, 3], "has no easting and northing"),
        ("EPSG:4326", "EPSG:4326", [1, 2, 3], "is not a projected CRS"),
        ("EPSG:2229", "EPSG:32611", [6480000, 1840000, 300], "in US survey foot and has no vertical part"),
        ("EPSG:4326", "EPSG:25832", [12.5, 155.8, 3], "cannot be transformed to EPSG:25832: check the CRS, and that"),
    ],
)
def test_positions_that_cannot_be_moved(source: str, target: str, point: list[float], message: str) -> None:
    with pytest.raises(FrameError, match=message):
        map_from_crs(source, target, np.array([point], dtype=np.float64))


def test_datum_unknown_is_taken_as_the_other_and_a_known_one_never() -> None:
    point = np.array([[719958.0, 6191969.0, 1.0]])
    np.testing.assert_allclose(map_from_crs("+proj=utm +zone=32 +ellps=GRS80 +units=m", "EPSG:25832", point), point)
    with pytest.raises(FrameError, match="has no transformation from EPSG:4979"):
        map_from_crs("EPSG:4979", "EPSG:25832+7837", np.array([[12.0, 55.0, 70.0]]))


# -- marks of other programs -----------------------------------------------------------------------------------------

MARKERS = """\
<document version="2.0.0"><chunk>
  <cameras><camera id="0" label="a"/><camera id="1" label="B.JPG"/><camera id="2" label="elsewhere"/></cameras>
  <markers>
    <marker id="0" label="M1"><reference x="720000" y="6192010" z="61" sx="0.01" sy="0.01" sz="0.02"/></marker>
    <marker id="1" label="M2"><reference x="720010" y="6192000" z="62" enabled="false"/></marker>
    <marker id="2" label="bare"/>
  </markers>
  <frames><frame id="0"><markers>
    <marker marker_id="0">
      <location camera_id="0" pinned="true" x="10.5" y="20.5"/>
      <location camera_id="1" pinned="true" x="0" y="600"/>
    </marker>
    <marker marker_id="1"><location camera_id="2" pinned="true" x="1" y="2"/></marker>
    <marker marker_id="2"><location camera_id="0" pinned="true" x="1" y="2"/></marker>
  </markers></frame></frames>
</chunk></document>
"""


def marks_of(points: dict[str, ProjectControlPoint], name: str) -> dict[str, tuple[float, ...]]:
    """The marks of a point by their photographs."""
    indices, pixels = points[name].mark_photograph.tolist(), points[name].mark_pixel.tolist()
    return {f"{'abc'[i]}.jpg": tuple(pixel) for i, pixel in zip(indices, pixels, strict=True)}


@pytest.mark.parametrize("origin", ["photogram", "matlab"])
def test_metashape_markers_are_points_and_marks(folder: Path, origin: str) -> None:
    (folder / "markers.xml").write_text(MARKERS)
    change(folder, "project.yaml", ("gcp_list.txt\n      picture_size_px: [4000, 3000]", "markers.xml"))
    change(folder, "project.yaml", ("  mark_sigma_px: 1\n", f"  mark_sigma_px: 1\n  pixel_origin: {origin}\n"))
    project = read(folder)
    points = points_of(project)
    assert marks_of(points, "M1") == {"a.jpg": (10.0, 20.0), "b.jpg": (-0.5, 599.5)}  # whatever pixel_origin says
    assert points["M1"].sigma_m.tolist() == [0.01, 0.01, 0.02]
    assert points["M2"].sigma_m.tolist() == [0.02, 0.02, 0.03]
    assert (points["M1"].role, points["M2"].role) == ("control", "check")
    said = [str(warning) for warning in project.warnings]
    assert any("markers.xml: marks of 1 point (bare) without coordinates are left out" in text for text in said)
    assert any("1 of 3 marks is in a photograph that is not in the project" in text for text in said)
    assert any("elsewhere (1)" in text for text in said)


def test_pix4d_marks_beside_a_table_of_points(folder: Path) -> None:
    (folder / "pix4d.txt").write_text("D:\\day 1\\A.JPG,C1,10.5,20.5,1.2\nb.jpg,C1,30.25,40,1.2\nc.jpg,C2,1,2,1\n")
    change(folder, "project.yaml", ("      marks: marks.csv\n      sigma_m", "      marks: pix4d.txt\n      sigma_m"))
    change(folder, "marks.csv", ("C1,a.jpg,10,20,\n", ""), ("C2,c.jpg,399,299,\n", ""))
    points = points_of(read(folder))
    assert marks_of(points, "C1") == {"a.jpg": (10.0, 20.0), "b.jpg": (29.75, 39.5)}
    assert rms_sigma_px(points["C1"].mark_covariance_px2).tolist() == [0.5, 0.5]


def test_two_photographs_of_a_file_are_never_one_of_the_project(folder: Path) -> None:
    (folder / "pix4d.txt").write_text("day1/b.png,C1,10.5,20.5\nday2/b.png,C1,30.25,40\nc.jpg,C2,1,2\n")
    change(folder, "project.yaml", ("      marks: marks.csv\n      sigma_m", "      marks: pix4d.txt\n      sigma_m"))
    change(folder, "marks.csv", ("C1,a.jpg,10,20,\n", ""), ("C2,c.jpg,399,299,\n", ""))
    project = read(folder)
    assert marks_of(points_of(project), "C1") == {}
    assert any("day1/b.png (1), day2/b.png (1)" in str(warning) for warning in project.warnings)


def test_the_table_of_marking_brings_its_sigmas_and_its_pixels(folder: Path) -> None:
    marks = [
        Mark("C1", "a.jpg", (10.25, 20.0), (0.3, 0.4), 0.1, "checker"),
        Mark("C2", "c.jpg", (1.0, 2.0)),
        Mark("K1", "b.jpg", (50.0, 60.0), (0.2, 0.2)),
    ]
    write_marks(folder / "marks.csv", marks)
    change(folder, "project.yaml", ("  mark_sigma_px: 1\n", "  mark_sigma_px: 1\n  pixel_origin: matlab\n"))
    points = points_of(read(folder))
    assert marks_of(points, "C1") == {"a.jpg": (10.25, 20.0)}
    sigmas = {name: rms_sigma_px(points[name].mark_covariance_px2).tolist() for name in ("C1", "C2", "K1")}
    assert sigmas == {"C1": [pytest.approx((0.125) ** 0.5)], "C2": [0.5], "K1": [pytest.approx(0.2)]}
    shared = 0.1 * (0.3 * 0.4)
    assert points["C1"].mark_covariance_px2[0].tolist() == [[0.3 * 0.3, shared], [shared, 0.4 * 0.4]]
    block = read(folder).control_points_in(LocalFrame("EPSG:25832", (0.0, 0.0, 0.0), "grid"))
    of_block = {block.name[g]: c for g, c in zip(block.mark_point, block.mark_covariance_px2, strict=True)}
    np.testing.assert_array_equal(of_block["C1"], points["C1"].mark_covariance_px2[0])
    np.testing.assert_array_equal(of_block["C2"], 0.25 * np.eye(2))


def test_marks_of_the_page_replace_those_of_a_gcp_list_in_the_photographs_own_pixels(folder: Path) -> None:
    change(folder, "project.yaml", ("      picture_size_px: [4", "      marks: marks.csv\n      picture_size_px: [4"))
    before = marks_of(points_of(read_with_table(folder, [])), "G1")
    made = Mark("G1", "a.jpg", (11.5, 12.5), (0.1, 0.1), kind="checker", time="2026-05-01T10:20:30Z")
    taken_over = Mark("G1", "c.jpg", (1.0, 2.0), kind="imported")
    added = Mark("new", "a.jpg", (1.0, 2.0), (1.0, 1.0))
    project = read_with_table(folder, [made, taken_over, added, Mark("L1", "a.jpg", (1.0, 2.0), kind="imported")])
    points = points_of(project)
    assert marks_of(points, "G1") == {"a.jpg": (11.5, 12.5), "c.jpg": before["c.jpg"]}
    assert sorted(rms_sigma_px(points["G1"].mark_covariance_px2).tolist()) == [pytest.approx(0.1), 1.0]
    (said,) = [str(w) for w in project.warnings if "no table has" in str(w)]
    assert "marks.csv: marks of 1 point (new) that no table has are left out" in said
    assert "add them to gcp_list.txt, with coordinates" in said
    removed = Mark("G1", "c.jpg", (1.0, 2.0), kind="removed")
    assert set(marks_of(points_of(read_with_table(folder, [removed])), "G1")) == {"a.jpg"}


def read_with_table(folder: Path, marks: list[Mark]) -> Project:
    """The project with this table of the page, which holds all other marks of the table as well."""
    others = [Mark("C1", "a.jpg", (10.0, 20.0)), Mark("C2", "c.jpg", (399.0, 299.0)), Mark("K1", "a.jpg", (30.0, 40.0))]
    write_marks(folder / "marks.csv", [*others, *marks])
    return read(folder)


@pytest.mark.parametrize("content", [None, "", "point,photograph,u,v,raw_u,raw_v\n"])
def test_a_table_that_nobody_has_marked_in_yet_is_no_error_and_a_misspelt_one_is(
    folder: Path, content: str | None
) -> None:
    (folder / "marks.csv").unlink()
    if content is not None:
        (folder / "marks.csv").write_text(content)
    project = read(folder)
    assert marks_of(points_of(project), "C1") == {}
    change(folder, "project.yaml", ("      marks: marks.csv\n      sigma_m", "      marks: mraks.csv\n      sigma_m"))
    assert any("mraks.csv:1: cannot be read" in fault for fault in faults(folder))


def test_proposals_are_refused(folder: Path) -> None:
    write_proposals(folder / "marks.csv", [Proposal(Mark("C1", "a.jpg", (10.0, 20.0)), 0.5)])
    found = [line for line in faults(folder) if "proposals" in line]
    assert "marks.csv:1: holds proposals, which are no marks yet: confirm them" in found[0]


# ---- units that columns state --------------------------------------------------------------------------------------


def test_units_in_the_header_are_converted_exactly_and_said(folder: Path) -> None:
    metric = read(folder)
    plain = {p.name: p for p in metric.control_points}
    foot, survey_foot = 0.3048, 1200.0 / 3937.0
    rows = (
        "name,Easting (US survey feet),northing_ftUS,Elevation (ft),sigma_plan (mm),role\n"
        f"C1,{720010 / survey_foot!r},{6192000 / survey_foot!r},{63 / foot!r},,\n"
        f"C2,{720010 / survey_foot!r},{6192020 / survey_foot!r},{64 / foot!r},10,check\n"
    )
    (folder / "control.csv").write_text(rows)
    (folder / "check.csv").write_text(f"name;lon;lat;height [feet]\nK1;12.5116;55.8231;{65 / foot!r}\n")
    project = read(folder)
    for point in project.control_points:
        np.testing.assert_allclose(point.position_map_m, plain[point.name].position_map_m, rtol=0, atol=1e-6)
        np.testing.assert_allclose(point.sigma_m, plain[point.name].sigma_m, rtol=1e-12)
    said = [str(w) for w in project.warnings if w not in metric.warnings]
    assert len(said) == 2
    assert "control.csv: easting and northing in US survey feet and heights in feet, as its columns say" in said[0]
    assert "check.csv: heights in feet, as its columns say" in said[1]


def test_metres_in_the_header_change_nothing(folder: Path) -> None:
    before = read(folder)
    change(folder, "control.csv", ("easting,northing,height", "easting (m),northing [m],height_m"))
    after = read(folder)
    assert [str(w) for w in after.warnings] == [str(w) for w in before.warnings]
    for old, new in zip(before.control_points, after.control_points, strict=True):
        np.testing.assert_array_equal(old.position_map_m, new.position_map_m)


# ---- names of photographs as others write them ---------------------------------------------------------------------


def test_marks_are_joined_to_photographs_by_any_name_that_fits_one(folder: Path) -> None:
    before = read(folder)
    change(folder, "gcp_list.txt", ("a.jpg", "A.JPG"), ("c.jpg", "D:\\flight\\c.jpg"), ("b.jpg", "photographs/b"))
    after = read(folder)
    assert after.warnings == before.warnings
    for old, new in zip(before.control_points, after.control_points, strict=True):
        np.testing.assert_array_equal(old.mark_photograph, new.mark_photograph)


def test_a_name_that_fits_two_photographs_is_not_guessed(folder: Path) -> None:
    for name in ("east", "west"):
        (folder / "images" / name).mkdir()
        (folder / "images" / name / "d.jpg").touch()
    listed = "    - {name: east/d.jpg}\n    - {name: west/d.jpg}\n    - {name: b.jpg}\n"
    change(folder, "project.yaml", ("    - {name: b.jpg}\n", listed))
    change(folder, "gcp_list.txt", ("a.jpg", "d.jpg"))
    (said,) = [w for w in read(folder).warnings if "d.jpg" in w.text]
    assert said.remedy == "did you mean east/d.jpg or west/d.jpg? Write the folder too"
