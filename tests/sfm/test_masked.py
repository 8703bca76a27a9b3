"""Nothing is found in masked pixels, nor so near to them that they have a part in it; the rest is as without a mask."""

import numpy as np
import pytest

from photogram.camera import Camera, Pose
from photogram.errors import ImageError
from photogram.sfm.tie_points.detector import FeatureSettings
from photogram.sfm.tie_points.features import find_features
from photogram.sfm.tie_points.guided_matching import TransferSettings, cut_patches, transfer_to
from photogram.sfm.tie_points.masked import are_clear, clear_px
from photogram.survey import TiePoints

RNG = np.random.default_rng(5)


def texture(height: int, width: int) -> np.ndarray:
    """A picture (H, W, 3) with detail of several sizes."""
    total = np.zeros((height, width))
    for side in (2, 4, 8, 16):
        coarse = RNG.normal(size=(-(-height // side), -(-width // side)))
        total += np.kron(coarse, np.ones((side, side)))[:height, :width] * np.sqrt(side)
    grey = np.clip(128 + 18 * total, 0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


PICTURE = texture(300, 420)
USED = np.ones((300, 420), dtype=bool)
USED[200:, 250:] = False


def test_distances_are_the_king_s() -> None:
    used = np.ones((5, 7), dtype=bool)
    used[2, 3] = False
    row, column = np.mgrid[:5, :7]
    assert np.array_equal(clear_px(used), np.maximum(abs(row - 2), abs(column - 3)))
    pixel = np.array([[3.0, 2.0], [4.4, 2.0], [4.6, 2.0], [-3.0, 9.0]])
    assert are_clear(clear_px(used), pixel, 1.0).tolist() == [False, False, True, True]
    assert are_clear(clear_px(used), pixel, np.array([0.0, 0.5, 2.0, 2.5])).tolist() == [False, True, False, True]


@pytest.mark.parametrize("reduction", [1, 2])
def test_key_points_keep_clear_of_a_mask_and_the_others_stay(reduction: int) -> None:
    settings = FeatureSettings(maximum=100_000)
    free, masked = (find_features("a.jpg", PICTURE, settings, reduction, used) for used in (None, USED))
    row, column = np.rint(masked.pixel[:, 1]).astype(int), np.rint(masked.pixel[:, 0]).astype(int)
    assert USED[row, column].all()
    kept = are_clear(clear_px(USED), free.pixel, free.size_px)
    assert 0.5 < kept.mean() < 0.95
    assert np.array_equal(free.pixel[kept], masked.pixel)
    assert np.array_equal(free.descriptor[kept], masked.descriptor)


def test_places_in_the_count_of_key_points_go_to_what_is_used() -> None:
    settings = FeatureSettings(maximum=200)
    masked = find_features("a.jpg", PICTURE, settings, 1, USED)
    assert len(masked) == 200
    everywhere = find_features("a.jpg", PICTURE, settings, 1, np.ones_like(USED))
    assert np.array_equal(everywhere.pixel, find_features("a.jpg", PICTURE, settings).pixel)


def test_a_photograph_that_is_masked_nearly_whole_is_no_error() -> None:
    used = np.zeros_like(USED)
    used[0, 0] = True
    assert len(find_features("a.jpg", PICTURE, FeatureSettings(), 1, used)) == 0
    with pytest.raises(ImageError, match="only 0 key points"):
        find_features("a.jpg", np.zeros_like(PICTURE), FeatureSettings())


def test_tie_points_are_transferred_neither_from_masked_pixels_nor_to_them() -> None:
    camera = Camera("c", 420, 300, 400.0, np.array([209.5, 149.5]))
    down = np.diag([1.0, -1.0, -1.0])
    poses = [Pose(down, np.array([0.0, 0.0, 40.0])), Pose(down, np.array([2.0, 0.0, 40.0]))]
    shift = 20  # pixels: 2 m at 10 pixels a metre
    second = np.roll(PICTURE, -shift, axis=1)[..., 0]
    u, v = np.meshgrid(np.arange(60, 400, 12.0), np.arange(30, 280, 12.0))
    pixel = np.column_stack([u.ravel(), v.ravel()])
    count = len(pixel)
    world = np.column_stack([(pixel[:, 0] - 209.5) / 10, -(pixel[:, 1] - 149.5) / 10, np.zeros(count)])
    seen_twice = np.zeros(count, dtype=bool)
    seen_twice[0] = True  # the second photograph must show one of them
    photograph = np.concatenate([np.zeros(count, np.int64), np.ones(1, np.int64)])
    point = np.concatenate([np.arange(count), [0]])
    order = np.lexsort((photograph, point))
    places = np.concatenate([pixel, pixel[:1] - [shift, 0]])
    tie = TiePoints(
        photograph[order], point[order], np.zeros(count + 1, np.int64)[order], places[order],
        np.ones(count + 1)[order], world, np.zeros((count, 3), np.uint8),
    )  # fmt: skip
    centres = np.array([pose.position_world_m for pose in poses])
    settings = TransferSettings()

    def found(source: np.ndarray | None, target: np.ndarray | None) -> set[int]:
        patches = cut_patches(tie, centres, lambda _: PICTURE[..., 0].copy(), lambda _: source)
        return set(transfer_to(1, tie, patches, [camera] * 2, poses, second, settings, target).point.tolist())

    free = found(None, None)
    assert len(free) > 300
    from_clear = {p for p in free if are_clear(clear_px(USED), pixel[p][None], 16.0)[0]}
    to_clear = {p for p in free if are_clear(clear_px(USED), pixel[p][None] - [shift, 0], 7.0)[0]}
    assert found(USED, None) == from_clear < free
    assert found(None, USED) == to_clear < free
    assert found(USED, USED) == from_clear & to_clear
