"""What `photogram plan` does."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import typer
from rich.markup import escape
from rich.table import Table

from photogram.arrays import FloatArray
from photogram.simulation.planning.figures import prediction_picture
from photogram.simulation.planning.flight_file import PlanOptions, flight_plan
from photogram.simulation.planning.flight_plan import RANGES
from photogram.simulation.planning.numbers import prediction_numbers
from photogram.simulation.planning.prediction import Alternative, Prediction, alternatives, predict_accuracy
from photogram.terminal.console import console, errors, steps
from photogram.wording import percent


def _centimetres(value: float) -> str:
    return "–" if not math.isfinite(value) else f"{100 * value:.1f} cm"


def _both(prediction: Prediction, values: FloatArray) -> str:
    median, worst = prediction.typical_m(values)
    return f"{_centimetres(median)}, {_centimetres(worst)} at worst"


def _facts(prediction: Prediction) -> Table:
    plan = prediction.plan
    table = Table("figure", "value", title="Flight", show_header=False)
    table.add_row("site", f"{plan.width_m:g} × {plan.length_m:g} m, relief {plan.relief_m:g} m")
    table.add_row(
        "ground sampling distance, flying height", f"{_centimetres(plan.ground_sampling_m)}, {plan.height_m:.0f} m"
    )
    table.add_row("photographs, strips", f"{len(prediction.position_m)}, {prediction.strips}")
    table.add_row("base, distance of strips", f"{plan.base_m:.1f} m, {plan.strip_distance_m:.1f} m")
    table.add_row(
        "ground covered",
        f"{prediction.ground_covered_m2 / 1e4:.1f} ha, {percent(prediction.covered)} of the site twice or more",
    )
    table.add_row("tie points, observations assumed", f"{prediction.tie_points}, {prediction.observations}")
    sigma = plan.gnss_sigmas_m
    table.add_row("GNSS", "none" if sigma is None else f"{plan.gnss}, {', '.join(f'{s:g}' for s in sigma)} m")
    table.add_row("control points", f"{plan.control}")
    return table


def _accuracy(prediction: Prediction) -> Table:
    table = Table("figure", "value", title="Predicted accuracy (standard deviations)", show_header=False)
    table.add_row("ground points in plan", _both(prediction, prediction.plan_sigma_m))
    table.add_row("ground points in height", _both(prediction, prediction.sigma_m[:, 2]))
    survey = math.hypot(*prediction.plan.control_sigma_m[:2]), prediction.plan.control_sigma_m[2]
    plan, height = (
        math.hypot(prediction.typical_m(v)[0], s)
        for v, s in ((prediction.plan_sigma_m, survey[0]), (prediction.sigma_m[:, 2], survey[1]))
    )
    table.add_row("RMSE to be expected at check points", f"plan {_centimetres(plan)}, height {_centimetres(height)}")
    focal, prior = prediction.parameter_sigma["focal_px"], prediction.prior_sigma["focal_px"]
    before = f"{prior:g} px" if math.isfinite(prior) else "free"
    table.add_row("focal length", f"{focal:.2f} px, {before} a priori" if prior > 0 else "fixed")
    table.add_row("all heights together", _centimetres(prediction.mean_height_sigma_m))
    table.add_row(f"dome over {prediction.radius_m:.0f} m", _centimetres(prediction.dome_sigma_m))
    if len(prediction.control_mdb_m):
        worst = prediction.control_mdb_m.max(axis=0)
        table.add_row(
            "smallest detectable blunder of a control point",
            f"plan {_centimetres(max(worst[:2]))}, height {_centimetres(worst[2])}"
            if all(map(math.isfinite, worst))
            else "none",
        )
    return table


def _changes(prediction: Prediction, changes: Sequence[Alternative]) -> Table:
    table = Table("change", "photographs", "plan", "height", "worst height", "dome", title="Effect of single changes")
    rows = [("as planned", prediction), *((c.what, c.prediction) for c in changes)]
    for what, p in rows:
        height, worst = p.typical_m(p.sigma_m[:, 2])
        figures = (p.typical_m(p.plan_sigma_m)[0], height, worst, p.dome_sigma_m)
        table.add_row(what, str(len(p.position_m)), *map(_centimetres, figures))
    return table


_OPTIONS = {
    "width_m": "--area",
    "length_m": "--area",
    "gsd_m": "--gsd",
    "flying_height_m": "--height",
    "forward_overlap": "--forward",
    "side_overlap": "--side",
    "cross_strips": "--cross",
    "oblique_strips": "--oblique",
    "relief_m": "--relief",
    "control_points": "--control",
}


def _check_ranges(given: PlanOptions) -> None:
    """Refuse figures that cannot be. Raises typer.BadParameter."""
    for name, option in _OPTIONS.items():
        value = given.get(name)
        if isinstance(value, int | float) and not RANGES[name].holds(value):
            raise typer.BadParameter(f"{value:g} must be {RANGES[name]}", param_hint=option)


def run(
    file: Path | None,
    options: Mapping[str, float | str | None],
    *,
    changes: bool,
    picture: Path | None,
    as_json: bool,
) -> None:
    """Predict the accuracy of a plan, of a file and of what the ``options`` change in it, and show it: values by the
    names of fields of FlightPlan, None where an option says nothing."""
    given = {name: value for name, value in options.items() if value is not None}
    _check_ranges(given)
    settled = flight_plan(file, given)
    with steps("Prediction", to=errors if as_json else console) as progress:
        progress(0, 0, "the flight as planned")
        prediction = predict_accuracy(settled)
        tried = alternatives(settled, progress) if changes else []
    if picture is not None:
        prediction_picture(picture, prediction, tried)
    if as_json:
        typer.echo(json.dumps(prediction_numbers(prediction, tried), indent=1))
        return
    console.print(_facts(prediction))
    console.print(_accuracy(prediction))
    for warning in prediction.warnings:
        console.print(f"[bold]Weak:[/bold] {escape(warning)}")
    if tried:
        console.print(_changes(prediction, tried))
    if picture is not None:
        console.print(f"Written: {escape(str(picture))}", soft_wrap=True)
