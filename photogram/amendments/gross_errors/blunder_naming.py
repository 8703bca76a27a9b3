"""Causes of rejected measurements, derived from their prediction by all other observations.

Two points exchanged, marks set on another point's target, easting and northing exchanged, one digit mistyped: each is
named only where the prediction is precise enough to exclude chance.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.amendments.gross_errors.data_snooping import Search
from photogram.amendments.gross_errors.hypothesis import Hypothesis, unmeasured
from photogram.arrays import FloatArray
from photogram.camera import project_points
from photogram.constraints.between_points import CONSTRAINT_KINDS, CommonSurface, Distance, observations
from photogram.constraints.rigs import relative_poses
from photogram.factors.common_errors import common_shifts
from photogram.quality.asprs import AXES
from photogram.results import Adjustment
from photogram.survey import Block, ControlPoints
from photogram.wording import some, things

SURE = 4.0  # sigmas within which a prediction is said to be what was meant
CHANCE = 0.1  # probability by which some digit would explain a blunder that has nothing to do with it
ON_TARGET_PX = 2.0  # that a mark is off its own target beside its sigma: what a hand does at any resolution
_DECIMALS = 3  # of coordinates that people type
SINGLE = 0.2  # of the attitudes of a flight, up to which those that are wrong are blunders of single photographs


@dataclass(frozen=True)
class Blunder:
    """A blunder and its cause."""

    kind: str
    """Cause: wrong point, exchanged points, exchanged axes, mistyped, height, plan, position, mark, wrong target, …"""
    points: tuple[str, ...]
    """Names of the ground points concerned."""
    photograph: str | None
    """Name of the photograph of a mark, a GNSS position or an attitude."""
    sentence: str
    """The blunder in words."""
    camera: str | None = None
    """Name of the camera of a focal length."""


@dataclass(frozen=True, eq=False)
class _Ground:
    """Surveyed and predicted positions (G, 3) in the map, and the sigmas (G, 3) of their differences."""

    names: tuple[str, ...]
    surveyed_m: FloatArray
    predicted_m: FloatArray
    sigma_m: FloatArray

    def agree(self, predicted: int, surveyed: int) -> bool:
        """Return whether one point is predicted where another, or itself, was surveyed."""
        off = np.abs(self.predicted_m[predicted] - self.surveyed_m[surveyed])
        return bool(np.all(off <= SURE * self.sigma_m[predicted]))


def _ground(result: Adjustment, points: ControlPoints) -> _Ground:
    frame = result.block.frame
    axes = frame.rotation_world_from_map(np.zeros(3))
    variance = np.einsum("ji,gjk,ki->gi", axes, result.covariances.ground_m2, axes)
    return _Ground(
        points.name,
        frame.map_from_world(points.position_world_m),
        frame.map_from_world(result.estimates.ground_world_m),
        np.sqrt(variance + points.sigma_m**2),
    )


def _exchanged(ground: _Ground, suspected: Sequence[int]) -> Iterator[tuple[str, str]]:
    """Yield the names of pairs of suspected points that each lie where the other was surveyed."""
    for a, b in combinations(suspected, 2):
        if ground.agree(a, b) and ground.agree(b, a):
            yield ground.names[a], ground.names[b]


def exchanged_points(block: Block, explanation: Search) -> list[tuple[str, str]]:
    """Return the names of pairs of control points of ``block`` that are rejected and each lie where the other was
    surveyed."""
    ground = _ground(explanation.result, block.control_points)
    suspected = {ground.names.index(a.name): None for a in explanation.rejected if a.kind == "control point"}
    return list(_exchanged(ground, tuple(suspected)))


def _mistyped(surveyed: float, predicted: float, sigma: float) -> str | None:
    """Return the figure that was meant, if one wrong digit or two neighbouring ones exchanged explain a coordinate.

    None where the prediction is not sure enough: nearly every blunder is then near to some digit's.
    """
    off = abs(predicted - surveyed)
    step = 10.0 ** np.floor(np.log10(off))
    if 2.0 * SURE * sigma > CHANCE * step:
        return None
    text = f"{abs(surveyed):.{_DECIMALS}f}"
    places = [i for i, c in enumerate(text) if c.isdigit()]
    typed = {text[:i] + digit + text[i + 1 :] for i in places for digit in "0123456789"}
    for i, j in pairwise(places):
        other = list(text)
        other[i], other[j] = text[j], text[i]
        typed.add("".join(other))
    meant = {float(np.copysign(float(other), surveyed)): other for other in sorted(typed - {text})}
    best = min(meant, key=lambda value: abs(value - predicted))
    return f"{best:.{_DECIMALS}f}" if abs(best - predicted) <= SURE * sigma else None


def _of_ground(ground: _Ground, point: int, hypotheses: Sequence[Hypothesis]) -> Blunder:
    """Return what went wrong with the coordinates of one point, by what the rest predicts for it."""
    name = ground.names[point]
    surveyed = ground.surveyed_m[point]
    predicted = ground.predicted_m[point]
    sigma, off = ground.sigma_m[point].copy(), predicted - surveyed
    axes = sorted({axis for a in hypotheses for axis in a.axes})
    if not np.isfinite(predicted).all():
        for a in hypotheses:
            off[list(a.axes)], sigma[list(a.axes)] = a.off, a.sigma
        return _plain(name, axes, off, sigma)
    axes = [axis for axis in axes if abs(off[axis]) > SURE * sigma[axis]] or axes
    for other in range(len(ground.names)):
        if other != point and ground.agree(point, other):
            text = (
                f"control point {name} is marked at the position of {ground.names[other]}: wrong point, or wrong marks"
            )
            return Blunder("wrong point", (name, ground.names[other]), None, text)
    if np.all(np.abs(predicted[:2] - surveyed[1::-1]) <= SURE * sigma[:2]):
        return Blunder("exchanged axes", (name,), None, f"control point {name}: easting and northing are swapped")
    meant = {axis: _mistyped(surveyed[axis], predicted[axis], sigma[axis]) for axis in axes}
    if all(meant.values()):
        figures = " and ".join(
            f"{AXES[axis]} {surveyed[axis]:.{_DECIMALS}f} looks mistyped for {figure}" for axis, figure in meant.items()
        )
        text = f"control point {name}: {figures}: all other observations predict {_metres(off[axes])} m from it"
        return Blunder("mistyped", (name,), None, text)
    return _plain(name, axes, off, sigma)


def _metres(values: Sequence[float] | FloatArray) -> str:
    return ", ".join(f"{value:+.3f}" for value in values)


def _plain(name: str, axes: list[int], off: FloatArray, sigma: FloatArray) -> Blunder:
    parts = [f"{AXES[axis]} {off[axis]:+.3f} m, {abs(off[axis]) / sigma[axis]:.0f} sigma" for axis in axes]
    kind = "height" if axes == [2] else "position" if 2 in axes else "plan"
    what = parts[0].replace(" ", ", ", 1) if len(parts) == 1 else f"{kind} ({'; '.join(parts)})"
    return Blunder(kind, (name,), None, f"control point {name}: all other observations predict a different {what}")


def _of_mark(result: Adjustment, block: Block, hypothesis: Hypothesis) -> Blunder:
    """Return what went wrong with a mark: whose target it is on, if any, else how far it is off."""
    photographs = block.photograph_names
    points, i = block.control_points, photographs.index(str(hypothesis.photograph))
    g = points.name.index(hypothesis.name)
    m = np.flatnonzero((points.mark_photograph == i) & (points.mark_point == g))[0]
    pose, camera = result.block.poses[i], result.block.cameras[block.photographs[i].camera]
    u, v = hypothesis.off
    if pose is not None:
        place = np.where(
            np.isfinite(result.estimates.ground_world_m), result.estimates.ground_world_m, points.position_world_m
        )
        predicted = project_points(camera, pose, place) - points.mark_pixel[m]
        u, v = predicted[g].tolist()
        distance = np.where(np.isfinite(predicted).all(axis=1), np.linalg.norm(predicted, axis=1), np.inf)
        distance[g] = np.inf
        nearest = int(np.argmin(distance))
        if distance[nearest] <= ON_TARGET_PX + SURE * points.mark_sigma_px[m]:
            text = f"mark of {hypothesis.name} in {hypothesis.photograph} is on the target of {points.name[nearest]}"
            return Blunder("wrong target", (hypothesis.name, points.name[nearest]), hypothesis.photograph, text)
    if not np.isfinite([u, v]).all():
        text = (
            f"mark of {hypothesis.name} in {hypothesis.photograph} cannot be right: all other observations put the "
            "point behind the camera, or beyond the edge of its lens"
        )
        return Blunder("mark", (hypothesis.name,), hypothesis.photograph, text)
    text = (
        f"mark of {hypothesis.name} in {hypothesis.photograph} is {np.hypot(u, v):.1f} px off: all other observations "
        "predict it "
        f"{u:+.1f}, {v:+.1f} px from it"
    )
    return Blunder("mark", (hypothesis.name,), hypothesis.photograph, text)


def _of_position(result: Adjustment, block: Block, hypothesis: Hypothesis) -> Blunder:
    """Return the blunder of a GNSS position: its distance from the prediction by all other observations."""
    i = block.photograph_names.index(hypothesis.name)
    pose = result.block.poses[i]
    photograph = block.photographs[i]
    frame = block.frame
    off, where = hypothesis.off, ""
    if pose is not None and photograph.gnss_world_m is not None:
        measured = photograph.measured_centre_world_m(pose.rotation_world_from_camera)
        offset = np.zeros(3)
        if photograph.flight in result.estimates.flights:
            offset = result.estimates.offset_world_m[result.estimates.flights.index(photograph.flight)]
        offset = offset + common_shifts(result.block)[i]
        places = frame.map_from_world(np.array([pose.position_world_m - offset, measured]))
        off = tuple((places[0] - places[1]).tolist())
    if len(off) == 3 and np.isfinite(off).all():
        where = f" (easting, northing, height {_metres(off)} m)"
    distance = float(np.linalg.norm(off))
    text = f"GNSS position of {hypothesis.name}: all other observations predict it {distance:.2f} m from it{where}"
    return Blunder("GNSS position", (), hypothesis.name, text)


def _of_attitude(result: Adjustment, block: Block, hypothesis: Hypothesis) -> Blunder:
    """Return what is wrong with a measured attitude: by how much the camera was turned otherwise."""
    i = block.photograph_names.index(hypothesis.name)
    pose, measured = result.block.poses[i], block.photographs[i].attitude_world_from_camera
    turn = float(np.linalg.norm(hypothesis.off))  # where it is not known otherwise
    if pose is not None and measured is not None:
        turn = float(
            np.arccos(np.clip((np.trace(measured.T @ pose.rotation_world_from_camera) - 1.0) / 2.0, -1.0, 1.0))
        )
    text = f"attitude of {hypothesis.name}: all other observations rotate the camera by {np.rad2deg(turn):.1f}° from it"
    return Blunder("attitude", (), hypothesis.name, text)


def _of_focal_length(result: Adjustment, block: Block, hypothesis: Hypothesis) -> Blunder:
    """Return the blunder of a given focal length: its estimate from all other observations."""
    c = [camera.name for camera in block.cameras].index(hypothesis.name)
    given, adjusted = block.cameras[c], result.block.cameras[c].focal_px
    sigma = float(np.sqrt(result.covariances.calibration[c, 0, 0]))
    text = (
        f"focal length of camera {given.name}: all other observations give {adjusted:.1f} ± {sigma:.1f} px where "
        f"{given.focal_px:.1f} ± {given.sigmas[0]:.1f} px is given ({adjusted / given.focal_px - 1.0:+.1%}): a wrong "
        "tag, a zoom lens, or cropped or resized pictures"
    )
    return Blunder("focal length", (), None, text, given.name)


def _of_offset(result: Adjustment, hypothesis: Hypothesis) -> Blunder:
    """Return the offset of the GNSS positions of a flight that the control points show."""
    off, sigma = np.array(hypothesis.off), np.array(hypothesis.sigma)
    if hypothesis.name in result.estimates.flights:
        f = result.estimates.flights.index(hypothesis.name)
        off, sigma = result.estimates.offset_world_m[f], np.sqrt(np.diag(result.covariances.offset_m2[f]))
    text = (
        f"GNSS positions of flight {hypothesis.name}: they lie off the control points by a common offset "
        f"(easting, northing, height {_metres(-off)} m, each ± {_metres(sigma).replace('+', '')} m), which is "
        "now estimated"
    )
    return Blunder("GNSS offset", (), None, text)


def _of_constraint(result: Adjustment, block: Block, hypothesis: Hypothesis) -> Blunder:
    """Return what contradicts a constraint: by how much everything else gives another value."""
    every = list(observations(block.constraints))
    k = next(n for n, o in enumerate(every) if (o.kind, o.label) == (hypothesis.kind, hypothesis.name))
    off_m, sigma_m = result.tests.constraints.residual_m[k], result.tests.constraints.adjusted_sigma_m[k]
    constraint = block.constraints[every[k].constraint]
    sigmas = abs(off_m) / np.hypot(sigma_m, constraint.sigmas_m[every[k].row])
    if isinstance(constraint, CommonSurface):
        where = "above the others" if constraint.kind == "level surface" else "from the plane of the others"
        text = f"{hypothesis.words}: all other observations put it {off_m:+.4f} m {where}, {sigmas:.1f} sigma"
    else:
        measured_m = constraint.length_m if isinstance(constraint, Distance) else constraint.difference_m
        text = (
            f"{hypothesis.words}: all other observations give {measured_m + off_m:.4f} m where {measured_m:.4f} m was "
            f"measured, {sigmas:.1f} sigma"
        )
    photographs = constraint.of_photographs
    return Blunder(hypothesis.kind, () if photographs else every[k].points, None, text)


def _of_exposure(result: Adjustment, block: Block, hypothesis: Hypothesis) -> Blunder:
    """Return by how much the two photographs of an exposure are off the relative pose of their rig."""
    rig, master = next(
        (r, master) for r in result.block.rigs for name, master in r.exposures if name == hypothesis.name
    )
    numbers = {p.name: i for i, p in enumerate(block.photographs)}
    first, second = (result.block.poses[numbers[name]] for name in (master, hypothesis.name))
    off = np.zeros(6)
    off[list(hypothesis.axes)] = hypothesis.off  # where poses are not known
    if first is not None and second is not None and rig.pose is not None:
        both = [(p.rotation_world_from_camera[None], p.position_world_m[None]) for p in (first, second)]
        off = rig.pose.misfits(*relative_poses(*both))[0]
    turn = np.rad2deg(float(np.linalg.norm(off[:3])))
    text = (
        f"exposure {hypothesis.name}: all other observations put it {np.linalg.norm(off[3:]):.3f} m "
        f"(right, down, forward {_metres(off[3:])} m) and {turn:.2f}° from where its rig has it beside {master}: the "
        "two were not taken at the same moment"
    )
    return Blunder("exposure", (), hypothesis.name, text)


def _of_flight(result: Adjustment, block: Block, flight: str, members: Sequence[int]) -> Blunder:
    """Return what is wrong with the measured attitudes of most photographs of a flight: by which turn of the camera
    they are off in common, and by how much beside it."""
    poses = ((result.block.poses[i], block.photographs[i].attitude_world_from_camera) for i in members)
    turns = Rotation.from_matrix([m.T @ pose.rotation_world_from_camera for pose, m in poses if pose and m is not None])
    common = turns.mean()
    off, beside = np.rad2deg(-common.as_rotvec()), np.rad2deg(np.median((common.inv() * turns).magnitude()))
    names = some([block.photographs[i].name for i in members])
    text = (
        f"attitudes of {things(len(members), 'photograph')} of flight {flight} ({names}): all other observations "
        f"contradict them, by {np.linalg.norm(off):.1f}° in common (about the camera's axes right, down, forward "
        f"{', '.join(f'{angle:+.1f}' for angle in off)}°) and by {beside:.1f}° beside that; they are not used: check "
        "how the angles of the gimbal are counted, a pitch of -90° looking straight down"
    )
    return Blunder("attitude", (), None, text)


def withdrawn_attitudes(block: Block, believed: Block, result: Adjustment) -> list[Blunder]:
    """Return the measured attitudes of ``block`` that are lost in ``believed``, because its oriented photographs
    contradict them: those of single photographs one by one, those of more of a flight together. A compass that a whole
    flight contradicts is no blunder."""
    blunders, photographs = list[Blunder](), list(zip(block.photographs, believed.photographs, strict=True))
    for flight in sorted({p.flight for p in block.photographs if p.attitude_sigma_rad is not None}):
        own = [i for i, (p, _) in enumerate(photographs) if p.flight == flight and p.attitude_sigma_rad is not None]
        whole = [i for i in own if photographs[i][1].attitude_sigma_rad is None]
        lost = [i for i in own if i in whole or photographs[i][0].heading_known > photographs[i][1].heading_known]
        if len(lost) <= SINGLE * len(own):
            blunders += [_of_attitude(result, block, unmeasured("attitude", block.photographs[i].name)) for i in lost]
        elif len(whole) > SINGLE * len(own):
            blunders.append(_of_flight(result, block, flight, whole))
    return blunders


def _with_rivals(blunder: Blunder, rejected: Sequence[Hypothesis]) -> Blunder:
    rivals = tuple(dict.fromkeys(rival for a in rejected for rival in a.rivals))
    if not rivals:
        return blunder
    more = f" and {len(rivals) - 2} more" if len(rivals) > 2 else ""
    return replace(
        blunder,
        sentence=f"{blunder.sentence}; or it is {' or '.join(rivals[:2])}{more}, which explains the data as well",
    )


def name_blunders(block: Block, explanation: Search) -> list[Blunder]:
    """Return the blunders behind the rejected measurements: points, marks, positions, attitudes, the rest."""
    ground = _ground(explanation.result, block.control_points)
    of_points: dict[int, list[Hypothesis]] = {}
    for a in explanation.rejected:
        if a.kind == "control point":
            of_points.setdefault(ground.names.index(a.name), []).append(a)
    names: list[Blunder] = []
    for first, second in exchanged_points(block, explanation):
        text = f"control points {first} and {second} are swapped: each is marked at the position of the other"
        names.append(Blunder("exchanged points", (first, second), None, text))
    explained = {name for blunder in names for name in blunder.points}
    names += [
        _with_rivals(_of_ground(ground, g, own), own)
        for g, own in of_points.items()
        if ground.names[g] not in explained
    ]
    of_kind: dict[str, Callable[[Hypothesis], Blunder]] = {
        "mark": lambda a: _of_mark(explanation.result, block, a),
        "GNSS position": lambda a: _of_position(explanation.result, block, a),
        "attitude": lambda a: _of_attitude(explanation.result, block, a),
        "focal length": lambda a: _of_focal_length(explanation.result, block, a),
        "GNSS offset": lambda a: _of_offset(explanation.result, a),
        "exposure": lambda a: _of_exposure(explanation.result, block, a),
        **dict.fromkeys(CONSTRAINT_KINDS, lambda a: _of_constraint(explanation.result, block, a)),
    }
    for kind, named in of_kind.items():
        names += [_with_rivals(named(a), [a]) for a in explanation.rejected if a.kind == kind]
    return names
