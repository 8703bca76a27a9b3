"""Ground filters from the literature, on grids of heights: what photogram's own is compared with.

Each takes heights (rows, columns; NaN where none is known) and the side of a cell and returns which cells are ground,
with the parameters that its authors give for all sites.
"""

from collections.abc import Callable

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates

from photogram.arrays import BoolArray, Float32Array, FloatArray

Filter = Callable[[FloatArray, float], BoolArray]


def _closed(heights: FloatArray) -> FloatArray:
    row, column = distance_transform_edt(~np.isfinite(heights), return_distances=False, return_indices=True)
    return np.asarray(heights[row, column])


def _opened(heights: Float32Array, radius: int) -> Float32Array:
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return np.asarray(cv2.morphologyEx(heights, cv2.MORPH_OPEN, disk, borderType=cv2.BORDER_REPLICATE))


def _lowest(heights: FloatArray, block: int) -> FloatArray:
    """Return the least height of blocks of cells; NaN where none is known."""
    rows, columns = (-(-n // block) for n in heights.shape)
    spare = ((0, rows * block - heights.shape[0]), (0, columns * block - heights.shape[1]))
    padded = np.pad(np.where(np.isfinite(heights), heights, np.inf), spare, constant_values=np.inf)
    least = padded.reshape(rows, block, columns, block).min(axis=(1, 3))
    return np.asarray(np.where(np.isfinite(least), least, np.nan))


def _low(heights: FloatArray, block: int) -> FloatArray:
    """Return the height below which a fifth of the known cells of each block lie; NaN where none is known."""
    rows, columns = (-(-n // block) for n in heights.shape)
    spare = ((0, rows * block - heights.shape[0]), (0, columns * block - heights.shape[1]))
    padded = np.pad(heights, spare, constant_values=np.nan).reshape(rows, block, columns, block)
    ordered = np.sort(padded.swapaxes(1, 2).reshape(rows, columns, -1), axis=-1)
    chosen = (0.2 * np.maximum(np.isfinite(ordered).sum(axis=-1) - 1, 0)).astype(int)
    return np.asarray(np.take_along_axis(ordered, chosen[..., None], axis=-1)[..., 0])


def _at_cells(blocks: FloatArray, block: int, shape: tuple[int, ...]) -> FloatArray:
    place = np.stack(np.meshgrid(*((np.arange(n) + 0.5) / block - 0.5 for n in shape), indexing="ij"))
    return np.asarray(map_coordinates(blocks, place, order=1, mode="nearest"))


def smrf(
    heights: FloatArray,
    cell_m: float,
    window_m: float = 22.0,
    slope: float = 0.15,
    threshold_m: float = 0.5,
    scaling_m: float = 1.25,
) -> BoolArray:
    """Simple morphological filter of Pingel, Clarke and McBride (2013), on the lowest heights of cells of a metre, with
    their optimised parameters for all samples but the window, which they give by the largest building."""
    block = max(1, round(1.0 / cell_m))
    side_m = cell_m * block
    lowest = _lowest(heights, block)
    known = np.isfinite(lowest)
    surface = _closed(lowest).astype(np.float32)
    last = surface
    lowest_outlier = -surface - _opened(-surface, 1) > 5.0 * side_m
    objects = lowest_outlier.copy()
    for radius in range(1, int(np.ceil(window_m / side_m)) + 1):
        opened = _opened(last, radius)
        objects |= last - opened > slope * radius * side_m
        last = opened
    terrain = _between(np.where(known & ~objects, lowest, np.nan))
    steep = np.hypot(*np.gradient(terrain, side_m))
    height, steep = _at_cells(terrain, block, heights.shape), _at_cells(steep, block, heights.shape)
    return np.asarray(np.abs(heights - height) <= threshold_m + scaling_m * steep)


def _between(values: FloatArray) -> FloatArray:
    """Return a grid with its unknown values as springs between the known ones have them."""
    unknown = ~np.isfinite(values)
    result = _closed(values)
    for halving in range(5, -1, -1):
        step = 2**halving
        for _ in range(40):
            near = [
                np.roll(np.pad(result, step, mode="edge"), s, a)[step:-step, step:-step]
                for a in (0, 1)
                for s in (step, -step)
            ]
            result = np.where(unknown, np.mean(near, axis=0), result)
    return np.asarray(result)


def progressive_morphology(
    heights: FloatArray,
    cell_m: float,
    slope: float = 0.3,
    least_m: float = 0.3,
    most_m: float = 2.5,
    window_m: float = 42.0,
) -> BoolArray:
    """Progressive morphological filter of Zhang et al. (2003): windows that double, and thresholds that grow with the
    difference of the windows and the slope, up to the least height of a building."""
    block = max(1, round(1.0 / cell_m))
    side_m = cell_m * block
    lowest = _lowest(heights, block)
    last = _closed(lowest).astype(np.float32)
    ground = np.isfinite(heights)
    before, half = 0, 1
    while (2 * half + 1) * side_m <= window_m + 2 * side_m:
        opened = _opened(last, half)
        threshold = min(least_m + slope * 2 * (half - before) * side_m * (before > 0), most_m)
        ground &= heights - _at_cells(opened.astype(np.float64), block, heights.shape) <= threshold + slope * side_m
        last, before, half = opened, half, half * 2
    return np.asarray(ground)


def cloth(
    heights: FloatArray,
    cell_m: float,
    cloth_m: float = 1.0,
    rigidness: int = 2,
    reach_m: float = 0.5,
    step_m: float = 0.3,
) -> BoolArray:
    """Cloth simulation of Zhang et al. (2016) on blocks of half a metre, by the package csf-3dfin, which has wheels for
    Python up to 3.13. Raises ImportError without it."""
    from CSF_3DFin import CSF

    block = max(1, round(0.5 / cell_m))
    side_m = cell_m * block
    lowest = _low(heights, block)
    row, column = np.nonzero(np.isfinite(lowest))
    simulation = CSF()
    simulation.params.verbose = False
    simulation.params.smooth_slope = True
    simulation.params.cloth_resolution = max(cloth_m, side_m)
    simulation.params.rigidness = rigidness
    simulation.params.class_threshold = reach_m
    simulation.set_point_cloud(np.column_stack([column * side_m, -row * side_m, lowest[row, column]]))
    simulation.run_cloth_simulation()
    chosen = np.asarray(simulation.classify_ground()[0])
    ground = np.full(lowest.shape, np.nan)
    ground[row[chosen], column[chosen]] = lowest[row[chosen], column[chosen]]
    return np.asarray(np.abs(heights - _at_cells(_between(ground), block, heights.shape)) <= step_m)
