"""What `photogram demo` does."""

from __future__ import annotations

from pathlib import Path

from rich.markup import escape

from photogram.cli.early_kernels import compiling_early
from photogram.cli.events import EventLines
from photogram.cli.screen.report_tables import show_judgement, show_report
from photogram.cli.screen.terminal import console
from photogram.cli.screen.voices import say_results, voice_of
from photogram.pipeline.input_validation import predicted_costs, tags_of
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.report.judgement import judge
from photogram.simulation.demonstration import write_demonstration


def run(folder: Path, seed: int, dense: bool, *, quiet: bool = False, lines: EventLines | None = None) -> None:
    """Render the simulated survey, process it, and show how far its result is from the truth; with ``lines`` in
    events."""
    voice = voice_of(quiet, lines)
    with compiling_early():
        with voice.preparing("Simulated survey") as step:
            path = write_demonstration(folder, seed, step, dense=dense)
        survey = load_project(path)
        predicted = predicted_costs(survey, tags_of(survey), test=False)  # a known survey, and people wait
        voice.forecast(predicted)
        with voice.watching(predicted.seconds_by_stage) as watcher:
            report = run_pipeline(survey, watcher=watcher)
    if quiet or lines is not None:
        voice.result(survey, report)
        return
    show_report(report)
    show_judgement(judge(folder, report))
    console.print(f"Project file: {escape(str(path))}", soft_wrap=True)
    say_results(survey)
