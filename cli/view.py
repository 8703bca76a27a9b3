"""photogram view: the results in 3-D, as one page for a browser."""

from __future__ import annotations

import json
import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer

from photogram.cli.app import app
from photogram.cli.terminal import console
from photogram.errors import ReportError
from photogram.files.atomic import replacing
from photogram.files.described_points import read_described
from photogram.page_files import NUMBERS
from photogram.report.viewer import view_page
from photogram.results_record import recorded

VIEW = "view.html"
CLOUDS = ("dense.laz", "points_adjusted.laz")
DEFAULT_POINTS = 1_500_000
NEEDED = ("photogram", "crs", "cameras", "photographs", "control_points")
"""Keys of report.json that the page shows."""

Results = Annotated[Path, typer.Argument(help="Folder of results, with report.json.", show_default=False)]
Points = Annotated[int, typer.Option(min=1000, max=20_000_000, help="Show at most so many points, evenly chosen.")]
Cloud = Annotated[
    Path | None, typer.Option(help="Another cloud of the survey: .las or .laz in its map grid.", show_default=False)
]
Open = Annotated[bool, typer.Option("--open", help="Open the page in the browser.")]


def _report(folder: Path) -> dict[str, Any]:
    """Return report.json of a folder of results. Raises ReportError where there is none, or where it is damaged or
    something else."""
    if not folder.is_dir():
        raise ReportError(f"{folder}: there is no such folder: name the folder of results of a survey")
    path = folder / NUMBERS
    if not path.is_file():
        below = folder / "results"
        hint = f"say photogram view {below}" if (below / NUMBERS).is_file() else "run photogram adjust first"
        raise ReportError(f"{folder}: no {NUMBERS} in it, this is no folder of results: {hint}")
    try:
        numbers = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as fault:
        raise ReportError(f"{path}: damaged ({fault}): make it again with photogram adjust") from fault
    missing = [key for key in NEEDED if key not in numbers] if isinstance(numbers, dict) else list(NEEDED)
    if missing:
        raise ReportError(f"{path}: no report of photogram, {missing[0]} is not in it: run photogram adjust again")
    return dict(numbers)


def _cloud(folder: Path) -> Path:
    found = next((folder / name for name in CLOUDS if (folder / name).is_file()), None)
    if found is None:
        raise ReportError(f"{folder}: no point cloud in it, neither {' nor '.join(CLOUDS)}: run photogram adjust again")
    return found


@app.command()
def view(results: Results, points: Points = DEFAULT_POINTS, cloud: Cloud = None, show: Open = False) -> None:
    """Write view.html: cloud, photographs, control and check points in 3-D, in one file that needs no network."""
    report = _report(results)
    path = cloud or _cloud(results)
    page = view_page(read_described(path), report, path.name, points)
    target = results / VIEW
    with recorded(results), replacing(target) as temporary:
        temporary.write_text(page, encoding="utf-8")
    console.print(f"Written: {target}, {target.stat().st_size / 1e6:.1f} MB", soft_wrap=True)
    if show and not webbrowser.open(target.absolute().as_uri()):
        raise ReportError(f"no browser found to open {target} with: open it yourself")
