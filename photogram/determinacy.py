"""Blocks that cannot be adjusted: which variable is not determined, and what it lacks, in a surveyor's words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from photogram.errors import AdjustmentError
from photogram.factors.graph import IndeterminateError, Problem
from photogram.factors.reprojection import residuals
from photogram.factors.state import State
from photogram.factors.variables import CALIBRATION, CONTROL_POINT, GNSS_OFFSET, POSE, TIE_POINT, WORDS


def check_determined(problem: Problem) -> None:
    """Raise AdjustmentError for what can be seen to be undetermined before anything is solved."""
    block = problem.block
    seen = np.bincount(problem.tie.photograph, minlength=len(block.photographs))
    seen += np.bincount(problem.marks.photograph, minlength=len(block.photographs))
    for photograph, rays in zip(block.photographs, seen, strict=True):
        held = photograph.gnss_world_m is not None and photograph.attitude_sigma_rad is not None
        if rays < 3 and not held:
            raise AdjustmentError(
                f"photograph {photograph.name}: {rays} image points take part, at least 3 are needed: "
                "match it with more overlap, mark control points in it, or leave it out"
            )
    positions = sum(p.gnss_world_m is not None for p in block.photographs)
    plan, height = np.isfinite(problem.control_sigma_m).sum(axis=0)[1:].tolist()
    if min(plan, height) < 3 and positions < 3:
        count = len(problem.control_world_m)
        part = "" if plan == height == count else f" ({plan} of them in plan, {height} in height)"
        raise AdjustmentError(
            f"nothing fixes the block in {block.frame.crs}: {count} control points{part} "
            f"and {positions} GNSS positions; three of either, not in one line, are needed"
        )
    used = set(problem.tie.camera.tolist()) | set(problem.marks.camera.tolist())
    for c, camera in enumerate(block.cameras):
        if c not in used and np.any(np.isinf(camera.sigmas)):
            raise AdjustmentError(
                f"camera {camera.name}: no photograph of it takes part, its free parameters cannot be estimated"
            )


def _name(problem: Problem, variable: tuple[str, int] | None) -> str:
    if variable is None:
        return "a variable that GTSAM does not name"
    kind, index = variable
    names: dict[str, Callable[[int], str]] = {
        POSE: lambda i: problem.block.photographs[i].name,
        CONTROL_POINT: lambda i: problem.block.control_points.with_role("control").name[i],
        GNSS_OFFSET: lambda i: problem.flights[i],
        CALIBRATION: lambda i: problem.block.cameras[i].name,
        TIE_POINT: str,
    }
    return f"{WORDS[kind]} {names[kind](index)}"


_LACKS = {
    POSE: "its position or attitude is not held by control points, GNSS positions and tie points together",
    CONTROL_POINT: "it has no survey sigma that holds it and too few marks",
    GNSS_OFFSET: "without control points it cannot be told from the block's position: give gnss.offset_sigma_m, or 0",
    CALIBRATION: "the photographs cannot determine every free parameter: give a prior sigma, or hold it",
    TIE_POINT: "its rays are too nearly parallel",
}


def undetermined(problem: Problem, fault: IndeterminateError) -> AdjustmentError:
    """Return the fault that names the variable of an indeterminate system and what it lacks."""
    lacks = "it is not determined" if fault.variable is None else _LACKS[fault.variable[0]]
    return AdjustmentError(f"the adjustment has no unique solution: {_name(problem, fault.variable)}: {lacks}")


def check_in_front(problem: Problem, state: State) -> None:
    """Raise AdjustmentError naming the photographs that have a point of theirs behind them, and the marked points."""
    block = problem.block
    control = block.control_points.with_role("control")
    marks = residuals(problem.marks, state.parameters, state.rotation, state.position, state.control)
    tie = residuals(problem.tie, state.parameters, state.rotation, state.position, state.tie_point)
    if np.isfinite(marks).all() and np.isfinite(tie).all():
        return
    lost = ~np.isfinite(marks).all(axis=1)
    marked = [
        f"control point {control.name[g]} is marked in {block.photographs[p].name} but lies behind it"
        for p, g in zip(problem.marks.photograph[lost], problem.marks.point[lost], strict=True)
    ]
    photographs = np.unique(problem.tie.photograph[~np.isfinite(tie).all(axis=1)])
    seen = [f"tie points lie behind {block.photographs[p].name}" for p in photographs]
    raise AdjustmentError(
        f"the adjustment turned photographs over: {'; '.join(marked + seen)}: check the marks, and the GNSS position "
        "and attitude of these photographs"
    )
