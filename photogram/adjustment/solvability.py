"""What the measurements of a block determine not at all, or badly, in a surveyor's words.

Not at all: the error names the variable, or the datum, and what it lacks; a single photograph or mark that keeps the
rest from a solution is left out. Badly: a sentence beside the result, of the block as a whole where its datum is weak,
of a photograph or a focal length where they alone are.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.errors import AdjustmentError
from photogram.factors.covariance import Covariances
from photogram.factors.datum import SCALE, SHIFT, TURN, datum_of, reach_m, weights_of
from photogram.factors.elimination.reprojection import residuals
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError, Problem
from photogram.factors.rigs.exposures import taking_part
from photogram.factors.variables import (
    CALIBRATION,
    COMMON_ERROR,
    CONTROL_POINT,
    DATUM,
    GNSS_OFFSET,
    POSE,
    RIG,
    TIE_POINT,
    WORDS,
)
from photogram.measures.rough_place import RoughPlace, rough_place
from photogram.survey import Block
from photogram.wording import percent

WEAK_RAD = 0.05  # an attitude, or the turn of a block, known no better than this is weak
WEAK_SHIFT = 0.1  # of the distance to the ground, the same of a position
WEAK_SCALE = 0.01
POSITION_WEAK = "The position of the block is known to"
ROUGHLY_PLACED = "The block is placed roughly, its GNSS positions being known to"
OPEN_SCALE = 0.5  # of the scale, from which it is not determined
ROTATION_WEAK = "The rotation of the block about"
WEAK_CAMERA = 0.05  # of the focal length, and of the picture the same of the principal point
MOST_NAMED = 5  # photographs, in sentences of their own
STEEP = 0.9  # upward part of an axis that is called vertical
FLAT = 0.3  # of one that is called level

_NONE: Mapping[int, str] = MappingProxyType({})


class UndeterminedPartError(AdjustmentError):
    """Single photographs or marks keep the rest of a block from a solution: why, by the index of the photograph and of
    the mark in the block."""

    def __init__(self, message: str, photographs: Mapping[int, str] = _NONE, marks: Mapping[int, str] = _NONE) -> None:
        super().__init__(message)
        self.photographs, self.marks = dict(photographs), dict(marks)


def check_determined(problem: Problem) -> None:
    """Raise AdjustmentError for what can be seen to be undetermined before anything is solved, UndeterminedPartError
    where it is single photographs."""
    block = problem.block
    seen = np.bincount(problem.tie.photograph, minlength=len(block.photographs))
    seen += np.bincount(problem.marks.photograph, minlength=len(block.photographs))
    placed = np.array(
        [p.gnss_world_m is not None and p.attitude_sigma_rad is not None for p in block.photographs], dtype=bool
    )
    own = seen >= 3
    pairs = taking_part(block).pairs
    for this, other in (pairs.T, pairs[:, ::-1].T):
        placed[this[own[other] | placed[other]]] = True  # its rig holds it
    few = {
        i: f"{rays} image points, at least 3 are needed: add overlap, mark control points in it, or remove it"
        for i, rays in enumerate(seen.tolist())
        if rays < 3 and not placed[i]
    }
    if few:
        named = "\n".join(f"photograph {block.photographs[i].name}: {why}" for i, why in few.items())
        raise UndeterminedPartError(named, photographs=few)
    positions = sum(p.gnss_world_m is not None for p in block.photographs)
    plan, height = np.isfinite(problem.control_sigma_m).sum(axis=0)[1:].tolist()
    open_parts = _open_parts(max(plan, positions), max(height, positions))
    if open_parts and not block.is_free:
        count = len(problem.control_world_m)
        part = "" if plan == height == count else f" ({plan} of them in plan, {height} in height)"
        raise AdjustmentError(
            f"the block has no datum in {_system(block)}: {count} control points{part} "
            f"and {positions} GNSS positions leave {open_parts} open; "
            "at least three of either, not collinear, are needed, or crs: none and neither for a free network"
        )
    with_rays = np.union1d(problem.tie.photograph, problem.marks.photograph)
    used = {block.photographs[i].camera for i in with_rays.tolist()}
    for c, camera in enumerate(block.cameras):
        if c not in used and np.any(np.isinf(camera.sigmas)):
            raise AdjustmentError(
                f"camera {camera.name}: none of its photographs is adjusted, so its free parameters cannot be estimated"
            )


def _system(block: Block) -> str:
    return "its local system" if block.frame.is_local else block.frame.crs


def _open_parts(plan: int, height: int) -> str:
    """Return what is open of a block with so many points that are known in plan and in height, empty for nothing: the
    least that fix seven parameters are two in plan and three in height."""
    parts = ["its position in plan"] * (plan == 0) + ["its height"] * (height == 0)
    parts += ["its heading", "its scale"] * (plan < 2)
    parts += ["its tilt"] if height < 2 else ["its tilt about the line between them"] * (height == 2)
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def _name(problem: Problem, variable: tuple[str, int] | None) -> str:
    if variable is None:
        return "a variable not named by GTSAM"
    kind, index = variable
    names: dict[str, Callable[[int], str]] = {
        POSE: lambda i: problem.block.photographs[i].name,
        CONTROL_POINT: lambda i: problem.block.control_points.with_role("control").name[i],
        GNSS_OFFSET: lambda i: problem.flights[i],
        COMMON_ERROR: lambda i: problem.block.common_errors[i].kind.replace("_", " "),
        RIG: lambda i: problem.block.rigs[i].name,
        CALIBRATION: lambda i: problem.block.cameras[i].name,
        TIE_POINT: str,
    }
    return f"{WORDS[kind]} {names[kind](index)}"


_LACKS = {
    POSE: "its position or attitude is not determined by control points, GNSS positions and tie points together",
    CONTROL_POINT: "it has no survey sigma that fixes it, and too few marks",
    GNSS_OFFSET: (
        "without control points it cannot be separated from the block's position: give gnss.offset_sigma_m, or 0"
    ),
    COMMON_ERROR: "nothing determines it",
    RIG: "its photographs have too few tie points of their own: give its relative pose, with standard deviations",
    CALIBRATION: "the photographs do not determine all free parameters: give prior sigmas, or fix some",
    TIE_POINT: "its rays are nearly parallel",
}


_WHOLE = {
    SHIFT: "its position is not determined: give control points or GNSS positions",
    TURN: (
        "a rotation is not determined: its control points and GNSS positions are collinear; give a point off the "
        "line, or measured attitudes"
    ),
    SCALE: "its scale is not determined: give control points or GNSS positions farther apart",
}


def undetermined(problem: Problem, error: IndeterminateError) -> AdjustmentError:
    """Return the error that names the variable of an indeterminate system and what it lacks, UndeterminedPartError
    where it is a single photograph."""
    no_solution = "the adjustment has no unique solution"
    if error.variable is None:
        return AdjustmentError(f"{no_solution}: {_name(problem, None)}: it is not determined")
    kind, index = error.variable
    if kind == DATUM:
        return AdjustmentError(f"{no_solution}: the block as a whole: {_WHOLE[index]}")
    message = f"{no_solution}: {_name(problem, error.variable)}: {_LACKS[kind]}"
    return (
        UndeterminedPartError(message, photographs={index: _LACKS[POSE]}) if kind == POSE else AdjustmentError(message)
    )


def control_marks(block: Block) -> IntArray:
    """Return the numbers of the marks of a block that take part in its adjustment, as Problem.marks has them."""
    points = block.control_points
    control = np.array([role == "control" for role in points.role], dtype=bool)
    return np.flatnonzero(control[points.mark_point] & np.isfinite(points.mark_sigma_px))


def check_in_front(problem: Problem, state: State) -> None:
    """Raise AdjustmentError naming the photographs that have a point of theirs behind them, and the marked points:
    UndeterminedPartError where it is a single mark or photograph."""
    block = problem.block
    control = block.control_points.with_role("control")
    marks = residuals(problem.marks, state.cameras, state.control)
    tie = residuals(problem.tie, state.cameras, state.tie_point)
    if np.isfinite(marks).all() and np.isfinite(tie).all():
        return
    lost = np.flatnonzero(~np.isfinite(marks).all(axis=1))
    marked = {
        m: f"control point {control.name[g]} is marked in {block.photographs[p].name} but lies behind it"
        for m, p, g in zip(
            lost.tolist(), problem.marks.photograph[lost].tolist(), problem.marks.point[lost].tolist(), strict=True
        )
    }
    photographs = np.unique(problem.tie.photograph[~np.isfinite(tie).all(axis=1)])
    seen = [f"tie points lie behind {block.photographs[p].name}" for p in photographs]
    message = (
        "points lie behind the cameras after the adjustment: "
        f"{'; '.join([*marked.values(), *seen])}: check the marks, and the "
        "GNSS position and attitude of these photographs"
    )
    if len(lost) == 1 and not len(photographs):
        number = int(control_marks(block)[lost[0]])
        raise UndeterminedPartError(message, marks={number: f"{marked[int(lost[0])]}: check the mark"})
    turned = np.union1d(photographs, problem.marks.photograph[lost])
    if len(turned) == 1:
        why = "points lie behind it after the adjustment: check its marks, its GNSS position and its attitude"
        raise UndeterminedPartError(message, photographs={int(turned[0]): why})
    raise AdjustmentError(message)


# ---- what is weak ----------------------------------------------------------------------------------------------------


def _axis(direction: FloatArray) -> str:
    """Return an axis (3,) of the map in words."""
    east, north, up = direction if direction[2] >= 0 else -direction
    if up > STEEP:
        return "the vertical"
    azimuth = float(np.rad2deg(np.arctan2(east, north))) % 360.0
    if up < FLAT:
        return f"a horizontal axis at {azimuth % 180.0:.0f}° from grid north"
    return f"an axis at {azimuth:.0f}° from grid north, inclined by {np.rad2deg(np.arcsin(up)):.0f}°"


def _weak_datum(covariance: FloatArray, axes: FloatArray, distance_m: float) -> list[str]:
    """Return what is weak of the datum with a covariance (7, 7), in the words of the map of ``axes`` (3, 3)."""
    sentences = []
    value, vector = np.linalg.eigh(covariance[3:6, 3:6])
    turn = float(np.sqrt(max(value[-1], 0.0)))
    if turn > WEAK_RAD:
        sentences.append(
            f"{ROTATION_WEAK} {_axis(axes.T @ vector[:, -1])} is known to "
            f"{np.rad2deg(turn):.1f}° only (1 sigma): control points or GNSS positions farther from that "
            "axis, better ones, or measured "
            "attitudes would fix it"
        )
    scale = float(np.sqrt(max(covariance[6, 6], 0.0)))
    if scale > WEAK_SCALE:
        sentences.append(
            f"The scale of the block is known to {percent(scale, 1)} only (1 sigma): control points or GNSS positions "
            "farther apart, or better ones, would fix it"
        )
    value = np.linalg.eigvalsh(covariance[:3, :3])
    shift = float(np.sqrt(max(value[-1], 0.0)))
    if shift > WEAK_SHIFT * distance_m:
        sentences.append(
            f"{POSITION_WEAK} {shift:.3g} m only (1 sigma), {distance_m:.3g} m from what it "
            "shows: better control points or GNSS positions would fix it"
        )
    return sentences


def _rough_datum(rough: RoughPlace, covariance: FloatArray) -> str:
    """Return how positions that scatter by more than tells the vertical place a block, of whose datum the covariance is
    (7, 7)."""
    shift_m, tilt, heading, scale = (
        float(np.sqrt(np.linalg.eigvalsh(covariance[part, part])[-1]))
        for part in (slice(0, 3), slice(3, 5), slice(5, 6), slice(6, 7))
    )
    known = [f"position to {shift_m:.2g} m", f"tilt, by the way photographs are taken, to {np.rad2deg(tilt):.0f}°"]
    lost = []
    for name, value, is_open in (
        ("heading", f"{np.rad2deg(heading):.0f}°", rough.open_heading),
        ("scale", percent(scale, 1), scale > OPEN_SCALE),
    ):
        if is_open:
            lost.append(f"its {name}")
        else:
            known.append(f"{name} to {value}")
    not_known = f"; {' and '.join(lost)} {'are' if len(lost) > 1 else 'is'} not determined" if lost else ""
    distances = "" if scale < WEAK_SCALE else ", and measured distances would give its scale"
    return (
        f"{ROUGHLY_PLACED} {rough.sigma_m:.2g} m while the photographs stand within {rough.width_m:.2g} m: "
        f"{', '.join(known)} (1 sigma){not_known}; its shape is known better than its place: three control points "
        f"would place it{distances}"
    )


def weak_parts(problem: Problem, state: State, covariances: Covariances) -> list[str]:
    """Return a sentence for what the measurements hold badly: the block as a whole, where its datum is weak; single
    photographs, beyond what they share with the block; focal lengths."""
    block, distance = problem.block, reach_m(problem, state)
    poses = covariances.poses
    axes = block.frame.rotation_world_from_map(np.zeros(3))
    whole = datum_of(covariances.layout, state, distance, weights_of(poses, distance))
    sentences = []
    if len(poses) > 1:
        covariance, rough = covariances.between(whole.fit, whole.fit), rough_place(block)
        sentences += _weak_datum(covariance, axes, distance) if rough is None else [_rough_datum(rough, covariance)]
    attitude = np.sqrt(np.einsum("naa->na", poses)[:, :3].max(axis=1, initial=0.0))
    position = np.sqrt(np.einsum("naa->na", poses)[:, 3:].max(axis=1, initial=0.0))
    ratio = np.maximum(attitude / WEAK_RAD, position / (WEAK_SHIFT * distance))
    rays = np.bincount(problem.tie.photograph, minlength=len(poses))
    marks = np.bincount(problem.marks.photograph, minlength=len(poses))
    named = 0
    for i in np.argsort(-ratio, kind="stable")[: 4 * MOST_NAMED].tolist():
        if ratio[i] <= 1.0 or named == MOST_NAMED:
            break
        at = 6 * int(covariances.layout.place[i])
        own = whole.own(slice(at, at + 6)) if len(poses) > 1 else np.eye(len(whole.fit), 6)
        covariance = covariances.between(own, own)
        turn = float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
        shift = float(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1]))
        if turn <= WEAK_RAD and shift <= WEAK_SHIFT * distance:
            continue
        named += 1
        sentences.append(
            f"Photograph {block.photographs[i].name} is weakly determined by its {rays[i]} tie points and "
            f"{marks[i]} marks "
            f"of control points: its attitude is known to {np.rad2deg(attitude[i]):.1f}°, its position to "
            f"{position[i]:.3g} m (1 sigma); more overlap or marks would fix it"
        )
    return sentences + _weak_cameras(problem, covariances)


def _weak_cameras(problem: Problem, covariances: Covariances) -> list[str]:
    """Return what is weak of focal lengths and principal points."""
    sentences = []
    for c, camera in enumerate(problem.block.cameras):
        sigma = np.sqrt(np.diag(covariances.calibration(c)))
        for k, name, size, of in (
            (0, "focal length", camera.focal_px, ""),
            (1, "principal point in x", float(camera.width_px), " of the width"),
            (2, "principal point in y", float(camera.height_px), " of the height"),
        ):
            if sigma[k] > WEAK_CAMERA * size:
                sentences.append(
                    f"The {name} of {camera.name} is known to {sigma[k]:.3g} px only, {percent(sigma[k] / size)}{of} "
                    "(1 sigma): a prior sigma, control points at different distances, or photographs rotated "
                    "about the viewing direction would fix it"
                )
    return sentences
