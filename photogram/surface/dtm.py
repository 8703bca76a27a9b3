"""Digital terrain model (DTM) from a surface: houses and trees taken away, the gaps interpolated, with sigma.

`ground_filter` finds in blocks of cells what stands on the ground; between the blocks on the ground the terrain is
linear.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter, map_coordinates, maximum_filter
from threadpoolctl import threadpool_limits

from photogram.arrays import BoolArray, Float32Array, FloatArray
from photogram.errors import SurfaceError
from photogram.settings.settings import Settings, Within
from photogram.surface.ground_filter import LEAST_M, nearest_known, on_ground
from photogram.surface.terrain_sigma import interpolated_sigma
from photogram.survey import Raster

MAXIMUM_BLOCKS = 4_000_000
"""Ground is looked for in so many blocks at most; those of a larger surface are made larger."""

_NO_GROUND = "terrain: no ground found in the surface: set terrain.enabled to false, or look at dsm.tif"
_BLOCK_M = 0.5
_LOW_SHARE = 0.2  # of the known cells of a block, sorted, lie below its low height
_MARGIN_M = 0.5  # around what is high, whose edges a surface smears
_EDGE_M = 0.25
_FAR_M = 2.0
_LEAST_SIGMAS = 3.0
_HIGH = 3.0  # least heights of an object
_SUPPORT = 0.25  # of a block's cells lie on the ground where its mean carries the terrain
_STRIP_BLOCKS = 64


@dataclass(frozen=True)
class TerrainSettings(Settings):
    """How ground is separated from the surface. Lengths are those of what stands on the ground, bushes, cars and
    houses, and do not follow the picture; nothing is looked for that is smaller than a cell of the surface."""

    gone: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("cell_m", "cloth_m", "rigidness", "reach_m", "step_m", "margin_m"),
        "belonged to the cloth simulation, which a filter without settings has replaced: remove this line",
    )

    enabled: Annotated[bool, "Whether a terrain model is made."] = False
    maximum_gap_m: Annotated[float, Within(0.001, 100_000, "m"), "What is further from any ground stays open."] = 30.0


@dataclass(frozen=True, eq=False)
class Terrain:
    """A DTM on the grid of its surface, its standard deviations, and which of its cells (rows, columns) are
    interpolated: what stood there is no ground."""

    heights: Raster
    sigma: Raster
    interpolated: BoolArray


def terrain_from_surface(surface: Raster, sigma: Raster, settings: TerrainSettings | None = None) -> Terrain:
    """Take away what does not lie on the ground.

    ``surface`` may have its holes closed: where it has no ``sigma`` it was not measured, and is not looked at. Measured
    cells on the ground keep the surface's height and sigma; the others take the height between the ground around them,
    linear in the triangles of the blocks' means, and a sigma by their distance from it. Cells without data stay so,
    and what is wider than the maximum gap is left open. The same surface gives the same terrain. Raises SurfaceError
    where there is no ground in the surface.
    """
    settings = settings or TerrainSettings()
    block = max(1, round(_BLOCK_M / surface.cell_m), int(np.ceil(np.sqrt(surface.values.size / MAXIMUM_BLOCKS))))
    side_m = surface.cell_m * block
    known = np.isfinite(sigma.values)
    least_m = max(LEAST_M, _LEAST_SIGMAS * float(np.median(sigma.values[known]))) if known.any() else LEAST_M
    values = np.where(known, surface.values, np.float32(np.nan))
    low = _blocks(values, block, _low_height)
    ground = on_ground(low, side_m, least_m)
    if not ground.any():
        raise SurfaceError(_NO_GROUND)
    rough = linear_between(low, ground)
    rise = (
        0.5 * side_m * np.hypot(*(np.gradient(gaussian_filter(rough, 1.0), side_m) if min(rough.shape) > 1 else (0, 0)))
    )
    kept, high = np.zeros(values.shape, dtype=bool), np.zeros(values.shape, dtype=np.uint8)
    off = np.empty_like(values)
    for rows in _strips(values, block):
        off[rows] = values[rows] - _refined(rough, block, rows, values.shape[1])
        kept[rows] = np.abs(off[rows]) <= least_m + _refined(rise, block, rows, values.shape[1])
        high[rows] = off[rows] > _HIGH * least_m
    # what a surface smears over an edge bears on the terrain around it only where there is no other ground near
    clear = kept & ~_near(high, _MARGIN_M / surface.cell_m)
    kept &= ~_near(high, _EDGE_M / surface.cell_m)
    firm, weak = (_blocks(of.astype(np.float32), block, _mean_height) for of in (clear, kept))
    supported = (firm > 0) & (firm >= min(_SUPPORT, float(firm.max())))
    far = distance_transform_edt(~supported) * side_m > _FAR_M if supported.any() else np.ones(low.shape, dtype=bool)
    supported |= far & (weak >= _SUPPORT)
    if not supported.any():
        raise SurfaceError(_NO_GROUND)
    carrying = clear | (kept & far.repeat(block, axis=0).repeat(block, axis=1)[: len(values), : values.shape[1]])
    mean = rough + _blocks(np.where(carrying, off, np.float32(np.nan)), block, _mean_height)
    fill, gap_m = linear_between(mean, supported), distance_transform_edt(~supported) * side_m
    deviation = interpolated_sigma(mean, supported, side_m, linear_between)
    fill[gap_m > settings.maximum_gap_m] = np.nan
    heights, sigmas = (np.full(values.shape, np.nan, dtype=np.float32) for _ in range(2))
    for rows in _strips(values, block):
        there = np.isfinite(surface.values[rows])
        between, spread = (_refined(of, block, rows, values.shape[1]) for of in (fill, deviation))
        heights[rows] = np.where(kept[rows], values[rows], np.where(there, between, np.nan))
        sigmas[rows] = np.where(kept[rows], sigma.values[rows], np.where(np.isfinite(heights[rows]), spread, np.nan))
    grid = surface.west_map_m, surface.north_map_m, surface.cell_m
    return Terrain(Raster(heights, *grid), Raster(sigmas, *grid), np.isfinite(heights) & ~kept)


def _strips(values: Float32Array, block: int) -> Iterator[slice]:
    side = _STRIP_BLOCKS * block
    return (slice(row, min(row + side, len(values))) for row in range(0, len(values), side))


def _near(high: NDArray[np.uint8], cells: float) -> BoolArray:
    return np.asarray(maximum_filter(high, 2 * round(cells) + 1) > 0)


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


def linear_between(values: FloatArray, known: BoolArray) -> FloatArray:
    """Return values of a grid where ``known``, elsewhere linear between those around; outside them the nearest."""
    result = values.copy()
    unknown = ~known
    if not unknown.any():
        return result
    result[unknown] = nearest_known(values, known)[unknown]
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
