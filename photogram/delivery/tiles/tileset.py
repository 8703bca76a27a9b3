"""The surface with the orthophoto on it as 3D Tiles 1.1 (OGC 22-025r4): a quadtree of binary glTF, and tileset.json.

Vertices stand along east, north and up of the tangent plane of the ellipsoid at the survey, each projected exactly; the
root's transform leads from there to the geocentric coordinates of WGS 84.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from photogram import __version__
from photogram.arrays import FloatArray
from photogram.delivery.model.draped_mesh import (
    GROUND,
    PLAIN,
    draped,
    picture_of,
    within_rim,
    y_up,
)
from photogram.delivery.model.gltf import Material, Part, glb
from photogram.delivery.survey_contents import SurveyContents
from photogram.delivery.thinned_tin import DEFAULT_ERROR_INTERVALS, interval_of, reduced_raster
from photogram.delivery.tiles.quadtree import SIDE, Quadtree, Tile
from photogram.delivery.tiles.tile_mesh import TileMesh, tile_mesh
from photogram.errors import FrameError
from photogram.files.atomic import make_folder_within, write_whole
from photogram.files.maps.rasters import RasterFile, open_raster, pixel_m
from photogram.geodesy.crs import NO_CRS, plan_of
from photogram.geodesy.frames import (
    LocalFrame,
    geocentric_from_topocentric,
    geodetic_from_map,
    topocentric_from_geodetic,
)
from photogram.grid import MapGrid
from photogram.report.view.drawn_surface import STEEPEST_DEG
from photogram.wording import things

TILESET = "tileset.json"

MOST_CELLS = 36_000_000
"""Of a larger surface every second cell is taken, or every third …"""

MOST_PIXELS = 512
"""Along a side of a tile's picture."""

ERROR_PIXELS = 16.0
"""Pixels of its picture, of MOST_PIXELS along its side, that the error of a tile with others below it is at least:
viewers refine what is off by more than 16 pixels of the screen, so a pixel of the picture is one of the screen then."""

_GLANCED_CELLS = 4_000_000
_BASELINE_M = 1e5
_UNDECLARED = (
    "Heights above the ellipsoid: the project does not declare its height system, so its heights are taken as such, "
    "and the model may stand too high or low by the height of the geoid: give heights.output."
)


@dataclass(frozen=True)
class Placement:
    """Where the tiles stand on Earth."""

    frame: LocalFrame
    origin_lla: tuple[float, float, float]
    """Latitude, longitude and ellipsoidal height of the origin of east, north and up."""

    @classmethod
    def near(cls, frame: LocalFrame) -> Placement:
        """Return that of a survey. Raises FrameError where the grid of its geoid is missing."""
        longitude, latitude, height = _geodetic(frame, np.array([frame.origin_map_m]))[0].tolist()
        return cls(frame, (latitude, longitude, height))

    def enu_m(self, place_map_m: FloatArray) -> FloatArray:
        """Return points (N, 3) of the map along east, north and up of the origin. Raises FrameError beyond the CRS or
        the geoid's grid."""
        return topocentric_from_geodetic(self.origin_lla, _geodetic(self.frame, place_map_m))

    def transform(self) -> list[float]:
        """Return the transform (16,) from east, north and up to geocentric coordinates, column by column."""
        ends = geocentric_from_topocentric(self.origin_lla, np.vstack([np.zeros(3), _BASELINE_M * np.eye(3)]))
        axes = (ends[1:] - ends[0]) / _BASELINE_M
        return np.column_stack([np.vstack([axes, ends[0]]), [0.0, 0.0, 0.0, 1.0]]).reshape(-1).tolist()


def _geodetic(frame: LocalFrame, place_map_m: FloatArray) -> FloatArray:
    """Return longitude, latitude and ellipsoidal height of points (N, 3) of the map."""
    geodetic = geodetic_from_map(plan_of(frame.crs), place_map_m)
    geodetic[:, 2] += frame.geoid_height_m(place_map_m)
    return geodetic


def write_tileset(path: Path, contents: SurveyContents, error_m: float | None) -> tuple[str, tuple[str, ...]]:
    """Write the tiles beside ``path``, and last ``path``, tileset.json; return in words what they hold, nothing where
    no file was written, and sentences on what they do not hold.

    The finest tiles are off by ``error_m`` at most, a tenth of a contour interval if None, unless that takes too many
    vertices. Raises ProjectError where a raster cannot be read, WorkspaceError where a file cannot be written.
    """
    if contents.top is None:
        return "", (f"Surface: {contents.absent.get('surface') or 'there is none'}.",)
    if contents.crs == NO_CRS or contents.frame is None:
        return "", ("Place on Earth: crs: none, and 3D Tiles stand on the globe.",)
    if contents.height_system == "orthometric" and contents.frame.geoid is None:
        return "", ("Heights above the ellipsoid: the project names no geoid: give heights.geoid.",)
    try:
        placement = Placement.near(contents.frame)
    except FrameError as error:
        return "", (f"Heights above the ellipsoid: {error}.",)
    if error_m is None:
        error_m = DEFAULT_ERROR_INTERVALS * interval_of(reduced_raster(contents.top, most=_GLANCED_CELLS))
    file = open_raster(contents.top)
    every = max(1, ceil(np.sqrt(file.grid.rows * file.grid.columns / MOST_CELLS)))
    tree = Quadtree(file.grid, every, SIDE)
    work = _Work(path.parent, file, tree, contents.orthophoto, placement, error_m)
    make_folder_within(path.parent)
    root = _written(work, Tile(0, 0, 0))
    if root is None:
        return "", ("Surface: the orthophoto shows nothing of it.",)
    write_whole(path, json.dumps(_tileset(contents, work, root), separators=(",", ":"), ensure_ascii=False))
    lacks = [] if contents.orthophoto is not None else ["Orthophoto: there is none, so the surface is grey."]
    lacks += [] if contents.height_system is not None else [_UNDECLARED]
    cell_m = tree.every * file.grid.cell_m
    levels = things(tree.depth + 1, "level")
    return f"surface in {things(root.tiles, 'tile')}, {levels} of detail, cells of {cell_m:.3g} m at best", tuple(lacks)


@dataclass(frozen=True)
class _Work:
    """What the tiles are made of, and where they go."""

    folder: Path
    file: RasterFile
    tree: Quadtree
    orthophoto: Path | None
    placement: Placement
    error_m: float


@dataclass(frozen=True, eq=False)
class _Written:
    """A tile and all below it, as they have been written."""

    node: dict[str, Any]
    low_m: FloatArray
    high_m: FloatArray
    """Their corners along east, north and up."""
    error_m: float
    tiles: int


def _written(work: _Work, tile: Tile) -> _Written | None:
    """Write a tile after those below it; None where there is nothing in it."""
    below = [made for child in work.tree.children(tile) if (made := _written(work, child)) is not None]
    own = _write_tile(work, tile)
    if own is None and not below:
        return None
    low_m = np.min([part.low_m for part in (*below, *([own] if own else []))], axis=0)
    high_m = np.max([part.high_m for part in (*below, *([own] if own else []))], axis=0)
    side_m = work.tree.side * work.tree.stride(tile.level) * work.file.grid.cell_m
    least_m = ERROR_PIXELS * side_m / MOST_PIXELS if below else 0.0  # without a mesh of its own, too
    error_m = max([least_m, own.error_m if own else 0.0, *(2.0 * part.error_m for part in below)])
    half_m = np.maximum((high_m - low_m) / 2, 1e-3)
    axes = np.diag(half_m).reshape(-1)
    node: dict[str, Any] = {
        "boundingVolume": {"box": [*((low_m + high_m) / 2).tolist(), *axes.tolist()]},
        "geometricError": error_m,
        "refine": "REPLACE",
    }
    node |= own.node if own else {}
    node |= {"children": [part.node for part in below]} if below else {}
    return _Written(node, low_m, high_m, error_m, sum(part.tiles for part in below) + (own is not None))


def _write_tile(work: _Work, tile: Tile) -> _Written | None:
    """Write the file of a tile by itself; None where it has no heights, or the orthophoto shows none of them."""
    cells, tree = work.tree.cells_of(tile), work.tree
    seen = None
    if work.orthophoto is not None:
        level = np.zeros((cells.rows, cells.columns), dtype=np.float32)
        seen = np.isfinite(within_rim(cells.raster(level), work.orthophoto).values)
    mesh = tile_mesh(work.file, tree, tile, seen, work.error_m * 2 ** (tree.depth - tile.level))
    if mesh is None:
        return None
    place_m = work.placement.enu_m(mesh.tin.vertex_map_m)
    middle_m = np.round(place_m.mean(axis=0))
    picture = None if work.orthophoto is None else picture_of(work.orthophoto, _pixels(work.orthophoto, cells, mesh))
    uv = None if picture is None else picture.uv(mesh.tin.vertex_map_m)
    parts = draped(place_m - middle_m, uv, mesh.tin.triangle)
    if len(mesh.skirt_top):
        parts.append(_skirt(mesh, place_m - middle_m, uv))
    parts = [replace(part, material=replace(part.material, unlit=part.material.textured)) for part in parts]
    shift = y_up(middle_m[None])[0]
    jpeg = None if picture is None else picture.jpeg
    write_whole(work.folder / tile.name, glb(parts, jpeg, {}, (float(shift[0]), float(shift[1]), float(shift[2]))))
    corners = np.vstack([part.position_m.astype(np.float32).astype(np.float64) for part in parts]) + shift
    corners = np.column_stack([corners[:, 0], -corners[:, 2], corners[:, 1]])
    said = {"off_95_m": round(mesh.off_95_m, 4), "greatest_m": round(mesh.greatest_m, 4)}
    node = {"content": {"uri": tile.name}, "extras": {"vertical": said}}
    return _Written(node, corners.min(axis=0), corners.max(axis=0), mesh.off_95_m, 1)


def _skirt(mesh: TileMesh, place_m: FloatArray, uv: FloatArray | None) -> Part:
    """Return the skirts, in the colours of the edges that they hang from."""
    top = place_m[mesh.skirt_top]
    drop = np.zeros_like(top)
    drop[:, 2] = mesh.skirt_bottom_m - mesh.tin.vertex_map_m[mesh.skirt_top, 2]
    count = len(top)
    a = np.arange(0, count, 2)
    triangle = np.vstack([np.column_stack([a, a + 1, a + 1 + count]), np.column_stack([a, a + 1 + count, a + count])])
    position_m = y_up(np.vstack([top, top + drop]))
    at = np.zeros((count, 2)) if uv is None else uv[mesh.skirt_top]
    looks = PLAIN if uv is None else GROUND
    material = Material(
        "skirts", looks.grey, looks.textured, {"meaning": "closes gaps between levels of detail: no surface"}
    )
    up = np.tile([0.0, 1.0, 0.0], (2 * count, 1))
    return Part(position_m, up, np.vstack([at, at]), triangle, material)


def _pixels(orthophoto: Path, cells: MapGrid, mesh: TileMesh) -> MapGrid:
    """Return the pixels of a tile's picture: those of the orthophoto around its vertices, or larger ones."""
    low, high = mesh.tin.vertex_map_m[:, :2].min(axis=0), mesh.tin.vertex_map_m[:, :2].max(axis=0)
    side_m = (cells.columns - 1) * cells.cell_m
    cell_m = max(pixel_m(orthophoto), side_m / MOST_PIXELS)
    columns, rows = (max(1, ceil(length / cell_m - 1e-6)) for length in (high - low).tolist())
    return MapGrid(float(low[0]), float(high[1]), cell_m, rows, columns)


def _tileset(contents: SurveyContents, work: _Work, root: _Written) -> dict[str, Any]:
    latitude, longitude, height_m = work.placement.origin_lla
    said = {
        "generator": f"photogram {__version__}",
        "crs": contents.crs,
        "crs_in_words": contents.crs_words,
        "frame": "east, north, up, m, of the tangent plane of WGS 84 at origin; glTF: x east, y up, z south",
        "origin": {"latitude_deg": latitude, "longitude_deg": longitude, "ellipsoidal_height_m": height_m},
        "heights_declared": contents.height_system,
        "geometric_error": "m: vertical distance of 95 % of the next finer level's cells from a tile's mesh, at least "
        f"{ERROR_PIXELS:g} pixels of its picture where others are below it, and twice their error",
        "walls": f"triangles steeper than {STEEPEST_DEG:g}°, which the orthophoto does not see: grey, material walls",
        "skirts": "material skirts: closes gaps between levels of detail, no surface",
    }
    extent_m = float(np.linalg.norm(root.high_m - root.low_m))
    return {
        "asset": {"version": "1.1", "extras": said},
        "geometricError": max(extent_m, 2.0 * root.error_m),
        "root": {"transform": work.placement.transform()} | root.node,
    }
