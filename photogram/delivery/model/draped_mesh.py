"""A triangulated surface with the orthophoto on it: what of it is wall, its normals, and its picture.

An orthophoto looks straight down and does not see walls: triangles steeper than STEEPEST_DEG are a part of their own,
grey, so that nobody takes stretched pixels of a roof for a wall.
"""

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from photogram.arrays import FloatArray, IntArray
from photogram.delivery.model.gltf import Material, Part
from photogram.files.maps.rasters import picture_on_grid
from photogram.grid import MapGrid
from photogram.report.view.drawn_surface import STEEPEST_DEG
from photogram.survey import Raster

_WALL_GREY, _PLAIN_GREY = 0.35, 0.6
_JPEG_QUALITY = 85
_OPAQUE = 128

GROUND, PLAIN = Material("orthophoto", textured=True), Material("surface without an orthophoto", _PLAIN_GREY)
WALLS = Material(
    "walls",
    _WALL_GREY,
    extras={"meaning": f"steeper than {STEEPEST_DEG:g}°: not seen by the orthophoto, of heights beside one another"},
)


@dataclass(frozen=True, eq=False)
class Picture:
    """What the orthophoto shows of a part of the map."""

    grid: MapGrid
    """Its pixels."""
    jpeg: bytes

    def uv(self, places_map_m: FloatArray) -> FloatArray:
        """Return where in it (N, 2), from its upper left corner, places (N, 2 or 3) of the map are."""
        west, east, south, north = self.grid.extent_map_m
        u, v = (places_map_m[:, 0] - west) / (east - west), (north - places_map_m[:, 1]) / (north - south)
        return np.column_stack([u, v])


def picture_of(path: Path, grid: MapGrid) -> Picture:
    """Return what an orthophoto shows on a grid; beyond its rim its mean colour. Raises ProjectError where it cannot be
    read."""
    shown = picture_on_grid(path, grid, grid.whole)
    colour, seen = shown[..., :3], shown[..., 3] >= _OPAQUE
    if seen.any() and not seen.all():
        colour[~seen] = colour[seen].mean(axis=0).round().astype(np.uint8)
    stream = BytesIO()
    Image.fromarray(colour).save(stream, "JPEG", quality=_JPEG_QUALITY, subsampling=0)
    return Picture(grid, stream.getvalue())


def within_rim(raster: Raster, orthophoto: Path) -> Raster:
    """Return heights of the cells that an orthophoto shows. Raises ProjectError where it cannot be read."""
    grid = MapGrid.of(raster)
    seen = picture_on_grid(orthophoto, grid, grid.whole)[..., 3] >= _OPAQUE
    return grid.raster(np.where(seen, raster.values, np.float32(np.nan)))


def is_wall(vertex_m: FloatArray, triangle: IntArray) -> np.ndarray:
    """Return which triangles (T,) between vertices (V, 3), heights last, are steeper than STEEPEST_DEG."""
    across = _double_areas(vertex_m, triangle)
    return np.asarray(np.abs(across[:, 2]) < np.cos(np.radians(STEEPEST_DEG)) * np.linalg.norm(across, axis=1))


def draped(vertex_m: FloatArray, uv: FloatArray | None, triangle: IntArray) -> list[Part]:
    """Return ground and walls of triangles (T, 3) between vertices (V, 3) along east, north and up, y up; with places
    in the picture (V, 2) where there is one. Their normals are means by area of the triangles of the same part, so that
    edges stay sharp. A part without triangles is left out."""
    steep = is_wall(vertex_m, triangle)
    parts = []
    for material, chosen in ((PLAIN if uv is None else GROUND, ~steep), (WALLS, steep)):
        if not chosen.any():
            continue
        used, renumbered = np.unique(triangle[chosen], return_inverse=True)
        own, corners = vertex_m[used], renumbered.reshape(-1, 3)
        at = np.zeros((len(used), 2)) if uv is None else uv[used]
        parts.append(Part(y_up(own), y_up(_normals(own, corners)), at, corners, material))
    return parts


def y_up(places: FloatArray) -> FloatArray:
    """Return places (N, 3) along east, north and up as glTF has them: along east, up and south."""
    return np.column_stack([places[:, 0], places[:, 2], -places[:, 1]])


def _double_areas(vertex_m: FloatArray, triangle: IntArray) -> FloatArray:
    a, b, c = (vertex_m[triangle[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


def _normals(vertex_m: FloatArray, triangle: IntArray) -> FloatArray:
    across, sums = _double_areas(vertex_m, triangle), np.zeros_like(vertex_m)
    for corner in range(3):
        np.add.at(sums, triangle[:, corner], across)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(length > 0, sums / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0])
