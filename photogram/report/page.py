"""report.html: one file that holds everything, made from the numbers of report.json and the figures drawn with them.

No script, no request to anywhere: style and pictures stand within the file.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cache, partial
from types import MappingProxyType

from jinja2 import ChainableUndefined, Environment, PackageLoader, Undefined
from markupsafe import Markup

from photogram.languages.language import Language
from photogram.projection import CAMERA_PARAMETERS
from photogram.quality.asprs import AXES
from photogram.report.client.contents import client_part
from photogram.report.client.measurements import MOST_ROWS, measurement_rows, measurement_sentences
from photogram.report.client.volumes import reason_in, volume_rows, volume_sentences
from photogram.report.figures.mark_patches import figure_key
from photogram.report.identity import grouped
from photogram.report.marks import point_marks
from photogram.report.numbers.overall import length
from photogram.report.numbers.traffic_lights import number
from photogram.report.numbers.wording import FILTERS
from photogram.report.record.block import CameraRecord
from photogram.report.record.diagnosis import CalibrationRecord
from photogram.report.record.ground import GroundPointRecord, MarkRecord
from photogram.report.record.photographs import OrientedPhotograph
from photogram.report.record.positions import is_placed_by_prior
from photogram.report.record.report import Report, oriented
from photogram.report.record.surfaces import SurfacePointRecord
from photogram.report.record.verdict import LightRecord
from photogram.report.titles import CLOUD_TITLES
from photogram.result_files import is_picture
from photogram.results import SIGMA_TITLES

Row = dict[str, object]
"""What a table of the page shows in one row, by the names that the template uses."""

GRADES = {
    "good": ("●", "Good"),
    "few": ("◆", "Good, few points"),
    "attention": ("▲", "Attention"),
    "bad": ("■", "Bad"),
    "unknown": ("○", "Not tested"),
}
PAGE_FONT = Markup('"Source Sans 3", "Segoe UI", "Helvetica Neue", Arial, "Liberation Sans", sans-serif')
MAXIMUM_PHOTOGRAPHS = 60
MAXIMUM_MARKS = 40
MAXIMUM_SURFACE_CHECKS = 20
STRONG, VERY_STRONG = 0.8, 0.95
LIBRARY_TITLES = {
    "python": "Python",
    "gtsam": "GTSAM",
    "opencv": "OpenCV",
    "proj": "PROJ",
    "numpy": "NumPy",
    "scipy": "SciPy",
    "numba": "Numba",
}


def templates(undefined: type[Undefined]) -> Environment:
    """Return the templates of pages; ``undefined`` says what becomes of a name that a report does not have."""
    return Environment(
        loader=PackageLoader("photogram.report"),
        autoescape=True,
        undefined=undefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


@cache
def _environment() -> Environment:
    """Return the templates of the page with all that they call: they are compiled once, however many pages are made."""
    environment = templates(ChainableUndefined)
    environment.filters.update(FILTERS, grouped=grouped, sigma_length=length)
    environment.globals.update(
        grades=GRADES,
        axes=AXES,
        cloud_titles=CLOUD_TITLES,
        sigma_titles=SIGMA_TITLES,
        library_titles=LIBRARY_TITLES,
        page_font=PAGE_FONT,
        reason_in=reason_in,
        sigma_length=length,
    )
    return environment


def report_page(
    report: Report, figures: Sequence[Mapping[str, str]], stage_titles: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Return the page of a completed report with its figures, as `page_figures` drew them; a stage is called by its
    name where it has no title."""
    template = _environment().get_template("report.html.jinja")
    control = _ground_rows(report, "control", "left out")
    language = Language(report["survey"].get("language", "en"))
    residuals = [figure for figure in figures if figure["key"].startswith("residuals")]
    return template.render(
        report=report,
        language=language,
        gettext=partial(_said, language),
        ngettext=partial(_counted, language),
        client=client_part(report, language),
        volume_rows=volume_rows(report),
        volume_sentences=volume_sentences(report),
        measurement_rows=measurement_rows(report, whole=True),
        measurement_sentences=measurement_sentences(report),
        most_measurements=MOST_ROWS,
        figures={figure["key"]: figure for figure in figures},
        residual_figures=residuals,
        datum=_datum(report),
        placed_by_prior=is_placed_by_prior(report["gnss"]),
        control=control,
        predicted_points=[row for row in control if row["predicted"]],
        check=_ground_rows(report, "check"),
        marks=_marks(report),
        marked_points=_marked_points(report, {figure["key"]: figure for figure in figures}),
        marks_total=sum(len(p["marks"]) for p in report["control_points"]),
        photographs=_photographs(report),
        calibration=_calibration(report),
        stages=_stages(report, stage_titles),
        surface_checks=_surface_checks(report),
        lights=_lights(report),
        deliverables=_deliverables(report),
    )


def _said(language: Language, message: str, **values: object) -> Markup:
    """Return a message for a template; values that hold marks of HTML are shown, not obeyed."""
    return Markup(language.message(message)).format(**values)


def _counted(language: Language, one: str, several: str, count: int, **values: object) -> Markup:
    """Return a message for a template in the form that goes with a count, which is its placeholder ``n``."""
    return Markup(language.counted_message(one, several, count)).format(n=count, **values)


# ---- what the tables hold ------------------------------------------------------------------------------------------


def _datum(report: Report) -> str:
    """Return the reference system that every coordinate of the page is in."""
    heights, name = report["heights"], report["survey"]["crs_name"]
    grid = f"{report['crs']} ({name})" if name and name != report["crs"] else report["crs"]
    if not heights["output"]:
        return f"{grid}; heights in the undeclared system of the project"
    geoid = f", geoid {heights['geoid']}" if heights["geoid"] else ""
    return f"{grid}; heights {heights['output']}{geoid}"


def _at(values: Sequence[float | None] | Sequence[float] | None, axis: int) -> float | None:
    return None if values is None else values[axis]


def _axis_row(point: GroundPointRecord, axis: int) -> Row:
    difference, sigma = number(_at(point["residual_m"], axis)), number(_at(point["sigma_m"], axis))
    surveyed = number(point["surveyed_sigma_m"][axis])
    z = _at(point["z"], axis)
    both = math.hypot(sigma, surveyed)
    return {
        "axis": AXES[axis],
        "role": point["axis_roles"][axis],
        "surveyed": point["surveyed_map_m"][axis],
        "adjusted": _at(point["adjusted_map_m"], axis),
        "difference": difference,
        "sigma": sigma,
        "survey_sigma": surveyed,
        "z": difference / both if z is None and both > 0 else z,
        "redundancy": _at(point["redundancy"], axis),
        "w": _at(point["w"], axis),
        "mdb": _at(point["mdb_m"], axis),
        "effect": _at(point["effect_m"], axis),
        "left_out": _at(point["left_out_m"], axis),
        "left_out_sigma": _at(point["left_out_sigma_m"], axis),
    }


def _ground_rows(report: Report, *roles: str) -> list[Row]:
    """Return the points that have one of the roles along any axis, each with a row for each axis."""
    points = [p for p in report["control_points"] if set(roles) & set(p["axis_roles"])]
    return [
        {
            "name": p["name"],
            "marks": len(p["marks"]),
            "suspect": bool(p["suspect"]),
            "survey_assumed": p.get("surveyed_sigma_assumed", False),
            "verdict": p["verdict"],
            "p": p["chi2"]["p"] if p["chi2"] else None,
            "predicted": p["left_out_m"] is not None,
            "rows": [_axis_row(p, k) for k in range(3)],
        }
        for p in points
    ]


def _marks(report: Report) -> list[Row]:
    """Return the marks of ground points whose test or residual is largest, largest first."""

    def size(entry: tuple[GroundPointRecord, MarkRecord]) -> tuple[bool, float]:
        _, mark = entry
        test = [abs(w) for w in mark["w"] or [] if w is not None]
        return mark["w"] is not None, max(test) if test else math.hypot(*mark["residual_px"] or [])

    marks = [(point, mark) for point in report["control_points"] for mark in point["marks"] if mark["residual_px"]]
    largest = sorted(marks, key=size, reverse=True)[:MAXIMUM_MARKS]
    return [{"point": point["name"], "role": point["role"], **mark} for point, mark in largest]


def _marked_points(report: Report, figures: Mapping[str, Mapping[str, str]]) -> list[Row]:
    """Return the marks of each ground point in short, with the picture of them where there is one."""
    points = point_marks(report["control_points"])
    return [{"marks": marks, "figure": figures.get(figure_key(marks.name))} for marks in points]


def _surface_checks(report: Report) -> list[SurfacePointRecord]:
    """Return the check points on the dense surface: all, or those that are furthest off where they are many."""
    dense = report.get("dense")
    rows = [] if dense is None else dense["check_points"]["points"]
    if len(rows) <= MAXIMUM_SURFACE_CHECKS:
        return rows
    return sorted(rows, key=lambda row: -abs(row["difference_m"]))[:MAXIMUM_SURFACE_CHECKS]


def _lights(report: Report) -> list[LightRecord]:
    """Return the lights of the summary, all that nothing tests as one at the end."""
    lights = report["summary"]
    dark = [light for light in lights if light["grade"] == "unknown"]
    if len(dark) < 2:
        return lights
    reasons: dict[str, list[str]] = {}
    for light in dark:
        reasons.setdefault(light["finding"].removeprefix("not tested: "), []).append(light["subject"])
    finding = "; ".join(f"{', '.join(subjects)}: {reason}" for reason, subjects in reasons.items())
    one: LightRecord = {
        "subject": f"{len(dark)} of {len(lights)} questions",
        "grade": "unknown",
        "finding": finding,
        "rule": "not tested is not a good grade: it means unknown",
    }
    return [*(light for light in lights if light["grade"] != "unknown"), one]


def _deliverables(report: Report) -> Row:
    """Return the files that are listed, and how many pictures there are beside them."""
    listed = report["deliverables"]
    files = [entry for entry in listed if not is_picture(entry["file"])]
    return {"files": files, "pictures": len(listed) - len(files)}


def _photographs(report: Report) -> Row:
    """Return the registered photographs: all, or those with the largest GNSS residuals where they are many."""

    def size(entry: tuple[str, OrientedPhotograph]) -> float:
        residual = entry[1]["gnss_residual_m"]
        return math.hypot(*residual) if residual else -1.0

    entries = list(oriented(report["photographs"]).items())
    total = len(entries)
    if total > MAXIMUM_PHOTOGRAPHS:
        entries = sorted(entries, key=size, reverse=True)[:MAXIMUM_PHOTOGRAPHS]
    return {"rows": [{"name": name, **photograph} for name, photograph in entries], "total": total}


def _calibration(report: Report) -> list[Row]:
    """Return the parameters of every camera, and the correlations of those that were estimated."""
    diagnosed = report["diagnosis"]["cameras"]
    return [
        {
            "name": name,
            "camera": camera,
            "rows": _parameters(camera),
            "correlation": _correlation(diagnosed[name]) if name in diagnosed else None,
        }
        for name, camera in report["cameras"].items()
    ]


def _parameters(camera: CameraRecord) -> list[Row]:
    fixed, prior = camera["held"], camera["prior_sigma"]
    values = {
        "focal_px": [camera["focal_px"]],
        "principal_point_px": camera["principal_point_px"],
        "radial": camera["radial"],
        "tangential": camera["tangential"],
        "affinity": camera["affinity"],
        "readout_s": [camera.get("readout_s", 0.0)],
    }
    rows = list[Row]()
    for p in CAMERA_PARAMETERS:
        place = p.place or 0
        if place >= len(values[p.key]):
            continue  # a report of an earlier version
        value = values[p.key][place]
        sigma = camera["sigma"].get(p.name)
        if value == 0 and sigma is None and p.name not in fixed:
            continue  # a parameter that this camera has not
        rows.append(
            {
                "name": p.name.removesuffix("_px"),
                "unit": p.unit,
                "value": value,
                "digits": p.digits,
                "sigma": sigma,
                "prior": prior.get(p.name),
                "why": fixed.get(p.name) if sigma is None else None,
            }
        )
    return rows


def _correlation(diagnosed: CalibrationRecord) -> Row | None:
    """Return names and a matrix of correlations, each with how strong it is, None where nothing was estimated."""
    matrix, names = diagnosed["correlation"], diagnosed["parameters"]
    if not names:
        return None

    def grade(value: object) -> str:
        size = abs(number(value))
        return "very-strong" if size > VERY_STRONG else "strong" if size > STRONG else "weak"

    rows = [
        {"name": name.removesuffix("_px"), "cells": [{"value": v, "grade": grade(v)} for v in row[: i + 1]]}
        for i, (name, row) in enumerate(zip(names, matrix, strict=True))
    ]
    return {"names": [name.removesuffix("_px") for name in names], "rows": rows}


def _stages(report: Report, titles: Mapping[str, str]) -> list[Row]:
    peak = report["peak_memory_bytes"]
    return [
        {"title": titles.get(name, name.replace("_", " ")), "seconds": seconds, "bytes": peak.get(name)}
        for name, seconds in report["seconds"].items()
    ]
