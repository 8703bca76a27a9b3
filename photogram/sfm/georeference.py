"""Into the world: the similarity that brings a structure to control points, GNSS positions, attitudes or a vertical."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Similarity
from photogram.constraints.between_points import gives_scale
from photogram.errors import OrientationError
from photogram.measures.collinearity import collinear
from photogram.measures.vertical import VERTICAL_SIGMA_RAD, Vertical, structure_up, turn_sigmas_rad
from photogram.sfm.local_frame import local_similarity, structure_scale
from photogram.sfm.mark_scale import other_size, picture_factor
from photogram.sfm.reconstruction import Structure
from photogram.sfm.similarity import (
    open_turn_rad,
    robust_similarity,
    similarity_from_attitudes,
    upright_similarity,
)
from photogram.survey import Block, ControlPoints, TiePoints
from photogram.triangulation import consensus_intersections, ideal_observations

SHAPE_TOLERANCE = 0.005  # of the block's extent, by which a free block may be bent
SCATTER = 0.03  # of the control points' extent, that they may scatter by and place a block all the same
FEWEST_SCATTERING, SCATTERING_SHARE = 5, 0.75  # control points, and of all, that must agree to that
OPEN_TURN_RAD = 0.05  # that positions leave about the line they lie along, from which attitudes are asked


def intersected_control(structure: Structure, points: ControlPoints) -> FloatArray:
    """Return control points (G, 3) in the structure's frame from their marks, NaN with fewer than two that agree."""
    usable = np.flatnonzero(structure.registered[points.mark_photograph])
    order = usable[np.lexsort((points.mark_photograph[usable], points.mark_point[usable]))]
    photograph, point = points.mark_photograph[order], points.mark_point[order]
    marks = TiePoints(
        photograph, point, np.zeros_like(point), points.mark_pixel[order], points.mark_sigma_px[order],
        np.full((len(points), 3), np.nan), np.zeros((len(points), 3), dtype=np.uint8),
    )  # fmt: skip
    limit = np.maximum(3.0 * structure.settings.threshold_px, 5.0 * marks.sigma_px)
    position: FloatArray = consensus_intersections(
        marks.first_observation, photograph, marks.pixel,
        ideal_observations(structure.calibrated(), structure.camera_of, marks), limit, structure.as_oriented,
    )[0]  # fmt: skip
    return position


def _placed_by_control(source: FloatArray, points: ControlPoints, *, alone: bool) -> Similarity:
    """Return the similarity that most control points (G,) agree with where the structure has them, ``source`` (G, 3).

    Points may scatter more than is stated or assumed of them. Where they do not agree to that, and nothing else places
    the block, ``alone``, they may agree to SCATTER of their extent; the adjustment says by how much. Raises
    OrientationError where they do not.
    """
    target = points.position_world_m
    extent = float(np.linalg.norm(np.ptp(target, axis=0)))
    stated = np.linalg.norm(points.sigma_m, axis=1) + SHAPE_TOLERANCE * extent
    try:
        return robust_similarity(source, target, stated)[0]
    except OrientationError:
        if not alone:
            raise
        fit, agree = robust_similarity(source, target, np.maximum(stated, SCATTER * extent))
        if np.count_nonzero(agree) < max(FEWEST_SCATTERING, SCATTERING_SHARE * len(agree)):
            raise
        return fit


def _upright(structure: Structure, block: Block, index: IntArray, fit: Similarity, vertical: Vertical) -> Similarity:
    """Return the similarity ``fit`` to the positions of the photographs ``index`` (K,), or, where these tell the
    vertical worse than the way in which photographs are taken does, the upright one that fits them in plan."""
    source = structure.position[index]
    sigma_m = np.array([block.photographs[i].gnss_sigma_m for i in index])
    if turn_sigmas_rad(fit.points(source), sigma_m)[0] <= VERTICAL_SIGMA_RAD:
        return fit
    scale = None
    if gives_scale(block.constraints):
        marked = intersected_control(structure, block.control_points)
        scale = structure_scale(block, structure.position, structure.registered, marked)
    up = structure_up(structure.rotation[structure.registered], vertical, fit.rotation[2])
    target = np.array([block.photographs[i].gnss_world_m for i in index])
    return upright_similarity(source, up, target, sigma_m, scale)


def placed_by(structure: Structure, block: Block) -> Literal["control points", "GNSS positions"]:
    """Return what brings a structure into the world: control points, where three are intersected, not in one line."""
    points = block.control_points.fully_controlled()
    known = np.isfinite(intersected_control(structure, points)).all(axis=1)
    return "GNSS positions" if collinear(points.position_world_m[known]) else "control points"


def georeference(structure: Structure, block: Block, vertical: Vertical = "auto") -> Similarity:
    """Return the similarity that brings a structure into the world: by control points where three are intersected, not
    in one line, else by GNSS positions, with attitudes where the positions alone leave a turn open; into a local frame
    with a vertical as its photographs look, where the block is free.

    Raises OrientationError when neither is enough.
    """
    if block.is_free:
        return local_similarity(
            block, structure.rotation, structure.position, structure.registered, structure.point,
            intersected_control(structure, block.control_points), vertical,
        )  # fmt: skip
    points = block.control_points.fully_controlled()
    source = intersected_control(structure, points)
    known = np.asarray(np.isfinite(source).all(axis=1))
    if not collinear(points.position_world_m[known]):
        alone = sum(p.gnss_world_m is not None for p in block.photographs) < 2
        try:
            return _placed_by_control(source[known], points.select(known), alone=alone)
        except OrientationError as error:
            if alone:
                factor = picture_factor(replace(block, poses=structure.poses(), cameras=structure.calibrated()))
                why = str(error) if factor is None else other_size(factor)
                raise OrientationError(f"the control points do not fit the block: {why}") from error
    index = [i for i in np.flatnonzero(structure.registered) if block.photographs[i].gnss_world_m is not None]
    target = np.array([block.photographs[i].gnss_world_m for i in index]).reshape(-1, 3)
    sigma = np.linalg.norm(np.array([block.photographs[i].gnss_sigma_m for i in index]).reshape(-1, 3), axis=1)
    sigma = sigma + SHAPE_TOLERANCE * float(np.linalg.norm(np.ptp(target, axis=0))) if len(index) else sigma
    source = structure.position[index]
    with_attitude = [i for i in index if block.photographs[i].attitude_world_from_camera is not None]
    if len(with_attitude) >= 2 and open_turn_rad(source, target, sigma) > OPEN_TURN_RAD:
        return similarity_from_attitudes(
            structure.position[with_attitude],
            structure.rotation[with_attitude],
            np.array([block.photographs[i].gnss_world_m for i in with_attitude]),
            np.array([block.photographs[i].attitude_world_from_camera for i in with_attitude]),
        )
    if not (collinear(source) or collinear(target)):
        fit, agree = robust_similarity(source, target, sigma)
        return _upright(structure, block, np.array(index)[agree], fit, vertical)
    where = "its local system" if block.frame.is_local else block.frame.crs
    raise OrientationError(
        f"the block of {int(structure.registered.sum())} photographs cannot be georeferenced in {where}: "
        f"{int(known.sum())} control points are marked in two of them, {len(index)} have a GNSS position; "
        "give at least three of either, not collinear"
    )
