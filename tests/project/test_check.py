"""The check before the long work: what it finds in surveys that are spoilt on purpose, and that it is silent in
others."""

import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from photogram.adjustment.problem import AdjustmentSettings
from photogram.camera import Camera, Pose, project_points, rotation_from_gimbal
from photogram.errors import ProjectError
from photogram.files.photographs.headers import PhotographHeader, equal_files, read_headers
from photogram.files.photographs.images import read_tags, write_photograph
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.frames import LocalFrame, geodetic_from_map
from photogram.geodesy.height_systems import DeclaredHeights
from photogram.pipeline.costs.space import machine_needs
from photogram.pipeline.pipeline import STAGES
from photogram.project.control.points import ProjectControlPoint
from photogram.project.findings import Finding
from photogram.project.project import Project, ProjectPhotograph
from photogram.project.validation.check import check_survey, header_findings, project_errors, survey_findings
from photogram.sfm.orientation import OrientationSettings
from photogram.sfm.tie_points.detector import FeatureSettings
from photogram.sfm.tie_points.guided_matching import TransferSettings
from photogram.sfm.tie_points.matching import MatchingSettings
from photogram.sfm.tie_points.pairs import PairSettings
from photogram.surface.contours import ContourSettings
from photogram.surface.dense.tile_matching import DenseSettings
from photogram.surface.dtm import TerrainSettings
from photogram.surface.ortho.orthophoto import OrthophotoSettings
from photogram.surface.tin_dsm import SurfaceSettings
from photogram.terminal.console import console
from photogram.wording import some, things

CRS = "EPSG:25832"
CAMERA = Camera("p4", 4000, 3000, 3000.0, np.array([1999.5, 1499.5]))
GROUND_M, FLYING_M = 60.0, 50.0
CORNER = np.array([550_000.0, 6_150_000.0, GROUND_M])
FRAME = LocalFrame(CRS, (550_000.0, 6_150_000.0, GROUND_M), "tangent")
YAW = 17.0

Survey = tuple[Project, list[PhotographTags | None]]


def camera_positions() -> np.ndarray[Any, np.dtype[np.float64]]:
    columns, rows = np.meshgrid(np.arange(4) * 20.0, np.arange(3) * 20.0)
    return np.asarray(CORNER + np.column_stack([columns.ravel(), rows.ravel(), np.full(12, FLYING_M)]))


def a_survey() -> Survey:
    """Twelve photographs straight down from 50 m, seven ground points with all the marks they can have."""
    position = camera_positions()
    geodetic = geodetic_from_map(CRS, position)
    tags: list[PhotographTags | None] = [
        PhotographTags(
            make="DJI",
            model="FC6310",
            width_px=4000,
            height_px=3000,
            focal_mm=8.8,
            time=datetime(2024, 5, 1, 10) + timedelta(seconds=3 * i),
            longitude_deg=lon,
            latitude_deg=lat,
            height_m=height,
            height_above_take_off_m=FLYING_M,
            gnss_sigma_m=(0.02, 0.02, 0.04),
            rtk_flag=50,
            gimbal_yaw_deg=YAW,
            gimbal_pitch_deg=-90.0,
            gimbal_roll_deg=0.0,
        )
        for i, (lon, lat, height) in enumerate(geodetic)
    ]
    photographs = tuple(ProjectPhotograph(f"{i:02d}.JPG", Path(f"{i:02d}.JPG"), 0) for i in range(12))
    places = CORNER + np.array([[0, 0, 0], [60, 0, 1], [60, 40, 2], [0, 40, -1], [30, 20, 0], [20, 10, 1], [40, 30, 0]])
    roles = ["control"] * 5 + ["check"] * 2
    points = tuple(ground_point(f"G{i}", role, p) for i, (role, p) in enumerate(zip(roles, places, strict=True)))
    survey = Project(
        Path("project.yaml"), CRS, "tangent", "high", (CAMERA,), ("given",), ("",), ((),), photographs, points,
        np.zeros(3),
        FeatureSettings(), PairSettings(), MatchingSettings(), OrientationSettings(), TransferSettings(),
        AdjustmentSettings(), DenseSettings(), SurfaceSettings(), TerrainSettings(), ContourSettings(),
        OrthophotoSettings(),
        None, Path("results"), Path("work"), DeclaredHeights(*("ellipsoidal",) * 4),
    )  # fmt: skip
    return survey, tags


def ground_point(name: str, role: Any, position: np.ndarray[Any, np.dtype[np.float64]]) -> ProjectControlPoint:
    rotation = rotation_from_gimbal(YAW, -90.0, 0.0)
    world = FRAME.world_from_map(position[None])
    pixels = [project_points(CAMERA, Pose(rotation, c), world)[0] for c in FRAME.world_from_map(camera_positions())]
    seen = [i for i, pixel in enumerate(pixels) if CAMERA.contains(pixel[None])[0]]
    return ProjectControlPoint(
        name,
        (role, role),
        position,
        np.full(3, 0.02),
        np.array(seen),
        np.array([pixels[i] for i in seen]),
        np.tile(np.eye(2), (len(seen), 1, 1)),
        "ellipsoidal",
    )


def headers(survey: Survey) -> list[PhotographHeader]:
    pairs = zip(survey[0].photographs, survey[1], strict=True)
    return [PhotographHeader(p.name, t, "" if t else f"photograph {p.name}: cannot be decoded") for p, t in pairs]


def found(survey: Survey, **more: Any) -> list[Finding]:
    needs = machine_needs(STAGES, *survey)
    return check_survey(survey[0], headers(survey), needs, **more)


def with_points(survey: Survey, change: Callable[[ProjectControlPoint], ProjectControlPoint]) -> Survey:
    return replace(survey[0], control_points=tuple(change(p) for p in survey[0].control_points)), survey[1]


def with_tags(survey: Survey, **values: Any) -> Survey:
    return survey[0], [None if t is None else replace(t, **values) for t in survey[1]]


def without_gnss(survey: Survey) -> Survey:
    return with_tags(survey, longitude_deg=None, latitude_deg=None, height_m=None)


def keep_points(names: Sequence[str]) -> Callable[[Survey], Survey]:
    def change(survey: Survey) -> Survey:
        points = tuple(p for p in survey[0].control_points if p.name in names)
        return replace(survey[0], control_points=points), survey[1]

    return change


def first_marks(names: Sequence[str], count: int) -> Callable[[Survey], Survey]:
    def keep(p: ProjectControlPoint) -> ProjectControlPoint:
        few = slice(0, count)
        return replace(
            p,
            mark_photograph=p.mark_photograph[few],
            mark_pixel=p.mark_pixel[few],
            mark_covariance_px2=p.mark_covariance_px2[few],
            mark_kind=p.mark_kind[few],
        )

    return lambda survey: with_points(survey, lambda p: keep(p) if p.name in names else p)


def moved(name: str, by: Sequence[float]) -> Callable[[Survey], Survey]:
    return lambda survey: with_points(
        survey, lambda p: replace(p, position_map_m=p.position_map_m + by) if p.name == name else p
    )


def photograph_moved(index: int, north_deg: float) -> Callable[[Survey], Survey]:
    def change(survey: Survey) -> Survey:
        tags = list(survey[1])
        tag = tags[index]
        assert tag is not None
        assert tag.latitude_deg is not None
        tags[index] = replace(tag, latitude_deg=tag.latitude_deg + north_deg)
        return survey[0], tags

    return change


def tag_changed(index: int, **values: Any) -> Callable[[Survey], Survey]:
    def change(survey: Survey) -> Survey:
        tags = list(survey[1])
        tag = tags[index]
        assert tag is not None
        tags[index] = replace(tag, **values)
        return survey[0], tags

    return change


def mark_turned(survey: Survey) -> Survey:
    """One mark of G4 in the opposite corner of its photograph."""

    def change(p: ProjectControlPoint) -> ProjectControlPoint:
        if p.name != "G4":
            return p
        pixel = p.mark_pixel.copy()
        pixel[0] = [3999, 2999] - pixel[0]
        return replace(p, mark_pixel=pixel)

    return with_points(survey, change)


def on_a_line(survey: Survey) -> Survey:
    control = [p for p in survey[0].control_points if p.role == "control"]
    places = [CORNER + np.array([5.0 + 12 * i, 5.0 + 6 * i, 0.0]) for i in range(len(control))]
    points = [ground_point(p.name, p.role, place) for p, place in zip(control, places, strict=True)]
    return replace(survey[0], control_points=(*points, *survey[0].control_points[5:])), survey[1]


def on_all(*changes: Callable[[Survey], Survey]) -> Callable[[Survey], Survey]:
    def change(survey: Survey) -> Survey:
        for one in changes:
            survey = one(survey)
        return survey

    return change


def frozen(survey: Survey) -> Survey:
    tag = survey[1][0]
    assert tag is not None
    return with_tags(survey, longitude_deg=tag.longitude_deg, latitude_deg=tag.latitude_deg, height_m=tag.height_m)


def with_crs(crs: str) -> Callable[[Survey], Survey]:
    return lambda survey: (replace(survey[0], crs=crs, control_points=()), survey[1])


Expected = tuple[str, str, str]
NO_CHECK = ("warning", "check points", "none with two marks or more: accuracy will be predicted")
CASES: dict[str, tuple[Callable[[Survey], Survey], list[Expected]]] = {
    "nothing wrong": (lambda s: s, []),
    "another size": (
        tag_changed(3, width_px=1000, height_px=750),
        [("error", "camera p4", "1 of 12 photographs (03.JPG) have 1000 × 750 px, the camera 4000 × 3000 px")],
    ),
    "another model": (
        tag_changed(3, model="FC300S"),
        [
            (
                "warning",
                "camera p4",
                "its photographs were taken with different cameras: DJI FC6310 (11), DJI FC300S (1)",
            )
        ],
    ),
    "another focal length": (
        tag_changed(3, focal_mm=24.0),
        [("warning", "camera p4", "its photographs were taken with different focal lengths: 8.8 mm (11), 24 mm (1)")],
    ),
    "a thermal picture": (
        tag_changed(3, kind="thermal"),
        [("warning", "03.JPG", "1 picture of the kind thermal, not ordinary photographs")],
    ),
    "no standard deviation": (
        lambda s: with_tags(s, gnss_sigma_m=None),
        [("error", "00.JPG, 01.JPG, 02.JPG, 03.JPG, 04.JPG and 7 more", "12 GNSS positions without a standard dev")],
    ),
    "two lenses": (
        on_all(
            *(tag_changed(i, lens="DL 35mm", lens_serial="2") for i in range(4)),
            *(tag_changed(i, lens="DL 24mm", lens_serial="1") for i in range(4, 12)),
        ),
        [
            (
                "warning",
                "camera p4",
                "its photographs were taken with different lenses: DL 24mm no. 1 (8), DL 35mm no. 2 (4)",
            )
        ],
    ),
    "XMP that is not XML": (
        on_all(*(tag_changed(i, damage=("the XMP tags are not valid XML (x), only EXIF is used",)) for i in (3, 5))),
        [("warning", "03.JPG, 05.JPG", "the XMP tags are not valid XML (x), only EXIF is used")],
    ),
    "a frozen receiver": (
        frozen,
        [
            (
                "warning",
                "00.JPG, 01.JPG, 02.JPG, 03.JPG, 04.JPG and 7 more",
                "12 photographs have the GNSS position of another time",
            ),
        ],
    ),
    "a frozen receiver and no control": (
        on_all(keep_points([]), frozen),
        [
            (
                "error",
                "00.JPG, 01.JPG, 02.JPG, 03.JPG, 04.JPG and 7 more",
                "12 photographs have the GNSS position of another time",
            ),
            ("error", "the block", "neither control points nor GNSS positions: the survey cannot be georeferenced"),
        ],
    ),
    "some without GNSS": (
        tag_changed(3, longitude_deg=None, latitude_deg=None),
        [("warning", "03.JPG", "1 of 12 photographs have no GNSS position")],
    ),
    "no GNSS": (
        without_gnss,
        [("note", "photographs", "no photograph has a GNSS position: control points alone define")],
    ),
    "same moment": (
        lambda s: (s[0], [s[1][1], *s[1][1:]]),
        [
            ("warning", "00.JPG, 01.JPG", "same camera, time and position"),
            ("warning", "00.JPG", "all its 2 marks disagree with their points, by 22°"),
        ],
    ),
    "another site": (
        photograph_moved(11, 0.05),
        [
            ("warning", "11.JPG", "1 photograph 5566 m from the nearest of the others"),
            ("warning", "11.JPG", "all its 2 marks disagree with their points, by 84°"),
        ],
    ),
    "many sites": (
        on_all(keep_points([]), *(photograph_moved(i, 0.05 * i) for i in range(12))),
        [("warning", "photographs", "the photographs lie 5567 m apart, 12 groups with more than"), NO_CHECK],
    ),
    "on the other side of the world": (
        with_crs("EPSG:2193"),
        [("error", "crs", "12 of 12 GNSS positions are outside the area of use of EPSG:2193")],
    ),
    "one on the other side of the world": (
        on_all(keep_points([]), tag_changed(3, longitude_deg=100.0)),
        [("error", "03.JPG", "1 of 12 GNSS positions are outside the area of use of EPSG:25832"), NO_CHECK],
    ),
    "control of another place": (
        lambda s: with_points(s, lambda p: replace(p, position_map_m=p.position_map_m + np.array([3e4, 0, 0]))),
        [
            ("error", "control_points", "they lie 29.9 km or more from the GNSS positions of the photographs"),
        ],
    ),
    "one control point far away": (
        moved("G1", [0, 700, 0]),
        [
            ("warning", "point G1", "660 m from the nearest photograph, whose footprint is about 83 m wide"),
            ("warning", "point G1", "all its 4 marks disagree with its position, by "),
        ],
    ),
    "a wrong mark": (
        mark_turned,
        [("warning", "point G4 in 01.JPG", "its mark disagrees with its position, by 48°")],
    ),
    "attitudes turned about": (
        lambda s: with_tags(s, gimbal_yaw_deg=YAW + 90),
        [("warning", "marks", "27 of 37 disagree with GNSS positions and attitudes by ")],
    ),
    "control above the camera": (
        moved("G2", [0, 0, 80]),
        [("error", "point G2", "G2 is 32.0 m above ")],
    ),
    "a check point above the camera": (
        moved("G5", [0, 0, 80]),
        [
            ("warning", "point G5", "G5 is 31.0 m above "),
            ("warning", "heights", "heights of the check points look orthometric although declared ellipsoidal"),
        ],
    ),
    "control above a camera that is not sure of its height": (
        on_all(moved("G2", [0, 0, 80]), lambda s: with_tags(s, gnss_sigma_m=(2.0, 2.0, 10.0))),
        [("warning", "point G2", "G2 is 32.0 m above ")],
    ),
    "two height systems": (
        lambda s: with_points(s, lambda p: replace(p, position_map_m=p.position_map_m - [0, 0, 42])),
        [
            (
                "warning",
                "heights",
                "GNSS positions are 92 m above the control points, but the photographs were taken 50 m above ground",
            ),
            (
                "error",
                "heights",
                "control heights look orthometric although declared ellipsoidal: they lie 42.0 m below",
            ),
            (
                "error",
                "heights",
                "heights of the check points look orthometric although declared ellipsoidal: they lie",
            ),
        ],
    ),
    "marks of half-size pictures": (
        lambda s: with_points(s, lambda p: replace(p, mark_pixel=(p.mark_pixel + 0.5) / 2 - 0.5)),
        [
            (
                "warning",
                "marks",
                "the marks of the control points agree with the GNSS positions only with marks measured in images of "
                "about 2000 × 1500 px, the photographs are 4000 × 3000 px",
            ),
            (
                "warning",
                "marks",
                "the marks of the check points agree with the GNSS positions only with marks measured",
            ),
            ("warning", "marks", "17 of 37 disagree with GNSS positions and attitudes by 3"),
        ],
    ),
    "a focal length 13 % too long": (
        lambda s: (replace(s[0], cameras=(replace(CAMERA, focal_px=1.13 * CAMERA.focal_px),)), s[1]),
        [
            (
                "warning",
                "marks",
                "the marks of the control points agree with the GNSS positions only with a focal length",
            ),
            (
                "warning",
                "marks",
                "the marks of the check points agree with the GNSS positions only with a focal length",
            ),
        ],
    ),
    "two control points, no GNSS": (
        on_all(keep_points(["G0", "G2", "G5"]), without_gnss),
        [
            ("error", "the block", "2 control points with marks and 0 GNSS positions: the datum is not defined"),
            ("note", "photographs", "no photograph has a GNSS position"),
        ],
    ),
    "nothing that says where": (
        on_all(keep_points([]), without_gnss),
        [
            ("error", "the block", "neither control points nor GNSS positions: the survey cannot be georeferenced"),
            ("note", "photographs", "no photograph has a GNSS position"),
        ],
    ),
    "control in one line": (
        on_a_line,
        [("warning", "control points", "are collinear: rotation about their line is determined by GNSS alone")],
    ),
    "control in one line, no GNSS": (
        on_all(on_a_line, without_gnss),
        [
            ("error", "control points", "are collinear: rotation of the block about their line is not determined"),
            ("note", "photographs", "no photograph has a GNSS position"),
        ],
    ),
    "one strip alone": (
        on_all(
            keep_points([]),
            lambda s: with_tags(s, gimbal_yaw_deg=None),
            lambda s: (replace(s[0], photographs=s[0].photographs[:4]), s[1][:4]),
        ),
        [
            (
                "warning",
                "GNSS positions",
                "are collinear and there are no attitudes: rotation about the strip is not determined",
            ),
            NO_CHECK,
        ],
    ),
    "few marks": (
        on_all(first_marks(["G0", "G1"], 1), first_marks(["G2"], 0), first_marks(["G5"], 1), first_marks(["G6"], 0)),
        [
            ("warning", "G2", "1 control point without any mark: they are not used"),
            ("warning", "G0, G1", "2 control points with a single mark, which nothing checks"),
            ("warning", "G6", "1 check point without any mark: they test nothing"),
            ("warning", "G5", "1 check point with a single mark: they test nothing"),
            NO_CHECK,
        ],
    ),
    "one photograph": (
        on_all(keep_points([]), lambda s: (replace(s[0], photographs=s[0].photographs[:1]), s[1][:1])),
        [
            ("error", "photographs", "a survey needs at least two photographs"),
            ("error", "the block", "0 control points with marks and 1 GNSS position: the datum is not defined"),
            NO_CHECK,
        ],
    ),
    "a damaged photograph": (
        lambda s: (s[0], [*s[1][:5], None, *s[1][6:]]),
        [("error", "05.JPG", "photograph 05.JPG: cannot be decoded")],
    ),
}


@pytest.mark.parametrize("kind", CASES)
def test_what_is_wrong_is_found_and_nothing_else(kind: str) -> None:
    change, expected = CASES[kind]
    findings = found(change(a_survey()))
    assert (findings[-1].severity, findings[-1].where) == ("note", "survey")
    rest = findings[:-1]
    assert len(rest) == len(expected), "\n".join(map(str, rest))
    for severity, where, start in expected:
        match = [f for f in rest if (f.severity, f.where) == (severity, where) and start in f.text]
        assert match, (where, start, "\n".join(map(str, rest)))
        assert all(f.remedy or f.severity == "note" or "decoded" in f.text for f in match)
    order = [("error", "warning", "note").index(f.severity) for f in findings]
    assert order == sorted(order)


def test_a_fisheye_is_no_surprise_where_the_project_says_so() -> None:
    project, tags = with_tags(a_survey(), kind="fisheye")
    assert [f.severity for f in header_findings(headers((project, tags)))] == ["warning"]
    fisheye = replace(project, cameras=tuple(replace(c, model="fisheye") for c in project.cameras))
    assert not [f for f in found((fisheye, tags)) if "of the kind fisheye" in f.text]


def test_tags_alone_show_what_nothing_can_be_placed_by() -> None:
    good, bad = a_survey(), without_gnss(keep_points(["G0"])(a_survey()))
    assert [f for f in survey_findings(*good) if f.severity == "error"] == []
    assert [f.where for f in survey_findings(*bad) if f.severity == "error"] == ["the block"]


def test_twins_disk_and_memory() -> None:
    survey = a_survey()
    findings = found(survey, twins=[(0, 3)], free_disk_bytes=10**6, memory=10**8)
    assert [(f.severity, f.where) for f in findings[:-1]] == [
        ("warning", "00.JPG, 03.JPG"),
        ("warning", "disk"),
        ("warning", "memory"),
    ]
    assert "11 photographs, 1 camera, 11 with GNSS" in findings[-1].text
    assert found(survey, free_disk_bytes=10**12, memory=10**12)[0].severity == "note"
    nearly_full = found(survey, free_disk_bytes=int(1.2 * machine_needs(STAGES, *survey).disk_bytes))
    assert (nearly_full[0].severity, nearly_full[0].where) == ("warning", "disk")


def test_faults_of_the_project_file_become_findings(tmp_path: Path) -> None:
    path = tmp_path / "project.yaml"
    several = ProjectError(f"{path} has 2 errors:\n{path}:3: crs: is missing: give it\n{path}:7: gnss.x: unknown: y")
    assert project_errors(path, several) == [
        Finding("error", "project.yaml:3", "crs: is missing: give it"),
        Finding("error", "project.yaml:7", "gnss.x: unknown: y"),
    ]
    (one,) = project_errors(path, ProjectError(f"{path}: cannot be read (No such file)"))
    assert (one.where, one.text) == ("project.yaml", "cannot be read (No such file)")


def test_words() -> None:
    assert some(["a", "b"], 1) == "a and 1 more"
    assert (things(1, "mark"), things(2, "mark"), things(0, "body", "bodies")) == ("1 mark", "2 marks", "0 bodies")
    assert str(Finding("note", "here", "something", "")) == "here: something"


# -- files ------------------------------------------------------------------------------------------------------------


def test_headers_and_equal_files(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    pixels = rng.integers(0, 256, (60, 80, 3), dtype=np.uint8)
    write_photograph(tmp_path / "a.jpg", pixels, PhotographTags(model="X"))
    write_photograph(tmp_path / "b.jpg", pixels[::-1], PhotographTags(model="X"))
    shutil.copy(tmp_path / "a.jpg", tmp_path / "c.jpg")
    (tmp_path / "d.jpg").write_bytes((tmp_path / "a.jpg").read_bytes()[:1500])
    Image.fromarray(rng.random((60, 80), dtype=np.float32)).save(tmp_path / "e.tif")
    paths = [tmp_path / f"{n}" for n in ("a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.tif", "none.jpg")]
    with ThreadPoolExecutor(2) as executor:
        read, twins = read_headers(paths, executor), equal_files(paths, executor)
    assert twins == [(0, 2)]
    assert [h.tags is not None for h in read] == [True, True, True, False, False, False]
    assert read[0].tags == read_tags(paths[0])
    assert [h.name for h in read] == [p.name for p in paths]
    for header, word in zip(read[3:], ("truncated", "32-bit floating-point", "file not found"), strict=True):
        assert word in header.error


# -- the command ------------------------------------------------------------------------------------------------------

Run = Callable[..., Any]


def flat(text: str) -> str:
    return " ".join(text.replace("│", " ").replace("┃", " ").split())


def test_command_says_ready(survey: Path, photogram: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    outcome = photogram("check", survey / "project.yaml")
    assert outcome.code == 0, outcome.out
    assert outcome.err == ""
    assert flat(outcome.out.strip().splitlines()[-1]).startswith("Ready: 0 errors")
    assert "4 photographs, 1 camera, 4 with GNSS" in flat(outcome.out)
    assert not (survey / "work").exists()


def test_command_says_everything_at_once(
    survey: Path, photogram: Run, edit: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "width", 500)
    shutil.copy(survey / "photographs/sim_0001.JPG", survey / "photographs/sim_0002.JPG")
    broken = survey / "photographs/sim_0003.JPG"
    broken.write_bytes(broken.read_bytes()[:2000])
    outcome = photogram("check", survey / "project.yaml")
    assert outcome.code == 1
    assert "the same photograph twice" in outcome.out
    assert "truncated" in flat(outcome.out)
    assert outcome.out.strip().splitlines()[-1].startswith("Not ready: ")
    edit(survey / "project.yaml", lambda v: v.update(crs="EPSG:99999"))
    outcome = photogram("check", survey / "project.yaml")
    assert outcome.code == 1
    assert "project.yaml:" in outcome.out
    assert "'EPSG:99999': not a CRS known to PROJ" in flat(outcome.out)
    assert "the same photograph twice" in outcome.out
    assert outcome.out.strip().splitlines()[-1].startswith("Not ready: 2 errors, 1 warning")


def test_command_without_a_project_file(tmp_path: Path, photogram: Run) -> None:
    outcome = photogram("check", tmp_path / "none.yaml")
    assert outcome.code == 1
    assert "cannot be read" in outcome.err + outcome.out
    assert "Traceback" not in outcome.err
