"""The verdict on a whole survey: one sentence, a grade, the two figures that count, and what to do."""

import math
from collections.abc import Sequence

from photogram.quality.asprs import MINIMUM_POINTS
from photogram.report.numbers.traffic_lights import Direction, directions, number
from photogram.report.numbers.wording import UNIT
from photogram.report.record.local_frame import LocalFrameRecord
from photogram.report.record.positions import is_placed_by_prior
from photogram.report.record.report import SurveyNumbers
from photogram.report.record.verdict import (
    AsprsRecord,
    Grade,
    LightRecord,
    VerdictFigureRecord,
    VerdictRecord,
    WarningRecord,
)

FAR_APART = 1.5
"""Times the relative sigma, from which the absolute one is said beside it."""
MOST_TO_DO = 3
WITH_SURVEY = "together with their survey (ASPRS)"
"""Said of RMSE_H and RMSE_V, beside what was measured."""
_WORST_FIRST: tuple[Grade, ...] = ("bad", "attention", "unknown", "few", "good")


def length(value_m: object) -> str:
    """Write a standard deviation for a sentence: two digits, cm below a metre."""
    figure = number(value_m)
    if not math.isfinite(figure):
        return "unknown"
    unit, scaled = ("cm", 100 * figure) if figure < 0.995 else ("m", figure)
    digits = 1 if scaled < 9.95 else 0
    return f"{scaled:.{digits}f}\u202f{unit}"


def overall(
    report: SurveyNumbers, asprs: AsprsRecord, lights: Sequence[LightRecord], warnings: Sequence[WarningRecord]
) -> VerdictRecord:
    """Return the verdict on a survey, from its numbers, its accuracy by the standard, its lights and its warnings."""
    local = report.get("local_frame")
    if local is not None:
        return _of_free_network(report, local, lights, warnings)
    grade, sentence = _verdict(report, asprs, lights)
    also = _also(lights)
    if also and grade in ("good", "few"):
        grade = "attention"
    return {
        "grade": grade,
        "sentence": sentence,
        "also": also,
        "figures": [_figure(report, direction) for direction in directions(asprs)],
        "to_do": _to_do(asprs, warnings),
    }


def _of_free_network(
    report: SurveyNumbers,
    local: LocalFrameRecord,
    lights: Sequence[LightRecord],
    warnings: Sequence[WarningRecord],
) -> VerdictRecord:
    """Return the verdict on a network that nothing places: its relative precision is all that there is."""
    relative = local["relative"]
    size = length(relative["tie_points"]) if local["scale_known"] else f"{relative['tie_points']:.2g} {UNIT}"
    scale = "scaled by distances" if local["scale_known"] else "no scale"
    sentence = (
        f"Free network, relative precision predicted: ±\u202f{size} of the tie points (1 sigma), 1 in "
        f"{relative['tie_points_one_in']:,.0f} of the object; {scale}, no georeference."
    )
    remedies = [w["remedy"] for w in warnings if w["severity"] != "note" and w["remedy"]]
    if not report["adjustment"]["converged"]:
        sentence = "The adjustment did not converge: do not use this result."
    return {
        "grade": "unknown" if report["adjustment"]["converged"] else "bad",
        "sentence": sentence,
        "also": _also(lights),
        "figures": [],
        "to_do": list(dict.fromkeys(remedies))[:MOST_TO_DO] or ["nothing"],
    }


def _points(count: int) -> str:
    return f"{count} independent check point{'s' if count > 1 else ''}"


def _verdict(report: SurveyNumbers, asprs: AsprsRecord, lights: Sequence[LightRecord]) -> tuple[Grade, str]:
    if not report["adjustment"]["converged"]:
        return "bad", "The adjustment did not converge: do not use this result."
    both, assumed = directions(asprs), asprs["survey_assumed"]
    tested = [d for d in both if d.n]
    if not tested:
        return "unknown", _predicted(report)
    aimed = [d for d in tested if d.target_m is not None]
    if not aimed:
        return _without_target(tested, assumed, lights)
    missed = [d for d in aimed if not number(d.together_m if d.is_stated else d.fit_m) <= number(d.target_m)]
    if missed:
        missed_by = " and ".join(f"in {d.where} ({_measured(d)}, target {length(d.target_m)})" for d in missed)
        return "bad", f"Misses its target {missed_by} at {_points(max(d.n for d in missed))}."
    least = min(d.n for d in aimed)
    what = "targets" if len(aimed) == 2 else f"target in {aimed[0].where}"
    rest = [d.where for d in both if d not in aimed]
    untested = f"; in {rest[0]} nothing is tested against a target" if rest else ""
    if assumed and not all(d.is_stated for d in aimed):
        return "attention", f"RMSE within its {what} at {_points(least)}{untested}; {assumed}."
    return "good" if least >= MINIMUM_POINTS else "few", f"Meets its {what} at {_points(least)}{untested}."


def _measured(direction: Direction) -> str:
    survey = f", {length(direction.together_m)} {WITH_SURVEY}" if direction.is_stated else ""
    return f"RMSE {length(direction.fit_m)}{survey}"


def _without_target(
    tested: Sequence[Direction], assumed: str | None, lights: Sequence[LightRecord]
) -> tuple[Grade, str]:
    """Judge check points of a survey without a target as their lights do, by the size of a pixel on the ground;
    ``assumed`` says of which the accuracy of the survey is only assumed."""
    errors = " and ".join(f"{length(d.fit_m)} in {d.where}" for d in tested)
    sums = " and ".join(f"{length(d.together_m)} in {d.where}" for d in tested if d.is_stated)
    survey = (f"; {sums} {WITH_SURVEY}" if sums else "") + (f"; {assumed}" if assumed else "")
    subjects = {f"Check points in {d.where}" for d in tested}
    grades = [light["grade"] for light in lights if light["subject"] in subjects]
    grade: Grade = min(grades, key=_WORST_FIRST.index, default="unknown")
    return grade, f"RMSE of {errors} at {_points(min(d.n for d in tested))}{survey}; the project gives no target."


def _predicted(report: SurveyNumbers) -> str:
    placing = report["diagnosis"]["placing"]
    if not placing:
        return "Accuracy not tested: there are no check points."
    relative = number(placing["relative_plan_m"]), number(placing["relative_height_m"])
    absolute = number(placing["absolute_plan_m"]), number(placing["absolute_height_m"])
    figures = [
        f"±\u202f{length(plan)} in plan and ±\u202f{length(height)} in height" for plan, height in (relative, absolute)
    ]
    far = any(a > FAR_APART * r for r, a in zip(relative, absolute, strict=True))
    if far and is_placed_by_prior(report["gnss"]):
        predicted = f"Accuracy predicted, not tested: {figures[0]} relative to each other (1 sigma)"
        return f"{predicted}; absolute accuracy is that of GNSS, which nothing tests: assumed {figures[1]}."
    sigmas = f"{figures[0]} relative to each other, {figures[1]} absolute" if far else figures[1]
    return f"Accuracy predicted, not tested: {sigmas} (1 sigma)."


def _also(lights: Sequence[LightRecord]) -> str:
    """Return which other lights are red, those of the check points being said already."""
    red = [light["subject"] for light in lights if light["grade"] == "bad"]
    red = [subject for subject in red if not subject.startswith(("Check points", "Adjustment"))]
    return f"Red below: {', '.join(subject.removesuffix('?') for subject in red)}." if red else ""


def _figure(report: SurveyNumbers, tested: Direction) -> VerdictFigureRecord:
    """Return one of the two figures of the first screen: RMSE measured at check points, that with their survey, and the
    target, or what is predicted."""
    placing = report["diagnosis"]["placing"]
    relative_m = absolute_m = None
    if placing:
        plan = tested.where == "plan"
        relative_m = placing["relative_plan_m"] if plan else placing["relative_height_m"]
        absolute_m = placing["absolute_plan_m"] if plan else placing["absolute_height_m"]
    return {
        "where": f"in {tested.where}",
        "n": tested.n,
        "rmse_m": tested.fit_m if tested.n else None,
        "survey_m": tested.survey_m if tested.n else None,
        "asprs_rmse_m": tested.together_m if tested.n else None,
        "target_m": tested.target_m,
        "relative_sigma_m": relative_m,
        "absolute_sigma_m": absolute_m,
    }


def _to_do(asprs: AsprsRecord, warnings: Sequence[WarningRecord]) -> list[str]:
    """Return the first things to do: the remedies of the gravest warnings, or what the standard still asks for."""
    remedies = [w["remedy"] for w in warnings if w["severity"] != "note" and w["remedy"]]
    remedies = list(dict.fromkeys(remedies))[:MOST_TO_DO]
    least = min(asprs["n_h"], asprs["n_v"])
    if not remedies and 0 < least < MINIMUM_POINTS:
        return [f"nothing; survey {MINIMUM_POINTS} check points for the full statement of the standard ({least} now)"]
    return remedies or ["nothing"]
