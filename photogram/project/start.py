"""What a project starts from that another program has found: tie points, poses and interior orientations."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os.path import isfile  # false, not an exception, for a name that cannot be
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera, Pose
from photogram.errors import ExchangeError, ProjectError
from photogram.files.photographs.names import joined_names
from photogram.files.solutions.solution import ForeignSolution
from photogram.files.solutions.stored_solutions import read_stored
from photogram.project.document import Document
from photogram.project.findings import Finding
from photogram.project.schema import ProjectFile, Whose
from photogram.survey import TiePoints
from photogram.wording import some


@dataclass(frozen=True)
class InitialSolutionFile:
    """Where a project starts: a stored solution, and whose tie points and poses are used."""

    solution: Path
    """File of the solution."""
    tie_points: Whose
    """The other program's tie points, or key points and matches of photogram's own."""
    poses: Whose
    """The other program's poses, or an orientation of photogram's own."""


@dataclass(frozen=True, eq=False)
class InitialSolution:
    """What a solution says of a project's photographs (F) and cameras (C)."""

    tie_points: TiePoints
    """Tie points, numbered as the project numbers its photographs, without positions; ``feature`` numbers the
    observations of each photograph."""
    poses: tuple[Pose | None, ...]
    """Poses in the frame of the solution, None where it has none."""
    parameters: tuple[FloatArray | None, ...]
    """Interior orientation (12,) of each camera, None where the solution has it not."""

    def calibrated(self, cameras: Sequence[Camera]) -> tuple[Camera, ...]:
        """Return the cameras as the solution has them, but for parameters that the project holds fixed."""
        return tuple(
            camera
            if parameters is None
            else camera.with_parameters(np.where(camera.sigmas > 0, parameters, camera.parameters))
            for camera, parameters in zip(cameras, self.parameters, strict=True)
        )


def project_start(file: ProjectFile, base: Path) -> InitialSolutionFile | None:
    """Return where a project starts, its solution from the folder ``base``; None where it starts from photographs
    alone."""
    entry = file.start
    if entry is None or entry.solution is None:
        return None
    return InitialSolutionFile(base / entry.solution, entry.tie_points, entry.poses)


def read_start(document: Document, file: ProjectFile) -> ForeignSolution | None:
    """Return the solution that a project starts from, None without; what is wrong with it is noted in the document."""
    start = project_start(file, document.base)
    if start is None:
        return None
    key = ("start", "solution")
    if not isfile(start.solution):
        document.add_error(key, f"file {start.solution} not found: make it with photogram import")
        return None
    try:
        solution = read_stored(start.solution)
    except ExchangeError as error:
        document.add_error(key, str(error))
        return None
    if start.tie_points == "theirs" and not len(solution.tie_points.point):
        text = f"{start.solution.name} holds {solution.contents}: write tie_points: own, and photogram matches them"
        document.add_error(("start", "tie_points"), text)
    if start.poses == "theirs" and all(p.pose is None for p in solution.photographs):
        document.add_error(("start", "poses"), f"{start.solution.name} has no poses: write poses: own")
    return solution


def known_observations(start: InitialSolutionFile | None) -> int | None:
    """Return the number of observations of the tie points that a project starts from, None where it measures its own.
    Raises ExchangeError where the solution cannot be read."""
    return None if start is None or start.tie_points == "own" else len(read_stored(start.solution).tie_points.point)


_WHOSE_TIES: dict[Whose, str] = {"theirs": "tie points are those of the solution", "own": "tie points are matched anew"}
_WHOSE_POSES: dict[Whose, str] = {"theirs": "its poses are initial values", "own": "its poses are not used"}


def start_findings(start: InitialSolutionFile | None) -> list[Finding]:
    """Return what the solution holds that a project starts from, and what of it is used. Raises ExchangeError where it
    cannot be read."""
    if start is None:
        return []
    solution = read_stored(start.solution)
    text = f"the solution of {solution.program} holds {solution.contents}"
    return [Finding("note", "start", text, f"{_WHOSE_POSES[start.poses]}, {_WHOSE_TIES[start.tie_points]}")]


def check_start(
    document: Document,
    file: ProjectFile,
    solution: ForeignSolution,
    names: Sequence[str],
    camera_of: Sequence[int],
    cameras: Sequence[Camera],
) -> None:
    """Raise ProjectError where a solution is none of a project's photographs."""
    try:
        start_of(names, camera_of, cameras, solution)
    except ProjectError as error:
        written = "" if file.start is None else file.start.solution
        document.add_error(("start", "solution"), f"{written} {error}")
        document.raise_errors()


def start_of(
    names: Sequence[str], camera_of: Sequence[int], cameras: Sequence[Camera], solution: ForeignSolution
) -> InitialSolution:
    """Return what a solution says of photographs (F) of these names, whose cameras are of these numbers.

    Photographs are found by their names as other programs write them. Raises ProjectError where a name fits several,
    where none is in the solution, and where the sizes of pictures contradict each other.
    """
    joined, own = joined_names((p.path for p in solution.photographs), names), {name: i for i, name in enumerate(names)}
    theirs = {own[joined.of[p.path]]: i for i, p in enumerate(solution.photographs) if p.path in joined.of}
    if joined.ambiguous:
        raise ProjectError(
            f"names photographs that fit several of the project: {joined.ambiguities}: leave them in the folders that "
            "the solution has them in, or give each a name of its own"
        )
    if not theirs:
        raise ProjectError(
            f"has none of the photographs of the project: its are {some([p.name for p in solution.photographs])}"
        )
    _check_sizes(names, camera_of, cameras, solution, theirs)
    number = np.full(len(solution.photographs), -1, dtype=np.int64)
    number[list(theirs.values())] = list(theirs)
    poses = tuple(solution.photographs[theirs[i]].pose if i in theirs else None for i in range(len(names)))
    return InitialSolution(
        _renumbered(solution.tie_points, number), poses, _parameters(camera_of, len(cameras), solution, theirs)
    )


def _check_sizes(
    names: Sequence[str],
    camera_of: Sequence[int],
    cameras: Sequence[Camera],
    solution: ForeignSolution,
    theirs: Mapping[int, int],
) -> None:
    for i, j in theirs.items():
        own, other = cameras[camera_of[i]], solution.cameras[solution.photographs[j].camera]
        if (own.width_px, own.height_px) != (other.width_px, other.height_px):
            raise ProjectError(
                f"was made from pictures of {other.width_px} × {other.height_px} px, but {names[i]} has "
                f"{own.width_px} × {own.height_px} px: use the pictures that the other program had"
            )


def _renumbered(ties: TiePoints, number: np.ndarray[tuple[int], np.dtype[np.int64]]) -> TiePoints:
    """Return tie points with the photographs of new numbers, −1 for those to be left out, and two rays at least."""
    photograph = number[ties.photograph]
    known = photograph >= 0
    rays = np.bincount(ties.point[known], minlength=len(ties))
    kept = replace(ties, photograph=photograph).select(rays >= 2, known)
    order = np.lexsort((kept.photograph, kept.point))
    sorted_ties = replace(
        kept,
        photograph=kept.photograph[order],
        pixel=kept.pixel[order],
        sigma_px=kept.sigma_px[order],
        position_world_m=np.full((len(kept), 3), np.nan),
    )
    return replace(sorted_ties, feature=_numbered_in_photographs(sorted_ties))


def _numbered_in_photographs(tie_points: TiePoints) -> IntArray:
    """Return the number (N,) of each observation among those of its photograph."""
    order = np.argsort(tie_points.photograph, kind="stable")
    sorted_photographs = tie_points.photograph[order]
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order)) - np.searchsorted(sorted_photographs, sorted_photographs)
    return number


def _parameters(
    camera_of: Sequence[int], count: int, solution: ForeignSolution, theirs: Mapping[int, int]
) -> tuple[FloatArray | None, ...]:
    """Return the interior orientation of each camera: that of most of its photographs where the solution has several,
    None where it has none of its model."""
    members: list[Counter[int]] = [Counter() for _ in range(count)]
    for i, j in theirs.items():
        members[camera_of[i]][solution.photographs[j].camera] += 1
    most = [None if not group else group.most_common(1)[0][0] for group in members]
    return tuple(None if number is None else solution.cameras[number].parameters for number in most)
