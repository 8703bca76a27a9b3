from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from makers import textured
from scipy.spatial import cKDTree

from photogram.errors import ImageError, SettingError
from photogram.sfm.tie_points.detector import FeatureSettings
from photogram.sfm.tie_points.detectors import sift
from photogram.sfm.tie_points.features import find_features
from photogram.survey import Features

ALL = FeatureSettings(maximum=200_000, cells_per_side=1)


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    return textured(760, 520, 1)


@pytest.fixture(scope="module")
def whole(picture: np.ndarray) -> Features:
    return find_features("whole", picture, replace(ALL, tile_px=4096))


def places(features: Features) -> np.ndarray:
    """Position, size and direction of key points as rows that can be compared by their distance."""
    direction = np.column_stack([np.cos(features.angle_rad), np.sin(features.angle_rad)])
    return np.column_stack([features.pixel, features.size_px, 50 * direction])


def blobs(width: int, height: int, centres: np.ndarray, sigma_px: float) -> np.ndarray:
    row, column = np.mgrid[:height, :width]
    picture = np.full((height, width), 60.0)
    for u, v in centres:
        picture += 150 * np.exp(-((column - u) ** 2 + (row - v) ** 2) / (2 * sigma_px**2))
    return np.repeat(np.round(picture).astype(np.uint8)[..., None], 3, axis=2)


def test_blobs_are_found_where_they_are_in_photograms_pixel_frame() -> None:
    rng = np.random.default_rng(4)
    grid = np.stack(np.meshgrid(np.arange(40.0, 460.0, 60.0), np.arange(40.0, 300.0, 60.0)), axis=-1).reshape(-1, 2)
    centres = grid + rng.uniform(-0.5, 0.5, grid.shape)
    found = find_features("blobs", blobs(500, 340, centres, 3.0), replace(ALL, tile_px=256))
    nearest, which = cKDTree(found.pixel).query(centres)
    # Half a pixel would show: the centre of the top-left pixel is (0, 0).
    assert np.abs(np.mean(found.pixel[which] - centres, axis=0)).max() < 0.03
    assert np.max(nearest) < 0.15
    assert np.all(np.abs(found.size_px[which] / (2 * 3.0) - np.sqrt(2)) < 0.7)


def test_key_points_are_sorted_within_the_picture_and_complete(picture: np.ndarray, whole: Features) -> None:
    assert len(whole) > 5000
    order = np.lexsort((whole.pixel[:, 0], whole.pixel[:, 1]))
    np.testing.assert_array_equal(order, np.arange(len(whole)))
    assert whole.pixel.min() >= 0
    assert np.all(whole.pixel.max(axis=0) <= [759, 519])
    column, row = np.round(whole.pixel).astype(int).T
    np.testing.assert_array_equal(whole.colour, picture[row, column])
    assert (whole.descriptor.dtype, whole.descriptor.shape[1]) == (np.dtype(np.uint8), 128)


def opencv_sift(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places and responses of the key points that OpenCV's SIFT finds, and their descriptors."""
    sift = cv2.SIFT.create(contrastThreshold=0.02, enable_precise_upscale=True)
    key_points, descriptor = sift.detectAndCompute(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), None)
    angle = np.deg2rad([k.angle for k in key_points])
    place = np.array([(*k.pt, k.size) for k in key_points])
    table = np.column_stack([place, 50 * np.cos(angle), 50 * np.sin(angle)])
    return table, np.array([k.response for k in key_points]), descriptor


def test_what_is_taken_before_it_is_oriented_is_what_would_be_taken_of_all(picture: np.ndarray) -> None:
    table, response, _ = opencv_sift(picture)
    cell = np.clip(table[:, :2] / [760, 520] * 6, 0, 5).astype(int)
    rank = np.empty(len(table), dtype=int)
    for c in np.unique(cell, axis=0):
        own = np.flatnonzero((cell == c).all(axis=1))
        rank[own[np.argsort(-response[own], kind="stable")]] = np.arange(len(own))
    taken = table[np.lexsort((-response, rank))[:3000]]
    found = places(find_features("some", picture, FeatureSettings(maximum=3000, cells_per_side=6)))
    assert len(found) == 3000
    assert np.mean(cKDTree(taken).query(found)[0] < 1e-2) > 0.998


@pytest.mark.parametrize("maximum", [300, 200_000])
def test_a_scale_space_made_again_gives_the_same_bytes(
    picture: np.ndarray, maximum: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = FeatureSettings(maximum=maximum, tile_px=300, overlap_px=60)
    held = find_features("held", picture, settings)
    monkeypatch.setattr(sift, "KEPT_PX", 0)
    again = find_features("again", picture, settings)
    for name in ("pixel", "size_px", "angle_rad", "descriptor", "colour"):
        np.testing.assert_array_equal(getattr(held, name), getattr(again, name))


@pytest.mark.parametrize(("width", "height"), [(20, 400), (400, 20), (9, 9), (700, 33)])
def test_small_and_narrow_pictures_are_searched_to_their_border(width: int, height: int) -> None:
    picture = textured(width, height, 5)
    table, _, _ = opencv_sift(picture)
    if len(table) < 8:
        with pytest.raises(ImageError, match=f"only {len(table)} key points found"):
            find_features("small", picture, ALL)
        return
    found = places(find_features("small", picture, ALL))
    assert np.mean(cKDTree(found).query(table)[0] < 1e-2) > 0.98
    assert np.mean(cKDTree(table).query(found)[0] < 1e-2) > 0.98


@pytest.mark.parametrize("tile_px", [256, 333])
def test_tiles_make_neither_gaps_nor_duplicates(picture: np.ndarray, whole: Features, tile_px: int) -> None:
    tiled = find_features("tiled", picture, replace(ALL, tile_px=tile_px))
    expected, actual = places(whole), places(tiled)
    # Key points of the first octaves are the same; coarser octaves are sampled from another corner of the picture.
    fine = whole.size_px < 6
    assert fine.sum() > 0.9 * len(whole)
    assert np.max(cKDTree(actual).query(expected[fine])[0]) < 1e-3
    assert np.max(cKDTree(expected).query(actual[tiled.size_px < 6])[0]) < 1e-3
    assert np.count_nonzero(tiled.size_px < 6) == np.count_nonzero(fine)
    assert len(tiled) == pytest.approx(len(whole), rel=0.005)
    assert np.mean(cKDTree(tiled.pixel).query(whole.pixel)[0] < 1) > 0.99


def test_rows_and_columns_of_tiles_are_not_confused() -> None:
    picture = textured(700, 200, 6)
    whole = find_features("whole", picture, replace(ALL, tile_px=4096))
    tiled = find_features("tiled", picture, replace(ALL, tile_px=256))
    turned = find_features("turned", np.ascontiguousarray(np.rot90(picture)), replace(ALL, tile_px=256))
    assert len(tiled) == pytest.approx(len(whole), rel=0.005)
    assert len(turned) == pytest.approx(len(whole), rel=0.02)
    back = np.column_stack([699 - turned.pixel[:, 1], turned.pixel[:, 0]])
    assert np.mean(cKDTree(back).query(tiled.pixel)[0] < 0.1) > 0.97


def test_the_same_picture_gives_the_same_key_points(picture: np.ndarray) -> None:
    settings = FeatureSettings(maximum=900, tile_px=300)
    one, other = (find_features("same", picture, settings) for _ in range(2))
    for name in ("pixel", "size_px", "angle_rad", "descriptor", "colour"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_the_number_of_threads_changes_nothing(picture: np.ndarray) -> None:
    settings = FeatureSettings(maximum=900, tile_px=300)
    before = cv2.getNumThreads()
    results: list[Features] = []
    try:
        for threads in (1, 3):
            cv2.setNumThreads(threads)
            with ThreadPoolExecutor(threads) as workers:
                results += workers.map(lambda _: find_features("same", picture, settings), range(threads))
    finally:
        cv2.setNumThreads(before)
    for other in results[1:]:
        for name in ("pixel", "size_px", "angle_rad", "descriptor"):
            np.testing.assert_array_equal(getattr(results[0], name), getattr(other, name))


def test_key_points_spread_over_a_picture_whose_texture_does_not() -> None:
    picture = textured(600, 400, 3).astype(float)
    strength = np.where(np.arange(600) < 150, 1.0, 0.6)[None, :, None]
    uneven = np.clip(128 + strength * (picture - 128), 0, 255).astype(np.uint8)
    every = find_features("uneven", uneven, ALL)
    even = find_features("uneven", uneven, replace(ALL, maximum=600, cells_per_side=10))
    strongest = find_features("uneven", uneven, replace(ALL, maximum=600))
    assert len(even) == len(strongest) == 600
    cells = np.histogram2d(even.pixel[:, 0], even.pixel[:, 1], bins=10, range=((0, 600), (0, 400)))[0]
    assert cells.min() >= 5
    assert cells.max() <= 7
    assert np.mean(even.pixel[:, 0] < 150) < 0.35
    assert np.mean(strongest.pixel[:, 0] < 150) > 0.6
    assert np.max(cKDTree(places(every)).query(places(even))[0]) == 0.0


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_a_blank_photograph_is_refused_by_name(grey: int) -> None:
    blank = np.full((120, 170, 3), grey, dtype=np.uint8)
    with pytest.raises(ImageError, match=r"DJI_0007\.JPG: only 0 key points found in 170 x 120 px: .*remove it"):
        find_features("DJI_0007.JPG", blank, FeatureSettings())


def test_a_nearly_blank_photograph_is_refused_too() -> None:
    ramp = np.linspace(20.0, 230.0, 300) + np.linspace(-10.0, 10.0, 200)[:, None]
    foggy = np.repeat(np.round(ramp).astype(np.uint8)[..., None], 3, axis=2)
    with pytest.raises(ImageError, match=r"fog: only [0-7] key points found in 300 x 200 px"):
        find_features("fog", foggy, FeatureSettings())


@pytest.mark.parametrize(
    ("name", "value"),
    [("maximum", 7), ("contrast_threshold", -0.01), ("tile_px", 255), ("overlap_px", 800), ("cells_per_side", 0)],
)
def test_settings_out_of_range_are_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(SettingError, match=f"^{name}: must be .*, found {value:g}$"):
        replace(FeatureSettings(), **{name: value})
