"""Sky in oblique photographs: above the horizon, above everything that matches, smooth, and at the photograph's border.

Where the block is oriented, the elevation of every pixel's ray is known. Sky is what all of this holds for, in a
picture reduced by REDUCTION:

- it lies ABOVE_HORIZON_DEG or more above the horizon, seen from the projection centre;
- it lies ABOVE_MATCHED_DEG or more above every tie point of the photograph whose azimuth is less than NEAR_DEG away:
  what stands below the top of a mast belongs to the mast, whether it matches or not;
- it is smooth: grey values vary by less than ROUGH_DN within a reduced pixel, and by less than STEP_DN to the next;
- it belongs to an area that reaches the border of the photograph and has LEAST_SHARE of its pixels;
- it keeps RIM_PIXELS reduced pixels from whatever is not sky.

So ground that matches is never taken for sky. Clouds with hard edges and a mast that matches leave sky unmasked, which
does no harm.
"""

import cv2
import numpy as np

from photogram.arrays import BoolArray, ByteArray, FloatArray
from photogram.camera import Camera, Pose, image_plane_or_nan

REDUCTION = 8
ABOVE_HORIZON_DEG, ABOVE_MATCHED_DEG = 1.0, 1.0
NEAR_DEG = 3.0
ROUGH_DN, STEP_DN = 6.0, 6.0
LEAST_SHARE = 0.01
RIM_PIXELS = 1


def _directions_deg(
    camera: Camera, pose: Pose, up_world: FloatArray, pixel: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the azimuths, from any direction, and the elevations above the horizon (N,) of the rays of pixels (N, 2);
    NaN where the camera model shows none. ``up_world`` (3,) points up."""
    ideal = image_plane_or_nan(camera, pixel)
    ray = np.column_stack([ideal, np.ones(len(ideal))]) @ pose.rotation_world_from_camera.T
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    first = np.cross(up_world, np.eye(3)[np.argmin(np.abs(up_world))])
    first /= np.linalg.norm(first)
    second = np.cross(up_world, first)
    elevation = np.arcsin(np.clip(ray @ up_world, -1.0, 1.0))
    return np.rad2deg(np.arctan2(ray @ second, ray @ first)), np.rad2deg(elevation)


def _reduced_pixels(camera: Camera) -> tuple[FloatArray, tuple[int, int]]:
    """Return the places (N, 2) in the photograph of the pixels of the reduced picture, and its rows and columns."""
    rows, columns = camera.height_px // REDUCTION, camera.width_px // REDUCTION
    v, u = np.mgrid[:rows, :columns].reshape(2, -1)
    return REDUCTION * (np.column_stack([u, v]) + 0.5) - 0.5, (rows, columns)


def shows_above_horizon(camera: Camera, pose: Pose, up_world: FloatArray) -> bool:
    """Return whether a photograph can show sky at all; if not it need not be read."""
    place, _ = _reduced_pixels(camera)
    return bool((_directions_deg(camera, pose, up_world, place)[1] > ABOVE_HORIZON_DEG).any())


def _highest_matched_deg(azimuth: FloatArray, matched_azimuth: FloatArray, matched_elevation: FloatArray) -> FloatArray:
    """Return the elevation (N,) of the highest tie point less than NEAR_DEG from each azimuth, −90 without any."""
    bins = 720
    known = np.isfinite(matched_azimuth) & np.isfinite(matched_elevation)
    at = np.floor((matched_azimuth[known] + 180.0) / 360.0 * bins).astype(np.int64) % bins
    highest = np.full(bins, -90.0)
    np.maximum.at(highest, at, matched_elevation[known])
    reach = int(np.ceil(NEAR_DEG / 360.0 * bins)) + 1
    widened = np.max([np.roll(highest, step) for step in range(-reach, reach + 1)], axis=0)
    return np.asarray(widened[np.floor((np.nan_to_num(azimuth) + 180.0) / 360.0 * bins).astype(np.int64) % bins])


def _smooth(grey: ByteArray, shape: tuple[int, int]) -> BoolArray:
    """Return which reduced pixels (rows, columns) of a photograph (H, W) are smooth, and like the ones beside them."""
    rows, columns = shape
    blocks = grey[: rows * REDUCTION, : columns * REDUCTION].reshape(rows, REDUCTION, columns, REDUCTION)
    mean = blocks.mean(axis=(1, 3), dtype=np.float32)
    deviation = np.sqrt(np.maximum((blocks.astype(np.float32) ** 2).mean(axis=(1, 3)) - mean**2, 0.0))
    around = np.ones((3, 3), np.uint8)
    step = np.maximum(cv2.dilate(mean, around) - mean, mean - cv2.erode(mean, around))
    return np.asarray((deviation < ROUGH_DN) & (step < STEP_DN))


def find_sky(
    camera: Camera, pose: Pose, up_world: FloatArray, grey: ByteArray, matched_px: FloatArray
) -> BoolArray | None:
    """Return which pixels (H, W) of a photograph are sky, None where none is.

    ``up_world`` (3,) points up at the projection centre, ``grey`` (H, W) are the photograph's grey values,
    ``matched_px`` (M, 2) where it shows tie points that agree with the oriented block.
    """
    place, shape = _reduced_pixels(camera)
    azimuth, elevation = _directions_deg(camera, pose, up_world, place)
    high = elevation > ABOVE_HORIZON_DEG
    if not high.any():
        return None
    closed = _highest_matched_deg(azimuth, *_directions_deg(camera, pose, up_world, matched_px.reshape(-1, 2)))
    open_ = (high & (elevation > closed + ABOVE_MATCHED_DEG)).reshape(shape) & _smooth(grey, shape)
    sky = _large_at_border(open_)
    # what is not sky is widened, but for the border, beyond which the sky goes on
    sky = cv2.erode(sky.astype(np.uint8), np.ones((2 * RIM_PIXELS + 1,) * 2, np.uint8), borderValue=1)
    if not sky.any():
        return None
    whole = np.zeros((camera.height_px, camera.width_px), dtype=bool)
    large = np.repeat(np.repeat(sky.astype(bool), REDUCTION, axis=0), REDUCTION, axis=1)
    whole[: large.shape[0], : large.shape[1]] = large
    # the last rows and columns, fewer than REDUCTION, are as those before them
    whole[large.shape[0] :] = whole[large.shape[0] - 1]
    whole[:, large.shape[1] :] = whole[:, large.shape[1] - 1 : large.shape[1]]
    return whole


def _large_at_border(area: BoolArray) -> BoolArray:
    """Return the connected parts of an area (rows, columns) that are large enough and reach its border."""
    _, label = cv2.connectedComponents(area.astype(np.uint8), connectivity=4)
    label = np.asarray(label)
    border = np.zeros(int(label.max()) + 1, dtype=bool)
    for side in (label[0], label[-1], label[:, 0], label[:, -1]):
        border[side] = True
    kept = border & (np.bincount(label.ravel(), minlength=len(border)) >= LEAST_SHARE * label.size)
    kept[0] = False
    return np.asarray(kept[label])
