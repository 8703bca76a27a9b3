"""Where the ground points of a file lie in the map: by the CRS that the file or its entry names, in the order of the
figures that this CRS allows, checked against longitude and latitude where the file has them too.

Errors are noted in the document under the entry that names the file.
"""

from dataclasses import replace

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import FrameError
from photogram.files.tables.point_file import PointFile
from photogram.geodesy.crs import NO_CRS, WGS84, map_units, plan_of
from photogram.geodesy.frames import map_from_crs
from photogram.geodesy.height_systems import HeightSystem
from photogram.project.cross_checks import AreaOfUse
from photogram.project.crs_units import differ, in_units_of_crs
from photogram.project.document import Document, Key
from photogram.project.heights import Placed, ProjectMap, is_grid
from photogram.project.schema import ControlFileEntry, ProjectFile
from photogram.wording import shortened, some, things

FARTHEST_M, NEAR_M = 1000.0, 20.0
"""Easting and northing lie in another CRS where they are farther than the first from longitude and latitude of the same
points, and may where they are farther than the second: a missing grid of datum shifts, or a localisation."""


def crs_of(document: Document, file: ProjectFile, key: Key, entry: ControlFileEntry, points: PointFile) -> str | None:
    """Return the CRS of the points of a file, None with an error noted where it cannot be known."""
    if points.crs is not None and entry.crs is not None and differ(points.crs, entry.crs):
        where = "in its first line" if points.format == "gcp_list" else "itself"
        document.add_error((*key, "crs"), f"{entry.path} names {shortened(points.crs)} {where}: keep one of the two")
        return None
    if points.format == "gcp_list" and points.crs is None and entry.crs is None:
        line = points.points[0].line if points.points else 1
        text = "the first line must name the CRS, EPSG:32617 for example: add it, or give crs in the project file"
        document.add_error(key, f"{entry.path}:{line}: {text}")
        return None
    return entry.crs or points.crs or file.crs


def _given(points: PointFile) -> FloatArray:
    return np.array([p.position for p in points.points]).reshape(-1, 3)


def _exchanged(points: PointFile) -> PointFile:
    """Return a file whose first two coordinates are the other way round, with their sigmas and units."""
    first, second, up = points.unit_m
    rows = []
    for point in points.points:
        (x, y, z), (sx, sy, sz) = point.position or (np.nan,) * 3, point.sigma_m
        rows.append(replace(point, position=(y, x, z), sigma_m=(sy, sx, sz)))
    return replace(points, points=tuple(rows), unit_m=(second, first, up))


def _fits(points: PointFile, crs: str) -> bool | None:
    """Return whether all points lie where a CRS is used, None where that is not known of it."""
    given = _given(points)
    if not is_grid(crs):
        return bool((np.abs(given[:, :2]) <= (180.0, 90.0)).all())
    area = AreaOfUse.of(crs)
    return None if area is None else bool(area.contains(map_units(crs).in_metres(given)[:, :2]).all())


def in_order(document: Document, key: Key, path: str, points: PointFile, crs: str) -> PointFile | None:
    """Return a file with easting or longitude first, where that is open and ``crs`` decides it, said as a warning; None
    with an error noted where nothing decides it and the file names no columns. Raises FrameError where the CRS is
    none."""
    if not points.is_order_open or not points.points:
        return points
    turned = _exchanged(points)
    as_written, exchanged = _fits(points, crs), _fits(turned, crs)
    first, second = ("easting", "northing") if is_grid(crs) else ("longitude", "latitude")
    if exchanged and as_written is False:
        order = f"{second}, {first}, height"
        text = f"{path}: read as {order}: the other way round its points lie outside {shortened(crs)}"
        document.warn(key, text, f"name its columns, or give columns: [name, {order}]")
        return replace(turned, is_order_open=False)
    if points.is_named or (as_written and exchanged is False):
        return replace(points, is_order_open=False)
    line, x, y = points.points[0].line, *(f"{v:.10g}" for v in _given(points)[0, :2])
    document.add_error(
        key,
        f"{path}:{line}: no line names the columns, and {x} and {y} may be {first} and {second} or the reverse: give "
        f"columns: [name, {first}, {second}, height], or {second} before {first}",
    )
    return None


def _in_degrees(what: str, crs: str) -> str:
    return f"the {what} longitude and latitude, but {shortened(crs)} is a map grid: give crs: {WGS84}, or similar"


def _are_degrees(document: Document, key: Key, points: PointFile, crs: str) -> bool:
    """Return whether figures that no column calls so look like degrees although their CRS is a map grid, with an
    error noted."""
    if points.geographic is not None or not points.points or not is_grid(crs) or crs == NO_CRS:
        return False
    if _fits(points, crs) is not False or not (np.abs(_given(points)[:, :2]) <= 180.0).all():
        return False
    document.add_error(key, _in_degrees("figures look like", crs))
    return True


def _by_geodetic(document: Document, key: Key, path: str, points: PointFile, crs: str) -> PointFile | None:
    """Return a file as it is to be read in ``crs``: its longitude and latitude in a geographic CRS, its easting and
    northing in a map grid; None with an error noted where it has no such columns."""
    if points.geographic and is_grid(crs):
        document.add_error(key, _in_degrees("columns are", crs))
        return None
    if points.geographic is False and not is_grid(crs):
        if points.geodetic is None:
            text = f"the columns are easting and northing, but {shortened(crs)} has longitude and latitude"
            document.add_error(key, f"{text}: give the map grid of {path} as crs")
            return None
        degrees = [
            replace(point, position=(lon, lat, (point.position or (0.0, 0.0, np.nan))[2]))
            for point, (lon, lat) in zip(points.points, points.geodetic, strict=True)
        ]
        return replace(points, points=tuple(degrees), geographic=True, unit_m=(None, None, points.unit_m[2]))
    return points


def _contradicted(document: Document, key: Key, path: str, points: PointFile, crs: str) -> bool:
    """Return whether easting and northing lie elsewhere than longitude and latitude of the same rows, with an error
    noted; where they may, a warning."""
    if points.geographic is not False or points.geodetic is None or not is_grid(crs) or crs == NO_CRS:
        return False
    degrees = np.column_stack([np.array(points.geodetic), np.zeros(len(points.geodetic))])
    own = map_units(crs).in_metres(in_units_of_crs(document, key, path, crs, _given(points), points.unit_m))
    away_m = float(np.median(np.hypot(*(own - map_from_crs(WGS84, plan_of(crs), degrees))[:, :2].T)))
    if away_m <= NEAR_M:
        return False
    called = f"; the file calls their system {shortened(points.cs_name)!r}" if points.cs_name else ""
    far = f"{away_m / 1000.0:.0f} km" if away_m >= 10_000.0 else f"{away_m:.0f} m"
    text = f"{path}: easting and northing lie {far} from longitude and latitude of the same rows, read in {crs}{called}"
    if away_m > FARTHEST_M:
        document.add_error(key, f"{text}: give their CRS as crs, or crs: {WGS84} to use longitude and latitude")
        return True
    document.warn(
        key, text, "check crs; a localisation of the receiver, or a missing grid of datum shifts, does so too"
    )
    return False


def _declared(document: Document, key: Key, entry: ControlFileEntry, points: PointFile) -> HeightSystem | None:
    """Return the height system that the entry declares, else the one that the file's columns name."""
    if entry.heights == "orthometric" and points.heights_ellipsoidal:
        text = f"is orthometric, but {entry.path} has ellipsoidal heights, as its columns say: correct one of the two"
        document.add_error((*key, "heights"), text)
    return entry.heights or ("ellipsoidal" if points.heights_ellipsoidal else None)


def in_map(
    document: Document, key: Key, entry: ControlFileEntry, points: PointFile, crs: str, target: ProjectMap | None
) -> tuple[PointFile, Placed | None]:
    """Return a file as it is read in ``crs``, and its positions in the map, None where they cannot be brought there."""
    if target is None:
        return points, None
    path = str(entry.path)
    for note in points.notes:
        document.warn(key, f"{path}: {note.text}", note.remedy)
    if points.unfixed:
        which = some([f"{name} {solution}" for name, solution in points.unfixed])
        text = f"{path}: {things(len(points.unfixed), 'point')} without a fixed GNSS solution: {which}"
        document.warn(key, text, "survey them again, or state their standard deviation")
    try:
        read = in_order(document, key, path, points, crs) if not _are_degrees(document, key, points, crs) else None
        read = None if read is None else _by_geodetic(document, key, path, read, crs)
        if read is None or _contradicted(document, key, path, read, crs):
            return points, None
        given = in_units_of_crs(document, key, path, crs, _given(read), read.unit_m)
        declared = _declared(document, key, entry, read)
        return read, target.placed(crs, declared, target.heights.control_points, given, exact=True)
    except FrameError as error:
        text = str(error).removeprefix("crs: ")
        document.add_error((*key, "crs") if entry.crs else key, f"{entry.path}: {text}")
        return points, None
