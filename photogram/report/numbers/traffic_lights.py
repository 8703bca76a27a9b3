"""What the figures of a survey are worth, said by rules that stand beside each verdict.

Every rule reads report.json alone; a figure that is not there gives no verdict rather than a good one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from photogram.quality.asprs import MINIMUM_POINTS

Report = Mapping[str, Any]
Grade = Literal["good", "few", "attention", "bad", "unknown"]

AXES = ("easting", "northing", "height")
FEW_POINTS = 5
PLAN_GSD, HEIGHT_GSD = (1.5, 3.0), (2.0, 4.0)
SIGMA0 = (0.7, 1.3, 2.0)
REGISTERED = (0.98, 0.90)
SIGNIFICANT, DOUBTFUL = 0.005, 0.05
GNSS_RATIO = (1.5, 3.0)
REDUNDANCY = (0.3, 0.01)  # of a coordinate that is well controlled, and of one that is not at all
OVERLAP = (0.6, 0.4)
CORRELATION = 0.95


@dataclass(frozen=True)
class Light:
    """What is judged, how, what was found, and the rule that makes it so."""

    subject: str
    grade: Grade
    finding: str
    rule: str


def traffic_lights(report: Report) -> list[Light]:
    """Return the verdicts on a survey, from its report with `asprs` in it."""
    judges: tuple[Callable[[Report], Light], ...] = (
        lambda r: _check(r, "plan"),
        lambda r: _check(r, "height"),
        *([_surface] if report.get("dense") else []),
        _prediction,
        _blunders,
        _control,
        _sigma0,
        _registration,
        _gnss,
        _geometry,
        _converged,
    )
    return [judge(report) for judge in judges]


def number(value: object) -> float:
    """Return a figure of a report, NaN where there is none."""
    return float(value) if isinstance(value, int | float) else math.nan


def _check(report: Report, where: Literal["plan", "height"]) -> Light:
    asprs = report["asprs"]
    letter = "h" if where == "plan" else "v"
    n, rmse = asprs[f"n_{letter}"], number(asprs[f"rmse_{letter}_m"])
    untested = f"no check point{_left_out(report, where)}"
    return _against_target(report, where, f"Check points in {where}", n, rmse, untested)


def _surface(report: Report) -> Light:
    """Judge the dense surface by the check points that it was interpolated at, as those in height are judged."""
    test = report["dense"]["check_points"]
    untested = "too few check points lie on it" if test["n"] else "no check point lies on it"
    return _against_target(
        report, "height", "Dense surface at check points", test["n"], number(test["rmse_v_m"]), untested
    )


def _against_target(
    report: Report, where: Literal["plan", "height"], subject: str, n: int, rmse: float, untested: str
) -> Light:
    """Judge the RMSE, m, of n points in plan or height against the target, or against the GSD where there is none;
    ``untested`` is the reason why there is no RMSE."""
    letter = "h" if where == "plan" else "v"
    target, name = report["asprs"][f"target_rmse_{letter}_m"], f"RMSE_{letter.upper()}"
    if target is not None:
        rule = (
            f"good: {name} within the target of {target:.3f} m, from {MINIMUM_POINTS} points or more; few points: "
            "within it, from fewer; bad: beyond it"
        )
    else:
        best, worst = PLAN_GSD if where == "plan" else HEIGHT_GSD
        rule = (
            f"no target given; good: {name} within {best:g} GSD, from {FEW_POINTS} points or more; few points: the "
            f"same from fewer; attention: within {worst:g} GSD; bad: beyond"
        )
    if not math.isfinite(rmse):
        return Light(subject, "unknown", f"not tested: {untested}", rule)
    finding = f"{name} {rmse:.3f} m, n = {n}"
    if target is not None:
        within = rmse <= target
        grade: Grade = "bad" if not within else "good" if n >= MINIMUM_POINTS else "few"
        return Light(subject, grade, f"{finding}; target {target:.3f} m", rule)
    gsd = number(report["block"].get("gsd_m"))
    if not gsd > 0:
        return Light(subject, "unknown", f"{finding}; no basis for a grade", rule)
    ratio = rmse / gsd
    grade = "bad" if ratio > worst else "attention" if ratio > best else "good" if n >= FEW_POINTS else "few"
    return Light(subject, grade, f"{finding}, {ratio:.1f} GSD", rule)


def _left_out(report: Report, where: str) -> str:
    """Return what leave-one-out says in place of check points."""
    found = report.get("leave_one_out") or {}
    rmse = number(found.get("rmse_h_m" if where == "plan" else "rmse_v_m"))
    if not math.isfinite(rmse):
        return ""
    return f"; {found['n']} control points, each predicted from all others: RMSE {rmse:.3f} m"


def _prediction(report: Report) -> Light:
    rule = (
        f"good: the differences of check points agree with their predicted sigmas (χ², p from {DOUBTFUL:g} to "
        f"{1 - SIGNIFICANT:g}); attention: p from {SIGNIFICANT:g}, or they are smaller than predicted; bad: larger"
    )
    subject, found = "Predicted against achieved", report.get("predicted_against_achieved") or {}
    p = number((found.get("chi2") or {}).get("p"))
    if not math.isfinite(p):
        return Light(subject, "unknown", "not tested: no check points with predicted sigmas", rule)
    grade: Grade = "bad" if p < SIGNIFICANT else "good" if DOUBTFUL <= p <= 1 - SIGNIFICANT else "attention"
    return Light(subject, grade, found.get("sentence") or f"p = {p:.3f}, n = {found.get('n')}", rule)


def _blunders(report: Report) -> Light:
    rule = (
        "good: no observation contradicts all others; attention: GNSS positions or attitudes alone do; bad: a ground "
        "point, a mark or a focal length does (of five hundred surveys without a blunder, one is suspected). "
        "What is named was rejected"
    )
    named, suspects = report.get("blunders") or [], report.get("suspects") or []
    if not named and not suspects:
        return Light("Blunders", "good", "none suspected", rule)
    first = (named or suspects)[0].get("sentence", "")
    more = len(suspects) - 1 if not named else len(named) - 1
    other = f"; and {more} more" if more > 0 else ""
    gnss_only = all(s.get("kind") in ("GNSS position", "attitude") for s in (*named, *suspects))
    return Light("Blunders", "attention" if gnss_only else "bad", f"{first}{other}", rule)


def _control(report: Report) -> Light:
    rule = (
        f"good: every coordinate of a control point shows {REDUNDANCY[0]:.0%} or more of a blunder in its own residual "
        f"(redundancy number); attention: less, only a large blunder is found; bad: {REDUNDANCY[1]:.0%} or less, "
        "none is found"
    )
    shares = [
        (number(r), f"{axis} of {point['name']}", number(mdb))
        for point in report["control_points"]
        for axis, r, mdb in zip(AXES, point.get("redundancy") or [], point.get("mdb_m") or [], strict=False)
        if r is not None
    ]
    if not shares:
        return Light("Are blunders detectable?", "unknown", "no control points", rule)
    least, name, mdb_m = min(shares)
    grade: Grade = "good" if least >= REDUNDANCY[0] else "attention" if least > REDUNDANCY[1] else "bad"
    found = f": one of {mdb_m:.3f} m is found with 80 % probability" if math.isfinite(mdb_m) else ""
    return Light("Are blunders detectable?", grade, f"least redundancy {least:.2f}, {name}{found}", rule)


def _sigma0(report: Report) -> Light:
    low, high, worst = SIGMA0
    rule = (
        f"good: sigma0 to {high:g} (below {low:g} stated sigmas are too large, and predicted ones on the safe side); "
        f"attention: to {worst:g}; bad: above"
    )
    value = number(report["adjustment"]["sigma0"])
    if not math.isfinite(value):
        return Light("Stated sigmas", "unknown", "no redundancy, no sigma0", rule)
    grade: Grade = "bad" if value > worst else "good" if value <= high else "attention"
    said = "stated sigmas too large: predicted sigmas are on the safe side" if value < low else ""
    said = "stated sigmas too small: predicted sigmas are too small as well" if value > high else said
    return Light("Stated sigmas", grade, f"sigma0 {value:.2f}{'; ' if said else ''}{said}", rule)


def _registration(report: Report) -> Light:
    best, worst = REGISTERED
    rule = (
        f"good: {best:.0%} of the photographs or more, in one block; attention: {worst:.0%}, or several blocks; "
        "bad: fewer"
    )
    block = report["block"]
    share, parts = block["registered"] / block["photographs"], len(block["component_sizes"])
    grade: Grade = "bad" if share < worst else "good" if share >= best and parts <= 1 else "attention"
    finding = f"{block['registered']} of {block['photographs']} ({share:.0%})"
    return Light("Photographs oriented", grade, finding + (f", in {parts} separate blocks" if parts > 1 else ""), rule)


def _gnss(report: Report) -> Light:
    best, worst = GNSS_RATIO
    rule = (
        f"good: GNSS residuals within {best:g} of their stated sigmas (RMS of w), no warning; attention: "
        f"within {worst:g}, or a warning; bad: beyond"
    )
    tests = [number(w) ** 2 for p in report["photographs"].values() for w in p.get("gnss_w") or [] if w is not None]
    rms, gnss = report["block"]["gnss_residual_rms_m"], report.get("gnss") or {}
    if rms["three_d"] is None:
        return Light("GNSS", "unknown", "no GNSS positions", rule)
    finding = f"residuals {rms['plan']:.3f} m in plan, {rms['height']:.3f} m in height (RMS)"
    warned = len(gnss.get("warnings") or [])
    if warned:
        finding += f"; {warned} warning{'s' if warned > 1 else ''}"
    if not tests:
        return Light("GNSS", "unknown", f"{finding}; not tested", rule)
    ratio = math.sqrt(sum(tests) / len(tests))
    grade: Grade = "bad" if ratio > worst else "good" if ratio <= best and not warned else "attention"
    return Light("GNSS", grade, f"{finding}; RMS of w {ratio:.1f}", rule)


def focal_height_correlation(diagnosis: Report) -> float:
    """Return the strongest correlation of a focal length with the heights on the ground, NaN where there is none."""
    found = diagnosis.get("focal_height_correlation")
    each = [number(c.get("ground")) for c in found.values()] if isinstance(found, Mapping) else [number(found)]
    known = [value for value in each if math.isfinite(value)]
    return max(known, key=abs) if known else math.nan


def _geometry(report: Report) -> Light:
    best, worst = OVERLAP
    rule = (
        f"good: three photographs or more see {best:.0%} of the ground, no doming, focal length and height "
        f"separable (correlation below {CORRELATION:g}) as given, no pattern in residuals; attention: "
        f"{worst:.0%}, or one of "
        "these; bad: less"
    )
    overlap, diagnosis = report["block"].get("overlap"), report.get("diagnosis") or {}
    if overlap is None:
        return Light("Geometry", "unknown", "the tie points span no area", rule)
    share, faults = number(overlap["share_3_or_more"]), []
    dome, correlation = diagnosis.get("dome") or {}, focal_height_correlation(diagnosis)
    if dome.get("significant"):
        faults.append(f"doming of {number(dome.get('measured_m')):+.3f} m")
    if abs(correlation) > CORRELATION:
        faults.append(f"focal length and heights correlate by {correlation:.2f}")
    decided = [name for name, camera in report["cameras"].items() if camera.get("focal_length")]
    faults += [f"the photographs contradict the given focal length of {name}" for name in decided]
    for name, pattern in (diagnosis.get("residual_pattern") or {}).items():
        if pattern["significant"]:
            faults.append(f"residuals in {name} share a pattern of {pattern['pattern_px']:.2g} px")
    grade: Grade = "bad" if share < worst else "good" if share >= best and not faults else "attention"
    return Light("Geometry", grade, "; ".join([f"{share:.0%} of the ground seen by three or more", *faults]), rule)


def _converged(report: Report) -> Light:
    adjustment = report["adjustment"]
    rule = "good: the adjustment converged; bad: it did not, do not use the result"
    grade: Grade = "good" if adjustment["converged"] else "bad"
    word = "converged" if adjustment["converged"] else "NOT converged"
    return Light("Adjustment", grade, f"{word}, {adjustment['iterations']} iterations", rule)
