"""The profile of an authority: its figures with the keys that they come from, its classes, and what it says."""

from collections.abc import Sequence

import numpy as np

from photogram.arrays import FloatArray
from photogram.languages.language import ENGLISH, Language
from photogram.quality.asprs import MINIMUM_POINTS, STANDARD, ReportSettings
from photogram.report.record.ground import GroundPointRecord
from photogram.report.record.verdict import AsprsRecord, ScaleClassRecord, StandardFigureRecord, StandardRecord
from photogram.report.standards import pec_pcd


def standard_record(
    settings: ReportSettings,
    points: Sequence[GroundPointRecord],
    asprs: AsprsRecord,
    language: Language = ENGLISH,
) -> StandardRecord | None:
    """Return the profile that the project asks for, from the ground points of a report and its accuracy, in a language
    but for what an authority has its own words for; None where it asks for none."""
    if settings.standard == "asprs-2024":
        return _asprs(asprs)
    if settings.standard == "pec-pcd":
        return _pec_pcd(points, asprs, language)
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


def _pec_pcd(points: Sequence[GroundPointRecord], asprs: AsprsRecord, language: Language) -> StandardRecord:
    plan_m, height_m = _discrepancies(points)
    in_plan, in_height = language.gettext("RMS in plan"), language.gettext("RMS in height")
    figures: list[StandardFigureRecord] = [
        {"name": in_plan, "value_m": asprs["fit_rmse_h_m"], "n": asprs["n_h"], "key": "asprs.fit_rmse_h_m"},
        {"name": in_height, "value_m": asprs["fit_rmse_v_m"], "n": asprs["n_v"], "key": "asprs.fit_rmse_v_m"},
    ]
    scales = _scale_classes(plan_m, height_m)
    first_plan = next((row["scale"] for row in scales if row["plan"] == "A"), None)
    first_height = next((row["scale"] for row in scales if row["height"] == "A"), None)
    statements = list[str]()
    if first_plan is not None:
        statements.append(language.gettext("Class A in plan at 1:{scale} and smaller scales.", scale=first_plan))
    if first_height is not None:
        statements.append(language.gettext("Class A in height at 1:{scale} and smaller scales.", scale=first_height))
    return {
        "profile": "pec-pcd",
        "standard": pec_pcd.NAME,
        "least_points": pec_pcd.LEAST_POINTS,
        "figures": figures,
        "scales": scales,
        "statements": statements,
        "not_stated": _too_few(len(plan_m), len(height_m), language),
    }


def _too_few(n_plan: int, n_height: int, language: Language) -> list[str]:
    """Return why there is no class in plan, and none in height, of so many check points."""
    least, sentences = pec_pcd.LEAST_POINTS, list[str]()
    if not n_plan:
        sentences.append(
            language.gettext(
                "No class in plan: no check points, and whether 90 % are within a limit takes {least} at least.",
                least=least,
            )
        )
    elif n_plan < least:
        sentences.append(
            language.ngettext(
                "No class in plan: {n} check point, and whether 90 % are within a limit takes {least} at least.",
                "No class in plan: {n} check points, and whether 90 % are within a limit takes {least} at least.",
                n_plan,
                least=least,
            )
        )
    if not n_height:
        sentences.append(
            language.gettext(
                "No class in height: no check points, and whether 90 % are within a limit takes {least} at least.",
                least=least,
            )
        )
    elif n_height < least:
        sentences.append(
            language.ngettext(
                "No class in height: {n} check point, and whether 90 % are within a limit takes {least} at least.",
                "No class in height: {n} check points, and whether 90 % are within a limit takes {least} at least.",
                n_height,
                least=least,
            )
        )
    return sentences


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
