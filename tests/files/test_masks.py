"""Masks are found by the names that other programs give them, read in every usual format, and refused when damaged."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from photogram.errors import ImageError
from photogram.files.photographs.masks import check_mask, find_masks, name_of_mask, read_mask, read_masks, write_mask

SIZE = 12, 7
USED = np.ones((7, 12), dtype=bool)
USED[2:5, 3:9] = False


def touch(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")
    return folder


@pytest.mark.parametrize(
    "name",
    [
        "IMG_1.png", "img_1.PNG", "IMG_1.JPG.png", "IMG_1_mask.png", "IMG_1_MASK.JPG", "IMG_1-mask.tif",
        "IMG_1.mask.png", "IMG_1.JPG.mask.png", "IMG_1_Masq.tif", "IMG_1 mask.png",
    ],
)  # fmt: skip
def test_a_mask_is_found_by_the_names_of_other_programs(tmp_path: Path, name: str) -> None:
    found = find_masks(touch(tmp_path, name), ["IMG_1.JPG", "IMG_10.JPG"])
    assert found.of_photograph == {"IMG_1.JPG": tmp_path / name}
    assert found.others == ()


def test_a_photograph_whose_name_ends_in_mask_keeps_its_own(tmp_path: Path) -> None:
    found = find_masks(touch(tmp_path, "gas_mask.png", "gas.png"), ["gas_mask.JPG", "gas.JPG"])
    assert {name: path.name for name, path in found.of_photograph.items()} == {
        "gas_mask.JPG": "gas_mask.png",
        "gas.JPG": "gas.png",
    }


def test_masks_of_folders_within_and_of_photographs_in_folders(tmp_path: Path) -> None:
    names = ["100MEDIA/DJI_1.JPG", "101MEDIA/DJI_1.JPG", "DJI_2.JPG"]
    folder = touch(tmp_path, "100MEDIA/DJI_1_mask.png", name_of_mask(names[1]), "sky/DJI_2.png")
    found = find_masks(folder, names).of_photograph
    assert [found[name].relative_to(folder).as_posix() for name in names] == [
        "100MEDIA/DJI_1_mask.png", "101MEDIA_DJI_1.JPG.png", "sky/DJI_2.png",
    ]  # fmt: skip


def test_masks_are_joined_as_other_programs_write_names(tmp_path: Path) -> None:
    names = ["survey/west/DJI_0001.JPG", "survey/east/DJI_0001.JPG", "survey/east/DJI_0012.JPG"]
    files = ["west/dji_0001_mask.png", "east/DJI_1.png", "masks/DJI_12.JPG.png"]
    folder = touch(tmp_path, *files, "DJI_0012.JPG_depth.png")
    found = find_masks(folder, names)
    assert [found.of_photograph[name].relative_to(folder).as_posix() for name in names] == files
    assert found.others == ("DJI_0012.JPG_depth.png",)
    with pytest.raises(ImageError, match=r"DJI_1.png fits several photographs, survey/west/\S*, survey/east"):
        find_masks(touch(tmp_path, "DJI_1.png"), names)


def test_what_fits_no_photograph_is_named_and_hidden_files_are_not_looked_at(tmp_path: Path) -> None:
    found = find_masks(touch(tmp_path, "a.png", "b.png", ".c.png", "notes.txt"), ["a.jpg"])
    assert found.others == ("b.png",)


@pytest.mark.parametrize(
    ("files", "said"),
    [
        (("x.png", "y.png"), "no mask in .* x.png, y.png fit none; call them a_mask.png"),
        ((), "there is no picture in it"),
        (("a.png", "a_mask.png"), "a.jpg has 2 masks, a.png, a_mask.png: keep one"),
        (("a.png", "a.tif"), "a.jpg has 2 masks"),
    ],
)
def test_a_folder_that_does_not_fit_is_refused(tmp_path: Path, files: tuple[str, ...], said: str) -> None:
    with pytest.raises(ImageError, match=said):
        find_masks(touch(tmp_path, *files), ["a.jpg"])


def test_a_name_that_fits_two_photographs_is_refused_and_the_whole_name_decides(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"a\.png fits several photographs, a\.jpg, a\.tif: call it a\.jpg\.png$"):
        find_masks(touch(tmp_path, "a.png"), ["a.jpg", "a.tif"])
    (tmp_path / "a.png").rename(tmp_path / "a.tif.png")
    assert list(find_masks(tmp_path, ["a.jpg", "a.tif"]).of_photograph) == ["a.tif"]


def saved(path: Path, picture: Image.Image, **more: Any) -> Path:
    picture.save(path, **more)
    return path


def layers(colour: np.ndarray, alpha: np.ndarray) -> Image.Image:
    return Image.fromarray(np.dstack([colour, colour, colour, alpha]).astype(np.uint8))


GREY = Image.fromarray(np.where(USED, 255, 0).astype(np.uint8))
FAINT = Image.fromarray(np.where(USED, 1, 0).astype(np.uint8))


@pytest.mark.parametrize(
    ("name", "picture"),
    [
        ("grey.png", GREY),
        ("faint.png", FAINT),
        ("one_bit.png", GREY.convert("1")),
        ("colour.png", Image.merge("RGB", [FAINT, Image.new("L", SIZE), Image.new("L", SIZE)])),
        ("palette.png", GREY.convert("RGB").convert("P", palette=Image.Palette.ADAPTIVE)),
        ("grey.tif", GREY),
        ("one_bit.tif", GREY.convert("1")),
        ("deep.png", Image.fromarray(np.where(USED, 40000, 0).astype(np.uint16))),
        ("opaque.png", layers(np.where(USED, 255, 0), np.full(USED.shape, 255))),
        ("white.png", layers(np.full(USED.shape, 255), np.where(USED, 9, 0))),
        ("both.png", layers(np.where(USED, 255, 0), np.where(USED, 255, 0))),
        ("grey_alpha.png", Image.merge("LA", [Image.new("L", SIZE, 200), GREY])),
    ],
)
def test_every_usual_format_says_the_same(tmp_path: Path, name: str, picture: Image.Image) -> None:
    path = saved(tmp_path / name, picture)
    check_mask(path, SIZE)
    assert np.array_equal(read_mask(path, SIZE), USED)


def test_a_jpeg_is_black_below_the_middle(tmp_path: Path) -> None:
    used = np.ones((64, 96), dtype=bool)
    used[13:37, 21:69] = False
    picture = Image.fromarray(np.where(used, 255, 0).astype(np.uint8))
    path = saved(tmp_path / "m.jpg", picture, quality=60)
    assert np.count_nonzero(np.asarray(Image.open(path))[~used]), "its black is not 0 everywhere"
    assert np.array_equal(read_mask(path), used)


def test_black_and_transparency_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    painted = layers(np.zeros(USED.shape), np.where(USED, 0, 255))  # black paint on a transparent layer
    with pytest.raises(ImageError, match="not clear what is left out: export it without transparency"):
        read_mask(saved(tmp_path / "layer.png", painted))


def test_sizes_kinds_and_a_mask_that_leaves_nothing_are_refused(tmp_path: Path) -> None:
    path = saved(tmp_path / "m.png", GREY)
    with pytest.raises(ImageError, match=r"12 × 7 px, turned by 90°, its photograph has 7 × 12 px"):
        check_mask(path, (7, 12))
    with pytest.raises(ImageError, match="its photograph has 20 × 7 px"):
        read_mask(path, (20, 7))
    with pytest.raises(ImageError, match="pixel type F"):
        read_mask(saved(tmp_path / "f.tif", Image.new("F", SIZE, 1.0)))
    with pytest.raises(ImageError, match="all of it is black"):
        read_mask(saved(tmp_path / "black.png", Image.new("L", SIZE)))
    with pytest.raises(ImageError, match="file not found"):
        read_mask(tmp_path / "none.png")
    with pytest.raises(ImageError, match="was modified since the run began"):
        read_mask(path, SIZE, "0" * 64)


def test_several_masks_leave_what_all_of_them_leave(tmp_path: Path) -> None:
    left = np.ones(USED.shape, dtype=bool)
    left[:, :4] = False
    for name, used in (("a.png", USED), ("b.png", left), ("c.png", ~left)):
        write_mask(tmp_path / name, used)
    assert np.array_equal(read_masks([tmp_path / "a.png", tmp_path / "b.png"]), USED & left)
    with pytest.raises(ImageError, match="leaves nothing"):
        read_masks([tmp_path / "b.png", tmp_path / "c.png"])


@given(arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9))).filter(lambda used: used.any()))
def test_what_is_written_is_read(tmp_path_factory: pytest.TempPathFactory, used: np.ndarray) -> None:
    path = tmp_path_factory.mktemp("masks") / "m.png"
    write_mask(path, used)
    assert np.array_equal(read_mask(path, (used.shape[1], used.shape[0])), used)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "TIFF"])
def test_a_damaged_mask_is_refused_or_reads_as_a_mask(tmp_path: Path, kind: str) -> None:
    rng, stream = np.random.default_rng(4), io.BytesIO()
    Image.fromarray(np.where(rng.random((40, 50)) > 0.3, 255, 0).astype(np.uint8)).save(stream, kind)
    whole, path, refused = stream.getvalue(), tmp_path / "m", 0
    for trial in range(200):
        data = bytearray(whole)
        if trial % 2:
            data = data[: int(rng.integers(0, len(data)))]
        else:
            data[int(rng.integers(0, len(data)))] = int(rng.integers(0, 256))
        path.write_bytes(bytes(data))
        try:
            assert read_mask(path, (50, 40)).shape == (40, 50)
        except ImageError as fault:
            refused += str(path) in str(fault)
    assert refused >= 90


def test_damage_of_a_png_shows_without_decoding(tmp_path: Path) -> None:
    path = saved(tmp_path / "m.png", GREY)
    data = bytearray(path.read_bytes())
    data[-20] ^= 0xFF
    path.write_bytes(bytes(data))
    with pytest.raises(ImageError, match="cannot be decoded"):
        check_mask(path, SIZE)
