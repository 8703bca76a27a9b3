"""Starting poses of all photographs, in the world: from control points, from measured poses, or from tie points alone.

Where every photograph shows four control points it is resected from them. Else the block is started from measured
positions and attitudes, if its tie points confirm them; else it is grown from its tie points. Either is then brought
into the world by a robust similarity to control points or GNSS positions.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera, Pose, Similarity
from photogram.constraints.between_points import gives_scale
from photogram.errors import OrientationError, PhotogramError
from photogram.measures.collinearity import collinear
from photogram.measures.vertical import VERTICAL_SIGMA_RAD, Vertical, structure_up, turn_sigmas_rad
from photogram.projection import PARAMETER_NAMES
from photogram.sfm.direct import direct_structure, measured
from photogram.sfm.incremental import extend, grow
from photogram.sfm.known_poses import KnownPoses, known_structure
from photogram.sfm.local_frame import local_similarity, structure_scale
from photogram.sfm.mark_scale import other_size, picture_factor
from photogram.sfm.reconstruction import Structure, StructureSettings
from photogram.sfm.resection import Resection, resect
from photogram.sfm.similarity import (
    common_rotation,
    open_turn_rad,
    robust_similarity,
    similarity_from_attitudes,
    upright_similarity,
)
from photogram.survey import Block, ControlPoints, Photograph, TiePoints
from photogram.triangulation import consensus_intersections, ideal_observations
from photogram.wording import Progress, silent

Method = Literal["control", "attitude", "growth", "start"]
_LOG = logging.getLogger(__name__)

ATTITUDE_LIMIT = 4.0  # sigmas, that a measured attitude may be off
ATTITUDES_AGREEING = 0.8  # of a flight, from which its headings are accepted
SHAPE_TOLERANCE = 0.005  # of the block's extent, by which a free block may be bent
SCATTER = 0.03  # of the control points' extent, that they may scatter by and place a block all the same
FEWEST_SCATTERING, SCATTERING_SHARE = 5, 0.75  # control points, and of all, that must agree to that
OPEN_TURN_RAD = 0.05  # that positions leave about the line they lie along, from which attitudes are asked
LOOSE = 3.0  # thresholds, that image points may disagree by with photographs resected from few marks
CONFIRMED_SHARE = 0.5  # of the image points of such a photograph, that agree
DISTORTION_PX, DISTORTION_SHARE = 10.0, 2e-3
"""That distortion may be wrong by in the corners for control points to be resected with it, px and share of the longer
side of the picture, the larger of the two."""


@dataclass(frozen=True)
class OrientationSettings(StructureSettings):
    """How starting poses are determined."""

    method: Annotated[
        Literal["auto", "control", "attitude", "growth"],
        "How starting poses are determined; `auto`: the first of the three methods that can be had and holds.",
    ] = "auto"
    vertical: Annotated[Vertical, "How the photographs of a block without georeference look."] = "auto"


@dataclass(frozen=True, eq=False)
class Orientation:
    """Initial poses in the world (m), and how they were determined."""

    poses: tuple[Pose | None, ...]
    """Pose of each photograph, None if not registered."""
    resections: tuple[Resection | None, ...]
    """Resections of photographs with enough control points."""
    component: IntArray
    """0 for the block that is adjusted, 1 and more for others without common tie points, −1 for none (N,)."""
    method: Method
    """Method used."""
    reason: tuple[str, ...]
    """Why a photograph is not registered, empty if it is."""
    parameters: tuple[FloatArray, ...] = field(default=())
    """Interior orientation (12,) of each camera from the orientation; () if unchanged."""

    def __repr__(self) -> str:
        return f"<Orientation by {self.method}: {int(self.registered.sum())} of {len(self.poses)} photographs>"

    @property
    def registered(self) -> BoolArray:
        """Return which photographs (N,) have a pose."""
        return np.array([pose is not None for pose in self.poses], dtype=bool)

    @property
    def rests_on_control(self) -> bool:
        """Return whether a pose is a resection from control points; else all come from tie points, and control points
        have placed the whole in the world, if anything."""
        pairs = zip(self.poses, self.resections, strict=True)
        return any(resection is not None and pose is resection.refined for pose, resection in pairs)

    def calibrated(self, cameras: Sequence[Camera]) -> tuple[Camera, ...]:
        """Return the cameras as they came out of the orientation."""
        if not self.parameters:
            return tuple(cameras)
        return tuple(c.with_parameters(q) for c, q in zip(cameras, self.parameters, strict=True))


def _distortion_sigma_px(camera: Camera) -> float:
    """Return how far, by the stated sigmas of its distortion, an image point in the corner of a picture may be off.

    Focal length and principal point do not count: a pose takes up what is wrong with them.
    """
    f, r = camera.focal_px, 0.5 * float(np.hypot(camera.width_px, camera.height_px)) / camera.focal_px
    radial = {"k1": r**3, "k2": r**5, "k3": r**7, "k4": r**9}
    moved = {**radial, "p1": 3.0 * r**2, "p2": 3.0 * r**2, "b1": r / f, "b2": r / f}
    sigmas = np.array([camera.sigmas[PARAMETER_NAMES.index(name)] for name in moved])
    return float(np.linalg.norm(f * np.array(list(moved.values())) * np.where(np.isfinite(sigmas), sigmas, 0.0)))


def resections_of(block: Block, *, any_camera: bool = False) -> tuple[tuple[Resection | None, ...], tuple[str, ...]]:
    """Resect every photograph that shows four control points, or three and has a GNSS position, not in one line.

    Returns the resections, and one line for each photograph whose control points contradict each other. A camera that
    is hardly known bends the rays more than control points could contradict each other: its photographs are left out,
    unless ``any_camera`` is wanted.
    """
    points = block.control_points.fully_controlled()
    bent = [max(DISTORTION_PX, DISTORTION_SHARE * max(c.width_px, c.height_px)) for c in block.cameras]
    known = [any_camera or _distortion_sigma_px(c) < most for c, most in zip(block.cameras, bent, strict=True)]
    resections: list[Resection | None] = []
    errors: list[str] = []
    for index, photograph in enumerate(block.photographs):
        marks = np.flatnonzero(points.mark_photograph == index)
        position = points.position_world_m[points.mark_point[marks]]
        gnss = photograph.gnss_world_m
        resection = None
        enough = len(marks) >= 4 or (len(marks) == 3 and gnss is not None)
        if enough and known[photograph.camera] and not collinear(position):
            pixel, sigma = points.mark_pixel[marks], points.mark_sigma_px[marks]
            try:
                camera = block.cameras[photograph.camera]
                sigma_m = points.sigma_m[points.mark_point[marks]]
                resection = resect(camera, position, pixel, sigma, sigma_m=sigma_m, expected_world_m=gnss)
            except PhotogramError as error:
                errors.append(f"photograph {photograph.name}: {error}")
        resections.append(resection)
    return tuple(resections), tuple(errors)


def _confirmed(
    block: Block, resections: tuple[Resection | None, ...], settings: StructureSettings
) -> tuple[Resection | None, ...]:
    """Return the resections without those that the tie points contradict: P3P of three or four points may pick a pose
    far away, and its control points alone do not show it."""
    loose = replace(settings, threshold_px=LOOSE * settings.threshold_px)
    poses = [None if resection is None else resection.refined for resection in resections]
    structure = Structure.oriented(block.tie_points, block.cameras, block.camera_of, loose, poses)
    seen = block.tie_points.photograph[structure.intersectable]
    visible = np.bincount(seen, minlength=len(resections))
    holds = (visible < settings.minimum_points) | (structure.agreeing >= CONFIRMED_SHARE * visible)
    return tuple(r if h else None for r, h in zip(resections, holds, strict=True))


def confirmed_resections(block: Block, settings: StructureSettings) -> tuple[Resection | None, ...]:
    """Return the resections of a block's photographs from its control points that its tie points do not contradict."""
    return _confirmed(block, resections_of(block)[0], settings)


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


def _components(
    block: Block, settings: OrientationSettings, progress: Progress, known: KnownPoses | None
) -> tuple[list[Structure], Method]:

    def grown(cameras: Sequence[Camera], candidates: BoolArray) -> list[Structure]:
        return grow(block.tie_points, cameras, block.camera_of, settings, progress, candidates=candidates)

    if known is not None:
        started = known_structure(block, settings, known)
        return [started, *grown(known.cameras, ~started.registered)], "start"
    everything = np.ones(len(block.photographs), dtype=bool)
    if settings.method != "growth" and measured(block).sum() >= 3:
        progress(0, len(everything), "from measured poses")
        structure = direct_structure(block, settings)
        if structure is not None:
            extend(structure, everything, progress)
            return [structure, *grown(block.cameras, ~structure.registered)], "attitude"
        if settings.method == "attitude":
            raise OrientationError(
                "the tie points do not confirm the measured positions and attitudes: "
                "set orientation: {method: growth}, or remove the setting"
            )
    if settings.method == "attitude":
        raise OrientationError("orientation by attitude needs three photographs with GNSS position and attitude")
    return grown(block.cameras, everything), "growth"


def _reasons(block: Block, component: IntArray, settings: OrientationSettings) -> tuple[str, ...]:
    rays = np.bincount(block.tie_points.photograph, minlength=len(block.photographs))
    reasons = []
    for i, number in enumerate(component.tolist()):
        if number == 0:
            reasons.append("")
        elif number > 0:
            size = int(np.count_nonzero(component == number))
            reasons.append(f"shares no tie points with the block: part of a separate component of {size} photographs")
        elif rays[i] < settings.minimum_points:
            reasons.append(f"{rays[i]} tie points with other photographs, {settings.minimum_points} are needed")
        else:
            reasons.append(f"its {rays[i]} tie points do not agree with the block")
    return tuple(reasons)


def orient(
    block: Block,
    settings: OrientationSettings,
    progress: Progress = silent,
    known: KnownPoses | None = None,
) -> Orientation:
    """Find a starting pose for every photograph that can be joined to the block; from poses that are ``known``, where
    they are given.

    Control points that contradict each other in every photograph are passed over where tie points orient the block: the
    adjustment names the wrong ones. Raises OrientationError when they do and nothing else orients it, when nothing can
    be oriented, or when nothing places the block in the world.
    """
    count = len(block.photographs)
    resections, errors = resections_of(block, any_camera=settings.method == "control")
    contradicted = bool(errors) and len(errors) + sum(r is not None for r in resections) == count
    if contradicted and settings.method == "control":
        raise OrientationError("\n".join(errors))
    if settings.method != "control":
        resections = _confirmed(block, resections, settings)
    if known is None and settings.method in ("auto", "control") and all(r is not None for r in resections):
        poses = tuple(r.refined for r in resections if r is not None)
        return Orientation(poses, resections, np.zeros(count, dtype=np.int64), "control", ("",) * count)
    if known is None and settings.method == "control":
        lacking = [p.name for p, r in zip(block.photographs, resections, strict=True) if r is None]
        raise OrientationError(
            f"orientation by control needs 4 marked control points in every photograph; {len(lacking)} have fewer, "
            f"the first {lacking[0]}: mark them, or remove orientation.method"
        )
    components, method = _components(block, settings, progress, known)
    if not components:
        if contradicted and settings.method == "auto":
            raise OrientationError("\n".join(errors))
        raise OrientationError(
            f"no two of the {count} photographs form a valid relative orientation: they need "
            f"{settings.minimum_points} tie "
            "points in common, and views from different places: give photographs that overlap by 60 % or more"
        )
    structure = components[0]
    _LOG.debug("oriented by %s: components of %s photographs", method, [int(c.registered.sum()) for c in components])
    try:
        fit = georeference(structure, block, settings.vertical)
    except OrientationError as error:
        raise OrientationError("\n".join([str(error), *errors])) from error
    _LOG.debug("placed in the world at scale %.6g", fit.scale)
    component = np.full(count, -1, dtype=np.int64)
    for number, other in enumerate(components):
        component[other.registered] = number
    poses_world = [None if pose is None else fit.pose(pose) for pose in structure.poses()]
    for i, resection in enumerate(resections):
        if poses_world[i] is None and resection is not None:
            poses_world[i], component[i] = resection.refined, 0
    return Orientation(
        tuple(poses_world), resections, component, method, _reasons(block, component, settings),
        tuple(structure.parameters),
    )  # fmt: skip


def georeferenced_again(block: Block, orientation: Orientation, settings: OrientationSettings) -> Block:
    """Return a block with poses and tie points as ``orientation`` has them, brought to the control points as they are
    now: those that placed the orientation were others.

    ``block`` has the tie points. Raises OrientationError where nothing places the block in the world.
    """
    cameras = orientation.calibrated(block.cameras)
    structure = Structure.oriented(block.tie_points, cameras, block.camera_of, settings, orientation.poses)
    fit = georeference(structure, block, settings.vertical)
    points = fit.points(block.tie_points.position_world_m)
    return replace(
        block,
        poses=tuple(None if pose is None else fit.pose(pose) for pose in orientation.poses),
        tie_points=replace(block.tie_points, position_world_m=points),
    )


def _turn_about_vertical(rotation: FloatArray) -> FloatArray:
    """Return the turn about the vertical (3, 3) nearest to a rotation (3, 3) of the world."""
    angle = np.arctan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1])
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _angle_rad(a: FloatArray, b: FloatArray) -> float:
    return float(np.arccos(np.clip((np.trace(a.T @ b) - 1.0) / 2.0, -1.0, 1.0)))


def accepted_attitudes(block: Block, poses: Sequence[Pose | None]) -> tuple[Photograph, ...]:
    """Return the photographs with the measured attitudes that may take part in the adjustment.

    An attitude is accepted that agrees with the pose in the world within ATTITUDE_LIMIT sigmas, after a turn common to
    all. A compass that is wrong is wrong for whole strips, so where one attitude in five of a flight does not agree,
    none of its headings is accepted: what remains is the tilt, which the vertical gives, turned to the heading of the
    pose. A tilt that does not agree is left out.
    """
    given, turned = [], []
    for i, (photograph, pose) in enumerate(zip(block.photographs, poses, strict=True)):
        if pose is not None and photograph.attitude_world_from_camera is not None:
            given.append(i)
            turned.append(pose.rotation_world_from_camera @ photograph.attitude_world_from_camera.T)
    if not given:
        return block.photographs
    turns = np.array(turned)
    common = common_rotation(turns)  # positions that are metres off turn a block as a whole
    agrees = {
        i: _angle_rad(common, turn) < _limit_rad(block.photographs[i]) for i, turn in zip(given, turns, strict=True)
    }
    for flight in {block.photographs[i].flight for i in given}:
        members = [i for i in given if block.photographs[i].flight == flight]
        if np.mean([agrees[i] for i in members]) <= ATTITUDES_AGREEING:
            agrees.update(dict.fromkeys(members, False))
    return tuple(
        photograph if agrees.get(i, True) else _with_tilt_alone(photograph, turns[given.index(i)], common)
        for i, photograph in enumerate(block.photographs)
    )


def _limit_rad(photograph: Photograph) -> float:
    return ATTITUDE_LIMIT * (photograph.attitude_sigma_rad or 0.0)


def _with_tilt_alone(photograph: Photograph, turn: FloatArray, common: FloatArray) -> Photograph:
    """Return a photograph whose pose is ``turn`` (3, 3) away from its attitude with the tilt of the attitude alone."""
    attitude = photograph.attitude_world_from_camera
    if attitude is None:
        return photograph
    tilted = _turn_about_vertical(turn) @ attitude
    # a common turn about level axes is the block's, by its positions, and no error of this tilt
    level = common @ _turn_about_vertical(common).T
    pose = turn @ attitude
    if min(_angle_rad(tilted, pose), _angle_rad(level @ tilted, pose)) < _limit_rad(photograph):
        return replace(photograph, attitude_world_from_camera=tilted, heading_known=False)
    return replace(photograph, attitude_world_from_camera=None, attitude_sigma_rad=None)
