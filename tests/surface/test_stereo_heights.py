"""Heights from pairs of photographs: on a frustum that is known, and of pairs that agree or do not."""

from itertools import permutations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from steep_site import GSD_M, HEIGHT_M, STEP_M, SteepSite, steep_site

from photogram.arrays import Float32Array
from photogram.surface.dense.stereo_heights import StereoHeights, _fill_agreed, stereo_heights
from photogram.surface.views import Views

BOUNDS_M = -1.0, HEIGHT_M + 1.0
AGREE_M = 2.0 * STEP_M
NAN = float("nan")


def found_of(site: SteepSite, near: Float32Array, reduction: int = 1, *, closely: bool = False) -> StereoHeights:
    """Return what pairs tell of the whole grid."""
    lines = site.lines(site.level.grid.whole)
    return stereo_heights(
        site.views, site.picture, reduction, lines, near, BOUNDS_M, reduction * AGREE_M, closely=closely
    )


def level(site: SteepSite) -> Float32Array:
    return np.full((site.level.grid.rows, site.level.grid.columns), 0.5 * HEIGHT_M, np.float32)


@pytest.mark.parametrize("reduction", [1, 2])
def test_heights_of_steep_faces(reduction: int) -> None:
    """Nothing is known but that they are between level ground and the top."""
    site = steep_site(60.0)
    found, whole = found_of(site, level(site), reduction), site.level.grid.whole
    error, face = found.height_m - site.truth_m(whole), site.on_faces(whole)
    known = np.isfinite(found.height_m)
    assert np.array_equal(known, found.pairs > 0)
    assert known[face].mean() > 0.9
    assert abs(np.nanmedian(error[face])) < 0.5 * GSD_M * reduction
    pixel_m = GSD_M * reduction * site.slope  # what a pixel in plan is in height
    assert np.nanmedian(np.abs(error[face])) < 0.7 * pixel_m
    assert np.mean(np.abs(error[face & known]) < 3.0 * pixel_m) > 0.93
    several = face & (found.pairs > 1)
    assert several.sum() > 0.5 * face.sum()
    assert np.mean(np.abs(error[several]) < 3.0 * pixel_m) > 0.97


def test_heights_near_known_ones_are_those_of_all_disparities() -> None:
    """To a fraction of a pixel, though what is known is half a metre off."""
    site = steep_site(60.0)
    whole = site.level.grid.whole
    row, column = np.mgrid[: whole.row_end, : whole.column_end]
    near = (site.truth_m(whole) + 0.5 * np.sin(column / 7.0) * np.cos(row / 9.0)).astype(np.float32)
    free, closely = found_of(site, level(site)), found_of(site, near, closely=True)
    both = (free.pairs > 1) & (closely.pairs > 1)
    assert both.mean() > 0.7
    height_of_pixel_m = 42.0 * GSD_M / 12.0  # from bases of about 12 m
    apart = np.abs(free.height_m - closely.height_m)[both]
    assert np.median(apart) < 0.1 * height_of_pixel_m
    assert np.mean(apart < height_of_pixel_m) > 0.95
    error = np.abs(closely.height_m - site.truth_m(whole))[site.on_faces(whole)]
    assert np.nanmedian(error) < 0.6 * GSD_M * site.slope


def test_no_pair_tells_nothing() -> None:
    site = steep_site(60.0)
    one = Views(site.views.photograph[:1], site.views.cameras._replace(
        camera=site.views.cameras.camera[:1], rotation=site.views.cameras.rotation[:1],
        position=site.views.cameras.position[:1], velocity=site.views.cameras.velocity[:1],
    ))  # fmt: skip
    lines = site.lines(site.level.grid.whole)
    found = stereo_heights(one, site.picture, 1, lines, level(site), BOUNDS_M, AGREE_M)
    assert np.isnan(found.height_m).all()
    assert not found.pairs.any()


@pytest.mark.parametrize("closely", [False, True])
def test_threads_of_opencv_change_nothing(closely: bool) -> None:
    site = steep_site(60.0)
    near = site.truth_m(site.level.grid.whole) if closely else level(site)
    threads, found = cv2.getNumThreads(), []
    try:
        for count in (1, 2, 4):
            cv2.setNumThreads(count)
            heights = found_of(site, near, closely=closely)
            found.append((heights.height_m.tobytes(), heights.pairs.tobytes()))
    finally:
        cv2.setNumThreads(threads)
    assert found[0] == found[1] == found[2]


def agreed(heights: list[float], reach: float) -> tuple[float, int]:
    """Return the height of one cell, and how many pairs agree on it."""
    out, pairs = np.full((1, 1), np.nan, np.float32), np.zeros((1, 1), np.uint8)
    _fill_agreed(np.array(heights, np.float32)[:, None, None], np.float32(reach), out, pairs)
    return float(out[0, 0]), int(pairs[0, 0])


@pytest.mark.parametrize(
    ("heights", "expected"),
    [
        ([NAN, NAN], (NAN, 0)),
        ([NAN, 3.0], (3.0, 1)),
        ([1.0, 5.0, 5.5, 9.0], (5.25, 2)),
        ([1.0, 1.5, 2.0, 8.0, 8.25], (1.5, 3)),  # most agree on the lower one, to the limit
        ([1.0, 1.75, 8.0, NAN, 8.25], (8.125, 2)),  # of two as large, the tighter
        ([1.0, 2.0, 3.0], (1.5, 2)),  # a chain is no group, and of two as tight the lower
        ([4.0, 4.0, 4.0, 4.0], (4.0, 4)),
    ],
)
def test_a_cell_has_the_mean_of_the_most_that_agree(heights: list[float], expected: tuple[float, int]) -> None:
    for order in list(permutations(heights))[:30]:
        height, pairs = agreed(list(order), 1.0)
        assert pairs == expected[1]
        assert height == expected[0] or (np.isnan(height) and np.isnan(expected[0]))


def slow_agreed(values: NDArray[np.float32], reach: np.float32) -> tuple[float, int, float]:
    """Return the mean, the number and the width of the best group, looking at every one."""
    best = (NAN, 0, np.inf)
    ordered = np.sort(values[np.isfinite(values)])
    for first in range(len(ordered)):
        for last in range(first + 1, len(ordered) + 1):
            width = float(ordered[last - 1] - ordered[first])
            if width <= reach and (-(last - first), width) < (-best[1], best[2]):
                best = (float(ordered[first:last].mean()), last - first, width)
    return best


@settings(max_examples=60)
@given(st.lists(st.one_of(st.just(NAN), st.floats(-8.0, 8.0, width=32)), min_size=1, max_size=8), st.floats(0.25, 4.0))
def test_agreement_is_that_of_every_group(heights: list[float], reach: float) -> None:
    height, pairs = agreed(heights, reach)
    mean, most, _ = slow_agreed(np.array(heights, np.float32), np.float32(reach))
    assert pairs == most
    assert height == pytest.approx(mean, abs=1e-5, nan_ok=True)


def test_cells_are_by_themselves() -> None:
    heights = np.array([[[1.0, NAN], [3.0, 2.0]], [[1.5, NAN], [NAN, 7.0]]], np.float32)
    out, pairs = np.full((2, 2), np.nan, np.float32), np.full((2, 2), 9, np.uint8)
    _fill_agreed(heights, np.float32(1.0), out, pairs)
    expected = np.array([[2, 0], [1, 1]], np.uint8)
    assert np.array_equal(pairs, expected)
    assert np.array_equal(out, np.array([[1.25, np.nan], [3.0, 2.0]], np.float32), equal_nan=True)
