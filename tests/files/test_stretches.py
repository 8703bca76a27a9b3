"""The stretch of a camera's photographs, from a sample of their pixel values."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
from deep_files import write_tiff
from PIL import Image

from photogram.errors import ImageError
from photogram.files.photographs import stretches
from photogram.files.photographs.depth import Stretch
from photogram.files.photographs.duplicates import find_duplicates
from photogram.files.photographs.stretches import MIXED_REMEDY, SAMPLED, camera_stretches, find_stretch, mixed_depths
from photogram.files.photographs.tags import PhotographTags


def uniform(low: int, high: int, seed: int = 1, shape: tuple[int, ...] = (200, 250)) -> np.ndarray:
    return np.random.default_rng(seed).integers(low, high + 1, shape).astype(np.uint16)


def test_ten_and_twelve_bits_use_their_full_contrast(tmp_path: Path) -> None:
    """What a camera of 10 or 12 bits counts to becomes nearly white, not nearly black."""
    for highest in (1023, 4095):
        path = write_tiff(tmp_path / "a.tif", uniform(0, highest))
        stretch = find_stretch([path])
        assert stretch.low == 0
        assert highest * 0.999 <= stretch.high <= highest


def test_a_few_outliers_do_not_take_the_contrast(tmp_path: Path) -> None:
    """Thermal, with a chimney: 0.02 % of the pixels lie far above all others."""
    values = uniform(4000, 5000)
    values.ravel()[:10] = 60000
    stretch = find_stretch([write_tiff(tmp_path / "a.tif", values)])
    assert stretch.low == 4000
    assert 5000 <= stretch.high <= 5000 + 1.01 * stretches.MARGIN * 1000


def test_all_photographs_and_channels_count(tmp_path: Path) -> None:
    dark = write_tiff(tmp_path / "dark.tif", uniform(1000, 2000))
    colour = uniform(1500, 1800, 2, (100, 100, 3))
    colour[..., 2] += 7000
    bright = write_tiff(tmp_path / "bright.tif", colour)
    stretch = find_stretch([dark, bright])
    assert stretch.low == 1000
    assert 8700 < stretch.high <= 8800
    with ThreadPoolExecutor(2) as executor:
        assert find_stretch([dark, bright], executor) == stretch


def test_a_sample_is_spread_over_the_survey(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []

    def values_of(path: Path) -> np.ndarray:
        read.append(path.name)
        return uniform(10, 900, shape=(50,))

    monkeypatch.setattr(stretches, "sample_values", values_of)
    find_stretch([tmp_path / f"{i}.tif" for i in range(500)])
    numbers = [int(Path(name).stem) for name in read]
    assert len(numbers) <= SAMPLED
    assert numbers[0] == 0
    assert numbers[-1] >= 475


def test_nearly_all_pixels_equal_still_make_a_stretch(tmp_path: Path) -> None:
    values = np.full((200, 250), 300, np.uint16)
    values[0, :10] = 700
    assert find_stretch([write_tiff(tmp_path / "a.tif", values)]) == Stretch(300, 700)


def test_equal_pixels_are_an_error(tmp_path: Path) -> None:
    paths = [write_tiff(tmp_path / name, np.full((20, 30), 512, np.uint16)) for name in ("a.tif", "b.tif")]
    with pytest.raises(ImageError, match=r"a\.tif: all its pixels have the value 512, and those of 1 further"):
        find_stretch(paths)
    with pytest.raises(ImageError, match=r"a\.tif: all its pixels have the value 512, so they show nothing"):
        find_stretch(paths[:1])
    with pytest.raises(ImageError, match="no photographs"):
        find_stretch([])


def test_an_8_bit_photograph_needs_none(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((20, 30), np.uint8)).save(tmp_path / "a.png")
    with pytest.raises(ImageError, match=r"a\.png: 8 bits a channel, which need no stretch"):
        find_stretch([tmp_path / "a.png"])


def of(folder: Path, names: Sequence[str], cameras: Sequence[int], bits: Sequence[int]) -> dict[str, Stretch]:
    with ThreadPoolExecutor(2) as executor:
        photographs = [(name, folder / name) for name in names]
        return camera_stretches(photographs, cameras, ["red", "wide", "spare"], bits, executor)


def test_every_camera_has_its_own(tmp_path: Path) -> None:
    for name, low in (("r1.tif", 100), ("r2.tif", 150), ("n1.tif", 9000)):
        write_tiff(tmp_path / name, uniform(low, low + 500))
    found = of(tmp_path, ["r1.tif", "n1.tif", "r2.tif"], [0, 1, 0], [16, 16, 16])
    assert set(found) == {"red", "wide"}
    assert found["red"].low == 100
    assert found["wide"].low == 9000
    assert of(tmp_path, ["a.jpg", "b.jpg"], [0, 0], [8, 8]) == {}


def test_photographs_of_other_depth_are_named(tmp_path: Path) -> None:
    with pytest.raises(ImageError) as fault:
        of(tmp_path, [f"{i}.tif" for i in range(6)], [0, 0, 0, 1, 1, 1], [16, 8, 16, 8, 8, 12])
    assert str(fault.value).splitlines() == [
        f"camera red: 1 photograph of 3 (1.tif) has 8 bits a channel, the others 16: {MIXED_REMEDY}",
        f"camera wide: 1 photograph of 3 (5.tif) has 12 bits a channel, the others 8: {MIXED_REMEDY}",
    ]
    assert mixed_depths([], []) == mixed_depths(["a", "b"], [12, 12]) == ""
    assert mixed_depths(list("abcd"), [16, 8, 16, 12]).startswith("2 photographs of 4 (b, d) have 8 or 12 bits")


def test_copies_are_found_among_deep_photographs(tmp_path: Path) -> None:
    """Saved anew with other bytes, of the same moment; the next exposure looks different, an 8-bit one is no copy."""
    tags = PhotographTags(time=datetime(2025, 5, 4, 10), longitude_deg=9.0, latitude_deg=48.0, bits=16)
    smooth = cv2.GaussianBlur(uniform(0, 65535, 3), (0, 0), 15.0)
    for name, values in (("a.tif", smooth), ("b.tif", smooth + 1), ("c.tif", smooth[::-1])):
        write_tiff(tmp_path / name, values.astype(np.uint16))
    Image.fromarray((smooth // 256).astype(np.uint8)).save(tmp_path / "d.tif")
    paths = [tmp_path / f"{name}.tif" for name in "abcd"]
    with ThreadPoolExecutor(2) as executor:
        found = find_duplicates(paths, [tags, tags, tags, replace(tags, bits=8)], [0] * 4, executor)
    assert found == [(0, 1)]
