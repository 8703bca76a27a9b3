"""Digital terrain model (DTM) from a surface: houses and trees taken away by a cloth simulation, the gaps interpolated.

The surface is turned upside down and a cloth dropped on it: what it does not reach stands on the ground (Zhang et al.
2016, An Easy-to-Use Airborne LiDAR Data Filtering Method Based on Cloth Simulation). The simulation is the package
csf-3dfin, built on that of the authors.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import binary_dilation, distance_transform_edt, map_coordinates, maximum_filter
from threadpoolctl import threadpool_limits

from photogram.arrays import BoolArray, Float32Array, FloatArray
from photogram.errors import PhotogramError, SurfaceError
from photogram.settings.settings import Settings, Within
from photogram.survey import Raster

MAXIMUM_BLOCKS = 4_000_000
"""The cloth is dropped on so many blocks at most; those of a larger surface are made larger."""

_LOW_SHARE = 0.2  # of the known cells of a block, sorted, lie below its low height
_STRIP_BLOCKS = 64


@dataclass(frozen=True)
class TerrainSettings(Settings):
    """How ground is separated from the surface. Lengths are those of what stands on the ground, bushes, cars and
    houses, and do not follow the picture; nothing is looked for that is smaller than a cell of the surface."""

    enabled: Annotated[bool, "Whether a terrain model is made."] = False
    cell_m: Annotated[
        float,
        Within(0.001, 1000, "m"),
        "Side of the blocks on which the cloth is dropped, a cell at least.",
    ] = 0.5
    cloth_m: Annotated[float, Within(0.01, 1000, "m"), "Distance of the cloth's knots."] = 1.0
    rigidness: Annotated[Literal[1, 2, 3], "1 for steep, 2 for rolling, 3 for flat ground."] = 2
    reach_m: Annotated[float, Within(0.001, 1000, "m"), "A block this near to the cloth is ground."] = 0.5
    step_m: Annotated[float, Within(0.001, 1000, "m"), "A cell this near to the ground of the blocks is ground."] = 0.3
    margin_m: Annotated[
        float, Within(0.001, 1000, "m"), "Cells this near to what stands three steps high or more are not ground."
    ] = 0.5
    maximum_gap_m: Annotated[float, Within(0.001, 100_000, "m"), "What is further from any ground stays open."] = 30.0


@dataclass(frozen=True, eq=False)
class Terrain:
    """A DTM on the grid of its surface, and which of its cells (rows, columns) are interpolated: what stood there is no
    ground."""

    heights: Raster
    interpolated: BoolArray


def terrain_from_surface(surface: Raster, settings: TerrainSettings | None = None) -> Terrain:
    """Take away what does not lie on the ground.

    Cells on the ground keep the surface's height; the others take the height between the ground around them, linear in
    the triangles of the blocks' means. Cells without data stay so, and what is wider than the maximum gap is left open.
    The same surface gives the same terrain. Raises SurfaceError where there is no ground in the surface.
    """
    settings = settings or TerrainSettings()
    block = max(1, round(settings.cell_m / surface.cell_m), int(np.ceil(np.sqrt(surface.values.size / MAXIMUM_BLOCKS))))
    side_m, values = surface.cell_m * block, surface.values
    low = _blocks(values, block, _low_height)
    ground = _cloth(low, side_m, settings)
    if not ground.any():
        raise SurfaceError("terrain: no ground found in the surface: choose a larger reach_m, or remove terrain")
    rough = _between(low, ground)
    on_ground, high = np.zeros(values.shape, dtype=bool), np.zeros(values.shape, dtype=np.uint8)
    for rows in _strips(values, block):
        off = values[rows] - _refined(rough, block, rows, values.shape[1])
        on_ground[rows] = np.abs(off) <= settings.step_m
        high[rows] = off > 3 * settings.step_m
    on_ground &= maximum_filter(high, 2 * round(settings.margin_m / surface.cell_m) + 1) == 0
    mean = _blocks(np.where(on_ground, values, np.float32(np.nan)), block, _mean_height)
    # a block of few ground cells beside a wall says little of its middle
    enough = _blocks(on_ground.astype(np.float32), block, _mean_height) >= 0.5
    supported = enough if enough.any() else np.isfinite(mean)
    fill = _between(mean, supported)
    fill[distance_transform_edt(~supported) * side_m > settings.maximum_gap_m] = np.nan
    heights = np.full(values.shape, np.nan, dtype=np.float32)
    for rows in _strips(values, block):
        between = _refined(fill, block, rows, values.shape[1])
        heights[rows] = np.where(on_ground[rows], values[rows], np.where(np.isfinite(values[rows]), between, np.nan))
    terrain = Raster(heights, surface.west_map_m, surface.north_map_m, surface.cell_m)
    return Terrain(terrain, np.isfinite(heights) & ~on_ground)


def _strips(values: Float32Array, block: int) -> Iterator[slice]:
    side = _STRIP_BLOCKS * block
    return (slice(row, min(row + side, len(values))) for row in range(0, len(values), side))


def _low_height(cells: FloatArray) -> FloatArray:
    """Return of cells (..., N) a low height that single wrong cells do not lower; NaN where none is known."""
    ordered = np.sort(cells, axis=-1)  # NaN comes last
    known = np.isfinite(cells).sum(axis=-1)
    chosen = np.floor(_LOW_SHARE * np.maximum(known - 1, 0)).astype(np.int64)
    return np.asarray(np.take_along_axis(ordered, chosen[..., None], axis=-1)[..., 0])


def _mean_height(cells: FloatArray) -> FloatArray:
    known = np.isfinite(cells)
    count = known.sum(axis=-1)
    mean = np.where(known, cells, 0.0).sum(axis=-1) / np.maximum(count, 1)
    return np.asarray(np.where(count > 0, mean, np.nan))


def _blocks(values: Float32Array, block: int, rule: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return what ``rule`` makes of the cells (..., N) of each block, strip by strip."""
    columns = -(-values.shape[1] // block)
    parts = []
    for rows in _strips(values, block):
        strip = values[rows].astype(np.float64)
        count = -(-len(strip) // block)
        spare = ((0, count * block - len(strip)), (0, columns * block - strip.shape[1]))
        whole = np.pad(strip, spare, constant_values=np.nan)
        parts.append(rule(whole.reshape(count, block, columns, block).swapaxes(1, 2).reshape(count, columns, -1)))
    return np.concatenate(parts)


def _cloth(low: FloatArray, side_m: float, settings: TerrainSettings) -> BoolArray:
    """Return which blocks the cloth says are ground."""
    try:
        from CSF_3DFin import CSF
    except ImportError as error:
        raise PhotogramError(
            "terrain: the ground filter needs the package csf-3dfin, which is not installed: pip install csf-3dfin "
            "for a Python version it supports, or remove terrain"
        ) from error
    row, column = np.nonzero(np.isfinite(low))
    ground = np.zeros(low.shape, dtype=bool)
    if not len(row):
        return ground
    cloth = CSF()
    cloth.params.verbose = False
    cloth.params.smooth_slope = True
    cloth.params.cloth_resolution = max(settings.cloth_m, side_m)
    cloth.params.rigidness = settings.rigidness
    cloth.params.class_threshold = settings.reach_m
    cloth.set_point_cloud(np.column_stack([column * side_m, -row * side_m, low[row, column]]))
    with threadpool_limits(1, "openmp"):  # its loops are so short that threads wait for each other
        cloth.run_cloth_simulation()
        chosen = np.asarray(cloth.classify_ground()[0])
    ground[row[chosen], column[chosen]] = True
    return ground


def _between(values: FloatArray, known: BoolArray) -> FloatArray:
    """Return values of a grid where ``known``, elsewhere linear between those around; outside them the nearest."""
    result = values.copy()
    unknown = ~known
    if not unknown.any():
        return result
    row, column = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    result[unknown] = values[row, column][unknown]
    edge = known & binary_dilation(unknown, np.ones((3, 3), dtype=bool))
    places = np.argwhere(edge)
    if np.linalg.matrix_rank(places - places[:1]) == 2:
        with threadpool_limits(1, "blas"):  # SciPy solves a 2 × 2 system per triangle, which threads make slower by far
            linear = LinearNDInterpolator(places, values[edge])(np.argwhere(unknown))
        result[unknown] = np.where(np.isfinite(linear), linear, result[unknown])
    return result


def _refined(blocks: FloatArray, block: int, rows: slice, columns: int) -> FloatArray:
    """Return values of blocks at the centres of the cells of some rows, bilinear between the blocks' middles."""
    row = (np.arange(rows.start, rows.stop) + 0.5) / block - 0.5
    column = (np.arange(columns) + 0.5) / block - 0.5
    place = np.stack(np.meshgrid(row, column, indexing="ij"))
    return np.asarray(map_coordinates(blocks, place, order=1, mode="nearest"))
