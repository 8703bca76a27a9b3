"""What writers of solutions share: what can be written at all, paths, and sentences on what has no place.

The sentences name what is missing and no more: they stand below the words "Not in it:".
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from photogram.arrays import BoolArray
from photogram.errors import ExchangeError
from photogram.files.solutions.parsing import file_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.survey import TiePoints
from photogram.wording import printable, things


def check_writable(path: Path, solution: ForeignSolution) -> None:
    """Raise ExchangeError where a solution holds what no file can: values that are not finite, names that are none."""
    for photograph in solution.photographs:
        if file_of(str(path), photograph.name).name != photograph.name or "\\" in photograph.name:
            raise ExchangeError(f"{path}: photograph {printable(photograph.name)!r} has a name that is no file's")
        file_of(str(path), str(photograph.file))
        pose = photograph.pose
        if pose is not None and not (
            np.isfinite(pose.rotation_world_from_camera).all() and np.isfinite(pose.position_world_m).all()
        ):
            raise ExchangeError(f"{path}: photograph {photograph.name} has a pose that is not finite: leave it out")
    for camera in solution.cameras:
        if not np.isfinite(camera.parameters).all():
            raise ExchangeError(f"{path}: camera {camera.name} has parameters that are not finite: leave it out")


def path_to_write(photograph: ForeignPhotograph) -> str:
    """Return the path that another program shall find a photograph by: the one it was read with where that leads into a
    folder, else its name."""
    file = photograph.file
    leads_away = file.is_absolute() or ".." in file.parts or re.match(r"[A-Za-z]:", file.parts[0])
    return photograph.name if leads_away else str(file)


def oriented_tie_points(solution: ForeignSolution) -> tuple[TiePoints, list[str]]:
    """Return the tie points that have a position with their observations in oriented photographs, and sentences on the
    others."""
    tie = solution.tie_points
    known: BoolArray = np.asarray(np.isfinite(tie.position_world_m).all(axis=1))
    oriented = np.array([photograph.pose is not None for photograph in solution.photographs], dtype=bool)
    kept: BoolArray = np.asarray(known[tie.point] & oriented[tie.photograph])
    unknown, lost = int((~known).sum()), int((~kept).sum())
    left_out = [f"{things(unknown, 'tie point')} without a position."] if unknown else []
    if lost:
        left_out.append(
            f"{things(lost, 'observation')} of tie points without a position or in photographs without an orientation."
        )
    return tie.select(known, kept), left_out


def unoriented_photographs(solution: ForeignSolution) -> Iterator[str]:
    """Give a sentence on the photographs without an orientation, where there are any."""
    count = sum(photograph.pose is None for photograph in solution.photographs)
    if count:
        yield f"{things(count, 'photograph')} without an orientation."


def without_place(solution: ForeignSolution, *, has_origin: bool = False, has_measured: bool = False) -> Iterator[str]:
    """Give sentences on what a format cannot hold that knows no ground points; ``has_origin`` where it knows that of a
    topocentric frame, ``has_measured`` where it knows measured positions."""
    if solution.frame != "local" and not (has_origin and solution.frame == "topocentric"):
        yield f"What the coordinates are: {_FRAMES[solution.frame]}."
    if solution.ground_points is not None:
        yield "Ground points and their marks."
    if not has_measured and any(photograph.measured is not None for photograph in solution.photographs):
        yield "Measured positions of photographs."


_FRAMES = {
    "topocentric": "east, north and up at an origin",
    "geocentric": "geocentric ones of WGS 84",
    "map": "those of a map",
}
