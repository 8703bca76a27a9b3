"""DNG files: the JPEG of full size in them is the photograph, with the tags of the file."""

import hashlib
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from deep_files import tags_of_jpeg, write_dng

from photogram.arrays import ByteArray
from photogram.errors import ImageError
from photogram.files.photographs.images import (
    check_photograph,
    inspect_photograph,
    read_leading_tags,
    read_photograph,
    read_tags,
    read_window,
    write_photograph,
)
from photogram.files.photographs.tags import PhotographTags

WIDTH, HEIGHT = 160, 96
RAW = np.random.default_rng(2).integers(0, 4096, (HEIGHT + 4, WIDTH + 8)).astype(np.uint16)
TAGS = PhotographTags(
    make="DJI",
    model="FC3411",
    focal_mm=8.38,
    focal_35mm_mm=22.0,
    time=datetime(2025, 5, 4, 10, 11, 12),
    longitude_deg=9.0,
    latitude_deg=48.0,
    height_m=512.25,
    gimbal_yaw_deg=12.5,
    gimbal_pitch_deg=-90.0,
    gimbal_roll_deg=0.0,
)


def pixels(width: int, height: int, seed: int = 1) -> ByteArray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3)).astype(np.uint8)


def jpeg(folder: Path, name: str, width: int, height: int, tags: PhotographTags = TAGS) -> Path:
    path = folder / name
    write_photograph(path, pixels(width, height), tags)
    return path


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """What the camera has written beside its raw file."""
    return jpeg(tmp_path, "full.jpg", WIDTH, HEIGHT)


@pytest.fixture
def raw(tmp_path: Path, picture: Path) -> Path:
    """A raw file with a small and a full preview; the raw pixels have a margin, as those of cameras have."""
    bare = jpeg(tmp_path, "bare.jpg", WIDTH, HEIGHT, PhotographTags())
    small = jpeg(tmp_path, "small.jpg", WIDTH // 2, HEIGHT // 2, PhotographTags())
    return write_dng(tmp_path / "DJI_0001.DNG", RAW, [small, bare], tags_of_jpeg(picture), (WIDTH, HEIGHT))


def test_the_preview_of_full_size_is_the_photograph(raw: Path, picture: Path) -> None:
    size = WIDTH, HEIGHT
    np.testing.assert_array_equal(read_photograph(raw, size), read_photograph(picture))
    np.testing.assert_array_equal(read_window(raw, (8, 3, 60, 40), 2), read_window(picture, (8, 3, 60, 40), 2))
    assert check_photograph(raw, size) == size
    read_photograph(raw, size, hashlib.sha256(raw.read_bytes()).hexdigest())
    with pytest.raises(ImageError, match="was modified since the run began"):
        read_photograph(raw, size, hashlib.sha256(picture.read_bytes()).hexdigest())
    with pytest.raises(ImageError, match=f"{WIDTH} × {HEIGHT} px, but its camera has 168 × 100 px"):
        read_photograph(raw, (168, 100))


def test_tags_are_those_of_the_file(raw: Path, picture: Path) -> None:
    expected = read_tags(picture)
    assert expected == replace(
        TAGS, width_px=WIDTH, height_px=HEIGHT, height_is_ellipsoidal=expected.height_is_ellipsoidal
    )
    assert read_tags(raw) == inspect_photograph(raw) == read_leading_tags(raw, (WIDTH, HEIGHT)) == expected


def test_a_preview_of_all_raw_pixels_is_one_too(tmp_path: Path) -> None:
    height, width = RAW.shape
    whole = jpeg(tmp_path, "whole.jpg", width, height)
    path = write_dng(tmp_path / "a.dng", RAW, [whole], crop=(WIDTH, HEIGHT))
    assert read_photograph(path).shape == (height, width, 3)


def test_a_small_preview_is_an_error_that_says_what_to_do(tmp_path: Path) -> None:
    small = jpeg(tmp_path, "small.jpg", WIDTH // 2, HEIGHT // 2)
    one = write_dng(tmp_path / "one.dng", RAW, [small], crop=(WIDTH, HEIGHT))
    none = write_dng(tmp_path / "none.dng", RAW, [])
    for path, said in (
        (one, r"one\.dng: DNG of 160 × 96 px, its largest preview has 80 × 48 px, and photogram develops no raw"),
        (none, r"none\.dng: DNG of 168 × 100 px, no preview in it"),
    ):
        for read in (inspect_photograph, read_photograph, read_tags, check_photograph):
            with pytest.raises(ImageError, match=said + ".*convert all photographs alike .* to 16-bit TIFF or JPEG"):
                read(path)


def test_damage_is_refused_or_harmless(raw: Path) -> None:
    """Any byte of the directories may be wrong, and the file may end in any of its parts: photograph or error."""
    whole, rng = raw.read_bytes(), np.random.default_rng(4)
    last = len(whole) - 1200
    refused = 0
    for place in [*rng.integers(8, len(whole), 60).tolist(), *rng.integers(last, len(whole), 160).tolist()]:
        content = bytearray(whole)
        content[place] ^= int(rng.integers(1, 256))
        raw.write_bytes(bytes(content))
        try:
            assert read_photograph(raw, (WIDTH, HEIGHT)).shape == (HEIGHT, WIDTH, 3)
            refused += bool(inspect_photograph(raw).damage)
        except ImageError:
            refused += 1
    assert refused > 10
    for length in range(16, len(whole) - 100, len(whole) // 40):
        raw.write_bytes(whole[:length])
        with pytest.raises(ImageError, match=r"DJI_0001\.DNG"):
            check_photograph(raw, (WIDTH, HEIGHT))


def test_directories_that_lead_nowhere_or_in_circles(raw: Path) -> None:
    whole = raw.read_bytes()
    first = int.from_bytes(whole[4:8], "little")
    entries = int.from_bytes(whole[first : first + 2], "little")
    entry = next(
        first + 2 + 12 * i
        for i in range(entries)
        if int.from_bytes(whole[first + 2 + 12 * i : first + 4 + 12 * i], "little") == 330
    )
    at = int.from_bytes(whole[entry + 8 : entry + 12], "little")
    for offset in (0, first, len(whole) - 1, 2**32 - 1):
        content = bytearray(whole)
        content[at : at + 4] = offset.to_bytes(4, "little")
        raw.write_bytes(bytes(content))
        with pytest.raises(ImageError, match=r"DJI_0001\.DNG"):
            inspect_photograph(raw)
