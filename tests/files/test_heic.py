"""HEIF files: the photograph as the sensor delivered it, with its tags, as it is in a JPEG or PNG."""

import hashlib
import sys
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from deep_files import write_heic
from makers import textured
from PIL import Image

from photogram.errors import ImageError
from photogram.files.photographs.depth import Stretch
from photogram.files.photographs.heic import is_heic, unturned
from photogram.files.photographs.images import (
    check_photograph,
    inspect_photograph,
    read_grey,
    read_leading_tags,
    read_patches,
    read_photograph,
    read_small,
    read_tags,
    read_window,
    sample_values,
    thumbnail,
    write_photograph,
)
from photogram.files.photographs.tags import PhotographTags

WIDTH, HEIGHT = 256, 192
PIXELS = textured(WIDTH, HEIGHT, 3)
TAGS = PhotographTags(
    make="Apple",
    model="iPhone 15 Pro",
    lens="iPhone 15 Pro back triple camera 6.765mm f/1.78",
    width_px=WIDTH,
    height_px=HEIGHT,
    focal_mm=6.765,
    focal_35mm_mm=24.0,
    time=datetime(2025, 5, 4, 10, 11, 12),
    longitude_deg=-70.75,
    latitude_deg=-33.5,
    height_m=512.25,
    gnss_horizontal_error_m=4.5,
    gimbal_yaw_deg=12.5,
    gimbal_pitch_deg=-90.0,
    gimbal_roll_deg=0.0,
)


@pytest.fixture
def jpeg(tmp_path: Path) -> Path:
    path = tmp_path / "picture.jpg"
    write_photograph(path, PIXELS, TAGS)
    return path


@pytest.fixture
def lossless(tmp_path: Path) -> Path:
    path = tmp_path / "lossless.png"
    Image.fromarray(PIXELS).save(path)
    return path


@pytest.fixture
def heic(tmp_path: Path, jpeg: Path) -> Path:
    return write_heic(tmp_path / "IMG_0001.HEIC", PIXELS, jpeg)


def test_tags_are_those_of_the_jpeg(heic: Path, jpeg: Path) -> None:
    expected = read_tags(jpeg)
    assert expected == replace(TAGS, height_is_ellipsoidal=expected.height_is_ellipsoidal)
    assert read_tags(heic) == inspect_photograph(heic) == read_leading_tags(heic, (WIDTH, HEIGHT)) == expected


def test_pixels_are_those_that_were_encoded(heic: Path, lossless: Path) -> None:
    np.testing.assert_array_equal(read_photograph(heic, (WIDTH, HEIGHT)), PIXELS)
    np.testing.assert_array_equal(read_grey(heic), read_grey(lossless))
    np.testing.assert_array_equal(thumbnail(heic), thumbnail(lossless))
    np.testing.assert_array_equal(read_small(heic, 100), read_small(lossless, 100))
    np.testing.assert_array_equal(read_patches(heic, [(3, 4, 20, 30)])[0], PIXELS[4:30, 3:20])
    assert check_photograph(heic) == (WIDTH, HEIGHT)
    read_photograph(heic, sha256=hashlib.sha256(heic.read_bytes()).hexdigest())


def test_pixels_at_high_quality_are_within_the_noise_of_a_camera(tmp_path: Path) -> None:
    path = write_heic(tmp_path / "a.heic", PIXELS, quality=95)
    assert np.sqrt(np.mean((read_photograph(path) - PIXELS.astype(float)) ** 2)) < 2.0


@pytest.mark.parametrize("orientation", range(1, 9))
def test_what_turns_the_picture_for_looking_at_turns_no_pixel(tmp_path: Path, jpeg: Path, orientation: int) -> None:
    """A phone held upright writes the same sensor; what the file says of it is not applied, neither once nor twice."""
    path = write_heic(tmp_path / "turned.heic", PIXELS, jpeg, orientation)
    assert is_heic(path.read_bytes())
    assert (unturned(path.read_bytes()) == path.read_bytes()) == (orientation == 1)
    np.testing.assert_array_equal(read_photograph(path, (WIDTH, HEIGHT)), PIXELS)
    tags = read_tags(path)
    assert (tags.width_px, tags.height_px, tags.focal_mm) == (WIDTH, HEIGHT, 6.765)


@pytest.mark.parametrize("reduction", [1, 2, 4])
def test_an_embedded_thumbnail_stands_for_no_pixel(tmp_path: Path, lossless: Path, reduction: int) -> None:
    path = write_heic(tmp_path / "a.heic", PIXELS, thumbnails=[160, 96])
    box = (3, 5, 40, 30)
    np.testing.assert_array_equal(read_window(path, box, reduction), read_window(lossless, box, reduction))


def test_ten_bits_are_stretched(tmp_path: Path) -> None:
    values = np.random.default_rng(1).integers(0, 1024, (HEIGHT, WIDTH, 3)).astype(np.uint16)
    path = write_heic(tmp_path / "DSC00001.HIF", values)
    assert inspect_photograph(path).bits == 10
    stretch = Stretch(0, 1023)
    np.testing.assert_array_equal(read_photograph(path, stretch=stretch), stretch.applied(values))
    assert check_photograph(path) == (WIDTH, HEIGHT)
    np.testing.assert_array_equal(np.sort(sample_values(path)), np.sort(values.ravel()))
    with pytest.raises(ImageError, match="10 bits a channel, and nothing says how they are stretched"):
        read_photograph(path)


@pytest.mark.parametrize("read", [read_photograph, read_tags, inspect_photograph, check_photograph])
def test_without_the_extra_the_remedy_is_named(heic: Path, monkeypatch: pytest.MonkeyPatch, read: object) -> None:
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    said = r'IMG_0001\.HEIC: HEIC, which this installation does not decode: pip install "photogram\[heic\]", or convert'
    with pytest.raises(ImageError, match=said):
        read(heic)  # type: ignore[operator]


def test_damage_is_refused_or_harmless(heic: Path) -> None:
    whole, rng = heic.read_bytes(), np.random.default_rng(4)
    refused = 0
    for place in [*rng.integers(0, 600, 80).tolist(), *rng.integers(600, len(whole), 40).tolist()]:
        content = bytearray(whole)
        content[place] ^= int(rng.integers(1, 256))
        heic.write_bytes(bytes(content))
        try:
            assert read_photograph(heic, (WIDTH, HEIGHT)).shape == (HEIGHT, WIDTH, 3)
            inspect_photograph(heic)
        except ImageError:
            refused += 1
    assert refused > 10
    for length in range(16, len(whole) - 1, len(whole) // 20):
        heic.write_bytes(whole[:length])
        with pytest.raises(ImageError, match=r"IMG_0001\.HEIC: cannot be decoded .* truncated or damaged"):
            check_photograph(heic)
