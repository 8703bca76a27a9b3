"""photogram plan: the accuracy of a flight before it is flown. Arguments only."""

import re
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

GnssName = Literal["rtk", "consumer", "none"]
LayoutName = Literal["corners", "edges", "grid", "centre"]

_AREA = re.compile(r"(\d+(?:\.\d+)?)\s*[xX×]\s*(\d+(?:\.\d+)?)")


def _area(text: str | None) -> tuple[float, float] | tuple[None, None]:
    if text is None:
        return None, None
    match = _AREA.fullmatch(text.strip())
    if match is None:
        raise typer.BadParameter(f"{text!r}: write two numbers, 200x300 for example", param_hint="--area")
    return float(match[1]), float(match[2])


def _option(text: str, default: str | None = None, metavar: str | None = None) -> Any:  # noqa: ANN401 - Typer's own type
    """Return an option that overrides the plan file; ``default`` is what holds without either."""
    shown = "" if default is None else f" Default: {default}."
    return typer.Option(help=text + shown, show_default=False, metavar=metavar)


def plan(
    file: Annotated[
        Path | None, typer.Argument(help="Plan, flight.yaml; options override it.", show_default=False)
    ] = None,
    area: Annotated[str | None, _option("Site in m, east x north, for example 200x300.", metavar="ExN")] = None,
    gsd: Annotated[float | None, _option("Ground sampling distance in m.", "0.02", "M")] = None,
    height: Annotated[float | None, _option("Flying height above ground in m, instead of --gsd.", metavar="M")] = None,
    forward: Annotated[float | None, _option("Forward overlap, 0 to 1.", "0.8", "SHARE")] = None,
    side: Annotated[float | None, _option("Side overlap, 0 to 1.", "0.7", "SHARE")] = None,
    cross: Annotated[int | None, _option("Cross strips, 1.2 times as high.", "0", "N")] = None,
    oblique: Annotated[int | None, _option("Oblique strips, tilted by 25°.", "0", "N")] = None,
    relief: Annotated[float | None, _option("Relief from valley to hill in m.", "10", "M")] = None,
    gnss: Annotated[GnssName | None, _option("GNSS positions of the photographs.", "rtk")] = None,
    control: Annotated[int | None, _option("Number of control points.", "5", "N")] = None,
    layout: Annotated[LayoutName | None, _option("Layout of the control points.", "corners")] = None,
    changes: Annotated[bool, typer.Option(help="Predict the effect of single changes too.")] = True,
    picture: Annotated[Path | None, _option("Write a map of the predicted standard deviations (PNG).")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Predict the accuracy of a planned flight, and the effect of single changes."""
    width, length = _area(area)
    from photogram.simulation.work.plan import run

    options = {
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
    }
    run(file, options, changes=changes, picture=picture, as_json=as_json)
