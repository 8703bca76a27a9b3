"""photogram compare: point clouds against a reference."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from photogram.cli.app import app
from photogram.cli.terminal import console
from photogram.comparison import compare as compare_cloud
from photogram.errors import ProjectError
from photogram.files.points import read_cloud
from photogram.report.pictures import comparison_picture
from photogram.stages import read_reference
from photogram.workspace import write_json


@app.command()
def compare(
    clouds: Annotated[
        list[Path], typer.Argument(help="Point clouds: .txt, .csv, .xyz, .las, .laz.", show_default=False)
    ],
    reference: Annotated[
        Path, typer.Option(help="The reference: a GeoTIFF surface or a point cloud.", show_default=False)
    ],
    output: Annotated[Path, typer.Option(help="Folder for comparison.json and comparison.png.")] = Path("comparison"),
    sor: Annotated[bool, typer.Option(help="Filter statistical outliers first (6 neighbours, 1 sigma).")] = True,
) -> None:
    """Filter point clouds and compare them with a reference: cloud to cloud, and height over its surface."""
    titles = [path.stem for path in clouds]
    if len(set(titles)) < len(titles):
        raise ProjectError(
            f"two clouds are called {max(titles, key=titles.count)!r}: rename one, the table goes by name"
        )
    surface = read_reference(reference)
    results = {path.stem: compare_cloud(read_cloud(path), surface, sor) for path in clouds}
    table = Table(
        "cloud",
        "points",
        "removed",
        "mean, m",
        "st. dev., m",
        "median, m",
        "NMAD, m",
        "to nearest point: mean, m",
        "st. dev., m",
    )
    for name, result in results.items():
        s, c = result.cloud_to_surface, result.cloud_to_cloud
        figures = [s.mean_m, s.std_m, s.median_m, s.nmad_m, c.mean_m, c.std_m]
        table.add_row(name, str(s.points), str(result.removed), *(f"{x:.4f}" for x in figures))
    console.print(table)
    output.mkdir(parents=True, exist_ok=True)
    write_json(
        output / "comparison.json",
        {
            name: {"removed": r.removed, "cloud_to_surface": r.cloud_to_surface, "cloud_to_cloud": r.cloud_to_cloud}
            for name, r in results.items()
        },
    )
    comparison_picture(output / "comparison.png", results)
    console.print(f"Written: {output / 'comparison.json'}, {output / 'comparison.png'}")
