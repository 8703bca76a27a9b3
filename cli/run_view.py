"""What `photogram view` does."""

from __future__ import annotations

import webbrowser
from os.path import isdir
from pathlib import Path
from typing import Any

from rich.markup import escape

from photogram.cli.terminal import console, steps
from photogram.errors import ReportError
from photogram.files.atomic import replacing
from photogram.files.described_points import read_described
from photogram.page_files import NUMBERS
from photogram.report.reading import making_of, read_report
from photogram.report.viewer import view_page

VIEW = "view.html"
CLOUDS = ("dense.laz", "points_adjusted.laz")


def _report(folder: Path) -> dict[str, Any]:
    """Return report.json of a folder of results. Raises ReportError where there is none, or where it is damaged or
    something else."""
    if not isdir(folder):
        raise ReportError(f"{folder}: there is no such folder: name the folder of results of a survey")
    path = folder / NUMBERS
    if not path.is_file():
        below = folder / "results"
        hint = f"say photogram view {below}" if (below / NUMBERS).is_file() else "run photogram adjust first"
        raise ReportError(f"{folder}: no {NUMBERS} in it, this is no folder of results: {hint}")
    return read_report(path)


def _cloud(folder: Path) -> Path:
    found = next((folder / name for name in CLOUDS if (folder / name).is_file()), None)
    if found is None:
        raise ReportError(f"{folder}: no point cloud in it, neither {' nor '.join(CLOUDS)}: run photogram adjust again")
    return found


def run(results: Path, points: int, cloud: Path | None, show: bool) -> None:
    """Write the page of a folder of results, and open it if asked for."""
    report = _report(results)
    path = cloud or _cloud(results)
    target = results / VIEW
    with steps("3-D view") as progress:
        progress(0, 3, f"reading {path.name}")
        described = read_described(path)
        progress(1, 3, f"thinning and packing {path.name}")
        with making_of(results / NUMBERS):
            page = view_page(described, report, path.name, points)
        progress(2, 3, f"writing {VIEW}")
        with replacing(target) as temporary:
            temporary.write_text(page, encoding="utf-8")
        progress(3, 3, "")
    console.print(f"Written: {escape(str(target))}, {target.stat().st_size / 1e6:.1f} MB", soft_wrap=True)
    if show and not webbrowser.open(target.absolute().as_uri()):
        raise ReportError(f"no browser found to open {target} with: open it yourself")
