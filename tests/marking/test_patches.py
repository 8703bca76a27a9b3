"""Patches of photographs: exactly the pixels of their windows, within bounded memory."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from photogram.errors import ControlPointError, ImageError
from photogram.files.photographs.images import read_window
from photogram.marking.page.patches import AROUND, PatchReader, Window

SIZE = 1501, 1103


@pytest.fixture(scope="module")
def pixels() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    rng = np.random.default_rng(1)
    coarse = rng.integers(0, 256, (SIZE[1] // 20 + 1, SIZE[0] // 20 + 1, 3), dtype=np.uint8)
    return np.kron(coarse, np.ones((20, 20, 1), dtype=np.uint8))[: SIZE[1], : SIZE[0]]


@pytest.fixture(scope="module")
def photographs(
    pixels: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], tmp_path_factory: pytest.TempPathFactory
) -> list[Path]:
    """A JPEG that a viewer would turn, and the same pixels as PNG."""
    folder = tmp_path_factory.mktemp("photographs")
    paths = [folder / "a.jpg", folder / "b.png"]
    turned = Image.Exif()
    turned[0x0112] = 6
    Image.fromarray(pixels).save(paths[0], quality=98, subsampling=0, exif=turned)
    Image.fromarray(pixels).save(paths[1])
    return paths


@pytest.fixture
def reader(photographs: list[Path]) -> PatchReader:
    return PatchReader(photographs, [SIZE, SIZE])


def test_a_patch_has_the_pixels_of_its_window(
    reader: PatchReader, pixels: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]
) -> None:
    wanted = Window(701, 333, 90, 71)
    assert reader.window(1, wanted) == wanted
    np.testing.assert_array_equal(reader.pixels(1, wanted), pixels[333:404, 701:791])
    off = reader.pixels(0, wanted).astype(float) - pixels[333:404, 701:791]
    assert np.abs(off).mean() < 4.0, "JPEG, in the pixels of the sensor whatever its tag says"


@pytest.mark.parametrize("photograph", [0, 1])
@pytest.mark.parametrize("scale", [2, 4, 8])
def test_a_reduced_patch_covers_the_window_that_is_told(
    reader: PatchReader, pixels: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], photograph: int, scale: int
) -> None:
    wanted = Window(517, 203, 300, 240, scale)
    window = reader.window(photograph, wanted)
    assert window.left <= 517
    assert window.left + window.width >= 817
    assert window.left % scale == window.width % scale == 0
    found = reader.pixels(photograph, wanted)
    assert found.shape == (window.height // scale, window.width // scale, 3)
    part = pixels[window.upper : window.upper + window.height, window.left : window.left + window.width]
    mean = part.reshape(window.height // scale, scale, window.width // scale, scale, 3).mean(axis=(1, 3))
    assert np.abs(found - mean).mean() < 4.0


def test_windows_end_at_the_photograph(reader: PatchReader) -> None:
    assert reader.window(0, Window(-50, -20, 100, 60)) == Window(0, 0, 50, 40)
    assert reader.window(0, Window(1490, 1090, 100, 60)) == Window(1490, 1090, 11, 13)
    assert reader.window(0, Window(1480, 1080, 100, 60, 8)) == Window(1480, 1080, 24, 24, 8)
    assert reader.pixels(0, Window(1480, 1080, 100, 60, 8)).shape == (3, 3, 3)
    assert reader.pixels(1, Window(1480, 1080, 100, 60, 8)).shape == (3, 3, 3)


@pytest.mark.parametrize(
    "wanted", [Window(2000, 0, 10, 10), Window(0, 0, 10, 10, 3), Window(0, 0, 0, 10), Window(0, 0, 10**6, 10)]
)
def test_what_is_no_window_is_refused(reader: PatchReader, wanted: Window) -> None:
    with pytest.raises(ControlPointError, match="patch"):
        reader.pixels(0, wanted)


def test_a_picture_is_png(reader: PatchReader) -> None:
    wanted = Window(3, 5, 40, 30)
    with Image.open(io.BytesIO(reader.picture(1, wanted))) as picture:
        assert picture.format == "BMP"
        np.testing.assert_array_equal(np.array(picture), reader.pixels(1, wanted))


def test_a_photograph_is_decoded_once_for_its_neighbourhood_and_memory_is_bounded(
    photographs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded: list[tuple[object, ...]] = []
    read = read_window

    def counted(*arguments: object) -> object:
        decoded.append(arguments)
        return read(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr("photogram.marking.page.patches.read_window", counted)
    many, most = [photographs[1]] * 12, 3_000_000
    reader = PatchReader(many, [SIZE] * 12, most)
    for i in range(12):
        reader.pixels(i, Window(700, 500, 80, 80))
        reader.pixels(i, Window(700 + AROUND // 2, 500 - AROUND // 2, 80, 80))
        assert reader.kept_bytes <= most
    assert len(decoded) == 12
    reader.pixels(11, Window(0, 0, 80, 80))
    assert len(decoded) == 13


def test_what_is_read_ahead_is_there(photographs: list[Path]) -> None:
    reader = PatchReader(photographs, [SIZE, SIZE])
    reader.read_ahead([(0, Window(100, 100, 80, 80)), (1, Window(100, 100, 80, 80)), (1, Window(9000, 0, 5, 5))])
    for plan in reader._planned:
        plan.result(timeout=30)
    assert reader.kept_bytes > 0
    reader.close()


def test_another_photograph_under_its_name_is_refused(photographs: list[Path]) -> None:
    with pytest.raises(ImageError, match="1501 × 1103 px, but its camera has 1500 × 1103"):
        PatchReader(photographs, [(1500, 1103), SIZE]).pixels(0, Window(0, 0, 10, 10))


def test_nothing_is_read_ahead_after_the_end(photographs: list[Path]) -> None:
    reader = PatchReader(photographs, [SIZE, SIZE])
    reader.close()
    reader.read_ahead([(0, Window(100, 100, 80, 80))])
    assert reader.kept_bytes == 0
