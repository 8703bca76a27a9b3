"""What a report says of itself: accuracy by the standard, verdicts, warnings, and what was discarded.

All of it follows from the other figures of report.json and from what the project asks of the report, so that it can be
made anew whenever that changes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from photogram.quality.asprs import (
    STANDARD,
    Accuracy,
    ReportSettings,
    accuracy,
    blunders,
    coarse_survey,
    statement_h,
    statement_v,
    systematic,
)
from photogram.report.identity import report_id
from photogram.report.numbers.overall import overall
from photogram.report.numbers.ranked_warnings import ranked_warnings
from photogram.report.numbers.traffic_lights import AXES, traffic_lights

Json = dict[str, Any]
CLOUDS = {"linear_2view": "two-view", "linear_3view": "three-view"}


def complete(report: Mapping[str, Any], settings: ReportSettings) -> Json:
    """Return the report with `survey`, `asprs`, `discarded`, `warnings`, `summary`, `verdict` and `report_id` made from
    its other figures."""
    whole = dict(report)
    whole["survey"] = {**(report.get("survey") or {}), **_named(settings)}
    whole["asprs"] = asprs_numbers(report["control_points"], settings)
    whole["discarded"] = discarded(whole)
    whole["warnings"] = ranked_warnings(whole)
    whole["summary"] = [asdict(light) for light in traffic_lights(whole)]
    whole["verdict"] = overall(whole)
    whole["report_id"] = report_id(whole)
    return whole


def _named(settings: ReportSettings) -> Json:
    return {"name": settings.name or None, "client": settings.client or None, "author": settings.author or None}


# ---- accuracy by the standard --------------------------------------------------------------------------------------


def axis_roles(point: Mapping[str, Any]) -> list[str]:
    """Return the role of a ground point along easting, northing and height."""
    roles = point.get("axis_roles")
    if isinstance(roles, Mapping):
        return [str(roles.get(axis)) for axis in AXES]
    return [str(role) for role in roles] if roles else [str(point["role"])] * 3


def asprs_numbers(points: Sequence[Mapping[str, Any]], settings: ReportSettings) -> Json:
    """Return accuracy and statements of the ASPRS standard from the check points of a report; control points never
    enter here."""
    rows = [p for p in points if "check" in axis_roles(p) and p.get("residual_m") and p.get("surveyed_sigma_m")]
    checked = np.array([[role == "check" for role in axis_roles(p)] for p in rows], dtype=bool).reshape(-1, 3)
    # None, where an axis has no figure, becomes NaN
    difference_m = np.array([p["residual_m"] for p in rows], dtype=np.float64).reshape(-1, 3)
    difference_m = np.where(checked, difference_m, np.nan)
    sigma_m = np.array([p["surveyed_sigma_m"] for p in rows], dtype=np.float64).reshape(-1, 3)
    found, names = accuracy(difference_m, sigma_m), [str(p["name"]) for p in rows]
    return {
        "standard": STANDARD,
        "n_h": found.n_h,
        "n_v": found.n_v,
        "axes": {name: asdict(axis) for name, axis in zip(AXES, found.axes, strict=True)},
        "fit_rmse_h_m": found.fit_h_m,
        "fit_rmse_v_m": found.fit_v_m,
        "survey_rmse_h_m": found.survey_h_m,
        "survey_rmse_v_m": found.survey_v_m,
        "rmse_h_m": found.rmse_h_m,
        "rmse_v_m": found.rmse_v_m,
        "rmse_3d_m": found.rmse_3d_m,
        "target_rmse_h_m": settings.target_rmse_h_m,
        "target_rmse_v_m": settings.target_rmse_v_m,
        **_stated(found, settings),
        "blunders": blunders(difference_m, names, settings),
        "systematic": systematic(found, settings),
        "survey": coarse_survey(found, settings),
        "legacy_95": {"horizontal_m": found.legacy_95_h_m, "vertical_m": found.legacy_95_v_m}
        if settings.legacy_95
        else None,
    }


def _stated(found: Accuracy, settings: ReportSettings) -> Json:
    """Return the standard's statements, and for each that cannot be made a sentence that says why."""
    statements, missing = [], []
    rows = (
        ("horizontal", "h", found.n_h, found.rmse_h_m, settings.target_rmse_h_m, statement_h),
        ("vertical", "v", found.n_v, found.rmse_v_m, settings.target_rmse_v_m, statement_v),
    )
    for name, letter, n, rmse_m, target_m, statement in rows:
        text = None if target_m is None else statement(found, target_m)
        if text is not None:
            statements.append(text)
        elif not n:
            missing.append(f"No statement of {name} accuracy: no check points, the accuracy is not tested.")
        elif target_m is None:
            missing.append(
                f"No statement of {name} accuracy: it needs an accuracy class, and the project gives none; "
                f"set report.target_rmse_{letter}_m."
            )
        else:
            missing.append(
                f"No statement of {name} accuracy: the tested RMSE of {rmse_m:.3f} m (n = {n}) does not meet the class "
                f"of {target_m:.3f} m."
            )
    return {"statements": statements, "not_stated": missing}


# ---- what was discarded --------------------------------------------------------------------------------------------


CONTRADICTED = "it contradicts all other observations"


def discarded(report: Mapping[str, Any]) -> list[Json]:
    """Return what took no part in the result, and why: `{what, count, reason}`."""
    adjustment, found = report["adjustment"], list[Json]()

    def add(what: str, count: int, reason: str) -> None:
        if count:
            found.append({"what": what, "count": count, "reason": reason})

    for name, photograph in report["photographs"].items():
        if not photograph.get("registered", True):
            add(f"photograph {name}", 1, photograph.get("reason") or "not registered")
    add(
        "tie-point observations",
        adjustment["discarded_observations"],
        "rejected as outliers: they disagree with the other rays of their point, or the intersection angle "
        "is too small",
    )
    add("tie points", adjustment["discarded_tie_points"], "fewer than two observations remained")
    for point in report["control_points"]:
        if point.get("adjusted_map_m") is None:
            add(
                f"{point['role']} point {point['name']}", 1, "fewer than two intersecting marks in oriented photographs"
            )
        axes = [axis for axis, role in zip(AXES, axis_roles(point), strict=True) if role == "left out"]
        add(f"{', '.join(axes)} of control point {point['name']}", len(axes), CONTRADICTED)
        for mark in point.get("marks") or []:
            add(f"mark of {point['name']} in {mark['photograph']}", int(bool(mark.get("left_out"))), CONTRADICTED)
    for entry in (report.get("gnss") or {}).get("not_used") or []:
        add(f"GNSS position of {entry.get('photograph')}", 1, str(entry.get("reason")))
    for key, what, reason in (
        ("disbelieved_attitudes", "attitudes of the gimbal", "they contradict the tie points"),
        ("disbelieved_headings", "headings of the gimbal", "they contradict the tie points; the tilt is used"),
    ):
        add(what, int(adjustment.get(key) or 0), reason)
    for name, cloud in report["clouds"].items():
        reason = "removed by the statistical outlier filter before the comparison"
        add(f"points of the {CLOUDS.get(name, name)} cloud", int(cloud.get("removed_by_sor") or 0), reason)
    return found
