"""Points as few bytes: whole steps within blocks of space, as a page in a browser reads them."""

import base64
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, Float32Array, FloatArray, IntArray

STEPS = 2**16
"""Steps along each side of a block: what 16 bits count."""
UNKNOWN = STEPS - 1
"""Stands for a figure that is not known."""
MAXIMUM_BLOCKS = 64

_FINEST_STEP_M = 0.001
_SEED = 6


@dataclass(frozen=True, eq=False)
class PackedPositions:
    """Positions as whole steps: ``origin_map_m`` + ``step_m`` · (65536 · block + step).

    ``step`` (N, 3) uint16 is sorted by blocks; ``order`` (N,) says which point each row was. ``blocks`` (B, 5) names
    the block along easting, northing and height, the row it begins at, and how many it has.
    """

    origin_map_m: FloatArray
    step_m: float
    step: NDArray[np.uint16]
    order: IntArray
    blocks: IntArray

    def position_map_m(self) -> FloatArray:
        """Return the positions (N, 3) that are meant, in the order of the rows."""
        block = np.repeat(self.blocks[:, :3], self.blocks[:, 4], axis=0)
        return self.origin_map_m + (block * STEPS + self.step.astype(np.float64)) * self.step_m


def pack_positions(position_map_m: FloatArray) -> PackedPositions:
    """Pack positions (N, 3), N at least 1: off by half a step at most along each axis.

    A step is a millimetre, as in LAZ files, or that times a power of ten where the cloud is so wide that it would fall
    into more than 64 blocks along an axis. Within a block the points stand in a random order, always the same, so that
    the first of them show it all.
    """
    origin = np.floor(position_map_m.min(axis=0))
    extent, step_m = float((position_map_m - origin).max()), _FINEST_STEP_M
    while extent / step_m >= STEPS * MAXIMUM_BLOCKS - 1:
        step_m *= 10
    steps = np.rint((position_map_m - origin) / step_m).astype(np.int64)
    block = steps // STEPS
    shuffled = np.random.default_rng(_SEED).permutation(len(steps))
    number = (block[:, 0] * MAXIMUM_BLOCKS + block[:, 1]) * MAXIMUM_BLOCKS + block[:, 2]
    order = shuffled[np.argsort(number[shuffled], kind="stable")]
    _, first, count = np.unique(number[order], return_index=True, return_counts=True)
    blocks = np.column_stack([block[order[first]], first, count])
    return PackedPositions(origin, step_m, (steps[order] % STEPS).astype(np.uint16), order, blocks)


def pack_figures(values: FloatArray | None, count: int) -> tuple[NDArray[np.uint16], float]:
    """Return figures (N,) from zero up as whole steps uint16 and the step; what is not finite, or None, is UNKNOWN."""
    if values is None or not np.isfinite(values).any():
        return np.full(count, UNKNOWN, dtype=np.uint16), 1.0
    known = np.isfinite(values)
    step = max(float(values[known].max()) / (UNKNOWN - 1), 1e-9)
    packed = np.full(len(values), UNKNOWN, dtype=np.uint16)
    packed[known] = np.rint(np.maximum(values[known], 0.0) / step).astype(np.uint16)
    return packed, step


def as_text(values: NDArray[np.uint16] | ByteArray) -> str:
    """Return the bytes of an array, the lowest of each number first, in base64."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()).decode()


def pack_heights(values_m: Float32Array) -> tuple[NDArray[np.uint16], float, float]:
    """Return heights as whole steps uint16 above the first of them, that first one and the step; what is not finite is
    UNKNOWN.

    The step is a millimetre, or of 2, 5, 10, 20 … the least in which they fit. Raises ValueError where no height is
    known.
    """
    known = np.isfinite(values_m)
    heights = values_m[known].astype(np.float64)
    if not len(heights):
        raise ValueError("no height is known")
    low_m = float(np.floor(heights.min()))
    series = (_FINEST_STEP_M * digit * 10.0**power for power in range(9) for digit in (1, 2, 5))
    step_m = next(step for step in series if (heights.max() - low_m) / step < UNKNOWN - 1)
    packed = np.full(values_m.shape, UNKNOWN, dtype=np.uint16)
    packed[known] = np.rint((heights - low_m) / step_m).astype(np.uint16)
    return packed, low_m, step_m
