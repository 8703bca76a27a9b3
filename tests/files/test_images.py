import hashlib
import io
import json
import tracemalloc
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from makers import SharedData
from PIL import ExifTags, Image
from scipy.spatial.transform import Rotation

from photogram.camera import VERTICAL, rotation_from_gimbal
from photogram.errors import ImageError, WorkspaceError
from photogram.files.atomic import replacing
from photogram.files.photographs import identification, images
from photogram.files.photographs.identification import MOST_BYTES, read_content, read_ends
from photogram.files.photographs.images import (
    check_photograph,
    inspect_photograph,
    read_grey,
    read_leading_tags,
    read_patches,
    read_photograph,
    read_tags,
    read_window,
    thumbnail,
    write_photograph,
)
from photogram.files.photographs.tags import Dewarp, Kind, PhotographTags, gimbal_from_camera_angles
from photogram.files.reading import read_rest, read_whole

READERS = (read_photograph, read_grey, check_photograph)

JPEG_OPTIONS: list[dict[str, Any]] = [
    {"subsampling": "4:2:0"},
    {"subsampling": "4:2:2"},
    {"subsampling": "4:4:4", "restart_marker_rows": 1},
    {"progressive": True},
]

TAGS = PhotographTags(
    make="DJI",
    model="FC6310R",
    serial="ce3ccab369970d29",
    lens="DL 24mm",
    lens_serial="0123",
    band="RGB",
    width_px=160,
    height_px=96,
    focal_mm=8.8,
    focal_35mm_mm=24.0,
    pixels_per_mm=416.25,
    calibrated_focal_mm=8.81,
    calibrated_radial=(-0.26, 0.11, -0.03),
    time=datetime(2019, 5, 9, 10, 0, 7, 250000, timezone(timedelta(hours=-3, minutes=-30))),
    longitude_deg=-74.1855840912,
    latitude_deg=-11.2246986034,
    height_m=-40.524,
    height_is_ellipsoidal=True,
    height_above_take_off_m=25.05,
    gnss_sigma_m=(0.01568, 0.01101, 0.03329),
    gnss_horizontal_error_m=0.021,
    rtk_flag=50,
    gimbal_yaw_deg=-162.9,
    gimbal_pitch_deg=-89.9,
    gimbal_roll_deg=180.0,
    flight_yaw_deg=17.0,
    flight_pitch_deg=4.6,
    flight_roll_deg=-1.1,
    dewarp=Dewarp(
        "2019-02-04",
        (1943.4300537, 1934.9899902),
        (8.1140137, -2.197998),
        (-0.408528, 0.360104, -0.414649),
        (0.0013461, 1e-7),
        (1600.0, 960.0),
        applied=True,
    ),
)


@pytest.fixture
def photograph(tmp_path: Path) -> Path:
    rng = np.random.default_rng(5)
    rows, columns = np.mgrid[0:96, 0:160]
    smooth = np.stack([rows, columns, rows + columns], axis=2)
    path = tmp_path / "DJI_0001.JPG"
    write_photograph(path, (smooth % 200 + rng.integers(0, 40, smooth.shape)).astype(np.uint8), TAGS)
    return path


def damaged(photograph: Path, content: bytes) -> Path:
    path = photograph.with_name("DJI_0002.JPG")
    path.write_bytes(content)
    return path


def test_tags_survive_writing_and_reading(photograph: Path) -> None:
    assert read_tags(photograph) == TAGS


@pytest.mark.parametrize("kind", ["thermal", "panorama", "fisheye"])
@pytest.mark.parametrize("ellipsoidal", [True, False])
def test_kind_and_heights_survive_writing_and_reading(tmp_path: Path, kind: Kind, ellipsoidal: bool) -> None:
    tags = replace(TAGS, kind=kind, height_is_ellipsoidal=ellipsoidal)
    write_photograph(tmp_path / "a.jpg", np.zeros((96, 160, 3), np.uint8), tags)
    assert inspect_photograph(tmp_path / "a.jpg") == tags


def test_tags_are_read_without_the_pixels(photograph: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where more stands before the pixels than is read at first, and where the pixels are missing."""
    content = photograph.read_bytes()
    scan = content.index(b"\xff\xda")
    assert read_leading_tags(photograph, (160, 96)) == TAGS
    monkeypatch.setattr(identification, "_LEADING_BYTES", 100)
    assert read_leading_tags(photograph, (160, 96)) == TAGS
    assert read_leading_tags(damaged(photograph, content[: scan + 20]), (160, 96)) == TAGS
    with pytest.raises(ImageError, match="160 × 96 px, but its camera has 96 × 160 px"):
        read_leading_tags(photograph, (96, 160))
    for end in range(16, scan, 97):  # damage to what stands before the pixels is said, or the tags say it
        with pytest.raises(ImageError, match="DJI_0002"):
            read_leading_tags(damaged(photograph, content[:end]), (160, 96))


@pytest.mark.parametrize("kind", ["TIFF", "PNG"])
def test_tags_of_other_formats_are_read_too(tmp_path: Path, kind: str) -> None:
    exif = Image.Exif()
    exif[ExifTags.Base.Model] = "a camera"
    Image.new("L", (32, 24)).save(tmp_path / "a", kind, exif=exif)
    assert read_leading_tags(tmp_path / "a", (32, 24)) == read_tags(tmp_path / "a")
    assert read_leading_tags(tmp_path / "a", (32, 24)).model == "a camera"


@pytest.mark.parametrize(
    "folder", ["exif", "p4m_rtk_xmp", "brighton_beach", "sheffield_cross", "dbat_sxb", "mmvii_gcp4"]
)
def test_real_tags_stand_before_the_pixels(shared_data: SharedData, folder: str) -> None:
    paths = [p for p in sorted(shared_data(folder).rglob("*")) if p.suffix.lower() in (".jpg", ".jpeg")]
    assert paths
    for path in paths[:6]:
        with Image.open(path) as picture:
            size = picture.size
        assert read_leading_tags(path, size) == read_tags(path)


def test_tags_are_none_where_nothing_is_said(tmp_path: Path) -> None:
    path = tmp_path / "bare.jpg"
    Image.new("RGB", (7, 5)).save(path)
    assert read_tags(path) == PhotographTags(width_px=7, height_px=5)
    write_photograph(path, np.zeros((5, 7, 3), np.uint8), PhotographTags())
    assert read_tags(path) == PhotographTags(width_px=7, height_px=5)


def test_position_without_fix_is_none(tmp_path: Path) -> None:
    path = tmp_path / "nofix.jpg"
    tags = PhotographTags(longitude_deg=0.0, latitude_deg=0.0, height_m=0.0, gnss_sigma_m=(0.0, 0.0, 0.0), rtk_flag=0)
    write_photograph(path, np.zeros((5, 7, 3), np.uint8), tags)
    assert read_tags(path) == PhotographTags(width_px=7, height_px=5, rtk_flag=0)


def test_exif_position_stands_alone_without_xmp(photograph: Path) -> None:
    picture = Image.open(photograph)
    path = photograph.with_name("exif_only.jpg")
    picture.save(path, exif=picture.getexif(), xmp=b"")
    tags = read_tags(path)
    assert tags.longitude_deg == pytest.approx(TAGS.longitude_deg, abs=1e-9)
    assert tags.latitude_deg == pytest.approx(TAGS.latitude_deg, abs=1e-9)
    assert tags.height_m == TAGS.height_m
    assert tags.time == TAGS.time
    assert tags.gimbal_yaw_deg is None


def test_clock_that_was_never_set_is_no_time(photograph: Path) -> None:
    content = photograph.read_bytes().replace(b"2019:05:09 10:00:07", b"0000:00:00 00:00:00")
    assert read_tags(damaged(photograph, content)).time is None


def test_pixels_and_grey_of_a_lossless_photograph(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (11, 17, 3)).astype(np.uint8)
    path = tmp_path / "lossless.png"
    Image.fromarray(pixels).save(path)
    assert np.array_equal(read_photograph(path, (17, 11)), pixels)
    luminance = pixels @ np.array([0.299, 0.587, 0.114])
    assert np.abs(read_grey(path).astype(float) - luminance).max() <= 1.0


def test_jpeg_keeps_its_pixels_and_its_luminance(photograph: Path) -> None:
    pixels, grey = read_photograph(photograph, (160, 96)), read_grey(photograph, (160, 96))
    assert pixels.shape == (96, 160, 3)
    assert grey.shape == (96, 160)
    assert pixels.dtype == grey.dtype == np.uint8
    assert pixels.flags.writeable
    assert grey.flags.c_contiguous
    inside = ((pixels > 0) & (pixels < 255)).all(axis=2)
    luminance = pixels @ np.array([0.299, 0.587, 0.114])
    assert np.abs(grey - luminance)[inside].max() <= 2.0
    assert check_photograph(photograph, (160, 96)) == (160, 96)


@pytest.mark.parametrize("mode", ["RGB", "L"])
@pytest.mark.parametrize("options", JPEG_OPTIONS)
def test_jpeg_is_decoded_to_the_pixels_that_pillow_gives(tmp_path: Path, mode: str, options: dict[str, Any]) -> None:
    v, u = np.mgrid[:151, :203]
    waves = 127 + 90 * np.sin(np.stack([u / 7, v / 5, (u + v) / 11], axis=2))
    noise = np.random.default_rng(4).integers(-30, 30, waves.shape)
    path = tmp_path / "waves.jpg"
    Image.fromarray(np.clip(waves + noise, 0, 255).astype(np.uint8)).convert(mode).save(path, quality=88, **options)
    with Image.open(path) as picture:
        assert np.array_equal(read_photograph(path), np.array(picture.convert("RGB")))
    with Image.open(path) as picture:
        picture.draft("L", None)
        assert np.array_equal(read_grey(path), np.array(picture.convert("L")))


def test_what_a_file_holds_beyond_its_stated_size_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some file systems do not say how large a file is."""
    path = tmp_path / "unsized"
    path.write_bytes(bytes(range(100)))
    unsized = path.stat()
    monkeypatch.setattr("os.fstat", lambda _: type("Stat", (), {"st_size": 10, "st_mode": unsized.st_mode})())
    for most, kept in ((1000, 100), (100, 100), (40, 40), (10, 10)):
        with path.open("rb") as stream:
            assert read_rest(stream, most) == bytes(range(kept))


def test_reading_a_file_takes_the_memory_of_the_file(photograph: Path) -> None:
    tracemalloc.start()
    try:
        read_content(photograph)
        read_whole(photograph, MOST_BYTES)
        assert tracemalloc.get_traced_memory()[1] < 4 * photograph.stat().st_size + 1_000_000
    finally:
        tracemalloc.stop()


def test_orientation_tag_does_not_turn_the_pixels(tmp_path: Path) -> None:
    path = tmp_path / "turned.jpg"
    exif = Image.Exif()
    exif[274] = 6
    Image.new("RGB", (40, 24)).save(path, exif=exif)
    assert read_photograph(path).shape == (24, 40, 3)
    assert read_grey(path).shape == (24, 40)
    assert check_photograph(path) == (40, 24)


@pytest.mark.parametrize("read", [*READERS, inspect_photograph])
@pytest.mark.parametrize("kept", [0, 1, 100, 0.5, 0.9, -100, -2, -1])
def test_truncated_jpeg_is_refused(photograph: Path, read: object, kept: float) -> None:
    whole = photograph.read_bytes()
    length = int(kept * len(whole)) if isinstance(kept, float) else kept
    path = damaged(photograph, whole[:length])
    with pytest.raises(ImageError, match=r"DJI_0002\.JPG.*copy it again"):
        read(path)  # type: ignore[operator]


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize("share", [0.7, 0.98])
def test_jpeg_that_ends_in_lost_clusters_is_refused(photograph: Path, read: object, share: float) -> None:
    whole = photograph.read_bytes()
    kept = int(share * len(whole))
    path = damaged(photograph, whole[:kept] + bytes(len(whole) - kept))
    with pytest.raises(ImageError, match="truncated or damaged"):
        read(path)  # type: ignore[operator]


@pytest.mark.parametrize("options", [{"progressive": True}, {"optimize": True}, {"restart_marker_rows": 1}])
def test_sound_jpeg_of_every_kind_is_accepted(tmp_path: Path, options: dict[str, Any]) -> None:
    pixels = np.random.default_rng(2).integers(0, 256, (64, 80, 3)).astype(np.uint8)
    path = tmp_path / "sound.jpg"
    Image.fromarray(pixels).save(path, **options)
    assert check_photograph(path) == (80, 64)
    path.write_bytes(path.read_bytes() + bytes(1000))
    assert check_photograph(path) == (80, 64)


@pytest.mark.parametrize("read", READERS)
def test_wrong_size_is_refused(photograph: Path, read: object) -> None:
    with pytest.raises(ImageError, match=r"DJI_0001\.JPG: 160 × 96 px, but its camera has 96 × 160 px"):
        read(photograph, (96, 160))  # type: ignore[operator]


@pytest.mark.parametrize("read", [*READERS, read_tags])
def test_missing_photograph_is_refused(tmp_path: Path, read: object) -> None:
    with pytest.raises(ImageError, match=r"gone\.jpg: file not found"):
        read(tmp_path / "gone.jpg")  # type: ignore[operator]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"-162.900", b"somewhat", "the XMP tag GimbalYawDegree is 'somewhat', not a number; it is not used"),
        (b"2019-02-04;1943", b"2019-02-04,1943", "the XMP tag DewarpData is "),
    ],
)
def test_a_tag_that_cannot_be_read_is_lost_alone(photograph: Path, old: bytes, new: bytes, message: str) -> None:
    """Another maker's tag of the same name is no reason to lose a photograph."""
    content = photograph.read_bytes()
    assert content.count(old) == 1
    tags = read_tags(damaged(photograph, content.replace(old, new)))
    (said,) = tags.damage
    assert said.startswith(message)
    whole = replace(TAGS, damage=(said,))
    assert tags == (replace(whole, gimbal_yaw_deg=None) if b"162" in old else replace(whole, dewarp=None))


def test_a_position_that_lies_on_no_globe_is_refused(photograph: Path) -> None:
    content = photograph.read_bytes().replace(b"-11.2246986034", b"-91.2246986034")
    with pytest.raises(ImageError, match="impossible"):
        read_tags(damaged(photograph, content))


@pytest.mark.parametrize(("reference", "sign"), [(b"1", -1.0), (b"0", 1.0), (b"\x01", -1.0), (b"\x00", 1.0)])
def test_the_reference_of_a_height_may_be_text(tmp_path: Path, reference: bytes, sign: float) -> None:
    exif = Image.Exif()
    exif[ExifTags.IFD.GPSInfo] = {
        ExifTags.GPS.GPSLatitudeRef: "N", ExifTags.GPS.GPSLatitude: (46.0, 0.0, 0.0),
        ExifTags.GPS.GPSLongitudeRef: "E", ExifTags.GPS.GPSLongitude: (7.0, 0.0, 0.0),
        ExifTags.GPS.GPSAltitudeRef: reference, ExifTags.GPS.GPSAltitude: 330.25,
    }  # fmt: skip
    path = tmp_path / "a.jpg"
    Image.new("RGB", (16, 12)).save(path, exif=exif)
    assert read_tags(path).height_m == pytest.approx(sign * 330.25)


def test_xmp_that_is_not_xml_leaves_exif_and_is_named(photograph: Path) -> None:
    content = photograph.read_bytes()
    broken = damaged(photograph, content.replace(b"</rdf:RDF>", b"</rdf:RDX>"))
    tags = read_tags(broken)
    (said,) = tags.damage
    assert said.startswith("the XMP tags are not valid XML (")
    assert said.endswith("only EXIF is used")
    assert (tags.model, tags.focal_mm, tags.time) == (TAGS.model, TAGS.focal_mm, TAGS.time)
    assert tags.latitude_deg == pytest.approx(TAGS.latitude_deg, abs=1e-8)
    assert (tags.gimbal_pitch_deg, tags.rtk_flag, tags.dewarp) == (None, None, None)
    assert inspect_photograph(broken) == tags


@pytest.mark.filterwarnings("error")
def test_damaged_exif_is_said_in_words_and_not_printed(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[ExifTags.Base.Model], exif[ExifTags.Base.Make] = "a camera with a long name", "a maker with a long name"
    path = tmp_path / "cut.jpg"
    Image.new("L", (32, 24)).save(path, exif=exif.tobytes()[:-70])
    (said,) = read_tags(path).damage
    assert said.startswith("the EXIF tags are damaged (")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [(11_000, 9_000), (20_000, 9_500)])
def test_frames_of_aerial_cameras_are_read_without_a_warning(tmp_path: Path, size: tuple[int, int]) -> None:
    path = tmp_path / "frame.jpg"
    Image.new("L", size, 90).save(path, quality=50)
    assert check_photograph(path, size) == size
    assert inspect_photograph(path).width_px == size[0]
    assert read_grey(path).shape == size[::-1]
    assert thumbnail(path) == pytest.approx(90.0, abs=2.0)


def test_more_than_a_gigapixel_is_refused_in_words(tmp_path: Path) -> None:
    content = io.BytesIO()
    Image.new("L", (16, 16)).save(content, "PNG")
    head = bytearray(content.getvalue())
    head[16:24] = (40_000).to_bytes(4, "big") + (30_000).to_bytes(4, "big")
    head[29:33] = zlib.crc32(bytes(head[12:29])).to_bytes(4, "big")
    (tmp_path / "mosaic.png").write_bytes(head)
    for read in (*READERS, inspect_photograph, read_tags):
        with pytest.raises(ImageError, match=r"40000 × 30000 px are 1200 megapixels, photogram reads up to 1000"):
            read(tmp_path / "mosaic.png")


def test_photograph_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    pixels = np.zeros((5, 7, 3), np.uint8)
    with pytest.raises(WorkspaceError, match="cannot be written"):
        write_photograph(tmp_path / "nowhere" / "a.jpg", pixels, PhotographTags())
    with pytest.raises(ValueError, match="7 × 5"):
        write_photograph(tmp_path / "a.jpg", pixels, replace(TAGS, width_px=8))
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "result.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError), replacing(path) as partial:  # noqa: PT012
        partial.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_same_photograph_gives_the_same_bytes(photograph: Path) -> None:
    pixels = read_photograph(photograph)
    first, second = photograph.with_name("a.jpg"), photograph.with_name("b.jpg")
    write_photograph(first, pixels, TAGS)
    write_photograph(second, pixels, TAGS)
    assert first.read_bytes() == second.read_bytes()


EAST, NORTH, UP = np.eye(3)


@pytest.mark.parametrize(
    ("angles", "right", "down", "forward"),
    [
        ((0.0, -90.0, 0.0), EAST, -NORTH, -UP),
        ((90.0, -90.0, 0.0), -NORTH, -EAST, -UP),
        ((0.0, 0.0, 0.0), EAST, -UP, NORTH),
        ((90.0, 0.0, 0.0), -NORTH, -UP, EAST),
        ((0.0, 0.0, 90.0), -UP, -EAST, NORTH),
        ((180.0, -90.0, 180.0), EAST, -NORTH, -UP),
    ],
)
def test_obvious_attitudes(
    angles: tuple[float, float, float], right: np.ndarray, down: np.ndarray, forward: np.ndarray
) -> None:
    expected = np.column_stack([right, down, forward])
    np.testing.assert_allclose(rotation_from_gimbal(*angles), expected, atol=1e-15)


@given(st.floats(-360, 360), st.floats(-90, 90), st.floats(-180, 180))
def test_attitude_is_a_rotation_that_looks_where_the_angles_say(yaw: float, pitch: float, roll: float) -> None:
    R = rotation_from_gimbal(yaw, pitch, roll)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1.0)
    forward = R[:, 2]
    assert forward[2] == pytest.approx(np.sin(np.radians(pitch)), abs=1e-12)
    level = np.cos(np.radians(pitch))
    assert forward[:2] == pytest.approx([level * np.sin(np.radians(yaw)), level * np.cos(np.radians(yaw))], abs=1e-12)


def test_survey_photographs_look_where_the_truth_says(shared_data: SharedData) -> None:
    folder = shared_data("dtu_phantom4")
    truth = json.loads((folder / "truth.json").read_text())["cameras"]
    convergence_deg = 2.9
    for name, camera in truth.items():
        tags = read_tags(folder / "images" / name)
        assert tags.gimbal_yaw_deg is not None
        assert tags.gimbal_pitch_deg is not None
        assert tags.gimbal_roll_deg is not None
        R = rotation_from_gimbal(tags.gimbal_yaw_deg - convergence_deg, tags.gimbal_pitch_deg, tags.gimbal_roll_deg)
        difference = R @ np.array(camera["rotation_camera_from_world"])
        angle_deg = np.degrees(np.arccos(min(1.0, (np.trace(difference) - 1.0) / 2.0)))
        assert angle_deg < 6.0


def test_rtk_tags_of_a_real_drone(shared_data: SharedData) -> None:
    folder = shared_data("p4m_rtk_xmp")
    tags = {path.name: read_tags(path) for path in sorted(folder.glob("*.JPG"))}
    fixed = tags["DJI_0010.JPG"]
    assert fixed == PhotographTags(
        make="DJI",
        model="FC6360",
        serial="ce3ccab369970d2995b38aac35c75ff8",
        width_px=1600,
        height_px=1300,
        focal_mm=5.74,
        focal_35mm_mm=40.0,
        time=datetime(2023, 6, 1, 9, 48, 4),
        longitude_deg=-74.18558409,
        latitude_deg=11.2246986,
        height_m=40.52,
        height_is_ellipsoidal=True,
        height_above_take_off_m=25.05,
        capture="2910a6ec59f311eda10ace3ccab36997",
        gnss_sigma_m=(0.01568, 0.01101, 0.03329),
        rtk_flag=50,
        gimbal_yaw_deg=17.1,
        gimbal_pitch_deg=-89.9,
        gimbal_roll_deg=0.0,
        flight_yaw_deg=17.0,
        flight_pitch_deg=4.6,
        flight_roll_deg=-1.1,
        velocity_m_s=(0.0, 0.0, 0.0),
        dewarp=Dewarp(
            "2019-02-04",
            (1943.4300537, 1934.9899902),
            (8.1140137, 2.197998),
            (-0.408528, 0.360104, -0.414649),
            (0.0013461, 0.0013461),
            (1600.0, 1300.0),
        ),
    )
    floats = [t for t in tags.values() if t.rtk_flag == 34]
    assert len(floats) == 1
    assert floats[0].gnss_sigma_m is not None
    assert 0.15 < min(floats[0].gnss_sigma_m) < max(floats[0].gnss_sigma_m) < 0.5
    assert all(check_photograph(path, (1600, 1300)) for path in folder.glob("*.JPG"))


def test_tags_of_a_drone_without_rtk(shared_data: SharedData) -> None:
    tags = read_tags(shared_data("brighton_beach") / "images" / "DJI_0018.JPG")
    assert tags.model == "FC300S"
    assert tags.rtk_flag is None
    assert tags.gnss_sigma_m is None
    assert tags.longitude_deg == pytest.approx(-91.9945599, abs=1e-7)
    assert tags.latitude_deg == pytest.approx(46.8426071, abs=1e-7)
    assert (tags.gimbal_yaw_deg, tags.height_m) == (45.0, 198.31)


def test_tags_of_an_ordinary_camera(shared_data: SharedData) -> None:
    tags = read_tags(shared_data("exif") / "gps_exif.jpg")
    assert tags.make == "Canon"
    assert tags.longitude_deg == pytest.approx(-(116 + 18 / 60 + 5.83056640625 / 3600))
    assert tags.latitude_deg == pytest.approx(33 + 52 / 60 + 31.658935546875 / 3600)
    assert tags.height_m == 304.0
    assert tags.gimbal_pitch_deg is None


def test_height_below_sea_level_is_negative(shared_data: SharedData) -> None:
    tags = read_tags(shared_data("sheffield_cross") / "images" / "DJI_0054.JPG")
    assert tags.height_m == -5.677


# ---- the conventions of other makers ---------------------------------------------------------------------------------

PIX4D, SENSEFLY = "http://pix4d.com/camera/1.0/", "http://ns.sensefly.com/Camera/1.0/"
AUTEL, PARROT = "http://www.autelrobotics.com/drone/1.0/", "http://www.parrot.com/drone-parrot/1.0/"
MICASENSE = "http://micasense.com/DLS/1.0/"


def with_xmp(path: Path, namespaces: dict[str, str], attributes: str, elements: str = "", before: str = "") -> Path:
    declared = " ".join(f'xmlns:{prefix}="{uri}"' for prefix, uri in namespaces.items())
    packet = (
        f'{before}<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" {declared} {attributes}>{elements}</rdf:Description>'
        '</rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
    )
    Image.new("RGB", (16, 12)).save(path, xmp=packet.encode())
    return path


def camera_angles(tags: PhotographTags) -> tuple[float | None, float | None, float | None]:
    return tags.gimbal_yaw_deg, tags.gimbal_pitch_deg, tags.gimbal_roll_deg


def rotation_of(tags: PhotographTags) -> np.ndarray:
    assert tags.gimbal_yaw_deg is not None
    assert tags.gimbal_pitch_deg is not None
    assert tags.gimbal_roll_deg is not None
    return rotation_from_gimbal(tags.gimbal_yaw_deg, tags.gimbal_pitch_deg, tags.gimbal_roll_deg)


@given(st.floats(-180, 180), st.floats(-85, 85), st.floats(-80, 80))
def test_camera_angles_turn_a_camera_that_looks_down(yaw: float, pitch: float, roll: float) -> None:
    body = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix()  # north, east, down from the body
    nose, right, down = body[[1, 0, 2]].T * np.array([1.0, 1.0, -1.0])  # east, north, up
    expected = np.column_stack([right, -nose, down])
    R = rotation_from_gimbal(*gimbal_from_camera_angles(yaw, pitch, roll))
    is_vertical = np.hypot(*expected[:2, 2]) < VERTICAL  # taken for straight down
    np.testing.assert_allclose(R, expected, atol=2 * VERTICAL if is_vertical else 1e-9)


@pytest.mark.parametrize("yaw", [0.0, 90.0, -135.0])
def test_camera_that_looks_straight_down_has_its_yaw(yaw: float) -> None:
    assert gimbal_from_camera_angles(yaw, 0.0, 0.0) == pytest.approx((yaw, -90.0, 0.0), abs=1e-9)
    assert gimbal_from_camera_angles(yaw, 90.0, 0.0) == pytest.approx((yaw, 0.0, 0.0), abs=1e-9)
    straight_up = rotation_from_gimbal(*gimbal_from_camera_angles(yaw, 180.0, 0.0))
    np.testing.assert_allclose(straight_up, rotation_from_gimbal(yaw, 90.0, 0.0), atol=1e-9)


def test_sensefly_tags(tmp_path: Path) -> None:
    attributes = 'Camera:Yaw="31.5" Camera:Pitch="4" Camera:Roll="0" Camera:GPSXYAccuracy="0.021"'
    attributes += ' Camera:GPSZAccuracy="0.035" Camera:PerspectiveFocalLength="10.6"'
    attributes += ' Camera:PerspectiveDistortion="0.01,-0.08,0.07,0.0004,-0.0002" Camera:ModelType="perspective"'
    attributes += ' Camera:VerticCS="ellipsoidal" crs:Version="7.0"'
    spaces = {"Camera": SENSEFLY, "crs": "http://ns.adobe.com/camera-raw-settings/1.0/"}
    tags = read_tags(with_xmp(tmp_path / "a.jpg", spaces, attributes))
    assert camera_angles(tags) == pytest.approx((31.5, -86.0, 0.0), abs=1e-9)
    assert tags.gnss_sigma_m == (0.021, 0.021, 0.035)
    assert tags.calibrated_focal_mm == 10.6
    assert tags.calibrated_radial == (0.01, -0.08, 0.07)
    assert tags.kind == "frame"
    assert tags.height_is_ellipsoidal is None  # of no position


def test_parrot_sequoia_tags_as_elements_with_fractions(tmp_path: Path) -> None:
    elements = (
        "<Camera:Yaw>1250/100</Camera:Yaw><Camera:Pitch>-300/100</Camera:Pitch><Camera:Roll>0/1</Camera:Roll>"
        "<Camera:AboveGroundAltitude>8025/100</Camera:AboveGroundAltitude>"
        "<Camera:GPSXYAccuracy>0</Camera:GPSXYAccuracy><Camera:GPSZAccuracy>1/0</Camera:GPSZAccuracy>"
        "<Camera:BandName><rdf:Seq><rdf:li>Green</rdf:li></rdf:Seq></Camera:BandName>"
        "<Camera:ModelType>fisheye</Camera:ModelType>"
    )
    tags = read_tags(with_xmp(tmp_path / "a.jpg", {"Camera": PIX4D}, "", elements))
    assert rotation_of(tags) == pytest.approx(rotation_from_gimbal(12.5, -93.0, 0.0), abs=1e-9)
    assert tags.height_above_take_off_m == 80.25
    assert tags.gnss_sigma_m is None
    assert tags.band == "Green"
    assert tags.kind == "fisheye"


def test_autel_tags_old_and_new(tmp_path: Path) -> None:
    old = read_tags(
        with_xmp(
            tmp_path / "old.jpg",
            {"Camera": PIX4D},
            'Camera:Pitch="66.04" Camera:Yaw="2.42" Camera:Roll="0.000000" Camera:ModelType="perspective"',
        )
    )
    assert camera_angles(old) == pytest.approx((2.42, -23.96, 0.0), abs=1e-9)
    attributes = 'drone:GimbalPitchDegree="-89.5" drone:GimbalYawDegree="12.0" drone:GimbalRollDegree="0.0"'
    attributes += ' drone:RtkFlag="50" drone:GpsLatitude="47.5" drone:GpsLongtitude="8.25"'
    attributes += ' drone:AbsoluteAltitude="+502.1" drone:RelativeAltitude="+60.0"'
    new = read_tags(with_xmp(tmp_path / "new.jpg", {"drone": AUTEL}, attributes))
    assert camera_angles(new) == (12.0, -89.5, 0.0)
    assert (new.longitude_deg, new.latitude_deg, new.height_m) == (8.25, 47.5, 502.1)
    assert (new.rtk_flag, new.height_is_ellipsoidal, new.height_above_take_off_m) == (50, True, 60.0)


def test_parrot_anafi_tags_come_before_its_camera_tags(tmp_path: Path) -> None:
    attributes = 'p:CameraPitchDegree="-78.36" p:CameraRollDegree="-0.32" p:CameraYawDegree="176.31"'
    attributes += ' Camera:Pitch="1" Camera:Yaw="2" Camera:Roll="3"'
    tags = read_tags(with_xmp(tmp_path / "a.jpg", {"p": PARROT, "Camera": PIX4D}, attributes))
    assert camera_angles(tags) == (176.31, -78.36, -0.32)


def test_light_sensor_and_missing_sensor_are_no_attitude(tmp_path: Path) -> None:
    light = with_xmp(tmp_path / "a.jpg", {"DLS": MICASENSE}, 'DLS:Yaw="1" DLS:Pitch="2" DLS:Roll="3"')
    zeros = with_xmp(
        tmp_path / "b.jpg", {"Camera": PIX4D}, 'Camera:Yaw="0/100" Camera:Pitch="0/100" Camera:Roll="0/100"'
    )
    assert camera_angles(read_tags(light)) == camera_angles(read_tags(zeros)) == (None, None, None)


@pytest.mark.parametrize("written", [str.lower, str.upper, str.title])
def test_the_case_of_xmp_names_and_name_spaces_does_not_count(tmp_path: Path, written: Callable[[str], str]) -> None:
    def named(values: dict[str, str]) -> str:
        return " ".join(f'{space}:{written(name)}="{value}"' for (space, _, name), value in pairs(values))

    def pairs(values: dict[str, str]) -> Iterator[tuple[tuple[str, str, str], str]]:
        return ((name.partition(":"), value) for name, value in values.items())

    attributes = named({
        "d:GimbalYawDegree": "+12.5", "d:GimbalPitchDegree": "-90.0", "d:GimbalRollDegree": "0.0", "d:RtkFlag": "50",
        "d:RelativeAltitude": "+61.25", "d:ImageSource": "InfraredCamera", "c:BandName": "LWIR", "c:CaptureUUID": "x7",
    })  # fmt: skip
    tags = read_tags(with_xmp(tmp_path / "a.jpg", {"d": written(AUTEL), "c": written(PIX4D)}, attributes))
    assert (tags.gimbal_yaw_deg, tags.gimbal_pitch_deg, tags.height_above_take_off_m) == (12.5, -90.0, 61.25)
    assert (tags.rtk_flag, tags.kind, tags.band, tags.capture) == (50, "thermal", "LWIR", "x7")


def test_names_in_structures_are_not_those_beside_them(tmp_path: Path) -> None:
    """Whatever stands around the packet; one written as elements, one as attributes."""
    elements = (
        '<s:CameraOrientationFLU s:Yaw="1" s:Pitch="2" s:Roll="3"/><s:CameraOrientationNED rdf:parseType="Resource">'
        "<s:Yaw>146.5</s:Yaw><s:Pitch>-84</s:Pitch><s:Roll>0.2</s:Roll></s:CameraOrientationNED>"
        "<s:Other><rdf:Description><drone:RtkFlag>0</drone:RtkFlag></rdf:Description></s:Other>"
    )
    spaces = {"s": "https://www.skydio.com/drone-skydio/1.0/", "drone": AUTEL}
    path = with_xmp(tmp_path / "a.jpg", spaces, 'drone:RtkFlag="50"', elements)
    assert (camera_angles(read_tags(path)), read_tags(path).rtk_flag) == ((146.5, -84.0, 0.2), 50)
    path.write_bytes(path.read_bytes().replace(b"adobe:ns:meta/", b"other:ns:meta/"))
    assert camera_angles(read_tags(path)) == (146.5, -84.0, 0.2)


def test_xmp_that_gdal_has_copied_is_read(tmp_path: Path) -> None:
    path = with_xmp(tmp_path / "a.jpg", {"drone": AUTEL}, 'drone:RtkFlag="16"', before="xml:XMP=")
    assert read_tags(path).rtk_flag == 16


def test_wrong_camera_calibration_is_named(tmp_path: Path) -> None:
    attributes = 'Camera:PerspectiveFocalLength="10" Camera:PerspectiveDistortion="0.1,0.2"'
    path = with_xmp(tmp_path / "a.jpg", {"Camera": PIX4D}, attributes)
    tags = read_tags(path)
    (said,) = tags.damage
    assert said.startswith("the XMP tag Camera:PerspectiveDistortion is '0.1,0.2', expected")
    assert (tags.calibrated_focal_mm, tags.calibrated_radial) == (10.0, None)


@pytest.mark.parametrize(
    ("unit", "resolution"), [(2, 25.4 * 166.0), (3, 1660.0), (4, 166.0), (5, 0.166), (None, 4216.4)]
)
def test_camera_with_geotags_and_exif_alone(tmp_path: Path, unit: int | None, resolution: float) -> None:
    exif = Image.Exif()
    exif[ExifTags.Base.Make], exif[ExifTags.Base.Model] = "SONY", "ILCE-7RM4"
    inner, gps = exif.get_ifd(ExifTags.IFD.Exif), exif.get_ifd(ExifTags.IFD.GPSInfo)
    inner[ExifTags.Base.FocalLength], inner[ExifTags.Base.FocalLengthIn35mmFilm] = 35.0, 35
    inner[ExifTags.Base.LensModel], inner[ExifTags.Base.BodySerialNumber] = "FE 35mm F1.8", "S01"
    inner[ExifTags.Base.FocalPlaneXResolution] = resolution
    if unit is not None:
        inner[ExifTags.Base.FocalPlaneResolutionUnit] = unit
    gps[ExifTags.GPS.GPSLatitudeRef], gps[ExifTags.GPS.GPSLatitude] = "S", (33.0, 30.0, 0.0)
    gps[ExifTags.GPS.GPSLongitudeRef], gps[ExifTags.GPS.GPSLongitude] = "W", (70.0, 45.0, 0.0)
    gps[ExifTags.GPS.GPSAltitudeRef], gps[ExifTags.GPS.GPSAltitude] = b"\x02", 812.5
    gps[ExifTags.GPS.GPSHPositioningError] = 0.04
    path = tmp_path / "DSC00001.JPG"
    Image.new("RGB", (24, 16)).save(path, exif=exif)
    tags = inspect_photograph(path)
    assert tags.pixels_per_mm == pytest.approx(166.0, rel=1e-6)
    assert (tags.longitude_deg, tags.latitude_deg, tags.height_m) == (-70.75, -33.5, 812.5)
    assert tags.height_is_ellipsoidal
    assert tags.gnss_horizontal_error_m == pytest.approx(0.04)
    assert (tags.lens, tags.serial, tags.focal_35mm_mm) == ("FE 35mm F1.8", "S01", 35.0)
    assert camera_angles(tags) == (None, None, None)


@pytest.mark.parametrize("options", [*JPEG_OPTIONS, {"grey": True}])
@pytest.mark.parametrize("reduction", [1, 2, 4, 8])
def test_a_window_is_what_decoding_everything_gives(tmp_path: Path, options: dict[str, Any], reduction: int) -> None:
    path, rng = tmp_path / "a.jpg", np.random.default_rng(4)
    pixels = np.kron(rng.integers(0, 256, (130, 80, 3)), np.ones((5, 5, 1))).astype(np.uint8)[:643, :397]
    options = dict(options)
    picture = Image.fromarray(pixels).convert("L" if options.pop("grey", False) else "RGB")
    picture.save(path, "JPEG", quality=95, **options)
    columns, rows = -(-397 // reduction), -(-643 // reduction)
    whole = read_window(path, (0, 0, columns, rows), reduction)
    assert whole.shape == (rows, columns, 3)
    for lower in {1, rows // 9, rows // 3, rows // 3 + 1, rows - 1, rows}:
        part = read_window(path, (1, lower // 2, columns - 1, lower), reduction)
        np.testing.assert_array_equal(part, whole[lower // 2 : lower, 1:-1])


def test_a_window_is_decoded_no_farther_down_than_it_reaches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    decoded: list[tuple[int, int]] = []
    decode = images._decode

    def noted(path: Path, picture: Image.Image) -> None:
        decode(path, picture)
        decoded.append(picture.size)

    monkeypatch.setattr(images, "_decode", noted)
    for name, progressive in (("a.jpg", False), ("b.jpg", True)):
        Image.new("RGB", (400, 640)).save(tmp_path / name, progressive=progressive)
        read_window(tmp_path / name, (0, 0, 50, 100))
    assert decoded == [(400, 192), (400, 640)]


def test_only_rows_of_a_single_scan_are_cut() -> None:
    def frame(kind: int, rows: int, scanned: int) -> bytes:
        header = bytes([0xFF, kind, 0, 17, 8, *rows.to_bytes(2, "big"), 0, 9, 3, *bytes(9)])
        return b"\xff\xd8" + header + bytes([0xFF, 0xDA, 0, 12, scanned, *bytes(9)]) + b"\xff\xd9"

    assert images._cut_below(frame(0xC0, 640, 3), 192, 640) == frame(0xC0, 192, 3)
    assert images._cut_below(frame(0xC1, 640, 3), 192, 640) == frame(0xC1, 192, 3)
    assert images._cut_below(frame(0xC2, 640, 3), 192, 640) is None, "progressive"
    assert images._cut_below(frame(0xC0, 640, 1), 192, 640) is None, "a scan for each colour"
    assert images._cut_below(frame(0xC0, 0, 3), 192, 640) is None, "its rows are counted at the end"


def test_patches_are_parts_of_the_photograph_from_one_decoding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.jpg"
    write_photograph(path, np.random.default_rng(2).integers(0, 256, (60, 80, 3)).astype(np.uint8), PhotographTags())
    whole = read_photograph(path)
    decoded: list[Path] = []
    decode = images._decode

    def noted(path: Path, picture: Image.Image) -> None:
        decoded.append(path)
        decode(path, picture)

    monkeypatch.setattr(images, "_decode", noted)
    boxes = [(0, 0, 5, 7), (75, 50, 80, 60), (10, 20, 11, 21)]
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    found = read_patches(path, boxes, (80, 60), sha256)
    assert len(decoded) == 1
    for (left, upper, right, lower), patch in zip(boxes, found, strict=True):
        np.testing.assert_array_equal(patch, whole[upper:lower, left:right])
    with pytest.raises(ImageError, match="was modified since the run began"):
        read_patches(path, boxes, None, "0" * 64)
    with pytest.raises(ImageError, match="but its camera has 81 × 60 px"):
        read_patches(path, boxes, (81, 60))


def test_the_pixels_of_a_sound_jpeg_are_not_read(photograph: Path) -> None:
    ends = read_ends(photograph)
    assert len(ends) < 0.2 * photograph.stat().st_size
    assert ends.endswith(b"\xff\xd9")
    assert inspect_photograph(photograph) == read_tags(photograph)
    whole = photograph.read_bytes()
    for changed in (whole + bytes(1000), whole[:-2] + bytes(2), whole[:-2]):
        assert read_ends(damaged(photograph, changed)) == changed


def test_of_several_pictures_all_is_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    first, second = (Image.fromarray(rng.integers(0, 256, (64, 80, 3), dtype=np.uint8)) for _ in range(2))
    path = tmp_path / "pair.jpg"
    first.save(path, format="MPO", save_all=True, append_images=[second])
    whole = path.read_bytes()
    assert read_ends(path) == whole
    assert inspect_photograph(path) == read_tags(path)
