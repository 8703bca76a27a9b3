"""The figures of an audit as the rows of its tables, for terminal, page and audit.json."""

from collections.abc import Sequence

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.exchange.audit.audit import Audit
from photogram.exchange.audit.differences import PoseDifference
from photogram.exchange.audit.findings import contradictions, left_out
from photogram.exchange.audit.fits import Fit
from photogram.exchange.audit.further_solutions import FurtherSolution
from photogram.exchange.audit.page import AuditTables, CalibrationRow, FigureRow, PoseRow
from photogram.exchange.audit.precision import exterior_sigmas, ground_sigmas
from photogram.files.solutions.solution import ForeignSolution, StatedAdjustment
from photogram.geodesy.crs import crs_label
from photogram.projection import CAMERA_PARAMETERS, CameraParameter
from photogram.quality.accuracy import CheckAccuracy
from photogram.survey import Block, ControlPoints
from photogram.wording import things

NOTHING = "–"
FITTED = ", fitted"
"""What is said of a check point that the program itself used as control."""
CORRELATED = 0.8
"""Absolute correlation from which two parameters are said to be hardly told apart."""


def tables(audit: Audit) -> AuditTables:
    """Return all tables of an audit."""
    return AuditTables(
        audit.solution.program,
        _about(audit),
        tuple(_figures(audit)),
        tuple(_calibrations(audit)),
        tuple(_poses(audit)),
        contradictions(audit),
        left_out(audit),
        tuple(_names(audit)),
        tuple(_checks(audit)),
        tuple(_precision(audit)),
        _scaled(audit),
    )


def _names(audit: Audit) -> list[str]:
    """Return the names of further programs, each its own."""
    names: list[str] = [audit.solution.program]
    for solution in audit.solutions[1:]:
        program, number = solution.program, 2
        while program in names:
            program, number = f"{solution.program} ({number})", number + 1
        names.append(program)
    return names[1:]


def _about(audit: Audit) -> str:
    solution, block = audit.solution, audit.start.block
    oriented = sum(photograph.pose is not None for photograph in solution.photographs)
    where = (
        "The coordinates are those of a free network, in a unit of its own: lengths below are in that unit."
        if block.is_free
        else "Coordinates are those of the ground points; no CRS is stated."
        if block.frame.is_local
        else f"Coordinates are in {crs_label(block.frame.crs)}."
    )
    placed = ""
    if not audit.start.is_placed and not block.is_free:
        placed = (
            " The files do not say where the solution lies: a similarity brought it to its control points or positions."
        )
    ties, marks = len(block.tie_points), len(block.control_points.mark_point)
    others = "".join(_about_other(each, name) for each, name in zip(audit.further, _names(audit), strict=True))
    return (
        f"{oriented} of {len(solution.photographs)} photographs oriented by {solution.program}; {ties} tie points with "
        f"{len(block.tie_points.photograph)} observations, {len(block.control_points)} ground points with {marks} "
        f"marks. {where}{placed}{_model(solution.stated)}{others}"
    )


def _model(stated: StatedAdjustment) -> str:
    """Return what the column of their weights takes over of their adjustment, as a sentence."""
    has_fixed = stated.held is not None and stated.held.any()
    parts = [
        "what they held of the calibration is held" if has_fixed else "",
        "the marks of check points are measurements of points without a survey" if stated.uses_check_marks else "",
        "nothing is rejected" if stated.is_least_squares else "",
    ]
    words = ", ".join(part for part in parts if part)
    return f" With their weights, as in their adjustment, {words}." if words else ""


def _about_other(other: FurtherSolution, name: str) -> str:
    shared = int((other.photograph_of >= 0).sum())
    points = int((other.point_of >= 0).sum())
    ties = other.start.block.tie_points
    where = (
        "its poses are compared where its files place them"
        if other.is_in_the_same_map
        else "its poses are compared after a similarity of the projection centres"
        if other.poses
        else "its poses cannot be compared: too few photographs in common"
    )
    return (
        f" Beside it {name}, which has {shared} of the photographs and {points} of the ground points; its figures are "
        f"of its own {things(len(ties), 'tie point')} with {len(ties.photograph)} observations, and {where}."
    )


def _number(value: float | None, digits: int, unit: str = "") -> str:
    return NOTHING if value is None or not np.isfinite(value) else f"{value:.{digits}f}{unit}"


def _accuracy(accuracy: CheckAccuracy | None) -> str:
    if accuracy is None or not accuracy.n:
        return NOTHING
    return f"{accuracy.rmse_h_m:.3f}, {accuracy.rmse_v_m:.3f} m ({accuracy.n})"


def _row(name: str, cells: Sequence[str]) -> FigureRow:
    """Return a row of the cells of theirs, of further programs, of the same weights and of ours."""
    return FigureRow(name, cells[0], cells[-2], cells[-1], tuple(cells[1:-2]))


def _figures(audit: Audit) -> list[FigureRow]:
    fits: list[Fit | None] = [audit.theirs, *(each.fit for each in audit.further), audit.same_fit, audit.ours_fit]
    tie_px = [None if fit is None else fit.tie_rms_px for fit in fits]
    mark_px = [None if fit is None else fit.mark_rms_px for fit in fits]
    control = [_accuracy(None if fit is None else fit.control) for fit in fits]
    check = [_accuracy(None if fit is None else fit.check) for fit in fits]
    for k, each in enumerate(zip(audit.solutions, audit.blocks, strict=True)):
        check[k] += FITTED if _checks_fitted(*each) else ""
    same, ours = audit.same, audit.ours.result
    sigma0 = [solution.stated.sigma0 for solution in audit.solutions]
    redundancy = [solution.stated.redundancy for solution in audit.solutions]
    sigma0 += [None if same is None else same.sigma0, ours.sigma0]
    redundancy += [None if same is None else same.redundancy, ours.redundancy]
    rows = [
        _row("Tie points: RMS of a residual", [_number(value, 3, " px") for value in tie_px]),
        _row("Marks: RMS of a residual", [_number(value, 3, " px") for value in mark_px]),
        _row("sigma0", [_number(value, 4) for value in sigma0]),
        _row("Redundancy", [_number(value, 0) for value in redundancy]),
        _row("Control points as fitted: RMSE in plan, height", control),
        _row("Check points: RMSE in plan, height", check),
    ]
    stated_px = [solution.reprojection_rms_px for solution in audit.solutions]
    if any(value is not None for value in stated_px):
        cells = [_number(value, 3, " px") for value in (*stated_px, None, None)]
        rows.insert(1, _row("The same as the program states it", cells))
    return rows


def _checks(audit: Audit) -> list[FigureRow]:
    """Return the check points one by one: adjusted minus surveyed, easting, northing, height."""
    points = audit.start.block.control_points
    fitted = _fitted(audit.solution, audit.start.block)
    rows = []
    for g in np.flatnonzero(~points.controlled.any(axis=1)).tolist():
        further, names = [], [points.name[g]]
        for each in audit.further:
            other = int(each.point_of[g])
            was = "" if other < 0 or not _fitted(each.solution, each.start.block)[other] else FITTED
            further.append(NOTHING if other < 0 else _triple(each.fit.off_m[other]) + was)
            name = "" if other < 0 else each.start.block.control_points.name[other]
            names += [name] if name and name not in names else []
        same = NOTHING if audit.same_fit is None else _triple(audit.same_fit.off_m[g])
        ours = _triple(audit.ours_fit.off_m[g])
        theirs = _triple(audit.theirs.off_m[g]) + (FITTED if fitted[g] else "")
        rows.append(_row(" = ".join(names), [theirs, *further, same, ours]))
    return rows


def _fitted(solution: ForeignSolution, block: Block) -> BoolArray:
    """Return which points of a program's block (G,) it used as control, whatever they are here."""
    fitted = solution.stated.fitted
    if fitted is None:
        return np.asarray(block.control_points.controlled.any(axis=1))
    return fitted[_surveyed(solution.ground_points)]


def _checks_fitted(solution: ForeignSolution, block: Block) -> bool:
    """Return whether a program used a check point as control."""
    return bool((_fitted(solution, block) & ~block.control_points.controlled.any(axis=1)).any())


def _triple(off_m: FloatArray) -> str:
    return NOTHING if not np.isfinite(off_m).all() else ", ".join(f"{value:+.3f}" for value in off_m.tolist())


def _scaled(audit: Audit) -> str:
    """Return what standard deviations are multiplied by, as a sentence; nothing where no program states any."""
    names = [audit.solution.program, *_names(audit)]
    stating = [(name, s.stated) for name, s in zip(names, audit.solutions, strict=True) if _states(s.stated)]
    if not stating:
        return ""
    scaled = [name for name, stated in stating if stated.sigmas_are_scaled]
    own = audit.solution.stated.sigmas_are_scaled
    theirs = f"Those of {' and '.join(scaled)} are multiplied by sigma0" if scaled else "None is multiplied by sigma0"
    also = ", and so are those with their weights" if own else ", ours are not" if scaled else ""
    return f"{theirs}{also}."


def _states(stated: StatedAdjustment) -> bool:
    return any(sigma is not None for sigma in (stated.angle_sigma_deg, stated.position_sigma_m, stated.ground_sigma_m))


def _precision(audit: Audit) -> list[FigureRow]:
    """Return standard deviations of exterior orientations and ground points, where a program states its own."""
    if not _scaled(audit):
        return []
    same, ours = audit.same, audit.ours.result
    factor = same.sigma0 if same is not None and audit.solution.stated.sigmas_are_scaled else 1.0
    nowhere = np.full((len(audit.solution.photographs), 3), np.nan)
    of_same = (nowhere, nowhere) if same is None else exterior_sigmas(same)
    of_ours = exterior_sigmas(ours)
    rows = []
    for i, photograph in enumerate(audit.solution.photographs):
        for k, (what, name) in enumerate(
            (("omega, phi, kappa, degrees", "angle_sigma_deg"), ("projection centre, m", "position_sigma_m"))
        ):
            further = [_stated(each.solution.stated, name, int(each.photograph_of[i])) for each in audit.further]
            theirs = _stated(audit.solution.stated, name, i)
            cells = [theirs, *further, _sigmas(factor * of_same[k][i]), _sigmas(of_ours[k][i])]
            rows.append(_row(f"{photograph.name}: {what}", cells))
    return rows + _ground_precision(audit, factor)


def _ground_precision(audit: Audit, factor: float) -> list[FigureRow]:
    points, ours = audit.start.block.control_points, ground_sigmas(audit.ours.result)
    same = np.full(ours.shape, np.nan) if audit.same is None else factor * ground_sigmas(audit.same)
    surveyed = np.flatnonzero(_surveyed(audit.solution.ground_points))
    rows = []
    for g, name in enumerate(points.name):
        further = []
        for each in audit.further:
            other = int(each.point_of[g])
            own = np.flatnonzero(_surveyed(each.solution.ground_points))
            further.append(NOTHING if other < 0 else _stated(each.solution.stated, "ground_sigma_m", int(own[other])))
        theirs = _stated(audit.solution.stated, "ground_sigma_m", int(surveyed[g]))
        cells = [theirs, *further, _sigmas(same[g]), _sigmas(ours[g])]
        rows.append(_row(f"{points.role[g]} point {name}, m", cells))
    return rows


def _surveyed(points: ControlPoints | None) -> BoolArray:
    """Return which ground points of a solution (G,) are in its block."""
    if points is None:
        return np.zeros(0, dtype=bool)
    return np.asarray(np.isfinite(points.position_world_m).all(axis=1))


def _stated(stated: StatedAdjustment, name: str, i: int) -> str:
    sigma = getattr(stated, name)
    return NOTHING if sigma is None or i < 0 else _sigmas(sigma[i])


def _sigmas(sigma: FloatArray) -> str:
    """Return standard deviations with three digits."""
    if not np.isfinite(sigma).all():
        return NOTHING
    return ", ".join(f"{value:#.3g}".removesuffix(".") for value in sigma.tolist())


def _calibrations(audit: Audit) -> list[CalibrationRow]:
    rows = []
    result = audit.ours.result
    for c, camera in enumerate(audit.solution.cameras):
        own, covariance = result.block.cameras[c], result.covariances.calibration[c]
        sigma = np.sqrt(np.diag(covariance))
        known = np.flatnonzero(sigma > 0.0)
        correlation = np.zeros_like(covariance)
        correlation[np.ix_(known, known)] = covariance[np.ix_(known, known)] / np.outer(sigma[known], sigma[known])
        for k, p in enumerate(CAMERA_PARAMETERS):
            if sigma[k] == 0.0 and camera.parameters[k] == 0.0:
                continue
            others = [n for n in known.tolist() if n != k and abs(correlation[k, n]) >= CORRELATED]
            with_others = ", ".join(f"{CAMERA_PARAMETERS[n].words} {correlation[k, n]:+.2f}" for n in others)
            further = [each.cameras[c] for each in audit.further]
            rows.append(
                CalibrationRow(
                    camera.name,
                    p.words,
                    _parameter(p, float(camera.parameters[k])),
                    _parameter(p, float(own.parameters[k])),
                    _parameter(p, float(sigma[k])) if sigma[k] > 0.0 else "held",
                    _number(float(audit.parameter_sigmas[c, k]), 1),
                    with_others,
                    tuple(NOTHING if other is None else _parameter(p, float(other.parameters[k])) for other in further),
                    tuple(_number(float(each.parameter_sigmas[c, k]), 1) for each in audit.further),
                )
            )
    return rows


def _parameter(parameter: CameraParameter, value: float) -> str:
    return f"{value:.{parameter.digits}f}" + (f" {parameter.unit}" if parameter.unit else "")


def _poses(audit: Audit) -> list[PoseRow]:
    """Return the differences, each photograph's together, the one in which the audited program differs most first."""
    further = [{pose.photograph: pose for pose in each.poses} for each in audit.further]
    rows = []
    for pose in sorted(audit.poses, key=lambda p: -p.sigmas):
        rows.append(_pose(audit.solution.program, pose))
        others = zip(_names(audit), further, strict=True)
        rows += [_pose(name, poses[pose.photograph]) for name, poses in others if pose.photograph in poses]
    return rows


def _pose(program: str, pose: PoseDifference) -> PoseRow:
    position = ", ".join(f"{value:+.3f}" for value in pose.position_m.tolist())
    turn = ", ".join(f"{angle:+.4f}" for angle in np.rad2deg(pose.rotation_rad).tolist())
    return PoseRow(pose.photograph, program, position, turn, f"{pose.sigmas:.2f}")
