from dataclasses import replace
from math import hypot

import pytest

from photogram.files.photographs.tags import Dewarp, PhotographTags
from photogram.project.draft.cameras import camera_key, camera_names, tagged_camera, whole_diagonal_px

DJI = PhotographTags(make="DJI", model="FC300S", width_px=4000, height_px=3000, focal_mm=3.61, focal_35mm_mm=20.0)
DEWARP = Dewarp(
    "2018-09-07", (3656.9, 3650.7), (-20.03, 23.1), (-0.267, 0.112, -0.0332), (0.0009, 0.0001), (5472.0, 3648.0)
)
P4R = PhotographTags(
    make="DJI", model="FC6310R", width_px=5472, height_px=3648, focal_mm=8.8, focal_35mm_mm=24.0, dewarp=DEWARP
)


@pytest.mark.parametrize(
    ("size", "diagonal_mm", "expected"),
    [
        ((4000, 3000), 7.8, 5000.0),
        ((4000, 2250), 7.8, 5000.0),
        ((3000, 4000), 7.8, 5000.0),
        ((800, 450), None, 1000.0),
        ((5472, 3648), 15.9, hypot(5472, 3648)),
        ((4864, 3648), 15.9, hypot(5472, 3648)),
        ((5472, 3078), 15.9, hypot(5472, 3648)),
        ((6000, 4000), 28.8, hypot(6000, 4000)),
        ((6000, 4000), None, hypot(6000, 4000)),
        ((1600, 1300), 6.2, hypot(1600, 1300)),
        ((8256, 6192), 54.8, hypot(8256, 6192)),
    ],
)
def test_equivalent_focal_length_belongs_to_the_whole_sensor(
    size: tuple[int, int], diagonal_mm: float | None, expected: float
) -> None:
    assert whole_diagonal_px(*size, diagonal_mm) == pytest.approx(expected, rel=1e-9)


def test_focal_length_does_not_depend_on_the_part_of_the_sensor_kept() -> None:
    whole = tagged_camera("a", [DJI], None)
    part = tagged_camera("b", [replace(DJI, height_px=2250)], None)
    assert whole is not None
    assert part is not None
    assert whole.focal_px == pytest.approx(20.0 / 43.2666 * 5000.0)
    assert part.focal_px == pytest.approx(whole.focal_px)
    assert part.principal_point_px == (1999.5, 1124.5)
    # 20 mm by the picture's own diagonal is 8 % less: half of that is covered
    f, own_diagonal_px = part.focal_px, 20.0 / 43.2666 * hypot(4000, 2250)
    assert part.sigmas[0] == pytest.approx(hypot(0.03 * f, 0.5 * (f - own_diagonal_px)))
    assert part.sigmas[1:] == pytest.approx((40.0, 0.1, 0.1, 0.05, 0.003, 0.003, 0.003 * f, 0.001 * f))
    assert part.readings_px == pytest.approx((20.0 / 36.0 * 4000.0, own_diagonal_px, 3.61 / 6.17 * 4000.0))
    assert "Read otherwise it is 2222 px by the width; 2121 px by the picture's own diagonal; 2340 px" in part.reason
    assert whole.readings_px == pytest.approx((20.0 / 36.0 * 4000.0, 3.61 / 6.17 * 4000.0))
    assert "35 mm equivalent 20 mm" in part.source


def test_sony_by_equivalent_and_by_resolution() -> None:
    tags = PhotographTags(width_px=6000, height_px=4000, focal_mm=35.0, focal_35mm_mm=35.0, pixels_per_mm=166.9)
    by_equivalent = tagged_camera("a", [tags], None)
    by_resolution = tagged_camera("a", [replace(tags, focal_35mm_mm=None)], None)
    assert by_equivalent is not None
    assert by_resolution is not None
    assert by_equivalent.focal_px == pytest.approx(35.0 / 36.0 * 6000.0, rel=2e-3)
    assert by_resolution.focal_px == pytest.approx(35.0 * 166.9)


def test_calibration_of_dji_is_taken_with_its_centre_and_order() -> None:
    camera = tagged_camera("a", [P4R], None)
    assert camera is not None
    assert camera.focal_px == pytest.approx(3653.8)
    assert camera.principal_point_px == pytest.approx((2735.5 - 20.03, 1823.5 + 23.1))
    assert camera.radial == DEWARP.radial
    assert camera.tangential == DEWARP.tangential
    assert camera.sigmas == pytest.approx((0.002 * 3653.8, 5.472, 0.01, 0.01, 0.01, 0.001, 0.001, 0.0, 0.0))
    assert camera.readings_px == (), "a calibration has one reading"
    assert camera.source == "DewarpData of 2018-09-07"


def test_different_focal_lengths_across_and_down_widen_the_sigma() -> None:
    dewarp = replace(DEWARP, focal_px=(3700.0, 3600.0))
    camera = tagged_camera("a", [replace(P4R, dewarp=dewarp)], None)
    assert camera is not None
    assert camera.focal_px == pytest.approx(3650.0)
    assert camera.sigmas[0] == pytest.approx(50.0)
    assert "3700.0 px across and 3600.0 px down" in camera.reason


def test_calibration_is_scaled_to_smaller_pictures_and_refused_for_another_part_of_the_sensor() -> None:
    whole = tagged_camera("a", [P4R], None)
    quarter = tagged_camera("a", [replace(P4R, width_px=1368, height_px=912)], None)
    part = tagged_camera("a", [replace(P4R, height_px=3078)], None)
    assert whole is not None
    assert quarter is not None
    assert part is not None
    assert quarter.focal_px == pytest.approx(whole.focal_px / 4)
    assert quarter.principal_point_px == pytest.approx((683.5 - 20.03 / 4, 455.5 + 23.1 / 4))
    assert quarter.radial == whole.radial
    assert "scaled by 0.25" in quarter.reason
    assert part.source.startswith("EXIF focal length")


def test_calibration_of_another_size_is_found_by_exif_where_its_own_size_is_not_given() -> None:
    tags = replace(P4R, width_px=1368, height_px=912, dewarp=replace(DEWARP, size_px=None))
    camera = tagged_camera("a", [tags], None)
    assert camera is not None
    assert camera.source.startswith("EXIF focal length")
    assert camera.focal_px == pytest.approx(24.0 / 43.2666 * hypot(1368, 912))


def test_pictures_that_the_camera_has_freed_of_distortion_have_none() -> None:
    camera = tagged_camera("a", [replace(P4R, dewarp=replace(DEWARP, applied=True))], None)
    assert camera is not None
    assert camera.radial == (0.0, 0.0, 0.0)
    assert camera.tangential == (0.0, 0.0)
    assert camera.principal_point_px == (2735.5, 1823.5)
    assert camera.focal_px == pytest.approx(3653.8)


def test_the_most_frequent_calibration_is_taken() -> None:
    other = replace(P4R, dewarp=replace(DEWARP, focal_px=(3600.0, 3600.0)))
    camera = tagged_camera("a", [other, P4R, P4R], None)
    assert camera is not None
    assert camera.focal_px == pytest.approx(3653.8)
    assert "2 different ones" in camera.reason


def test_calibration_in_the_camera_name_space_needs_the_resolution() -> None:
    tags = PhotographTags(width_px=5472, height_px=3648, focal_mm=10.6, calibrated_focal_mm=10.61)
    assert tagged_camera("a", [tags], None) is None
    radial = (0.01, -0.08, 0.07)
    camera = tagged_camera("a", [replace(tags, pixels_per_mm=416.6, calibrated_radial=radial)], None)
    assert camera is not None
    assert camera.focal_px == pytest.approx(10.61 * 416.6)
    assert camera.radial == radial
    assert "maker's calibration" in camera.source


def test_given_focal_length_comes_first_and_without_any_there_is_no_camera() -> None:
    camera = tagged_camera("a", [P4R], 3600.0)
    assert camera is not None
    assert camera.focal_px == 3600.0
    assert tagged_camera("a", [replace(DJI, focal_35mm_mm=None)], None) is None


def test_cameras_are_told_by_body_lens_focal_length_band_and_size() -> None:
    others = [
        replace(DJI, serial="1"),
        replace(DJI, lens="x"),
        replace(DJI, lens_serial="2"),
        replace(DJI, band="Red"),
        replace(DJI, focal_mm=4.0),
        replace(DJI, height_px=2250),
    ]
    assert len({camera_key(t) for t in [DJI, *others]}) == 7
    assert camera_key(replace(DJI, focal_mm=3.64, gimbal_yaw_deg=1.0, dewarp=DEWARP)) == camera_key(DJI)


def test_names_of_cameras_say_what_tells_them_apart() -> None:
    tags = [
        DJI,
        replace(DJI, height_px=2250),
        replace(P4R, band="Red"),
        replace(P4R, band="Blue"),
        PhotographTags(make="Canon", model="Canon EOS R5", width_px=30, height_px=20),
        PhotographTags(width_px=30, height_px=20),
    ]
    assert camera_names([camera_key(t) for t in tags], tags) == [
        "dji_fc300s_4000x3000",
        "dji_fc300s_4000x2250",
        "red_8_8mm_dji_fc6310r_5472x3648",
        "blue_8_8mm_dji_fc6310r_5472x3648",
        "canon_eos_r5_30x20",
        "camera_30x20",
    ]
    same = [replace(DJI, serial=s) for s in "ab"]
    names = camera_names([camera_key(t) for t in same], same)
    assert len(set(names)) == 2
