"""The gross but usual mistakes in the input of a survey: each ends in a right result, or in one clear sentence.

A tiny survey is written to disk, 12 photographs of 400 × 300 px straight down from 50 m over ground points of known
coordinates, spoilt in one way, and checked as `photogram check` does. docs/mistakes.md lists them.
"""

import re
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

from photogram.camera import Camera, Pose, project_points, rotation_from_gimbal
from photogram.files.photographs.images import read_photograph, read_tags, write_photograph
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.frames import LocalFrame, geodetic_from_map, map_from_geodetic
from photogram.pipeline.input_validation import check_project
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.project.findings import Finding
from photogram.terminal.console import console

pytestmark = pytest.mark.filterwarnings("error")

Run = Callable[..., Any]
Values = dict[str, Any]

CRS = "EPSG:25832"
WIDTH, HEIGHT, FOCAL_PX = 400, 300, 300.0
CAMERA = Camera("drone", WIDTH, HEIGHT, FOCAL_PX, np.array([199.5, 149.5]))
ORIGIN = np.array([550_000.0, 6_150_000.0, 60.0])
FRAME = LocalFrame(CRS, (550_000.0, 6_150_000.0, 60.0), "tangent")
FLYING_M, YAW_DEG = 50.0, 17.0
CENTRES = ORIGIN + np.array([[20.0 * i, 20.0 * j, FLYING_M] for j in range(3) for i in range(4)])
POINTS = ORIGIN + np.array(
    [[0, 0, 0], [60, 0, 6], [60, 40, 2], [0, 40, -4], [30, 20, 5], [20, 10, 1], [40, 30, -3]], dtype=np.float64
)
NAMES = [f"G{i}" for i in range(7)]
CONTROL = 5
START = datetime(2024, 5, 1, 10)


def marks_of(points: np.ndarray[Any, Any], camera: Camera = CAMERA) -> list[dict[str, list[float]]]:
    rotation = rotation_from_gimbal(YAW_DEG, -90.0, 0.0)
    world, centres = FRAME.world_from_map(points), FRAME.world_from_map(CENTRES)
    marks: list[dict[str, list[float]]] = [{} for _ in points]
    for i, centre in enumerate(centres):
        pixels = project_points(camera, Pose(rotation, centre), world)
        for p, pixel in enumerate(pixels):
            if camera.contains(pixel[None])[0]:
                marks[p][f"{i:02d}.JPG"] = [float(x) for x in pixel.round(3)]
    return marks


def tags_of(geodetic: np.ndarray[Any, Any]) -> list[PhotographTags]:
    return [
        PhotographTags(
            make="DJI", model="FC6310", serial="a1", width_px=WIDTH, height_px=HEIGHT, focal_mm=8.8, focal_35mm_mm=32.0,
            time=START + timedelta(seconds=3 * i), longitude_deg=lon, latitude_deg=lat, height_m=height,
            height_is_ellipsoidal=True, height_above_take_off_m=FLYING_M, gnss_sigma_m=(0.02, 0.02, 0.04), rtk_flag=50,
            gimbal_yaw_deg=YAW_DEG, gimbal_pitch_deg=-90.0, gimbal_roll_deg=0.0,
            flight_yaw_deg=YAW_DEG, flight_pitch_deg=0.0, flight_roll_deg=0.0,
        )
        for i, (lon, lat, height) in enumerate(geodetic)
    ]  # fmt: skip


@cache
def scene(seed: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
    coarse = np.random.default_rng(seed).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    pixels = np.asarray(Image.fromarray(coarse).resize((WIDTH, HEIGHT), Image.Resampling.BICUBIC))
    pixels.setflags(write=False)
    return pixels


class Tiny:
    """The survey on disk: ``values`` of its project file, ``tags`` and ``pixels`` of its photographs; written by
    ``findings``."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.tags = tags_of(geodetic_from_map(CRS, CENTRES))
        self.pixels = [scene(i) for i in range(12)]
        self.points, self.marks = POINTS.copy(), marks_of(POINTS)
        self.extra: dict[str, bytes] = {}
        self.values: Values = {
            "photogram": 1,
            "crs": CRS,
            "heights": "ellipsoidal",
            "cameras": {
                "drone": {
                    "width_px": WIDTH, "height_px": HEIGHT, "focal_px": FOCAL_PX, "principal_point_px": [199.5, 149.5],
                    "sigmas": {"focal_px": 9.0},
                }
            },
            "photographs": {"folder": "photographs"},
            "control_points": {"sigma_m": [0.02, 0.02, 0.03], "mark_sigma_px": 0.5},
        }  # fmt: skip
        self.listed = True

    @property
    def project(self) -> Path:
        return self.folder / "project.yaml"

    def strip_gnss(self) -> None:
        self.tags = [
            replace(t, longitude_deg=None, latitude_deg=None, height_m=None, height_is_ellipsoidal=None)
            for t in self.tags
        ]

    def table(self, points: np.ndarray[Any, Any], header: str = "name,easting,northing,height") -> None:
        """Give the points in a table instead of the project file."""
        rows = [f"{n},{x!r},{y!r},{z!r}" for n, (x, y, z) in zip(NAMES, points.tolist(), strict=True)]
        (self.folder / "points.csv").write_text("\n".join([header, *rows]) + "\n")
        lines = [f"{n},{p},{u},{v}" for n, m in zip(NAMES, self.marks, strict=True) for p, (u, v) in m.items()]
        (self.folder / "marks.csv").write_text("\n".join(["name,photograph,u,v", *lines]) + "\n")
        self.values["control_points"]["files"] = [{"path": "points.csv", "marks": "marks.csv"}]
        self.listed = False

    def write(self) -> Path:
        photographs = self.folder / "photographs"
        photographs.mkdir(exist_ok=True)
        for i, (tags, pixels) in enumerate(zip(self.tags, self.pixels, strict=True)):
            height, width = pixels.shape[:2]
            write_photograph(photographs / f"{i:02d}.JPG", pixels, replace(tags, width_px=width, height_px=height))
        for name, content in self.extra.items():
            (photographs / name).write_bytes(content)
        if self.listed:
            self.values["control_points"]["list"] = [
                {"name": n, "role": "control" if i < CONTROL else "check", "position_m": p, "marks": m}
                for i, (n, p, m) in enumerate(zip(NAMES, self.points.tolist(), self.marks, strict=True))
            ]
        self.project.write_text(yaml.safe_dump(self.values, sort_keys=False))
        return self.project

    def findings(self) -> list[Finding]:
        """Return what is wrong with the survey, without notes."""
        return [f for f in check_project(self.write()) if f.severity != "note"]


@pytest.fixture
def tiny(tmp_path: Path) -> Tiny:
    return Tiny(tmp_path)


def only(findings: Sequence[Finding], severity: str, *fragments: str) -> None:
    """Assert that one finding says it all, or that the others say nothing worse."""
    text = "\n".join(f"{f.severity}: {f}" for f in findings)
    told = [f for f in findings if f.severity == severity and all(part in str(f) for part in fragments)]
    assert told, text
    if severity == "warning":
        assert not [f for f in findings if f.severity == "error"], text


def test_a_sound_survey_has_no_findings(tiny: Tiny) -> None:
    assert tiny.findings() == []


def test_every_row_of_the_page_is_held_by_a_test_and_every_test_is_in_it() -> None:
    page = (Path(__file__).parents[2] / "docs/mistakes.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(test_\w+)`", page))
    rows = [line for line in page.splitlines() if line.startswith("| ") and "`test_" in line]
    assert len(rows) >= 30
    tests = {name for name in globals() if name.startswith("test_")}
    elsewhere = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parents[1].rglob("test_*.py"))
    assert named <= set(re.findall(r"^def (test_\w+)", elsewhere, re.MULTILINE))
    general = {"test_a_sound_survey_has_no_findings", "test_a_sound_survey_goes_on_after_the_check"}
    general |= {"test_adjust_stops_at_errors_before_any_work", sys._getframe().f_code.co_name}
    assert tests - named == general


# ---- marks and cameras ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("scale", "size"), [(0.5, "200 × 150 px"), (0.9, "36")])
def test_marks_of_smaller_pictures(tiny: Tiny, scale: float, size: str) -> None:
    tiny.marks = [
        {n: [(u + 0.5) * scale - 0.5, (v + 0.5) * scale - 0.5] for n, (u, v) in m.items()} for m in tiny.marks
    ]
    only(tiny.findings(), "warning", "only with marks measured in images of about", size, "check picture_size_px")


@pytest.mark.parametrize("factor", [1.3, 0.7])
def test_a_focal_length_that_is_30_percent_off(tiny: Tiny, factor: float) -> None:
    tiny.values["cameras"]["drone"]["focal_px"] = factor * FOCAL_PX
    only(tiny.findings(), "warning", "a focal length of about ", f"stated are {factor * FOCAL_PX:.0f} px", "focal_px")


def test_a_wrong_focal_length_is_no_reason_to_stop(tiny: Tiny, photogram: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """RTK and check points alone: heights look 6 m off, and the focal length may be adjusted."""
    monkeypatch.setattr(console, "width", 500)
    tiny.values["cameras"]["drone"]["focal_px"] = 1.13 * FOCAL_PX
    tiny.write()
    for point in tiny.values["control_points"]["list"]:
        point["role"] = "check"
    tiny.project.write_text(yaml.safe_dump(tiny.values))
    outcome = photogram("adjust", tiny.project, "--until", "features")
    assert outcome.code == 0, outcome.err
    assert (
        "the marks of the check points agree with the GNSS positions only with a focal length of about" in outcome.out
    )


def test_the_camera_of_another_picture_size(tiny: Tiny) -> None:
    tiny.values["cameras"]["drone"] |= {"width_px": 4000, "height_px": 3000}
    only(tiny.findings(), "error", "camera drone", "have 400 × 300 px, the camera 4000 × 3000 px")


def test_two_lenses_under_one_camera(tiny: Tiny) -> None:
    tiny.tags = [replace(t, lens="DL 24mm" if i < 8 else "DL 35mm") for i, t in enumerate(tiny.tags)]
    only(tiny.findings(), "warning", "different lenses: DL 24mm (8), DL 35mm (4)", "give each its own entry")


def test_a_mark_outside_its_picture(tiny: Tiny) -> None:
    tiny.marks[2]["05.JPG"] = [200.0, 300.0]
    only(
        tiny.findings(), "error", "the mark of G2 at pixel (200, 300) is outside the photograph, which is 400 × 300 px"
    )


@pytest.mark.parametrize("turned", [2, 3])
def test_photographs_that_a_viewer_has_turned(tiny: Tiny, turned: int) -> None:
    """Half a turn contradicts the attitudes; a quarter has another size than the camera."""
    tiny.pixels = [np.ascontiguousarray(np.rot90(p, turned)) for p in tiny.pixels]
    if turned == 2:
        tiny.marks = [{n: [WIDTH - 1 - u, HEIGHT - 1 - v] for n, (u, v) in m.items()} for m in tiny.marks]
        only(tiny.findings(), "warning", "disagree with GNSS positions and attitudes", "check attitudes")
    else:
        only(tiny.findings(), "error", "have 300 × 400 px, the camera 400 × 300 px", "or use the originals")


def test_an_orientation_tag_changes_nothing(tiny: Tiny) -> None:
    tiny.write()
    path = tiny.folder / "photographs" / "03.JPG"
    plain = read_photograph(path)
    with Image.open(path) as picture:
        exif, xmp = picture.getexif(), picture.info["xmp"]
        exif[0x0112] = 3
        picture.save(path, exif=exif, xmp=xmp, quality=100, subsampling=0)
    tiny.extra["03.JPG"] = path.read_bytes()
    assert tiny.findings() == []
    assert np.abs(read_photograph(path).astype(int) - plain).mean() < 3.0


# ---- coordinates ---------------------------------------------------------------------------------------------------


def test_one_control_point_a_kilometre_off(tiny: Tiny) -> None:
    tiny.points[1, 0] += 1000.0
    assert all(f.where == "point G1" for f in tiny.findings())
    only(tiny.findings(), "warning", "point G1", "1000 m from the nearest photograph", "check its coordinates")


def test_latitude_and_longitude_exchanged(tiny: Tiny) -> None:
    tiny.table(geodetic_from_map(CRS, POINTS)[:, [1, 0, 2]], "name,longitude,latitude,height")
    tiny.values["control_points"]["files"][0]["crs"] = "EPSG:4326"
    only(tiny.findings(), "error", "longitude and latitude look swapped in all 7", "give longitude before latitude")


def test_tags_with_latitude_and_longitude_exchanged(tiny: Tiny) -> None:
    tiny.tags = [replace(t, longitude_deg=t.latitude_deg, latitude_deg=t.longitude_deg) for t in tiny.tags]
    only(tiny.findings(), "error", "with longitude and latitude exchanged they would lie among the control points")


@pytest.mark.parametrize("positions", ["tags", "project"])
def test_control_in_the_neighbouring_zone(tiny: Tiny, positions: str) -> None:
    tiny.points = map_from_geodetic("EPSG:25833", geodetic_from_map(CRS, POINTS))
    if positions == "project":
        tiny.values["photographs"] |= {
            "gnss_sigma_m": [0.02, 0.02, 0.04],
            "list": [{"name": f"{i:02d}.JPG", "gnss_m": c} for i, c in enumerate(CENTRES.tolist())],
        }
    only(tiny.findings(), "error", "in EPSG:25833 they would lie among the", "give EPSG:25833 as their crs")


def test_easting_and_northing_exchanged_in_a_file(tiny: Tiny) -> None:
    tiny.table(POINTS[:, [1, 0, 2]])
    only(tiny.findings(), "error", "easting and northing look swapped in all 7", "give easting before northing")


@pytest.mark.parametrize("zone", ["EPSG:25831", "EPSG:25833"])
def test_control_whose_file_names_another_zone(tiny: Tiny, zone: str) -> None:
    tiny.table(POINTS)
    tiny.values["control_points"]["files"][0]["crs"] = zone
    only(tiny.findings(), "error", "in EPSG:25832 they would lie among them", "give EPSG:25832 as their crs")


def test_a_zone_of_the_other_hemisphere(tiny: Tiny) -> None:
    tiny.values["crs"] = "EPSG:32732"
    only(tiny.findings(), "error", "GNSS positions are outside the area of use of EPSG:32732", "EPSG:32632 for example")


def positions_given(tiny: Tiny, positions: np.ndarray[Any, Any], names: Sequence[int] = range(12)) -> None:
    """Give positions of photographs in a table, and leave the ground points out of it."""
    rows = [f"{i:02d}.JPG,{x!r},{y!r},{z!r}" for i, (x, y, z) in zip(names, positions.tolist(), strict=True)]
    (tiny.folder / "positions.csv").write_text("\n".join(["name,easting,northing,height", *rows]) + "\n")
    entry = {"path": "positions.csv", "position_of": "camera", "heights": "ellipsoidal"}
    tiny.values["photographs"] |= {"gnss_sigma_m": [0.02, 0.02, 0.04], "positions": [entry]}
    tiny.points[:, 2] = np.nan
    del tiny.values["control_points"]
    tiny.listed = False


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda c: np.roll(c, -1, axis=0)[:11], "each agrees with the photograph after its own: check that"),
        (
            lambda c: np.roll(c, 2, axis=0)[2:],
            "each agrees with the second photograph before its own: check",
        ),
        (lambda c: map_from_geodetic("EPSG:25833", geodetic_from_map(CRS, c)), "in EPSG:25833 they would lie among"),
        (lambda c: c + np.array([0.0, 0.0, 40.0]), "positions.csv: its heights lie 40.0 m above those in the tags"),
        (
            lambda c: np.where(np.arange(12)[:, None] == 4, c + np.array([90.0, 0.0, 0.0]), c),
            "1 of 12 positions (04.JPG) lie up",
        ),
    ],
)
def test_positions_that_contradict_the_tags(
    tiny: Tiny, change: Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]], says: str
) -> None:
    given = change(CENTRES)
    positions_given(tiny, given, range(12)[-len(given) :] if "second" in says else range(len(given)))
    only(tiny.findings(), "warning", "positions.csv: ", says)


@pytest.mark.parametrize("sigma_m", [(0.02, 0.02, 0.04), None])
def test_positions_that_are_better_than_the_tags(tiny: Tiny, sigma_m: tuple[float, float, float] | None) -> None:
    """Of tags without RTK positions may be metres off, and heights be a barometer's."""
    positions_given(tiny, CENTRES)
    off_m = np.array([1.5, -1.0, 2.0]) if sigma_m else np.array([5.0, -6.0, 60.0])
    off = tags_of(geodetic_from_map(CRS, CENTRES + off_m))
    tiny.tags = [replace(t, gnss_sigma_m=sigma_m, rtk_flag=50 if sigma_m else 16) for t in off]
    assert [f for f in tiny.findings() if f.where == "positions.csv"] == []


def test_a_single_altitude_of_zero(tiny: Tiny) -> None:
    tiny.tags[4] = replace(tiny.tags[4], height_m=0.0)
    found = tiny.findings()
    only(found, "warning", "04.JPG: a height of 0 in the tags, where the others have", "is not used")
    assert not any("height systems" in str(finding) for finding in found)
    (survey,) = (f for f in check_project(tiny.write()) if f.where == "survey")
    assert "12 photographs, 1 camera, 11 with GNSS" in survey.text


def test_several_points_with_one_position(tiny: Tiny) -> None:
    points = POINTS.copy()
    points[:] = points[0]
    tiny.table(points)
    heights = tiny.values.pop("heights")
    found = tiny.findings()
    only(found, "error", "points.csv:2: points G0, G1", "7 points of different names have one position")
    assert not any("height" in str(finding) for finding in found)
    tiny.values["heights"] = heights
    for others, words in ((1, "points G0, G1: 2 points"), (3, "points G0, G1, G2, G3: 4 points")):
        points = POINTS.copy()
        points[1 : 1 + others] = points[0]
        tiny.table(points)
        only(tiny.findings(), "warning", f"points.csv:2: {words} of different names have one position")


@pytest.mark.parametrize("gnss", [True, False])
def test_positions_of_cameras_as_control_points(tiny: Tiny, gnss: bool) -> None:
    names = [f"p{i}" for i in range(len(CENTRES))]
    tiny.values["control_points"]["list"] = [
        {"name": n, "position_m": c, "marks": {f"{i:02d}.JPG": [WIDTH / 2, HEIGHT / 2]}}
        for i, (n, c) in enumerate(zip(names, CENTRES.tolist(), strict=True))
    ]
    tiny.listed = False
    if not gnss:
        tiny.strip_gnss()
    where = "points p0, p1, p2, p3, p4 and 7 more: 12 of 12 control points are positions of cameras"
    del tiny.values["heights"]
    found = tiny.findings()
    only(found, "error", where, "give them under photographs.positions")
    assert not any("height" in str(finding) for finding in found)


@pytest.mark.parametrize("height_m", [9999.0, -9999.0, 1e5])
def test_a_height_that_is_none(tiny: Tiny, height_m: float) -> None:
    tiny.points[3, 2] = height_m
    only(tiny.findings(), "error", "[G3].position_m: height", "is impossible on Earth or a placeholder")


def test_an_altitude_of_1e308_in_the_tags(tiny: Tiny) -> None:
    tiny.write()
    content = (tiny.folder / "photographs" / "04.JPG").read_bytes()
    height = f"+{tiny.tags[4].height_m:.3f}".encode()
    assert content.count(height) == 1
    tiny.extra["04.JPG"] = content.replace(height, b"+1e308 ".ljust(len(height)))
    only(tiny.findings(), "warning", "04.JPG", "the tags give a height of 1e+308 m", "the position is not used")
    assert read_tags(tiny.folder / "photographs" / "04.JPG").height_m is None


def test_coordinates_of_1e308(tiny: Tiny) -> None:
    tiny.points[3, 0] = 1e308
    only(tiny.findings(), "error", "[G3].position_m: easting must be from -100000000 to 100000000 m, found 1e+308")


def test_mixed_height_systems(tiny: Tiny) -> None:
    tiny.points[:, 2] -= 42.0
    only(tiny.findings(), "error", "control heights look orthometric although declared ellipsoidal: they lie 4")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
@pytest.mark.parametrize("where", ["list", "table", "mark"])
def test_numbers_that_are_none(tiny: Tiny, value: float, where: str) -> None:
    if where == "mark":
        tiny.marks[2]["05.JPG"] = [value, 20.0]
    else:
        tiny.points[2, 1] = value
    if where == "table":
        tiny.table(tiny.points)
        only(tiny.findings(), "error", f"points.csv:4: northing of G2 must be a number, found '{value}'")
    else:
        only(tiny.findings(), "error", "[G2]", "finite number")


@pytest.mark.parametrize("sigma_m", [0.0, -0.02])
def test_standard_deviations_of_nothing_and_less(tiny: Tiny, sigma_m: float) -> None:
    tiny.values["control_points"]["sigma_m"] = [0.02, 0.02, sigma_m]
    only(tiny.findings(), "error", "control_points.sigma_m", "must be from 1e-05 to 10000 m")


@pytest.mark.parametrize(
    ("crs", "words"),
    [
        ("EPSG:4326", "'EPSG:4326' (WGS 84) is not a projected CRS: choose a map grid, for example"),
        ("EPSG:2229", "the crs is in US survey foot: write position, in the units of the crs"),
        ("EPSG:99999", "'EPSG:99999': not a CRS known to PROJ"),
    ],
)
def test_a_crs_in_degrees_in_feet_and_none(tiny: Tiny, crs: str, words: str) -> None:
    tiny.values["crs"] = crs
    only(tiny.findings(), "error", "crs", words)


# ---- GNSS ----------------------------------------------------------------------------------------------------------


def test_a_lever_arm_in_millimetres(tiny: Tiny) -> None:
    tiny.values["gnss"] = {"lever_arm_m": [120, 0, 85], "offset_sigma_m": [0.1, 0.1, 0.15]}
    only(
        tiny.findings(),
        "error",
        "[120, 0, 85] m is 147 m from antenna to camera: typed in millimetres?",
        "[0.12, 0, 0.",
    )


@pytest.mark.parametrize("control", [True, False])
def test_all_positions_equal(tiny: Tiny, control: bool) -> None:
    first = tiny.tags[0]
    tiny.tags = [
        replace(t, longitude_deg=first.longitude_deg, latitude_deg=first.latitude_deg, height_m=first.height_m)
        for t in tiny.tags
    ]
    if not control:
        tiny.points, tiny.marks, tiny.listed = tiny.points[:0], [], False
    severity = "warning" if control else "error"
    only(
        tiny.findings(),
        severity,
        "12 photographs have the GNSS position of another time, which is not used",
    )


def test_photographs_of_two_sites(tiny: Tiny) -> None:
    moved = geodetic_from_map(CRS, CENTRES + np.array([5000.0, 0.0, 0.0]))
    tiny.tags[9:] = tags_of(moved)[9:]
    only(tiny.findings(), "warning", "09.JPG, 10.JPG, 11.JPG", "3 photographs 49", "belongs to another site")


def test_photographs_from_one_place(tiny: Tiny) -> None:
    jitter = np.random.default_rng(1).normal(0.0, 0.05, CENTRES.shape)
    tiny.tags = [
        replace(t, gimbal_yaw_deg=30.0 * i) for i, t in enumerate(tags_of(geodetic_from_map(CRS, CENTRES[:1] + jitter)))
    ]
    tiny.marks = [{} for _ in NAMES]
    only(tiny.findings(), "warning", "all 12 GNSS positions lie within", "rays from one place do not intersect")


@pytest.mark.parametrize("times", ["backwards", "missing"])
def test_times_that_run_backwards_or_are_missing(tiny: Tiny, times: str) -> None:
    """Nothing depends on their order: the survey is as sound as before."""
    ahead = [None if times == "missing" else START - timedelta(seconds=3 * i) for i in range(12)]
    tiny.tags = [replace(t, time=time) for t, time in zip(tiny.tags, ahead, strict=True)]
    assert tiny.findings() == []


# ---- photographs and control ---------------------------------------------------------------------------------------


def test_the_same_photograph_twice(tiny: Tiny) -> None:
    tiny.write()
    tiny.extra["05 (1).JPG"] = (tiny.folder / "photographs" / "05.JPG").read_bytes()
    only(tiny.findings(), "warning", "05.JPG, 05 (1).JPG", "the same photograph twice: the first is used", "remove the")


def test_one_photograph_only(tiny: Tiny) -> None:
    tiny.tags, tiny.pixels = tiny.tags[:1], tiny.pixels[:1]
    tiny.marks = [{n: m for n, m in own.items() if n == "00.JPG"} for own in tiny.marks]
    only(tiny.findings(), "error", "a survey needs at least two photographs")


def test_too_few_control_points_and_no_positions(tiny: Tiny) -> None:
    tiny.strip_gnss()
    tiny.marks = [m if i < 2 or i >= CONTROL else {} for i, m in enumerate(tiny.marks)]
    only(
        tiny.findings(),
        "error",
        "2 control points with marks and 0 GNSS positions: the datum is not defined",
        "at least three",
    )


@pytest.mark.parametrize("gnss", [True, False])
def test_control_points_in_one_line(tiny: Tiny, gnss: bool) -> None:
    tiny.points[:CONTROL] = ORIGIN + np.array([[5.0 + 12.0 * i, 5.0 + 6.0 * i, 0.0] for i in range(CONTROL)])
    tiny.marks = marks_of(tiny.points)
    if not gnss:
        tiny.strip_gnss()
    words = "determined by GNSS alone" if gnss else "rotation of the block about their line"
    only(tiny.findings(), "warning" if gnss else "error", "control points: are collinear", words)


@pytest.mark.parametrize("kind", ["nothing in common", "water"])
def test_photographs_that_cannot_be_matched(
    tiny: Tiny, kind: str, photogram: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only the pixels tell: the run ends with a sentence, before any orientation."""
    monkeypatch.setattr(console, "width", 500)
    if kind == "water":
        tiny.pixels = [np.full((HEIGHT, WIDTH, 3), (40, 70, 90), np.uint8) for _ in tiny.pixels]
    outcome = photogram("adjust", tiny.write())
    assert outcome.code == 1
    words = (
        "no features, or too few to match, were detected in 12 of 12"
        if kind == "water"
        else "no two of the 12 photographs have"
    )
    assert words in outcome.err
    assert outcome.err.count("\n") == 1


# ---- the run -------------------------------------------------------------------------------------------------------


def test_adjust_stops_at_errors_before_any_work(tiny: Tiny, photogram: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "width", 500)
    tiny.values["gnss"] = {"lever_arm_m": [120, 0, 85]}
    outcome = photogram("adjust", tiny.write())
    assert outcome.code == 1
    assert outcome.err == ""
    assert "typed in millimetres?" in outcome.out
    assert "Not ready: 1 error" in outcome.out
    assert "--no-check processes" in outcome.out
    assert not (tiny.folder / "work").exists()
    outcome = photogram("adjust", tiny.project, "--no-check", "--until", "photographs")
    assert outcome.code == 0, outcome.err
    assert (tiny.folder / "work" / "photographs.stage").is_dir()


def test_a_sound_survey_goes_on_after_the_check(tiny: Tiny, photogram: Run) -> None:
    outcome = photogram("adjust", tiny.write(), "--until", "photographs")
    assert outcome.code == 0
    assert "Validation of" not in outcome.out


def sparse(values: Values) -> None:
    values["dense"] = {"enabled": False}
    values["orthophoto"] = {"enabled": False}


@pytest.mark.usefixtures("undrawn")
def test_a_copy_takes_no_part_in_the_adjustment(survey: Path, edit: Run, photogram: Run) -> None:
    """The result is that of the survey without the copy; a mark in the copy counts as one in the photograph."""

    def listed(values: Values) -> None:
        sparse(values)
        values["photographs"]["list"].append({**values["photographs"]["list"][1], "name": "sim_0009.JPG"})
        for point in values["control_points"]["list"]:
            if "sim_0002.JPG" in point["marks"]:
                point["marks"]["sim_0009.JPG"] = point["marks"].pop("sim_0002.JPG")

    project_file = survey / "project.yaml"
    edit(project_file, sparse)
    plain = run_pipeline(load_project(project_file))
    shutil.copy(survey / "photographs/sim_0002.JPG", survey / "photographs/sim_0009.JPG")
    edit(project_file, listed)
    outcome = photogram("adjust", project_file)
    assert outcome.code == 0, outcome.err
    report = yaml.safe_load((survey / "results/quality/report.json").read_text(encoding="utf-8"))
    copy = report["photographs"]["sim_0009.JPG"]
    assert (copy["registered"], copy["reason"]) == (False, "the same photograph as sim_0002.JPG")
    assert report["block"]["registered"] == 4
    assert report["adjustment"]["observations"] == plain["adjustment"]["observations"]
    assert report["check_points"]["rmse_h_m"] == pytest.approx(plain["check_points"]["rmse_h_m"], abs=1e-4)
    assert "the same photograph as sim_0002.JPG" in " ".join(outcome.out.split())


@pytest.mark.usefixtures("undrawn")
def test_a_frozen_receiver_leaves_the_block_to_control(survey: Path, edit: Run, photogram: Run) -> None:
    first = read_tags(survey / "photographs/sim_0001.JPG")
    for path in sorted((survey / "photographs").iterdir()):
        place = {name: getattr(first, name) for name in ("longitude_deg", "latitude_deg", "height_m")}
        write_photograph(path, read_photograph(path), replace(read_tags(path), **place))
    edit(survey / "project.yaml", sparse)
    outcome = photogram("adjust", survey / "project.yaml")
    assert outcome.code == 0, outcome.err
    report = yaml.safe_load((survey / "results/quality/report.json").read_text(encoding="utf-8"))
    (warning,) = report["gnss"]["warnings"]
    assert "4 photographs" in warning
    assert "the receiver had stopped updating, or is slower than the camera; these positions were not used" in warning
    assert np.isfinite(report["adjustment"]["sigma0"])
    assert report["check_points"]["rmse_v_m"] < 0.3


# ---- figures that stand for nothing --------------------------------------------------------------------------------


def test_zeros_for_an_attitude_are_not_used(tiny: Tiny) -> None:
    zeros = {"gimbal_yaw_deg": 0.0, "gimbal_pitch_deg": 0.0, "gimbal_roll_deg": 0.0}
    tiny.tags = [replace(t, **zeros) for t in tiny.tags]  # type: ignore[arg-type]
    findings = tiny.findings()
    only(findings, "warning", "the tags of all 12 photographs give an attitude of 0, 0, 0: it is not used")
    assert len(findings) == 1


def test_a_single_zero_is_a_measurement(tiny: Tiny) -> None:
    tiny.tags[3] = replace(tiny.tags[3], gimbal_yaw_deg=0.0)
    assert not [f for f in tiny.findings() if "0, 0, 0" in f.text]


def test_zeros_for_a_height_are_said(tiny: Tiny) -> None:
    tiny.tags = [replace(t, height_m=0.0, rtk_flag=None, gnss_sigma_m=None) for t in tiny.tags]
    tiny.values["photographs"]["gnss_sigma_m"] = [2, 2, 3]
    tiny.values["gnss"] = {"offset_sigma_m": [3, 3, 30]}
    only(tiny.findings(), "warning", "the tags of all 12 photographs give a height of 0: heights are known by control")


def test_one_height_for_positions_that_rose_and_sank_is_said(tiny: Tiny) -> None:
    flown_m = [FLYING_M + 2.0 * (i % 3) for i in range(12)]
    tiny.tags = [replace(t, height_above_take_off_m=h) for t, h in zip(tiny.tags, flown_m, strict=True)]
    only(tiny.findings(), "warning", "the tags of all 12 photographs give a height of 110 m: heights are known by")


def test_one_height_for_a_table_of_positions_is_said(tiny: Tiny) -> None:
    """In another height system than the points, seemingly: the height of a plan is no system's."""
    flown_m = [FLYING_M + 2.0 * (i % 3) for i in range(12)]
    tiny.tags = [replace(t, height_above_take_off_m=h) for t, h in zip(tiny.tags, flown_m, strict=True)]
    plan = np.column_stack([CENTRES[:, :2], np.full(12, 35.0)])
    rows = [f"{i:02d}.JPG,{x!r},{y!r},{z!r}" for i, (x, y, z) in enumerate(plan.tolist())]
    (tiny.folder / "positions.csv").write_text("\n".join(["name,easting,northing,height", *rows]) + "\n")
    entry = {"path": "positions.csv", "position_of": "camera", "heights": "ellipsoidal"}
    tiny.values["photographs"] |= {"gnss_sigma_m": [0.02, 0.02, 0.04], "positions": [entry]}
    only(tiny.findings(), "warning", "positions.csv: all its 12 heights are the same", "known by control points alone")


def test_a_flying_height_that_cannot_be_is_not_used(tiny: Tiny) -> None:
    tiny.tags = [replace(t, height_above_take_off_m=1.0) for t in tiny.tags]
    findings = tiny.findings()
    only(findings, "warning", "the tags of all 12 photographs give 1 m above ground", "it is not used")
    assert len(findings) == 1


def test_a_receiver_slower_than_the_camera(tiny: Tiny) -> None:
    firsts = [tiny.tags[i - i % 3] for i in range(12)]
    tiny.tags = [
        replace(t, longitude_deg=f.longitude_deg, latitude_deg=f.latitude_deg, height_m=f.height_m)
        for t, f in zip(tiny.tags, firsts, strict=True)
    ]
    findings = tiny.findings()
    only(findings, "warning", "8 photographs have the GNSS position of another time, which is not used", "slower than")
    assert len(findings) == 1


def with_tags(survey: Path, **changed: float | None) -> None:
    for path in sorted((survey / "photographs").iterdir()):
        write_photograph(path, read_photograph(path), replace(read_tags(path), **changed))  # type: ignore[arg-type]


@pytest.mark.usefixtures("undrawn")
def test_zeros_for_attitudes_accuse_nobody(finished_survey: Path, survey: Path, photogram: Run) -> None:
    plain = yaml.safe_load((finished_survey / "results/quality/report.json").read_text(encoding="utf-8"))
    with_tags(survey, gimbal_yaw_deg=0.0, gimbal_pitch_deg=0.0, gimbal_roll_deg=0.0)
    outcome = photogram("adjust", survey / "project.yaml")
    assert outcome.code == 0, outcome.err
    report = yaml.safe_load((survey / "results/quality/report.json").read_text(encoding="utf-8"))
    assert report["blunders"] == []
    assert report["check_points"]["rmse_h_m"] < plain["check_points"]["rmse_h_m"] + 0.01
    assert report["check_points"]["rmse_v_m"] < plain["check_points"]["rmse_v_m"] + 0.03


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("control", [True, False])
def test_zeros_for_heights_leave_them_to_control(survey: Path, edit: Run, photogram: Run, control: bool) -> None:
    with_tags(survey, height_m=0.0, rtk_flag=None, gnss_sigma_m=None, height_is_ellipsoidal=None)

    def consumer(values: Values) -> None:
        values["photographs"]["gnss_sigma_m"] = [2.0, 2.0, 3.0]
        if not control:
            for point in values["control_points"]["list"]:
                point["role"] = "check"

    edit(survey / "project.yaml", consumer)
    outcome = photogram("adjust", survey / "project.yaml")
    assert outcome.code == 0, outcome.err
    report = yaml.safe_load((survey / "results/quality/report.json").read_text(encoding="utf-8"))
    assert report["blunders"] == []
    heights_m = [p["sigma_m"][2] for p in report["photographs"].values() if p["registered"]]
    if control:
        assert report["check_points"]["rmse_v_m"] < 0.3
    else:
        assert min(heights_m) > 100.0  # nothing says how high it is
