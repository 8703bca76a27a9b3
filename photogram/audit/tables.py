"""The figures of an audit as the rows of its tables, for terminal, page and audit.json."""

from __future__ import annotations

import numpy as np

from photogram.audit.audit import Audit, Fit
from photogram.audit.findings import contradictions, left_out
from photogram.crs import crs_label
from photogram.projection import CAMERA_PARAMETERS
from photogram.quality.accuracy import CheckAccuracy
from photogram.report.audit_page import AuditTables, CalibrationRow, FigureRow, PoseRow

NOTHING = "–"
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
    )


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
    placed = "" if audit.start.is_placed or block.is_free else (
        " The files do not say where the solution lies: a similarity brought it to its control points or positions."
    )  # fmt: skip
    ties, marks = len(block.tie_points), len(block.control_points.mark_point)
    return (
        f"{oriented} of {len(solution.photographs)} photographs oriented by {solution.program}; {ties} tie points with "
        f"{len(block.tie_points.photograph)} observations, {len(block.control_points)} ground points with {marks} "
        f"marks. {where}{placed}"
    )


def _number(value: float | None, digits: int) -> str:
    return NOTHING if value is None or not np.isfinite(value) else f"{value:.{digits}f}"


def _accuracy(found: CheckAccuracy | None) -> str:
    if found is None or not found.n:
        return NOTHING
    return f"{found.rmse_h_m:.3f}, {found.rmse_v_m:.3f} m ({found.n})"


def _figures(audit: Audit) -> list[FigureRow]:
    same, ours, fits = audit.same, audit.ours.result, (audit.theirs, audit.same_fit, audit.ours_fit)

    def row(name: str, what: str, digits: int, unit: str) -> FigureRow:
        values = [None if fit is None else float(getattr(fit, what)) for fit in fits]
        shown = [_number(value, digits) for value in values]
        return FigureRow(name, *(s if s == NOTHING else s + unit for s in shown))

    def accuracy(name: str, of: str) -> FigureRow:
        return FigureRow(name, *(_accuracy(None if fit is None else _part(fit, of)) for fit in fits))

    rows = [
        row("Tie points: RMS of a residual", "tie_rms_px", 3, " px"),
        row("Marks: RMS of a residual", "mark_rms_px", 3, " px"),
        FigureRow("sigma0", NOTHING, _number(None if same is None else same.sigma0, 4), _number(ours.sigma0, 4)),
        FigureRow("Redundancy", NOTHING, NOTHING if same is None else str(same.redundancy), str(ours.redundancy)),
        accuracy("Control points as fitted: RMSE in plan, height", "control"),
        accuracy("Check points: RMSE in plan, height", "check"),
    ]
    stated = audit.solution.reprojection_rms_px
    if stated is not None:
        rows.insert(1, FigureRow("The same as the program states it", f"{stated:.3f} px", NOTHING, NOTHING))
    return rows


def _part(fit: Fit, of: str) -> CheckAccuracy:
    return fit.control if of == "control" else fit.check


def _calibrations(audit: Audit) -> list[CalibrationRow]:
    rows = []
    result = audit.ours.result
    for c, camera in enumerate(audit.solution.cameras):
        own, covariance = result.block.cameras[c], result.calibration_covariance[c]
        sigma = np.sqrt(np.diag(covariance))
        known = np.flatnonzero(sigma > 0.0)
        correlation = np.zeros_like(covariance)
        correlation[np.ix_(known, known)] = covariance[np.ix_(known, known)] / np.outer(sigma[known], sigma[known])
        for k, p in enumerate(CAMERA_PARAMETERS):
            if sigma[k] == 0.0 and camera.parameters[k] == 0.0:
                continue
            others = [n for n in known.tolist() if n != k and abs(correlation[k, n]) >= CORRELATED]
            with_others = ", ".join(f"{CAMERA_PARAMETERS[n].words} {correlation[k, n]:+.2f}" for n in others)
            unit = f" {p.unit}" if p.unit else ""
            rows.append(
                CalibrationRow(
                    camera.name,
                    p.words,
                    f"{camera.parameters[k]:.{p.digits}f}{unit}",
                    f"{own.parameters[k]:.{p.digits}f}{unit}",
                    f"{sigma[k]:.{p.digits}f}{unit}" if sigma[k] > 0.0 else "held",
                    _number(float(audit.parameter_sigmas[c, k]), 1),
                    with_others,
                )
            )
    return rows


def _poses(audit: Audit) -> list[PoseRow]:
    rows = []
    for pose in sorted(audit.poses, key=lambda p: -p.sigmas):
        east, north, up = pose.position_m.tolist()
        turn = np.rad2deg(pose.rotation_rad).tolist()
        rows.append(
            PoseRow(
                pose.photograph,
                f"{east:+.3f}, {north:+.3f}, {up:+.3f}",
                ", ".join(f"{angle:+.4f}" for angle in turn),
                f"{pose.sigmas:.2f}",
            )
        )
    return rows
