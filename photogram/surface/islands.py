"""Heights that contradict a smooth surface all around them.

On asphalt, on sand, at the water's edge photographs hardly correlate. What shines moves with the camera, shadows with
the sun, and most of all in larger cells the photographs of one strip agree on a height metres from the ground. Such a
piece hangs together, so that its cells support each other, and its standard deviations are small. What tells it is the
ground around it. From every doubtful cell eight directions are looked along, to the first height in each that is sure.
Where five of these lie on one plane, the ground is taken to go on between them. Nothing lies beneath it, so a height
far below the plane is false; so is one far above it that rests on two photographs, or that the finest level took for
detail. What larger cells show above a plane may be a crown.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from photogram.arrays import Float32Array, FloatArray
from photogram.compilation import njit
from photogram.surface.dsm import STEEPEST
from photogram.surface.levels import SURE_RAYS, SURE_SHARE, Surface

REACH_CELLS = 100
"""How far is looked for sure heights, in cells; windows must reach so much further."""

DIRECTIONS = 5
"""So many of eight directions must meet one plane."""

ON_PLANE_CELLS, OFF_PLANE_CELLS = 3.0, 16.0
"""How far heights are from a plane that they lie on, and from where on one is off it, in sides of a cell."""

HELD, ALIKE_CELLS = 2, 8.0
"""So many sure heights that are no farther from that of the cell, in its sides, hold it: the edge of a roof has ground
on five sides, and the roof on three."""


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
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


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _fill_above(
    doubtful: Float32Array, sure: Float32Array, on_plane_m: float, alike_m: float, rise_m: float, out: Float32Array
) -> None:
    """Fill how far each ``doubtful`` height is above the plane of ``sure`` heights around it, NaN where these lie in no
    plane, or HELD of them are alike; (rows, columns) each, NaN where there is no such height."""
    rows, columns = doubtful.shape
    down, right, z = np.empty(8), np.empty(8), np.empty(8)
    for r in range(rows):
        for c in range(columns):
            out[r, c] = np.nan
            if np.isnan(doubtful[r, c]):
                continue
            met, alike = 0, 0
            for k in range(9):
                dr, dc = k // 3 - 1, k % 3 - 1
                if k == 4:
                    continue
                for step in range(1, REACH_CELLS + 1):
                    i, j = r + step * dr, c + step * dc
                    if not (0 <= i < rows and 0 <= j < columns):
                        break
                    if not np.isnan(sure[i, j]):
                        down[met], right[met], z[met] = step * dr, step * dc, sure[i, j] - doubtful[r, c]
                        alike += 1 if abs(z[met]) <= alike_m else 0
                        met += 1
                        break
            if met >= DIRECTIONS and alike < HELD:
                many, height = _plane_around(down[:met], right[:met], z[:met], on_plane_m, rise_m)
                if many >= DIRECTIONS:
                    out[r, c] = -height


def without_islands(surface: Surface, cell_m: float) -> Surface:
    """Return a surface without the heights that contradict a smooth surface around them, OFF_PLANE_CELLS and more off
    its plane. All is as with a larger window from REACH_CELLS inside this one on."""
    agree, look = surface.rays.astype(np.int32), surface.seen.astype(np.int32)
    sure = (surface.cells == 1) & (agree >= SURE_RAYS) & (SURE_SHARE[1] * agree >= SURE_SHARE[0] * look)
    none, above_m, limit_m = np.float32(np.nan), np.empty_like(surface.height_m), OFF_PLANE_CELLS * cell_m
    sure_m, doubtful_m = (np.where(which, surface.height_m, none) for which in (sure, ~sure))
    _fill_above(doubtful_m, sure_m, ON_PLANE_CELLS * cell_m, ALIKE_CELLS * cell_m, STEEPEST * cell_m, above_m)
    island = (above_m < -limit_m) | ((above_m > limit_m) & ((surface.cells == 1) | (agree < SURE_RAYS)))
    nothing = {name: np.where(island, layer.dtype.type(0), layer) for name, layer in vars(surface).items()}
    kept = {name: np.where(island, none, getattr(surface, name)) for name in ("height_m", "sigma_m")}
    return replace(surface, **(nothing | kept))
