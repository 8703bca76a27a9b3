"""What a report says of itself: accuracy by the standard, verdicts, warnings, and what was discarded.

All of it follows from the other figures of report.json and from what the project asks of the report, so that it can be
made anew whenever that changes.
"""

from collections.abc import Sequence
from typing import Literal, TypeVar

import numpy as np

from photogram.arrays import FloatArray
from photogram.languages.language import ENGLISH, Language
from photogram.quality.asprs import (
    AXES,
    STANDARD,
    ReportSettings,
    asprs_accuracy,
    assumed_survey,
    blunders,
    coarse_survey,
    statement_h,
    statement_v,
    systematic,
)
from photogram.report.identity import report_id
from photogram.report.numbers.dense_surface import is_assumed
from photogram.report.numbers.overall import overall
from photogram.report.numbers.ranked_warnings import ranked_warnings
from photogram.report.numbers.traffic_lights import traffic_lights
from photogram.report.numbers.wording import without_metres
from photogram.report.record.ground import GroundPointRecord
from photogram.report.record.report import Report, SurveyNumbers
from photogram.report.record.verdict import (
    AsprsRecord,
    AxisAccuracyRecord,
    DiscardedRecord,
    NamesRecord,
    ProductAccuracyRecord,
    SurveyRecord,
)
from photogram.report.standards.asprs_statements import asprs_statements
from photogram.report.standards.authorities import standard_record
from photogram.report.titles import CLOUD_TITLES
from photogram.report.values import finite, record_of

ValueT = TypeVar("ValueT")


def complete(numbers: SurveyNumbers | Report, settings: ReportSettings) -> Report:
    """Return the report with its names, and `asprs`, `discarded`, `warnings`, `summary`, `verdict` and `report_id` made
    from its other figures."""
    asprs = asprs_numbers(numbers["control_points"], settings)
    asprs["products"] = product_accuracies(numbers, settings)
    warnings = ranked_warnings(numbers, asprs)
    local = numbers.get("local_frame")
    unscaled = local is not None and not local["scale_known"]
    diagnosis = numbers["diagnosis"]
    if unscaled:
        warnings, diagnosis = _without_metres(warnings), _without_metres(diagnosis)
    lights = traffic_lights(numbers, asprs)
    lights = _without_metres(lights) if unscaled else lights
    whole: Report = {
        **numbers,
        "diagnosis": diagnosis,
        "survey": _survey(numbers["survey"], settings),
        "asprs": asprs,
        "discarded": discarded(numbers),
        "warnings": warnings,
        "summary": lights,
        "verdict": overall(numbers, asprs, lights, warnings),
        "standard": standard_record(settings, numbers["control_points"], asprs),
        "report_id": "",
    }
    whole["report_id"] = report_id(whole)
    return whole


def _survey(survey: SurveyRecord, settings: ReportSettings) -> SurveyRecord:
    former: SurveyRecord = {**survey}
    former.pop("language", None)
    return {**former, **survey_names(settings)}


def survey_names(settings: ReportSettings) -> NamesRecord:
    """Return what the project calls the survey, whose it is, how its ground points were surveyed, and the language of
    the client's part where it is not English."""
    names: NamesRecord = {
        "name": settings.name or None,
        "client": settings.client or None,
        "author": settings.author or None,
        "surveyor": settings.surveyor or None,
        "instrument": settings.instrument or None,
        "targets": settings.targets or None,
        "place": settings.place or None,
    }
    if settings.language != "en":
        names["language"] = settings.language
    return names


def _without_metres(value: ValueT) -> ValueT:
    """Return sentences, at any depth, of a network without scale: what they call metres is in its units."""
    if isinstance(value, str):
        return without_metres(value)  # type: ignore[return-value]
    if isinstance(value, list):
        return [_without_metres(item) for item in value]  # type: ignore[return-value]
    if isinstance(value, dict):
        return {key: _without_metres(item) for key, item in value.items()}  # type: ignore[return-value]
    return value


# ---- accuracy by the standard --------------------------------------------------------------------------------------


def asprs_numbers(
    points: Sequence[GroundPointRecord], settings: ReportSettings, language: Language = ENGLISH
) -> AsprsRecord:
    """Return accuracy and statements of the ASPRS standard from the check points of a report; control points never
    enter here. Why there is no statement, and whose survey is only assumed, is said in a language."""
    rows = [p for p in points if "check" in p["axis_roles"] and p["residual_m"]]
    checked = np.array([[role == "check" for role in p["axis_roles"]] for p in rows], dtype=bool).reshape(-1, 3)
    # None, where an axis has no figure, becomes NaN
    difference_m = np.array([p["residual_m"] for p in rows], dtype=np.float64).reshape(-1, 3)
    difference_m = np.where(checked, difference_m, np.nan)
    sigma_m = np.array([p["surveyed_sigma_m"] for p in rows], dtype=np.float64).reshape(-1, 3)
    sigma_m[is_assumed(rows)] = np.nan
    accuracy, names = asprs_accuracy(difference_m, sigma_m), [p["name"] for p in rows]
    assumed = _assumed_survey(rows, difference_m, language)
    statements, not_stated = asprs_statements(accuracy, assumed, settings, language)
    east, north, height = (record_of(AxisAccuracyRecord, axis) for axis in accuracy.axes)
    return {
        "standard": STANDARD,
        "n_h": accuracy.n_h,
        "n_v": accuracy.n_v,
        "axes": {"easting": east, "northing": north, "height": height},
        "fit_rmse_h_m": finite(accuracy.fit_h_m),
        "fit_rmse_v_m": finite(accuracy.fit_v_m),
        "survey_rmse_h_m": finite(accuracy.survey_h_m),
        "survey_rmse_v_m": finite(accuracy.survey_v_m),
        "survey_assumed": assumed,
        "rmse_h_m": finite(accuracy.rmse_h_m),
        "rmse_v_m": finite(accuracy.rmse_v_m),
        "rmse_3d_m": finite(accuracy.rmse_3d_m),
        "target_rmse_h_m": settings.target_rmse_h_m,
        "target_rmse_v_m": settings.target_rmse_v_m,
        "statements": statements,
        "not_stated": not_stated,
        "blunders": blunders(difference_m, names, settings),
        "systematic": systematic(accuracy, settings),
        "survey": coarse_survey(accuracy, settings),
        "legacy_95": {"horizontal_m": accuracy.legacy_95_h_m, "vertical_m": accuracy.legacy_95_v_m}
        if settings.legacy_95
        else None,
    }


def _assumed_survey(points: Sequence[GroundPointRecord], difference_m: FloatArray, language: Language) -> str | None:
    """Return in words of which points (N), that check by their differences (N, 3), the accuracy of the survey is only
    assumed; None where it is stated of all."""
    tells = np.isfinite(difference_m[:, :2]).all(axis=1) | np.isfinite(difference_m[:, 2])
    names = [points[i]["name"] for i in np.flatnonzero(tells & is_assumed(points)).tolist()]
    return assumed_survey(names, int(tells.sum()), language) if names else None


def product_accuracies(numbers: SurveyNumbers | Report, settings: ReportSettings) -> list[ProductAccuracyRecord]:
    """Return the accuracy of the products themselves at the check points: of the surface model in height, where one was
    matched, and of the orthophoto in plan, where one was made and its targets were looked for. The standard knows
    heights and plan: there is none of products on a plane of their own."""
    products = list[ProductAccuracyRecord]()
    if "plane" in numbers and numbers["plane"]["used"]:
        return products
    dense, orthophoto = numbers.get("dense"), numbers.get("orthophoto")
    if dense is not None:
        heights = dense["check_points"]
        rmse_m = heights["rmse_m"], heights["survey_rmse_m"], heights["rmse_v_m"]
        products.append(_product("dsm.tif", "height", heights["n"], rmse_m, settings.target_rmse_v_m))
    if orthophoto is not None and "check_points" in orthophoto:
        plan = orthophoto["check_points"]
        rmse_m = plan["fit_rmse_h_m"], plan["survey_rmse_h_m"], plan["rmse_h_m"]
        products.append(_product("orthophoto.tif", "plan", plan["n"], rmse_m, settings.target_rmse_h_m))
    return products


def _product(
    product: str,
    where: Literal["plan", "height"],
    n: int,
    rmse_m: tuple[float | None, float | None, float | None],
    target_m: float | None,
) -> ProductAccuracyRecord:
    fit_m, survey_m, together_m = rmse_m
    statement = not_stated = None
    name, letter, stated = ("horizontal", "h", statement_h) if where == "plan" else ("vertical", "v", statement_v)
    if together_m is None and fit_m is not None:
        not_stated = (
            f"No statement of the {name} accuracy of {product}: the accuracy of the survey of its check points is only "
            "assumed; enter it as sigma_m, and remove sigma_assumed."
        )
    elif together_m is None:
        on_it = f"{n} check point{'s' if n != 1 else ''}" if n else "no check points"
        not_stated = f"No statement of the {name} accuracy of {product}: it is tested at {on_it}."
    elif target_m is None:
        not_stated = (
            f"No statement of the {name} accuracy of {product}: it needs an accuracy class; set "
            f"report.target_rmse_{letter}_m."
        )
    else:
        statement = stated(n, together_m, target_m)
        if statement is None:
            not_stated = (
                f"No statement of the {name} accuracy of {product}: its tested RMSE of {together_m:.3f} m (n = {n}) "
                f"does not meet the class of {target_m:.3f} m."
            )
    return {
        "product": product,
        "where": where,
        "n": n,
        "fit_rmse_m": fit_m,
        "survey_rmse_m": survey_m,
        "rmse_m": together_m,
        "target_rmse_m": target_m,
        "statement": statement,
        "not_stated": not_stated,
    }


# ---- what was discarded --------------------------------------------------------------------------------------------


CONTRADICTED = "it contradicts all other observations"


def discarded(report: SurveyNumbers) -> list[DiscardedRecord]:
    """Return what took no part in the result, and why."""
    adjustment, entries = report["adjustment"], list[DiscardedRecord]()

    def add(what: str, count: int, reason: str) -> None:
        if count:
            entries.append({"what": what, "count": count, "reason": reason})

    for name, photograph in report["photographs"].items():
        if not photograph["registered"]:
            add(f"photograph {name}", 1, photograph["reason"])
    add(
        "tie-point observations",
        adjustment["discarded_observations"],
        "rejected as outliers: they disagree with the other rays of their point, or the intersection angle "
        "is too small",
    )
    add("tie points", adjustment["discarded_tie_points"], "fewer than two observations remained")
    for point in report["control_points"]:
        if point["adjusted_map_m"] is None:
            reason = "fewer than two intersecting marks in oriented photographs"
            add(f"{point['role']} point {point['name']}", 1, reason)
        axes = [axis for axis, role in zip(AXES, point["axis_roles"], strict=True) if role == "left out"]
        reason = CONTRADICTED if point["role"] == "control" else "above something else than the results, as it seems"
        add(f"{', '.join(axes)} of {point['role']} point {point['name']}", len(axes), reason)
        for mark in point["marks"]:
            add(f"mark of {point['name']} in {mark['photograph']}", int(mark["left_out"]), CONTRADICTED)
    for entry in report["gnss"]["not_used"]:
        add(f"GNSS position of {entry['photograph']}", 1, entry["reason"])
    add("attitudes of the gimbal", adjustment["disbelieved_attitudes"], "they contradict the tie points")
    reason = "they contradict the tie points; the tilt is used"
    add("headings of the gimbal", adjustment["rejected_headings"], reason)
    for name, cloud in report["clouds"].items():
        reason = "removed by the statistical outlier filter before the comparison"
        add(f"points of the {CLOUD_TITLES.get(name, name)} cloud", cloud.get("removed_by_sor", 0), reason)
    return entries
