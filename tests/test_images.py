from __future__ import annotations

import json
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from photogram.camera import rotation_from_gimbal
from photogram.errors import ImageError, WorkspaceError
from photogram.files.atomic import replacing
from photogram.files.images import (
    Dewarp,
    PhotographTags,
    check_photograph,
    read_grey,
    read_pixels,
    read_tags,
    write_photograph,
)

DATA = Path(__file__).parents[1] / ".." / "shared" / "data"
READERS = (read_pixels, read_grey, check_photograph)

TAGS = PhotographTags(
    make="DJI",
    model="FC6310R",
    width_px=160,
    height_px=96,
    focal_mm=8.8,
    focal_35mm_mm=24.0,
    time=datetime(2019, 5, 9, 10, 0, 7, 250000, timezone(timedelta(hours=-3, minutes=-30))),
    longitude_deg=-74.1855840912,
    latitude_deg=-11.2246986034,
    height_m=-40.524,
    height_above_take_off_m=25.05,
    gnss_sigma_m=(0.01568, 0.01101, 0.03329),
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
    ),
)


def data_file(name: str) -> Path:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"shared data {name} is not here")
    return path


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
    assert np.array_equal(read_pixels(path, (17, 11)), pixels)
    luminance = pixels @ np.array([0.299, 0.587, 0.114])
    assert np.abs(read_grey(path).astype(float) - luminance).max() <= 1.0


def test_jpeg_keeps_its_pixels_and_its_luminance(photograph: Path) -> None:
    pixels, grey = read_pixels(photograph, (160, 96)), read_grey(photograph, (160, 96))
    assert pixels.shape == (96, 160, 3)
    assert grey.shape == (96, 160)
    assert pixels.dtype == grey.dtype == np.uint8
    assert pixels.flags.writeable
    assert grey.flags.c_contiguous
    inside = ((pixels > 0) & (pixels < 255)).all(axis=2)
    luminance = pixels @ np.array([0.299, 0.587, 0.114])
    assert np.abs(grey - luminance)[inside].max() <= 2.0
    assert check_photograph(photograph, (160, 96)) == (160, 96)


def test_orientation_tag_does_not_turn_the_pixels(tmp_path: Path) -> None:
    path = tmp_path / "turned.jpg"
    exif = Image.Exif()
    exif[274] = 6
    Image.new("RGB", (40, 24)).save(path, exif=exif)
    assert read_pixels(path).shape == (24, 40, 3)
    assert check_photograph(path) == (40, 24)


@pytest.mark.parametrize("read", READERS)
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
def test_sound_jpeg_of_every_kind_is_accepted(tmp_path: Path, options: dict[str, object]) -> None:
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
    with pytest.raises(ImageError, match=r"gone\.jpg: there is no such file"):
        read(tmp_path / "gone.jpg")  # type: ignore[operator]


def test_deep_pixels_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "deep.tif"
    Image.fromarray(np.zeros((4, 4), np.uint16)).save(path)
    with pytest.raises(ImageError, match="8-bit"):
        read_pixels(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"-162.900", b"somewhat", "GimbalYawDegree is 'somewhat'"),
        (b"</rdf:RDF>", b"</rdf:RDX>", "no valid XML"),
        (b"-11.2246986034", b"-91.2246986034", "no globe"),
        (b"2019-02-04;1943", b"2019-02-04,1943", "DewarpData"),
    ],
)
def test_nonsense_in_tags_is_named(photograph: Path, old: bytes, new: bytes, message: str) -> None:
    content = photograph.read_bytes()
    assert content.count(old) == 1
    with pytest.raises(ImageError, match=message):
        read_tags(damaged(photograph, content.replace(old, new)))


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
    pixels = read_pixels(photograph)
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


def test_survey_photographs_look_where_the_truth_says() -> None:
    folder = data_file("dtu_phantom4")
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


def test_rtk_tags_of_a_real_drone() -> None:
    folder = data_file("p4m_rtk_xmp")
    tags = {path.name: read_tags(path) for path in sorted(folder.glob("*.JPG"))}
    fixed = tags["DJI_0010.JPG"]
    assert fixed == PhotographTags(
        make="DJI",
        model="FC6360",
        width_px=1600,
        height_px=1300,
        focal_mm=5.74,
        focal_35mm_mm=40.0,
        time=datetime(2023, 6, 1, 9, 48, 4),
        longitude_deg=-74.18558409,
        latitude_deg=11.2246986,
        height_m=40.52,
        height_above_take_off_m=25.05,
        gnss_sigma_m=(0.01568, 0.01101, 0.03329),
        rtk_flag=50,
        gimbal_yaw_deg=17.1,
        gimbal_pitch_deg=-89.9,
        gimbal_roll_deg=0.0,
        flight_yaw_deg=17.0,
        flight_pitch_deg=4.6,
        flight_roll_deg=-1.1,
        dewarp=Dewarp(
            "2019-02-04",
            (1943.4300537, 1934.9899902),
            (8.1140137, 2.197998),
            (-0.408528, 0.360104, -0.414649),
            (0.0013461, 0.0013461),
        ),
    )
    floats = [t for t in tags.values() if t.rtk_flag == 34]
    assert len(floats) == 1
    assert floats[0].gnss_sigma_m is not None
    assert 0.15 < min(floats[0].gnss_sigma_m) < max(floats[0].gnss_sigma_m) < 0.5
    assert all(check_photograph(path, (1600, 1300)) for path in folder.glob("*.JPG"))


def test_tags_of_a_drone_without_rtk() -> None:
    tags = read_tags(data_file("brighton_beach") / "images" / "DJI_0018.JPG")
    assert tags.model == "FC300S"
    assert tags.rtk_flag is None
    assert tags.gnss_sigma_m is None
    assert tags.longitude_deg == pytest.approx(-91.9945599, abs=1e-7)
    assert tags.latitude_deg == pytest.approx(46.8426071, abs=1e-7)
    assert (tags.gimbal_yaw_deg, tags.height_m) == (45.0, 198.31)


def test_tags_of_an_ordinary_camera() -> None:
    tags = read_tags(data_file("exif") / "gps_exif.jpg")
    assert tags.make == "Canon"
    assert tags.longitude_deg == pytest.approx(-(116 + 18 / 60 + 5.83056640625 / 3600))
    assert tags.latitude_deg == pytest.approx(33 + 52 / 60 + 31.658935546875 / 3600)
    assert tags.height_m == 304.0
    assert tags.gimbal_pitch_deg is None


def test_height_below_sea_level_is_negative() -> None:
    tags = read_tags(data_file("sheffield_cross") / "images" / "DJI_0054.JPG")
    assert tags.height_m == -5.677
