"""photogram compare: clouds and surfaces against a reference or an earlier survey. Arguments only."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from photogram.terminal.fast_checks import check_clouds

_CHANGE, _M3C2 = "Two epochs", "M3C2"


def compare(
    clouds: Annotated[
        list[Path],
        typer.Argument(
            help="Point clouds: .txt, .csv, .xyz, .las, .laz; or the later surface: GeoTIFF, LandXML, DXF, or a folder "
            "of results.",
            show_default=False,
        ),
    ],
    reference: Annotated[
        Path,
        typer.Option(
            help="Reference, or the earlier epoch: a surface (as above) or cloud; rim: the ground around each polygon.",
            show_default=False,
        ),
    ],
    output: Annotated[Path, typer.Option(help="Output folder.")] = (Path("comparison")),
    sor: Annotated[
        bool, typer.Option(help="First remove statistical outliers (SOR, 6 neighbours, 1 standard deviation).")
    ] = True,
    method: Annotated[
        Literal["height", "mesh", "m3c2"],
        typer.Option(help="height differences; signed distances to a mesh of the reference; M3C2.", show_default=True),
    ] = "height",
    polygons: Annotated[
        Path | None,
        typer.Option(
            help="Polygons for cut/fill volumes: .gpkg, .geojson; default: everything that both surfaces cover.",
            show_default=False,
            rich_help_panel=_CHANGE,
        ),
    ] = None,
    stable: Annotated[
        Path | None,
        typer.Option(
            help="Polygons of stable ground: the offset between the epochs is reported.",
            show_default=False,
            rich_help_panel=_CHANGE,
        ),
    ] = None,
    coregister: Annotated[
        Literal["offset", "tilt", "rigid"] | None,
        typer.Option(
            help="Apply the co-registration on stable ground: vertical offset, offset and tilt, or rigid "
            "transformation (clouds).",
            show_default=False,
            rich_help_panel=_CHANGE,
        ),
    ] = None,
    sigma: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="Standard deviations of the later epoch, m: random, and systematic (common to all heights); 0 0 of a "
            "design.",
            metavar="RANDOM SYSTEMATIC",
            show_default=False,
            rich_help_panel=_CHANGE,
        ),
    ] = None,
    reference_sigma: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="The same for the earlier epoch.",
            metavar="RANDOM SYSTEMATIC",
            show_default=False,
            rich_help_panel=_CHANGE,
        ),
    ] = None,
    correlation: Annotated[
        float | None,
        typer.Option(
            help="Correlation length of the height errors, m; default: 5 cells, the windows of the matching.",
            show_default=False,
            rich_help_panel=_CHANGE,
        ),
    ] = None,
    polygon_sigma: Annotated[
        float,
        typer.Option(help="Standard deviation of the corners of the polygons, m.", rich_help_panel=_CHANGE),
    ] = 0.0,
    part: Annotated[
        list[str] | None,
        typer.Option(
            help="Surface of a LandXML file, or layer of a DXF, where it has several; may be repeated.",
            metavar="NAME",
            show_default=False,
            rich_help_panel=_CHANGE,
        ),
    ] = None,
    radius: Annotated[
        float | None,
        typer.Option(help="Radius of the cylinder, m; default: 4 spacings.", show_default=False, rich_help_panel=_M3C2),
    ] = None,
    normal_radius: Annotated[
        float | None,
        typer.Option(
            help="Radius for normals, m; default: 2 of the cylinder.", show_default=False, rich_help_panel=_M3C2
        ),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(
            help="Distance of core points, m; default: the radius.", show_default=False, rich_help_panel=_M3C2
        ),
    ] = None,
    max_distance: Annotated[
        float, typer.Option(help="Maximum cylinder depth along the normal, m.", rich_help_panel=_M3C2)
    ] = 10.0,
) -> None:
    """Compare clouds with a reference, or two epochs of a site: differences, what is significant, volumes."""
    check_clouds([*clouds, reference])
    from photogram.change.work.compare import Options, run

    options = Options(
        method, polygons, stable, coregister, sigma, reference_sigma, correlation, polygon_sigma, radius,
        normal_radius, spacing, max_distance, tuple(part or ()),
    )  # fmt: skip
    run(clouds, reference, output, sor, options)
