"""Which files can be photographs, and which show the same exposure, by their names."""

from photogram.files.photographs.names import deep_twins, without_raw_twins


def test_raw_files_beside_a_picture_are_left_out() -> None:
    names = ["a/DJI_1.JPG", "a/DJI_1.DNG", "a/DJI_2.dng", "b/DJI_1.DNG", "a/DJI_3.TIF", "a/dji_3.dng"]
    assert without_raw_twins(names) == ["a/DJI_1.JPG", "a/DJI_2.dng", "b/DJI_1.DNG", "a/DJI_3.TIF"]
    assert without_raw_twins(["1.DNG", "2.DNG"]) == ["1.DNG", "2.DNG"]


def test_deep_photographs_beside_one_of_8_bits() -> None:
    names = ["1.JPG", "1.tif", "2.tif", "b/1.tif", "3.jpg", "3.png"]
    assert deep_twins(names, [8, 16, 16, 16, 8, 8]) == {"1.tif": "1.JPG"}
    assert deep_twins(["1.tif", "1.png"], [16, 16]) == {}
