"""photogram compare: point clouds against a reference. Arguments only; the work is in `photogram.cli.work`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from photogram.cli.app import app
from photogram.cli.beforehand import check_clouds


@app.command()
def compare(
    clouds: Annotated[
        list[Path], typer.Argument(help="Point clouds: .txt, .csv, .xyz, .las, .laz.", show_default=False)
    ],
    reference: Annotated[
        Path, typer.Option(help="Reference: a surface as GeoTIFF, or a point cloud.", show_default=False)
    ],
    output: Annotated[Path, typer.Option(help="Folder for comparison.json and comparison.png.")] = Path("comparison"),
    sor: Annotated[
        bool, typer.Option(help="First remove statistical outliers (SOR, 6 neighbours, 1 standard deviation).")
    ] = True,
) -> None:
    """Compare point clouds with a reference: height over its surface, and distance to its nearest point."""
    check_clouds([*clouds, reference])
    from photogram.cli.work.compare import run

    run(clouds, reference, output, sor)
