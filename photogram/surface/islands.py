"""Heights that contradict a smooth surface all around them.

On asphalt, on sand, at the water's edge texture is weak. Reflections move with the camera, shadows with the sun, and
the photographs of one strip may agree on a height metres from the ground, in larger cells above all. The cells of such
a piece support each other, and their standard deviations are small; the ground around exposes it. From every doubtful
cell the nearest sure height is found in each of eight directions. Where five of these lie on one plane, the ground is
taken to continue between them: a height far below the plane is false, and so is one far above it that is of the finest
level, rests on two photographs, or on some that correlate weakly. Above a plane, larger cells may show a crown.
"""

import numpy as np

from photogram.arrays import ByteArray, Float32Array, FloatArray
from photogram.compilation import njit
from photogram.surface.dsm import ROUGH_CORRELATION, SURE_RAYS, SURE_SHARE
from photogram.surface.levels import LevelSurface
from photogram.surface.nearest_heights import DIRECTIONS, steps_to_heights
from photogram.surface.planes import STEEPEST

REACH_CELLS = 100
"""Distance to which sure heights are looked for, in cells; windows must reach so much further."""

LEAST_DIRECTIONS = 5
"""So many of eight directions must meet one plane."""

ON_PLANE_CELLS, OFF_PLANE_CELLS = 3.0, 16.0
"""Largest distance from a plane of heights that lie on it, and smallest of one that is off it, over the cell size."""

LEAST_ALIKE, ALIKE_CELLS = 2, 8.0
"""So many sure heights that differ by no more, over the cell size, keep a height: the edge of a roof has ground on five
sides, and the roof on three."""

ALL = (slice(None), slice(None))


@njit(cache=True, nogil=True)
def _plane_around(
    down: FloatArray, right: FloatArray, z: FloatArray, on_plane_m: float, rise_m: float
) -> tuple[int, float]:
    """Return how many of the heights ``z`` (N,) lie on the plane of three of them that most lie on, and its height at
    the origin; of planes that rise by no more than ``rise_m`` per cell, 0 and NaN without any."""
    many, height, least = 0, np.nan, np.inf
    for a in range(len(z)):
        for b in range(a + 1, len(z)):
            r, c, h = down[b] - down[a], right[b] - right[a], z[b] - z[a]
            for k in range(b + 1, len(z)):
                rr, cc, hh = down[k] - down[a], right[k] - right[a], z[k] - z[a]
                area = r * cc - c * rr
                if area == 0.0:
                    continue
                by_down, by_right = (h * cc - hh * c) / area, (r * hh - rr * h) / area
                if by_down * by_down + by_right * by_right > rise_m * rise_m:
                    continue
                at = z[a] - by_down * down[a] - by_right * right[a]
                on, total = 0, 0.0
                for n in range(len(z)):
                    off = abs(z[n] - at - by_down * down[n] - by_right * right[n])
                    if off <= on_plane_m:
                        on, total = on + 1, total + off
                if on > many or (on == many and total < least):
                    many, height, least = on, at, total
    return many, height


@njit(cache=True, nogil=True)
def _fill_above(
    doubtful: Float32Array, sure: Float32Array, steps: ByteArray, place: tuple[int, int], on_plane_m: float,
    alike_m: float, rise_m: float, out: Float32Array,
) -> None:  # fmt: skip
    """Fill how far each ``doubtful`` height is above the plane of ``sure`` heights around it, NaN where these lie in no
    plane, or LEAST_ALIKE of them are alike; (rows, columns) each, NaN where there is no such height. ``place`` is the
    cell of these that is the first of ``out``, ``steps`` lead to sure heights."""
    down, right, z = np.empty(8), np.empty(8), np.empty(8)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = np.nan
            r, c = place[0] + i, place[1] + j
            if np.isnan(doubtful[r, c]):
                continue
            met, alike = 0, 0
            for k, (dr, dc) in enumerate(DIRECTIONS):
                step = np.int64(steps[k, r, c])
                if step > 0:
                    down[met], right[met] = step * dr, step * dc
                    z[met] = sure[r + step * dr, c + step * dc] - doubtful[r, c]
                    alike += 1 if abs(z[met]) <= alike_m else 0
                    met += 1
            if met >= LEAST_DIRECTIONS and alike < LEAST_ALIKE:
                many, height = _plane_around(down[:met], right[:met], z[:met], on_plane_m, rise_m)
                if many >= LEAST_DIRECTIONS:
                    out[i, j] = -height


def without_islands(surface: LevelSurface, cell_m: float, part: tuple[slice, slice] = ALL) -> LevelSurface:
    """Return a ``part`` of a surface, rows and columns, without the heights that contradict a smooth surface around
    them, OFF_PLANE_CELLS and more off its plane. All is as with a larger window from REACH_CELLS inside this one on."""
    agree, look = surface.rays.astype(np.int32), surface.seen.astype(np.int32)
    sure = (surface.cells == 1) & (agree >= SURE_RAYS) & (SURE_SHARE[1] * agree >= SURE_SHARE[0] * look)
    none, limit_m = np.float32(np.nan), OFF_PLANE_CELLS * cell_m
    sure_m, doubtful_m = (np.where(which, surface.height_m, none) for which in (sure, ~sure))
    layers = {name: layer[part] for name, layer in vars(surface).items()}
    place, above_m = (part[0].start or 0, part[1].start or 0), np.empty(layers["height_m"].shape, np.float32)
    steps, rise_m = steps_to_heights(sure_m, REACH_CELLS), STEEPEST * cell_m
    _fill_above(doubtful_m, sure_m, steps, place, ON_PLANE_CELLS * cell_m, ALIKE_CELLS * cell_m, rise_m, above_m)
    weak = (layers["cells"] == 1) | (layers["rays"] < SURE_RAYS) | (layers["correlation"] < ROUGH_CORRELATION)
    island = (above_m < -limit_m) | ((above_m > limit_m) & weak)
    for name, layer in layers.items():
        hole = none if name in ("height_m", "sigma_m") else layer.dtype.type(0)
        layers[name] = np.where(island, hole, layer)
    return LevelSurface(**layers)
