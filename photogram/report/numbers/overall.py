"""The verdict on a whole survey: one sentence, a grade, the two figures that count, and what to do."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from photogram.quality.asprs import MINIMUM_POINTS
from photogram.report.numbers.traffic_lights import number

Json = dict[str, Any]

FAR_APART = 1.5
"""Times the relative sigma, from which the absolute one is said beside it."""
MOST_TO_DO = 3
_DIRECTIONS = (("h", "in plan"), ("v", "in height"))


def length(value_m: object) -> str:
    """Write a standard deviation for a sentence: two digits, cm below a metre."""
    figure = number(value_m)
    if not math.isfinite(figure):
        return "unknown"
    unit, scaled = ("cm", 100 * figure) if figure < 0.995 else ("m", figure)
    digits = 1 if scaled < 9.95 else 0
    return f"{scaled:.{digits}f}\u202f{unit}"


def overall(report: Mapping[str, Any]) -> Json:
    """Return `{grade, sentence, also, figures, to_do}` of a report with `asprs`, `summary` and `warnings` in it."""
    grade, sentence = _verdict(report)
    also = _also(report)
    if also and grade in ("good", "few"):
        grade = "attention"
    return {
        "grade": grade,
        "sentence": sentence,
        "also": also,
        "figures": [_figure(report, letter, where) for letter, where in _DIRECTIONS],
        "to_do": _to_do(report),
    }


def _points(count: int) -> str:
    return f"{count} independent check point{'s' if count > 1 else ''}"


def _verdict(report: Mapping[str, Any]) -> tuple[str, str]:
    asprs = report["asprs"]
    if not report["adjustment"]["converged"]:
        return "bad", "The adjustment did not converge: do not use this result."
    tested = [(letter, where) for letter, where in _DIRECTIONS if asprs[f"n_{letter}"]]
    if not tested:
        return "unknown", _predicted(report)
    aimed = [(letter, where) for letter, where in tested if asprs[f"target_rmse_{letter}_m"] is not None]
    if not aimed:
        return _without_target(report, tested)
    missed = [
        (letter, where) for letter, where in aimed if not asprs[f"rmse_{letter}_m"] <= asprs[f"target_rmse_{letter}_m"]
    ]
    if missed:
        said = " and ".join(
            f"{where} (RMSE {length(asprs[f'rmse_{letter}_m'])}, target {length(asprs[f'target_rmse_{letter}_m'])})"
            for letter, where in missed
        )
        count = max(asprs[f"n_{letter}"] for letter, _ in missed)
        return "bad", f"Misses its target {said} at {_points(count)}."
    least = min(asprs[f"n_{letter}"] for letter, _ in aimed)
    what = "targets" if len(aimed) == 2 else f"target {aimed[0][1]}"
    rest = [where for letter, where in _DIRECTIONS if (letter, where) not in aimed]
    untested = f"; {rest[0]} nothing is tested against a target" if rest else ""
    return "good" if least >= MINIMUM_POINTS else "few", f"Meets its {what} at {_points(least)}{untested}."


def _without_target(report: Mapping[str, Any], tested: list[tuple[str, str]]) -> tuple[str, str]:
    """Judge check points of a survey without a target as their lights do, by the size of a pixel on the ground."""
    asprs = report["asprs"]
    said = " and ".join(f"{length(asprs[f'rmse_{letter}_m'])} {where}" for letter, where in tested)
    count = min(asprs[f"n_{letter}"] for letter, _ in tested)
    subjects = {f"Check points {where}" for _, where in tested}
    grades = [light["grade"] for light in report["summary"] if light["subject"] in subjects]
    order = ("bad", "attention", "unknown", "few", "good")
    grade = min(grades, key=order.index, default="unknown")
    return grade, f"RMSE of {said} at {_points(count)}; the project gives no target."


def _predicted(report: Mapping[str, Any]) -> str:
    placing = (report.get("diagnosis") or {}).get("placing")
    if not placing:
        return "Accuracy not tested: there are no check points."
    figures, sizes = [], []
    for which in ("relative", "absolute"):
        plan, height = number(placing[f"{which}_plan_m"]), number(placing[f"{which}_height_m"])
        sizes.append((plan, height))
        figures.append(f"±\u202f{length(plan)} in plan and ±\u202f{length(height)} in height")
    far = any(a > FAR_APART * r for r, a in zip(*sizes, strict=True))
    said = f"{figures[0]} relative to each other, {figures[1]} absolute" if far else figures[1]
    return f"Accuracy predicted, not tested: {said} (1 sigma)."


def _also(report: Mapping[str, Any]) -> str:
    """Return which other lights are red, those of the check points being said already."""
    red = [light["subject"] for light in report["summary"] if light["grade"] == "bad"]
    red = [subject for subject in red if not subject.startswith(("Check points", "Adjustment"))]
    return f"Red below: {', '.join(red)}." if red else ""


def _figure(report: Mapping[str, Any], letter: str, where: str) -> Json:
    """Return one of the two figures of the first screen: RMSE at check points with its target, or what is predicted."""
    asprs = report["asprs"]
    placing = (report.get("diagnosis") or {}).get("placing") or {}
    name = "plan" if letter == "h" else "height"
    return {
        "where": where,
        "n": asprs[f"n_{letter}"],
        "rmse_m": asprs[f"rmse_{letter}_m"] if asprs[f"n_{letter}"] else None,
        "fit_m": asprs[f"fit_rmse_{letter}_m"] if asprs[f"n_{letter}"] else None,
        "survey_m": asprs[f"survey_rmse_{letter}_m"] if asprs[f"n_{letter}"] else None,
        "target_m": asprs[f"target_rmse_{letter}_m"],
        "relative_sigma_m": placing.get(f"relative_{name}_m"),
        "absolute_sigma_m": placing.get(f"absolute_{name}_m"),
    }


def _to_do(report: Mapping[str, Any]) -> list[str]:
    """Return the first things to do: the remedies of the gravest warnings, or what the standard still asks for."""
    remedies = [w["remedy"] for w in report["warnings"] if w["severity"] != "note" and w["remedy"]]
    remedies = list(dict.fromkeys(remedies))[:MOST_TO_DO]
    asprs = report["asprs"]
    least = min(asprs["n_h"], asprs["n_v"])
    if not remedies and 0 < least < MINIMUM_POINTS:
        return [f"nothing; survey {MINIMUM_POINTS} check points for the full statement of the standard ({least} now)"]
    return remedies or ["nothing"]
