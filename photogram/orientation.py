"""Starting poses of all photographs, in the world: from control points, from measured poses, or from tie points alone.

Where every photograph shows four control points it is resected from them. Else the block is started from measured
positions and attitudes, if its tie points confirm them; else it is grown from its tie points. Either is then brought
into the world by a robust similarity to control points or GNSS positions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from photogram.camera import Pose
from photogram.direct_orientation import direct_structure, measured
from photogram.errors import OrientationError, PhotogramError
from photogram.growth import extend, grow, settle
from photogram.resection import Resection, collinear, resect
from photogram.similarity import Similarity, robust_similarity, similarity_from_attitudes, straight
from photogram.structure import BoolArray, Structure, StructureSettings
from photogram.survey import Block, ControlPoints, FloatArray, IntArray, TiePoints
from photogram.triangulation import consensus_intersections, ideal_observations

Method = Literal["control", "attitude", "growth"]
Progress = Callable[[int, int, str], None]

SHAPE_TOLERANCE = 0.005  # of the block's extent, by which a free block may be bent


@dataclass(frozen=True)
class OrientationSettings(StructureSettings):
    """How starting poses are found; ``auto`` takes the first method of the three that can be had and holds."""

    method: Literal["auto", "control", "attitude", "growth"] = "auto"


@dataclass(frozen=True, eq=False)
class Orientation:
    """Starting poses in the world, and how they were found.

    ``poses[i]`` is None for a photograph that is not registered; ``reason[i]`` then says why. ``resections`` are those
    of photographs with enough control points. ``component`` (N,): 0 for the block that is adjusted, 1 and more for
    others that share no tie points with it, −1 for photographs in none. ``parameters``: the interior orientation
    (8,) of each camera that came out of it, none where it was not touched.
    """

    poses: tuple[Pose | None, ...]
    resections: tuple[Resection | None, ...]
    component: IntArray
    method: Method
    reason: tuple[str, ...]
    parameters: tuple[FloatArray, ...] = field(default=())

    @property
    def registered(self) -> BoolArray:
        """Return which photographs (N,) have a pose."""
        return np.array([pose is not None for pose in self.poses], dtype=bool)


def resections_of(block: Block) -> tuple[Resection | None, ...]:
    """Resect every photograph that shows four control points, or three and has a GNSS position, not in one line.

    Raises OrientationError with one line per photograph whose control points contradict each other.
    """
    points = block.control_points.with_role("control")
    found: list[Resection | None] = []
    faults: list[str] = []
    for index, photograph in enumerate(block.photographs):
        marks = np.flatnonzero(points.mark_photograph == index)
        position = points.position_world_m[points.mark_point[marks]]
        gnss = photograph.gnss_world_m
        resection = None
        if (len(marks) >= 4 or (len(marks) == 3 and gnss is not None)) and not collinear(position):
            pixel, sigma = points.mark_pixel[marks], points.mark_sigma_px[marks]
            try:
                camera = block.cameras[photograph.camera]
                resection = resect(camera, position, pixel, sigma, expected_world_m=gnss)
            except PhotogramError as fault:
                faults.append(f"photograph {photograph.name}: {fault}")
        found.append(resection)
    if faults:
        raise OrientationError("\n".join(faults))
    return tuple(found)


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
        marks.first_observation, photograph, structure.camera_of, marks.pixel,
        ideal_observations(structure.calibrated(), structure.camera_of, marks), limit,
        structure.parameters, structure.rotation, structure.position,
    )[0]  # fmt: skip
    return position


def georeference(structure: Structure, block: Block) -> Similarity:
    """Return the similarity that brings a structure into the world: by control points where three are intersected, not
    in one line, else by GNSS positions, with attitudes where the positions alone leave a turn open.

    Raises OrientationError when neither is enough.
    """
    points = block.control_points.with_role("control")
    source = intersected_control(structure, points)
    known = np.isfinite(source).all(axis=1)
    if not straight(points.position_world_m[known]):
        target = points.position_world_m[known]
        extent = float(np.linalg.norm(np.ptp(target, axis=0)))
        sigma = np.linalg.norm(points.sigma_m[known], axis=1) + SHAPE_TOLERANCE * extent
        try:
            return robust_similarity(source[known], target, sigma)[0]
        except OrientationError as fault:
            if sum(p.gnss_world_m is not None for p in block.photographs) < 2:
                raise OrientationError(f"the control points do not fit the block: {fault}") from fault
    index = [i for i in np.flatnonzero(structure.registered) if block.photographs[i].gnss_world_m is not None]
    target = np.array([block.photographs[i].gnss_world_m for i in index]).reshape(-1, 3)
    sigma = np.linalg.norm(np.array([block.photographs[i].gnss_sigma_m for i in index]).reshape(-1, 3), axis=1)
    sigma = sigma + SHAPE_TOLERANCE * float(np.linalg.norm(np.ptp(target, axis=0))) if len(index) else sigma
    if not straight(target):
        return robust_similarity(structure.position[index], target, sigma)[0]
    with_attitude = [i for i in index if block.photographs[i].attitude_world_from_camera is not None]
    if len(with_attitude) >= 2:
        return similarity_from_attitudes(
            structure.position[with_attitude],
            structure.rotation[with_attitude],
            np.array([block.photographs[i].gnss_world_m for i in with_attitude]),
            np.array([block.photographs[i].attitude_world_from_camera for i in with_attitude]),
        )
    raise OrientationError(
        f"the block of {int(structure.registered.sum())} photographs cannot be placed in {block.frame.crs}: "
        f"{int(known.sum())} control points are marked in two of them, {len(index)} have a GNSS position; "
        "give three of either, not in one line"
    )


def _components(block: Block, settings: OrientationSettings, progress: Progress) -> tuple[list[Structure], Method]:
    camera_of = np.array([p.camera for p in block.photographs], dtype=np.int64)
    everything = np.ones(len(camera_of), dtype=bool)
    if settings.method != "growth" and measured(block).sum() >= 3:
        progress(0, len(camera_of), "from measured poses")
        structure = direct_structure(block, settings)
        if structure is not None:
            extend(structure, everything, progress)
            settle(structure)
            rest = ~structure.registered
            others = grow(block.tie_points, block.cameras, camera_of, settings, progress, candidates=rest)
            return [structure, *others], "attitude"
        if settings.method == "attitude":
            raise OrientationError(
                "the tie points do not confirm the measured positions and attitudes: "
                "set orientation: {method: growth}, or leave the choice out"
            )
    if settings.method == "attitude":
        raise OrientationError("orientation by attitude needs three photographs with GNSS position and attitude")
    return grow(block.tie_points, block.cameras, camera_of, settings, progress), "growth"


def _reasons(block: Block, component: IntArray, settings: OrientationSettings) -> tuple[str, ...]:
    rays = np.bincount(block.tie_points.photograph, minlength=len(block.photographs))
    reasons = []
    for i, number in enumerate(component.tolist()):
        if number == 0:
            reasons.append("")
        elif number > 0:
            size = int(np.count_nonzero(component == number))
            reasons.append(f"shares no tie points with the block: one of {size} photographs by themselves")
        elif rays[i] < settings.minimum_points:
            reasons.append(f"{rays[i]} tie points with other photographs, {settings.minimum_points} are needed")
        else:
            reasons.append(f"its {rays[i]} tie points do not agree with the block")
    return tuple(reasons)


def orient(block: Block, settings: OrientationSettings, progress: Progress = lambda *_: None) -> Orientation:
    """Find a starting pose for every photograph that can be joined to the block.

    Raises OrientationError when control points contradict each other, when nothing can be oriented, or when nothing
    places the block in the world.
    """
    count = len(block.photographs)
    resections = resections_of(block)
    if settings.method in ("auto", "control") and all(r is not None for r in resections):
        poses = tuple(r.refined for r in resections if r is not None)
        return Orientation(poses, resections, np.zeros(count, dtype=np.int64), "control", ("",) * count)
    if settings.method == "control":
        lacking = [p.name for p, r in zip(block.photographs, resections, strict=True) if r is None]
        raise OrientationError(
            f"orientation by control needs 4 marked control points in every photograph; {len(lacking)} have fewer, "
            f"the first {lacking[0]}: mark them, or leave orientation.method out"
        )
    components, method = _components(block, settings, progress)
    if not components:
        raise OrientationError(
            f"no two of the {count} photographs can be oriented to each other: they need {settings.minimum_points} tie "
            "points in common, and views from different places: give photographs that overlap by 60 % or more"
        )
    structure = components[0]
    fit = georeference(structure, block)
    component = np.full(count, -1, dtype=np.int64)
    for number, other in enumerate(components):
        component[other.registered] = number
    poses_found = [None if pose is None else fit.pose(pose) for pose in structure.poses()]
    for i, resection in enumerate(resections):
        if poses_found[i] is None and resection is not None:
            poses_found[i], component[i] = resection.refined, 0
    return Orientation(
        tuple(poses_found), resections, component, method, _reasons(block, component, settings),
        tuple(structure.parameters),
    )  # fmt: skip
