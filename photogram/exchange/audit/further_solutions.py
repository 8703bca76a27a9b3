"""Further solutions of the same photographs by other programs: what they share with the one that is audited.

Photographs are the same where their names are, as other programs write them, ground points where their surveyed
coordinates are: programs number them in their own ways.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera
from photogram.errors import ExchangeError
from photogram.exchange.audit.differences import (
    PoseDifference,
    brought,
    calibration_differences,
    cameras_of,
    pose_differences,
    poses_of,
)
from photogram.exchange.audit.fits import Fit, fit_of_solution
from photogram.exchange.audit.foreign_block import ForeignBlock, map_points
from photogram.files.photographs.names import joined_names
from photogram.files.solutions.solution import ForeignSolution
from photogram.results import Adjustment
from photogram.survey import Block
from photogram.wording import some

SAME_M = 0.001
"""What surveyed coordinates of the same point may differ by: programs round them."""
MOST_NAMED = 5


@dataclass(frozen=True, eq=False)
class FurtherSolution:
    """A further solution, compared with photogram's adjustment of the one that is audited."""

    solution: ForeignSolution
    start: ForeignBlock
    fit: Fit
    """How it fits its own measurements."""
    photograph_of: IntArray
    """Its photographs (N,) by those of the audited solution, −1 without."""
    point_of: IntArray
    """Its ground points by those of the audited block (G,), −1 without."""
    is_in_the_same_map: bool
    """Whether its poses are compared as its files place them, and not after a similarity."""
    cameras: tuple[Camera | None, ...]
    """Its cameras by those of the audited solution, None without."""
    poses: tuple[PoseDifference, ...]
    parameter_sigmas: FloatArray
    """Interior orientations (cameras, 12), theirs minus ours, over the standard deviations of ours; NaN without."""


def check_shared(solution: ForeignSolution, other: ForeignSolution) -> None:
    """Raise ExchangeError where two solutions share no photograph."""
    if (shared_photographs(solution, other) >= 0).any():
        return
    names = [some([p.name for p in each.photographs], MOST_NAMED) or "none" for each in (solution, other)]
    raise ExchangeError(
        f"{other.program}: shares no photograph with {solution.program}: it has {names[1]}, the other {names[0]}: "
        "name solutions of the same photographs"
    )


def shared_photographs(solution: ForeignSolution, other: ForeignSolution) -> IntArray:
    """Return the photographs of ``other`` that those of a solution (N,) are, −1 for those that it has not; names are
    joined as other programs write them, where one fits."""
    number = {photograph.path: i for i, photograph in enumerate(other.photographs)}
    of = joined_names((photograph.path for photograph in solution.photographs), list(number)).of
    return np.array([number.get(of.get(p.path, ""), -1) for p in solution.photographs], dtype=np.int64)


def same_points(points_m: FloatArray, others_m: FloatArray) -> IntArray:
    """Return which of other surveyed points (K, 3) those of a survey (G, 3) are, −1 for none; NaN is nowhere."""
    same = np.full(len(points_m), -1, dtype=np.int64)
    known, there = (np.flatnonzero(np.isfinite(rows).all(axis=1)) for rows in (points_m, others_m))
    if len(known) and len(there):
        distance, nearest = (np.atleast_1d(a) for a in KDTree(others_m[there]).query(points_m[known], p=np.inf))
        near = distance <= SAME_M
        same[known[near]] = there[nearest[near]]
    return same


def checks_of(solutions: Sequence[ForeignSolution], names: Sequence[str], crs: str | None) -> list[list[str]]:
    """Return for each solution the names of the points that ``names`` mean in any of them: its own of that name, else
    the one with the same surveyed coordinates. Raises ExchangeError where a name is in none."""
    surveys = [map_points(solution, crs or solution.crs) for solution in solutions]
    own = [() if solution.ground_points is None else solution.ground_points.name for solution in solutions]
    meant: list[list[str]] = [[] for _ in solutions]
    for name in names:
        at = [(s, meant_by(name, points)) for s, points in enumerate(own)]
        at = [(s, g) for s, g in at if g is not None]
        if not at:
            there = some([n for points in own for n in points], MOST_NAMED) or "none"
            raise ExchangeError(f"{name}: no such ground point in {_programs(solutions)}; there are {there}")
        first, g = at[0]
        if g is None:
            continue
        for s in range(len(solutions)):
            same = g if s == first else _same_in(surveys[first], surveys[s], g)
            if same >= 0 and own[s][same] not in meant[s]:
                meant[s].append(own[s][same])
    return meant


def _programs(solutions: Sequence[ForeignSolution]) -> str:
    return "the solution" if len(solutions) == 1 else some([solution.program for solution in solutions])


def meant_by(name: str, points: Sequence[str]) -> int | None:
    """Return the number of the point that a name means: its own, or the one whose first word it is; None for none."""
    if name in points:
        return points.index(name)
    begun = [g for g, point in enumerate(points) if point.split(" ")[0] == name]
    return begun[0] if len(begun) == 1 else None


def _same_in(one: tuple[str | None, FloatArray], other: tuple[str | None, FloatArray], g: int) -> int:
    if None not in (one[0], other[0]) and one[0] != other[0]:
        return -1
    return int(same_points(one[1][g : g + 1], other[1])[0])


def further_solution(
    solution: ForeignSolution, start: ForeignBlock, audited: ForeignSolution, result: Adjustment
) -> FurtherSolution:
    """Return a further solution compared with the adjustment of the audited one."""
    of, points = shared_photographs(audited, solution), _points_of(result, start)
    cameras = cameras_of(solution, of, result.block)
    is_same_map = _is_same_map(result.block, start.theirs, points)
    moved = brought(start, of, result, is_same_map=is_same_map)
    return FurtherSolution(
        solution,
        start,
        fit_of_solution(solution, start.theirs),
        of,
        points,
        start.is_placed and is_same_map,
        tuple(cameras),
        () if moved is None else tuple(pose_differences(poses_of(moved, of), result)),
        calibration_differences(cameras, result)[1],
    )


def _is_same_map(block: Block, other: Block, points: IntArray) -> bool:
    """Return whether two blocks lie in the same map: a system without a name is another one where no point is
    shared."""
    if block.is_free or other.is_free or block.frame.crs != other.frame.crs:
        return False
    return not block.frame.is_local or bool((points >= 0).any())


def _points_of(result: Adjustment, start: ForeignBlock) -> IntArray:
    own, other = result.block, start.theirs
    if own.frame.crs != other.frame.crs:
        return np.full(len(own.control_points), -1, dtype=np.int64)
    surveyed = [block.frame.map_from_world(block.control_points.position_world_m) for block in (own, other)]
    return same_points(*surveyed)
