"""Pixel values of more than 8 bits: decoded whole, whatever the file, and stretched linearly."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rasterio
from deep_files import write_tiff
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from photogram.arrays import ByteArray
from photogram.errors import ImageError
from photogram.files.photographs.depth import LARGEST_VALUE, Stretch
from photogram.files.photographs.images import (
    check_photograph,
    inspect_photograph,
    read_grey,
    read_patches,
    read_photograph,
    read_small,
    read_window,
    sample_values,
    thumbnail,
)

WIDTH, HEIGHT = 70, 600  # more rows than are decoded at a time, and no multiple of them
VALUES = np.random.default_rng(5).integers(4000, 9001, (HEIGHT, WIDTH, 3)).astype(np.uint16)
STRETCH = Stretch(4000, 9000)
TRANSPARENT = np.full((HEIGHT, WIDTH, 1), 65535, np.uint16)
FILES = ("plain.tif", "lzw.tif", "colour.png", "transparent.tif", "transparent.png", "grey.tif", "grey.png")


def by_opencv(path: Path, values: NDArray[Any]) -> None:
    """OpenCV, which has colours the other way round, writes LZW and PNG."""
    assert cv2.imwrite(str(path), values[..., ::-1] if values.shape[2:] == (3,) else values)


def written(folder: Path, name: str) -> Path:
    path = folder / name
    if name.startswith("grey"):
        write_tiff(path, VALUES[..., 0]) if name.endswith("tif") else by_opencv(path, VALUES[..., 0])
    elif name == "plain.tif":
        write_tiff(path, VALUES)
    elif name == "transparent.tif":
        write_tiff(path, np.dstack([VALUES, TRANSPARENT]))
    elif name == "transparent.png":
        by_opencv(path, np.dstack([VALUES[..., ::-1], TRANSPARENT]))
    else:
        by_opencv(path, VALUES)
    return path


def stretched(values: NDArray[np.uint16], stretch: Stretch = STRETCH) -> ByteArray:
    share = (values.astype(np.float64) - stretch.low) / (stretch.high - stretch.low)
    return np.rint(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)


@pytest.mark.parametrize("name", FILES)
def test_every_pixel_is_stretched_linearly(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, name)
    expected = stretched(VALUES if not name.startswith("grey") else np.repeat(VALUES[..., :1], 3, axis=2))
    assert inspect_photograph(path).bits == 16
    assert check_photograph(path, (WIDTH, HEIGHT)) == (WIDTH, HEIGHT)
    np.testing.assert_array_equal(read_photograph(path, (WIDTH, HEIGHT), stretch=STRETCH), expected)


@pytest.mark.parametrize("name", ["plain.tif", "grey.png"])
def test_all_readers_see_the_same_8_bits(tmp_path: Path, name: str) -> None:
    """As of an 8-bit picture of the same pixels: nothing else is done to them."""
    path, shallow = written(tmp_path, name), tmp_path / "shallow.png"
    pixels = read_photograph(path, stretch=STRETCH)
    Image.fromarray(pixels if name == "plain.tif" else pixels[..., 0]).save(shallow)
    readers: list[Callable[..., object]] = [
        read_photograph,
        read_grey,
        thumbnail,
        lambda path, stretch=None: read_small(path, 40, stretch),
        lambda path, stretch=None: read_window(path, (3, 5, 20, 90), 2, None, stretch),
        lambda path, stretch=None: read_patches(path, [(1, 2, 30, 40)], stretch=stretch)[0],
    ]
    for read in readers:
        np.testing.assert_array_equal(read(path, stretch=STRETCH), read(shallow))
        with pytest.raises(ImageError, match="16 bits a channel, and nothing says how they are stretched"):
            read(path)


@pytest.mark.parametrize("suffix", ["tif", "png"])
@pytest.mark.parametrize("channels", [1, 3])
def test_8_bits_are_left_as_they_are(tmp_path: Path, suffix: str, channels: int) -> None:
    path, pixels = tmp_path / f"a.{suffix}", stretched(VALUES)[..., :channels]
    by_opencv(path, pixels)
    assert inspect_photograph(path).bits == 8
    for stretch in (None, STRETCH):
        np.testing.assert_array_equal(read_photograph(path, stretch=stretch), np.broadcast_to(pixels, VALUES.shape))


def test_white_is_zero_and_12_bits(tmp_path: Path) -> None:
    grey = VALUES[..., 0]
    inverted = write_tiff(tmp_path / "inverted.tif", grey, t262=0)
    np.testing.assert_array_equal(read_grey(inverted, stretch=STRETCH), stretched(LARGEST_VALUE - grey))
    rows = np.arange(0, 4096, 16, dtype=np.uint16).reshape(2, 128)
    pairs = rows.reshape(-1, 2).astype(np.uint32)  # two values in three bytes
    packed = ((pairs[:, 0] << 12) | pairs[:, 1]).astype(">u4").view(np.uint8).reshape(-1, 4)[:, 1:]
    path = tmp_path / "packed.tif"
    lines = np.ascontiguousarray(packed).reshape(2, 192)
    write_tiff(path, lines, t256=128, t258=(12,), t279=(lines.nbytes,))
    assert inspect_photograph(path).bits == 12
    np.testing.assert_array_equal(read_grey(path, stretch=Stretch(0, 4095)), stretched(rows, Stretch(0, 4095)))


def test_samples_cover_the_whole_photograph(tmp_path: Path) -> None:
    path = tmp_path / "large.tif"
    values = np.random.default_rng(3).integers(0, 65536, (1500, 1400)).astype(np.uint16)
    write_tiff(path, values)
    np.testing.assert_array_equal(sample_values(path), values[::2, ::2].ravel())


@pytest.mark.parametrize(
    ("pixels", "kind"),
    [
        (VALUES.astype(np.float32), "32-bit floating-point pixels"),
        (VALUES[..., 0].astype(np.float64), "64-bit floating-point pixels"),
        (VALUES[..., 0].astype(np.int16), "16-bit signed pixels"),
        (VALUES[..., 0].astype(np.uint32), "32 bits a channel"),
        (np.dstack([VALUES, VALUES[..., :2]]), "5 channels of 16 bits"),
        (VALUES[..., :2], "2 channels of 16 bits"),
    ],
)
def test_other_pixels_are_refused_by_their_kind(tmp_path: Path, pixels: NDArray[np.generic], kind: str) -> None:
    path = write_tiff(tmp_path / "a.tif", pixels)
    for read in (inspect_photograph, check_photograph, read_photograph, sample_values):
        with pytest.raises(ImageError, match=rf"a\.tif: {kind}, photogram reads grey or colour of 8 to 16 bits"):
            read(path)


@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
def test_other_colours_are_refused(tmp_path: Path) -> None:
    printed = write_tiff(tmp_path / "cmyk.tif", np.dstack([VALUES, VALUES[..., :1]]), t262=5, t338=(0,))
    with pytest.raises(ImageError, match="neither grey nor red, green, blue"):
        inspect_photograph(printed)
    rng = np.random.default_rng(8)
    path = tmp_path / "grey and transparent.png"
    with rasterio.open(path, "w", driver="PNG", width=9, height=7, count=2, dtype="uint16") as file:
        file.write(rng.integers(0, 65536, (2, 7, 9)).astype(np.uint16))
    with pytest.raises(ImageError, match="2 channels of 16 bits"):
        inspect_photograph(path)


@pytest.mark.parametrize("name", ["plain.tif", "lzw.tif", "colour.png", "grey.png"])
@pytest.mark.parametrize("share", [0.3, 0.7, 0.995])
def test_truncated_files_are_refused(tmp_path: Path, name: str, share: float) -> None:
    path = written(tmp_path, name)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    for read in (check_photograph, sample_values, lambda path: read_photograph(path, stretch=STRETCH)):
        with pytest.raises(ImageError, match="the file is truncated or damaged"):
            read(path)


@pytest.mark.parametrize("name", FILES)
def test_damage_is_refused_or_harmless(tmp_path: Path, name: str) -> None:
    """Any byte of the file may be wrong: a photograph of its size, or one error."""
    path = written(tmp_path, name)
    whole, rng = path.read_bytes(), np.random.default_rng(11)
    refused = 0
    for place in [*range(8, 140, 3), *rng.integers(0, len(whole), 30).tolist()]:
        content = bytearray(whole)
        content[place] ^= int(rng.integers(1, 256))
        path.write_bytes(bytes(content))
        try:
            pixels = read_photograph(path, (WIDTH, HEIGHT), stretch=STRETCH)
        except ImageError:
            refused += 1
            continue
        assert pixels.shape == (HEIGHT, WIDTH, 3)
    assert refused > 0


@given(st.integers(0, LARGEST_VALUE - 1), st.integers(1, LARGEST_VALUE))
def test_a_stretch_is_monotone_and_reaches_both_ends(low: int, width: int) -> None:
    stretch = Stretch(low, min(low + width, LARGEST_VALUE))
    pixels = stretch.applied(np.arange(LARGEST_VALUE + 1, dtype=np.uint16)).astype(np.int64)
    assert (np.diff(pixels) >= 0).all()
    assert (pixels[stretch.low], pixels[stretch.high]) == (0, 255)


def test_an_8_bit_photograph_comes_back_from_any_range_of_255_steps() -> None:
    steps = np.arange(256)
    for low, per_step in ((0, 1), (4000, 1), (4000, 20), (100, 256)):
        stretch = Stretch(low, low + 255 * per_step)
        np.testing.assert_array_equal(stretch.applied((low + per_step * steps).astype(np.uint16)), steps)


@pytest.mark.parametrize(("low", "high"), [(5, 5), (9, 4), (-1, 7), (0, 65536)])
def test_a_stretch_must_rise(low: int, high: int) -> None:
    with pytest.raises(ImageError, match=f"a stretch from {low} to {high}: it must rise within 0 to 65535"):
        Stretch(low, high)
