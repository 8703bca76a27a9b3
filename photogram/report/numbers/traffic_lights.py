"""What the figures of a survey are worth, said by rules that stand beside each verdict.

Every rule reads report.json alone; a figure that is not there gives no verdict rather than a good one.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

from photogram.quality.asprs import AXES, MINIMUM_POINTS
from photogram.report.record.diagnosis import DiagnosisRecord
from photogram.report.record.report import SurveyNumbers, oriented
from photogram.report.record.surfaces import DenseRecord
from photogram.report.record.verdict import AsprsRecord, Grade, LightRecord
from photogram.wording import percent

FEW_POINTS = 5
PLAN_GSD, HEIGHT_GSD = (1.5, 3.0), (2.0, 4.0)
SIGMA0 = (0.7, 1.3, 2.0)
REGISTERED = (0.98, 0.90)
SIGNIFICANT, DOUBTFUL = 0.005, 0.05
GNSS_RATIO = (1.5, 3.0)
REDUNDANCY = (0.3, 0.01)  # of a coordinate that is well controlled, and of one that is not at all
OVERLAP = (0.6, 0.4)
CORRELATION = 0.95
ASSUMED_SURVEY = "the accuracy of their survey is only assumed"
"""Said of check points of a product, whose names the accuracy of the triangulation does not know."""


@dataclass(frozen=True)
class Direction:
    """Accuracy in plan or in height by the standard: its ``letter``, ``n`` check points, their RMSE as measured, the
    uncertainty of their survey, both together, and the class that is aimed at, m; None where unknown."""

    where: Literal["plan", "height"]
    letter: Literal["h", "v"]
    n: int
    fit_m: float | None
    survey_m: float | None
    together_m: float | None
    target_m: float | None

    @property
    def is_stated(self) -> bool:
        """Return whether the accuracy of the survey of all these check points is stated."""
        return math.isfinite(number(self.together_m))


def directions(asprs: AsprsRecord) -> tuple[Direction, Direction]:
    """Return the accuracy in plan, and in height."""
    return (
        Direction(
            "plan",
            "h",
            asprs["n_h"],
            asprs["fit_rmse_h_m"],
            asprs["survey_rmse_h_m"],
            asprs["rmse_h_m"],
            asprs["target_rmse_h_m"],
        ),
        Direction(
            "height",
            "v",
            asprs["n_v"],
            asprs["fit_rmse_v_m"],
            asprs["survey_rmse_v_m"],
            asprs["rmse_v_m"],
            asprs["target_rmse_v_m"],
        ),
    )


def _light(subject: str, grade: Grade, finding: str, rule: str) -> LightRecord:
    return {"subject": subject, "grade": grade, "finding": finding, "rule": rule}


def traffic_lights(report: SurveyNumbers, asprs: AsprsRecord) -> list[LightRecord]:
    """Return the verdicts on a survey, from its numbers and its accuracy by the standard."""
    plan, height = directions(asprs)
    dense, assumed = report.get("dense"), asprs["survey_assumed"] or ASSUMED_SURVEY
    return [
        _check(report, plan, assumed),
        _check(report, height, assumed),
        *([] if dense is None else [_surface(report, height, dense, assumed)]),
        _prediction(report),
        _blunders(report),
        _control(report),
        _sigma0(report),
        _registration(report),
        _gnss(report),
        _geometry(report),
        _converged(report),
    ]


def number(value: object) -> float:
    """Return a figure of a report, NaN where there is none."""
    return float(value) if isinstance(value, int | float) else math.nan


def _check(report: SurveyNumbers, tested: Direction, assumed: str) -> LightRecord:
    untested = f"no check point{_left_out(report, tested.where)}"
    return _against_target(report, tested, f"Check points in {tested.where}", untested, assumed)


def _surface(report: SurveyNumbers, height: Direction, dense: DenseRecord, assumed: str) -> LightRecord:
    """Judge the dense surface by the check points that it was interpolated at, as those in height are judged."""
    test = dense["check_points"]
    untested = "too few check points lie on it" if test["n"] else "no check point lies on it"
    of_it = replace(
        height, n=test["n"], fit_m=test["rmse_m"], survey_m=test["survey_rmse_m"], together_m=test["rmse_v_m"]
    )
    return _against_target(report, of_it, "Dense surface at check points", untested, assumed)


def _against_target(report: SurveyNumbers, tested: Direction, subject: str, untested: str, assumed: str) -> LightRecord:
    """Judge what check points say in plan or height: by the standard against the target, or as measured against the
    GSD where there is none. ``untested`` is the reason why there is no RMSE, ``assumed`` says of which points the
    accuracy of the survey is only assumed, where that of any is."""
    n, target, fit = tested.n, tested.target_m, number(tested.fit_m)
    name, together = f"RMSE_{tested.letter.upper()}", number(tested.together_m)
    if target is not None:
        rule = (
            f"good: {name} within the target of {target:.3f} m, from {MINIMUM_POINTS} points or more; few points: "
            f"within it, from fewer; attention: {name}1 is within it, the accuracy of the survey is only assumed; bad: "
            "beyond it"
        )
    else:
        best, worst = PLAN_GSD if tested.where == "plan" else HEIGHT_GSD
        rule = (
            f"no target given; good: {name}1 within {best:g} GSD, from {FEW_POINTS} points or more; few points: the "
            f"same from fewer; attention: within {worst:g} GSD; bad: beyond"
        )
    if not math.isfinite(fit):
        return _light(subject, "unknown", f"not tested: {untested}", rule)
    finding, survey = f"{name}1 {fit:.3f} m, n = {n}", f"; {assumed}"
    if tested.is_stated:
        survey = f"; together with their survey (ASPRS) {name} {together:.3f} m"
    if target is not None:
        within = (together if tested.is_stated else fit) <= target
        met: Grade = "attention" if not tested.is_stated else "good" if n >= MINIMUM_POINTS else "few"
        return _light(subject, met if within else "bad", f"{finding}{survey}; target {target:.3f} m", rule)
    gsd = number(report["block"]["gsd_m"])
    if not gsd > 0:
        return _light(subject, "unknown", f"{finding}{survey}; no basis for a grade", rule)
    ratio = fit / gsd
    grade: Grade = "bad" if ratio > worst else "attention" if ratio > best else "good" if n >= FEW_POINTS else "few"
    return _light(subject, grade, f"{finding}, {ratio:.1f} GSD{survey}", rule)


def _left_out(report: SurveyNumbers, where: str) -> str:
    """Return what leave-one-out says in place of check points."""
    test = report["leave_one_out"]
    rmse = math.nan if test is None else number(test["rmse_h_m"] if where == "plan" else test["rmse_v_m"])
    if test is None or not math.isfinite(rmse):
        return ""
    return f"; {test['n']} control points, each predicted from all others: RMSE {rmse:.3f} m"


def _prediction(report: SurveyNumbers) -> LightRecord:
    rule = (
        f"good: the differences of check points agree with their predicted sigmas (χ², p from {DOUBTFUL:g} to "
        f"{1 - SIGNIFICANT:g}); attention: p from {SIGNIFICANT:g}, or they are smaller than predicted; bad: larger"
    )
    subject, test = "Predicted against achieved", report["predicted_against_achieved"]
    p = math.nan if test is None else number(test["chi2"]["p"])
    if test is None or not math.isfinite(p):
        return _light(subject, "unknown", "not tested: no check points with predicted sigmas", rule)
    grade: Grade = "bad" if p < SIGNIFICANT else "good" if DOUBTFUL <= p <= 1 - SIGNIFICANT else "attention"
    return _light(subject, grade, test["sentence"], rule)


def _blunders(report: SurveyNumbers) -> LightRecord:
    rule = (
        "good: no observation contradicts all others; attention: GNSS positions or attitudes alone do; bad: a ground "
        "point, a mark or a focal length does (of five hundred surveys without a blunder, one is suspected). "
        "What is named was rejected"
    )
    named, suspects = report["blunders"], report["suspects"]
    adjustment = report["adjustment"]
    counts = {"attitudes": adjustment["disbelieved_attitudes"], "headings": adjustment["rejected_headings"]}
    contradicted = "".join(f"; {n} {what} of the gimbal contradict the tie points" for what, n in counts.items() if n)
    if not named and not suspects:
        return _light("Blunders", "attention" if contradicted else "good", f"none suspected{contradicted}", rule)
    sentences = [b["sentence"] for b in named] or [s["sentence"] for s in suspects]
    other = f"; and {len(sentences) - 1} more" if len(sentences) > 1 else ""
    kinds = {b["kind"] for b in named} | {s["kind"] for s in suspects}
    gnss_only = kinds <= {"GNSS position", "attitude"}
    return _light("Blunders", "attention" if gnss_only else "bad", f"{sentences[0]}{other}{contradicted}", rule)


def _control(report: SurveyNumbers) -> LightRecord:
    rule = (
        f"good: every coordinate of a control point shows {percent(REDUNDANCY[0])} or more of a blunder in its own "
        f"residual (redundancy number); attention: less, only a large blunder is found; bad: "
        f"{percent(REDUNDANCY[1])} or less, none is found"
    )
    shares = [
        (number(r), f"{axis} of {point['name']}", number(mdb))
        for point in report["control_points"]
        for axis, r, mdb in zip(AXES, point["redundancy"] or [], point["mdb_m"] or [], strict=False)
        if r is not None
    ]
    if not shares:
        return _light("Are blunders detectable?", "unknown", "no control points", rule)
    least, name, mdb_m = min(shares)
    grade: Grade = "good" if least >= REDUNDANCY[0] else "attention" if least > REDUNDANCY[1] else "bad"
    detectable = f": one of {mdb_m:.3f} m is found with 80 % probability" if math.isfinite(mdb_m) else ""
    return _light("Are blunders detectable?", grade, f"least redundancy {least:.2f}, {name}{detectable}", rule)


def _sigma0(report: SurveyNumbers) -> LightRecord:
    low, high, worst = SIGMA0
    rule = (
        f"good: sigma0 to {high:g} (below {low:g} stated sigmas are too large, and predicted ones on the safe side); "
        f"attention: to {worst:g}; bad: above"
    )
    value = number(report["adjustment"]["sigma0"])
    if not math.isfinite(value):
        return _light("Stated sigmas", "unknown", "no redundancy, no sigma0", rule)
    grade: Grade = "bad" if value > worst else "good" if value <= high else "attention"
    note = "stated sigmas too large: predicted sigmas are on the safe side" if value < low else ""
    note = "stated sigmas too small: predicted sigmas are too small as well" if value > high else note
    return _light("Stated sigmas", grade, f"sigma0 {value:.2f}{'; ' if note else ''}{note}", rule)


def _registration(report: SurveyNumbers) -> LightRecord:
    best, worst = REGISTERED
    rule = (
        f"good: {percent(best)} of the photographs or more, in one block; attention: {percent(worst)}, or several "
        "blocks; bad: fewer"
    )
    block = report["block"]
    share, parts = (
        block["registered"] / block["photographs"],
        1 + sum(not each["adjusted"] for each in block["component_ties"]),
    )
    grade: Grade = "bad" if share < worst else "good" if share >= best and parts <= 1 else "attention"
    finding = f"{block['registered']} of {block['photographs']} ({percent(share)})"
    return _light("Photographs oriented", grade, finding + (f", in {parts} separate blocks" if parts > 1 else ""), rule)


def _gnss(report: SurveyNumbers) -> LightRecord:
    best, worst = GNSS_RATIO
    rule = (
        f"good: GNSS residuals within {best:g} of their stated sigmas (RMS of w), no warning; attention: "
        f"within {worst:g}, or a warning; bad: beyond"
    )
    photographs = oriented(report["photographs"]).values()
    tests = [number(w) ** 2 for p in photographs for w in p["gnss_w"] or [] if w is not None]
    rms = report["block"]["gnss_residual_rms_m"]
    if rms["three_d"] is None:
        return _light("GNSS", "unknown", "no GNSS positions", rule)
    finding = f"residuals {rms['plan']:.3f} m in plan, {rms['height']:.3f} m in height (RMS)"
    warned = len(report["gnss"]["warnings"])
    if warned:
        finding += f"; {warned} warning{'s' if warned > 1 else ''}"
    if not tests:
        return _light("GNSS", "unknown", f"{finding}; not tested", rule)
    ratio = math.sqrt(sum(tests) / len(tests))
    grade: Grade = "bad" if ratio > worst else "good" if ratio <= best and not warned else "attention"
    return _light("GNSS", grade, f"{finding}; RMS of w {ratio:.1f}", rule)


def focal_height_correlation(diagnosis: DiagnosisRecord) -> float:
    """Return the strongest correlation of a focal length with the heights on the ground, NaN where there is none."""
    each = [number(camera["ground"]) for camera in diagnosis["focal_height_correlation"].values()]
    known = [value for value in each if math.isfinite(value)]
    return max(known, key=abs) if known else math.nan


def _geometry(report: SurveyNumbers) -> LightRecord:
    best, worst = OVERLAP
    rule = (
        f"good: three photographs or more see {percent(best)} of the ground, no doming, focal length and height "
        f"separable (correlation below {CORRELATION:g}) as given, no pattern in residuals; attention: "
        f"{percent(worst)}, or one of "
        "these; bad: less"
    )
    overlap, diagnosis = report["block"]["overlap"], report["diagnosis"]
    if overlap is None:
        return _light("Geometry", "unknown", "the tie points span no area", rule)
    share, errors = overlap["share_3_or_more"], list[str]()
    dome, correlation = diagnosis["dome"], focal_height_correlation(diagnosis)
    if dome["significant"]:
        errors.append(f"doming of {number(dome['measured_m']):+.3f} m")
    if abs(correlation) > CORRELATION:
        errors.append(f"focal length and heights correlate by {correlation:.2f}")
    decided = [name for name, camera in report["cameras"].items() if camera["focal_length"]]
    errors += [f"the photographs contradict the given focal length of {name}" for name in decided]
    for name, pattern in diagnosis["residual_pattern"].items():
        if pattern["significant"]:
            errors.append(f"residuals in {name} share a pattern of {pattern['pattern_px']:.2g} px")
    grade: Grade = "bad" if share < worst else "good" if share >= best and not errors else "attention"
    return _light(
        "Geometry", grade, "; ".join([f"{percent(share)} of the ground seen by three or more", *errors]), rule
    )


def _converged(report: SurveyNumbers) -> LightRecord:
    adjustment = report["adjustment"]
    rule = "good: the adjustment converged; bad: it did not, do not use the result"
    grade: Grade = "good" if adjustment["converged"] else "bad"
    word = "converged" if adjustment["converged"] else "NOT converged"
    return _light("Adjustment", grade, f"{word}, {adjustment['iterations']} iterations", rule)
