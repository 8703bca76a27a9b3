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
from photogram.camera import Camera, Pose
from photogram.errors import OrientationError, PhotogramError
from photogram.measures.collinearity import collinear
from photogram.measures.vertical import Vertical
from photogram.projection import PARAMETER_NAMES
from photogram.sfm.components import Placed, join_confirmed, place, share_calibration, world_poses
from photogram.sfm.direct import direct_structures, measured
from photogram.sfm.incremental import extend, grow
from photogram.sfm.known_poses import KnownPoses, known_structure
from photogram.sfm.reconstruction import Structure, StructureSettings
from photogram.sfm.resection import Resection, resect
from photogram.sfm.similarity import common_rotation
from photogram.survey import Block, Photograph
from photogram.wording import Progress, silent

Method = Literal["control", "attitude", "growth", "start"]
_LOG = logging.getLogger(__name__)

ATTITUDE_LIMIT = 4.0  # sigmas, that a measured attitude may be off
ATTITUDES_AGREEING = 0.8  # of a flight, from which its headings are accepted
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
    """Component of each photograph, the largest first: those that hang together by tie points; −1 for none (N,). All
    with poses are adjusted together."""
    method: Method
    """Method used."""
    reason: tuple[str, ...]
    """Why a photograph is not registered, empty if it is."""
    parameters: tuple[FloatArray, ...] = field(default=())
    """Interior orientation (12,) of each camera from the orientation; () if unchanged."""
    ties: tuple[str, ...] = field(default=("",))
    """What places each component in the world: control points, GNSS positions, or marked points that other components
    show too; empty for what is not adjusted, and where photographs were resected one by one."""

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
        structures = direct_structures(block, settings)
        left = everything.copy()
        for structure in structures:
            extend(structure, left, progress)
            left &= ~structure.registered
        if structures:
            return [*structures, *grown(block.cameras, left)], "attitude"
        if settings.method == "attitude":
            raise OrientationError(
                "the tie points do not confirm the measured positions and attitudes: "
                "set orientation: {method: growth}, or remove the setting"
            )
    if settings.method == "attitude":
        raise OrientationError("orientation by attitude needs three photographs with GNSS position and attitude")
    return grown(block.cameras, everything), "growth"


def _reasons(
    block: Block, poses: Sequence[Pose | None], component: IntArray, placed: Placed, settings: OrientationSettings
) -> tuple[str, ...]:
    rays = np.bincount(block.tie_points.photograph, minlength=len(block.photographs))
    reasons = []
    for i, number in enumerate(component.tolist()):
        if poses[i] is not None:
            reasons.append("")
        elif number >= 0:
            size = int(np.count_nonzero(component == number))
            why = placed.reasons[number] or "it shows no three marked points that the block shows too"
            reasons.append(
                f"part of a component of {size} photographs that shares no tie points with the block, and that nothing "
                f"else ties to it: {why}"
            )
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
    _LOG.debug("oriented by %s: components of %s photographs", method, [int(c.registered.sum()) for c in components])
    try:
        parameters, placed = _placed(components, block, settings)
    except OrientationError as error:
        raise OrientationError("\n".join([str(error), *errors])) from error
    placed_poses, numbers = world_poses(components, placed)
    component, ties = np.array(numbers), placed.ties
    for i, resection in enumerate(resections):
        if placed_poses[i] is None and resection is not None:
            placed_poses[i] = resection.refined
            if component[i] < 0:
                component[i] = placed.first
    return Orientation(
        tuple(placed_poses), resections, component, method, _reasons(block, placed_poses, component, placed, settings),
        parameters, ties,
    )  # fmt: skip


def _placed(
    components: list[Structure], block: Block, settings: OrientationSettings
) -> tuple[tuple[FloatArray, ...], Placed]:
    """Return the calibrations of the cameras, and the components placed in the world with them, joined by photographs
    that only their measured positions confirm."""
    parameters = share_calibration(components)
    placed = place(components, block, settings.vertical)
    alone = ~np.any([c.registered for c in components], axis=0)
    for structure, fit in zip(components, placed.fits, strict=True):
        if fit is not None and not block.is_free:
            join_confirmed(structure, fit, block, alone)
            alone &= ~structure.registered
            _LOG.debug("placed in the world at scale %.6g", fit.scale)
    return parameters, placed


def georeferenced_again(block: Block, orientation: Orientation, settings: OrientationSettings) -> Block:
    """Return a block with poses and tie points as ``orientation`` has them, brought to the control points as they are
    now: those that placed the orientation were others.

    ``block`` has the tie points. Raises OrientationError where nothing places the block in the world.
    """
    cameras = orientation.calibrated(block.cameras)
    numbers = np.unique(orientation.component[orientation.registered]).tolist()
    structures = [
        Structure.oriented(
            block.tie_points, cameras, block.camera_of, settings,
            [p if c == n else None for p, c in zip(orientation.poses, orientation.component, strict=True)],
        )
        for n in numbers
    ]  # fmt: skip
    placed = place(structures, block, settings.vertical)
    points = block.tie_points.position_world_m.copy()
    first = np.full(len(points), -1)
    first[block.tie_points.point] = orientation.component[block.tie_points.photograph]
    for number, fit in zip(numbers, placed.fits, strict=True):
        own = first == number
        points[own] = np.nan if fit is None else fit.points(points[own])
    return replace(
        block,
        poses=tuple(world_poses(structures, placed)[0]),
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
