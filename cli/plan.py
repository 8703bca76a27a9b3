"""photogram plan: the accuracy of a flight before it is flown."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, TypeAlias, get_args

import typer
from rich.table import Table

from photogram.cli.app import app
from photogram.cli.terminal import console
from photogram.flight_prediction import Alternative, Prediction, alternatives, predict
from photogram.plan_file import flight_plan, plan_settings
from photogram.planning import RANGES, FlightPlan, Gnss, Layout
from photogram.report.prediction_numbers import prediction_numbers
from photogram.report.prediction_picture import prediction_picture

_AREA = re.compile(r"(\d+(?:\.\d+)?)\s*[xX×]\s*(\d+(?:\.\d+)?)")


def _pair(text: str, option: str) -> tuple[float, float]:
    found = _AREA.fullmatch(text.strip())
    if found is None:
        raise typer.BadParameter(f"{text!r}: write two numbers, 200x300 for example", param_hint=option)
    return float(found[1]), float(found[2])


def _centimetres(value: float) -> str:
    return "–" if not math.isfinite(value) else f"{100 * value:.1f} cm"


def _both(found: Prediction, values: Any) -> str:  # noqa: ANN401 - an array of sigmas
    median, worst = found.typical_m(values)
    return f"{_centimetres(median)}, {_centimetres(worst)} at the worst place"


def _facts(found: Prediction) -> Table:
    plan = found.plan
    table = Table("figure", "value", title="Flight", show_header=False)
    table.add_row("site", f"{plan.width_m:g} × {plan.length_m:g} m, relief {plan.relief_m:g} m")
    table.add_row(
        "ground sampling distance, flying height", f"{_centimetres(plan.ground_sampling_m)}, {plan.height_m:.0f} m"
    )
    table.add_row("photographs, strips", f"{len(found.position_m)}, {found.strips}")
    table.add_row("base, distance of strips", f"{plan.base_m:.1f} m, {plan.strip_distance_m:.1f} m")
    table.add_row(
        "ground covered", f"{found.ground_covered_m2 / 1e4:.1f} ha, {found.covered:.0%} of the site twice or more"
    )
    table.add_row("tie points, observations assumed", f"{found.tie_points}, {found.observations}")
    sigma = plan.gnss_sigmas_m
    table.add_row("GNSS", "none" if sigma is None else f"{plan.gnss}, {', '.join(f'{s:g}' for s in sigma)} m")
    table.add_row("control points", f"{plan.control}")
    return table


def _accuracy(found: Prediction) -> Table:
    table = Table("figure", "value", title="Predicted accuracy (standard deviations)", show_header=False)
    table.add_row("ground points in plan", _both(found, found.plan_sigma_m))
    table.add_row("ground points in height", _both(found, found.sigma_m[:, 2]))
    survey = math.hypot(*found.plan.control_sigma_m[:2]), found.plan.control_sigma_m[2]
    plan, height = (
        math.hypot(found.typical_m(v)[0], s)
        for v, s in ((found.plan_sigma_m, survey[0]), (found.sigma_m[:, 2], survey[1]))
    )
    table.add_row("RMSE to be expected at check points", f"plan {_centimetres(plan)}, height {_centimetres(height)}")
    focal, prior = found.parameter_sigma["focal_px"], found.prior_sigma["focal_px"]
    before = f"{prior:g} px" if math.isfinite(prior) else "free"
    table.add_row("focal length", f"{focal:.2f} px, {before} before" if prior > 0 else "held")
    table.add_row("all heights together", _centimetres(found.mean_height_sigma_m))
    table.add_row(f"dome over {found.radius_m:.0f} m", _centimetres(found.dome_sigma_m))
    if len(found.control_mdb_m):
        worst = found.control_mdb_m.max(axis=0)
        table.add_row(
            "blunder of a control point that shows",
            f"plan {_centimetres(max(worst[:2]))}, height {_centimetres(worst[2])}"
            if all(map(math.isfinite, worst))
            else "none",
        )
    return table


def _changes(found: Prediction, changes: Sequence[Alternative]) -> Table:
    table = Table(
        "change", "photographs", "plan", "height", "worst height", "dome", title="What a single change would bring"
    )
    rows = [("as planned", found), *((c.what, c.prediction) for c in changes)]
    for what, p in rows:
        height, worst = p.typical_m(p.sigma_m[:, 2])
        figures = (p.typical_m(p.plan_sigma_m)[0], height, worst, p.dome_sigma_m)
        table.add_row(what, str(len(p.position_m)), *map(_centimetres, figures))
    return table


def _settings(file: Path | None, given: dict[str, Any]) -> FlightPlan:
    """Return the plan of a file with what the options change."""
    settings = {} if file is None else plan_settings(file)
    for one, other in (("gsd_m", "flying_height_m"), ("flying_height_m", "gsd_m")):
        if given[one] is not None and given[other] is None:
            settings.pop(other, None)
    if given["gnss"] is not None:
        settings.pop("gnss_sigma_m", None)
        settings.pop("gnss_offset_sigma_m", None)
    if given["control_points"] is not None:
        settings.pop("control_world_m", None)
    settings |= {name: value for name, value in given.items() if value is not None}
    return flight_plan(settings, str(file) if file is not None else "photogram plan")


def _given(text: str, field: str | None = None) -> Any:  # noqa: ANN401 - Typer's own type
    """Return an option; its number is in the range of a field of FlightPlan."""
    low, high = (None, None) if field is None else RANGES[field]
    return typer.Option(help=text, show_default=False, min=low, max=high)


def _one_of(text: str | None, allowed: Sequence[str], option: str) -> None:
    if text is not None and text not in allowed:
        raise typer.BadParameter(f"{text!r} is none of {', '.join(allowed)}", param_hint=option)


Number: TypeAlias = float | None
Count: TypeAlias = int | None
Text: TypeAlias = str | None


@app.command()
def plan(
    file: Annotated[
        Path | None, typer.Argument(help="flight.yaml; options change what it says.", show_default=False)
    ] = None,
    area: Annotated[Text, _given("Site in m, east x north: 200x300.")] = None,
    gsd: Annotated[Number, _given("Ground sampling distance in m [0.02].", "gsd_m")] = None,
    height: Annotated[Number, _given("Flying height above ground in m, instead of --gsd.", "flying_height_m")] = None,
    forward: Annotated[Number, _given("Forward overlap [0.8].", "forward_overlap")] = None,
    side: Annotated[Number, _given("Side overlap [0.7].", "side_overlap")] = None,
    cross: Annotated[Count, _given("Cross strips, 1.2 times as high [0].", "cross_strips")] = None,
    oblique: Annotated[Count, _given("Oblique strips, tilted by 25° [0].", "oblique_strips")] = None,
    relief: Annotated[Number, _given("Relief from valley to hill in m [10].", "relief_m")] = None,
    gnss: Annotated[Text, _given("rtk, consumer or none [rtk].")] = None,
    control: Annotated[Count, _given("Number of control points [5].", "control_points")] = None,
    layout: Annotated[Text, _given("Where they lie: corners, edges, grid or centre [corners].")] = None,
    changes: Annotated[bool, typer.Option(help="Try what a single change would bring.")] = True,
    picture: Annotated[Path | None, _given("Write a map of the predicted sigma as PNG.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Predict the accuracy of a flight before flying it, and what would make it better."""
    width, length = (None, None) if area is None else _pair(area, "--area")
    _one_of(gnss, get_args(Gnss), "--gnss")
    _one_of(layout, get_args(Layout), "--layout")
    settled = _settings(
        file,
        {
            "width_m": width,
            "length_m": length,
            "gsd_m": gsd,
            "flying_height_m": height,
            "forward_overlap": forward,
            "side_overlap": side,
            "cross_strips": cross,
            "oblique_strips": oblique,
            "relief_m": relief,
            "gnss": gnss,
            "control_points": control,
            "control_layout": layout,
        },
    )
    found = predict(settled)
    tried = alternatives(settled) if changes else []
    if picture is not None:
        prediction_picture(picture, found, tried)
    if as_json:
        typer.echo(json.dumps(prediction_numbers(found, tried), indent=1, ensure_ascii=False))
        return
    console.print(_facts(found))
    console.print(_accuracy(found))
    for warning in found.warnings:
        console.print(f"[bold]Weak:[/bold] {warning}")
    if tried:
        console.print(_changes(found, tried))
    if picture is not None:
        console.print(f"Written: {picture}")
