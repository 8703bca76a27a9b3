"""photogram init: a project file from a folder of photographs. Arguments only."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from photogram.terminal.fast_checks import check_tables

HeightSystemName = Literal["ellipsoidal", "orthometric"]
RoleName = Literal["control", "check"]


def _picture_size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    sides = re.fullmatch(r"\s*([1-9]\d{0,5})\s*[xX×]\s*([1-9]\d{0,5})\s*", text)
    if sides is None:
        raise typer.BadParameter(f"{text!r} is not a size in pixels: write width x height, 4000x3000 for example")
    return int(sides[1]), int(sides[2])


def _focal_lengths(given: Sequence[str]) -> tuple[float | None, dict[str, float]]:
    """Return the focal length without a camera's name, px, None where none is given, and those by name."""
    whole, named = None, dict[str, float]()
    for text in given:
        name, _, number = text.rpartition("=")
        try:
            value = float(number)
        except ValueError:
            raise typer.BadParameter(
                f"{text!r} is no focal length: give pixels, or CAMERA=pixels", param_hint="'--focal-px'"
            ) from None
        if not name and whole is not None:
            raise typer.BadParameter("is given twice: name the cameras, CAMERA=pixels", param_hint="'--focal-px'")
        if name:
            named[name] = value
        else:
            whole = value
    return whole, named


def init(
    photographs: Annotated[Path, typer.Argument(help="Folder of the photographs.", show_default=False)],
    control: Annotated[
        list[Path] | None,
        typer.Option("--control", help="Control points: gcp_list.txt or a table (CSV); may be repeated."),
    ] = None,
    check: Annotated[
        list[Path] | None,
        typer.Option("--check", help="Check points, not used by the adjustment; may be repeated."),
    ] = None,
    marks: Annotated[
        Path | None,
        typer.Option("--marks", help="Image marks of the points: CSV of name, photograph, u, v; PIX4D's; Metashape's."),
    ] = None,
    crs: Annotated[str | None, typer.Option("--crs", help="Map grid, for example EPSG:25832.")] = None,
    project: Annotated[Path, typer.Option("--project", help="Project file to write.")] = Path("project.yaml"),
    picture_size: Annotated[
        str | None,
        typer.Option(
            "--picture-size",
            metavar="WxH",
            help="Size of the pictures in which the marks were measured, for example 4000x3000 (px).",
        ),
    ] = None,
    control_sigma: Annotated[
        float | None,
        typer.Option(
            "--control-sigma", min=1e-4, metavar="M", help="Standard deviation of the ground points' coordinates in m."
        ),
    ] = None,
    heights: Annotated[
        HeightSystemName | None,
        typer.Option("--heights", help="Vertical reference of the ground points' heights."),
    ] = None,
    geoid: Annotated[
        str | None,
        typer.Option("--geoid", help="Geoid of orthometric heights: EGM96, EPSG:5799 or a grid (.gtx, .tif)."),
    ] = None,
    focal_px: Annotated[
        list[str] | None,
        typer.Option(
            "--focal-px",
            metavar="[CAMERA=]PX",
            help="Focal length in px, if the tags do not give it; of several cameras by name, repeated.",
        ),
    ] = None,
    recursive: Annotated[bool, typer.Option("--recursive", help="Search subfolders too.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the project file.")] = False,
) -> None:
    """Write a project file for a folder of photographs: cameras, positions, flights and map grid from their tags."""
    size, (focal, focal_of) = _picture_size(picture_size), _focal_lengths(focal_px or ())
    if heights == "orthometric" and geoid is None and "+" not in (crs or ""):
        raise typer.BadParameter("--heights orthometric needs --geoid: EGM96, EPSG:5799 or the path of a grid")
    check_tables([*(control or ()), *(check or ()), *([] if marks is None else [marks])])
    from photogram.cli.work.init import run
    from photogram.pipeline.new_project import Request

    roles: list[tuple[Path, RoleName]] = [(path, "control") for path in control or ()]
    roles += [(path, "check") for path in check or ()]
    run(
        Request(
            photographs=photographs,
            ground_points=tuple(roles),
            marks=marks,
            crs=crs,
            project=project,
            picture_size_px=size,
            control_sigma_m=control_sigma,
            heights=heights,
            geoid=geoid,
            focal_px=focal,
            recursive=recursive,
            force=force,
            focal_px_of=focal_of,
        )
    )
