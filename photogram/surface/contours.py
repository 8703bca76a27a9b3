"""Contour lines of a surface, traced by contourpy: lines of one height through the centres of cells, cut at holes.

Nothing is smoothed: between the centres of four cells the surface is bilinear on its edges, and a line is straight
inside. What is finer than the cells that are contoured is averaged away first.
"""

from dataclasses import dataclass
from typing import Annotated, Any, cast

import numpy as np
from contourpy import ContourGenerator, LineType, contour_generator

from photogram.arrays import FloatArray, IntArray
from photogram.errors import SettingError, SurfaceError
from photogram.grid import block_means
from photogram.measures.round_lengths import round_near
from photogram.settings.settings import Default, Settings, Within
from photogram.survey import Contours, Raster

LINES_OVER_RELIEF = 20
"""About so many lines lie between the lowest and the highest ground where no interval is given."""

LEAST_SHARE = 0.5
"""A block of cells that are averaged has a height where this share of it is known."""

MAXIMUM_CELLS = 16_000_000
"""So many cells are contoured at most; of a larger raster as many together as leave that."""

MAXIMUM_LEVELS = 2000
"""More heights than these are a mistake in the interval."""

_FINEST_INTERVAL_M = 0.01


@dataclass(frozen=True)
class ContourSettings(Settings):
    """How contour lines are traced."""

    enabled: Annotated[bool, "Whether contour lines are traced."] = True
    interval_m: Annotated[
        float | None,
        Within(0.01, 1000, "m"),
        "Contour interval.",
        Default(f"by the relief, about {LINES_OVER_RELIEF} lines"),
    ] = None
    cell_m: Annotated[
        float | None,
        Within(0.001, 1000, "m"),
        "The raster is averaged to about such cells first: larger is calmer.",
        Default("that of the raster"),
    ] = None
    minimum_length_m: Annotated[
        float | None, Within(0, 100_000, "m"), "Shorter lines are left out.", Default("8 cells")
    ] = None


def interval_for(relief_m: float) -> float:
    """Return the interval, 1, 2 or 5 times a power of ten and 1 cm at least, that comes nearest to LINES_OVER_RELIEF
    lines over a relief."""
    return round_near(max(relief_m / LINES_OVER_RELIEF, _FINEST_INTERVAL_M))


def contour_lines(raster: Raster, settings: ContourSettings | None = None) -> Contours:
    """Trace the lines of the multiples of the interval, lowest first; none runs through a cell without data.

    The raster is treated as a whole: beside it some 70 bytes for each cell that is contoured, 1.1 GB at most. Raises
    SurfaceError where no cell has data, SettingError where the interval makes more than MAXIMUM_LEVELS heights.
    """
    settings = settings or ContourSettings()
    block = _block(raster, settings.cell_m)
    values, share = block_means(raster.values, block)
    known, cell_m = share >= LEAST_SHARE, raster.cell_m * block
    if not known.any():
        raise SurfaceError("contours: no cell of the surface has a height: set contours.enabled to false")
    heights = values[known]
    low, high = float(heights.min()), float(heights.max())
    spread = np.percentile(heights, [0.5, 99.5])
    # a single wild height may not ask for more lines than there can be
    relief_m = max(float(spread[1] - spread[0]), (high - low) * 2 * LINES_OVER_RELIEF / MAXIMUM_LEVELS)
    interval_m = settings.interval_m or interval_for(relief_m)
    first, last = np.ceil(low / interval_m), np.floor(high / interval_m)
    if not last - first < MAXIMUM_LEVELS:
        raise SettingError(
            "interval_m",
            f"an interval of {interval_m:g} m makes {last - first + 1:.0f} heights from {low:.1f} to "
            f"{high:.1f} m, more than {MAXIMUM_LEVELS}: choose a larger one",
        )
    shortest_m = 8 * cell_m if settings.minimum_length_m is None else settings.minimum_length_m
    generator = contour_generator(
        z=np.ma.masked_array(values, ~known), name="serial", corner_mask=False, line_type=LineType.ChunkCombinedOffset
    )
    corner = np.array([raster.west_map_m + cell_m / 2, raster.north_map_m - cell_m / 2])
    levels = np.round(np.arange(first, last + 1) * interval_m, 9)
    lines = [_of_level(generator, float(level), shortest_m / cell_m) for level in levels]
    vertices = np.concatenate([v for v, _ in lines] or [np.zeros((0, 2))])
    count = np.concatenate([c for _, c in lines] or [np.zeros(0, np.int64)])
    height = np.repeat(levels, [len(c) for _, c in lines])
    first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    return Contours(height, corner + vertices * [cell_m, -cell_m], first, interval_m, cell_m)


def _of_level(generator: ContourGenerator, level: float, shortest: float) -> tuple[FloatArray, IntArray]:
    """Return the vertices (V, 2), in cells, of lines of one height that are long enough, and their numbers (L,)."""
    (vertices,), (offset,) = cast(Any, generator.lines(level))
    if vertices is None or offset is None:
        return np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
    first = offset.astype(np.int64)
    step = np.hypot(*np.diff(vertices, axis=0, append=vertices[-1:]).T)
    step[first[1:] - 1] = 0.0  # from the end of a line to the start of the next
    keep = np.add.reduceat(step, first[:-1]) >= shortest
    count = np.diff(first)
    return vertices[np.repeat(keep, count)], count[keep]


def _block(raster: Raster, cell_m: float | None) -> int:
    """Return how many cells along a side are averaged into one."""
    wanted = 1 if cell_m is None else max(1, round(cell_m / raster.cell_m))
    return max(wanted, int(np.ceil(np.sqrt(raster.values.size / MAXIMUM_CELLS))))
