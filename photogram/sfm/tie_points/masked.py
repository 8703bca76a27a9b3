"""Which places of a photograph lie clear of what its mask leaves out."""

import cv2
import numpy as np

from photogram.arrays import BoolArray, Float32Array, FloatArray


def clear_px(used: BoolArray) -> Float32Array:
    """Return how many pixels (H, W) away the nearest pixel is that a mask leaves out, along rows, columns and diagonals
    as the king moves; 0 for those themselves. ``used`` (H, W) are the pixels that it leaves."""
    return np.asarray(cv2.distanceTransform(used.view(np.uint8), cv2.DIST_C, 3), dtype=np.float32)


def are_clear(clear: Float32Array, pixel: FloatArray, reach_px: FloatArray | float) -> BoolArray:
    """Return which places (N, 2) of a photograph lie farther than ``reach_px`` (N,), or of all, from what its mask
    leaves out; ``clear`` (H, W) is of ``clear_px``."""
    height, width = clear.shape
    column = np.clip(np.rint(pixel[:, 0]).astype(np.int64), 0, width - 1)
    row = np.clip(np.rint(pixel[:, 1]).astype(np.int64), 0, height - 1)
    return np.asarray(clear[row, column] > reach_px)
