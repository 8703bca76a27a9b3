"""Gross contradictions on the ground, found where the joint adjustment would be bent by them beyond repair.

The photographs are adjusted without any control point; each point is intersected from the largest set of its marks that
agree, and the similarity that most of them agree with takes them to their surveyed positions (robust S-transformation;
Caspary 2000, ch. 4). What stays off is gross: blunders of metres and of dozens of pixels, not of centimetres.
"""

from dataclasses import replace
from itertools import combinations

import numpy as np

from photogram.amendments.gross_errors.data_snooping import Adjuster
from photogram.amendments.gross_errors.hypothesis import Hypothesis, unmeasured
from photogram.arrays import FloatArray
from photogram.errors import OrientationError
from photogram.sfm.marked_points import intersected_marks
from photogram.sfm.similarity import fit_similarity, robust_similarity
from photogram.survey import Block

BENDS = (0.0003, 0.001, 0.005)  # of the extent: what a block without control may be bent by, the stiffest first
GAUGE = 0.05  # of the flying height: sigma of the positions that hold a block without GNSS in place
AGREEING = 4  # points: three fit nearly always
FEW = 8  # points, among which two exchanged ones may leave no majority
_LIMIT = 4.0


def _without_control(block: Block) -> Block:
    """Return the block without control, held by GNSS, or where there is too little of it by its starting positions."""
    points = block.control_points.with_roles(["check"] * len(block.control_points))
    photographs = block.photographs
    if sum(p.gnss_world_m is not None for p in photographs) < 3:
        heights = [pose.position_world_m[2] for pose in block.poses if pose is not None]
        ground = block.control_points.position_world_m[block.control_points.controlled[:, 2], 2]
        flying_m = float(np.median(heights) - np.median(ground)) if len(ground) else 0.0
        sigma = np.full(3, max(GAUGE * flying_m, 1.0))
        photographs = tuple(
            p
            if pose is None
            else replace(p, gnss_world_m=pose.position_world_m, gnss_sigma_m=sigma, gnss_sigma_assumed=False)
            for p, pose in zip(photographs, block.poses, strict=True)
        )
    return replace(block, control_points=points, photographs=photographs)


def _exchange(position: FloatArray, target: FloatArray, sigma: FloatArray) -> tuple[int, int] | None:
    """Return the two points whose exchange makes all of them fit a similarity, None where no exchange does."""
    best, least = None, _LIMIT
    for a, b in combinations(range(len(target)), 2):
        order = np.arange(len(target))
        order[[a, b]] = b, a
        misfit = fit_similarity(position, target[order], 1.0 / sigma**2).points(position) - target[order]
        worst = float(np.max(np.linalg.norm(misfit, axis=1) / sigma))
        if worst < least:
            best, least = (a, b), worst
    return best


def gross_blunders(block: Block, adjust: Adjuster) -> list[Hypothesis]:
    """Return the control points and marks that are grossly off, none where too few agree to say so."""
    result = adjust(_without_control(block))
    points, names = block.control_points, block.photograph_names
    position, agreed = intersected_marks(result.block)
    control = np.asarray(points.controlled.any(axis=1))
    enough = np.asarray(np.isfinite(position).all(axis=1))
    off = np.flatnonzero(~agreed & enough[points.mark_point] & control[points.mark_point])
    rejected = [
        unmeasured("mark", points.name[points.mark_point[m]], names[points.mark_photograph[m]]) for m in off.tolist()
    ]
    whole = np.flatnonzero(points.controlled.all(axis=1) & enough)
    target = points.position_world_m[whole]
    extent = float(np.linalg.norm(np.ptp(target, axis=0))) if len(whole) else 0.0
    for bend in BENDS:
        sigma = np.linalg.norm(points.sigma_m[whole], axis=1) + bend * extent
        try:
            _, agree = robust_similarity(position[whole], target, sigma)
        except OrientationError:
            agree = np.zeros(len(whole), dtype=bool)
        if agree.sum() < AGREEING <= len(whole) <= FEW:
            # two of so few leave no majority that could outvote them
            exchanged = _exchange(position[whole], target, sigma)
            agree = ~np.isin(np.arange(len(whole)), exchanged) if exchanged else agree
        if agree.sum() >= min(AGREEING, len(whole) - 2):
            return rejected + [unmeasured("control point", points.name[g]) for g in whole[~agree].tolist()]
    return rejected
