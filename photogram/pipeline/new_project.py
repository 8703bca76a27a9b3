"""A project file from a folder of photographs: their tags, files of ground points, and those of positions beside."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from os.path import exists, isdir, isfile  # false, not an exception, for a name that cannot be
from pathlib import Path, PurePosixPath

import numpy as np

from photogram.errors import ControlPointError, FrameError, ImageError, ProjectError
from photogram.files.atomic import replacing
from photogram.files.marks.formats import read_marks, read_points
from photogram.files.marks.mark_table import MARKS, has_rows
from photogram.files.photographs.duplicates import find_duplicates
from photogram.files.photographs.images import inspect_photograph
from photogram.files.photographs.masks import find_masks
from photogram.files.photographs.names import deep_twins
from photogram.files.portable import path_from
from photogram.files.tables.point_file import PointFile
from photogram.files.tables.position_files import PositionFile
from photogram.files.tables.position_tables import read_positions
from photogram.geodesy.crs import is_geographic, map_units
from photogram.geodesy.frames import geodetic_from_map
from photogram.geodesy.height_systems import HeightSystem
from photogram.machine import cores
from photogram.pipeline.photograph_folder import MASKS_FOLDER, look_into
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.project_file import GEO_TXT
from photogram.project.control.mark_entries import of_page
from photogram.project.draft.control import ControlFile
from photogram.project.draft.draft import (
    DraftMasks,
    DraftPositions,
    LeftOut,
    ProjectDraft,
    TaggedPhotograph,
    Wishes,
    draft_project,
)
from photogram.project.draft.text import project_text
from photogram.project.findings import Findings
from photogram.project.positions.matching import match_rows
from photogram.project.ranges import FOCAL_PX, PIXELS, SIGMA_M
from photogram.settings.settings import Within
from photogram.survey import Role
from photogram.wording import Progress, html_table, silent, things

_POSITIONS = (".mrk", ".pos", ".csv", ".txt")
"""Of files that may hold positions of photographs, in small letters."""


@dataclass(frozen=True)
class Request:
    """What a project file is asked for: the folder of the photographs, files of ground points with their roles, marks,
    and what the tags do not say; None where nothing is said."""

    photographs: Path
    ground_points: tuple[tuple[Path, Role], ...]
    marks: Path | None
    crs: str | None
    project: Path
    picture_size_px: tuple[int, int] | None
    control_sigma_m: float | None
    heights: HeightSystem | None
    geoid: str | None
    focal_px: float | None
    recursive: bool
    force: bool
    focal_px_of: Mapping[str, float] = field(default_factory=dict)

    def out_of_range(self) -> list[tuple[str, float, Within]]:
        """Return the figures that cannot be: the name of each, its value, and what it has to lie within."""
        width, height = self.picture_size_px or (None, None)
        given: list[tuple[str, float | None, Within]] = [
            ("picture_size_px", width, PIXELS),
            ("picture_size_px", height, PIXELS),
            ("control_sigma_m", self.control_sigma_m, SIGMA_M),
            ("focal_px", self.focal_px, FOCAL_PX),
            *(("focal_px", value, FOCAL_PX) for value in self.focal_px_of.values()),
        ]
        return [
            (name, value, allowed) for name, value, allowed in given if value is not None and not allowed.holds(value)
        ]


@dataclass(frozen=True, eq=False)
class NewProject:
    """A project file that was written: its ``path``, the ``draft`` that it was written from, and the ``warnings`` that
    reading it gives."""

    path: Path
    draft: ProjectDraft
    warnings: Findings

    def _facts(self) -> list[tuple[str, str]]:
        draft = self.draft
        points = sum(len(file.position) for file in draft.control)
        return [
            ("photographs", f"{len(draft.photographs)}, {len(draft.left_out)} left out"),
            ("cameras", ", ".join(f"{c.name} (f {c.focal_px:.0f} ± {c.sigmas[0]:.0f} px)" for c in draft.cameras)),
            ("map grid", f"{draft.crs} ({draft.crs_name})"),
            ("ground points", str(points)),
            *([] if draft.masks is None else [("masks", draft.masks.error or str(draft.masks.photographs))]),
            *(("warning", text) for text in (*draft.warnings, *map(str, self.warnings))),
        ]

    def __repr__(self) -> str:
        draft = self.draft
        return (
            f"<NewProject {self.path}: {things(len(draft.photographs), 'photograph')}, "
            f"{things(len(draft.cameras), 'camera')}, {draft.crs}>"
        )

    def _repr_html_(self) -> str:
        return html_table(str(self.path), (), self._facts())


# ---- what lies in the folder -----------------------------------------------------------------------------------------


def _inspected(folder: Path, name: str) -> TaggedPhotograph | LeftOut:
    if not name.isprintable():
        return LeftOut(repr(name), "its name has unprintable characters: rename it")
    path = folder / name
    try:
        return TaggedPhotograph(name, inspect_photograph(path))
    except ImageError as error:
        return LeftOut(name, str(error).removeprefix(f"photograph {path}: "))


def _inspect(folder: Path, names: Sequence[str], progress: Progress) -> tuple[list[TaggedPhotograph], list[LeftOut]]:
    tagged, unreadable = list[TaggedPhotograph](), list[LeftOut]()
    with ThreadPoolExecutor(cores()) as executor:
        for done, result in enumerate(executor.map(lambda name: _inspected(folder, name), names), 1):
            if isinstance(result, LeftOut):
                unreadable.append(result)
            else:
                tagged.append(result)
            progress(done, len(names), result.name)
    return tagged, unreadable


def _without_duplicates(
    folder: Path, photographs: list[TaggedPhotograph]
) -> tuple[list[TaggedPhotograph], list[LeftOut]]:
    """Return the photographs once each, and those that are copies of another."""
    paths, tags = [folder / p.name for p in photographs], [p.tags for p in photographs]
    with ThreadPoolExecutor(cores()) as executor:
        groups = find_duplicates(paths, tags, [None] * len(paths), executor)
    original = {i: group[0] for group in groups for i in group[1:]}
    return (
        [p for i, p in enumerate(photographs) if i not in original],
        [
            LeftOut(photographs[i].name, f"the same photograph as {photographs[first].name}")
            for i, first in original.items()
        ],
    )


def _without_deep_twins(photographs: list[TaggedPhotograph]) -> tuple[list[TaggedPhotograph], list[LeftOut]]:
    """Return the photographs without those of more than 8 bits that lie beside the same exposure of 8, and these."""
    twins = deep_twins([p.name for p in photographs], [p.tags.bits for p in photographs])
    return (
        [p for p in photographs if p.name not in twins],
        [LeftOut(name, f"the same exposure as {twin}, which has 8 bits") for name, twin in twins.items()],
    )


def _without_other_pngs(
    photographs: list[TaggedPhotograph], pngs: frozenset[str]
) -> tuple[list[TaggedPhotograph], list[LeftOut]]:
    """Return the photographs without those of ``pngs`` whose tags name no camera, and these."""
    reason = (
        "a PNG without a camera in its tags, beside photographs of another kind, is taken for an overview: save it as "
        "TIFF if it is a photograph"
    )
    others = {p.name for p in photographs if p.name in pngs and p.tags.make is None and p.tags.model is None}
    return [p for p in photographs if p.name not in others], [LeftOut(name, reason) for name in sorted(others)]


def _relative(path: Path, project: Path) -> str:
    return path_from(project.parent, path).as_posix()


def _mark_table(file: PointFile, marks: Path | None, project: Path) -> Path | None:
    """Return the table of the marks of a file of points: the one that is given, where the file has none of its own,
    else that of the page of `photogram mark`, unless another table is called so that is not about these points."""
    if marks is not None:
        return None if file.holds_marks else marks
    table = project.absolute().parent / MARKS
    try:
        made = read_marks(table) if has_rows(table) else ()
    except ControlPointError:
        return None  # not a table of marks, and nobody has named it
    about = {mark.point for mark in made} & {point.name for point in file.points}
    is_free = of_page(table, made) is not None or (bool(about) and not file.holds_marks)
    return table if is_free else None


def _control_file(
    path: Path, role: Role, marks: Path | None, project: Path, size: tuple[int, int] | None, sigma_m: float | None
) -> ControlFile:
    file = read_points(path)
    table = _mark_table(file, marks, project)
    return ControlFile(
        _relative(path, project),
        role,
        np.array([p.position for p in file.points]).reshape(-1, 3),
        file.crs,
        file.geographic,
        file.holds_marks,
        all(None not in p.sigma_m for p in file.points),
        None if table is None else _relative(table, project),
        marks is None and table is not None and not has_rows(table),
        size,
        None if sigma_m is None else (sigma_m, sigma_m, sigma_m),
        turned=file.turned_columns,
        geodetic=None if file.geodetic is None else np.array(file.geodetic),
    )


def _geoid(geoid: str | None, project: Path) -> str | None:
    return geoid if geoid is None or not isfile(geoid) else _relative(Path(geoid), project)


def _positions(
    folder: Path, files: Sequence[str], names: list[str], project: Path
) -> tuple[tuple[DraftPositions, ...], set[str]]:
    """Return the files of positions among ``files`` of the folder, and a geo.txt above it; and which of ``files`` they
    are."""
    found = dict[str, DraftPositions]()
    for file in files:
        here = PurePosixPath(file).parent
        neighbours = [name for name in names if PurePosixPath(name).parent == here]
        positions = _position_file(folder / file, neighbours or names, project)
        if positions is not None:
            found[file] = positions
    above = folder.absolute().parent / GEO_TXT
    shared = _position_file(above, names, project) if above.is_file() else None
    return (*found.values(), *([] if shared is None else [shared])), set(found)


def _position_file(path: Path, names: list[str], project: Path) -> DraftPositions | None:
    """Return an MRK file or a geo.txt with its rows, or the reason for which it cannot be used; a table of which nobody
    says what its positions are of with how to use it; None where a file is something else."""
    kind, is_geo = path.suffix.lower(), path.name.lower() == GEO_TXT
    written, is_used = _relative(path, project), kind == ".mrk" or is_geo
    if kind not in _POSITIONS:
        return None
    try:
        read = read_positions(path)
        matching = match_rows(read, names)
        degrees = _degrees_of(read) if is_geo else {}
    except (ProjectError, FrameError) as error:
        lines = str(error).splitlines()
        more = f" and {len(lines) - 1} more errors" if len(lines) > 1 else ""
        return DraftPositions(written, error=lines[0].removeprefix(f"{path}:") + more) if is_used else None
    if is_used:
        return DraftPositions(written, matching.rows, matching.error, is_geo, degrees)
    use = f"positions of {things(len(matching.rows), 'photograph')}, of the camera or of the antenna: to use them, add "
    use += f"{{path: {written}, position_of: camera}}, or antenna, under photographs.positions"
    return DraftPositions(written, error=use) if matching.rows else None


def _degrees_of(file: PositionFile) -> Mapping[int, tuple[float, float, float]]:
    """Return longitude, latitude and height of the rows of a file by their lines, none where it does not say of which
    CRS they are. Raises FrameError where that is none."""
    given = np.array([row.position for row in file.rows])
    if file.crs is not None and not is_geographic(file.crs):
        given = geodetic_from_map(file.crs, map_units(file.crs).in_metres(given))
    elif not file.geographic:
        return {}
    return {row.line: (x, y, z) for row, (x, y, z) in zip(file.rows, given.tolist(), strict=True)}


def _with_places(photographs: list[TaggedPhotograph], files: Sequence[DraftPositions]) -> list[TaggedPhotograph]:
    """Return photographs whose tags have no position with that of a table beside them."""
    rows = {name: file.degrees[row.line] for file in files for name, row in file.rows.items() if file.degrees}
    placed = []
    for p in photographs:
        if p.tags.longitude_deg is None and p.name in rows:
            longitude, latitude, height = rows[p.name]
            tags = replace(p.tags, longitude_deg=longitude, latitude_deg=latitude, height_m=height)
            placed.append(replace(p, tags=tags))
        else:
            placed.append(p)
    return placed


def _masks(folder: Path, names: list[str], project: Path) -> DraftMasks | None:
    """Return the folder of masks beside the photographs or among them, None where there is none."""
    places = [folder.absolute().parent / MASKS_FOLDER, folder / MASKS_FOLDER]
    masks = next((path for path in places if isdir(path)), None)
    if masks is None:
        return None
    try:
        return DraftMasks(_relative(masks, project), len(find_masks(masks, names).of_photograph))
    except ImageError as error:
        return DraftMasks(_relative(masks, project), error=str(error).splitlines()[0])


# ---- the file --------------------------------------------------------------------------------------------------------


def write_project(wanted: Request, progress: Progress = silent) -> ProjectDraft:
    """Read the tags of the photographs and write the project file; returns what is in it.

    Raises ProjectError where a figure cannot be, the project file exists already, or the map grid or a focal length is
    not known; ImageError where there are no photographs; FrameError where there is no such map grid; WorkspaceError
    where the file cannot be written.
    """
    project, photographs = wanted.project, wanted.photographs
    wrong = [f"{name}: {value:g} must be {allowed}" for name, value, allowed in wanted.out_of_range()]
    if wrong:
        raise ProjectError("\n".join(wrong))
    if exists(project) and not wanted.force:
        raise ProjectError(
            f"{project}: the project file exists already: give another with --project FILE, or --force to overwrite it"
        )
    inside = look_into(photographs, recursive=wanted.recursive)
    files = tuple(
        _control_file(path, role, wanted.marks, project, wanted.picture_size_px, wanted.control_sigma_m)
        for path, role in wanted.ground_points
    )
    tagged, unreadable = _inspect(photographs, inside.names, progress)
    tagged, pngs = _without_other_pngs(tagged, inside.pngs)
    tagged, twins = _without_deep_twins(tagged)
    tagged, duplicates = _without_duplicates(photographs, tagged)
    positions, tables = _positions(photographs, inside.others, [p.name for p in tagged], project)
    tagged = _with_places(tagged, positions)
    masks = _masks(photographs, [p.name for p in tagged], project)
    wishes = Wishes(
        wanted.crs,
        wanted.focal_px,
        wanted.focal_px_of,
        files,
        wanted.heights,
        _geoid(wanted.geoid, project),
        positions,
        masks,
    )
    draft = draft_project(tagged, [*unreadable, *pngs, *twins, *duplicates, *inside.left_out], wishes)
    given = {
        path.absolute() for path in (project, *(path for path, _ in wanted.ground_points), wanted.marks or project)
    }
    others = [n for n in inside.others if n not in tables and (photographs / n).absolute() not in given]
    draft = replace(draft, others=tuple(others), unsearched=inside.unsearched)
    with replacing(project) as partial:
        partial.write_text(project_text(draft, _relative(photographs, project)), encoding="utf-8")
    return draft


def read_back(project: Path) -> Findings:
    """Return what is doubtful in a project file that was just written. Raises ProjectError with what has to be mended
    by hand."""
    try:
        written = load_project(project)
    except ProjectError as error:
        raise ProjectError(f"{project} written; fix these errors first:\n{error}") from error
    return Findings(written.warnings)


def _paths(given: Path | str | Sequence[Path | str]) -> list[Path]:
    return [Path(path) for path in ([given] if isinstance(given, str | Path) else given)]


def init(
    photographs: Path | str,
    *,
    control: Path | str | Sequence[Path | str] = (),
    check: Path | str | Sequence[Path | str] = (),
    marks: Path | str | None = None,
    crs: str | None = None,
    project: Path | str = "project.yaml",
    picture_size_px: tuple[int, int] | None = None,
    control_sigma_m: float | None = None,
    heights: HeightSystem | None = None,
    geoid: str | None = None,
    focal_px: float | None = None,
    focal_px_of: Mapping[str, float] | None = None,
    recursive: bool = False,
    force: bool = False,
    progress: Progress = silent,
) -> NewProject:
    """Write a project file for a folder of photographs: cameras, positions, flights and map grid from their tags.

    ``control`` and ``check`` are files of control and check points (gcp_list.txt or a table), ``marks`` their image
    marks where those files hold none, measured in pictures of ``picture_size_px`` (width, height) where that is not the
    photographs' own. ``crs`` is the map grid, such as EPSG:25832; ``control_sigma_m`` the standard deviation of ground
    points that state none; ``heights`` says what the heights of the ground points are above, ``geoid`` which geoid.
    ``focal_px`` is the focal length where the tags give none, ``focal_px_of`` that of cameras by their names.
    ``recursive`` searches the folders within, ``force`` overwrites the project file, ``progress`` is told of each
    photograph that is read.

    Raises ProjectError where a figure cannot be, the project file exists already, the map grid or a focal length is not
    known, or what was written has to be completed by hand; ImageError where there are no photographs; FrameError where
    there is no such map grid; WorkspaceError where the file cannot be written.
    """
    if heights == "orthometric" and geoid is None and "+" not in (crs or ""):
        raise ProjectError("heights: orthometric heights need a geoid: EGM96, EPSG:5799 or the path of a grid")
    roles: list[tuple[Path, Role]] = [(path, "control") for path in _paths(control)]
    roles += [(path, "check") for path in _paths(check)]
    path = Path(project)
    draft = write_project(
        Request(
            photographs=Path(photographs),
            ground_points=tuple(roles),
            marks=None if marks is None else Path(marks),
            crs=crs,
            project=path,
            picture_size_px=picture_size_px,
            control_sigma_m=control_sigma_m,
            heights=heights,
            geoid=geoid,
            focal_px=focal_px,
            recursive=recursive,
            force=force,
            focal_px_of=focal_px_of or {},
        ),
        progress,
    )
    return NewProject(path, draft, read_back(path))
