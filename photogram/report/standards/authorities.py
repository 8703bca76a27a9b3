"""The profile of an authority: its figures with the keys that they come from, its classes, and what it says."""

from collections.abc import Sequence

import numpy as np

from photogram.arrays import FloatArray
from photogram.quality.asprs import MINIMUM_POINTS, STANDARD, ReportSettings
from photogram.report.record.ground import GroundPointRecord
from photogram.report.record.verdict import AsprsRecord, ScaleClassRecord, StandardFigureRecord, StandardRecord
from photogram.report.standards import pec_pcd


def standard_record(
    settings: ReportSettings, points: Sequence[GroundPointRecord], asprs: AsprsRecord
) -> StandardRecord | None:
    """Return the profile that the project asks for, from the ground points of a report and its accuracy; None where it
    asks for none."""
    if settings.standard == "asprs-2024":
        return _asprs(asprs)
    if settings.standard == "pec-pcd":
        return _pec_pcd(points, asprs)
    return None


def _asprs(asprs: AsprsRecord) -> StandardRecord:
    figures: list[StandardFigureRecord] = [
        {"name": "RMSE_H", "value_m": asprs["rmse_h_m"], "n": asprs["n_h"], "key": "asprs.rmse_h_m"},
        {"name": "RMSE_V", "value_m": asprs["rmse_v_m"], "n": asprs["n_v"], "key": "asprs.rmse_v_m"},
    ]
    return {
        "profile": "asprs-2024",
        "standard": STANDARD,
        "least_points": MINIMUM_POINTS,
        "figures": figures,
        "scales": [],
        "statements": asprs["statements"],
        "not_stated": asprs["not_stated"],
    }


def _pec_pcd(points: Sequence[GroundPointRecord], asprs: AsprsRecord) -> StandardRecord:
    plan_m, height_m = _discrepancies(points)
    figures: list[StandardFigureRecord] = [
        {"name": "RMS in plan", "value_m": asprs["fit_rmse_h_m"], "n": asprs["n_h"], "key": "asprs.fit_rmse_h_m"},
        {"name": "RMS in height", "value_m": asprs["fit_rmse_v_m"], "n": asprs["n_v"], "key": "asprs.fit_rmse_v_m"},
    ]
    statements, not_stated = [], []
    for where, discrepancy_m in (("in plan", plan_m), ("in height", height_m)):
        n = len(discrepancy_m)
        if n < pec_pcd.LEAST_POINTS:
            not_stated.append(
                f"No class {where}: {n or 'no'} check point{'' if n == 1 else 's'}, and whether 90 % are within a "
                f"limit takes {pec_pcd.LEAST_POINTS} at least."
            )
    scales = _scale_classes(plan_m, height_m)
    for where, kind in (("in plan", "plan"), ("in height", "height")):
        first = next((row for row in scales if row[kind] == "A"), None)  # type: ignore[literal-required]
        if first is not None:
            statements.append(f"Class A {where} at 1:{first['scale']} and smaller scales.")
    return {
        "profile": "pec-pcd",
        "standard": pec_pcd.NAME,
        "least_points": pec_pcd.LEAST_POINTS,
        "figures": figures,
        "scales": scales,
        "statements": statements,
        "not_stated": not_stated,
    }


def _scale_classes(plan_m: FloatArray, height_m: FloatArray) -> list[ScaleClassRecord]:
    """Return the classes by scale, up to the first at which all that is tested is of the strictest; none without
    points enough."""
    rows: list[ScaleClassRecord] = []
    tested = {kind for kind, values in (("plan", plan_m), ("height", height_m)) if len(values) >= pec_pcd.LEAST_POINTS}
    if not tested:
        return rows
    for scale, interval_m in pec_pcd.CONTOUR_INTERVAL_M.items():
        plan, height = pec_pcd.plan_class(plan_m, scale), pec_pcd.height_class(height_m, scale)
        rows.append({"scale": scale, "contour_interval_m": float(interval_m), "plan": plan, "height": height})
        if all(found == "A" for kind, found in (("plan", plan), ("height", height)) if kind in tested):
            break
    return rows


def _discrepancies(points: Sequence[GroundPointRecord]) -> tuple[FloatArray, FloatArray]:
    """Return lengths of differences in plan (n,) and differences in height (m,) of check points, m."""
    rows = [(p["axis_roles"], p["residual_m"]) for p in points if p["residual_m"] is not None]
    plan = [np.hypot(d[0], d[1]) for roles, d in rows if roles[0] == roles[1] == "check"]
    height = [d[2] for roles, d in rows if roles[2] == "check"]
    return np.array(plan, dtype=np.float64), np.array(height, dtype=np.float64)
