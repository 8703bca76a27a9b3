"""Clouds that are compared, with the standard deviations of their heights and their CRS, and distances as LAZ."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from photogram.arrays import FloatArray
from photogram.errors import ProjectError
from photogram.files.clouds.dense_points import SIGMA
from photogram.files.clouds.laz_streams import laz_stream
from photogram.files.clouds.points import (
    LAS_SUFFIXES,
    NO_DATE,
    add_extra_bytes,
    las_colour,
    las_header,
    las_units,
    read_cloud,
    read_las,
)
from photogram.geodesy.crs import NO_CRS, map_units
from photogram.survey import PointCloud


@dataclass(frozen=True, eq=False)
class ComparedCloud:
    """A cloud as it was read."""

    path: Path
    points: PointCloud
    sigma_height_m: FloatArray | None
    """Standard deviation of each height (N,), None where the file holds none."""
    crs: str | None
    """WKT of its CRS, None where the file names none."""


def read_compared(path: Path) -> ComparedCloud:
    """Return a cloud, in metres whatever its CRS counts, with its extra bytes "sigma z". Raises ProjectError as
    ``read_cloud``, and where a standard deviation is none."""
    if path.suffix.lower() not in LAS_SUFFIXES or not path.is_file():
        return ComparedCloud(path, read_cloud(path), None, None)
    data = read_las(path)
    units = las_units(data.header, NO_CRS)
    cloud = PointCloud(np.asarray(data.xyz, dtype=np.float64) * units.factors, las_colour(data))
    if len(cloud) == 0:
        raise ProjectError(f"point cloud {path}: it contains no points: export it again")
    sigma = None
    if SIGMA in set(data.point_format.dimension_names):
        sigma = np.asarray(data[SIGMA], dtype=np.float64) * units.height_m
        if not np.all((sigma >= 0.0) & np.isfinite(sigma)):
            raise ProjectError(f"point cloud {path}: {SIGMA!r} holds what is no standard deviation: export it again")
    return ComparedCloud(path, cloud, sigma, _crs_of(path, data.header))


def _crs_of(path: Path, header: laspy.LasHeader) -> str | None:
    try:
        crs = header.parse_crs()
    except Exception as error:  # whatever PROJ says of what is no CRS; laspy names no errors of its own
        raise ProjectError(f"point cloud {path}: its CRS cannot be read ({error}): export it again") from error
    return None if crs is None else str(crs.to_wkt())


def write_distances(
    path: Path,
    points_map_m: FloatArray,
    crs: str,
    fields: Mapping[str, tuple[NDArray[np.generic], str]],
) -> None:
    """Write points (N, 3) as LAZ 1.4 in the units of ``crs``, with extra bytes, of each name the values (N,), in metres
    where they are lengths, and what they are; whole or not at all. Raises FrameError where ``crs`` is no map grid,
    WorkspaceError where the file cannot be written."""
    header, place = las_header(crs, NO_DATE, colour=False), points_map_m / map_units(crs).factors
    header.offsets = np.floor((place.min(axis=0) + place.max(axis=0)) / 2)
    add_extra_bytes(header, {name: (values.dtype.type, text) for name, (values, text) in fields.items()})
    points = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(len(place), header=header))
    points.X, points.Y, points.Z = np.rint((place - header.offsets) / header.scales).astype(np.int32).T
    points.return_number[:] = points.number_of_returns[:] = 1
    for name, (values, _) in fields.items():
        points[name] = values
    with laz_stream(path) as stream:
        points.write(stream, do_compress=True)
