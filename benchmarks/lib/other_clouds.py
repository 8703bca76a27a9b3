"""Heights beside another program's cloud. It is photogrammetric itself: agreement with it is not accuracy."""

import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import FloatArray

NEIGHBOURS, REACH_M = 8, 0.3  # points of the other cloud that make a height, and how near they must be


def height_differences_m(own_m: FloatArray, other_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the points (N, 3) of a cloud that have a median height of the nearest points of another one, near in plan,
    and their heights (N,) over it."""
    distance, index = cKDTree(other_m[:, :2]).query(own_m[:, :2], k=NEIGHBOURS)
    near = np.asarray(distance)[:, -1] < REACH_M
    difference = own_m[:, 2] - np.median(other_m[index][..., 2], axis=1)
    return own_m[near], np.asarray(difference[near])
