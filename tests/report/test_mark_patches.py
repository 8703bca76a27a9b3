"""Patches of photographs around ground points: that signs stand where marks are, and that a page's picture is one."""

import base64
import io
from typing import Any

import numpy as np
import pytest
from PIL import Image

from photogram.arrays import ByteArray, FloatArray
from photogram.report.figures.mark_patches import (
    ACROSS,
    GAP_PX,
    MOST_PATCHES,
    SIDE_PX,
    MarkPatch,
    PhotographPatch,
    figure_key,
    mark_figure,
    mark_sheet,
    reduced,
    shown_marks,
)

LEFT, UPPER, SIDE = 400, 300, 61


def patch(**more: Any) -> MarkPatch:
    """A black patch of 61 × 61 px with the mark in its middle."""
    given: dict[str, Any] = {"mark_px": (LEFT + 30.0, UPPER + 30.0), "sign": "marked", "words": "raw"}
    of_photograph = {name: more.pop(name) for name in ("reduction", "half_px") if name in more}
    pixels = more.pop("pixels", np.zeros((SIDE, SIDE, 3), np.uint8))
    return MarkPatch("1.jpg", PhotographPatch(pixels, LEFT, UPPER, **of_photograph), **{**given, **more})


def centre(picture: ByteArray, colour: tuple[int, int, int]) -> FloatArray:
    """Return column and row (2,) of the middle of what has a colour."""
    rows, columns = np.nonzero(np.abs(picture.astype(int) - colour).max(axis=2) < 25)
    assert len(rows) > 10, colour
    return np.array([(columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2])


YELLOW, RED, BLUE, WHITE = (0xFF, 0xE1, 0x4D), (0xD5, 0x5E, 0x00), (0x56, 0xB4, 0xE9), (250, 0, 250)


@pytest.mark.parametrize("at", [(30, 30), (22, 37)])
def test_the_cross_stands_on_the_pixel_that_was_marked(at: tuple[int, int]) -> None:
    pixels = np.zeros((SIDE, SIDE, 3), np.uint8)
    pixels[at[1], at[0]] = WHITE
    picture = mark_sheet("", [patch(pixels=pixels, mark_px=(LEFT + at[0], UPPER + at[1]))])
    np.testing.assert_allclose(centre(picture, YELLOW), centre(picture, WHITE), atol=1.5)


def test_the_ring_stands_where_the_adjustment_puts_the_point() -> None:
    """4 px to the right of the mark and 7 px below, by the scale of the patch."""
    picture = mark_sheet("", [patch(adjusted_px=(LEFT + 34.0, UPPER + 37.0))])
    off = centre(picture, BLUE) - centre(picture, YELLOW)
    np.testing.assert_allclose(off / (SIDE_PX / SIDE), (4.0, 7.0), atol=0.3)


def test_a_rejected_mark_has_another_colour_and_shape() -> None:
    kept, rejected = (mark_sheet("", [patch(sign=sign)]) for sign in ("marked", "rejected"))
    centre(rejected, RED)
    with pytest.raises(AssertionError):
        centre(rejected, YELLOW)
    with pytest.raises(AssertionError):
        centre(kept, RED)


def test_a_reduced_patch_keeps_its_place() -> None:
    """A white square of 4 × 4 px around the mark is in the middle of the cross, reduced or not."""
    pixels = np.zeros((120, 120, 3), np.uint8)
    pixels[60:64, 40:44] = WHITE
    whole = patch(pixels=pixels, mark_px=(LEFT + 41.5, UPPER + 61.5), half_px=50.0)
    small = patch(pixels=reduced(pixels, 4), mark_px=(LEFT + 41.5, UPPER + 61.5), half_px=50.0, reduction=4)
    for one in (whole, small):
        picture = mark_sheet("", [one])
        np.testing.assert_allclose(centre(picture, YELLOW), centre(picture, WHITE), atol=2.0)


def test_reduced_pixels_are_means() -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (7, 9, 3)).astype(np.uint8)
    small = reduced(pixels, 2)
    assert small.shape == (3, 4, 3)
    assert np.abs(small[1, 2] - pixels[2:4, 4:6].astype(float).mean(axis=(0, 1))).max() <= 0.5
    np.testing.assert_array_equal(reduced(pixels, 1), pixels)


def test_patches_stand_in_rows_of_one_scale() -> None:
    sheets = [mark_sheet("", [patch()] * count) for count in (1, ACROSS, ACROSS + 1)]
    for sheet, count, columns in zip(sheets, (1, 1, 2), (1, ACROSS, ACROSS), strict=True):
        black = (sheet == 0).all(axis=2)
        squares = [np.flatnonzero(np.diff(np.r_[0, black.sum(axis=axis) > SIDE_PX / 2, 0])) for axis in (0, 1)]
        sides = [np.diff(edges.reshape(-1, 2)) for edges in squares]
        assert [len(of) for of in sides] == [columns, count]
        assert all(np.abs(side - SIDE_PX).max() <= 2 for side in sides)
    assert len(sheets[0]) == len(sheets[1]) < len(sheets[2])


def test_a_title_stands_above_and_words_below() -> None:
    plain, titled = mark_sheet("", [patch()]), mark_sheet("G01: proposed", [patch()])
    more = len(titled) - len(plain)
    assert more > 0
    np.testing.assert_array_equal(titled[more + GAP_PX :], plain[GAP_PX:])
    assert (titled[: more + GAP_PX] < 128).any()
    below = plain[GAP_PX + SIDE_PX :] < 128
    assert below.any()
    assert not mark_sheet("", [patch(words="")])[GAP_PX + SIDE_PX + 30 :].min() < 128 <= below.sum()


# ---- on the page ---------------------------------------------------------------------------------------------------


def mark(n: int, residual_px: float, left_out: bool = False) -> dict[str, Any]:
    return {
        "photograph": f"{n}.jpg", "pixel": [50.0, 40.0], "residual_px": [residual_px, 0.0], "left_out": left_out,
        "w": [1.5, -2.5], "kind": "circle", "sigma_px": 0.25,
    }  # fmt: skip


def surroundings() -> PhotographPatch:
    return PhotographPatch(np.full((65, 65, 3), 90, np.uint8), 18.0, 8.0, 1, 32.0)


def test_the_picture_of_a_point_has_a_patch_of_each_photograph_that_gave_one() -> None:
    point: Any = {"name": "G 1", "marks": [mark(1, 0.2), mark(2, 0.9), mark(3, 0.1, left_out=True)]}
    figure = mark_figure(point, {f"{n}.jpg": surroundings() for n in (1, 3)})
    assert figure is not None
    assert figure.key == figure_key("G 1")
    assert figure.caption == "G 1: 2 of 3 marks, those first that fit worst."
    head, _, body = figure.uri.partition(",")
    assert head == "data:image/jpeg;base64"
    with Image.open(io.BytesIO(base64.b64decode(body, validate=True))) as picture:
        assert 700 < picture.width < 1400
        assert np.asarray(picture).std() > 5.0
    assert mark_figure(point, {f"{n}.jpg": surroundings() for n in (1, 3)}) == figure, "always the same"
    assert mark_figure(point, {}) is None


def test_of_many_marks_those_that_fit_worst_are_shown() -> None:
    many: Any = {"name": "G1", "marks": [mark(n, 0.01 * n) for n in range(MOST_PATCHES + 5)]}
    shown = shown_marks(many)
    assert len(shown) == MOST_PATCHES
    assert [m["photograph"] for m in shown[:2]] == [f"{MOST_PATCHES + 4}.jpg", f"{MOST_PATCHES + 3}.jpg"]
