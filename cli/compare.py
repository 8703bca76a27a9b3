"""photogram compare: point clouds against a reference."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from photogram.cli.app import app
from photogram.cli.terminal import console
from photogram.comparison import Comparison, triangulate
from photogram.comparison import compare as compare_cloud
from photogram.errors import ProjectError
from photogram.files.atomic import make_folder
from photogram.files.points import read_cloud
from photogram.report.pictures import comparison_picture
from photogram.stages import read_reference
from photogram.survey import PointCloud
from photogram.workspace import write_json

FIGURES: dict[str, Callable[[Comparison], str]] = {
    "points after the filter": lambda c: str(c.cloud_to_surface.points),
    "removed by the filter": lambda c: str(c.removed),
    "height over the surface: mean, m": lambda c: f"{c.cloud_to_surface.mean_m:.4f}",
    "standard deviation, m": lambda c: f"{c.cloud_to_surface.std_m:.4f}",
    "median, m": lambda c: f"{c.cloud_to_surface.median_m:.4f}",
    "NMAD, m": lambda c: f"{c.cloud_to_surface.nmad_m:.4f}",
    "to the nearest point: mean, m": lambda c: f"{c.cloud_to_cloud.mean_m:.4f}",
    "to the nearest point: standard deviation, m": lambda c: f"{c.cloud_to_cloud.std_m:.4f}",
}


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
    given = read_reference(reference)
    surface = triangulate(given) if isinstance(given, PointCloud) else given
    results = {path.stem: compare_cloud(read_cloud(path), surface, sor) for path in clouds}
    table = Table(title=f"Differences from {reference.name}")
    table.add_column("figure")
    for name in results:
        table.add_column(name, justify="right")
    for title, figure in FIGURES.items():
        table.add_row(title, *(figure(result) for result in results.values()))
    console.print(table)
    make_folder(output)
    write_json(
        output / "comparison.json",
        {
            name: {"removed": r.removed, "cloud_to_surface": r.cloud_to_surface, "cloud_to_cloud": r.cloud_to_cloud}
            for name, r in results.items()
        },
    )
    comparison_picture(output / "comparison.png", results)
    console.print(f"Written: {output / 'comparison.json'}, {output / 'comparison.png'}")
