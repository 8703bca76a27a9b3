"""A project that starts from another program's solution: cameras, poses, tie points, ground points and marks."""

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os.path import isdir, isfile, lexists  # false, not an exception, for a name that cannot be
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Camera
from photogram.errors import ExchangeError, ImageError, ProjectError, WorkspaceError
from photogram.exchange.draft import ImportedDraft, draft_import
from photogram.exchange.draft_text import MARKS, POINTS, POSITIONS, SOLUTION, imported_text
from photogram.exchange.formats.assembly import sentences
from photogram.exchange.formats.colmap.database import is_database, read_colmap_database
from photogram.exchange.formats.recognition import read_solution
from photogram.files.atomic import unwritable, write_whole
from photogram.files.marks.mark_table import write_marks
from photogram.files.photographs.images import inspect_photograph
from photogram.files.photographs.names import SUFFIXES, JoinedNames, joined_names
from photogram.files.portable import path_from
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.files.solutions.stored_solutions import write_stored
from photogram.files.tables.point_tables import write_point_table
from photogram.files.tables.position_tables import write_positions
from photogram.geodesy.crs import NO_CRS, is_geographic
from photogram.machine import cores
from photogram.pipeline.new_project import read_back
from photogram.project.draft.draft import LeftOut, TaggedPhotograph
from photogram.project.findings import Findings
from photogram.sfm.tie_points.tracks import join_matches
from photogram.survey import Features
from photogram.wording import Progress, html_table, silent, some, things

_PLACES = (".", "images", "..", "../images", "../..", "../../images")
"""Folders, from that of the solution, in which the photographs are looked for."""


@dataclass(frozen=True, eq=False)
class ImportedProject:
    """A project file that was written: its ``path``, the ``draft`` that it was written from, the ``files`` beside it,
    the ``warnings`` that reading it gives, and what was ``left_out`` of the solution, in sentences."""

    path: Path
    draft: ImportedDraft
    files: tuple[Path, ...]
    warnings: Findings
    left_out: tuple[str, ...]

    def _facts(self) -> list[tuple[str, str]]:
        draft = self.draft
        return [
            ("solution", f"{draft.program}: {draft.contents}"),
            ("photographs", f"{len(draft.photographs)}, {len(draft.left_out)} not there"),
            ("tie points", draft.tie_points),
            ("poses", draft.poses),
            ("map grid", f"{draft.crs} ({draft.crs_name})"),
            ("ground points", str(len(draft.points))),
            *(("left out", text) for text in self.left_out),
            *(("warning", str(text)) for text in self.warnings),
        ]

    def __repr__(self) -> str:
        photographs = things(len(self.draft.photographs), "photograph")
        return f"<ImportedProject {self.path}: {photographs} of {self.draft.program}>"

    def _repr_html_(self) -> str:
        return html_table(str(self.path), (), self._facts())


def import_solution(
    solution: Path | str,
    *,
    photographs: Path | str | None = None,
    project: Path | str = "project.yaml",
    crs: str | None = None,
    check: Sequence[str] = (),
    force: bool = False,
    progress: Progress = silent,
) -> ImportedProject:
    """Write a project file that starts from another program's solution, or from the matches of a database of COLMAP.

    ``photographs`` is their folder, where it is not the one that the solution names or lies in; those that it has not
    are left out. ``crs`` is that of the solution's ground points and positions, where its files do not say it; ground
    points named under ``check`` are check points. ``force`` overwrites the files that are written: the project, the
    solution in photogram's form, and tables of positions, points and marks beside it.

    Raises ExchangeError where the solution cannot be read, ImageError where no photograph is found, ProjectError where
    a file is there already, the CRS is not known, or a point is not in the solution; FrameError where PROJ does not
    know the CRS; WorkspaceError where a file cannot be written.
    """
    path, source = Path(project), Path(solution)
    targets = {name: path.parent / name for name in (SOLUTION, POSITIONS, POINTS, MARKS)}
    _check_targets((path, *targets.values()), force=force)
    foreign = _of_database(source) if is_database(source) else read_solution(source)
    folder, files = _photographs(source, foreign, None if photographs is None else Path(photographs))
    tagged, left_out = _inspected(folder, foreign, files, progress)
    draft = draft_import(foreign, tagged, left_out, crs, check)
    written = [targets[SOLUTION]]
    write_stored(targets[SOLUTION], foreign)
    geographic = draft.measured_crs is not None and is_geographic(draft.measured_crs)
    if draft.measured and draft.crs != NO_CRS:
        write_positions(targets[POSITIONS], draft.measured, geographic=geographic)
        written.append(targets[POSITIONS])
    if draft.points:
        write_point_table(targets[POINTS], draft.points, geographic=geographic)
        written.append(targets[POINTS])
    if draft.points and draft.marks:
        write_marks(targets[MARKS], draft.marks)
        written.append(targets[MARKS])
    folder_name = path_from(path.parent, folder).as_posix()
    write_whole(path, imported_text(draft, folder_name))
    return ImportedProject(path, draft, tuple(written), read_back(path), (*foreign.left_out, *draft.notes))


def _check_targets(files: Sequence[Path], *, force: bool) -> None:
    """Raise before anything is read where a file of one folder is there already, or cannot be written."""
    there = [file for file in files if lexists(file)]
    if there and not force:
        raise ProjectError(f"{there[0]}: already exists; choose another --project or use --force")
    for file in there:
        if isdir(file):
            raise ProjectError(f"{file}: is a folder: give another project with --project FILE")
    folder = files[0].absolute().parent
    if not isdir(folder):
        raise WorkspaceError(f"{folder}: folder not found: make it, or give another project with --project FILE")
    reason = unwritable(folder)
    if reason:
        raise WorkspaceError(f"{folder}: {reason}: allow it, or give another project with --project FILE")


# ---- the solution ----------------------------------------------------------------------------------------------------


def _of_database(path: Path) -> ForeignSolution:
    """Return the photographs and cameras of a database of COLMAP, and its verified matches joined to tie points."""
    database = read_colmap_database(path)
    features = [_features(pixel) for pixel in database.pixels]
    joined = join_matches(features, database.matches, [np.ones(len(pixel)) for pixel in database.pixels])
    if not len(joined.tie_points):
        raise ExchangeError(f"{path}: has no verified matches: run one of COLMAP's matchers, and its verification")
    conflicts = things(joined.conflicts, "set of matches", "sets of matches")
    lost = sentences((joined.conflicts, f"{conflicts} with two key points of a photograph."))
    photographs = tuple(
        ForeignPhotograph(file.name, camera, None, file)
        for camera, file in zip(database.camera_of, database.files, strict=True)
    )
    return ForeignSolution(
        "COLMAP (database)", database.cameras, photographs, joined.tie_points, left_out=(*database.left_out, *lost)
    )


def _features(pixel: FloatArray) -> Features:
    """Return key points (N, 2) without size, angle, descriptor and colour."""
    count = len(pixel)
    no_descriptor, black = np.zeros((count, 0), dtype=np.uint8), np.zeros((count, 3), dtype=np.uint8)
    return Features(pixel, np.zeros(count), np.zeros(count), no_descriptor, black)


# ---- the photographs -------------------------------------------------------------------------------------------------


def _photographs(source: Path, solution: ForeignSolution, given: Path | None) -> tuple[Path, dict[str, str]]:
    """Return the folder of the photographs, and their names in it by those in the solution."""
    if given is not None:
        if not isdir(given):
            raise ImageError(f"{given}: folder not found: give the folder of the photographs")
        joined = _joined(given, solution, given.rglob("*"))
        if not (joined.of or joined.ambiguous):
            raise ImageError(
                f"{given}: has none of the photographs of the solution: these are "
                f"{some([p.name for p in solution.photographs])}"
            )
        folder = given
    else:
        counted = [(each, _joined(each, solution, each.iterdir())) for each in _folders(source, solution)]
        folder, joined = max(counted, key=lambda each: len(each[1].of), default=(source, JoinedNames({}, {})))
        if not joined.of:
            raise ImageError(
                f"{source}: its photographs are neither where the solution names them nor near it: give their folder "
                "with --photographs DIR"
            )
    if joined.ambiguous:
        raise ImageError(
            f"{folder}: names of the solution fit several files, {joined.ambiguities}: give the folder of the right "
            "ones"
        )
    return folder, {p.name: joined.of[p.path] for p in solution.photographs if p.path in joined.of}


def _joined(folder: Path, solution: ForeignSolution, files: Iterable[Path]) -> JoinedNames:
    """Return which of the pictures of a folder the photographs of a solution are."""
    wanted = {p.name for p in solution.photographs}
    there = [f for f in files if (f.name in wanted or f.suffix.lower() in SUFFIXES) and isfile(f)]
    return joined_names((p.path for p in solution.photographs), sorted(f.relative_to(folder).as_posix() for f in there))


def _folders(source: Path, solution: ForeignSolution) -> Iterable[Path]:
    base = source if isdir(source) else source.parent
    named = {Path(p.file).parent for p in solution.photographs}
    yield from sorted(folder for folder in named if folder.is_absolute() and isdir(folder))
    for place in _PLACES:
        folder = base / place
        if isdir(folder):
            yield folder.resolve()


def _inspected(
    folder: Path, solution: ForeignSolution, files: Mapping[str, str], progress: Progress
) -> tuple[dict[str, TaggedPhotograph], list[LeftOut]]:
    """Return the photographs with their tags, by their names in the solution, and those that cannot be used."""
    usable, left_out = dict[str, TaggedPhotograph](), list[LeftOut]()
    with ThreadPoolExecutor(cores()) as executor:
        read = executor.map(
            lambda p: _tagged(folder, solution.cameras[p.camera], p.name, files.get(p.name)), solution.photographs
        )
        for done, (photograph, tagged) in enumerate(zip(solution.photographs, read, strict=True), 1):
            if isinstance(tagged, LeftOut):
                left_out.append(tagged)
            else:
                usable[photograph.name] = tagged
            progress(done, len(solution.photographs), photograph.name)
    return usable, left_out


def _tagged(folder: Path, camera: Camera, name: str, file: str | None) -> TaggedPhotograph | LeftOut:
    if file is None:
        return LeftOut(name, f"no such file in {folder.name}")
    try:
        tags = inspect_photograph(folder / file)
    except ImageError as error:
        return LeftOut(name, str(error).removeprefix(f"photograph {folder / file}: "))
    if (tags.width_px, tags.height_px) != (camera.width_px, camera.height_px):
        return LeftOut(
            name,
            f"it has {tags.width_px} × {tags.height_px} px, and {camera.width_px} × {camera.height_px} px in the "
            "solution",
        )
    return TaggedPhotograph(file, tags)
