"""photogram volume: volumes of polygons of one surface. Arguments only."""

from pathlib import Path
from typing import Annotated

import typer

from photogram.terminal.fast_checks import check_clouds


def volume(
    surface: Annotated[Path, typer.Argument(help="Folder of results, or a surface: GeoTIFF.", show_default=False)],
    polygons: Annotated[Path, typer.Argument(help="Polygons: .gpkg, .geojson.", show_default=False)],
    base: Annotated[
        str,
        typer.Option(help="rim: the ground around each polygon; a height in m; or a surface: GeoTIFF, results."),
    ] = "rim",
    output: Annotated[Path, typer.Option(help="Output folder.")] = (Path("comparison")),
    polygon_sigma: Annotated[float, typer.Option(help="Standard deviation of the corners of the polygons, m.")] = 0.0,
) -> None:
    """Measure the volume of each polygon of a surface, with its standard deviation."""
    check_clouds([surface])
    from photogram.change.work.compare import run_volume

    run_volume(surface, polygons, base, output, polygon_sigma)
