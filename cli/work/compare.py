"""What `photogram compare` does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from photogram.cli.screen.terminal import console, steps
from photogram.errors import ProjectError
from photogram.files.atomic import make_folder
from photogram.files.clouds.points import read_cloud
from photogram.files.npz_json import write_json
from photogram.pipeline.stages.comparison import read_reference
from photogram.quality.cloud_comparison import Comparison, triangulate
from photogram.quality.cloud_comparison import compare as compare_cloud
from photogram.report.figures.style import comparison_picture
from photogram.survey import PointCloud

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


def run(clouds: list[Path], reference: Path, output: Path, sor: bool) -> None:
    """Compare clouds with a reference; show the figures and write them and a picture of the differences."""
    titles = [path.stem for path in clouds]
    if len(set(titles)) < len(titles):
        raise ProjectError(f"two clouds have the name {max(titles, key=titles.count)!r}: rename one")
    with steps("Comparison") as progress:
        total = len(clouds) + 2
        progress(0, total, f"reading {reference.name}")
        given = read_reference(reference)
        progress(1, total, f"triangulating {reference.name}" if isinstance(given, PointCloud) else "")
        surface = triangulate(given) if isinstance(given, PointCloud) else given
        results = {}
        for number, path in enumerate(clouds, 2):
            progress(number, total, path.name)
            results[path.stem] = compare_cloud(read_cloud(path), surface, sor)
        progress(total, total, "")
    table = Table(title=f"Differences from {escape(reference.name)}")
    table.add_column("figure")
    for name in results:
        table.add_column(escape(name), justify="right")
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
    written = f"{output / 'comparison.json'}, {output / 'comparison.png'}"
    console.print(f"Written: {escape(written)}", soft_wrap=True)
