"""What `photogram demo` does."""

from __future__ import annotations

from pathlib import Path

from rich.markup import escape

from photogram.cli.screen.report_tables import show_judgement, show_report
from photogram.cli.screen.terminal import bars, console
from photogram.cli.screen.watching import Terminal, stage_weights
from photogram.cli.work.adjust import say_results
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.report.judgement import judge
from photogram.simulation.demonstration import write_demonstration


def run(folder: Path, seed: int, dense: bool) -> None:
    """Render the simulated survey, process it, and show how far its result is from the truth."""
    with bars() as progress:
        task = progress.add_task("Simulated survey", total=None, text="")
        path = write_demonstration(
            folder,
            seed,
            lambda done, total, text: progress.update(task, completed=done, total=total, text=text),
            dense=dense,
        )
        progress.remove_task(task)
        survey = load_project(path)
        report = run_pipeline(survey, watcher=Terminal(progress, stage_weights(survey)))
    if report is not None:
        show_report(report)
        show_judgement(judge(folder, report))
    console.print(f"Project file: {escape(str(path))}", soft_wrap=True)
    say_results(survey)
