"""Points and marks of a survey written for other programs: as they are in the journal of marking, or in the project
where nothing was marked."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from photogram.errors import ControlPointError, WorkspaceError
from photogram.files.marks.formats import MapCrs, MarkFormat, format_of, write_points_and_marks, written_files
from photogram.files.marks.mark_table import MARKS, text_of_marks
from photogram.files.tables.surveyed_points import Mark, MarkKey, PointRole, SurveyedPoint
from photogram.geodesy.crs import crs_in_words, map_units, plan_of, product_crs, written_crs
from photogram.geodesy.frames import map_from_crs
from photogram.geodesy.height_systems import first_wkt
from photogram.marking.files.actions import MarkState, state_of, table_of, touched_keys
from photogram.marking.files.journal import read_journal
from photogram.marking.marking_survey import FOLDER, JOURNAL
from photogram.measures.mark_covariances import stated_pairs
from photogram.pipeline.pipeline import load_project
from photogram.project.control.mark_entries import mark_entries
from photogram.project.control.points import ProjectControlPoint
from photogram.project.project import Project
from photogram.survey import Role, Roles
from photogram.wording import some, things


@dataclass(frozen=True)
class ExportedMarks:
    """What was written."""

    files: tuple[Path, ...]
    """The files."""
    points: int
    """Number of points with coordinates."""
    marks: int
    """Number of marks."""
    crs: str
    """The CRS of the coordinates, and what heights count from, in words."""
    notes: tuple[str, ...]
    """Sentences on what was left out, and on what the format cannot say."""


@dataclass(frozen=True)
class _Known:
    """Points with coordinates and roles, all marks, and what is known of how they came together."""

    points: tuple[SurveyedPoint, ...]
    without_position: frozenset[str]
    marks: tuple[Mark, ...]
    notes: list[str] = field(default_factory=list)


def export_marks(
    project: Path | str,
    target: Path | str,
    form: MarkFormat | None = None,
    *,
    photographs: Path | str | None = None,
    overwrite: bool = False,
) -> ExportedMarks:
    """Write the points of a project and their marks for another program, in the format that the name of ``target``
    implies unless ``form`` is given.

    Marks are those of the journal of marking, and those of the project at places that it does not know. Doubtful marks
    are left out; marks that contradict the others are not: that is for who marks to say. ``photographs`` is their
    folder in place of the project's own. Raises ProjectError with every error of the project, ControlPointError where
    the format cannot hold something, WorkspaceError where a file is there and may not be overwritten, is one that the
    survey reads, or cannot be written, and where the journal is damaged.
    """
    path = Path(target)
    chosen = form or format_of(path)
    survey = load_project(Path(project), None if photographs is None else Path(photographs))
    _check_targets(survey, written_files(path, chosen), overwrite)
    known = _known(survey)
    marks = _without_doubtful(known)
    points = known.points
    if chosen == "gcp_list":
        points, marks = _of_gcp_list(known, marks)
    elif known.without_position:
        bare = some(sorted(known.without_position))
        known.notes.append(f"without coordinates, their marks alone: {bare}")
    if not marks and not points:
        raise ControlPointError(f"{survey.path}: nothing to export: no points with coordinates, and no marks")
    files = write_points_and_marks(path, chosen, points, marks, _map_crs(survey))
    return ExportedMarks(files, len(points), len(marks), crs_in_words(survey.crs, survey.heights), tuple(known.notes))


def _map_crs(survey: Project) -> MapCrs:
    """Return the CRS of the points; a map grid without vertical part means ellipsoidal heights to Metashape."""
    plan = plan_of(survey.crs)
    crs = written_crs(product_crs(survey.crs, survey.heights) if survey.heights.output == "orthometric" else plan)
    return MapCrs(plan, None if crs is None else first_wkt(crs))


def _check_targets(survey: Project, files: Sequence[Path], overwrite: bool) -> None:
    """Raise WorkspaceError where a file that is to be written is one of the survey's own, or is there already."""
    folder = survey.path.absolute().parent
    entries, _ = mark_entries(survey.path)
    named = [name for entry in entries for name in (entry.path, entry.marks) if name is not None]
    own = {survey.path, folder / MARKS, survey.work / FOLDER / JOURNAL, *(folder / name for name in named)}
    places = {path.resolve() for path in own} | {photograph.path.resolve() for photograph in survey.photographs}
    for file in files:
        if file.resolve() in places:
            raise WorkspaceError(f"{file}: the survey reads it, so it is not written: give another name")
        if file.is_dir():
            raise WorkspaceError(f"{file}: is a folder: give the name of a file")
        if not overwrite and (file.exists() or file.is_symlink()):
            raise WorkspaceError(f"{file}: is there already: give another name, or --overwrite")


# ---- what is known -------------------------------------------------------------------------------------------------


def _known(survey: Project) -> _Known:
    notes: list[str] = []
    actions = read_journal(survey.work / FOLDER / JOURNAL)
    state, touched = state_of(actions), touched_keys(actions)
    table = survey.path.parent / MARKS
    if actions and table.is_file() and table.read_bytes() != text_of_marks(table_of(state.marks, actions)).encode():
        notes.append(f"{table} was changed since it was marked: the marks of the journal are exported, not the changes")
    points, bare = _points(survey, state)
    given = [mark for mark in _given_marks(survey) if mark.key not in touched]
    marks = _of_survey(survey, [*given, *state.marks.values()], {p.name for p in points} | bare, notes)
    return _Known(points, frozenset(bare), marks, notes)


def _given_marks(survey: Project) -> list[Mark]:
    """Return the marks of the project."""
    return [
        Mark(point.name, survey.photographs[i].name, (u, v), sigma_px, rho, kind)
        for point in survey.control_points
        for i, (u, v), (sigma_px, rho), kind in zip(
            point.mark_photograph.tolist(),
            point.mark_pixel.tolist(),
            stated_pairs(point.mark_covariance_px2),
            point.mark_kind,
            strict=True,
        )
    ]


def _of_survey(survey: Project, marks: Iterable[Mark], names: set[str], notes: list[str]) -> tuple[Mark, ...]:
    """Return the marks of points and photographs that the survey has, and note the others."""
    photographs = {photograph.name for photograph in survey.photographs}
    kept, strange = list[Mark](), list[MarkKey]()
    for mark in marks:
        known = mark.point in names and mark.photograph in photographs
        if known:
            kept.append(mark)
        else:
            strange.append(mark.key)
    if strange:
        places = some([f"{point} in {photograph}" for point, photograph in sorted(strange)])
        notes.append(f"left out, because the project has not the point or the photograph: {places}")
    return tuple(sorted(kept, key=lambda mark: mark.key))


def _points(survey: Project, state: MarkState) -> tuple[tuple[SurveyedPoint, ...], set[str]]:
    """Return the points with coordinates that are control or check points, and the names of all others."""
    known_points = {point.name: _given_point(survey, point) for point in survey.control_points}
    for name, new in state.points.items():
        former = known_points.get(name)
        known_points[name] = _new_point(new, survey, None if former is None else former.role)
    points = {name: _with_role(point, state.roles.get(name)) for name, point in known_points.items()}
    known = tuple(point for point in points.values() if point is not None)
    return known, {name for name, point in points.items() if point is None}


def _given_point(survey: Project, point: ProjectControlPoint) -> SurveyedPoint | None:
    if not np.isfinite(point.position_map_m).all():
        return None
    x, y, z = map_units(survey.product_crs).from_metres(point.position_map_m)[0].tolist()
    east, north, up = point.sigma_m.tolist()
    return SurveyedPoint(point.name, (x, y, z), (east, north, up), point.roles)


def _new_point(new: SurveyedPoint, survey: Project, roles: Roles | None) -> SurveyedPoint | None:
    """Return a point that was added or changed while marking, in the units of the map."""
    if new.position is None:
        return None
    position = np.array([new.position])
    if new.crs is not None and new.crs != survey.crs:
        moved = map_from_crs(new.crs, plan_of(survey.crs), position, survey.datum.grid)
        position = map_units(survey.product_crs).from_metres(moved)
    x, y, z = position[0].tolist()
    return SurveyedPoint(new.name, (x, y, z), new.sigma_m, roles or ("control", "control"))


def _with_role(point: SurveyedPoint | None, role: PointRole | None) -> SurveyedPoint | None:
    """Return a point with the role that it was given while marking, None where it is a tie point then."""
    if point is None or role == "tie":
        return None
    given: Role | None = role
    return point if given is None else replace(point, role=(given, given))


# ---- what a file can hold ------------------------------------------------------------------------------------------


def _without_doubtful(known: _Known) -> tuple[Mark, ...]:
    doubtful = [f"{mark.point} in {mark.photograph}" for mark in known.marks if mark.is_doubtful]
    if doubtful:
        known.notes.append(f"{things(len(doubtful), 'doubtful mark')} left out: {some(doubtful)}")
    return tuple(mark for mark in known.marks if not mark.is_doubtful)


def _of_gcp_list(known: _Known, marks: Sequence[Mark]) -> tuple[tuple[SurveyedPoint, ...], tuple[Mark, ...]]:
    """Return what a gcp_list.txt can hold: marks of points with coordinates, and points with marks."""
    marked = {mark.point for mark in marks}
    bare = sorted(marked & known.without_position)
    if bare:
        known.notes.append(f"left out, because gcp_list.txt needs coordinates: {some(bare)}")
    unmarked = [point.name for point in known.points if point.name not in marked]
    if unmarked:
        known.notes.append(f"left out, because gcp_list.txt has no place for points without marks: {some(unmarked)}")
    points = tuple(point for point in known.points if point.name in marked)
    checks = [point.name for point in points if point.role != ("control", "control")]
    if checks:
        known.notes.append(
            f"gcp_list.txt has no roles, so check points become control points there: {some(checks)}: remove their "
            "lines where they are to stay independent"
        )
    names = {point.name for point in points}
    return points, tuple(mark for mark in marks if mark.point in names)
