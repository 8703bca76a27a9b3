"""report.html: one file that holds everything, made from the numbers of report.json and the figures drawn with them.

No script, no request to anywhere: style and pictures stand within the file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from jinja2 import ChainableUndefined, Environment, PackageLoader, Undefined
from markupsafe import Markup

from photogram.report.identity import grouped
from photogram.report.numbers.completion import axis_roles
from photogram.report.numbers.overall import length
from photogram.report.numbers.traffic_lights import AXES, number
from photogram.report.numbers.wording import (
    capitalised,
    css_string,
    matching_settings,
    memory,
    plain,
    probability,
    rich,
    share,
    signed,
    small,
    whole,
)
from photogram.report.numbers.wording import (
    fixed as fixed,
)

Json = dict[str, Any]

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
STAGE_TITLES = {
    "photographs": "Photographs read",
    "features": "Features",
    "pairs": "Pairs",
    "matches": "Matching",
    "tie_points": "Tie points",
    "orientation": "Orientation",
    "transfer": "Tie point transfer",
    "intersection": "Linear intersection",
    "adjustment": "Joint adjustment",
    "dense": "Dense matching",
    "surface": "Surface model",
    "relief": "Terrain and contours",
    "orthophoto": "Orthophoto",
    "comparison": "Comparison",
}
LIBRARY_TITLES = {
    "python": "Python",
    "gtsam": "GTSAM",
    "opencv": "OpenCV",
    "proj": "PROJ",
    "numpy": "NumPy",
    "scipy": "SciPy",
    "numba": "Numba",
}
CLOUD_TITLES = {"linear_2view": "Two views, linear", "linear_3view": "Three views, linear", "adjusted": "Adjusted"}


def templates(undefined: type[Undefined]) -> Environment:
    """Return the templates of pages; ``undefined`` says what becomes of a name that a report does not have."""
    return Environment(
        loader=PackageLoader("photogram.report"),
        autoescape=True,
        undefined=undefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def report_page(report: Mapping[str, Any], figures: Sequence[Mapping[str, str]]) -> str:
    """Return the page of a completed report with its figures, as `page_figures` drew them."""
    environment = templates(ChainableUndefined)
    environment.filters.update(
        fixed=fixed,
        signed=signed,
        share=share,
        whole=whole,
        rich=rich,
        memory=memory,
        plain=plain,
        small=small,
        probability=probability,
        capitalised=capitalised,
        css_string=css_string,
        grouped=grouped,
        sigma_length=length,
        matching_settings=matching_settings,
    )
    environment.globals.update(
        grades=GRADES, axes=AXES, cloud_titles=CLOUD_TITLES, library_titles=LIBRARY_TITLES, page_font=PAGE_FONT
    )
    template = environment.get_template("report.html.jinja")
    control = _ground_rows(report, "control", "left out")
    residuals = [figure for figure in figures if figure["key"].startswith("residuals")]
    return template.render(
        report=report,
        figures={figure["key"]: figure for figure in figures},
        residual_figures=residuals,
        datum=_datum(report),
        control=control,
        predicted_points=[p for p in control if any(row["left_out"] is not None for row in p["rows"])],
        check=_ground_rows(report, "check"),
        marks=_marks(report),
        marks_total=sum(len(p.get("marks") or []) for p in report["control_points"]),
        photographs=_photographs(report),
        calibration=_calibration(report),
        stages=_stages(report),
        surface_checks=_surface_checks(report),
        lights=_lights(report),
        deliverables=_deliverables(report),
    )


# ---- what the tables hold ------------------------------------------------------------------------------------------


def _datum(report: Mapping[str, Any]) -> str:
    """Return the reference system that every coordinate of the page is in."""
    heights = report.get("heights") or {}
    name = (report.get("survey") or {}).get("crs_name")
    grid = f"{report['crs']} ({name})" if name and name != report["crs"] else report["crs"]
    output = heights.get("output")
    if not output:
        return f"{grid}; heights in the undeclared system of the project"
    geoid = f", geoid {heights['geoid']}" if heights.get("geoid") else ""
    return f"{grid}; heights {plain(output)}{geoid}"


def _at(values: object, axis: int) -> object:
    return values[axis] if isinstance(values, list | tuple) and len(values) > axis else None


def _axis_row(point: Mapping[str, Any], axis: int) -> Json:
    difference, sigma = number(_at(point.get("residual_m"), axis)), number(_at(point.get("sigma_m"), axis))
    surveyed = number(_at(point.get("surveyed_sigma_m"), axis))
    z = _at(point.get("z"), axis)
    both = math.hypot(sigma, surveyed)
    return {
        "axis": AXES[axis],
        "role": axis_roles(point)[axis],
        "surveyed": _at(point["surveyed_map_m"], axis),
        "adjusted": _at(point.get("adjusted_map_m"), axis),
        "difference": difference,
        "sigma": sigma,
        "survey_sigma": surveyed,
        "z": difference / both if z is None and both > 0 else z,
        **{
            name: _at(point.get(key), axis)
            for name, key in (
                ("redundancy", "redundancy"),
                ("w", "w"),
                ("mdb", "mdb_m"),
                ("effect", "effect_m"),
                ("left_out", "left_out_m"),
                ("left_out_sigma", "left_out_sigma_m"),
            )
        },
    }


def _ground_rows(report: Mapping[str, Any], *roles: str) -> list[Json]:
    """Return the points that have one of the roles along any axis, each with a row for each axis."""
    points = [p for p in report["control_points"] if set(roles) & set(axis_roles(p))]
    return [
        {
            "name": p["name"],
            "marks": len(p.get("marks") or []),
            "suspect": bool(p.get("suspect")),
            "verdict": p.get("verdict"),
            "p": (p.get("chi2") or {}).get("p") if isinstance(p.get("chi2"), Mapping) else None,
            "rows": [_axis_row(p, k) for k in range(3)],
        }
        for p in points
    ]


def _marks(report: Mapping[str, Any]) -> list[Json]:
    """Return the marks of ground points whose test or residual is largest, largest first."""

    def size(mark: Json) -> float:
        test = [abs(number(w)) for w in mark["w"] or [] if w is not None]
        return max(test) if test else math.hypot(*(number(v) for v in mark["residual_px"]))

    rows = [
        {"point": p["name"], "role": p["role"], **mark}
        for p in report["control_points"]
        for mark in p.get("marks") or []
        if mark.get("residual_px")
    ]
    tested = [row for row in rows if row.get("w")]
    others = [{**row, "w": None} for row in rows if not row.get("w")]
    return [*sorted(tested, key=size, reverse=True), *sorted(others, key=size, reverse=True)][:MAXIMUM_MARKS]


def _surface_checks(report: Mapping[str, Any]) -> list[Json]:
    """Return the check points on the dense surface: all, or those that are furthest off where they are many."""
    rows = ((report.get("dense") or {}).get("check_points") or {}).get("points") or []
    if len(rows) <= MAXIMUM_SURFACE_CHECKS:
        return list(rows)
    return sorted(rows, key=lambda row: -abs(number(row["difference_m"])))[:MAXIMUM_SURFACE_CHECKS]


def _lights(report: Mapping[str, Any]) -> list[Json]:
    """Return the lights of the summary, all that nothing tests as one at the end."""
    lights = [dict(light) for light in report["summary"]]
    dark = [light for light in lights if light["grade"] == "unknown"]
    if len(dark) < 2:
        return lights
    reasons: dict[str, list[str]] = {}
    for light in dark:
        reasons.setdefault(str(light["finding"]).removeprefix("not tested: "), []).append(str(light["subject"]))
    finding = "; ".join(f"{', '.join(subjects)}: {reason}" for reason, subjects in reasons.items())
    one = {
        "subject": f"{len(dark)} of {len(lights)} questions",
        "grade": "unknown",
        "finding": finding,
        "rule": "not tested is not a good grade: it means unknown",
    }
    return [*(light for light in lights if light["grade"] != "unknown"), one]


def _deliverables(report: Mapping[str, Any]) -> Json:
    """Return the files that are listed, and how many pictures there are beside them."""
    listed = report.get("deliverables") or []
    files = [entry for entry in listed if not str(entry["file"]).startswith("pictures/")]
    return {"files": files, "pictures": len(listed) - len(files)}


def _photographs(report: Mapping[str, Any]) -> Json:
    """Return the registered photographs: all, or those with the largest GNSS residuals where they are many."""
    rows = [{"name": name, **p} for name, p in report["photographs"].items() if p.get("registered", True)]
    if len(rows) <= MAXIMUM_PHOTOGRAPHS:
        return {"rows": rows, "total": len(rows)}

    def size(row: Json) -> float:
        residual = row.get("gnss_residual_m")
        return math.hypot(*residual) if residual else -1.0

    return {"rows": sorted(rows, key=size, reverse=True)[:MAXIMUM_PHOTOGRAPHS], "total": len(rows)}


def _calibration(report: Mapping[str, Any]) -> list[Json]:
    """Return the parameters of every camera, and the correlations of those that were estimated."""
    diagnosed = (report.get("diagnosis") or {}).get("cameras") or {}
    return [
        {
            "name": name,
            "camera": camera,
            "rows": _parameters(camera),
            "correlation": _correlation(diagnosed.get(name) or {}),
        }
        for name, camera in report["cameras"].items()
    ]


def _parameters(camera: Mapping[str, Any]) -> list[Json]:
    values = {"focal_px": camera["focal_px"]}
    values |= dict(zip(("cx_px", "cy_px"), camera["principal_point_px"], strict=False))
    values |= dict(zip(("k1", "k2", "k3", "k4"), camera["radial"], strict=False))
    values |= dict(zip(("p1", "p2"), camera["tangential"], strict=False))
    values |= dict(zip(("b1", "b2"), camera.get("affinity") or (), strict=False))
    held, prior = camera.get("held") or {}, camera.get("prior_sigma") or {}
    rows = []
    for name, value in values.items():
        sigma = camera["sigma"].get(name)
        if value == 0 and sigma is None:
            continue  # a parameter that this camera has not
        unit = "px" if name.endswith("_px") or name in {"b1", "b2"} else ""
        rows.append(
            {
                "name": name.removesuffix("_px"),
                "unit": unit,
                "value": value,
                "digits": 3 if unit else 7,
                "sigma": sigma,
                "prior": prior.get(name),
                "why": held.get(name) if sigma is None else None,
            }
        )
    return rows


def _correlation(diagnosed: Mapping[str, Any]) -> Json | None:
    """Return names and a matrix of correlations, each with how strong it is, None where they are not known."""
    matrix, names = diagnosed.get("correlation"), diagnosed.get("parameters")
    names = list(names) if names else None
    if isinstance(matrix, Mapping):
        names = list(matrix)
        matrix = [[row.get(n) for n in names] if isinstance(row, Mapping) else row for row in matrix.values()]
    if not matrix or not names:
        return None

    def grade(value: object) -> str:
        size = abs(number(value))
        return "very-strong" if size > VERY_STRONG else "strong" if size > STRONG else "weak"

    rows = [
        {"name": name.removesuffix("_px"), "cells": [{"value": v, "grade": grade(v)} for v in row[: i + 1]]}
        for i, (name, row) in enumerate(zip(names, matrix, strict=True))
    ]
    return {"names": [name.removesuffix("_px") for name in names], "rows": rows}


def _stages(report: Mapping[str, Any]) -> list[Json]:
    peak = report.get("peak_memory_bytes") or {}
    return [
        {"title": STAGE_TITLES.get(name, name.replace("_", " ")), "seconds": seconds, "bytes": peak.get(name)}
        for name, seconds in report["seconds"].items()
    ]
