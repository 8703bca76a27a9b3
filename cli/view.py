"""photogram view: the results in 3-D, as one page for a browser."""

from __future__ import annotations

import webbrowser
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import typer

from photogram.cli.app import app
from photogram.cli.terminal import bars, console
from photogram.errors import PhotogramError, ReportError
from photogram.files.atomic import replacing
from photogram.files.described_points import read_described
from photogram.files.previews import previews
from photogram.page_files import NUMBERS
from photogram.pipeline import load_project
from photogram.report.view_record import ViewRecord, view_record
from photogram.report.viewer import view_page

VIEW = "view.html"
CLOUDS = ("dense.laz", "points_adjusted.laz")
PROJECT = "project.yaml"
DEFAULT_POINTS = 1_500_000
LARGEST_REPORT = 500_000_000
"""Bytes of a report.json: a thousand times that of a survey of 500 photographs."""

Results = Annotated[Path, typer.Argument(help="Folder of results, with report.json.", show_default=False)]
Points = Annotated[int, typer.Option(min=1000, max=20_000_000, help="Show at most so many points, evenly chosen.")]
Cloud = Annotated[
    Path | None, typer.Option(help="Another cloud of the survey: .las or .laz in its map grid.", show_default=False)
]
Photographs = Annotated[
    Path | None,
    typer.Option(
        help="Folder of the photographs, for small pictures of them; without it project.yaml above the results says.",
        show_default=False,
    ),
]
Open = Annotated[bool, typer.Option("--open", help="Open the page in the browser.")]


def _report(folder: Path) -> ViewRecord:
    """Return what the page shows of report.json of a folder of results. Raises ReportError where there is none, or it
    is damaged or something else."""
    if not folder.is_dir():
        raise ReportError(f"{folder}: there is no such folder: name the folder of results of a survey")
    path = folder / NUMBERS
    if not path.is_file():
        below = folder / "results"
        hint = f"say photogram view {below}" if (below / NUMBERS).is_file() else "run photogram adjust first"
        raise ReportError(f"{folder}: no {NUMBERS} in it, this is no folder of results: {hint}")
    try:
        size = path.stat().st_size
        text = path.read_bytes() if size <= LARGEST_REPORT else b""
    except OSError as fault:
        raise ReportError(f"{path}: cannot be read ({fault.strerror}): check the disk and its permissions") from fault
    if size > LARGEST_REPORT:
        raise ReportError(f"{path}: {size / 1e6:.0f} MB are no report of photogram: run photogram adjust again")
    try:
        return view_record(text)
    except ReportError as fault:
        raise ReportError(f"{path}: {fault}: run photogram adjust again") from fault


def _cloud(folder: Path) -> Path:
    found = next((folder / name for name in CLOUDS if (folder / name).is_file()), None)
    if found is None:
        raise ReportError(f"{folder}: no point cloud in it, neither {' nor '.join(CLOUDS)}: run photogram adjust again")
    return found


def _paths(results: Path, names: list[str], folder: Path | None) -> Mapping[str, Path]:
    """Return where photographs lie: in the folder that was named, else where the project above the results has them."""
    if folder is not None:
        if not folder.is_dir():
            raise ReportError(f"{folder}: there is no such folder: name the folder of the photographs")
        return {name: folder / name for name in names if (folder / name).is_file()}
    project = results.absolute().parent / PROJECT
    if not project.is_file():
        return {}
    try:
        survey = load_project(project)
    except PhotogramError as fault:
        console.print(f"No pictures of photographs, {project} cannot be used: {fault}", soft_wrap=True, markup=False)
        return {}
    if survey.results.resolve() != results.resolve():
        return {}
    there = {photograph.name: photograph.path for photograph in survey.photographs}
    return {name: there[name] for name in names if name in there and there[name].is_file()}


def _pictures(results: Path, record: ViewRecord, folder: Path | None) -> Mapping[str, bytes]:
    """Return small pictures of the registered photographs, and say of how many there are none."""
    names = list(record.registered)
    paths = _paths(results, names, folder)
    if not paths:
        console.print("No pictures of photographs: --photographs names their folder", soft_wrap=True)
        return MappingProxyType({})
    with bars() as progress:
        task = progress.add_task("Pictures", total=len(paths), text="")
        made, absent = previews(paths, lambda done, _: progress.update(task, completed=done))
    if len(made) < len(names):
        why = next(iter(absent.values()), "their files are not there")
        said = f"Pictures of {len(made)} of {len(names)} photographs; of the others none: {why}"
        console.print(said, soft_wrap=True, markup=False)
    return made


@app.command()
def view(
    results: Results,
    points: Points = DEFAULT_POINTS,
    cloud: Cloud = None,
    photographs: Photographs = None,
    show: Open = False,
) -> None:
    """Write view.html: cloud, photographs, control and check points in 3-D, in one file that needs no network."""
    record = _report(results)
    path = cloud or _cloud(results)
    points_shown = read_described(path)
    page = view_page(points_shown, record, path.name, points, _pictures(results, record, photographs))
    target = results / VIEW
    with replacing(target) as temporary:
        temporary.write_text(page, encoding="utf-8")
    console.print(f"Written: {target}, {target.stat().st_size / 1e6:.1f} MB", soft_wrap=True)
    if show and not webbrowser.open(target.absolute().as_uri()):
        raise ReportError(f"no browser found to open {target} with: open it yourself")
