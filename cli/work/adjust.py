"""What `photogram adjust` does."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import typer
from rich.markup import escape

from photogram.errors import PhotogramError
from photogram.files.portable import path_from
from photogram.pipeline.finished_report import prints_of, products_of, removed_products, renewed_prints
from photogram.pipeline.input_validation import checked_project, predicted_costs, tags_of
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.pipeline.precompilation import compiling_early
from photogram.pipeline.stage import Watcher
from photogram.pipeline.stages.publishing.report_files import PAGE, PRINTED, print_report
from photogram.pipeline.store.cluster import cluster
from photogram.pipeline.store.pools import Pool, ProcessPool
from photogram.project.draft.component import earlier_components, write_component
from photogram.project.project import Project
from photogram.report.record.report import Report
from photogram.result_files import within_results
from photogram.sfm.components import FEWEST_PHOTOGRAPHS
from photogram.terminal.console import console
from photogram.terminal.events import EventLines
from photogram.terminal.findings_table import has_errors
from photogram.terminal.output_modes import Voice, voice_of


def say_printed(survey: Project) -> None:
    """Print the report as PDF and say where it is."""
    console.print(f"Printed: {escape(str(print_report(survey)))}", soft_wrap=True)


def _pool(workers: int | None, scheduler: str | None) -> AbstractContextManager[Pool | None]:
    """Return the processes that are asked for, None where the work is done in threads."""
    if scheduler is not None:
        return cluster(scheduler)
    return nullcontext() if workers is None else ProcessPool(workers)


def _adjusted_apart(survey: Project, report: Report, voice: Voice | None) -> Iterator[str]:
    """Adjust each component that nothing ties to the rest as a free network of its own, watched by a ``voice`` where
    there is one, and yield where its report is; one that cannot be is named with the reason, and ends nothing."""
    written = list[Path]()
    for number, (names, tie) in enumerate(
        zip(report["block"]["components"], report["block"]["component_ties"], strict=True), start=1
    ):
        if tie["adjusted"] or len(names) < FEWEST_PHOTOGRAPHS:
            continue
        try:
            written.append(write_component(survey, names, number))
            own = load_project(written[-1])
            with nullcontext(Watcher()) if voice is None else voice.watching({}) as watcher:
                apart = run_pipeline(own, watcher=watcher)
            said = f"component {number}, {len(names)} photographs that nothing ties to the rest, is a free network of "
            said += f"its own: {path_from(Path(), own.results / within_results(PAGE)).as_posix()}"
            if apart is not None and not apart["adjustment"]["converged"]:
                said += ", not converged"
        except PhotogramError as error:
            said = f"component {number}, {len(names)} photographs, cannot be adjusted by itself: {error}"
        yield f"Apart: {said}"
    for path in earlier_components(survey, written):
        yield (
            f"No longer apart: {path.name} and its results are left from an earlier run of this survey: delete them if "
            "you do not need them"
        )


def run(
    project: Path,
    photographs: Path | None,
    *,
    start: str | None,
    until: str | None,
    pdf: bool,
    strict: bool,
    check: bool,
    quiet: bool = False,
    lines: EventLines | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Process a survey and show the essentials of its report; with ``lines`` in events."""
    voice = voice_of(quiet, lines)
    survey = load_project(project, photographs)
    if check:
        checked = checked_project(survey)
        voice.findings(checked.findings, f"Validation of {survey.path}")
        if has_errors(checked.findings):
            raise typer.Exit(1)
    predicted = predicted_costs(survey, checked.tags if check else tags_of(survey), start, until)
    voice.forecast(predicted)
    before, products = prints_of(survey), products_of(survey)
    with compiling_early(), _pool(workers, scheduler) as pool, voice.watching(predicted.seconds_by_stage) as watcher:
        report = run_pipeline(survey, watcher=watcher, start=start, until=until, pool=pool)
    silent = quiet or lines is not None
    if report and pdf and silent:
        print_report(survey)
    renewed = renewed_prints(survey, [name for name in before if not (pdf and name == PRINTED)]) if report else []
    changed = [*renewed, *(removed_products(survey, products) if report else ())]
    if report and until is None:
        changed += _adjusted_apart(survey, report, None if lines is not None else voice)
    if lines is not None:
        for sentence in changed:
            lines.say("warning", sentence)  # every line is an event, and the verdict is the last
    voice.result(survey, report)
    for sentence in () if lines is not None else changed:
        console.print(escape(sentence), soft_wrap=True)
    if report and pdf and not silent:
        say_printed(survey)
    if report and strict and report["blunders"]:
        raise typer.Exit(1)
