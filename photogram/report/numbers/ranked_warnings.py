"""What a reader of a report must not overlook, the gravest first: few sentences, each with what to do.

What is of no consequence stands in its section of the page, not here: a parameter that keeps its stated value, sigmas
that were stated a little off, quantities that change together and cost no heights.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

from photogram.adjustment.reliability import CRITICAL
from photogram.adjustment.solvability import ROTATION_WEAK, ROUGHLY_PLACED
from photogram.languages.language import ENGLISH, Language
from photogram.quality.asprs import MINIMUM_POINTS, STATE_SURVEY
from photogram.quality.datum_precision import WHOLE_BLOCK
from photogram.report.numbers.statistics import GROUPS
from photogram.report.numbers.traffic_lights import number
from photogram.report.record.block import BlockRecord
from photogram.report.record.diagnosis import DiagnosisRecord
from photogram.report.record.ground import VarianceComponentRecord
from photogram.report.record.local_frame import ConstraintRecord, DistanceRecord
from photogram.report.record.report import SurveyNumbers
from photogram.report.record.verdict import AsprsRecord, Severity, WarningRecord
from photogram.wording import percent, uncapitalised

SEVERITIES: tuple[Severity, ...] = ("bad", "attention", "note")

CALIBRATE = ": calibrate the camera"
"""Where in the sentence on a focal length that stays doubtful the remedy begins."""
LOOSE_GSD = 3.0
"""Ground sampling distances, beyond which components lie loosely together."""
MOST_NAMED = 5
"""Blunders, check points and other findings of one kind that are said one by one, at most."""
WRONGLY_STATED = (0.7, 1.3)
"""Sigma factors of a group between which nobody needs to change what was stated."""
GROUP_TITLES: Mapping[str, str] = MappingProxyType(
    {name: group.title for name, group in GROUPS.items()} | {"gnss_offset": "GNSS offsets", "distances": "distances"}
)
"""What a list calls groups of observations; a report of another version may have groups that are not among them."""


def ranked_warnings(report: SurveyNumbers, asprs: AsprsRecord, language: Language = ENGLISH) -> list[WarningRecord]:
    """Return what a reader of these numbers, and of the accuracy by the standard, must not overlook, the gravest
    first; its sentences in English, the remedies in a language."""
    dense = report.get("dense")
    warnings = [
        *_adjustment(report, language),
        *_focal_lengths(report, language),
        *_blunders(report, language),
        *_check_points(asprs, language),
        *_prediction(report, language),
        *_heights(report, language),
        *_geometry(report, language),
        *_several("surface", [] if dense is None else dense["warnings"]),
        *_several("GNSS", report["gnss"]["warnings"]),
        *_masks(report, language),
        *_block(report["block"], language),
        *_stated_sigmas(report["variance_components"], language),
        *_too_few(asprs, language),
    ]
    local = report.get("local_frame")
    if local is not None:
        # of a network without a datum nothing can be said of heights, and nothing is surveyed that could test it
        pointless = [*_heights(report, language), *_too_few(asprs, language)]
        severity: Severity = "note" if local["scale_known"] and local["vertical_sure"] else "attention"
        remedy = language.gettext("give a distance between two marked points or two photographs")
        frame = _warning("local frame", severity, local["sentence"], "" if local["scale_known"] else remedy)
        warnings = [frame, *(w for w in warnings if w not in pointless)]
    warnings += _constraints(report, language)
    return sorted(warnings, key=lambda w: SEVERITIES.index(w["severity"]))


def _warning(part: str, severity: Severity, sentence: str, remedy: str = "") -> WarningRecord:
    return {"part": part, "severity": severity, "sentence": sentence, "remedy": remedy}


def _several(
    part: str, sentences: Sequence[str], severity: Severity = "attention", remedy: str = ""
) -> list[WarningRecord]:
    """Warn of the first sentences of a list, and of how many more there are."""
    warnings = [_warning(part, severity, sentence, remedy) for sentence in sentences[:MOST_NAMED]]
    more = len(sentences) - MOST_NAMED
    return [*warnings, _warning(part, severity, f"and {more} more of this kind")] if more > 0 else warnings


def _masks(report: SurveyNumbers, language: Language) -> list[WarningRecord]:
    masks = report.get("masks")
    sentences = [] if masks is None else [f"the mark of {mark} lies in masked pixels" for mark in masks["marks"]]
    remedy = language.gettext("check the marks that lie in masks, and whether the masks fit")
    return _several("marks", sentences, remedy=remedy)


def _constraints(report: SurveyNumbers, language: Language) -> list[WarningRecord]:
    """Warn of constraints between points that the rest contradicts, those that are checks too; rejected ones are
    blunders, and said there."""
    distances, others = report.get("distances", []), report.get("constraints", [])
    named: list[tuple[str, str | None, DistanceRecord | ConstraintRecord]] = [
        (f"the distance between {' and '.join(d['ends'])}", d.get("role"), d) for d in distances
    ]
    named += [(f"the {d['kind']} {d['name']}", d["role"], d) for d in others]
    sentences = []
    for name, role, d in named:
        tested = number(d.get("z") if role == "check" else d["w"])
        if abs(tested) > CRITICAL:
            against = "the block, which it checks" if role == "check" else "the rest"
            sentences.append(
                f"{name} differs by {number(d['residual_m']):+.4f} m from {against}, {abs(tested):.1f} times its "
                "standard deviation"
            )
    remedy = language.gettext(
        "measure the distances and height differences named in the warnings again, or check the marks of their points"
    )
    return _several("constraints", sentences, "bad", remedy)


def _adjustment(report: SurveyNumbers, language: Language) -> list[WarningRecord]:
    if report["adjustment"]["converged"]:
        return []
    sentence = "the adjustment did not converge: do not use this result"
    remedy = language.gettext("correct what the other warnings name, and run photogram check")
    return [_warning("adjustment", "bad", sentence, remedy)]


def _focal_lengths(report: SurveyNumbers, language: Language) -> list[WarningRecord]:
    warnings = list[WarningRecord]()
    for name, camera in report["cameras"].items():
        sentence, calibrate, more = (camera["focal_length"] or "").partition(CALIBRATE)
        remedy = f"{calibrate}{more}".removeprefix(": ")
        if not remedy:
            remedy = language.gettext("correct focal_px in the project file")
        elif not language.is_english:
            remedy = language.gettext(
                "calibrate the camera, whose focal length is doubtful, as the technical part says"
            )
        warnings += [_warning("calibration", "bad", f"focal length of {name}: {sentence}", remedy)] if sentence else []
    return warnings


def _blunders(report: SurveyNumbers, language: Language) -> list[WarningRecord]:
    decided = any(camera["focal_length"] for camera in report["cameras"].values())
    named = [b for b in report["blunders"] if not (decided and b["kind"] == "focal length")]
    warnings = list[WarningRecord]()
    remedy = language.gettext("check the measurements that were rejected as blunders")
    harmless = ("GNSS position", "attitude")
    warnings += _several("blunders", [b["sentence"] for b in named if b["kind"] not in harmless], "bad", remedy)
    warnings += _several("blunders", [b["sentence"] for b in named if b["kind"] in harmless], "attention", remedy)
    effect = report["blunders_effect"]
    if effect is not None and effect["sentence"]:
        warnings.append(_warning("blunders", "note", effect["sentence"]))
    # what one blunder spreads to its neighbours is suspected too
    suspects = [s for s in report["suspects"] if not named or s["kind"] == "GNSS position"]
    if suspects:
        others = f"; {len(suspects) - 1} more may be effects of it" if len(suspects) > 1 else ""
        severity: Severity = "attention" if all(s["kind"] == "GNSS position" for s in suspects) else "bad"
        first = suspects[0]
        remedy = f"check {first['kind']} {first['name']}, and remove that measurement if it is wrong"
        if not language.is_english:
            remedy = language.gettext(
                "check the measurement of {name}, and remove that measurement if it is wrong", name=first["name"]
            )
        warnings.append(_warning("suspects", severity, f"{first['sentence']}{others}", remedy))
    return warnings


def _heights(report: SurveyNumbers, language: Language) -> list[WarningRecord]:
    heights = report["heights"]
    difference = heights.get("difference")
    if heights["output"] is not None and (difference is None or difference["same"]):
        return []
    remedy = language.gettext("write heights: … in the project file")
    return [_warning("heights", "attention", heights["sentence"], remedy)]


def _check_points(asprs: AsprsRecord, language: Language) -> list[WarningRecord]:
    part, warnings = "check points", list[WarningRecord]()
    if asprs["blunders"]:
        first, count = asprs["blunders"][0], len(asprs["blunders"])
        more = f"; so are {count - 1} more coordinates" if count > 1 else ""
        remedy = language.gettext(
            "check coordinates and marks of these check points, the height system and the control points"
        )
        warnings.append(_warning(part, "bad", f"{first}{more}", remedy))
    if asprs["systematic"]:
        sentence = "; ".join(asprs["systematic"])
        remedy = language.gettext("check datum, height system and control points")
        warnings.append(_warning(part, "attention", sentence, remedy))
    if asprs["survey_assumed"]:
        sentence = f"{asprs['survey_assumed']}: no accuracy by the ASPRS standards is stated"
        warnings.append(_warning(part, "attention", sentence, language.gettext(STATE_SURVEY)))
    remedy = language.gettext("resurvey the check points more accurately")
    return warnings + _several(part, asprs["survey"], remedy=remedy)


def _prediction(report: SurveyNumbers, language: Language) -> list[WarningRecord]:
    test = report["predicted_against_achieved"]
    if test is None or test["consistent"]:
        return []
    larger = test["chi2"]["p"] < 0.5
    remedy = language.gettext("rely on the check points, not the predicted sigmas") if larger else ""
    if any(point["suspect"] for point in report["control_points"] if point["role"] == "check"):
        remedy = language.gettext("check the suspect check points before relying on the accuracy at check points")
    return [_warning("prediction", "bad" if larger else "note", test["sentence"], remedy)]


def best_remedy(diagnosis: DiagnosisRecord) -> str:
    """Return what would help a weak block most, as computed; empty where nothing that was tried helps."""
    helpful = [r for r in diagnosis["remedies"] if r["helps"]]
    if not helpful:
        return ""
    best = min(helpful, key=lambda r: r["sigma_height_after_m"])
    return (
        f"{uncapitalised(best['title'])} would reduce the sigma of heights from {best['sigma_height_before_m']:.3f} to "
        f"{best['sigma_height_after_m']:.3f} m"
    )


def _geometry(report: SurveyNumbers, language: Language) -> list[WarningRecord]:
    diagnosis, cameras = report["diagnosis"], report["cameras"]
    decided = tuple(
        f"The focal length of {name} is known" for name, camera in cameras.items() if camera["focal_length"]
    )
    sentences = [s for s in diagnosis["warnings"] if not (decided and s.startswith(decided))]
    # what the datum leaves open is what most else follows from
    sentences.sort(key=lambda s: not s.startswith((ROUGHLY_PLACED, WHOLE_BLOCK, ROTATION_WEAK)))
    warnings = _several("geometry", sentences)
    if warnings:
        remedy = best_remedy(diagnosis)
        if remedy and not language.is_english:
            remedy = language.gettext("measure more: the technical part predicts the gain for the heights")
        warnings[0]["remedy"] = remedy
    return warnings


def _block(block: BlockRecord, language: Language) -> list[WarningRecord]:
    warnings, missing = list[WarningRecord](), block["photographs"] - block["registered"]
    if missing:
        sentence = f"{missing} of {block['photographs']} photographs are not in the result"
        remedy = language.gettext("see under Discarded why photographs are not in the result")
        warnings.append(_warning("photographs", "attention", sentence, remedy))
    warnings += _components(block, language)
    overlap = block["overlap"]
    if overlap is not None and overlap["share_2_or_more"] < 0.9:
        once = percent(1 - overlap["share_2_or_more"])
        sentence = f"{once} of the ground amid the tie points is seen by fewer than two photographs"
        remedy = language.gettext("fly with more overlap where fewer than two photographs see the ground")
        warnings.append(_warning("photographs", "attention", sentence, remedy))
    return warnings


def _components(block: BlockRecord, language: Language) -> Iterator[WarningRecord]:
    """Yield what is left out because nothing ties it, and how well what is tied without tie points lies together."""
    for lost in (c for c in block["component_ties"] if not c["adjusted"]):
        sentence = (
            f"a component of {lost['photographs']} photographs shares no tie points with the block, and nothing else "
            "ties it: it is not in the result"
        )
        remedy = language.gettext("fly with more overlap between the components, or mark three control points in each")
        yield _warning("photographs", "attention", sentence, remedy)
    for further in block["component_ties"]:
        sigma = further["sigma_to_first_m"]
        if sigma is None:
            continue
        sentence = (
            f"{further['photographs']} photographs share no tie points with the rest and are tied to it by "
            f"{further['placed_by'] or 'control points'}: {_metres(sigma['plan'])} in plan and "
            f"{_metres(sigma['height'])} in height (1 sigma)"
        )
        loose = block["gsd_m"] is not None and max(sigma["plan"], sigma["height"]) > LOOSE_GSD * block["gsd_m"]
        remedy = language.gettext("fly with more overlap between the components, or mark three control points in each")
        yield _warning("photographs", "attention" if loose else "note", sentence, remedy if loose else "")


def _metres(value: float) -> str:
    return f"{value:.3f} m" if value < 1.0 else f"{value:.2f} m"


def _stated(group: VarianceComponentRecord, title: str) -> str:
    stated = number(group["stated_sigma"])
    factor = number(group["sigma_factor"])
    unit = group["unit"]
    if not unit or not math.isfinite(stated):
        return f"{title} ({factor:.2g} times)"
    return f"{title} (stated {stated:.2g} {unit}, found {factor * stated:.2g} {unit})"


def _stated_sigmas(components: dict[str, VarianceComponentRecord], language: Language) -> list[WarningRecord]:
    low, high = WRONGLY_STATED
    small, large = list[str](), list[str]()
    for name, group in components.items():
        if not group["significant"]:
            continue
        text, factor = _stated(group, GROUP_TITLES.get(name, name)), number(group["sigma_factor"])
        small += [text] * (factor > high)
        large += [text] * (factor < low)
    part, warnings = "stated sigmas", list[WarningRecord]()
    if small:
        sentence = f"sigmas stated too small, so predicted ones are too small as well: {', '.join(small)}"
        remedy = language.gettext(
            "look for blunders among the measurements whose sigmas are stated too small, or state larger sigmas"
        )
        warnings.append(_warning(part, "attention", sentence, remedy))
    if large:
        sentence = f"sigmas stated too large, so predicted ones are on the safe side: {', '.join(large)}"
        warnings.append(_warning(part, "note", sentence))
    return warnings


def _too_few(asprs: AsprsRecord, language: Language) -> list[WarningRecord]:
    n_h, n_v = asprs["n_h"], asprs["n_v"]
    if n_h == n_v == 0:
        sentence = "no check points: the accuracy is predicted, not tested"
        remedy = language.gettext("survey at least five check points, ideally thirty")
        return [_warning("check points", "attention", sentence, remedy)]
    few = [f"{n} {where}" for n, where in ((n_h, "in plan"), (n_v, "in height")) if n < MINIMUM_POINTS]
    sentence = f"{' and '.join(few)}: the standard requires at least {MINIMUM_POINTS} check points"
    return [_warning("check points", "note", sentence)] if few else []
