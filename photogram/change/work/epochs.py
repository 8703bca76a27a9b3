"""What `photogram epochs` does."""

from contextlib import nullcontext
from pathlib import Path

import typer
from rich.markup import escape

from photogram.change.epochs.epochs import adjusted_epochs, compare_epochs, joint_errors, output_of, pairs_of
from photogram.change.work.tables import show_surface_change
from photogram.files.maps.polygon_files import read_polygons
from photogram.files.portable import path_from
from photogram.pipeline.input_validation import checked_project
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.precompilation import compiling_early
from photogram.pipeline.stages.publishing.report_files import PAGE
from photogram.pipeline.store.pools import ProcessPool
from photogram.result_files import within_results
from photogram.terminal.console import bars, console, steps
from photogram.terminal.findings_table import has_errors
from photogram.terminal.output_modes import voice_of
from photogram.terminal.progress import Terminal


def run(project: Path, polygons: Path | None, workers: int | None) -> None:
    """Adjust, make the surfaces, compare them; say where everything is."""
    survey = load_project(project)
    checked = checked_project(survey)
    voice_of(quiet=False, lines=None).findings(checked.findings, f"Validation of {survey.path}")
    if has_errors(checked.findings):
        raise typer.Exit(1)
    if polygons is not None:
        read_polygons(polygons, survey.product_crs)  # for its errors: hours before the volumes are asked for
    pool_of = nullcontext() if workers is None else ProcessPool(workers)
    with compiling_early(), pool_of as pool, bars() as progress:
        made = list(adjusted_epochs(survey, Terminal(progress, {}), pool))
    for name, own in made:
        page = path_from(Path(), own.results / within_results(PAGE)).as_posix()
        console.print(f"Epoch {escape(name)}: {escape(page)}", soft_wrap=True)
    pairs = pairs_of(survey)
    for pair, errors in zip(pairs, joint_errors(survey, pairs), strict=True):
        with steps(f"{pair.later} minus {pair.earlier}") as progress_of_pair:
            change = compare_epochs(survey, pair, errors, polygons, progress_of_pair)
        show_surface_change(change)
        folder = path_from(Path(), output_of(survey, pair)).as_posix()
        console.print(f"Written: {escape(folder)}", soft_wrap=True)
