import contextlib
import importlib
import json
import re
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from makers import SharedData, no_matlab
from pages import blocks, blocks_in, text_of

from photogram.adjustment.problem import AdjustmentSettings
from photogram.camera import Camera
from photogram.errors import ImageError, ProjectError
from photogram.files.maps.seam_files import NamedPolygon, write_seams
from photogram.files.tables.control_files import read_marks, read_points
from photogram.geodesy.frames import LocalFrame
from photogram.project.project import Project, read_project
from photogram.projection import PARAMETER_NAMES
from photogram.sfm.tie_points.detector import FeatureSettings
from photogram.survey import rms_sigma_px

EXAMPLE = Path(__file__).parents[2] / "examples" / "dtu_phantom4" / "project.yaml"

GOOD = """\
photogram: 1
crs: EPSG:25832
world: grid
cameras:
  phantom4:
    width_px: 5472
    height_px: 3648
    focal_px: 3674.19518
    principal_point_px: [2741.9, 1838.1]
    radial: [-0.261203, 0.107443, -0.0356483]
    tangential: [-1.12104e-3, 8e-4]
    pixel_origin: matlab
    sigmas: {focal_px: 30, principal_point_px: free, k1: 1e-3}
  small:
    width_px: 1000
    height_px: 800
    focal_px: 900
    principal_point_px: [499.5, 399.5]
photographs:
  folder: images
  camera: phantom4
  gnss_sigma_m: [0.02, 0.02, 0.03]
  list:
    - name: a.jpg
      gnss_m: [719957.478837, 6191969.555072, 124.510072]
      attitude_deg: {yaw: 209.7, pitch: -90, roll: 0}
      attitude_sigma_deg: 3
      flight: "7"
    - name: b.jpg
      gnss_m: [719953.608322, 6191961.631379, 124.520072]
      gnss_sigma_m: [0.1, 0.2, 0.3]
    - name: c.jpg
      camera: small
gnss:
  offset_sigma_m: [0.2, 0.2, 0]
control_points:
  sigma_m: [0.02, 0.02, 0.03]
  mark_sigma_px: 1.5
  pixel_origin: colmap
  list:
    - name: P1
      position_m: [719970.70, 6191955.16, 69.59]
      marks: {a.jpg: [1622, 1321], b.jpg: [1292, 1309]}
    - name: 2
      role: check
      position_m: [719939.94, 6191966.88, 69.27]
      sigma_m: [0.01, 0.01, 0.01]
      mark_sigma_px: 0.5
      marks:
        a.jpg: [3745, 1239]
    - name: 003
      position_m: [719978.34, 6191972.15, 71.10]
      marks: {c.jpg: [1000, 800]}
adjustment: {robust_loss: cauchy, maximum_rounds: 3}
comparison: {reference: reference.txt}
results: out/results
work: out/work
"""


@pytest.fixture
def survey(tmp_path: Path) -> Path:
    (tmp_path / "images").mkdir()
    for name in ("a.jpg", "b.jpg", "c.jpg"):
        (tmp_path / "images" / name).touch()
    (tmp_path / "reference.txt").touch()
    (tmp_path / "project.yaml").write_text(GOOD)
    return tmp_path


def read(survey: Path, text: str | None = None) -> Project:
    path = survey / "project.yaml"
    if text is not None:
        path.write_text(text)
    return read_project(path, read_matlab_camera=no_matlab)


def faults(survey: Path, text: str) -> list[str]:
    """The faults of a project file as ``line: message``."""
    with pytest.raises(ProjectError) as raised:
        read(survey, text)
    path = survey / "project.yaml"
    lines = str(raised.value).splitlines()
    if len(lines) > 1:
        assert lines[0] == f"{path} has {len(lines) - 1} errors:"
        lines = lines[1:]
    assert all(line.startswith(f"{path}:") for line in lines)
    return [line.removeprefix(f"{path}:") for line in lines]


def line_of(text: str, part: str) -> int:
    """The number of the only line that holds ``part``."""
    numbers = [i for i, line in enumerate(text.splitlines(), 1) if part in line]
    assert len(numbers) == 1, (part, numbers)
    return numbers[0]


# -- a good file ------------------------------------------------------------------------------------------------------


def test_every_value_of_a_good_file_arrives(survey: Path) -> None:
    project = read(survey)
    assert (project.crs, project.world_kind, project.path) == ("EPSG:25832", "grid", survey / "project.yaml")
    phantom, small = project.cameras
    assert (phantom.name, phantom.width_px, phantom.height_px, phantom.focal_px) == ("phantom4", 5472, 3648, 3674.19518)
    np.testing.assert_allclose(phantom.principal_point_px, [2740.9, 1837.1], atol=1e-9)
    assert phantom.radial.tolist() == [-0.261203, 0.107443, -0.0356483, 0.0]
    assert phantom.tangential.tolist() == [-1.12104e-3, 8e-4]
    assert phantom.sigmas.tolist() == [30.0, np.inf, np.inf, 1e-3, *[0.0] * 8]
    assert small.principal_point_px.tolist() == [499.5, 399.5]
    assert not small.radial.any()
    assert not small.sigmas.any()

    a, b, c = project.photographs
    assert [(p.name, p.path, p.camera, p.flight) for p in (a, b, c)] == [
        ("a.jpg", survey / "images" / "a.jpg", 0, "7"),
        ("b.jpg", survey / "images" / "b.jpg", 0, "1"),
        ("c.jpg", survey / "images" / "c.jpg", 1, "1"),
    ]
    assert a.gnss_map_m is not None
    assert a.gnss_map_m.tolist() == [719957.478837, 6191969.555072, 124.510072]
    assert a.gnss_sigma_m is not None
    assert a.gnss_sigma_m.tolist() == [0.02, 0.02, 0.03]
    assert (a.attitude_deg, a.attitude_sigma_deg) == ((209.7, -90.0, 0.0), 3.0)
    assert b.gnss_sigma_m is not None
    assert b.gnss_sigma_m.tolist() == [0.1, 0.2, 0.3]
    assert (b.attitude_deg, c.gnss_map_m) == (None, None)

    first, second, third = project.control_points
    assert [(p.name, p.role) for p in project.control_points] == [("P1", "control"), ("2", "check"), ("003", "control")]
    assert first.position_map_m.tolist() == [719970.70, 6191955.16, 69.59]
    assert first.sigma_m.tolist() == [0.02, 0.02, 0.03]
    assert first.mark_photograph.tolist() == [0, 1]
    assert first.mark_pixel.tolist() == [[1621.5, 1320.5], [1291.5, 1308.5]]
    assert rms_sigma_px(first.mark_covariance_px2).tolist() == [1.5, 1.5]
    assert (second.sigma_m.tolist(), rms_sigma_px(second.mark_covariance_px2).tolist()) == ([0.01, 0.01, 0.01], [0.5])
    assert third.mark_pixel.tolist() == [[999.5, 799.5]]

    assert project.gnss_offset_sigma_m.tolist() == [0.2, 0.2, 0.0]
    assert project.adjustment == AdjustmentSettings(robust_loss="cauchy", maximum_rounds=3)
    assert project.features == FeatureSettings()
    assert project.reference == survey / "reference.txt"
    assert (project.results, project.work) == (survey / "out" / "results", survey / "out" / "work")


def test_control_points_in_the_world_keep_their_marks(survey: Path) -> None:
    project = read(survey)
    points = project.control_points_in(LocalFrame("EPSG:25832", (719900.0, 6191900.0, 0.0), "grid"))
    assert points.name == ("P1", "2", "003")
    np.testing.assert_allclose(points.position_world_m[0], [70.70, 55.16, 69.59], atol=1e-9)
    assert points.mark_photograph.tolist() == [0, 1, 0, 2]
    assert points.mark_point.tolist() == [0, 0, 1, 2]
    assert points.mark_sigma_px.tolist() == [1.5, 1.5, 0.5, 1.5]
    check = points.with_role("check")
    assert check.name == ("2",)
    assert check.mark_pixel.tolist() == [[3744.5, 1238.5]]


def test_assumed_sigmas_of_all_points_are_those_of_points_that_have_no_own(survey: Path) -> None:
    frame = LocalFrame("EPSG:25832", (719900.0, 6191900.0, 0.0), "grid")
    stated = read(survey).control_points_in(frame)
    assert not stated.sigma_assumed.any()
    assert not stated.mark_sigma_assumed.any()
    text = GOOD.replace(
        "  mark_sigma_px: 1.5\n", "  sigma_assumed: true\n  mark_sigma_px: 1.5\n  mark_sigma_assumed: true\n"
    )
    points = read(survey, text).control_points_in(frame)
    assert points.name == ("P1", "2", "003")
    assert points.sigma_assumed.tolist() == [True, False, True]
    assert points.mark_sigma_assumed.tolist() == [True, False, True]
    assert points.with_role("check").sigma_assumed.tolist() == [False]
    np.testing.assert_array_equal(points.sigma_m, stated.sigma_m)


def test_least_file_takes_all_photographs_of_the_folder(survey: Path) -> None:
    (survey / "images" / "notes.txt").touch()
    camera = "{width_px: 9, height_px: 9, focal_px: 9, principal_point_px: [4, 4]}"
    text = f"photogram: 1\ncrs: EPSG:25832\ncameras: {{only: {camera}}}\nphotographs: {{folder: images}}\nsurface:\n"
    project = read(survey, text)
    assert [p.name for p in project.photographs] == ["a.jpg", "b.jpg", "c.jpg"]
    assert {p.camera for p in project.photographs} == {0}
    assert project.world_kind == "tangent"
    assert project.control_points == ()
    empty = project.control_points_in(LocalFrame("EPSG:25832", (7e5, 6e6, 0.0)))
    assert (len(empty), empty.mark_pixel.shape) == (0, (0, 2))


def test_command_line_replaces_the_folder(survey: Path) -> None:
    (survey / "images").rename(survey / "elsewhere")
    project = read_project(survey / "project.yaml", survey / "elsewhere", read_matlab_camera=no_matlab)
    assert project.photographs[1].path == survey / "elsewhere" / "b.jpg"


MATLAB = re.sub(
    r"    focal_px: 3674.*?matlab\n", "    matlab: cam.mat\n    pixel_origin: matlab\n", GOOD, flags=re.DOTALL
)


def test_matlab_camera_comes_from_its_reader(survey: Path) -> None:
    (survey / "cam.mat").touch()
    (survey / "project.yaml").write_text(MATLAB)

    def reader(path: Path, name: str, width_px: int, height_px: int, origin: Literal["photogram", "matlab"]) -> Camera:
        assert (path, name, width_px, height_px, origin) == (survey / "cam.mat", "phantom4", 5472, 3648, "matlab")
        return Camera(name, width_px, height_px, 3600.0, np.array([2700.0, 1800.0]))

    camera = read_project(survey / "project.yaml", read_matlab_camera=reader).cameras[0]
    assert camera.focal_px == 3600.0
    assert camera.sigmas.tolist() == [30.0, np.inf, np.inf, 1e-3, *[0.0] * 8]


def test_matlab_reader_fault_gets_its_line(survey: Path) -> None:
    (survey / "cam.mat").touch()
    (survey / "project.yaml").write_text(MATLAB)

    def reader(path: Path, *_: object) -> Camera:
        raise ImageError(f"{path.name} holds no K")

    with pytest.raises(ProjectError, match=r":8: cameras\.phantom4\.matlab: cam\.mat holds no K$"):
        read_project(survey / "project.yaml", read_matlab_camera=reader)


finite = st.floats(allow_nan=False, allow_infinity=False, min_value=-9e5, max_value=9e5)


@settings(max_examples=40, deadline=None)
@given(
    offset=st.tuples(finite, finite, st.floats(-400, 400)),
    u=st.floats(-0.5, 5471.5),
    k=st.floats(-1, 1),
    name=st.text(st.characters(categories=("L", "N", "P", "Zs")), min_size=1).filter(
        lambda s: s.strip() != "" and s.isprintable()
    ),
)
def test_round_trip_of_any_figures_and_names(
    tmp_path_factory: pytest.TempPathFactory, offset: tuple[float, float, float], u: float, k: float, name: str
) -> None:
    folder = tmp_path_factory.mktemp("round")
    (folder / "a.jpg").touch()
    position = [600_000.0 + offset[0] / 10, 6_000_000.0 + offset[1] / 10, offset[2]]
    camera = {"width_px": 5472, "height_px": 3648, "focal_px": 4e3, "principal_point_px": [1, 2], "radial": [k, 0, k]}
    points = [{"name": name, "position_m": position, "marks": {"a.jpg": [u, 3.0]}}]
    content = {
        "photogram": 1,
        "crs": "EPSG:25832",
        "cameras": {name: camera},
        "photographs": {"folder": ".", "list": [{"name": "a.jpg"}]},
        "control_points": {"sigma_m": [1, 1, 1], "mark_sigma_px": 1, "list": points},
    }
    (folder / "project.yaml").write_text(yaml.safe_dump(content, allow_unicode=True), encoding="utf-8")
    project = read_project(folder / "project.yaml", read_matlab_camera=no_matlab)
    assert project.cameras[0].name == project.control_points[0].name == name
    assert project.cameras[0].radial.tolist() == [k, 0.0, k, 0.0]
    assert project.control_points[0].position_map_m.tolist() == position
    assert project.control_points[0].mark_pixel.tolist() == [[u, 3.0]]


# -- camera models ----------------------------------------------------------------------------------------------------


def test_a_fisheye_with_all_its_terms(survey: Path) -> None:
    text = GOOD.replace(
        "    focal_px: 900\n", "    focal_px: 900\n    model: fisheye\n    radial: [0.01, -0.02, 0.003, -4e-4]\n"
    )
    text = text.replace("    focal_px: 900\n", "    focal_px: 900\n    affinity: [1.5, -0.5]\n")
    text = text.replace("[499.5, 399.5]", "[499.5, 399.5]\n    sigmas: {k4: 1e-4, b1: 2, b2: free}")
    brown, fisheye = read(survey, text).cameras
    assert (brown.model, fisheye.model) == ("brown", "fisheye")
    assert not brown.affinity.any()
    assert fisheye.radial.tolist() == [0.01, -0.02, 0.003, -4e-4]
    assert fisheye.affinity.tolist() == [1.5, -0.5]
    sigmas = dict(zip(PARAMETER_NAMES, fisheye.sigmas.tolist(), strict=True))
    assert {name: sigma for name, sigma in sigmas.items() if sigma} == {"k4": 1e-4, "b1": 2.0, "b2": np.inf}


@pytest.mark.parametrize("radial", [[0.1, 0.2], [0.1, 0.2, 0.3], [0.1, 0.2, 0.3, 0.4]])
def test_two_to_four_radial_terms(survey: Path, radial: list[float]) -> None:
    text = GOOD.replace("[-0.261203, 0.107443, -0.0356483]", str(radial))
    assert read(survey, text).cameras[0].radial.tolist() == [*radial, 0.0, 0.0][:4]


def test_a_camera_per_flight(survey: Path) -> None:
    text = GOOD.replace(
        "    pixel_origin: matlab\n", "    pixel_origin: matlab\n    per_flight: true\n    source: tags\n"
    )
    project, plain = read(survey, text), read(survey, GOOD)
    assert [c.name for c in project.cameras] == ["phantom4 (flight 7)", "phantom4 (flight 1)", "small"]
    assert [p.camera for p in project.photographs] == [0, 1, 2]
    assert project.camera_source == ("tags", "tags", "")
    assert len(project.calibration) == 3
    for copy in project.cameras[:2]:
        np.testing.assert_array_equal(copy.parameters, plain.cameras[0].parameters)
        np.testing.assert_array_equal(copy.sigmas, plain.cameras[0].sigmas)
    text = GOOD.replace("    height_px: 800\n", "    height_px: 800\n    per_flight: true\n").replace(
        "      camera: small\n", ""
    )
    assert [c.name for c in read(survey, text).cameras] == ["phantom4", "small"], "no photograph, no copy"


# -- the example ------------------------------------------------------------------------------------------------------


def test_example_loads(tmp_path: Path) -> None:
    for number in (67, 68, 100):
        (tmp_path / f"100_0002_{number:04d}.JPG").touch()
    project = read_project(EXAMPLE, tmp_path, read_matlab_camera=no_matlab)
    assert (project.world_kind, project.crs) == ("grid", "EPSG:25832")
    assert [len(p.mark_photograph) for p in project.control_points] == [1] * 12
    assert np.bincount(
        project.control_points_in(LocalFrame("EPSG:25832", (0, 0, 0), "grid")).mark_photograph
    ).tolist() == [
        4,
        4,
        4,
    ]
    assert project.cameras[0].sigmas.tolist() == [30.0, *[0.0] * 11]


def test_example_agrees_with_the_data(shared_data: SharedData) -> None:
    pytest.importorskip("matio", reason='mat-io is not installed: "photogram[matlab]"')
    data = shared_data("dtu_phantom4")
    matlab = importlib.import_module("photogram.files.matlab")
    project = read_project(EXAMPLE, data / "images", read_matlab_camera=matlab.read_camera)
    camera = matlab.read_camera(data / "DJI_Phantom4_cam.mat", "phantom4", 5472, 3648, "photogram")
    np.testing.assert_allclose(project.cameras[0].parameters, camera.parameters, rtol=1e-15)
    rows = [line.split(",") for line in (data / "gcp_tables.csv").read_text().splitlines()[2:]]
    assert len(rows) == len(project.control_points)
    for row, point in zip(rows, project.control_points, strict=True):
        photograph = project.photographs[int(point.mark_photograph[0])].name
        assert [photograph, point.name] == row[:2]
        assert [*point.position_map_m, *point.mark_pixel[0]] == [float(v) for v in row[2:]]
    table = dict(line.split("\t", 1) for line in (data / "camera_positions.txt").read_text().splitlines()[2:])
    for photo in project.photographs:
        assert photo.gnss_map_m is not None
        assert photo.gnss_map_m.tolist() == [float(v) for v in table[photo.name].split("\t")[:3]]


def test_full_example_of_the_documentation(tmp_path: Path) -> None:
    (tmp_path / "project.yaml").write_text(blocks("yaml", "docs/project-file.md")[0].code)
    (tmp_path / "images").mkdir()
    (tmp_path / "masks").mkdir()
    photographs = ("images/100_0002_0067.JPG", "images/100_0002_0068.JPG", "masks/100_0002_0067_mask.png")
    for name in (*photographs, "gear.png", "m300.mat", "reference.tif"):
        (tmp_path / name).touch()
    (tmp_path / "gcp_list.txt").write_text("EPSG:25832\n719970 6191960 70 2000 1000 100_0002_0067.JPG G1\n")
    (tmp_path / "check.csv").write_text("name,lon,lat,height\nK1,12.5114,55.823,70\n")
    (tmp_path / "marks.csv").write_text("name,photograph,u,v\nK1,100_0002_0068.JPG,100,200\n")
    (tmp_path / "ppk.csv").write_text(
        "photo,lon,lat,h,sde,sdn,sdu,Q\n100_0002_0067,12.5114,55.823,124,0.01,0.01,0.02,1\n"
    )
    line = "67 1.5 [2100] 1,N 2,E 190,V 55.823,Lat 12.5114,Lon 124.5,Ellh 0.01, 0.01, 0.02 50,Q\n"
    (tmp_path / "images" / "100_0002_Timestamp.MRK").write_text(line)

    def reader(path: Path, name: str, width_px: int, height_px: int, _: str) -> Camera:
        assert path.name == "m300.mat"
        return Camera(name, width_px, height_px, 3600.0, np.array([2640.0, 1978.0]))

    project = read_project(tmp_path / "project.yaml", read_matlab_camera=reader)
    assert [camera.name for camera in project.cameras] == ["phantom4", "m300"]
    assert [p.camera for p in project.photographs] == [0, 1]
    assert [[path.name for path in paths] for paths in project.masks.files] == [
        ["100_0002_0067_mask.png", "gear.png"],
        [],
    ]
    assert [p.name for p in project.control_points] == ["67-1", "C2", "G1", "K1"]
    assert [p.role for p in project.control_points] == ["control", "check", "control", "check"]


def test_tables_of_the_documentation(tmp_path: Path) -> None:
    text = text_of("docs/project-file.md").split("## Ground points from files")[1]
    for name, block in zip(("gcp_list.txt", "points.csv", "marks.csv"), blocks_in(text), strict=False):
        (tmp_path / name).write_text(block.code)
    assert [p.name for p in read_points(tmp_path / "gcp_list.txt").points] == ["67-1"]
    assert [p.role for p in read_points(tmp_path / "points.csv").points] == [("check", "check"), None]
    assert [m.sigma_px for m in read_marks(tmp_path / "marks.csv")] == [(0.5, 0.5), None]


# -- faults: each with its exact line ---------------------------------------------------------------------------------

Change = tuple[str, str]
FAULTS: dict[str, tuple[Change, str, str]] = {
    "unknown key": (
        ("world: grid", "wrld: grid"),
        "wrld: grid",
        "wrld: unknown key: did you mean 'world'?",
    ),
    "unknown key far from all": (
        ("  offset_sigma_m: [0.2, 0.2, 0]", "  zzz: 3"),
        "zzz: 3",
        "gnss.zzz: unknown key: allowed here: lever_arm_axes, lever_arm_m, lever_arm_per_flight_m, offset_sigma_m",
    ),
    "unknown key in a list item": (
        ('flight: "7"', 'fligth: "7"'),
        "fligth",
        "photographs.list[a.jpg].fligth: unknown key: did you mean 'flight'?",
    ),
    "unknown key in settings": (
        ("maximum_rounds: 3", "maximum_round: 3"),
        "maximum_round",
        "adjustment.maximum_round: unknown key: did you mean 'maximum_rounds'?",
    ),
    "text for a number": (
        ("width_px: 1000", "width_px: wide"),
        "wide",
        "cameras.small.width_px: must be a whole number, found the text 'wide'",
    ),
    "decimal comma": (
        ("focal_px: 900", "focal_px: 900,5"),
        "900,5",
        "cameras.small.focal_px: must be a number, found the text '900,5' (write 900.5, with a decimal point)",
    ),
    "boolean for a number": (
        ("focal_px: 900", "focal_px: true"),
        "true",
        "cameras.small.focal_px: must be a number, found true",
    ),
    "fraction for a whole number": (
        ("width_px: 1000", "width_px: 1000.5"),
        "1000.5",
        "cameras.small.width_px: must be a whole number, found 1000.5",
    ),
    "missing": (
        ("    height_px: 800\n", ""),
        "  small:",
        "cameras.small.height_px: is missing: give the height of its photographs in pixels",
    ),
    "missing calibration": (
        ("    focal_px: 900\n", ""),
        "  small:",
        "cameras.small.focal_px: is missing: give focal_px, or matlab: FILE.mat with the calibration",
    ),
    "missing at the top": (
        ("crs: EPSG:25832\n", ""),
        "photogram: 1",
        "crs: is missing: give the map grid, crs: EPSG:25832 for example",
    ),
    "another format": (
        ("photogram: 1", "photogram: 2"),
        "photogram: 2",
        "photogram: format 2 is not supported: this version reads photogram: 1",
    ),
    "block where a word stands": (
        ("gnss:\n  offset_sigma_m: [0.2, 0.2, 0]", "gnss: none"),
        "gnss: none",
        "gnss: needs a mapping of keys, found the text 'none'",
    ),
    "settings are no block": (
        ("adjustment: {robust_loss: cauchy, maximum_rounds: 3}", "adjustment: fast"),
        "adjustment: fast",
        "adjustment: needs a mapping of keys, found the text 'fast'",
    ),
    "settings that contradict each other": (
        ("maximum_rounds: 3}", "maximum_rounds: 3}\ndense:\n  large_step: 5\n  small_step: 9"),
        "small_step: 9",
        "dense.small_step: must be below large_step, 5, found 9",
    ),
    "setting out of a range that another one sets": (
        ("maximum_rounds: 3}", "maximum_rounds: 3}\nfeatures:\n  tile_px: 1024\n  overlap_px: 600"),
        "overlap_px: 600",
        "features.overlap_px: must be from 16 to 512, found 600",
    ),
    "setting narrower than what is possible": (
        ("maximum_rounds: 3}", "maximum_rounds: 3}\northophoto: {feather_cells: 9000}"),
        "feather_cells: 9000",
        "orthophoto.feather_cells: must be from 0 to 8 cells, found 9000",
    ),
    "language that there is not": (
        ("maximum_rounds: 3}", "maximum_rounds: 3}\nreport: {language: it}"),
        "language: it",
        "report.language: must be en, de, es, pt or fr, found the text 'it'",
    ),
    "role": (
        ("role: check", "role: chek"),
        "role: chek",
        "control_points.list[2].role: must be control or check, found the text 'chek': did you mean 'check'?",
    ),
    "two numbers for three": (
        ("[0.2, 0.2, 0]", "[0.2, 0.2]"),
        "[0.2, 0.2]",
        "gnss.offset_sigma_m: needs 3 numbers [easting, northing, height], found [0.2, 0.2]",
    ),
    "not finite": (
        ("71.10]", ".nan]"),
        ".nan]",
        "control_points.list[003].position_m: height must be a finite number, found nan",
    ),
    "infinite setting": (
        ("maximum_rounds: 3", "robust_threshold: .inf"),
        ".inf",
        "adjustment.robust_threshold: must be a finite number, found inf",
    ),
    "sigma of control": (
        ("sigma_m: [0.01, 0.01, 0.01]", "sigma_m: [0.01, 0, -1]"),
        "[0.01, 0, -1]",
        "control_points.list[2].sigma_m: northing must be from 1e-05 to 10000 m, found 0; height "
        "must be from 1e-05 to 10000 m, found -1",
    ),
    "sigma of marks": (
        ("mark_sigma_px: 1.5", "mark_sigma_px: 0"),
        "mark_sigma_px: 0\n",
        "control_points.mark_sigma_px: must be from 0.0001 to 1000 px, found 0",
    ),
    "no sigma of control": (
        ("  sigma_m: [0.02, 0.02, 0.03]\n  mark", "  mark"),
        "- name: P1",
        "control_points.list[P1]: the point has no standard deviation: give sigma_m, here or for all points",
    ),
    "no sigma of gnss": (
        ("  gnss_sigma_m: [0.02, 0.02, 0.03]\n", ""),
        "gnss_m: [719957",
        "photographs.list[a.jpg].gnss_m: has no standard deviation: give gnss_sigma_m, here or for all photographs",
    ),
    "sigma of a parameter": (
        ("principal_point_px: free", "principal_point_px: loose"),
        "loose",
        "cameras.phantom4.sigmas.principal_point_px: must be 0 (held fixed), a prior sigma from 1e-12 to 1000000, or "
        "free, found the text 'loose'",
    ),
    "number for a name": (
        ("name: 003", "name: 1.10"),
        "name: 1.10",
        'control_points.list[#3].name: must be text, found 1.1: write it in quotes, "1.10" for example',
    ),
    "principal point": (
        ("[499.5, 399.5]", "[499.5, 3990.5]"),
        "3990.5",
        "cameras.small.principal_point_px: the principal point (499.5, 3990.5) lies outside the photograph of "
        "1000 × 800 px",
    ),
    "one radial term": (
        ("[-0.261203, 0.107443, -0.0356483]", "[-0.261203]"),
        "[-0.261203]",
        "cameras.phantom4.radial: needs 2 to 4 numbers [k1, k2, k3, k4], found [-0.261203]",
    ),
    "model": (
        ("    focal_px: 900\n", "    focal_px: 900\n    model: fish\n"),
        "model: fish",
        "cameras.small.model: must be brown or fisheye, found the text 'fish': did you mean 'fisheye'?",
    ),
    "affinity": (
        ("    focal_px: 900\n", "    focal_px: 900\n    affinity: [-900, 0]\n"),
        "affinity:",
        "cameras.small.affinity: b1 is -900 px: focal_px + b1 must be above 0",
    ),
    "undefined camera": (
        ("camera: small", "camera: smal"),
        "camera: smal",
        "photographs.list[c.jpg].camera: camera 'smal' is not under cameras: did you mean 'small'?",
    ),
    "undefined camera of all": (
        ("  camera: phantom4", "  camera: phantm4"),
        "phantm4",
        "photographs.camera: camera 'phantm4' is not under cameras: did you mean 'phantom4'?",
    ),
    "two photographs of one name": (
        ("- name: b.jpg", "- name: a.jpg #"),
        "a.jpg #",
        "photographs.list[a.jpg].name: 'a.jpg' is used twice, first in line 24: give each its own name",
    ),
    "two points of one name": (
        ("name: 003", "name: P1 #"),
        "P1 #",
        "control_points.list[P1].name: 'P1' is used twice, first in line 41: give each its own name",
    ),
    "mark in an unknown photograph": (
        ("        a.jpg: [3745, 1239]", "        a.JPG: [3745, 1239]"),
        "a.JPG",
        "control_points.list[2].marks.a.JPG: photograph 'a.JPG' is not in the list: did you mean 'a.jpg'?",
    ),
    "mark outside": (
        ("a.jpg: [3745, 1239]", "a.jpg: [3745, 3649]"),
        "3649",
        "control_points.list[2].marks.a.jpg: the mark of 2 at pixel (3745, 3649) is outside the photograph, which is "
        "5472 × 3648 px",
    ),
    "unknown crs": (
        ("EPSG:25832", "EPSG:99999"),
        "EPSG:99999",
        "crs: 'EPSG:99999': not a CRS known to PROJ",
    ),
    "geographic crs": (
        ("EPSG:25832", "EPSG:4326"),
        "EPSG:4326",
        "crs: 'EPSG:4326' (WGS 84) is not a projected CRS",
    ),
    "swapped": (
        ("[719970.70, 6191955.16, 69.59]", "[6191955.16, 719970.70, 69.59]"),
        "[6191955.16, 719970.70",
        "control_points.list[P1].position_m: easting and northing look swapped: found easting 6191955.16, "
        "northing 719970.70",
    ),
    "far away": (
        ("[719978.34, 6191972.15", "[719978.34, 6161972.15"),
        "6161972.15",
        "control_points.list[003].position_m: more than 20 km from the centre of all positions: found easting "
        "719978.34, northing 6161972.15",
    ),
    "outside the crs": (
        ("[719978.34, 6191972.15", "[32719978.34, 6191972.15"),
        "32719978.34",
        "control_points.list[003].position_m: outside the area of use of EPSG:25832 (ETRS89 / UTM zone 32N",
    ),
    "height 9999": (
        ("69.27]", "9999]"),
        " 9999]",
        "control_points.list[2].position_m: height 9999 m is impossible on Earth or a placeholder",
    ),
    "height -9999 of gnss": (
        ("124.520072]", "-9999.0]"),
        "-9999.0]",
        "photographs.list[b.jpg].gnss_m: height -9999 m is impossible on Earth or a placeholder",
    ),
    "height 999": (
        ("69.27]", "999.0]"),
        " 999.0]",
        "control_points.list[2].position_m: height 999 m is impossible on Earth or a placeholder",
    ),
    "height with a digit too many": (
        ("69.27]", "6927]"),
        " 6927]",
        "control_points.list[2].position_m: height 6927 m is 6856 m from the others, about 71.1 m: check its digits",
    ),
    "missing photographs": (
        ("- name: b.jpg", "- name: d.jpg"),
        "folder: images",
        "photographs.folder: 1 of 3 photographs are not in ",
    ),
    "attitude": (
        ("pitch: -90, ", ""),
        "attitude_deg",
        "photographs.list[a.jpg].attitude_deg.pitch: is missing: give the pitch in degrees, -90 straight down",
    ),
    "duplicate key": (
        ("world: grid", "world: grid\ncrs: EPSG:25833"),
        "EPSG:25833",
        "crs: is given twice, first in line 2: keep one of the two",
    ),
    "alias": (
        ("{a.jpg: [1622, 1321], b.jpg: [1292, 1309]}", "{a.jpg: &m [1622, 1321], b.jpg: *m}"),
        "*m}",
        "control_points.list[P1].marks.b.jpg: anchors and aliases (& and *) are not supported",
    ),
    "tag": (
        ("world: grid", "world: !!python/name:os.system grid"),
        "os.system",
        "world: the tag tag:yaml.org,2002:python/name:os.system is not supported",
    ),
    "unprintable": (
        ("name: P1", 'name: "P\\0 1"'),
        "P\\0 1",
        "control_points.list[#1].name: contains a line break or an unprintable character",
    ),
    "no reference": (
        ("reference: reference.txt", "reference: lost.txt"),
        "lost.txt",
        "comparison.reference: file ",
    ),
    "work among results": (
        ("work: out/work", "work: out/./results"),
        "out/./results",
        "work: is the folder of the results too: give the intermediate results their own",
    ),
    "matlab beside figures": (
        ("    focal_px: 900\n", "    focal_px: 900\n    matlab: lost.mat\n    pixel_origin: matlab\n"),
        "focal_px: 900",
        "cameras.small.focal_px: is given here and in lost.mat: keep one of the two",
    ),
}


def changed(change: Change) -> str:
    assert change[0] in GOOD
    return GOOD.replace(change[0], change[1], 1)


@pytest.mark.parametrize("kind", FAULTS)
def test_each_fault_names_line_key_and_remedy(survey: Path, kind: str) -> None:
    change, marker, message = FAULTS[kind]
    text = changed(change)
    number = text[: text.index(marker)].count("\n") + 1
    found = faults(survey, text)
    assert [f for f in found if f.startswith(f"{number}: {message}")], "\n".join(found)
    # b.jpg under another name leaves its mark without a photograph; two points without sigma; two figures and no .mat
    several = {"two photographs of one name": 2, "missing photographs": 2, "no sigma of control": 2}
    several["matlab beside figures"] = 3
    assert len(found) == several.get(kind, 1), "\n".join(found)


TOGETHER = (
    "unknown key",
    "unknown crs",
    "sigma of a parameter",
    "text for a number",
    "undefined camera",
    "unknown key in a list item",
    "height -9999 of gnss",
    "two numbers for three",
    "swapped",
    "role",
    "height 9999",
    "sigma of control",
    "mark outside",
    "two points of one name",
    "unknown key in settings",
    "no reference",
    "work among results",
)


def test_all_faults_of_one_file_at_once_in_the_order_of_lines(survey: Path) -> None:
    text = GOOD
    for kind in TOGETHER:
        old, new = FAULTS[kind][0]
        assert old in text
        text = text.replace(old, new, 1)
    expected = []
    for kind in TOGETHER:
        _, marker, message = FAULTS[kind]
        expected.append((text[: text.index(marker)].count("\n") + 1, message.replace("EPSG:25832", "EPSG:99999")))
    found = faults(survey, text)
    numbers = [int(f.split(":")[0]) for f in found]
    assert numbers == sorted(n for n, _ in expected), "\n".join(found)
    for number, message in expected:
        assert any(f.startswith(f"{number}: {message}") for f in found), (message, "\n".join(found))


def test_single_fault_is_a_single_line(survey: Path) -> None:
    with pytest.raises(ProjectError) as raised:
        read(survey, GOOD.replace("world: grid", "world: flat"))
    assert str(raised.value) == (f"{survey / 'project.yaml'}:3: world: must be tangent or grid, found the text 'flat'")


def test_several_faults_in_one_entry_are_all_found(survey: Path) -> None:
    text = GOOD.replace("role: check", "role: chek").replace("[3745, 1239]", "[9745, 1239]").replace("69.27]", "9999]")
    text = text.replace("name: 2\n", "nam: 2\n")
    words = [re.sub(r"^\d+: control_points\.list\[#2\]\.", "", f) for f in faults(survey, text)]
    assert [w.split(":")[0] for w in words] == ["nam", "name", "role", "position_m", "marks.a.jpg"]


def test_missing_photographs_are_all_named_with_folder_and_option(survey: Path) -> None:
    for name in ("a.jpg", "c.jpg"):
        (survey / "images" / name).unlink()
    (fault,) = faults(survey, GOOD)
    assert fault == (
        f"{line_of(GOOD, 'folder: images')}: photographs.folder: 2 of 3 photographs are not in {survey / 'images'}: "
        "a.jpg, c.jpg: put them there, or give their folder with --photographs DIR"
    )
    (fault,) = faults(survey, GOOD.replace("folder: images", "folder: pictures"))
    assert f"folder {survey / 'pictures'} not found: a.jpg, b.jpg, c.jpg" in fault


def swap(text: str) -> str:
    return re.sub(r"position_m: \[(\S+), (\S+),", r"position_m: [\2, \1,", text)


def test_swapped_everywhere_is_one_fault(survey: Path) -> None:
    (fault,) = faults(survey, swap(GOOD))
    number = GOOD[: GOOD.index("    - name: P1")].count("\n")
    assert fault.startswith(
        f"{number}: control_points.list: easting and northing look swapped in all 3, the first: found"
    )


@pytest.mark.parametrize("crs", ["'+proj=utm +zone=32 +ellps=GRS80 +units=m'", "EPSG:3857"])
def test_swapped_is_seen_by_distance_where_no_area_tells(survey: Path, crs: str) -> None:
    text = GOOD.replace("EPSG:25832", crs).replace("[719970.70, 6191955.16", "[6191955.16, 719970.70")
    (fault,) = faults(survey, text)
    assert "control_points.list[P1].position_m: easting and northing look swapped" in fault


@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:25833", "EPSG:32632", "EPSG:3857", "EPSG:4647"])
def test_only_a_grid_that_cannot_be_meant_is_refused(survey: Path, crs: str) -> None:
    text = GOOD.replace("EPSG:25832", crs)
    if crs == "EPSG:4647":  # UTM 32 with the zone before the easting
        assert all("outside the area of use of EPSG:4647" in f and "in all" in f for f in faults(survey, text))
    else:
        assert read(survey, text).crs == crs


def test_matlab_faults(survey: Path) -> None:
    assert faults(survey, MATLAB) == [f"8: cameras.phantom4.matlab: file {survey / 'cam.mat'} not found"]
    (survey / "cam.mat").touch()
    (fault,) = faults(survey, MATLAB.replace("    pixel_origin: matlab\n", ""))
    assert fault.startswith("8: cameras.phantom4.matlab: pixel_origin is missing: matlab if the calibration counts")
    (fault,) = faults(survey, MATLAB.replace("pixel_origin: matlab\n", "pixel_origin: colmap\n"))
    assert fault.startswith("9: cameras.phantom4.pixel_origin: must be matlab or photogram for a .mat file")


def test_byte_order_mark_and_windows_lines_are_read(survey: Path) -> None:
    (survey / "project.yaml").write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert read(survey).cameras[1].name == "small"


def places(value: object, place: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Where every value of the file stands."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place, *(p for key, inner in items for p in places(inner, (*place, key)))]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("shift", [0, 4])
def test_nothing_in_any_place_is_a_defect(survey: Path, shift: int) -> None:
    wrong = [None, True, -1, 1e300, "x", [], {}, [1, "a", None], {"a": 1}, "a" * 300, [1e300, 1e300, 0]]
    good = json.dumps(yaml.safe_load(GOOD))
    refused = 0
    for i, place in enumerate(places(json.loads(good))[1:]):
        content = holder = json.loads(good)
        for key in place[:-1]:
            holder = holder[key]
        holder[place[-1]] = wrong[(i + shift) % len(wrong)]
        with contextlib.suppress(ProjectError):
            read(survey, json.dumps(content))
            continue
        refused += 1
    assert refused > 60


# ---- edited seams --------------------------------------------------------------------------------------------------


def test_edited_seams_are_read_and_what_is_wrong_with_them_stands_at_their_line(
    survey: Path,
) -> None:
    square = shapely.box(719950.0, 6191950.0, 719960.0, 6191960.0)
    crs = read(survey).crs
    text = f"{GOOD}orthophoto: {{seams: seams.gpkg}}\n"
    line = len(text.splitlines())
    assert read(survey).orthophoto.seams is None
    assert faults(survey, text) == [f"{line}: orthophoto.seams: file {survey / 'seams.gpkg'} not found"]
    write_seams(survey / "seams.gpkg", square, [NamedPolygon("b.jpg", square)], crs)
    assert read(survey, text).orthophoto.seams == str(survey / "seams.gpkg")
    (survey / "seams.gpkg").unlink()
    write_seams(survey / "seams.gpkg", square, [NamedPolygon("lost.jpg", square)], crs)
    (fault,) = faults(survey, text)
    assert fault.startswith(
        f"{line}: orthophoto.seams: seams {survey / 'seams.gpkg'}, layer seams: polygon 1: photograph"
    )
    assert fault.endswith("'lost.jpg' is none of the project's: write the name of a file")


# ---- the area that is mapped ---------------------------------------------------------------------------------------


def test_the_area_of_the_surface_is_read_and_what_is_wrong_with_it_stands_at_its_line(survey: Path) -> None:
    square = shapely.box(719950.0, 6191950.0, 719960.0, 6191960.0)
    path, text = survey / "site.geojson", f"{GOOD}surface: {{area: site.geojson}}\n"
    line = len(text.splitlines())
    assert read(survey).surface.area is None
    missing = f"{line}: surface.area: file {path} not found: correct the path, or remove the key"
    assert faults(survey, text) == [missing]
    path.write_text(shapely.to_geojson(square), encoding="utf-8")
    assert read(survey, text).surface.area == str(path)
    (fault,) = faults(survey, f"{GOOD}dense: {{enabled: false}}\nsurface: {{area: site.geojson}}\n")
    assert fault.endswith("is that of dense matching, which dense.enabled: false leaves out: remove one of them")
    (fault,) = faults(survey, f"{GOOD}surface: {{area: site.geojson, plane: auto}}\n")
    assert fault.endswith("surface.area: lies on the map, plane: auto makes the surface on a plane: remove one")
    path.write_text(shapely.to_geojson(shapely.Point(719950.0, 6191950.0)), encoding="utf-8")
    (fault,) = faults(survey, text)
    assert "is Point, a polygon is expected" in fault
