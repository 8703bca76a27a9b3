"""What stands on the ground, found in a grid of heights: houses, trees, cars, bridges.

The heights are opened with disks that grow (Zhang et al. 2003; Pingel, Clarke and McBride 2013), over a smooth ground
that is taken out first and made anew from what was found, so that slopes do not count. What an opening takes away is
an object where its rim falls: most of it goes down in a step that no slope of ground makes. Hilltops, heaps and dams
have rims that do not, and terraces on one side alone; a part of such a piece that falls on most sides, as the deck of
a bridge between its dams, is an object by itself.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.fft import dctn, idctn
from scipy.ndimage import (
    distance_transform_edt,
    gaussian_filter,
    label,
    map_coordinates,
    maximum,
    maximum_filter,
    minimum_filter,
)

from photogram.arrays import BoolArray, Float32Array, FloatArray, IntArray

WIDEST_M = 48.0
"""Objects that are wider in every direction are taken for ground."""
LEAST_M = 0.3
"""What lies less than that above the ground around is ground."""

_GROWTH = 0.1  # of the least height of an object, for a metre of the disk's radius
_STEP_SHARE, _STEPPED, _PART_STEPPED = 0.5, 0.65, 0.7
_STEEPEST = 1.2  # rise over run of ground beside which a rim is no step
_RIM_M = 1.0
_TREND_M, _SMOOTH_M = 2.0, (12.0, 6.0, 4.0)
_DISK_CELLS, _DISK_GROWTH = 6, 1.4
_ROUNDS, _PLANE_ROUNDS = 60, 20
_EIGHT = np.ones((3, 3), dtype=bool)


@dataclass(frozen=True)
class _Steps:
    """The cell's side, the least height of an object, and the least step of a rim, however high the object."""

    side_m: float
    least_m: float

    @property
    def reach(self) -> int:
        return max(1, round(_RIM_M / self.side_m))

    def needed_m(self, height_m: FloatArray) -> FloatArray:
        """Return the step that a rim needs, of objects so high."""
        most = max(self.least_m, _STEEPEST * (self.reach + 1) * self.side_m)
        return np.clip(_STEP_SHARE * height_m, 1.2 * self.least_m, most)


def on_ground(heights_m: FloatArray, side_m: float, least_m: float = LEAST_M) -> BoolArray:
    """Return which cells (rows, columns) are ground, of low heights (NaN where none is known) in cells of such a side.

    Cells without a height are no ground. The same heights give the same ground.
    """
    known = np.isfinite(heights_m)
    if not known.any():
        return known
    closed = nearest_known(heights_m, known)
    trend, ground, steps = _plane(heights_m, known), known, _Steps(side_m, least_m)
    for smooth_m in _SMOOTH_M:
        ground = known & ~_objects((closed - trend).astype(np.float32), steps)
        if not ground.any():
            return ground
        trend = _trend(heights_m, ground, side_m, smooth_m)
    return ground


def nearest_known(values: FloatArray, known: BoolArray) -> FloatArray:
    """Return a grid with its unknown values replaced by the nearest known ones."""
    row, column = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(values[row, column])


def _objects(above: Float32Array, steps: _Steps) -> BoolArray:
    """Return which cells stand on the ground, of heights over a smooth ground."""
    last = above
    lopped, objects = np.zeros(above.shape, dtype=bool), np.zeros(above.shape, dtype=bool)
    radius = 1
    while radius * steps.side_m <= WIDEST_M / 2:
        opened = _opened(last, radius)
        lopped |= last - opened > steps.least_m + _GROWTH * radius * steps.side_m
        pieces = lopped | objects
        if pieces.any():
            height = above - opened
            whole = _stepped(above, height, pieces, pieces, _STEPPED, steps)
            rest = pieces & ~whole & ~objects
            rim, falls = _rims(above, height, rest, pieces, steps)[2:]
            if falls.any():
                row, column = distance_transform_edt(~rim, return_distances=False, return_indices=True)
                whole |= _stepped(above, height, rest & falls[row, column], whole | objects, _PART_STEPPED, steps)
            objects |= whole
        last = opened
        radius = max(radius + 1, int(np.ceil(radius * _DISK_GROWTH)))
    return objects


def _rims(
    above: Float32Array, height: Float32Array, pieces: BoolArray, taken: BoolArray, steps: _Steps
) -> tuple[IntArray, int, BoolArray, BoolArray]:
    """Return the pieces' numbers (rows, columns) from 1, how many there are, their rims, and where these fall to the
    cells beside that are not ``taken``."""
    labelled, count = label(pieces, _EIGHT)
    number = np.asarray(labelled, dtype=np.int64)
    inside = maximum_filter(np.where(pieces, above, np.float32(-np.inf)), 2 * steps.reach + 1)
    beside = minimum_filter(np.where(pieces | taken, np.float32(np.inf), above), 3)
    rim = pieces & np.isfinite(beside)
    highest = np.zeros(count + 1)
    if count:
        highest[1:] = maximum(height, number, np.arange(1, count + 1))
    falls = rim.copy()
    falls[rim] = inside[rim] - beside[rim] > steps.needed_m(highest)[number[rim]]
    return number, count, rim, falls


def _stepped(
    above: Float32Array, height: Float32Array, pieces: BoolArray, taken: BoolArray, share: float, steps: _Steps
) -> BoolArray:
    """Return the pieces whose rim falls over such a share of it at least."""
    number, count, rim, falls = _rims(above, height, pieces, taken, steps)
    most, least = np.bincount(number[falls], minlength=count + 1), np.bincount(number[rim], minlength=count + 1)
    chosen = most >= share * least
    chosen[0] = False
    return np.asarray(chosen[number])


def _opened(heights: Float32Array, radius: int) -> Float32Array:
    """Return heights opened with a disk; a wide one on the lowest heights of blocks, from which nothing rises."""
    block = 1
    while radius > _DISK_CELLS * block:
        block *= 2
    rows, columns = heights.shape
    spare = ((0, -rows % block), (0, -columns % block))
    padded = np.pad(heights, spare, mode="edge")
    low = padded.reshape(padded.shape[0] // block, block, padded.shape[1] // block, block).min(axis=(1, 3))
    half = -(-radius // block)
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * half + 1, 2 * half + 1))
    opened = cv2.morphologyEx(low, cv2.MORPH_OPEN, disk, borderType=cv2.BORDER_REPLICATE)
    fine = cv2.resize(opened, padded.shape[::-1], interpolation=cv2.INTER_LINEAR)[:rows, :columns]
    return np.asarray(np.minimum(fine, heights))


def _plane(heights_m: FloatArray, known: BoolArray) -> FloatArray:
    """Return a plane (rows, columns) through the known heights, from which those above it hold little."""
    place, height = np.argwhere(known), heights_m[known]
    design = np.column_stack([np.ones(len(place)), place])
    weight = np.ones(len(place))
    for _ in range(_PLANE_ROUNDS):
        found = np.linalg.lstsq(design * weight[:, None], height * weight, rcond=None)[0]
        off = height - design @ found
        below = np.abs(off[off <= 0])
        spread = max(float(np.median(below)) if len(below) else 0.0, 0.2)
        weight = np.where(off > 0, 1.0 / np.sqrt(1.0 + (off / spread) ** 2), 1.0)
    row, column = np.indices(heights_m.shape)
    return np.asarray(found[0] + found[1] * row + found[2] * column)


def _trend(heights_m: FloatArray, ground: BoolArray, side_m: float, smooth_m: float) -> FloatArray:
    """Return a smooth ground (rows, columns): the thin plate through the ground that evens out what is shorter than
    ``smooth_m``, on cells of _TREND_M, over a plane."""
    plane = _plane(heights_m, ground)
    block = max(1, round(_TREND_M / side_m))
    spare = tuple((0, -n % block) for n in ground.shape)

    def sums(values: FloatArray) -> FloatArray:
        padded = np.pad(values, spare)
        rows, columns = (n // block for n in padded.shape)
        return np.asarray(padded.reshape(rows, block, columns, block).sum(axis=(1, 3)))

    count = sums(ground.astype(np.float64))
    mean = sums(np.where(ground, heights_m - plane, 0.0)) / np.maximum(count, 1.0)
    plate = _thin_plate(mean, count / block**2, smooth_m / (block * side_m))
    place = np.meshgrid(*((np.arange(n) + 0.5) / block - 0.5 for n in ground.shape), indexing="ij")
    return np.asarray(plane + map_coordinates(plate, np.stack(place), order=1, mode="nearest"))


def _thin_plate(values: FloatArray, weight: FloatArray, smooth_cells: float) -> FloatArray:
    """Return the penalised least squares on a grid by cosine transforms (Garcia 2010)."""
    row, column = (2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n) for n in values.shape)
    pass_share = 1.0 / (1.0 + smooth_cells**4 * (row[:, None] + column) ** 2)
    plate = gaussian_filter(nearest_known(values, weight > 0), smooth_cells / 2.0, mode="nearest")
    for _ in range(_ROUNDS):
        plate = idctn(pass_share * dctn(weight * (values - plate) + plate, norm="ortho"), norm="ortho")
    return np.asarray(plate)
