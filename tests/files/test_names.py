"""Which files can be photographs, and which show the same exposure, by their names."""

import pytest

from photogram.files.photographs.names import deep_twins, joined_names, twins


def test_raw_files_beside_a_picture_are_left_out() -> None:
    names = ["a/DJI_1.JPG", "a/DJI_1.DNG", "a/DJI_2.dng", "b/DJI_1.DNG", "a/DJI_3.TIF", "a/dji_3.dng"]
    assert twins(names) == {"a/DJI_1.DNG": "a/DJI_1.JPG", "a/dji_3.dng": "a/DJI_3.TIF"}
    assert twins(["1.DNG", "2.DNG"]) == {}
    assert twins(["1.ARW", "1.heic", "2.cr3", "2.webp"]) == {"1.ARW": "1.heic"}
    assert twins(["1.heic", "1.DNG", "2.HEIC", "2.jpg", "3.hif"]) == {"1.DNG": "1.heic", "2.HEIC": "2.jpg"}


def test_deep_photographs_beside_one_of_8_bits() -> None:
    names = ["1.JPG", "1.tif", "2.tif", "b/1.tif", "3.jpg", "3.png"]
    assert deep_twins(names, [8, 16, 16, 16, 8, 8]) == {"1.tif": "1.JPG"}
    assert deep_twins(["1.tif", "1.png"], [16, 16]) == {}


# ---- names as other programs write them ----------------------------------------------------------------------------

NAMES = ["east/DJI_0001.JPG", "west/DJI_0001.JPG", "west/DJI_0002.JPG", "IMG_0007.tif"]


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("west/DJI_0002.JPG", "west/DJI_0002.JPG"),
        ("DJI_0002.JPG", "west/DJI_0002.JPG"),
        ("dji_0002.jpg", "west/DJI_0002.JPG"),
        ("DJI_0002", "west/DJI_0002.JPG"),
        ("IMG_0007", "IMG_0007.tif"),
        ("DJI_2.JPG", "west/DJI_0002.JPG"),
        ("C:\\flights\\west\\DJI_0001.JPG", "west/DJI_0001.JPG"),
        ("/home/me/east/dji_1", "east/DJI_0001.JPG"),
        ("./photographs/IMG_7.TIF", "IMG_0007.tif"),
        ("IMG_0007.jpg", "IMG_0007.tif"),
    ],
)
def test_a_name_is_joined_where_one_photograph_fits(given: str, name: str) -> None:
    joined = joined_names([given], NAMES)
    assert joined.of == {given: name}
    assert joined.ambiguous == {}


def test_nothing_is_guessed() -> None:
    joined = joined_names(["DJI_0001.JPG", "dji_1", "DJI_0003.JPG", ""], NAMES)
    assert joined.of == {}
    both = ("east/DJI_0001.JPG", "west/DJI_0001.JPG")
    assert joined.ambiguous == {"DJI_0001.JPG": both, "dji_1": both}


def test_two_names_never_become_one_photograph() -> None:
    joined = joined_names(["IMG_0007.tif", "img_7", "a/DJI_0002", "b/DJI_0002"], NAMES)
    assert joined.of == {"IMG_0007.tif": "IMG_0007.tif"}
    assert set(joined.ambiguous) == {"img_7", "a/DJI_0002", "b/DJI_0002"}
