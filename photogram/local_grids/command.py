"""photogram calibrate-site: the CRS of a local grid. Arguments only."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from photogram.terminal.fast_checks import check_tables


class Heights(StrEnum):
    """What is estimated of the heights."""

    PLANE = "plane"
    OFFSET = "offset"
    NONE = "none"


class Unit(StrEnum):
    """Units of a local grid."""

    METRE = "m"
    FOOT = "ft"
    US_SURVEY_FOOT = "ftUS"


def calibrate_site(
    pairs: Annotated[
        Path,
        typer.Argument(help="Table (CSV) of points known by GNSS and in the local grid.", show_default=False),
    ],
    output: Annotated[
        Path | None,
        typer.Option(help="File for the CRS of the local grid, .wkt2; default: beside the table.", show_default=False),
    ] = None,
    crs: Annotated[
        str, typer.Option(help="CRS of longitude and latitude, or easting and northing, of the table.")
    ] = "EPSG:4326",
    projection: Annotated[
        str | None,
        typer.Option(
            help="Map that the local grid was derived from; default: a transverse Mercator about the site.",
            show_default=False,
        ),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(help="Fix the scale between grid and map; default: estimated.", show_default=False),
    ] = None,
    heights: Annotated[Heights, typer.Option(help="Inclined plane, its offset alone, or no heights.")] = Heights.PLANE,
    sigma_plan_m: Annotated[
        float | None,
        typer.Option(
            "--sigma-plan-m",
            help="Standard deviation along each axis in plan of pairs that state none, m.",
            show_default=False,
        ),
    ] = None,
    sigma_height_m: Annotated[
        float | None,
        typer.Option(
            "--sigma-height-m", help="Standard deviation in height of pairs that state none, m.", show_default=False
        ),
    ] = None,
    unit: Annotated[Unit, typer.Option(help="Unit of the local coordinates.")] = Unit.METRE,
    name: Annotated[str | None, typer.Option(help="Name of the local grid.", show_default=False)] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a file that is there.")] = False,
) -> None:
    """Calibrate a site (localisation): fit a local grid to points known by GNSS, and write its CRS."""
    check_tables([pairs])
    from photogram.local_grids.site_calibration import calibrate_site as calibrated
    from photogram.local_grids.work import show

    target = output or pairs.with_suffix(".wkt2")
    site = calibrated(
        pairs,
        target,
        crs=crs,
        projection=projection,
        scale=scale,
        heights=heights.value,
        sigma_plan_m=sigma_plan_m,
        sigma_height_m=sigma_height_m,
        unit=unit.value,
        name=name,
        overwrite=overwrite,
    )
    show(site, target)
