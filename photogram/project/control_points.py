"""Ground points that a project file takes from other files: positions brought to the project's CRS, sigmas and roles
filled in, marks brought to the photographs' own pixels.

Errors are noted in the document under the entry that names the file, and carry that file's own line.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import FloatArray, IntArray, check_shape
from photogram.errors import ControlPointError, FrameError
from photogram.files.marks.formats import read_marks, read_points
from photogram.files.marks.mark_table import MARKS, has_rows
from photogram.files.photographs.names import joined_names
from photogram.files.tables.point_file import PointFile
from photogram.files.tables.surveyed_points import IMPORTED, Mark, SurveyedPoint
from photogram.geodesy.height_systems import HeightSystem
from photogram.measures.mark_covariances import covariances_px2
from photogram.project.cross_checks import Located, camera_of
from photogram.project.document import Document, Key, suggestion
from photogram.project.heights import Placed, ProjectMap, is_grid
from photogram.project.mark_entries import as_marked, of_page
from photogram.project.positions.crs_units import in_units_of_crs
from photogram.project.schema import PIXEL_ORIGIN_PX, ControlFileEntry, PhotographEntry, ProjectFile
from photogram.survey import Role, Roles
from photogram.wording import shortened, some, things

ReadT = TypeVar("ReadT")

SHAPE_TOLERANCE = 0.005
"""How much width and height may differ in scale between the picture of the marks and the photograph."""

_MOST_NAMES = 5
_SMALLEST_ENLARGEMENT, _LARGEST_ENLARGEMENT = 1.2, 20.0


@dataclass(frozen=True, eq=False)
class ProjectControlPoint:
    """One surveyed point and its marks (M)."""

    name: str
    """Name."""
    roles: Roles
    """Role in plan and in height."""
    position_map_m: FloatArray
    """Surveyed position (3,), NaN for a point that is marked and not surveyed."""
    sigma_m: FloatArray
    """Standard deviations (3,)."""
    mark_photograph: NDArray[np.int64]
    """Indices (M,) among the project's photographs."""
    mark_pixel: FloatArray
    """Image coordinates (M, 2) in photogram's pixel frame."""
    mark_covariance_px2: FloatArray
    """Covariances (M, 2, 2) of u and v."""
    heights: HeightSystem | None = None
    """Height system it was given in, None if not declared."""
    mark_kind: tuple[str, ...] = ()
    """How they were measured (M,); IMPORTED, all of them, if not given."""
    sigma_assumed: bool = False
    """Whether a standard deviation of its position is only assumed, nobody having stated one."""
    mark_sigma_assumed: bool = False
    """The same of its marks."""
    line: str = ""
    """The file that it comes from and the line there, empty where that is the project file."""
    crs: str = ""
    """The CRS that its figures were given in, empty for the project's."""

    def __post_init__(self) -> None:
        marks = len(self.mark_photograph)
        check_shape("position_map_m", self.position_map_m, (3,))
        check_shape("sigma_m", self.sigma_m, (3,))
        check_shape("mark_pixel", self.mark_pixel, (marks, 2))
        check_shape("mark_covariance_px2", self.mark_covariance_px2, (marks, 2, 2))
        if marks and not self.mark_kind:
            object.__setattr__(self, "mark_kind", (IMPORTED,) * marks)
        if len(self.mark_kind) != marks:
            raise ValueError("every mark needs a kind")

    @property
    def role(self) -> Role:
        """Return ``control`` if any of its coordinates is, else ``check``."""
        return "control" if "control" in self.roles else "check"

    @property
    def controlled(self) -> NDArray[np.bool_]:
        """Return which of easting, northing and height (3,) are control."""
        plan, height = (role == "control" for role in self.roles)
        return np.array([plan, plan, height], dtype=bool)

    @property
    def control_map_m(self) -> FloatArray:
        """Return the position (3,), NaN where a coordinate is a check: those must not touch what is adjusted."""
        return np.where(self.controlled, self.position_map_m, np.nan)


@dataclass(frozen=True, eq=False)
class _Source:
    """One entry of control_points.files and what its files hold, ``marks`` those of the file and of the page;
    ``placed`` are its positions, None where unknown, ``columns`` what the first two figures of a point are, ``crs``
    theirs, empty where unknown."""

    key: Key
    entry: ControlFileEntry
    points: PointFile
    marks: tuple[Mark, ...]
    placed: Placed | None
    columns: tuple[str, str]
    crs: str

    def path_of(self, mark: Mark) -> str:
        """Return the file that a mark stands in."""
        own = self.points.holds_marks and not mark.source.is_of_page
        return str(self.entry.path) if own else str(self.entry.marks)


def read_point_files(
    document: Document, file: ProjectFile, photographs: Sequence[PhotographEntry] | None, target: ProjectMap | None
) -> tuple[tuple[ProjectControlPoint, ...], list[list[Located]]]:
    """Return the points of all files, and for each file where they lie, for the checks of positions.

    ``photographs`` is None where they are not known, ``target`` where the map is not. What is wrong is noted in the
    document; the points are complete only where nothing is.
    """
    entries = [(("control_points", "files", i), entry) for i, entry in enumerate(file.control_points.files)]
    read = [_source(document, file, key, entry, target) for key, entry in entries if entry.path is not None]
    sources = [source for source in read if source is not None]
    # Points of a file that cannot be read are not known; that file's error is enough.
    whole = len(sources) == len(entries)
    _check_names(document, file, sources)
    points: list[ProjectControlPoint] = []
    own_names = {point.name for point in file.control_points.list if point.name is not None}
    marks = [_own_marks(document, source, sources, own_names, whole) for source in sources]
    if photographs is not None:
        listed = any(point.marks for point in file.control_points.list)
        marks = [as_marked(own) for own in _marks_in_photographs(document, sources, marks, photographs, listed)]
    index = {photograph.name: i for i, photograph in enumerate(photographs or ())}
    for source, own in zip(sources, marks, strict=True):
        sigma_m, have_sigmas = _sigmas_m(document, file, source), _check_mark_sigmas(document, file, source)
        pixel = None if photographs is None else _pixels(document, file, source, own, photographs)
        if source.placed is not None and sigma_m is not None and have_sigmas and pixel is not None:
            marked = np.array([index[mark.photograph] for mark in own], dtype=np.int64)
            stated_px = _stated_mark_sigma_px(file, source) or np.nan
            sigma_px = np.array([mark.sigma_px or (stated_px, stated_px) for mark in own]).reshape(-1, 2)
            covariance_px2 = covariances_px2(sigma_px, np.array([mark.rho for mark in own], dtype=np.float64))
            points += _complete(
                source, source.placed, sigma_m, own, marked, pixel, covariance_px2, _assumed(file, source)
            )
    return tuple(points), [_located(source) for source in sources]


def _note(document: Document, key: Key, path: str, line: int, text: str) -> None:
    document.add_error(key, f"{path}:{line}: {text}")


def _read(document: Document, key: Key, written: str, reader: Callable[[Path], ReadT]) -> ReadT | None:
    """Return what ``reader`` reads, None where it cannot; its errors name the file as the project does."""
    path = document.base / written
    try:
        return reader(path)
    except ControlPointError as error:
        document.add_errors_of(key, error, path, written)
        return None


def _source(
    document: Document, file: ProjectFile, key: Key, entry: ControlFileEntry, target: ProjectMap | None
) -> _Source | None:
    points = _read(document, key, str(entry.path), read_points)
    if points is None:
        return None
    marks = points.marks if entry.marks is None else _marks(document, key, entry, points)
    if points.without_position:
        bare = f"{things(len(points.without_position), 'point')} ({some(points.without_position)})"
        text = f"{entry.path}: marks of {bare} without coordinates are left out"
        document.warn(key, text, "give coordinates, where they are to be control or check points")
    crs = _crs(document, file, key, entry, points)
    placed = None if crs is None else _placed(document, key, entry, points, crs, target)
    columns = ("easting", "northing") if crs is None or is_grid(crs) else ("longitude", "latitude")
    return _Source(key, entry, points, marks, placed, columns, crs or "")


def _marks(document: Document, key: Key, entry: ControlFileEntry, points: PointFile) -> tuple[Mark, ...]:
    """Return the marks of a file of points and of the table that its entry names, which need not be there before
    somebody has marked points on the page."""
    written = str(entry.marks)
    path = document.base / written
    rows = _read(document, key, written, has_rows) if path.name == MARKS else True
    if rows is None:
        return ()
    if not rows:
        return points.marks
    table = _read(document, key, written, read_marks) or ()
    made = of_page(path, table)
    if made is None and points.holds_marks:
        text = f"{entry.path} contains its own marks: name the {MARKS} that photogram mark writes, or remove this key"
        document.add_error((*key, "marks"), text)
    return (*points.marks, *(table if made is None else made))


def _crs(document: Document, file: ProjectFile, key: Key, entry: ControlFileEntry, points: PointFile) -> str | None:
    if points.crs is not None and entry.crs is not None and points.crs != entry.crs:
        where = "in its first line" if points.format == "gcp_list" else "itself"
        document.add_error((*key, "crs"), f"{entry.path} names {shortened(points.crs)} {where}: keep one of the two")
        return None
    if points.format == "gcp_list" and points.crs is None and entry.crs is None:
        text = "the first line must name the CRS, EPSG:32617 for example: add it, or give crs in the project file"
        _note(document, key, str(entry.path), points.points[0].line if points.points else 1, text)
        return None
    return points.crs or entry.crs or file.crs


def _placed(
    document: Document, key: Key, entry: ControlFileEntry, points: PointFile, crs: str, target: ProjectMap | None
) -> Placed | None:
    """Return the positions of a file in the map, None where they cannot be brought there."""
    if target is None:
        return None
    if points.geographic and is_grid(crs):
        text = f"the columns are longitude and latitude, but {crs} is a map grid: give crs: EPSG:4326, or similar"
        document.add_error(key, text)
        return None
    given = np.array([p.position for p in points.points]).reshape(-1, 3)
    try:
        given = in_units_of_crs(document, key, str(entry.path), crs, given, points.unit_m)
        return target.placed(crs, entry.heights, target.heights.control_points, given, exact=True)
    except FrameError as error:
        text = str(error).removeprefix("crs: ")
        document.add_error((*key, "crs") if entry.crs else key, f"{entry.path}: {text}")
        return None


def _located(source: _Source) -> list[Located]:
    if source.placed is None:
        return []
    places = zip(source.points.points, source.placed.map_m, source.placed.turned_map_m, strict=True)
    return [
        Located(source.key, position, turned, source.columns, f"{source.entry.path}:{point.line}", point.name)
        for point, position, turned in places
    ]


def _check_names(document: Document, file: ProjectFile, sources: Sequence[_Source]) -> None:
    """Note every name that two places of the project use."""
    block: Key = ("control_points", "list")
    first = {
        point.name: f"in line {document.line((*block, i, 'name'))} of {document.path.name}"
        for i, point in enumerate(file.control_points.list)
        if point.name is not None
    }
    for source in sources:
        for point in source.points.points:
            place = f"in {source.entry.path}:{point.line}"
            if point.name in first:
                text = f"{point.name!r} is used twice, first {first[point.name]}: give each point its own name"
                _note(document, source.key, str(source.entry.path), point.line, text)
            first.setdefault(point.name, place)


def _sigmas_m(document: Document, file: ProjectFile, source: _Source) -> FloatArray | None:
    """Return the sigmas (N, 3): of the file's columns, else of its entry, else of all points."""
    default = source.entry.sigma_m or file.control_points.sigma_m or (None, None, None)
    rows = [
        [own if own is not None else other for own, other in zip(point.sigma_m, default, strict=True)]
        for point in source.points.points
    ]
    bare = [point for point, row in zip(source.points.points, rows, strict=True) if None in row]
    if not bare:
        return np.array(rows, dtype=np.float64).reshape(-1, 3)
    if not document.has((*source.key, "sigma_m"), ("control_points", "sigma_m")):
        column = "" if source.points.holds_marks else ", or a column sigma in the file"
        points = f"{things(len(bare), 'point')} ({some([p.name for p in bare])})"
        text = f"{points} without a standard deviation: give sigma_m here or for all points"
        document.add_error(source.key, text + column)
    return None


def _stated_mark_sigma_px(file: ProjectFile, source: _Source) -> float | None:
    """Return the sigma of marks whose file gives none: of its entry, else of all points."""
    return source.entry.mark_sigma_px or file.control_points.mark_sigma_px


def _check_mark_sigmas(document: Document, file: ProjectFile, source: _Source) -> bool:
    """Return whether every mark of a source has a sigma; note those that have none."""
    bare = sum(mark.sigma_px is None for mark in source.marks)
    if not bare or _stated_mark_sigma_px(file, source) is not None:
        return True
    if not document.has((*source.key, "mark_sigma_px"), ("control_points", "mark_sigma_px")):
        column = "" if source.points.holds_marks else ", or a column sigma_px in the file"
        text = f"marks without a standard deviation ({bare}): give mark_sigma_px here or for all points"
        document.add_error(source.key, text + column)
    return False


def _assumed(file: ProjectFile, source: _Source) -> tuple[bool, bool]:
    """Return whether the sigmas of points and of marks that a source's file does not give are only assumed: the entry
    that gives them says so."""
    entry, block = source.entry, file.control_points
    return (
        entry.sigma_assumed if entry.sigma_m is not None else block.sigma_assumed,
        entry.mark_sigma_assumed if entry.mark_sigma_px is not None else block.mark_sigma_assumed,
    )


def _own_marks(
    document: Document, source: _Source, sources: Sequence[_Source], listed: set[str], whole: bool
) -> list[Mark]:
    """Return the marks of the source's own points; those of other files' points are left to entries that share them.

    Marks of no point are noted where the points are known as a ``whole``; the page has those of ``listed`` points too,
    and of points that were added there.
    """
    names = {point.name for point in source.points.points}
    shared = {
        point.name
        for other in sources
        if other is not source and other.entry.marks is not None and other.entry.marks == source.entry.marks
        for point in other.points.points
    }
    strange = [mark for mark in source.marks if whole and mark.point not in names | shared]
    added = list(dict.fromkeys(mark.point for mark in strange if mark.source.is_of_page and mark.point not in listed))
    if added and source is next(other for other in sources if other.entry.marks == source.entry.marks):
        text = f"{source.entry.marks}: marks of {things(len(added), 'point')} ({some(added)}) that no table has"
        document.warn(source.key, f"{text} are left out", f"add them to {source.entry.path}, with coordinates")
    strange = [mark for mark in strange if not mark.source.is_of_page]
    for name in list(dict.fromkeys(mark.point for mark in strange))[:_MOST_NAMES]:
        mark = next(mark for mark in strange if mark.point == name)
        text = f"no point {name!r} in {source.entry.path}: {suggestion(name, names)}"
        _note(document, source.key, source.path_of(mark), mark.source.line, text)
    return [mark for mark in source.marks if mark.point in names]


# ---- marks ---------------------------------------------------------------------------------------------------------


def _pixels(
    document: Document,
    file: ProjectFile,
    source: _Source,
    marks: Sequence[Mark],
    photographs: Sequence[PhotographEntry],
) -> FloatArray | None:
    """Return the pixels (M, 2) of marks in photogram's frame and the photographs' own size, None where one is wrong."""
    before = document.errors
    by_name = {p.name: p for p in photographs if p.name is not None}
    pixel = np.array([mark.pixel for mark in marks]).reshape(-1, 2)
    of_photogram = np.array([mark.source.is_of_photogram for mark in marks], dtype=bool)
    pixel[~of_photogram] -= PIXEL_ORIGIN_PX[file.control_points.pixel_origin]
    from_page = np.array([mark.source.is_of_page for mark in marks], dtype=bool)
    size_px = np.full(pixel.shape, np.nan)
    cameras = [camera_of(file, by_name[mark.photograph]) for mark in marks]
    for name in dict.fromkeys(cameras):
        camera = file.cameras.get(name or "")
        if camera is None or camera.width_px is None or camera.height_px is None:
            continue
        own = np.flatnonzero([c == name for c in cameras])
        size = (camera.width_px, camera.height_px)
        if source.entry.picture_size_px is not None:
            scale = _scale(document, source, str(name), source.entry.picture_size_px, size)
            if scale is None:
                continue
            # the corner of the top-left pixel, at -0.5, is the same place in both pictures
            other = own[~from_page[own]]
            pixel[other] = (pixel[other] + 0.5) * scale - 0.5
        size_px[own] = size
    outside = np.any((pixel < -0.5) | (pixel > size_px - 0.5), axis=1)
    if outside.any():
        _refuse(document, source, marks, outside, pixel, size_px)
    return pixel if document.errors == before else None


def _marks_in_photographs(
    document: Document,
    sources: Sequence[_Source],
    marks: Sequence[list[Mark]],
    photographs: Sequence[PhotographEntry],
    marks_listed: bool,
) -> list[list[Mark]]:
    """Return the marks of each source in photographs that take part in the project.

    The others are noted as a warning, with the photographs' names; as an error where no mark of any source is left and
    the project file lists none itself (``marks_listed``).
    """
    names = [p.name for p in photographs if p.name is not None]
    taking_part = set(names)
    joined = [joined_names((mark.photograph for mark in own), names) for own in marks]
    marks = [
        [replace(mark, photograph=join.of.get(mark.photograph, mark.photograph)) for mark in own]
        for own, join in zip(marks, joined, strict=True)
    ]
    kept = [[mark for mark in own if mark.photograph in taking_part] for own in marks]
    nothing_left = not any(kept) and not marks_listed
    for source, own, join in zip(sources, marks, joined, strict=True):
        missing = [mark for mark in own if mark.photograph not in taking_part]
        if not missing:
            continue
        counts = Counter(mark.photograph for mark in missing)
        listed = ", ".join(f"{name} ({count})" for name, count in list(counts.items())[:_MOST_NAMES])
        more = f" and {len(counts) - _MOST_NAMES} more" if len(counts) > _MOST_NAMES else ""
        near = suggestion(missing[0].photograph, names)
        several = join.ambiguous.get(missing[0].photograph)
        if several is not None:
            near = f"did you mean {' or '.join(several[:3])}? Write the folder too"
        hint = near if near.startswith("did you mean") else "add the photographs to the project, or remove their marks"
        text = f"{len(missing)} of {len(own)} marks are in photographs that are not in the project"
        where = f"{source.path_of(missing[0])}:{missing[0].source.line}: "
        if nothing_left:
            document.add_error(source.key, f"{where}{text}: {listed}{more}: {hint}")
        else:
            document.warn(source.key, f"{where}{text} and are left out: {listed}{more}", hint)
    return kept


def _scale(
    document: Document, source: _Source, camera: str, picture_px: tuple[int, int], size_px: tuple[int, int]
) -> float | None:
    across, down = size_px[0] / picture_px[0], size_px[1] / picture_px[1]
    if abs(down / across - 1.0) <= SHAPE_TOLERANCE:
        return across
    document.add_error(
        (*source.key, "picture_size_px"),
        f"a picture of {picture_px[0]} × {picture_px[1]} px has another aspect ratio than the photographs of "
        f"camera {camera}, "
        f"{size_px[0]} × {size_px[1]} px: give the size of the pictures in which the points were marked",
    )
    return None


def _refuse(
    document: Document,
    source: _Source,
    marks: Sequence[Mark],
    outside: NDArray[np.bool_],
    pixel: FloatArray,
    size_px: FloatArray,
) -> None:
    """Note marks outside their photographs; where most are, they will be those of another picture size."""
    picture = source.entry.picture_size_px
    wrong = np.flatnonzero(outside)
    enlargement = np.nanmax((pixel + 0.5) / size_px)
    if (
        picture is None
        and len(wrong) * 2 >= len(marks)
        and _SMALLEST_ENLARGEMENT < enlargement <= _LARGEST_ENLARGEMENT
        and pixel.min() >= -0.5
    ):
        width, height = (int(n) for n in size_px[wrong[0]])
        w, h = (int(np.ceil(enlargement)) * n for n in (width, height))
        _note(
            document,
            source.key,
            source.path_of(marks[wrong[0]]),
            marks[wrong[0]].source.line,
            f"{len(wrong)} of {len(marks)} marks are outside their photographs, which are {width} × {height} px: "
            f"they would fit pictures of {w} × {h} px: give picture_size_px: [{w}, {h}]",
        )
        return
    for number, i in enumerate(wrong[: _MOST_NAMES + 1]):
        mark = marks[i]
        (u, v), (width, height) = mark.pixel, size_px[i].astype(int)
        of = f"the photograph, which is {width} × {height} px"
        if picture is not None:
            of = f"a picture of {picture[0]} × {picture[1]} px"
        text = f"the mark of {mark.point} in {mark.photograph} at pixel ({u:.10g}, {v:.10g}) is outside {of}"
        if number == _MOST_NAMES and len(wrong) > _MOST_NAMES + 1:
            text = f"{len(wrong) - number} more marks from here on are outside"
        _note(
            document, source.key, source.path_of(mark), mark.source.line, f"{text}: check the order (u right, v down)"
        )


def _complete(
    source: _Source,
    placed: Placed,
    sigma_m: FloatArray,
    marks: Sequence[Mark],
    marked: IntArray,
    pixel: FloatArray,
    covariance_px2: FloatArray,
    assumed: tuple[bool, bool],
) -> list[ProjectControlPoint]:
    """Return the points of a source with their marks, which lie in the photographs of the indices ``marked`` (M,).
    Sigmas of points and of marks that the file does not give may be ``assumed``."""
    indices: dict[str, list[int]] = {}
    for i, mark in enumerate(marks):
        indices.setdefault(mark.point, []).append(i)

    def point(number: int, row: SurveyedPoint) -> ProjectControlPoint:
        own = indices.get(row.name, [])
        return ProjectControlPoint(
            row.name,
            row.role or source.entry.role,
            placed.map_m[number],
            sigma_m[number],
            marked[own],
            pixel[own],
            covariance_px2[own],
            placed.heights,
            tuple(marks[i].kind for i in own),
            assumed[0] and None in row.sigma_m,
            assumed[1] and all(marks[i].sigma_px is None for i in own),
            f"{source.entry.path}:{row.line}" if row.line else str(source.entry.path),
            source.crs,
        )

    return [point(number, row) for number, row in enumerate(source.points.points)]
