"""The matching core on a rectified pair whose disparities are known: Middlebury's cones (Scharstein & Szeliski 2003).

A rectified pair is a pair of cameras at a height of 10⁹ m that look straight down with a focal length of 10⁹ px: a cell
is a pixel of the left picture, and a height of d m is a disparity of d px, to 3e-5 px. The right camera stands 10⁹ m to
the east, its principal point as far to the right. What follows is the code that matches photographs of the ground.
"""

import warnings
from collections.abc import Callable

import numpy as np
import pytest
import rasterio
from makers import SharedData
from patch_windows import same_windows
from scipy.ndimage import distance_transform_edt

from photogram.arrays import BoolArray, Float32Array
from photogram.camera import Camera, oriented_cameras
from photogram.surface.dense.correlation import NEUTRAL, Hypotheses, fill_costs
from photogram.surface.dense.lattice import NOTHING_HIDDEN, Crops, GroundCells
from photogram.surface.dense.pyramid import median_of_known
from photogram.surface.dense.refinement import InitialHeights, Refined, own_side_mean, refine_heights
from photogram.surface.dense.semi_global import CostVolume, regularised
from photogram.surface.dense.tile_matching import DenseSettings

Read = Callable[[str], Float32Array]

HEIGHT_M = 1e9
LARGEST_PX, STEP_PX = 60, 1.0
RIM_PX = 8
"""The pictures are continued by what they have at their edges, so that windows at the edge can be sampled."""

PATCH = 16


@pytest.fixture(scope="module")
def read(shared_data: SharedData) -> Read:
    """Read one of the pair's pictures."""
    folder = shared_data("stereo_cones")

    def picture(name: str) -> Float32Array:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(folder / name) as file:
                return np.asarray(file.read(1), np.float32)

    return picture


def pair(left: Float32Array, right: Float32Array) -> tuple[Crops, GroundCells]:
    """Return a rectified pair as photographs of the ground."""
    rows, columns = left.shape
    pictures = [np.pad(picture, RIM_PX, mode="edge") for picture in (left, right)]
    height, width = pictures[0].shape
    cameras = oriented_cameras(
        [Camera("c", width, height, HEIGHT_M, np.array([cx, 0.0])) for cx in (0.0, HEIGHT_M)],
        np.arange(2), np.tile(np.diag([1.0, -1.0, -1.0]), (2, 1, 1)),
        np.array([[0.0, 0.0, HEIGHT_M], [HEIGHT_M, 0.0, HEIGHT_M]]),
    )  # fmt: skip
    crops = Crops(
        cameras, np.array([0, height * width]), np.full(2, -RIM_PX), np.full(2, -RIM_PX), np.full(2, width),
        np.full(2, height), np.concatenate([picture.ravel() for picture in pictures]), 1.0,
    )  # fmt: skip
    row, column = np.mgrid[:rows, :columns].astype(np.float64)
    foot, up = np.stack([column, -row, np.zeros_like(row)], axis=-1), np.zeros((rows, columns, 3))
    up[..., 2] = 1.0
    views = np.broadcast_to(np.arange(2), (-(-rows // PATCH), -(-columns // PATCH), 2)).copy()
    return crops, GroundCells(foot, up, np.array([1.0, 0, 0]), np.array([0, -1.0, 0]), 1, views, PATCH, NOTHING_HIDDEN)


@pytest.fixture(scope="module")
def disparity(read: Read) -> Float32Array:
    """Disparities (rows, columns) in px, NaN where the core finds none; all settings are those of a survey."""
    left, settings = read("Cones_LEFT.tif"), DenseSettings()
    crops, ground = pair(left, read("Cones_RIGHT.tif"))
    count, cells = round(LARGEST_PX / STEP_PX) + 1, left.size
    start, first = np.arange(cells + 1, dtype=np.int64) * count, np.zeros(cells, np.int32)
    cost, level = np.empty(start[-1], np.uint8), np.zeros((*left.shape, 2), np.float32)
    tried = Hypotheses(
        np.zeros(left.shape, np.float32), STEP_PX, first.reshape(left.shape), np.full(left.shape, count),
        start[:-1].reshape(left.shape),
    )  # fmt: skip
    fill_costs(crops, ground, same_windows(ground, 2, settings.noise_dn, 0.5), tried, cost)
    unit = NEUTRAL / 100.0
    volume = CostVolume(cost, start, first, left)
    best, _ = regularised(volume, settings.small_step * unit, settings.large_step * unit, settings.contrast_dn)
    z = (median_of_known(best) * np.float32(STEP_PX)).astype(np.float32)
    found, sigma, correlation = (np.empty(z.shape, np.float32) for _ in range(3))
    rays = np.empty(z.shape, np.uint8)
    smooth = np.empty_like(z)
    own_side_mean(z, level, STEP_PX, 2, smooth)
    from_here = InitialHeights(z, smooth, level, 0.3 * STEP_PX, STEP_PX, 1.0, 0.58 * STEP_PX)
    windows = same_windows(ground, 3, settings.noise_dn, 0.5)
    refine_heights(crops, ground, windows, from_here, Refined(found, sigma, correlation, rays))
    return found


def wrong(read: Read, disparity: Float32Array, limit_px: float) -> BoolArray:
    """Return which pixels are off by more than a limit or have no disparity."""
    return np.asarray(~(np.abs(disparity - read("Cones_LEFT_GT.tif")) <= limit_px))


def visible(read: Read) -> BoolArray:
    """Return which pixels both pictures show, as the data say, and whose disparity is known."""
    return np.asarray((read("mask_from_occlusion_left.tif") == 0) & (read("Cones_LEFT_GT.tif") > 0))


def test_disparities_are_right(read: Read, disparity: Float32Array) -> None:
    seen = visible(read)
    assert seen.sum() > 0.8 * seen.size
    assert wrong(read, disparity, 1.0)[seen].mean() < 0.12
    assert wrong(read, disparity, 2.0)[seen].mean() < 0.06
    assert np.median(np.abs(disparity - read("Cones_LEFT_GT.tif"))[seen & np.isfinite(disparity)]) < 0.25


def test_what_is_wrong_lies_at_the_edges_of_things(read: Read, disparity: Float32Array) -> None:
    """Three fifths of the pixels are 8 px and more away from a jump of the true disparity."""
    truth, seen = read("Cones_LEFT_GT.tif").astype(np.float64), visible(read)
    jump = np.abs(np.diff(truth, axis=1, prepend=truth[:, :1])) > 2.0
    jump |= np.abs(np.diff(truth, axis=0, prepend=truth[:1])) > 2.0
    away = distance_transform_edt(~jump) >= 8.0
    off = wrong(read, disparity, 1.0) & seen
    assert (seen & away).sum() > 0.5 * seen.sum()
    assert (off & away).sum() < 0.2 * off.sum()
    assert off[seen & away].mean() < 0.03
