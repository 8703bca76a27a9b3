"""Positions of photographs that a project file takes from other files: matched to their photographs, brought to the
project's CRS.

Errors are noted in the document under the entry that names the file, and carry that file's own line.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import FrameError, ProjectError
from photogram.files.tables.position_files import PositionFile, Triple, format_of
from photogram.files.tables.position_tables import read_positions
from photogram.geodesy.crs import WGS84, changes_datum
from photogram.geodesy.height_systems import HeightSystem
from photogram.gnss import Sigma3, Solution
from photogram.project.cross_checks import Located
from photogram.project.crs_units import differ, in_units_of_crs
from photogram.project.document import Document, Key
from photogram.project.heights import Placed, ProjectMap
from photogram.project.positions.matching import Matching, match_rows
from photogram.project.schema import PhotographEntry, PositionFileEntry, PositionOf, ProjectFile
from photogram.wording import shortened


@dataclass(frozen=True, eq=False)
class FilePosition:
    """The position of one photograph from a position file."""

    source: str
    """The file as the project names it."""
    position_map_m: FloatArray
    """Position (3,) in the project's CRS."""
    heights: HeightSystem | None
    """Height system it was given in."""
    sigma_m: Sigma3 | None
    """Standard deviations."""
    solution: Solution
    """Kind of the GNSS solution."""
    position_of: PositionOf
    """Whether it is that of the camera or the antenna."""
    gps_time: datetime | None = None
    """GPS time."""
    attitude_deg: Triple | None = None
    """Yaw, pitch and roll of the aircraft, None if not given."""
    lever_arm_m: Triple | None = None
    """Lever arm from antenna to camera along true east, true north and up, None if not given."""
    by_order: bool = False
    """True if only the order of the file assigns it to the photograph."""
    of_other_datum: bool = False
    """True if it came from another datum than the map's."""


def read_position_files(
    document: Document,
    file: ProjectFile,
    photographs: Sequence[PhotographEntry] | None,
    folder: Path | None,
    target: ProjectMap | None,
) -> tuple[dict[str, FilePosition], list[Located]]:
    """Return the positions of all files by the names of the photographs, and where they lie, for the checks.

    ``photographs`` in ``folder`` are None where they are not known, and so is the map ``target``. What is wrong is
    noted in the document.
    """
    of_photograph: dict[str, FilePosition] = {}
    located: list[Located] = []
    for i, entry in enumerate(file.photographs.positions):
        key: Key = ("photographs", "positions", i)
        read = None if entry.path is None else _read(document, key, entry.path, entry)
        _check_entry(document, key, entry)
        if read is None or photographs is None:
            continue
        matching = _matched(document, key, entry, read, _scope(entry, read.path, photographs, folder))
        if read.crs is not None and entry.crs is not None and differ(read.crs, entry.crs):
            text = f"{entry.path} names {shortened(read.crs)} itself: keep one of the two"
            document.add_error((*key, "crs"), text)
            continue
        for note in read.notes:
            document.warn(key, f"{entry.path}: {note.text}", note.remedy)
        crs = entry.crs or read.crs or (WGS84 if read.geographic else str(file.crs))
        placed = None if target is None else _placed(document, key, entry, read, crs, target)
        if placed is None:
            continue
        changed = changes_datum(crs, str(file.crs))
        arms = _lever_arms(document, key, entry, photographs, folder)
        number = {row.line: n for n, row in enumerate(read.rows)}
        for name, row in matching.rows.items():
            place, turned = (array[number[row.line]] for array in (placed.map_m, placed.turned_map_m))
            line = f"{entry.path}:{row.line}"
            located.append(Located(key, place, turned, line=line, name=name))
            if name in of_photograph:
                other = of_photograph[name].source
                text = f"{line}: {name} has a position in {other} too: keep one of the two"
                document.add_error(key, text)
            else:
                whose: PositionOf = entry.position_of or ("antenna" if read.format == "pos" else "camera")
                of_photograph[name] = FilePosition(
                    source=str(entry.path),
                    position_map_m=place,
                    heights=placed.heights,
                    sigma_m=row.sigma_m,
                    solution=row.solution,
                    position_of=whose,
                    gps_time=row.gps_time,
                    attitude_deg=row.attitude_deg,
                    lever_arm_m=arms.get(name, row.lever_arm_m) if whose == "antenna" else None,
                    by_order=read.format == "pos",
                    of_other_datum=changed,
                )
    return of_photograph, located


def _read(document: Document, key: Key, written: str, entry: PositionFileEntry | None = None) -> PositionFile | None:
    """Return what a file holds, None where it cannot be read; its errors name the file as the project does."""
    path = document.base / written
    try:
        return read_positions(path) if entry is None else read_positions(path, entry.format, entry.columns)
    except ProjectError as error:
        document.add_errors_of(key, error, path, written)
        return None


def _check_entry(document: Document, key: Key, entry: PositionFileEntry) -> None:
    if entry.path is None:
        return
    kind = entry.format or format_of(Path(entry.path))
    if kind == "csv" and entry.position_of is None:
        document.add_error(
            key,
            "positions of camera or antenna? give position_of: camera, or position_of: antenna where the "
            "program that wrote "
            f"{entry.path} did not apply the lever arm",
        )
    if entry.lever_arms is not None and (kind == "mrk" or entry.position_of == "camera"):
        document.add_error(
            (*key, "lever_arms"), "lever arms from another file are for positions of the antenna: remove this key"
        )


def _scope(
    entry: PositionFileEntry, path: Path, photographs: Sequence[PhotographEntry], folder: Path | None
) -> list[str]:
    """Return the photographs that a file may be about: those of its flight, and of an MRK those in its own folder
    where there are any."""
    named = [p for p in photographs if p.name is not None and entry.flight in (None, p.flight)]
    names = [p.name for p in named if p.name is not None]
    if path.suffix.lower() != ".mrk" or folder is None:
        return names
    here = path.parent.resolve()
    own = [name for name in names if (folder / name).parent.resolve() == here]
    return own or names


def _matched(
    document: Document, key: Key, entry: PositionFileEntry, read: PositionFile, names: Sequence[str]
) -> Matching:
    matching = match_rows(read, names)
    if matching.error:
        document.add_error(key, f"{entry.path}: {matching.error}")
    return matching


def _lever_arms(
    document: Document,
    key: Key,
    entry: PositionFileEntry,
    photographs: Sequence[PhotographEntry],
    folder: Path | None,
) -> dict[str, Triple]:
    """Return the lever arms by photograph that an MRK gives for the positions of another file."""
    if entry.lever_arms is None:
        return {}
    place: Key = (*key, "lever_arms")
    if format_of(Path(entry.lever_arms)) != "mrk":
        text = f"{entry.lever_arms} is not an MRK file: only these contain a lever arm for each photograph"
        document.add_error(place, text)
        return {}
    read = _read(document, place, entry.lever_arms)
    if read is None:
        return {}
    matching = match_rows(read, _scope(entry, read.path, photographs, folder))
    if matching.error:
        document.add_error(place, f"{entry.lever_arms}: {matching.error}")
    return {name: row.lever_arm_m for name, row in matching.rows.items() if row.lever_arm_m is not None}


def _placed(
    document: Document, key: Key, entry: PositionFileEntry, read: PositionFile, crs: str, target: ProjectMap
) -> Placed | None:
    """Return the positions of a file in the map, None where they cannot be brought there; heights of an MRK or .pos
    file are above the ellipsoid."""
    if read.format != "csv" and entry.crs is not None:
        document.add_error(
            (*key, "crs"), f"a {read.format.upper()} file is in WGS 84 longitude and latitude: remove this"
        )
        return None
    if read.format != "csv" and entry.heights == "orthometric":
        document.add_error((*key, "heights"), f"a {read.format.upper()} file is above the ellipsoid: remove this")
        return None
    given = np.array([row.position for row in read.rows]).reshape(-1, 3)
    declared: HeightSystem | None = entry.heights if read.format == "csv" else "ellipsoidal"
    if read.heights_ellipsoidal:
        if declared == "orthometric":
            text = (
                f"is orthometric, but {entry.path} has ellipsoidal heights, as its columns say: correct one of the two"
            )
            document.add_error((*key, "heights"), text)
        declared = "ellipsoidal"
    try:
        given = in_units_of_crs(document, key, str(entry.path), crs, given, read.unit_m)
        return target.placed(crs, declared, target.heights.gnss_given, given)
    except FrameError as error:
        document.add_error((*key, "crs") if entry.crs else key, f"{entry.path}: {str(error).removeprefix('crs: ')}")
        return None
