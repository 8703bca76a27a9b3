"""Gross contradictions on the ground, found where the joint adjustment would be bent by them beyond repair.

The photographs are adjusted without any control point; each point is intersected from the largest set of its marks that
agree, and the similarity that most of them agree with takes them to their surveyed positions (robust S-transformation;
Caspary 2000, ch. 4). What stays off is gross: blunders of metres and of dozens of pixels, not of centimetres.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from photogram.blunders import Accusation, Adjuster, unmeasured
from photogram.camera import image_plane_or_nan, models_of
from photogram.errors import OrientationError
from photogram.similarity import fit_similarity, robust_similarity
from photogram.survey import Block, FloatArray
from photogram.triangulation import consensus_intersections

BENDS = (0.0003, 0.001, 0.005)  # of the extent: what a block without control may be bent by, the stiffest first
AGREE_PX = 5.0  # of marks, beside their own sigma
GAUGE = 0.05  # of the flying height: sigma of the positions that hold a block without GNSS in place
AGREEING = 4  # points: three fit nearly always
FEW = 8  # points, among which two exchanged ones may leave no majority
_LIMIT = 4.0


def _held_in_place(block: Block) -> Block:
    """Return the block without control, held by GNSS, or where there is too little of it by its starting positions."""
    points = block.control_points.with_roles(["check"] * len(block.control_points))
    photographs = block.photographs
    if sum(p.gnss_world_m is not None for p in photographs) < 3:
        heights = [pose.position_world_m[2] for pose in block.poses if pose is not None]
        ground = block.control_points.position_world_m[block.control_points.controlled[:, 2], 2]
        flying_m = float(np.median(heights) - np.median(ground)) if len(ground) else 0.0
        sigma = np.full(3, max(GAUGE * flying_m, 1.0))
        photographs = tuple(
            p if pose is None else replace(p, gnss_world_m=pose.position_world_m, gnss_sigma_m=sigma)
            for p, pose in zip(photographs, block.poses, strict=True)
        )
    return replace(block, control_points=points, photographs=photographs)


def intersected_marks(block: Block) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the ground points (G, 3) of an oriented block from the marks that agree, in the world, NaN with fewer than
    two, and which marks do."""
    points = block.control_points
    order = np.lexsort((points.mark_photograph, points.mark_point))
    oriented = np.array([pose is not None for pose in block.poses])
    order = order[oriented[points.mark_photograph[order]] & np.isfinite(points.mark_sigma_px[order])]
    photograph, pixel = points.mark_photograph[order], points.mark_pixel[order]
    camera_of = np.array([p.camera for p in block.photographs], dtype=np.int64)
    ideal = np.empty_like(pixel)
    for c, camera in enumerate(block.cameras):
        own = camera_of[photograph] == c
        ideal[own] = image_plane_or_nan(camera, pixel[own])
    nowhere = np.full((3, 3), np.nan)
    position, agreed = consensus_intersections(
        np.searchsorted(points.mark_point[order], np.arange(len(points) + 1)).astype(np.int64),
        photograph, camera_of, pixel, ideal, AGREE_PX + _LIMIT * points.mark_sigma_px[order], models_of(block.cameras),
        np.array([c.parameters for c in block.cameras]),
        np.array([nowhere if p is None else p.rotation_world_from_camera for p in block.poses]),
        np.array([nowhere[0] if p is None else p.position_world_m for p in block.poses]),
    )  # fmt: skip
    inlier = np.zeros(len(points.mark_point), dtype=bool)
    inlier[order] = agreed
    return position, inlier


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


def gross_blunders(block: Block, adjust: Adjuster) -> list[Accusation]:
    """Return the control points and marks that are grossly off, none where too few agree to say so."""
    result = adjust(_held_in_place(block))
    points, names = block.control_points, [p.name for p in block.photographs]
    position, agreed = intersected_marks(result.block)
    control = np.asarray(points.controlled.any(axis=1))
    enough = np.asarray(np.isfinite(position).all(axis=1))
    off = np.flatnonzero(~agreed & enough[points.mark_point] & control[points.mark_point])
    accused = [
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
            return accused + [unmeasured("control point", points.name[g]) for g in whole[~agree].tolist()]
    return accused
