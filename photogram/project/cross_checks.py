"""Errors of a project file that show only when its blocks are read together; photographs are looked for, not opened.

Every check notes its errors in the document and skips what an earlier error has made unknown.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from os.path import isdir, isfile  # false, not an exception, for a name that cannot be
from pathlib import Path

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.errors import FrameError
from photogram.files.photographs.names import SUFFIXES, twins
from photogram.geodesy.crs import NO_CRS, crs_label, projected_crs
from photogram.geodesy.frames import map_from_geodetic
from photogram.project.constraints import check_constraints, used_points
from photogram.project.document import Document, Key, suggestion
from photogram.project.misplaced import other_reading, zones_within
from photogram.project.schema import (
    PIXEL_ORIGIN_PX,
    CameraEntry,
    ControlPointEntry,
    PhotographEntry,
    ProjectFile,
)
from photogram.wording import printable

FARTHEST_KM = 20.0
"""A position farther than this from the middle of all others is taken for a slip of the pen."""

LONGEST_NAME, LONGEST_PATH = 255, 3800
"""Of a file or folder and of its whole path, in bytes: Linux has 255 and 4096, and the results have names of their
own."""

LARGEST_DISTORTION = 10.0
"""Of one term at the corner of a picture, in the corner's own distance from the middle; terms of wide lenses of some
calibrations grow large and undo each other."""

LOWEST_M, HIGHEST_M = -500.0, 9000.0
"""Heights on Earth."""

FARTHEST_HEIGHT_M = 1000.0
"""A height farther than this from the middle of all others is taken for a slip of the pen."""

_PLACEHOLDERS_M = (999.0, 9999.0, 99999.0, 32767.0, 32768.0)
_PLACEHOLDER_DISTANCE_M = 100.0
_LIST: Key = ("photographs", "list")


@dataclass(frozen=True, eq=False)
class Located:
    """A position (3,) of the project in its CRS, and where its figures would lie the other way round.

    ``key`` is where the project file names it; ``columns`` are what its first two figures are. Of a position that comes
    from another file ``line`` is that file and the line, and ``name`` what has it, ``crs`` its CRS.
    """

    key: Key
    map_m: FloatArray
    turned_map_m: FloatArray
    columns: tuple[str, str] = ("easting", "northing")
    line: str = ""
    name: str = ""
    crs: str = ""

    @property
    def label(self) -> str:
        """Return what an error begins with; empty where the project file itself has the position."""
        return f"{self.line}: {self.name}: " if self.line else ""


@dataclass(frozen=True)
class AreaOfUse:
    """Where a CRS is used, as ranges of easting and northing, and the wider ranges in which it is still accepted."""

    low_m: FloatArray
    high_m: FloatArray
    crs: str

    @classmethod
    def of(cls, name: str) -> AreaOfUse | None:
        """Return the area of use of a CRS, None where its definition gives none. Raises FrameError as projected_crs."""
        if name == NO_CRS:
            return None
        crs = projected_crs(name)
        area = crs.area_of_use
        if area is None:
            return None
        east = area.east + 360.0 if area.west > area.east else area.east
        lon, lat = np.meshgrid(np.linspace(area.west, east, 25), np.linspace(area.south, area.north, 25))
        try:
            corners = map_from_geodetic(name, np.column_stack([lon.ravel(), lat.ravel(), np.zeros(lon.size)]))[:, :2]
        except FrameError:
            return None  # the area reaches to where the projection has no values, a pole for example
        return cls(corners.min(axis=0), corners.max(axis=0), f"{crs_label(name)} ({crs.name})")

    def contains(self, easting_northing_m: FloatArray) -> BoolArray:
        """Return which positions (N, 2) are accepted; NaN is not."""
        # zones are often used some degrees beyond their official area
        margin = np.minimum(0.5 * (self.high_m - self.low_m), 300_000.0)
        inside = (easting_northing_m >= self.low_m - margin) & (easting_northing_m <= self.high_m + margin)
        return np.asarray(inside.all(axis=-1))

    def __str__(self) -> str:
        (e0, n0), (e1, n1) = self.low_m / 1000.0, self.high_m / 1000.0
        return f"the area of use of {self.crs}, easting {e0:.0f} to {e1:.0f} km, northing {n0:.0f} to {n1:.0f} km"


def photographs_of(document: Document, file: ProjectFile, folder: Path | None) -> list[PhotographEntry] | None:
    """Return the photographs listed, or all in ``folder`` where there is no list; None where neither can be known."""
    if file.photographs.list is not None:
        if not file.photographs.list:
            document.add_error(_LIST, "is empty: list the photographs, or remove the list to use all in the folder")
        return list(file.photographs.list)
    if document.has(_LIST) or folder is None:
        return None
    key: Key = ("photographs", "folder")
    if not isdir(folder):
        document.add_error(key, f"folder {folder} not found: give it with --photographs DIR")
        return None
    try:
        there = [p.name for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file()]
        names = sorted(set(there) - twins(there).keys())
    except OSError as error:
        document.add_error(key, f"the folder {folder} cannot be read ({error.strerror})")
        return None
    odd = [name for name in names if not name.isprintable()]
    if odd:
        text = f"the name {printable(odd[0])} has unprintable characters: rename it"
        document.add_error(key, text + (f", and {len(odd) - 1} more" if len(odd) > 1 else ""))
    if not names:
        document.add_error(key, f"no photographs in {folder}: give their folder with --photographs DIR")
    return [PhotographEntry(name=name) for name in names]


def camera_of(file: ProjectFile, photograph: PhotographEntry) -> str | None:
    """Return the name of a photograph's camera: its own, the one of all photographs, or the only one there is."""
    only = next(iter(file.cameras)) if len(file.cameras) == 1 else None
    return photograph.camera or file.photographs.camera or only


def check_entries(
    document: Document,
    file: ProjectFile,
    photographs: Sequence[PhotographEntry] | None,
    folder: Path | None,
    files: Sequence[Sequence[Located]] = (),
    positions: Sequence[Located] = (),
    checks: Collection[str] = (),
) -> None:
    """Run every check; ``folder`` holds the photographs, ``files`` are the points and ``positions`` the photographs'
    positions that come from other files, ``checks`` the names of those points that are check points."""
    base = document.base
    if file.photogram not in (None, 1):
        document.add_error(("photogram",), f"format {file.photogram} is not supported: this version reads photogram: 1")
    for name, camera in file.cameras.items():
        _check_camera(document, ("cameras", name), camera)
    _check_photographs(document, file, photographs or ())
    flights = {p.flight for p in photographs or ()}
    for flight in file.gnss.lever_arm_per_flight_m:
        if photographs is not None and flight not in flights:
            text = f"unknown flight {flight!r}: {suggestion(flight, flights)}"
            document.add_error(("gnss", "lever_arm_per_flight_m", flight), text)
    if file.photographs.list and folder is not None:
        _check_files(document, file.photographs.list, folder)
    _check_control_points(document, file, photographs)
    _check_constraints(document, file, photographs, files, checks)
    _check_positions(document, file, files, positions)
    reference = file.comparison.reference
    if reference is not None and not isfile(base / reference):
        document.add_error(("comparison", "reference"), f"file {base / reference} not found")
    for name, place in (("results", base / file.results), ("work", base / file.work)):
        _check_path(document, (name,), place)


def _check_path(document: Document, key: Key, path: Path) -> None:
    """Note where a folder cannot have its name, or libraries could not write into it."""
    try:
        parts = [len(part.encode("utf-8")) for part in path.parts]
    except UnicodeEncodeError:
        text = f"the path {printable(str(path))} is not UTF-8: rename its folders, or choose another"
        document.add_error(key, text)
        return
    if max(parts) > LONGEST_NAME or sum(parts) + len(parts) > LONGEST_PATH:
        text = f"has a name of {max(parts)} bytes in a path of {sum(parts) + len(parts)}"
        document.add_error(key, f"{text}, at most {LONGEST_NAME} and {LONGEST_PATH} can be used: choose shorter names")


def _check_distortion(document: Document, key: Key, camera: CameraEntry) -> None:
    """Note distortion that would move the corners of the picture by more than LARGEST_DISTORTION times their distance
    from its middle."""
    if camera.focal_px is None or camera.width_px is None or camera.height_px is None:
        return
    corner = float(np.hypot(camera.width_px, camera.height_px)) / 2 / camera.focal_px
    terms = [
        *(("radial", f"k{i}", k, corner ** (2 * i)) for i, k in enumerate(camera.radial or (), 1)),
        *(("tangential", f"p{i}", p, 3 * corner) for i, p in enumerate(camera.tangential or (), 1)),
        *(("affinity", f"b{i}", b, 1 / camera.focal_px) for i, b in enumerate(camera.affinity or (), 1)),
    ]
    for name, term, value, lever in terms:
        most = LARGEST_DISTORTION / lever
        if abs(value) > most:
            document.add_error(
                (*key, name),
                f"{term} must be from {-most:.3g} to {most:.3g} for a picture of {camera.width_px} × "
                f"{camera.height_px} px and a focal length of {camera.focal_px:.10g} px, found {value:.10g}: "
                "check the order of the terms and the conventions of the program they come from",
            )


def _check_camera(document: Document, key: Key, camera: CameraEntry) -> None:
    _check_distortion(document, key, camera)
    figures = ("focal_px", "principal_point_px", "radial", "tangential", "affinity")
    if camera.matlab is None:
        for name in figures[:2]:
            if getattr(camera, name) is None and document.has(key) and not document.has((*key, name)):
                document.add_error((*key, name), f"is missing: give {name}, or matlab: FILE.mat with the calibration")
        return
    for name in figures:
        if document.has((*key, name)):
            document.add_error((*key, name), f"is given here and in {camera.matlab}: keep one of the two")
    if document.has((*key, "model")):
        document.add_error((*key, "model"), f"{camera.matlab} contains a Brown camera: remove model")
    if not isfile(document.base / camera.matlab):
        document.add_error((*key, "matlab"), f"file {document.base / camera.matlab} not found")
    origin: Key = (*key, "pixel_origin")
    if not document.has(origin):
        document.add_error(
            (*key, "matlab"),
            "pixel_origin is missing: matlab if the calibration counts pixels from (1, 1), photogram if from (0, 0)",
        )
    elif camera.pixel_origin == "colmap":
        document.add_error(origin, "must be matlab or photogram for a .mat file, found 'colmap'")


def _check_twice(document: Document, key: Key, names: Sequence[str | None]) -> None:
    first: dict[str, int] = {}
    for i, name in enumerate(names):
        if name is not None and first.setdefault(name, i) != i:
            line = document.line((*key, first[name], "name"))
            document.add_error(
                (*key, i, "name"), f"{name!r} is used twice, first in line {line}: give each its own name"
            )


def _check_camera_name(document: Document, key: Key, name: str | None, cameras: Mapping[str, CameraEntry]) -> None:
    if name is not None and name not in cameras and document.has(("cameras",)):
        document.add_error(key, f"camera {name!r} is not under cameras: {suggestion(name, cameras.keys())}")


def _check_photographs(document: Document, file: ProjectFile, photographs: Sequence[PhotographEntry]) -> None:
    _check_twice(document, _LIST, [p.name for p in photographs])
    _check_camera_name(document, ("photographs", "camera"), file.photographs.camera, file.cameras)
    has_default = document.has(("photographs", "camera"))
    listed = file.photographs.list is not None
    for i, photograph in enumerate(photographs):
        key: Key = (*_LIST, i) if listed else ("photographs",)
        _check_camera_name(document, (*key, "camera"), photograph.camera, file.cameras)
        if len(file.cameras) > 1 and photograph.camera is None and not has_default:
            document.add_error(key, f"which camera? give camera: one of {', '.join(file.cameras)}")
        has_sigma = document.has((*key, "gnss_sigma_m"), ("photographs", "gnss_sigma_m"))
        if photograph.gnss_m is not None and not has_sigma:
            text = "has no standard deviation: give gnss_sigma_m, here or for all photographs"
            document.add_error((*key, "gnss_m"), text)


def _check_files(document: Document, photographs: Sequence[PhotographEntry], folder: Path) -> None:
    names = list(dict.fromkeys(p.name for p in photographs if p.name is not None))
    missing = [name for name in names if not isfile(folder / name)]
    if missing:
        place = f"in {folder}" if isdir(folder) else f"there: folder {folder} not found"
        document.add_error(
            ("photographs", "folder"),
            f"{len(missing)} of {len(names)} photographs are not {place}: {', '.join(missing)}: "
            "put them there, or give their folder with --photographs DIR",
        )


def _check_control_points(document: Document, file: ProjectFile, photographs: Sequence[PhotographEntry] | None) -> None:
    points = file.control_points
    key: Key = ("control_points", "list")
    _check_twice(document, key, [p.name for p in points.list])
    ends = used_points(file)
    for i, point in enumerate(points.list):
        own: Key = (*key, i)
        needed = [("sigma_m", "standard deviation")] if point.position_m is not None else []
        needed += [("mark_sigma_px", "standard deviation of its marks")] if point.marks else []
        for name, what in needed if document.has(own) else ():
            if not document.has((*own, name), ("control_points", name)):
                document.add_error(own, f"the point has no {what}: give {name}, here or for all points")
        has_position = point.position_m is not None or document.has((*own, "position_m"), (*own, "position"))
        if point.name not in ends and not has_position:
            text = "position_m is missing: [easting, northing, height] in the map grid, in metres"
            document.add_error(own, f"{text}; without it a point only serves a distance or another constraint")
        if photographs is not None:
            _check_marks(document, file, (*own, "marks"), point, photographs)


def _check_constraints(
    document: Document,
    file: ProjectFile,
    photographs: Sequence[PhotographEntry] | None,
    files: Sequence[Sequence[Located]],
    of_files: Collection[str],
) -> None:
    points = {p.name for p in file.control_points.list if p.name is not None}
    checks = {
        p.name
        for p in file.control_points.list
        if p.name is not None and p.position_m is not None and "control" not in p.role
    }
    points |= {place.name for place in chain.from_iterable(files)}
    photograph_names = None if photographs is None else {p.name for p in photographs if p.name is not None}
    check_constraints(document, file, points, photograph_names, checks.union(of_files))


def _check_marks(
    document: Document, file: ProjectFile, key: Key, point: ControlPointEntry, photographs: Sequence[PhotographEntry]
) -> None:
    by_name = {p.name: p for p in photographs if p.name is not None}
    origin = PIXEL_ORIGIN_PX[file.control_points.pixel_origin]
    for name, (u, v) in point.marks.items():
        if name not in by_name:
            document.add_error(
                (*key, name), f"photograph {name!r} is not in the list: {suggestion(name, by_name.keys())}"
            )
            continue
        camera = file.cameras.get(camera_of(file, by_name[name]) or "")
        if camera is None or camera.width_px is None or camera.height_px is None:
            continue
        width, height = camera.width_px, camera.height_px
        if not (-0.5 <= u - origin <= width - 0.5 and -0.5 <= v - origin <= height - 0.5):
            document.add_error(
                (*key, name),
                f"the mark of {point.name} at pixel ({u:.10g}, {v:.10g}) is outside the photograph, which is "
                f"{width} × {height} px: check the order (u right, v down), the digits and the photograph",
            )


def _check_positions(
    document: Document, file: ProjectFile, files: Sequence[Sequence[Located]], positions: Sequence[Located]
) -> None:
    crs, area = None, None
    if file.crs is not None and file.crs != NO_CRS:
        try:
            area = AreaOfUse.of(file.crs)
            crs = file.crs
        except FrameError as error:
            document.add_error(("crs",), str(error).removeprefix("crs: "))
    control = _listed(
        [(("control_points", "list", i, "position_m"), p.position_m) for i, p in enumerate(file.control_points.list)]
    )
    gnss = _listed([((*_LIST, i, "gnss_m"), p.gnss_m) for i, p in enumerate(file.photographs.list or ())])
    gnss += positions
    _check_plan(document, crs, area, [control, *files, gnss])
    for group in ([*control, *chain.from_iterable(files)], gnss):
        _check_heights(document, group)


def _listed(positions: Sequence[tuple[Key, tuple[float, float, float] | None]]) -> list[Located]:
    return [Located(key, np.array(p), np.array([p[1], p[0], p[2]])) for key, p in positions if p is not None]


def _check_plan(
    document: Document, crs: str | None, area: AreaOfUse | None, groups: Sequence[Sequence[Located]]
) -> None:
    """Note swapped, distant and foreign positions; one error for a whole list or file that has the same."""
    every = list(chain.from_iterable(groups))
    if not every:
        return
    plan, turned = np.array([p.map_m[:2] for p in every]), np.array([p.turned_map_m[:2] for p in every])
    foreign = np.zeros(len(plan), dtype=bool) if area is None else ~area.contains(plan)
    swapped = foreign & area.contains(turned) if area is not None else foreign.copy()
    distance_km = np.zeros(len(plan))
    if not foreign.all():
        middle = np.median(plan[~foreign], axis=0)
        distance_km = np.hypot(*(plan - middle).T) / 1000.0
        swapped |= (distance_km > FARTHEST_KM) & (np.hypot(*(turned - middle).T) / 1000.0 <= FARTHEST_KM)
    foreign &= ~swapped
    distant = ~foreign & ~swapped & (distance_km > FARTHEST_KM)
    texts = (
        (swapped, "{} and {} look swapped", "write [easting, northing, height]"),
        (foreign, f"outside {area}", "check crs and the position"),
        (distant, f"more than {FARTHEST_KM:g} km from the centre of all positions", "check its digits"),
    )
    right = ~(swapped | foreign | distant)
    start = 0
    for group in groups:
        part = slice(start, start + len(group))
        start += len(group)
        for mask, text, remedy in texts:
            wrong = np.flatnonzero(mask[part])
            whole = len(wrong) == len(group) > 1
            for i in wrong[:1] if whole else wrong:
                place = group[i]
                where = f" in all {len(group)}, the first" if whole else ""
                figures = f"easting {place.map_m[0]:.2f}, northing {place.map_m[1]:.2f}"
                order = remedy
                if mask is swapped and place.line:
                    order = "give {} before {}".format(*place.columns)
                elif mask is not swapped and whole and crs is not None:
                    others = plan[right & ~np.isin(np.arange(len(plan)), np.arange(part.start, part.stop))]
                    reading = other_reading(crs, np.array([p.map_m for p in group]), others)
                    if reading is not None:
                        figures += f"; {reading[0]} they would lie among the others"
                        order = reading[1]
                    elif area is not None and place.crs:
                        map_m = np.array([p.map_m for p in group])
                        zones = zones_within(place.crs, crs, map_m, area.contains)
                        order = f"correct {place.crs} to {zones[0]}" if len(zones) == 1 else order
                document.add_error(
                    place.key if place.line or not whole else place.key[:2],
                    f"{place.label}{text.format(*place.columns)}{where}: found {figures}: {order}",
                )


def _check_heights(document: Document, places: Sequence[Located]) -> None:
    if not places:
        return
    height_m = np.array([place.map_m[2] for place in places])
    possible = (height_m >= LOWEST_M) & (height_m <= HIGHEST_M)
    middle = float(np.median(height_m[possible])) if possible.any() else 0.0
    for place, height in zip(places, height_m, strict=True):
        away = abs(height - middle)
        placeholder = abs(height) in _PLACEHOLDERS_M and away > _PLACEHOLDER_DISTANCE_M
        text = None
        if placeholder or not LOWEST_M <= height <= HIGHEST_M:
            text = "is impossible on Earth or a placeholder: give the surveyed height"
        elif away > FARTHEST_HEIGHT_M:
            text = f"is {away:.0f} m from the others, about {middle:.10g} m: check its digits"
        if text is not None:
            document.add_error(place.key, f"{place.label}height {height:.10g} m {text}")
