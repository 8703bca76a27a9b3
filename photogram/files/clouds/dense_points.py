"""The cloud of a dense surface as LAZ, written chunk by chunk: colour, sigma, confidence, rays and level of every
point."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import laspy
import numpy as np

from photogram.arrays import ByteArray, Float32Array, FloatArray, check_shapes
from photogram.files.clouds.laz_streams import laz_stream
from photogram.files.clouds.points import (
    COLOURED_FORMAT,
    NO_DATE,
    SCALE_M,
    SIGMA_DESCRIPTIONS,
    add_extra_bytes,
    described,
    las_header,
)
from photogram.geodesy.crs import MapUnits, map_units
from photogram.grid import MapGrid, Window

CHUNK_CELLS = 512
"""Side of the squares of cells in whose order a cloud is best written: neighbours stay together in the file."""

SIGMA, CONFIDENCE, RAYS, LEVEL = "sigma z", "confidence", "rays", "level"
"""Names of the extra bytes; the first as in clouds of tie points."""

ACROSS = "sigma across plane"
"""Name of the first where the surface lies on a plane: its standard deviation is not one of heights."""

_SIGMAS = {SIGMA: SIGMA_DESCRIPTIONS[SIGMA], ACROSS: "st. deviation across plane [m]"}
_EXTRA_BYTES: dict[str, tuple[type[np.generic], str]] = {
    CONFIDENCE: (np.uint8, "0 (none) to 100 (certain)"),
    RAYS: (np.uint8, "photographs that agree"),
    LEVEL: (np.uint8, "cells to a side that it is of"),
}


NEVER_CLASSIFIED, NOT_GROUND, GROUND = 0, 1, 2
"""Classes of the LAS specification (ASPRS LAS 1.4 R15, table 17): 0 where nobody asked, 1 unclassified, 2 ground."""


@dataclass(frozen=True, eq=False)
class DensePoints:
    """Points of a dense surface in the project's CRS.

    ``position_map_m`` (N, 3), ``colour`` (N, 3) red, green, blue; ``sigma_height_m`` (N,) standard deviation of the
    height, or across the plane of the surface; ``confidence`` (N,) from 0 to 1; ``rays`` (N,) number of photographs
    that agree on the point; ``level`` (N,) side of the cells that it was measured in, in cells of the surface;
    ``classification`` (N,) NEVER_CLASSIFIED, NOT_GROUND or GROUND.
    """

    position_map_m: FloatArray
    colour: ByteArray
    sigma_height_m: Float32Array
    confidence: Float32Array
    rays: ByteArray
    level: ByteArray
    classification: ByteArray

    def __post_init__(self) -> None:
        n = len(self.position_map_m)
        check_shapes(self, position_map_m=(n, 3), colour=(n, 3), sigma_height_m=(n,), confidence=(n,))
        check_shapes(self, rays=(n,), level=(n,), classification=(n,))

    def __len__(self) -> int:
        return len(self.position_map_m)


def points_of_cells(
    grid: MapGrid,
    window: Window,
    heights: Float32Array,
    colour: ByteArray,
    sigma: Float32Array,
    confidence: Float32Array,
    rays: ByteArray,
    level: ByteArray,
    classification: ByteArray,
) -> DensePoints:
    """Return the centres of a window's cells that have a height, row by row; all arrays (rows, columns), ``colour``
    (rows, columns, 3)."""
    row, column = np.nonzero(np.isfinite(heights))
    east, north = grid.centres_map_m(window)
    position = np.column_stack([east[column], north[row], heights[row, column].astype(np.float64)])
    at = row, column
    return DensePoints(position, colour[at], sigma[at], confidence[at], rays[at], level[at], classification[at])


def write_dense_laz(
    path: Path,
    grid: MapGrid,
    crs: str,
    chunks: Iterable[DensePoints],
    created: date = NO_DATE,
    *,
    coloured: bool = True,
    plane_origin_map_m: FloatArray | None = None,
) -> int:
    """Write a LAZ 1.4 file in ``crs`` and its units, with its height system where it names one, to a thousandth of the
    unit, and return the number of points; whole or not at all.

    Points stand in the order of the chunks; memory grows with a chunk. Colour is 16-bit, and left out (point format 6)
    where nothing is ``coloured``. Extra bytes: "sigma z" (float32), "confidence" (uint8, 0 to 100), "rays" and
    "level" (uint8). The coordinates' offsets are those of the middle of the grid, so the bytes do not depend on how the
    points are divided into chunks; of a grid on a plane, whose origin in the map is ``plane_origin_map_m`` (3,), those
    of the origin, and the sigma is ACROSS.

    Raises FrameError where ``crs`` is no map grid, WorkspaceError where the file cannot be written,
    ValueError where a position or confidence is not finite or out of its range.
    """
    header, units = las_header(crs, created, colour=coloured), map_units(crs)
    middle = grid.west_map_m + grid.columns * grid.cell_m / 2, grid.north_map_m - grid.rows * grid.cell_m / 2
    header.offsets = np.floor(
        np.array([*middle, 0.0] if plane_origin_map_m is None else plane_origin_map_m) / units.factors
    )
    sigma = SIGMA if plane_origin_map_m is None else ACROSS
    add_extra_bytes(header, {**described({sigma: _SIGMAS[sigma]}, units), **_EXTRA_BYTES})
    count = 0
    with (
        laz_stream(path) as stream,
        laspy.open(stream, "w", header=header, do_compress=True, closefd=False) as writer,
    ):
        for chunk in chunks:
            if len(chunk):
                writer.write_points(_record(path, chunk, header, units))
                count += len(chunk)
    return count


def _record(path: Path, chunk: DensePoints, header: laspy.LasHeader, units: MapUnits) -> laspy.ScaleAwarePointRecord:
    steps = np.rint((chunk.position_map_m / units.factors - header.offsets) / SCALE_M)
    if not np.all(np.abs(steps) <= np.iinfo(np.int32).max):
        raise ValueError(f"{path}: a point is not finite, or too far from the middle of the grid for LAZ")
    if not np.all((chunk.confidence >= 0) & (chunk.confidence <= 1)):
        raise ValueError(f"{path}: a confidence is not from 0 to 1")
    points = laspy.ScaleAwarePointRecord.zeros(len(chunk), header=header)
    points.X, points.Y, points.Z = steps.astype(np.int32).T
    points["return_number"][:] = points["number_of_returns"][:] = 1
    points["classification"][:] = chunk.classification
    if header.point_format.id == COLOURED_FORMAT:
        points.red, points.green, points.blue = chunk.colour.astype(np.uint16).T * np.uint16(257)
    names = set(points.point_format.extra_dimension_names)
    points[SIGMA if SIGMA in names else ACROSS] = (chunk.sigma_height_m / units.height_m).astype(np.float32)
    points[CONFIDENCE] = np.rint(100 * chunk.confidence).astype(np.uint8)
    points[RAYS] = chunk.rays
    points[LEVEL] = chunk.level
    return points
