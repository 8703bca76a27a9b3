"""photogram init: from a folder of small photographs, whose tags are the truth, to a project that can be read."""

import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from deep_files import tags_of_jpeg, write_dng, write_tiff
from hypothesis import given
from hypothesis import strategies as st
from makers import SharedData
from PIL import Image

from photogram.errors import FrameError, ProjectError
from photogram.files.photographs.images import read_photograph, read_tags, write_photograph
from photogram.files.photographs.tags import Dewarp, PhotographTags
from photogram.geodesy.frames import geodetic_from_map, map_from_geodetic
from photogram.gnss import RTK_OFFSET_SIGMA_M
from photogram.pipeline.pipeline import load_project
from photogram.project.draft.control import ControlFile
from photogram.project.draft.draft import LeftOut, TaggedPhotograph, Wishes, draft_project
from photogram.project.draft.positions import Gnss, gnss_of, offset_prior
from photogram.project.draft.text import flights_comment, project_text

Run = Callable[..., Any]
NOON = datetime(2024, 5, 1, 12, 0, 0)
WIDTH, HEIGHT = 64, 48
LONGITUDE, LATITUDE = 8.5, 47.4

DRONE = PhotographTags(
    make="DJI",
    model="FC300S",
    width_px=WIDTH,
    height_px=HEIGHT,
    focal_mm=3.61,
    focal_35mm_mm=20.0,
    time=NOON,
    longitude_deg=LONGITUDE,
    latitude_deg=LATITUDE,
    height_m=500.0,
    height_above_take_off_m=60.0,
    gimbal_yaw_deg=10.0,
    gimbal_pitch_deg=-90.0,
    gimbal_roll_deg=0.0,
)


def flown(number: int, tags: PhotographTags = DRONE, seconds: float = 5.0) -> list[PhotographTags]:
    """Return the tags of photographs 10 m apart, one every few seconds."""
    degree_m = 111_195.0
    return [
        replace(
            tags,
            time=None if tags.time is None else tags.time + timedelta(seconds=seconds * i),
            latitude_deg=None if tags.latitude_deg is None else tags.latitude_deg + 10.0 * i / degree_m,
        )
        for i in range(number)
    ]


def photographed(folder: Path, tags: Sequence[PhotographTags], first: int = 1) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for number, t in enumerate(tags, first):
        pixels = np.full((t.height_px or HEIGHT, t.width_px or WIDTH, 3), 128, np.uint8)
        write_photograph(folder / f"DJI_{number:04d}.JPG", pixels, t)
    return folder


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "photographs"


def project_of(outcome: Any, project: str) -> list[str]:
    """The names of the photographs of a project that was just written."""
    assert outcome.code == 0, outcome.err
    return [p.name for p in load_project(Path(project)).photographs]


def values_of(project: Path) -> dict[str, Any]:
    return dict(yaml.safe_load(project.read_text(encoding="utf-8")))


def squeezed(text: str) -> str:
    """Undo the folding of a table or a comment."""
    return re.sub(r"\s+", " ", re.sub(r"[│#]", " ", text))


# ---- the command -----------------------------------------------------------------------------------------------------


def test_a_plain_folder_becomes_a_project_that_can_be_read(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(12))
    outcome = photogram("init", folder)
    assert (outcome.code, outcome.err) == (0, "")
    project = load_project(Path("project.yaml"))
    assert [p.name for p in project.photographs] == [f"DJI_{i:04d}.JPG" for i in range(1, 13)]
    assert project.crs == "EPSG:32632"
    (camera,) = project.cameras
    assert camera.name == "dji_fc300s_64x48"
    assert camera.focal_px == pytest.approx(20.0 / 43.2666 * 80.0, abs=1e-3)
    assert camera.principal_point_px.tolist() == [31.5, 23.5]
    f = camera.focal_px
    # 3 %, and half of what the focal length by the width differs by; b1 and b2 for a shutter of which nothing is told
    focal = np.hypot(0.03 * f, 0.5 * (f - 20.0 / 36.0 * 64.0))
    expected = [focal, 0.64, 0.64, 0.1, 0.1, 0.05, 0, 0.003, 0.003, 0.003 * f, 0.001 * f, 0]
    assert camera.sigmas == pytest.approx(expected, rel=5e-3)
    assert project.focal_readings_px[0][0] == pytest.approx(20.0 / 36.0 * 64.0, abs=1e-3)
    assert project.calibration == ("auto",)
    assert project.camera_source == ("EXIF focal length 3.61 mm, 35 mm equivalent 20 mm",)
    assert [p.gnss_sigma_m.tolist() for p in project.photographs if p.gnss_sigma_m is not None] == [[2, 2, 3]] * 12
    assert project.gnss_offset_sigma_m.tolist() == [2, 2, 10]
    assert {p.flight for p in project.photographs} == {"1"}
    for text in ("12 in 1 flight", "12 without stated accuracy", "EPSG:32632", "photogram adjust project.yaml"):
        assert text in squeezed(outcome.out)
    lines = Path("project.yaml").read_text().splitlines()
    assert max(map(len, lines)) <= 120
    assert "folder: photographs" in Path("project.yaml").read_text()


def test_a_project_file_is_never_overwritten_without_asking(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(3))
    Path("project.yaml").write_text("mine")
    outcome = photogram("init", folder)
    assert outcome.code == 1
    assert "--force" in outcome.err
    assert Path("project.yaml").read_text() == "mine"
    assert photogram("init", folder, "--force").code == 0
    assert load_project(Path("project.yaml")).photographs


def test_the_project_may_lie_anywhere(folder: Path, photogram: Run, tmp_path: Path) -> None:
    photographed(folder, flown(3))
    (tmp_path / "work" / "deep").mkdir(parents=True)
    outcome = photogram("init", folder, "--project", "work/deep/survey.yaml")
    assert outcome.code == 0
    project = load_project(Path("work/deep/survey.yaml"))
    assert all(p.path.is_file() for p in project.photographs)
    assert "folder: ../../photographs" in Path("work/deep/survey.yaml").read_text()


def test_suffixes_of_any_case_hidden_files_and_folders_within(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(4))
    (folder / "DJI_0002.JPG").rename(folder / "DJI_0002.jpeg")
    Image.open(folder / "DJI_0003.JPG").save(folder / "DJI_0003.TiF")
    (folder / "DJI_0003.JPG").unlink()
    (folder / "DJI_0004.JPG").rename(folder / "._DJI_0004.JPG")
    (folder / "notes.txt").write_text("no photograph")
    photographed(folder / "card 2", flown(2, replace(DRONE, latitude_deg=47.4001)))
    photographed(folder / ".trash", flown(1))
    outcome = photogram("init", folder, "--focal-px", "37")
    assert outcome.code == 0
    names = {p["name"] for p in values_of(Path("project.yaml"))["photographs"]["list"]}
    assert names == {"DJI_0001.JPG", "DJI_0002.jpeg", "DJI_0003.TiF"}
    assert photogram("init", folder, "--recursive", "--force", "--focal-px", "37").code == 0
    names = {p.name for p in load_project(Path("project.yaml")).photographs}
    assert names == {"DJI_0001.JPG", "DJI_0002.jpeg", "DJI_0003.TiF", "card 2/DJI_0001.JPG", "card 2/DJI_0002.JPG"}


ODD_NAMES = ("1e5.jpg", "007.jpg", "a, b.jpg", "no: x.jpg", "#1.jpg", "ü [1] {2}.JPG", "- a.jpg", "q\"u'o.jpg", "%.jpg")


def test_odd_names_of_photographs_are_read_back(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(len(ODD_NAMES) + 1))
    for number, name in enumerate(ODD_NAMES, 2):
        (folder / f"DJI_{number:04d}.JPG").rename(folder / name)
    shutil.copy(folder / "DJI_0001.JPG", folder / "line\nbreak.jpg")
    outcome = photogram("init", folder)
    assert outcome.code == 0
    names = {p.name for p in load_project(Path("project.yaml")).photographs}
    assert names == {*ODD_NAMES, "DJI_0001.JPG"}
    assert "unprintable" in squeezed(outcome.out)


DRAFT = draft_project([TaggedPhotograph("a.jpg", DRONE)], [], Wishes())


@given(st.text(st.characters(codec="utf-8", exclude_categories=["C", "Zl", "Zp"]), min_size=1).filter(str.isprintable))
def test_every_printable_name_is_read_back(name: str) -> None:
    photographs = (replace(DRAFT.photographs[0], name=name),)
    draft = replace(DRAFT, photographs=photographs, left_out=(LeftOut(name, f"why {name}"),))
    values = yaml.safe_load(project_text(draft, name))
    assert values["photographs"]["list"] == [{"name": name}]
    assert values["photographs"]["folder"] == name


@pytest.mark.parametrize(
    ("prepare", "options", "message"),
    [
        (None, (), "folder not found"),
        ([], (), "no photographs"),
        ([replace(DRONE, focal_35mm_mm=None)], (), "--focal-px"),
        ([DRONE], ("--crs", "EPSG:4326"), "not a projected CRS"),
        ([DRONE], ("--crs", "EPSG:1"), "not a CRS known to PROJ"),
        ([DRONE], ("--crs", "EPSG:32615"), "EPSG:32632 for example"),
        ([replace(DRONE, kind="panorama")], (), "panorama"),
        ([DRONE], ("--control", "none.txt"), "none.txt"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    folder: Path, photogram: Run, prepare: list[PhotographTags] | None, options: tuple[str, ...], message: str
) -> None:
    if prepare is not None:
        photographed(folder, prepare)
    outcome = photogram("init", folder, *options)
    assert outcome.code == 1
    assert message in outcome.err
    assert len(outcome.err.strip().splitlines()) == 1
    assert not Path("project.yaml").exists()


def test_wrong_usage_is_exit_code_2(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(1))
    assert photogram("init", folder, "--picture-size", "4000").code == 2
    assert photogram("init", folder, "--control-sigma", "0").code == 2
    assert photogram("init").code == 2


def test_thermal_pictures_alone_are_a_survey_as_any_other(folder: Path, photogram: Run) -> None:
    photographed(folder, [replace(tags, kind="thermal") for tags in flown(12)])
    assert photogram("init", folder).code == 0
    assert len(load_project(Path("project.yaml")).photographs) == 12
    assert "of the kind thermal" not in photogram("check", Path("project.yaml")).out


def test_photographs_that_cannot_be_used_are_named_with_the_reason(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(12))
    whole = (folder / "DJI_0003.JPG").read_bytes()
    (folder / "DJI_0003.JPG").write_bytes(whole[: len(whole) // 2])
    photographed(folder, [replace(DRONE, kind="thermal"), replace(DRONE, kind="panorama")], 20)
    photographed(folder, [replace(DRONE, width_px=80)], 30)
    Image.fromarray(np.zeros((HEIGHT, WIDTH), np.uint16)).save(folder / "deep.tif")
    outcome = photogram("init", folder)
    assert outcome.code == 0
    text = squeezed(Path("project.yaml").read_text())
    names = {p.name for p in load_project(Path("project.yaml")).photographs}
    assert names == {f"DJI_{i:04d}.JPG" for i in range(1, 13)} - {"DJI_0003.JPG"}
    for name, reason in (
        ("DJI_0003.JPG", "truncated or damaged"),
        ("DJI_0020.JPG", "thermal"),
        ("DJI_0021.JPG", "panorama"),
        ("DJI_0030.JPG", "80 × 48 px"),
        ("deep.tif", "the only one of 64 × 48 px and 16 bits by a camera, too few"),
    ):
        assert re.search(rf"Left out: [^{{]*{re.escape(reason)}[^{{]*- {{name: {name}}}", text)
        assert name in outcome.out
    assert str(folder) not in text


def deep_copy(jpeg: Path, suffix: str = ".tif") -> Path:
    """Write the same photograph with 16 bits a channel beside it, with its tags."""
    values = read_photograph(jpeg).astype(np.uint16) * 16 + np.arange(WIDTH, dtype=np.uint16)[:, None]
    return write_tiff(jpeg.with_suffix(suffix), values, tags_of_jpeg(jpeg))


def test_raw_and_deep_files_beside_their_pictures_are_not_taken(folder: Path, photogram: Run) -> None:
    """Cameras and converters write an exposure twice; the picture is taken, as before."""
    photographed(folder, flown(6))
    alone = project_of(photogram("init", folder, "--project", "alone.yaml"), "alone.yaml")
    for i in (1, 2):
        path = folder / f"DJI_{i:04d}.JPG"
        write_dng(path.with_suffix(".DNG"), np.zeros((HEIGHT, WIDTH), np.uint16), [], tags_of_jpeg(path))
        deep_copy(folder / f"DJI_{i + 2:04d}.JPG")
    found = project_of(photogram("init", folder), "project.yaml")
    assert found == alone == [f"DJI_{i:04d}.JPG" for i in range(1, 7)]
    text = squeezed(Path("project.yaml").read_text())
    assert "the same exposure as DJI_0003.JPG, which has 8 bits - {name: DJI_0003.tif}" in text
    twin = "another picture of its name shows the same exposure, and is used - {name: DJI_0001.DNG}"
    assert twin in text


def test_raw_files_alone_are_photographs(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(6))
    for path in sorted(folder.glob("*.JPG")):
        write_dng(path.with_suffix(".DNG"), np.zeros((HEIGHT, WIDTH), np.uint16), [path], tags_of_jpeg(path))
        path.unlink()
    assert project_of(photogram("init", folder), "project.yaml") == [f"DJI_{i:04d}.DNG" for i in range(1, 7)]
    project = load_project(Path("project.yaml"))
    assert (project.cameras[0].width_px, project.cameras[0].height_px) == (WIDTH, HEIGHT)
    latitudes = [read_tags(path).latitude_deg for path in sorted(folder.iterdir())]
    assert latitudes == pytest.approx([tags.latitude_deg for tags in flown(6)], abs=1e-8)


def test_png_are_photographs_where_nothing_else_is(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(6))
    Image.fromarray(np.zeros((HEIGHT, WIDTH), np.uint8)).save(folder / "overview.png")
    assert len(project_of(photogram("init", folder), "project.yaml")) == 6
    for path in sorted(folder.glob("*.JPG")):
        with Image.open(path) as picture:
            picture.save(path.with_suffix(".png"), exif=picture.info["exif"])
        path.unlink()
    (folder / "overview.png").unlink()
    Image.fromarray(np.full((HEIGHT, WIDTH), 255, np.uint8)).save(folder / "DJI_0001_mask.png")
    names = project_of(photogram("init", folder, "--project", "png.yaml"), "png.yaml")
    assert names == [f"DJI_{i:04d}.png" for i in range(1, 7)]


def test_photographs_of_two_depths_are_two_cameras(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(12))
    for i in range(7, 13):
        deep_copy(folder / f"DJI_{i:04d}.JPG")
        (folder / f"DJI_{i:04d}.JPG").unlink()
    assert len(project_of(photogram("init", folder), "project.yaml")) == 12
    project = load_project(Path("project.yaml"))
    cameras = [{p.camera for p in project.photographs if p.name.endswith(suffix)} for suffix in (".JPG", ".tif")]
    assert len(project.cameras) == 2
    assert [len(own) for own in cameras] == [1, 1]
    assert cameras[0] != cameras[1]


def test_the_same_photograph_twice_is_taken_once(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(6))
    shutil.copy(folder / "DJI_0002.JPG", folder / "DJI_0002 (1).JPG")
    with Image.open(folder / "DJI_0004.JPG") as picture:  # saved anew, with its tags
        picture.save(folder / "saved again.JPG", quality=70, exif=picture.info["exif"], xmp=picture.info["xmp"])
    burst = Image.fromarray(np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8))
    write_photograph(folder / "burst.JPG", np.asarray(burst), flown(6)[5])  # the next one, within the clock's second
    outcome = photogram("init", folder)
    assert outcome.code == 0
    names = [p.name for p in load_project(Path("project.yaml")).photographs]
    assert names == [*(f"DJI_{i:04d}.JPG" for i in range(1, 7)), "burst.JPG"]
    text = squeezed(Path("project.yaml").read_text())
    assert "Left out: the same photograph as DJI_0002.JPG - {name: DJI_0002 (1).JPG}" in text
    assert "Left out: the same photograph as DJI_0004.JPG - {name: saved again.JPG}" in text
    assert "the same photograph as DJI_0004.JPG" in squeezed(outcome.out)


def test_two_lenses_of_one_body_are_two_cameras(folder: Path, photogram: Run) -> None:
    tags = flown(12)
    lenses = [{"lens": "DL 24mm"}, {"lens": "DL 35mm"}, {"lens_serial": "a1"}, {"lens_serial": "a2"}]
    for first, second in (lenses[:2], lenses[2:], [{"focal_mm": 24.0}, {"focal_mm": 35.0}]):
        shutil.rmtree(folder, ignore_errors=True)
        photographed(folder, [replace(t, **(first if i % 2 else second)) for i, t in enumerate(tags)])
        assert photogram("init", folder, "--focal-px", "60", "--force").code in (0, 1)
        outcome = photogram("init", folder, "--force")
        assert outcome.code == 0, outcome.err
        project = load_project(Path("project.yaml"))
        assert len(project.cameras) == 2
        assert [p.camera for p in project.photographs] == [0, 1] * 6


def test_xmp_that_is_not_xml_costs_neither_the_photograph_nor_its_marks(
    folder: Path, photogram: Run, tmp_path: Path
) -> None:
    photographed(folder, flown(12))
    path = folder / "DJI_0002.JPG"
    path.write_bytes(path.read_bytes().replace(b"</rdf:RDF>", b"</rdf:RDX>"))
    broken = (folder / "DJI_0005.JPG").read_bytes()
    (folder / "DJI_0005.JPG").write_bytes(broken[: len(broken) // 2])
    gcp_list(tmp_path / "gcp.txt", "EPSG:32632", "EPSG:32632", 0.5)
    with (tmp_path / "gcp.txt").open("a") as file:
        file.write("462300.0 5249000.0 440.0 10 12 DJI_0005.JPG G9\n462300.0 5249000.0 440.0 10 12 DJI_0006.JPG G9\n")
    outcome = photogram("init", folder, "--control", "gcp.txt")
    assert outcome.code == 0, outcome.err
    said = squeezed(outcome.out)
    assert "DJI_0002.JPG: the XMP tags are not valid XML" in said
    assert "1 of " in said
    assert "marks is in a photograph that is not in the project and is left out: DJI_0005.JPG (1)" in said
    text = squeezed(Path("project.yaml").read_text())
    assert "Warning: DJI_0002.JPG: the XMP tags are not valid XML" in text
    project = load_project(Path("project.yaml"))
    assert {p.name for p in project.photographs} >= {"DJI_0002.JPG"}
    assert len(project.control_points[-1].mark_photograph) == 1


def test_positions_of_a_frozen_receiver_are_not_used(folder: Path, photogram: Run) -> None:
    tags = flown(8)
    photographed(folder, [*tags[:4], *(replace(t, latitude_deg=tags[3].latitude_deg) for t in tags[4:])])
    outcome = photogram("init", folder)
    assert outcome.code == 0
    assert "4 photographs have the GNSS position of another time, which is not used" in squeezed(outcome.out)
    text = squeezed(Path("project.yaml").read_text())
    assert "Warning: DJI_0005.JPG, DJI_0006.JPG, DJI_0007.JPG, DJI_0008.JPG: 4 photographs" in text
    assert "4 without stated accuracy, 4 without a position" in text


def test_a_project_whose_positions_are_all_one_can_be_checked(folder: Path, photogram: Run) -> None:
    """No position is used, and none lacks its standard deviation."""
    photographed(folder, [replace(t, latitude_deg=46.0) for t in flown(8)])
    assert photogram("init", folder).code == 0
    assert load_project(Path("project.yaml")).photographs[0].gnss_sigma_m is not None
    assert "standard deviation" not in squeezed(photogram("check", "project.yaml").out)


def test_cameras_are_listed_and_photographs_say_which(folder: Path, photogram: Run) -> None:
    dewarp = Dewarp("2020-01-02", (60.0, 60.2), (0.5, -0.25), (-0.2, 0.1, -0.03), (0.001, -0.002), (80.0, 60.0))
    other = replace(DRONE, model="FC6310R", serial="x", width_px=80, height_px=60, dewarp=dewarp, focal_35mm_mm=30.0)
    photographed(folder, flown(3))
    photographed(folder, flown(4, other), 10)
    outcome = photogram("init", folder)
    assert outcome.code == 0
    project = load_project(Path("project.yaml"))
    cameras = [project.cameras[p.camera] for p in project.photographs]
    assert [c.name for c in cameras] == ["dji_fc300s_64x48"] * 3 + ["dji_fc6310r_80x60"] * 4
    calibrated = cameras[-1]
    assert calibrated.focal_px == pytest.approx(60.1)
    assert calibrated.principal_point_px == pytest.approx([40.0, 29.25])
    assert calibrated.radial == pytest.approx([*dewarp.radial, 0.0])
    assert calibrated.tangential == pytest.approx(dewarp.tangential)
    assert calibrated.sigmas == pytest.approx(
        [0.1202, 0.08, 0.08, 0.01, 0.01, 0.01, 0, 0.001, 0.001, 0, 0, 0], rel=5e-3
    )
    assert project.camera_source[cameras[-1].name == "dji_fc300s_64x48"] == "DewarpData of 2020-01-02"
    assert {p.flight for p in project.photographs} == {"1", "2"}, "two bodies in the air"


def test_flights_are_numbered_where_there_are_several(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(3))
    photographed(folder, flown(3, replace(DRONE, time=NOON + timedelta(minutes=25))), 4)
    assert photogram("init", folder).code == 0
    project = load_project(Path("project.yaml"))
    assert [p.flight for p in project.photographs] == ["1"] * 3 + ["2"] * 3


def test_other_sites_are_left_out_and_photographs_without_position_stay(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(8))
    photographed(folder, flown(2, replace(DRONE, longitude_deg=8.6)), 9)
    photographed(folder, flown(1, replace(DRONE, longitude_deg=-74.0, latitude_deg=11.0)), 11)
    photographed(folder, [replace(DRONE, longitude_deg=None, latitude_deg=None, height_m=None)], 12)
    outcome = photogram("init", folder)
    assert outcome.code == 0
    text = squeezed(Path("project.yaml").read_text())
    project = load_project(Path("project.yaml"))
    assert {int(p.name[4:8]) for p in project.photographs} == {*range(1, 9), 12}
    assert re.search(r"another site, 7\.5 km away at longitude 8\.60000, latitude 47\.400\d\d, 2 photographs", text)
    assert "- {name: DJI_0009.JPG} - {name: DJI_0010.JPG}" in text
    assert "1 without a position" in text
    for shown in ("2 photographs 7.5 km away", "DJI_0009.JPG, DJI_0010.JPG", "DJI_0011.JPG", "1 without a position"):
        assert shown in squeezed(outcome.out)


# ---- GNSS ------------------------------------------------------------------------------------------------------------

STD = (0.012, 0.014, 0.025)


@pytest.mark.parametrize(
    ("change", "kind", "sigma_m"),
    [
        ({"rtk_flag": 50, "gnss_sigma_m": STD}, "RTK fix", STD),
        ({"rtk_flag": 50, "gnss_sigma_m": (0.002, 0.014, 0.003)}, "RTK fix", (0.01, 0.014, 0.015)),
        ({"rtk_flag": 50}, "RTK fix", (0.02, 0.02, 0.03)),
        ({"rtk_flag": 34, "gnss_sigma_m": (0.47686, 0.19651, 0.44847)}, "RTK float", (0.477, 0.2, 0.448)),
        ({"rtk_flag": 32, "gnss_sigma_m": STD}, "RTK float", (0.2, 0.2, 0.4)),
        ({"rtk_flag": 16, "gnss_sigma_m": (1.2, 1.7, 2.5)}, "single (autonomous)", (1.5, 1.7, 3.0)),
        ({"rtk_flag": 0, "gnss_sigma_m": STD}, "without stated accuracy", (2.0, 2.0, 3.0)),
        ({}, "without stated accuracy", (2.0, 2.0, 3.0)),
        ({"gnss_sigma_m": (0.02, 0.02, 0.04)}, "with stated accuracy", (0.02, 0.02, 0.04)),
        ({"gnss_horizontal_error_m": 4.5}, "with stated accuracy", (4.5, 4.5, 9.0)),
    ],
)
def test_sigmas_are_those_that_the_solution_deserves_along_each_axis(
    change: dict[str, Any], kind: str, sigma_m: tuple[float, float, float]
) -> None:
    gnss = gnss_of(replace(DRONE, **change))
    assert gnss is not None
    assert (gnss.kind, gnss.sigma_m) == (kind, sigma_m)


def test_a_position_without_height_is_no_position() -> None:
    assert gnss_of(replace(DRONE, height_m=None)) is None


def test_sigmas_of_a_fix_a_float_and_a_single_solution_stay_apart_in_the_project(folder: Path, photogram: Run) -> None:
    flags = [(50, STD), (50, STD), (34, (0.3, 0.25, 0.5)), (16, (1.0, 1.0, 2.0)), (50, (0.011, 0.02, 0.03))]
    tags = [replace(t, rtk_flag=f, gnss_sigma_m=s) for t, (f, s) in zip(flown(5), flags, strict=True)]
    photographed(folder, tags)
    outcome = photogram("init", folder)
    assert outcome.code == 0
    project = load_project(Path("project.yaml"))
    found = [p.gnss_sigma_m.tolist() for p in project.photographs if p.gnss_sigma_m is not None]
    assert found == [[*STD], [*STD], [0.3, 0.25, 0.5], [1.5, 1.5, 3.0], [0.011, 0.02, 0.03]]
    values = values_of(Path("project.yaml"))["photographs"]
    assert values["gnss_sigma_m"] == [*STD]
    assert ["gnss_sigma_m" in p for p in values["list"]] == [False, False, True, True, True]
    assert "3 RTK fix, 1 RTK float, 1 single (autonomous)" in squeezed(outcome.out)
    assert project.gnss_offset_sigma_m.tolist() == [0.02, 0.02, 0.03]


def mrk(folder: Path, name: str, flags: Sequence[int], first: int = 1) -> None:
    lines = [
        f"{n}\t302400.25\t[2312]\t10,N\t-5,E\t200,V\t47.4,Lat\t8.5,Lon\t500.0,Ellh\t0.012, 0.011, 0.022\t{flag},Q"
        for n, flag in enumerate(flags, first)
    ]
    (folder / name).write_text("\n".join(lines), encoding="utf-8")


def test_an_mrk_beside_the_photographs_is_named_and_tells_the_sigmas(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(3))
    mrk(folder, "100_0001_Timestamp.MRK", [50, 50, 34])
    outcome = photogram("init", folder)
    assert outcome.code == 0
    assert "100_0001_Timestamp.MRK: of 3 photographs" in squeezed(outcome.out)
    assert "2 RTK fix, 1 RTK float" in squeezed(outcome.out)
    values = values_of(Path("project.yaml"))["photographs"]
    assert values["positions"] == [{"path": "photographs/100_0001_Timestamp.MRK"}]
    assert "gnss_sigma_m" not in values
    assert all("gnss_sigma_m" not in p for p in values["list"])
    project = load_project(Path("project.yaml"))
    listed = [p.file_position for p in project.photographs]
    assert [p.solution for p in listed if p is not None] == ["fix", "fix", "float"]


def test_an_mrk_of_each_folder_belongs_to_its_own_photographs(folder: Path, photogram: Run) -> None:
    for number, flight in enumerate(("a", "b")):
        photographed(folder / flight, flown(2, replace(DRONE, time=NOON + timedelta(hours=number))))
        mrk(folder / flight, "x_Timestamp.MRK", [50, 16 if flight == "b" else 50])
    assert photogram("init", folder, "--recursive").code == 0
    solutions = {
        p.name: p.file_position.solution
        for p in load_project(Path("project.yaml")).photographs
        if p.file_position is not None
    }
    assert solutions == {
        "a/DJI_0001.JPG": "fix", "a/DJI_0002.JPG": "fix", "b/DJI_0001.JPG": "fix", "b/DJI_0002.JPG": "single",
    }  # fmt: skip


def test_an_mrk_that_does_not_belong_here_is_not_used_and_said_so(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(2))
    mrk(folder, "far_Timestamp.MRK", [50, 50], first=700)
    (folder / "bad_Timestamp.MRK").write_text("rubbish\nmore\n")
    outcome = photogram("init", folder)
    assert outcome.code == 0
    assert "far_Timestamp.MRK: not used: its numbers 700 to 701 match no file name" in squeezed(outcome.out)
    assert "bad_Timestamp.MRK: not used: 1: is not a line of a DJI MRK file" in squeezed(outcome.out)
    assert "positions" not in values_of(Path("project.yaml"))["photographs"]


@pytest.mark.parametrize(
    ("gnss", "has_control", "sigma_m"),
    [
        (Gnss("RTK fix", STD), True, (0.1, 0.1, 0.15)),
        (Gnss("RTK fix", STD), False, RTK_OFFSET_SIGMA_M),
        (Gnss("with stated accuracy", STD), False, RTK_OFFSET_SIGMA_M),
        (Gnss("with stated accuracy", (3.0, 3.0, 6.0)), True, (3.0, 3.0, 30.0)),
        (Gnss("without stated accuracy", (2.0, 2.0, 3.0)), True, (3.0, 3.0, 30.0)),
        (Gnss("RTK float", (0.3, 0.3, 0.5)), False, (2.0, 2.0, 10.0)),
    ],
)
def test_offset_of_a_flight(gnss: Gnss, has_control: bool, sigma_m: tuple[float, float, float]) -> None:
    assert offset_prior([gnss, None, gnss], has_control)[0] == sigma_m
    assert offset_prior([None], has_control)[0] == offset_prior([], has_control)[0]


# ---- ground points ---------------------------------------------------------------------------------------------------


def gcp_list(path: Path, header: str, crs: str, scale: float = 1.0) -> Path:
    ground = map_from_geodetic(crs, np.array([[LONGITUDE, LATITUDE + 1e-4 * i, 440.0] for i in range(3)]))
    lines = [header]
    for number, (e, n, h) in enumerate(ground):
        for photograph in (1, 2):
            u, v = scale * (10 + 15 * number), scale * (12 + 8 * photograph)
            lines.append(f"{e:.3f} {n:.3f} {h:.3f} {u} {v} DJI_{photograph:04d}.JPG g{number}")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_control_file_gives_its_map_grid_and_is_named(folder: Path, photogram: Run, tmp_path: Path) -> None:
    photographed(folder, flown(3))
    gcp_list(tmp_path / "gcp_list.txt", "EPSG:2056", "EPSG:2056")
    outcome = photogram("init", folder, "--control", "gcp_list.txt", "--project", "p/project.yaml")
    assert outcome.code == 1, "the folder of the project file does not exist"
    (tmp_path / "p").mkdir()
    outcome = photogram("init", folder, "--control", "gcp_list.txt", "--project", "p/project.yaml")
    assert (outcome.code, outcome.err) == (0, "")
    project = load_project(Path("p/project.yaml"))
    assert project.crs == "EPSG:2056"
    assert all(p.sigma_assumed and p.mark_sigma_assumed for p in project.control_points)
    assert [(p.name, p.role) for p in project.control_points] == [(f"g{i}", "control") for i in range(3)]
    assert all(p.sigma_m.tolist() == [0.03, 0.03, 0.05] for p in project.control_points)
    assert project.control_points[1].mark_pixel.tolist() == [[25, 20], [25, 28]]
    assert project.gnss_offset_sigma_m.tolist() == [3, 3, 30]
    assert "3 points of ../gcp_list.txt" in squeezed(outcome.out)


def test_marks_of_a_larger_picture_and_the_accuracy_asked_for(folder: Path, photogram: Run, tmp_path: Path) -> None:
    photographed(folder, flown(3))
    gcp_list(tmp_path / "gcp.txt", "+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs", "EPSG:32632", 5.0)
    options = ("--control", "gcp.txt", "--picture-size", f"{5 * WIDTH}x{5 * HEIGHT}", "--control-sigma", "0.5")
    outcome = photogram("init", folder, *options)
    assert (outcome.code, outcome.err) == (0, "")
    project = load_project(Path("project.yaml"))
    assert project.crs == "EPSG:32632"
    point = project.control_points[1]
    assert point.sigma_m.tolist() == [0.5, 0.5, 0.5]
    assert (point.sigma_assumed, point.mark_sigma_assumed) == (False, True)
    # The centre of the top-left pixel is (0, 0) in both pictures: 125 of 320 px is (125.5 / 5) − 0.5 of 64.
    assert point.mark_pixel[0] == pytest.approx([24.6, 19.6])


def test_marks_that_do_not_fit_are_told_after_the_file_is_written(folder: Path, photogram: Run, tmp_path: Path) -> None:
    photographed(folder, flown(3))
    gcp_list(tmp_path / "gcp.txt", "EPSG:32632", "EPSG:32632", 5.0)
    outcome = photogram("init", folder, "--control", "gcp.txt")
    assert outcome.code == 1
    assert "project.yaml written" in outcome.err
    assert "picture_size_px" in outcome.err
    assert Path("project.yaml").exists()


def test_tables_of_points_and_marks_with_check_points(folder: Path, photogram: Run, tmp_path: Path) -> None:
    photographed(folder, flown(3))
    plan = map_from_geodetic("EPSG:32632", np.array([[LONGITUDE, LATITUDE, 440.0]]))[0]
    rows = [f"{n},{plan[0] + i:.3f},{plan[1]:.3f},440.0,0.02,0.02,0.04" for i, n in enumerate("abcd")]
    header = "name,easting,northing,height,sigma_e,sigma_n,sigma_h"
    (tmp_path / "control.csv").write_text("\n".join([header, *rows[:3]]))
    (tmp_path / "check.csv").write_text("\n".join([header, rows[3]]))
    marks = [f"{n},DJI_0001.JPG,{10 + 10 * i},20" for i, n in enumerate("abcd")]
    (tmp_path / "marks.csv").write_text("\n".join(["name,photograph,u,v", *marks]))
    outcome = photogram("init", folder, "--control", "control.csv", "--check", "check.csv", "--marks", "marks.csv")
    assert (outcome.code, outcome.err) == (0, "")
    project = load_project(Path("project.yaml"))
    assert [(p.name, p.role, len(p.mark_pixel)) for p in project.control_points] == [
        ("a", "control", 1),
        ("b", "control", 1),
        ("c", "control", 1),
        ("d", "check", 1),
    ]
    assert all(p.sigma_m.tolist() == [0.02, 0.02, 0.04] for p in project.control_points)
    entries = values_of(Path("project.yaml"))["control_points"]["files"]
    assert [entry.get("sigma_assumed") for entry in entries] == [None, None]
    assert [entry["mark_sigma_assumed"] for entry in entries] == [True, True]
    assert not any(p.sigma_assumed for p in project.control_points)


def test_a_list_without_accuracy_gets_sigmas_that_are_said_to_be_assumed(
    folder: Path, photogram: Run, tmp_path: Path
) -> None:
    photographed(folder, flown(3))
    gcp_list(tmp_path / "gcp_list.txt", "EPSG:32632", "EPSG:32632")
    assert photogram("init", folder, "--control", "gcp_list.txt").code == 0
    (entry,) = values_of(Path("project.yaml"))["control_points"]["files"]
    assert (entry["sigma_m"], entry["sigma_assumed"]) == ([0.03, 0.03, 0.05], True)
    assert (entry["mark_sigma_px"], entry["mark_sigma_assumed"]) == (1.0, True)


def test_points_without_marks_are_pointed_out(folder: Path, photogram: Run, tmp_path: Path) -> None:
    photographed(folder, flown(3))
    (tmp_path / "c.csv").write_text(f"name,longitude,latitude,height\na,{LONGITUDE},{LATITUDE},440\n")
    outcome = photogram("init", folder, "--control", "c.csv")
    assert "no marks for c.csv yet: photogram mark makes them" in squeezed(outcome.out)
    text = Path("project.yaml").read_text()
    assert "crs: EPSG:4326 # longitude and latitude" in text
    assert "crs: EPSG:32632" in text


PLACE = map_from_geodetic("EPSG:2056", np.array([[LONGITUDE, LATITUDE, 440.0]]))
PHOTOGRAPHS = [TaggedPhotograph(f"{i}.jpg", t) for i, t in enumerate(flown(3))]


def test_points_of_an_unknown_map_grid_far_from_the_photographs_are_refused() -> None:
    far = ControlFile("c.csv", "control", PLACE)
    with pytest.raises(
        ProjectError, match=r"c\.csv: the file does not name its map grid; in EPSG:32632 .* not among .*--crs"
    ):
        draft_project(PHOTOGRAPHS, [], Wishes(control=(far,)))
    assert draft_project(PHOTOGRAPHS, [], Wishes(crs="EPSG:2056", control=(far,))).crs == "EPSG:2056"
    near = replace(far, position=map_from_geodetic("EPSG:32632", geodetic_from_map("EPSG:2056", PLACE)))
    assert draft_project(PHOTOGRAPHS, [], Wishes(control=(near,))).crs == "EPSG:32632"


def test_points_in_another_zone_propose_the_one_in_which_they_lie_among_the_photographs() -> None:
    place = np.array([[LONGITUDE, LATITUDE, 440.0]])
    west, here, own = (
        ControlFile(f"{name}.csv", "control", map_from_geodetic(crs, place))
        for name, crs in (("west", "EPSG:32631"), ("here", "EPSG:32632"), ("own", "EPSG:25831"))
    )
    draft = draft_project(PHOTOGRAPHS, [], Wishes(control=(west,)))
    assert draft.crs == "EPSG:32631"
    assert "the points of west.csv lie among the photographs" in draft.crs_reason
    assert re.search(r"in the photographs' own, EPSG:32632, they would lie [34]\d\d km away", draft.crs_reason)
    assert "crs: EPSG:32631 # not stated in the file" in project_text(draft, "photographs")
    both = draft_project(PHOTOGRAPHS, [], Wishes(control=(west, here)))
    assert (both.crs, [file.grid for file in both.control]) == ("EPSG:32632", ["EPSG:32631", None])
    assert "crs: EPSG:32631 # not stated in the file; its points lie among" in project_text(both, "photographs")
    declared = draft_project(PHOTOGRAPHS, [], Wishes(crs="EPSG:25832", control=(own,)))
    assert (declared.crs, declared.control[0].grid) == ("EPSG:25832", "EPSG:25831")
    assert draft_project(PHOTOGRAPHS, [], Wishes(crs="EPSG:25832", control=(here,))).control[0].grid is None


@pytest.mark.parametrize(
    ("stated", "remedy"),
    [
        ("EPSG:32732", "write EPSG:32632 into the file, as its points lie among the photographs there"),
        ("EPSG:32640", "give the map grid of the site, EPSG:32632 for example"),
    ],
)
def test_a_file_that_names_a_zone_without_the_photographs_is_told_the_right_one(stated: str, remedy: str) -> None:
    points = map_from_geodetic("EPSG:32632", np.array([[LONGITUDE, LATITUDE, 440.0]]))
    wishes = Wishes(control=(ControlFile("points.csv", "control", points, crs=stated),))
    with pytest.raises(ProjectError, match=f"points.csv: {stated} .* is valid for .*: {remedy}"):
        draft_project(PHOTOGRAPHS, [], wishes)


def test_control_in_degrees_leaves_the_map_grid_to_the_photographs() -> None:
    file = ControlFile("c.txt", "control", geodetic_from_map("EPSG:2056", PLACE), crs="EPSG:4326")
    assert draft_project(PHOTOGRAPHS, [], Wishes(control=(file,))).crs == "EPSG:32632"


def test_control_elsewhere_is_refused() -> None:
    file = ControlFile("c.txt", "control", PLACE, crs="EPSG:32615")
    with pytest.raises(ProjectError, match="is valid for longitude"):
        draft_project(PHOTOGRAPHS, [], Wishes(control=(file,)))


def test_a_map_grid_that_is_none_is_refused() -> None:
    with pytest.raises(FrameError, match="not a projected CRS"):
        draft_project(PHOTOGRAPHS, [], Wishes(crs="EPSG:4258"))


@pytest.mark.parametrize(
    ("count", "says"), [(1, "the only one of 64 × 48 px by X"), (2, "one of 2 of 64 × 48 px by X")]
)
def test_photographs_of_a_camera_that_took_next_to_none_are_left_out(count: int, says: str) -> None:
    many = [TaggedPhotograph(f"m{i}.jpg", t) for i, t in enumerate(flown(60))]
    other = [TaggedPhotograph(f"x{i}.jpg", replace(t, model="X")) for i, t in enumerate(flown(count))]
    draft = draft_project([*many, *other], [], Wishes())
    assert [p.name for p in draft.left_out] == [p.name for p in other]
    assert all(p.reason.startswith(says) for p in draft.left_out)


def test_focal_length_of_several_cameras_must_be_wanted_by_one() -> None:
    other = [replace(t, model="X", focal_35mm_mm=None) for t in flown(3)]
    both = [*PHOTOGRAPHS, *(TaggedPhotograph(f"x{i}.jpg", t) for i, t in enumerate(other))]
    cameras = {c.name: c for c in draft_project(both, [], Wishes(focal_px=50.0)).cameras}
    assert cameras["dji_x_64x48"].focal_px == 50.0
    assert cameras["dji_fc300s_64x48"].focal_px != 50.0
    assert draft_project(PHOTOGRAPHS, [], Wishes(focal_px=50.0)).cameras[0].focal_px == 50.0
    third = [*both, *(TaggedPhotograph(f"y{i}.jpg", replace(t, model="Y")) for i, t in enumerate(other))]
    with pytest.raises(ProjectError, match=r"give --focal-px dji_x_64x48=… --focal-px dji_y_64x48=…"):
        draft_project(third, [], Wishes(focal_px=50.0))
    named = draft_project(third, [], Wishes(focal_px=50.0, focal_px_of={"dji_y_64x48": 20.0}))
    assert {c.name: c.focal_px for c in named.cameras if c.name != "dji_fc300s_64x48"} == {
        "dji_x_64x48": 50.0, "dji_y_64x48": 20.0,
    }  # fmt: skip
    with pytest.raises(ProjectError, match=r"--focal-px drone=…: no camera is called so; the cameras are dji_"):
        draft_project(third, [], Wishes(focal_px_of={"drone": 20.0}))
    known = [replace(p, tags=replace(p.tags, focal_35mm_mm=20.0)) for p in both]
    with pytest.raises(ProjectError, match="--focal-px"):
        draft_project(known, [], Wishes(focal_px=50.0))


def test_pictures_that_are_not_read_are_listed(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(4))
    (folder / "IMG_1.bmp").write_bytes(b"bmp")
    (folder / "DJI_0002.ARW").write_bytes(b"the raw picture of a photograph")
    (folder / "IMG_2.webp").write_bytes(b"webp")
    outcome = photogram("init", folder)
    assert outcome.code == 0
    said = squeezed(outcome.out)
    assert (
        "IMG_1.bmp, IMG_2.webp: pictures of this kind are not read: convert them to JPEG or TIFF, with their tags"
        in said
    )
    assert "DJI_0002.ARW: another picture of its name shows the same exposure, and is used" in said
    for path in folder.glob("*.JPG"):
        path.unlink()
    (folder / "DJI_0002.ARW").unlink()
    outcome = photogram("init", folder, "--force")
    assert outcome.code == 1
    assert "2 pictures (IMG_1.bmp, IMG_2.webp) of kinds that are not read" in " ".join(outcome.err.split())


# ---- real photographs ------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("folder")
def test_brighton_beach(photogram: Run, shared_data: SharedData) -> None:
    assert photogram("init", shared_data("brighton_beach") / "images").code == 0
    project = load_project(Path("project.yaml"))
    assert project.crs == "EPSG:32615"
    assert len(project.photographs) == 18
    # The picture is the 16:9 part of a 4:3 sensor: 3.61 mm at 1.56 µm are 2314 px.
    assert project.cameras[0].focal_px == pytest.approx(2314.0, rel=5e-3)


@pytest.mark.usefixtures("folder")
def test_rtk_photographs_of_two_sites(photogram: Run, shared_data: SharedData) -> None:
    outcome = photogram("init", shared_data("p4m_rtk_xmp"))
    assert outcome.code == 0
    project = load_project(Path("project.yaml"))
    sigmas = {p.name: p.gnss_sigma_m.tolist() for p in project.photographs if p.gnss_sigma_m is not None}
    assert sigmas == {
        "DJI_0220.JPG": [0.477, 0.2, 0.448],
        "DJI_0280.JPG": [0.013, 0.017, 0.026],
        "DJI_0400.JPG": [0.015, 0.018, 0.028],
        "DJI_0920.JPG": [0.012, 0.015, 0.025],
    }
    assert project.crs == "EPSG:32618"
    assert "# - {name: DJI_0010.JPG}" in Path("project.yaml").read_text()
    assert "3 RTK fix, 1 RTK float" in squeezed(outcome.out)


@pytest.mark.usefixtures("folder")
def test_sheffield_with_marks_of_the_full_size(photogram: Run, shared_data: SharedData) -> None:
    site = shared_data("sheffield_cross")
    options = ("--control", site / "gcp_file.txt", "--picture-size", "4000x3000", "--control-sigma", "0.5")
    assert photogram("init", site / "images", *options).code == 0
    project = load_project(Path("project.yaml"))
    assert project.crs == "EPSG:32617"
    assert len(project.photographs) == 41
    assert len(project.control_points) == 5
    assert sum(len(p.mark_pixel) for p in project.control_points) == 25


def test_a_simulated_survey_is_drafted_as_it_was_flown(pristine_survey: Path, folder: Path, photogram: Run) -> None:
    assert not folder.exists()
    truth = load_project(pristine_survey / "project.yaml")
    focal_px = truth.cameras[0].focal_px
    options = ("--crs", truth.crs, "--focal-px", f"{focal_px:.3f}")
    assert photogram("init", pristine_survey / "photographs", *options).code == 0
    project = load_project(Path("project.yaml"))
    assert [p.name for p in project.photographs] == [p.name for p in truth.photographs]
    assert project.crs == truth.crs
    assert project.cameras[0].focal_px == pytest.approx(focal_px, abs=1e-3)
    size = [(c.width_px, c.height_px) for c in (project.cameras[0], truth.cameras[0])]
    assert size[0] == size[1]


# ---- heights -------------------------------------------------------------------------------------------------------

RTK = replace(DRONE, rtk_flag=50, gnss_sigma_m=STD, height_is_ellipsoidal=True)


def test_heights_that_the_tags_know_are_declared(folder: Path, photogram: Run) -> None:
    photographed(folder, flown(3, RTK))
    assert photogram("init", folder).code == 0
    heights = load_project(Path("project.yaml")).heights
    assert (heights.output, heights.gnss, heights.control_points) == ("ellipsoidal", "ellipsoidal", None)


def test_heights_that_nobody_knows_are_asked_for(folder: Path, photogram: Run, tmp_path: Path) -> None:
    photographed(folder, flown(3, RTK))
    gcp_list(tmp_path / "gcp_list.txt", "EPSG:32632", "EPSG:32632")
    outcome = photogram("init", folder, "--control", "gcp_list.txt")
    assert outcome.code == 0
    assert "heights not declared the photographs tell by how much" in squeezed(outcome.out)
    path = Path("project.yaml")
    assert load_project(path).heights.output is None
    # what stands there as a comment is what is to be written
    block = re.sub(
        r"^# (heights:|  output|  gnss|  control_points|  geoid)", r"\1", path.read_text(), flags=re.MULTILINE
    )
    said = {"output": "ellipsoidal", "gnss": "ellipsoidal", "control_points": "orthometric", "geoid": "EGM96"}
    assert yaml.safe_load(block)["heights"] == said


def test_heights_may_be_given(folder: Path, photogram: Run, tmp_path: Path, sloping_geoid: Any) -> None:
    photographed(folder, flown(3, replace(RTK, latitude_deg=52.0, longitude_deg=9.5)))
    (tmp_path / "points.csv").write_text("name,easting,northing,height\nA,534300,5761400,120\nB,534350,5761420,121\n")
    options = ("--control", "points.csv", "--heights")
    assert photogram("init", folder, *options, "orthometric").code == 2  # above which geoid?
    outcome = photogram("init", folder, *options, "orthometric", "--geoid", sloping_geoid.path)
    assert (outcome.code, outcome.err) == (0, "")
    project = load_project(Path("project.yaml"))
    assert (project.heights.output, project.heights.gnss) == ("orthometric", "ellipsoidal")
    assert [p.position_map_m[2] for p in project.control_points] == [120.0, 121.0]
    assert photogram("init", folder, *options, "ellipsoidal", "--force").code == 0
    assert load_project(Path("project.yaml")).heights.control_points == "ellipsoidal"


def test_photographs_without_positions_and_control_become_a_free_network() -> None:
    bare = [
        TaggedPhotograph(f"{n}.JPG", replace(DRONE, longitude_deg=None, latitude_deg=None, height_m=None))
        for n in range(3)
    ]
    for wishes, photographs in ((Wishes(), bare), (Wishes(crs="none"), [TaggedPhotograph("a.JPG", DRONE)])):
        draft = draft_project(photographs, (), wishes)
        values = yaml.safe_load(text := project_text(draft, "photographs"))
        assert values["crs"] == "none"
        assert not {"gnss", "heights", "control_points"} & set(values)
        assert "# distances:" in text


def test_what_begins_a_flight_is_said_of_cameras_that_fire_at_once() -> None:
    said = " ".join(line.strip(" #") for line in flights_comment(2))
    assert said.startswith("2 flights: another camera body, a pause of more than ten minutes or a gap in the positions")
    assert flights_comment(1) == []
