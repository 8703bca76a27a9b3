"""The verdict on a whole survey: one sentence, a grade, the two figures that count, and what to do."""

import math
from collections.abc import Sequence

from photogram.languages.language import ENGLISH, Language
from photogram.quality.asprs import MINIMUM_POINTS
from photogram.report.numbers.traffic_lights import Direction, directions, number
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
RED_SUBJECTS = (
    "Dense surface at check points",
    "Predicted against achieved",
    "Blunders",
    "Are blunders detectable?",
    "Stated sigmas",
    "Photographs oriented",
    "GNSS",
    "Geometry",
)
"""Lights that the verdict names where they are red; what those of check points and of the adjustment say, it says."""
_WORST_FIRST: tuple[Grade, ...] = ("bad", "attention", "unknown", "few", "good")


def length(value_m: object, language: Language = ENGLISH) -> str:
    """Write a standard deviation for a sentence: two digits, cm below a metre."""
    figure = number(value_m)
    if not math.isfinite(figure):
        return language.gettext("unknown")
    unit, scaled = ("cm", 100 * figure) if figure < 0.995 else ("m", figure)
    digits = 1 if scaled < 9.95 else 0
    return f"{language.figure(f'{scaled:.{digits}f}')}\u202f{unit}"


def overall(
    report: SurveyNumbers,
    asprs: AsprsRecord,
    lights: Sequence[LightRecord],
    warnings: Sequence[WarningRecord],
    language: Language = ENGLISH,
) -> VerdictRecord:
    """Return the verdict on a survey, from its numbers, its accuracy by the standard, its lights and its warnings, in
    the language of the remedies of these."""
    local = report.get("local_frame")
    if local is not None:
        return _of_free_network(report, local, lights, warnings, language)
    grade, sentence = _verdict(report, asprs, lights, language)
    also = _also(lights, language)
    if also and grade in ("good", "few"):
        grade = "attention"
    return {
        "grade": grade,
        "sentence": sentence,
        "also": also,
        "figures": [_figure(report, direction) for direction in directions(asprs)],
        "to_do": _to_do(asprs, warnings, language),
    }


def _not_converged(language: Language) -> str:
    return language.gettext("The adjustment did not converge: do not use this result.")


def _of_free_network(
    report: SurveyNumbers,
    local: LocalFrameRecord,
    lights: Sequence[LightRecord],
    warnings: Sequence[WarningRecord],
    language: Language,
) -> VerdictRecord:
    """Return the verdict on a network that nothing places: its relative precision is all that there is."""
    relative = local["relative"]
    one_in = language.figure(f"{relative['tie_points_one_in']:,.0f}")
    if not report["adjustment"]["converged"]:
        sentence = _not_converged(language)
    elif local["scale_known"]:
        sentence = language.gettext(
            "Free network, relative precision predicted: ±\u202f{size} of the tie points (1 sigma), 1 in {one_in} of "
            "the object; scaled by distances, no georeference.",
            size=length(relative["tie_points"], language),
            one_in=one_in,
        )
    else:
        sentence = language.gettext(
            "Free network, relative precision predicted: ±\u202f{size} units of the tie points (1 sigma), 1 in "
            "{one_in} of the object; no scale, no georeference.",
            size=language.figure(f"{relative['tie_points']:.2g}"),
            one_in=one_in,
        )
    remedies = [w["remedy"] for w in warnings if w["severity"] != "note" and w["remedy"]]
    return {
        "grade": "unknown" if report["adjustment"]["converged"] else "bad",
        "sentence": sentence,
        "also": _also(lights, language),
        "figures": [],
        "to_do": list(dict.fromkeys(remedies))[:MOST_TO_DO] or [language.gettext("nothing")],
    }


def _at_points(count: int, language: Language) -> str:
    return language.ngettext("at {n} independent check point", "at {n} independent check points", count)


def _in_plan_or_height(direction: Direction, value_m: float | None, language: Language) -> str:
    written = length(value_m, language)
    if direction.where == "plan":
        return language.gettext("{length} in plan", length=written)
    return language.gettext("{length} in height", length=written)


def _verdict(
    report: SurveyNumbers, asprs: AsprsRecord, lights: Sequence[LightRecord], language: Language
) -> tuple[Grade, str]:
    if not report["adjustment"]["converged"]:
        return "bad", _not_converged(language)
    both, assumed = directions(asprs), asprs["survey_assumed"]
    tested = [d for d in both if d.n]
    if not tested:
        return "unknown", _predicted(report, language)
    aimed = [d for d in tested if d.target_m is not None]
    if not aimed:
        return _without_target(tested, assumed, lights, language)
    missed = [d for d in aimed if not number(d.together_m if d.is_stated else d.fit_m) <= number(d.target_m)]
    if missed:
        sentence = language.gettext(
            "Misses its target {missed} {at_points}.",
            missed=language.listed([_missed(d, language) for d in missed]),
            at_points=_at_points(max(d.n for d in missed), language),
        )
        return "bad", sentence
    least, doubted = min(d.n for d in aimed), bool(assumed) and not all(d.is_stated for d in aimed)
    clauses = [_met(aimed, _at_points(least, language), doubted, language)]
    rest = [d.where for d in both if d not in aimed]
    if rest:
        in_plan = language.gettext("in plan nothing is tested against a target")
        in_height = language.gettext("in height nothing is tested against a target")
        clauses.append(in_plan if rest[0] == "plan" else in_height)
    if doubted:
        return "attention", language.clauses([*clauses, str(assumed)]) + "."
    return "good" if least >= MINIMUM_POINTS else "few", language.clauses(clauses) + "."


def _missed(direction: Direction, language: Language) -> str:
    target = length(direction.target_m, language)
    measured = language.gettext("RMSE {length}", length=length(direction.fit_m, language))
    if direction.is_stated:
        measured += f", {_with_survey(length(direction.together_m, language), language)}"
    if direction.where == "plan":
        return language.gettext("in plan ({measured}, target {target})", measured=measured, target=target)
    return language.gettext("in height ({measured}, target {target})", measured=measured, target=target)


def _with_survey(sums: str, language: Language) -> str:
    """Return what is said of RMSE_H and RMSE_V, beside what was measured."""
    return language.gettext("{sums} together with their survey (ASPRS)", sums=sums)


def _met(aimed: Sequence[Direction], at_points: str, doubted: bool, language: Language) -> str:
    """Return that targets are met; ``doubted`` where the accuracy of the survey of check points is only assumed."""
    if len(aimed) == 2:
        met = language.gettext("Meets its targets {at_points}", at_points=at_points)
        within = language.gettext("RMSE within its targets {at_points}", at_points=at_points)
    elif aimed[0].where == "plan":
        met = language.gettext("Meets its target in plan {at_points}", at_points=at_points)
        within = language.gettext("RMSE within its target in plan {at_points}", at_points=at_points)
    else:
        met = language.gettext("Meets its target in height {at_points}", at_points=at_points)
        within = language.gettext("RMSE within its target in height {at_points}", at_points=at_points)
    return within if doubted else met


def _without_target(
    tested: Sequence[Direction], assumed: str | None, lights: Sequence[LightRecord], language: Language
) -> tuple[Grade, str]:
    """Judge check points of a survey without a target as their lights do, by the size of a pixel on the ground;
    ``assumed`` says of which the accuracy of the survey is only assumed."""
    errors = language.listed([_in_plan_or_height(d, d.fit_m, language) for d in tested])
    sums = [_in_plan_or_height(d, d.together_m, language) for d in tested if d.is_stated]
    least = _at_points(min(d.n for d in tested), language)
    clauses = [language.gettext("RMSE of {errors} {at_points}", errors=errors, at_points=least)]
    clauses += [_with_survey(language.listed(sums), language)] if sums else []
    clauses += [assumed] if assumed else []
    clauses.append(language.gettext("the project gives no target"))
    subjects = {f"Check points in {d.where}" for d in tested}
    grades = [light["grade"] for light in lights if light["subject"] in subjects]
    grade: Grade = min(grades, key=_WORST_FIRST.index, default="unknown")
    return grade, language.clauses(clauses) + "."


def _predicted(report: SurveyNumbers, language: Language) -> str:
    placing = report["diagnosis"]["placing"]
    if not placing:
        return language.gettext("Accuracy not tested: there are no check points.")
    relative = number(placing["relative_plan_m"]), number(placing["relative_height_m"])
    absolute = number(placing["absolute_plan_m"]), number(placing["absolute_height_m"])
    of_points, in_map = (
        language.gettext(
            "±\u202f{plan} in plan and ±\u202f{height} in height",
            plan=length(plan, language),
            height=length(height, language),
        )
        for plan, height in (relative, absolute)
    )
    if not any(a > FAR_APART * r for r, a in zip(relative, absolute, strict=True)):
        return language.gettext("Accuracy predicted, not tested: {absolute} (1 sigma).", absolute=in_map)
    if is_placed_by_prior(report["gnss"]):
        return language.gettext(
            "Accuracy predicted, not tested: {relative} relative to each other (1 sigma); absolute accuracy is that of "
            "GNSS, which nothing tests: assumed {absolute}.",
            relative=of_points,
            absolute=in_map,
        )
    return language.gettext(
        "Accuracy predicted, not tested: {relative} relative to each other, {absolute} absolute (1 sigma).",
        relative=of_points,
        absolute=in_map,
    )


def _also(lights: Sequence[LightRecord], language: Language) -> str:
    """Return which other lights are red, those of the check points being said already."""
    red = [light["subject"] for light in lights if light["grade"] == "bad"]
    red = [subject for subject in red if not subject.startswith(("Check points", "Adjustment"))]
    subjects = ", ".join(language.gettext(subject).removesuffix("?") for subject in red)
    return language.gettext("Red below: {subjects}.", subjects=subjects) if red else ""


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


def _to_do(asprs: AsprsRecord, warnings: Sequence[WarningRecord], language: Language) -> list[str]:
    """Return the first things to do: the remedies of the gravest warnings, or what the standard still asks for."""
    remedies = [w["remedy"] for w in warnings if w["severity"] != "note" and w["remedy"]]
    remedies = list(dict.fromkeys(remedies))[:MOST_TO_DO]
    least = min(asprs["n_h"], asprs["n_v"])
    if not remedies and 0 < least < MINIMUM_POINTS:
        return [
            language.gettext(
                "nothing; survey {enough} check points for the full statement of the standard ({n} now)",
                enough=MINIMUM_POINTS,
                n=least,
            )
        ]
    return remedies or [language.gettext("nothing")]
