"""What `photogram view` does."""

from __future__ import annotations

import webbrowser
from collections.abc import Mapping
from os.path import isdir
from pathlib import Path
from types import MappingProxyType

from rich.markup import escape

from photogram.cli.screen.terminal import console, steps
from photogram.errors import PhotogramError, ReportError
from photogram.files.atomic import replacing
from photogram.files.clouds.described_points import read_described
from photogram.files.photographs.previews import previews
from photogram.files.reading import read_whole
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.stages.report_files import NUMBERS, VIEW
from photogram.pipeline.store.results_record import recorded
from photogram.report.reading import MOST_BYTES
from photogram.report.view_record import ViewRecord, view_record
from photogram.report.viewer import view_page

PROJECT = "project.yaml"
CLOUDS = ("dense.laz", "points_adjusted.laz")


def _report(folder: Path) -> ViewRecord:
    """Return what the page shows of report.json of a folder of results. Raises ReportError where there is none, or it
    is damaged or something else."""
    if not isdir(folder):
        raise ReportError(f"{folder}: folder not found: give the results folder of a survey")
    path = folder / NUMBERS
    if not path.is_file():
        below = folder / "results"
        hint = f"run photogram view {below}" if (below / NUMBERS).is_file() else "run photogram adjust first"
        raise ReportError(f"{folder}: not a results folder, {NUMBERS} is missing: {hint}")
    try:
        return view_record(read_whole(path, MOST_BYTES))
    except ReportError as fault:
        raise ReportError(f"{path}: {fault}: run photogram adjust again") from fault


def _cloud(folder: Path) -> Path:
    found = next((folder / name for name in CLOUDS if (folder / name).is_file()), None)
    if found is None:
        raise ReportError(f"{folder}: no point cloud found, neither {' nor '.join(CLOUDS)}: run photogram adjust again")
    return found


def _paths(results: Path, names: list[str], folder: Path | None) -> Mapping[str, Path]:
    """Return where photographs lie: in the folder that was named, else where the project above the results has them."""
    if folder is not None:
        if not folder.is_dir():
            raise ReportError(f"{folder}: folder not found: name the folder of the photographs")
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
    with steps("Pictures", len(paths)) as progress:
        made, absent = previews(paths, lambda done, total: progress(done, total, ""))
    if len(made) < len(names):
        why = next(iter(absent.values()), "their files are not there")
        said = f"Pictures of {len(made)} of {len(names)} photographs; of the others none: {why}"
        console.print(said, soft_wrap=True, markup=False)
    return made


def run(results: Path, points: int, cloud: Path | None, photographs: Path | None, show: bool) -> None:
    """Write the page of a folder of results, and open it if asked for."""
    record = _report(results)
    path = cloud or _cloud(results)
    target = results / VIEW
    pictures = _pictures(results, record, photographs)
    with steps("3-D view") as progress:
        progress(0, 3, f"reading {path.name}")
        described = read_described(path)
        progress(1, 3, f"thinning and packing {path.name}")
        page = view_page(described, record, path.name, points, pictures)
        progress(2, 3, f"writing {VIEW}")
        with recorded(results), replacing(target) as temporary:
            temporary.write_text(page, encoding="utf-8")
        progress(3, 3, "")
    console.print(f"Written: {escape(str(target))}, {target.stat().st_size / 1e6:.1f} MB", soft_wrap=True)
    if show and not webbrowser.open(target.absolute().as_uri()):
        raise ReportError(f"no browser found: open {target} yourself")
