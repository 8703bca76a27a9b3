"""The components of a survey, which share no tie points, placed in one world: by control points, by GNSS positions, or
by marked points that others show too. What is placed is adjusted as one system; nothing of it needs to see the rest.

The first component settles a camera's calibration where it can; the others are adjusted with it, since each alone would
trade its focal length for its height.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Pose, Similarity
from photogram.errors import OrientationError
from photogram.measures.collinearity import collinear
from photogram.measures.vertical import Vertical
from photogram.sfm.georeference import SHAPE_TOLERANCE, georeference, intersected_control, placed_by
from photogram.sfm.reconstruction import PHOTOGRAPHS_FOR_CALIBRATION, Structure
from photogram.sfm.similarity import LIMIT, common_rotation, robust_similarity
from photogram.survey import Block
from photogram.wording import things

Tie = Literal["", "control points", "GNSS positions", "marked points"]
"""What places a component in the world, empty for nothing."""

FEWEST_PHOTOGRAPHS = 3  # of a component that GNSS positions place, fewer than which fit any positions
LARGEST_TURN_RAD = float(np.deg2rad(20.0))
"""Between the measured attitudes of a component, once placed, and how those of the first are turned on the whole."""
FAR_M, FAR_EXTENTS = 1000.0, 10.0
"""From the first, and in its extents, the larger of both, beyond which a component is another site: one map of both
would be empty."""
CONFIRMED_POINTS, CONFIRMED_SHARE = 10, 0.5
"""Agreeing tie points, and of those visible, that join a photograph whose measured position confirms its pose."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Components in the order in which they were given: the similarity of each to the world, None where nothing places
    it, what does, and why nothing does."""

    fits: tuple[Similarity | None, ...]
    ties: tuple[Tie, ...]
    reasons: tuple[str, ...]

    @property
    def first(self) -> int:
        """Return the number of the first component that is placed."""
        return next(number for number, fit in enumerate(self.fits) if fit is not None)


def share_calibration(structures: Sequence[Structure]) -> tuple[FloatArray, ...]:
    """Adjust components with the calibrations of the first that is large enough to have one, and return these (12,) by
    camera."""
    first = structures[0]
    settled = np.zeros(len(first.cameras), dtype=bool)
    parameters = first.parameters.copy()
    for structure in structures:
        used = np.bincount(structure.camera_of[structure.registered], minlength=len(settled)) > 0
        if np.any(settled & used):
            structure.parameters = np.where(settled[:, None], parameters, structure.parameters)
            for _ in range(2):
                structure.adjust(calibrate=False)
                structure.judge()
                structure.intersect()
        if structure.registered.sum() >= PHOTOGRAPHS_FOR_CALIBRATION or structure is first:
            parameters = np.where((used & ~settled)[:, None], structure.parameters, parameters)
            settled |= used
    return tuple(parameters)


def _turn(structure: Structure, fit: Similarity, block: Block) -> FloatArray | None:
    """Return the rotation (3, 3) common to the measured attitudes of a component from its own, once placed."""
    given = [
        (fit.rotation @ structure.rotation[i], attitude)
        for i in np.flatnonzero(structure.registered).tolist()
        if (attitude := block.photographs[i].attitude_world_from_camera) is not None
    ]
    return common_rotation(np.array([own @ attitude.T for own, attitude in given])) if given else None


def _turned_rad(one: FloatArray, other: FloatArray) -> float:
    return float(np.arccos(np.clip((np.trace(one.T @ other) - 1.0) / 2.0, -1.0, 1.0)))


def _check_near(first: FloatArray, further: FloatArray) -> None:
    """Raise OrientationError where projection centres (K, 3) lie so far from those of the first component (N, 3) that
    they are of another site."""
    extent_m = float(np.linalg.norm(np.ptp(first, axis=0)))
    away_m = float(np.linalg.norm(further.mean(axis=0) - first.mean(axis=0)))
    if away_m > max(FAR_M, FAR_EXTENTS * extent_m):
        raise OrientationError(f"it lies {away_m / 1000.0:.1f} km off: another site, give it a project of its own")


def _trusted(
    structure: Structure, block: Block, vertical: Vertical, turn: FloatArray | None, first: FloatArray
) -> tuple[Similarity, Tie]:
    """Return the similarity of a further component, and what gives it; ``first`` (N, 3) are the projection centres of
    the first in the world. Raises OrientationError where it cannot be told from a component of wrong matches, or is of
    another site."""
    tie: Tie = placed_by(structure, block)
    count = int(structure.registered.sum())
    if tie == "GNSS positions" and count < FEWEST_PHOTOGRAPHS:
        raise OrientationError(f"{things(count, 'position')} fit any component: {FEWEST_PHOTOGRAPHS} are needed")
    fit = georeference(structure, block, vertical)
    if tie == "GNSS positions":
        _check_near(first, fit.points(structure.position[structure.registered]))
    if tie == "GNSS positions" and _misfit(structure, fit, block) > LIMIT:
        raise OrientationError("its GNSS positions do not agree with its shape")
    own = _turn(structure, fit, block)
    if tie == "GNSS positions" and own is not None and turn is not None and _turned_rad(own, turn) > LARGEST_TURN_RAD:
        raise OrientationError("its GNSS positions contradict its measured attitudes")
    return fit, tie


def _marked_world(structures: Sequence[Structure], fits: Sequence[Similarity | None], block: Block) -> FloatArray:
    """Return where placed components have the marked points (G, 3) in the world, NaN where none shows them."""
    world = np.full((len(block.control_points), 3), np.nan)
    for structure, fit in zip(structures, fits, strict=True):
        if fit is not None:
            points = fit.points(intersected_control(structure, block.control_points))
            world = np.where(np.isnan(world), points, world)
    return world


def _by_marked_points(structure: Structure, block: Block, world: FloatArray) -> Similarity | None:
    """Return the similarity that takes the marked points of a component to those of others (G, 3)."""
    own = intersected_control(structure, block.control_points)
    common = np.isfinite(own).all(axis=1) & np.isfinite(world).all(axis=1)
    if common.sum() < 3 or collinear(world[common]):
        return None
    tolerance = SHAPE_TOLERANCE * float(np.linalg.norm(np.ptp(world[common], axis=0)))
    try:
        return robust_similarity(own[common], world[common], np.full(int(common.sum()), tolerance))[0]
    except OrientationError:
        return None


def place(structures: Sequence[Structure], block: Block, vertical: Vertical) -> Placed:
    """Place components in the world, each by what is measured of it; what that leaves, by the marked points that it has
    in common with those placed. Of a free network the first is the world.

    Raises OrientationError where none is placed, for the reason that the first is not.
    """
    fits: list[Similarity | None] = [None] * len(structures)
    ties: list[Tie] = [""] * len(structures)
    reasons, turn, centres = [""] * len(structures), None, np.zeros((0, 3))
    for number, structure in enumerate(structures if not block.is_free else structures[:1]):
        try:
            if any(fit is not None for fit in fits):
                fits[number], ties[number] = _trusted(structure, block, vertical, turn, centres)
            else:
                first = georeference(structure, block, vertical)
                fits[number], ties[number] = first, placed_by(structure, block)
                turn = _turn(structure, first, block)
                centres = first.points(structure.position[structure.registered])
        except OrientationError as error:
            reasons[number] = str(error)
    if all(fit is None for fit in fits):
        raise OrientationError(reasons[0])
    while True:
        world, before = _marked_world(structures, fits, block), fits.count(None)
        for number, structure in enumerate(structures):
            if fits[number] is None and (fit := _by_marked_points(structure, block, world)) is not None:
                fits[number], ties[number], reasons[number] = fit, "marked points", ""
        if fits.count(None) == before:
            return Placed(tuple(fits), tuple(ties), tuple(reasons))


def join_confirmed(structure: Structure, fit: Similarity, block: Block, candidates: BoolArray) -> None:
    """Join photographs of ``candidates`` (N,) that see fewer tie points of a placed component than growth asks for,
    where their measured positions confirm what these say."""
    strict, offset = structure.settings, _common_offset_m(structure, fit, block)
    structure.settings = replace(strict, minimum_points=CONFIRMED_POINTS, minimum_share=CONFIRMED_SHARE)
    for index in np.flatnonzero(candidates & ~structure.registered).tolist():
        measured, sigma_m = block.photographs[index].gnss_world_m, block.photographs[index].gnss_sigma_m
        if measured is None or sigma_m is None or not structure.resect(index):
            continue
        found = fit.points(structure.position[index][None])[0]
        off = np.linalg.norm((found - measured - offset) / np.maximum(sigma_m, _tolerance_m(structure, fit, index)))
        if off > LIMIT:
            structure.withdraw(np.arange(len(candidates)) == index)
    structure.settings = strict


def _off_m(structure: Structure, fit: Similarity, block: Block) -> tuple[FloatArray, FloatArray]:
    """Return by how much photographs of a placed component stand off their measured positions (K, 3), and the standard
    deviations (K, 3) of these."""
    index = [i for i in np.flatnonzero(structure.registered) if block.photographs[i].gnss_world_m is not None]
    measured = np.array([block.photographs[i].gnss_world_m for i in index]).reshape(-1, 3)
    sigma_m = np.array([block.photographs[i].gnss_sigma_m for i in index]).reshape(-1, 3)
    return fit.points(structure.position[index]) - measured, sigma_m


def _misfit(structure: Structure, fit: Similarity, block: Block) -> float:
    """Return by how many standard deviations most photographs stand off their measured positions."""
    off_m, sigma_m = _off_m(structure, fit, block)
    bent_m = SHAPE_TOLERANCE * float(np.linalg.norm(np.ptp(structure.position[structure.registered], axis=0)))
    return float(np.median(np.linalg.norm(off_m, axis=1) / (np.linalg.norm(sigma_m, axis=1) + fit.scale * bent_m)))


def _common_offset_m(structure: Structure, fit: Similarity, block: Block) -> FloatArray:
    """Return by how much most photographs of a placed component stand off their measured positions (3,): positions of
    another height system are so together."""
    off_m = _off_m(structure, fit, block)[0]
    return np.median(off_m, axis=0) if len(off_m) else np.zeros(3)


def _tolerance_m(structure: Structure, fit: Similarity, index: int) -> float:
    """Return how well a photograph of few points tells where it stands: a share of its distance from them."""
    points = structure.point[structure.tie_points.point[structure.observations_of(index)]]
    distance = np.linalg.norm(points - structure.position[index], axis=1)
    return float(SHAPE_TOLERANCE * fit.scale * np.nanmedian(distance))


def world_poses(structures: Sequence[Structure], placed: Placed) -> tuple[list[Pose | None], list[int]]:
    """Return the poses of all placed photographs in the world, and the component of each photograph, −1 for none."""
    poses: list[Pose | None] = [None] * len(structures[0].registered)
    component = [-1] * len(poses)
    for number, (structure, fit) in enumerate(zip(structures, placed.fits, strict=True)):
        for index, pose in enumerate(structure.poses()):
            if pose is not None:
                component[index] = number
                poses[index] = None if fit is None else fit.pose(pose)
    return poses, component
