"""The CRS of a project file taken from files of WKT, and its list of positions brought from the CRS's units to m."""

from collections.abc import Sequence
from os.path import isfile  # false, not an exception, for a name that cannot be
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import FrameError
from photogram.files.tables.column_units import UnitsM, in_words
from photogram.geodesy.crs import MapUnits, map_units, product_crs, same_plan
from photogram.geodesy.height_systems import DeclaredHeights
from photogram.project.document import Document, Key
from photogram.project.schema import ProjectFile
from photogram.wording import shortened

WKT_SUFFIXES = (".wkt", ".wkt2", ".prj")
MOST_BYTES = 100_000

Place = tuple[float, float, float]


def crs_of_file(path: Path) -> str:
    """Return the CRS that a file of WKT holds. Raises FrameError where it cannot be read."""
    if not isfile(path):
        raise FrameError(f"file {path} not found: give the path of a CRS as WKT, relative to this file")
    try:
        with path.open("rb") as stream:
            text = stream.read(MOST_BYTES + 1)
        if len(text) > MOST_BYTES:
            raise FrameError(f"{path} has more than {MOST_BYTES // 1000} kB, which is no CRS: give a file of WKT")
        return " ".join(text.decode("utf-8-sig").split())
    except OSError as error:
        raise FrameError(f"{path} cannot be read ({error.strerror}): give a file of WKT") from error
    except UnicodeDecodeError as error:
        raise FrameError(f"{path} is not text: give a file of WKT") from error


def _read(document: Document, key: Key, written: str | None) -> str | None:
    if written is None or Path(written).suffix.lower() not in WKT_SUFFIXES or "[" in written:
        return written
    try:
        return crs_of_file(document.base / written)
    except FrameError as error:
        document.add_error(key, str(error))
        return None


def with_read_crs(document: Document, file: ProjectFile) -> ProjectFile:
    """Return the file with the text of each CRS that it names by the path of a file of WKT. A file that
    cannot be read is noted."""
    points = [
        entry.model_copy(update={"crs": _read(document, ("control_points", "files", i, "crs"), entry.crs)})
        for i, entry in enumerate(file.control_points.files)
    ]
    positions = [
        entry.model_copy(update={"crs": _read(document, ("photographs", "positions", i, "crs"), entry.crs)})
        for i, entry in enumerate(file.photographs.positions)
    ]
    return file.model_copy(
        update={
            "crs": _read(document, ("crs",), file.crs),
            "control_points": file.control_points.model_copy(update={"files": points}),
            "photographs": file.photographs.model_copy(update={"positions": positions}),
        }
    )


def differ(crs: str, other: str) -> bool:
    """Return whether two names mean different systems in plan."""
    if crs == other:
        return False
    try:
        return not same_plan(crs, other)
    except FrameError:
        return True  # not two grids: only the same name is the same system


def with_listed_in_metres(document: Document, file: ProjectFile, heights: DeclaredHeights) -> ProjectFile:
    """Return the file with the positions that it lists in the units of its CRS, ``position`` and ``gnss``, in metres,
    as ``position_m`` and ``gnss_m``.

    Noted are a CRS in feet that leaves open what heights are in, a position that is given both ways, and one in metres
    beside a CRS that does not count metres, where it would be neither.
    """
    try:
        units = None if file.crs is None else map_units(product_crs(file.crs, heights))
        if units is not None and not units.is_metric and heights.output is None:
            document.add_error(("crs",), _without_heights(str(file.crs), units))
    except FrameError:
        units = None  # noted where the project names its CRS
    listed = file.photographs.list
    surveyed = [(p.position, p.position_m) for p in file.control_points.list]
    measured = [(p.gnss, p.gnss_m) for p in listed or ()]
    points = _all_in_metres(document, ("control_points", "list"), "position", surveyed, units)
    gnss = _all_in_metres(document, ("photographs", "list"), "gnss", measured, units)
    control = [
        entry.model_copy(update={"position_m": place})
        for entry, place in zip(file.control_points.list, points, strict=True)
    ]
    photographs = listed and [
        entry.model_copy(update={"gnss_m": place}) for entry, place in zip(listed, gnss, strict=True)
    ]
    return file.model_copy(
        update={
            "control_points": file.control_points.model_copy(update={"list": control}),
            "photographs": file.photographs.model_copy(update={"list": photographs}),
        }
    )


def _without_heights(crs: str, units: MapUnits) -> str:
    return (
        f"{shortened(crs)} is in {units.plan} and leaves open what heights are in: add its vertical CRS "
        "(EPSG:2263+6360 has NAVD88 heights in US survey feet, EPSG:2263+5703 in metres), or heights: ellipsoidal, "
        "which then are in the unit of the plan"
    )


def _all_in_metres(
    document: Document, key: Key, name: str, places: Sequence[tuple[Place | None, Place | None]], units: MapUnits | None
) -> list[Place | None]:
    """Return places in metres, of places in the units of the CRS and in metres; what is in metres beside a CRS in feet
    is noted once for a whole list, and left out."""
    twice = [i for i, (given, metric) in enumerate(places) if given is not None and metric is not None]
    for i in twice:
        document.add_error((*key, i, name), f"is given here and as {name}_m: keep one of the two")
    if units is None:
        return [metric or given for given, metric in places]
    metres = [i for i, (_, metric) in enumerate(places) if metric is not None and not units.is_metric]
    if metres:
        more = f", and the {len(metres) - 1} others in metres too" if len(metres) > 1 else ""
        text = f"the crs is in {units.words}: write {name}, in the units of the crs{more}"
        document.add_error((*key, metres[0], f"{name}_m"), text)
    return [_in_metres(given, units) or (metric if units.is_metric else None) for given, metric in places]


def _in_metres(given: Place | None, units: MapUnits) -> Place | None:
    if given is None:
        return None
    easting, northing, height = (np.array(given) * units.factors).tolist()
    return easting, northing, height


def in_units_of_crs(document: Document, key: Key, path: str, crs: str, given: FloatArray, unit_m: UnitsM) -> FloatArray:
    """Return positions (N, 3) whose columns in the file ``path`` state the units ``unit_m`` in those of their CRS, and
    warn where that changes them. Raises FrameError as ``map_units`` where the CRS is none."""
    try:
        own = map_units(crs).factors
        plan: UnitsM = unit_m
    except FrameError:
        own, plan = np.ones(3), (None, None, unit_m[2])  # longitude and latitude: a height alone has a length
    factor = np.array([1.0 if unit is None else unit / axis for unit, axis in zip(plan, own, strict=True)])
    if np.all(factor == 1.0):
        return given
    text = f"{path}: {in_words(plan)}, as its columns say, brought to the unit of {shortened(crs)}"
    document.warn(key, text, "correct the names of its columns if they are wrong")
    return np.asarray(given * factor)
