"""Ground points that a project file takes from other files: positions brought to the project's CRS, sigmas and roles
filled in, marks brought to the photographs' own pixels.

Errors are noted in the document under the entry that names the file, and carry that file's own line.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import FloatArray, IntArray, check_shape
from photogram.files.tables.surveyed_points import IMPORTED, Mark, SurveyedPoint
from photogram.geodesy.height_systems import HeightSystem
from photogram.measures.mark_covariances import covariances_px2
from photogram.project.control.mark_entries import as_marked
from photogram.project.control.marks import marks_in_photographs, own_marks, pixels
from photogram.project.control.sources import Source, read_source
from photogram.project.cross_checks import Located
from photogram.project.document import Document, Key, suggestion
from photogram.project.heights import Placed, ProjectMap
from photogram.project.schema import PhotographEntry, ProjectFile
from photogram.survey import Role, Roles
from photogram.wording import some, things


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


def read_point_files(
    document: Document, file: ProjectFile, photographs: Sequence[PhotographEntry] | None, target: ProjectMap | None
) -> tuple[tuple[ProjectControlPoint, ...], list[list[Located]]]:
    """Return the points of all files, and for each file where they lie, for the checks of positions.

    ``photographs`` is None where they are not known, ``target`` where the map is not. What is wrong is noted in the
    document; the points are complete only where nothing is.
    """
    entries = [(("control_points", "files", i), entry) for i, entry in enumerate(file.control_points.files)]
    read = [read_source(document, file, key, entry, target) for key, entry in entries if entry.path is not None]
    sources = [source for source in read if source is not None]
    # Points of a file that cannot be read are not known; that file's error is enough.
    whole = len(sources) == len(entries)
    _check_names(document, file, sources)
    _check_roles(document, sources)
    points: list[ProjectControlPoint] = []
    own_names = {point.name for point in file.control_points.list if point.name is not None}
    marks = [own_marks(document, source, sources, own_names, whole) for source in sources]
    if photographs is not None:
        listed = any(point.marks for point in file.control_points.list)
        marks = [as_marked(own) for own in marks_in_photographs(document, sources, marks, photographs, listed)]
    index = {photograph.name: i for i, photograph in enumerate(photographs or ())}
    for source, own in zip(sources, marks, strict=True):
        sigma_m, have_sigmas = _sigmas_m(document, file, source), _check_mark_sigmas(document, file, source)
        pixel = None if photographs is None else pixels(document, file, source, own, photographs)
        if source.placed is not None and sigma_m is not None and have_sigmas and pixel is not None:
            marked = np.array([index[mark.photograph] for mark in own], dtype=np.int64)
            stated_px = _stated_mark_sigma_px(file, source) or np.nan
            sigma_px = np.array([mark.sigma_px or (stated_px, stated_px) for mark in own]).reshape(-1, 2)
            covariance_px2 = covariances_px2(sigma_px, np.array([mark.rho for mark in own], dtype=np.float64))
            points += _complete(
                source, source.placed, sigma_m, own, marked, pixel, covariance_px2, _assumed(file, source)
            )
    return tuple(points), [_located(source) for source in sources]


def _located(source: Source) -> list[Located]:
    if source.placed is None:
        return []
    places = zip(source.points.points, source.placed.map_m, source.placed.turned_map_m, strict=True)
    return [
        Located(
            source.key, position, turned, source.columns, f"{source.entry.path}:{point.line}", point.name, source.crs
        )
        for point, position, turned in places
    ]


def _check_names(document: Document, file: ProjectFile, sources: Sequence[Source]) -> None:
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
                source.note(document, str(source.entry.path), point.line, text)
            first.setdefault(point.name, place)


def _check_roles(document: Document, sources: Sequence[Source]) -> None:
    """Note every role of a point that its file does not have."""
    for source in sources:
        names = [point.name for point in source.points.points]
        for name in sorted(set(source.entry.roles) - set(names)):
            text = f"there is no point {name!r} in {source.entry.path}: {suggestion(name, names)}"
            document.add_error((*source.key, "roles", name), text)


def _sigmas_m(document: Document, file: ProjectFile, source: Source) -> FloatArray | None:
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


def _stated_mark_sigma_px(file: ProjectFile, source: Source) -> float | None:
    """Return the sigma of marks whose file gives none: of its entry, else of all points."""
    return source.entry.mark_sigma_px or file.control_points.mark_sigma_px


def _check_mark_sigmas(document: Document, file: ProjectFile, source: Source) -> bool:
    """Return whether every mark of a source has a sigma; note those that have none."""
    bare = sum(mark.sigma_px is None for mark in source.marks)
    if not bare or _stated_mark_sigma_px(file, source) is not None:
        return True
    if not document.has((*source.key, "mark_sigma_px"), ("control_points", "mark_sigma_px")):
        column = "" if source.points.holds_marks else ", or a column sigma_px in the file"
        text = f"marks without a standard deviation ({bare}): give mark_sigma_px here or for all points"
        document.add_error(source.key, text + column)
    return False


def _assumed(file: ProjectFile, source: Source) -> tuple[bool, bool]:
    """Return whether the sigmas of points and of marks that a source's file does not give are only assumed: the entry
    that gives them says so."""
    entry, block = source.entry, file.control_points
    return (
        entry.sigma_assumed if entry.sigma_m is not None else block.sigma_assumed,
        entry.mark_sigma_assumed if entry.mark_sigma_px is not None else block.mark_sigma_assumed,
    )


def _complete(
    source: Source,
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
            source.entry.roles.get(row.name, row.role or source.entry.role),
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
