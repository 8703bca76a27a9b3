"""photogram demo: the built-in simulated survey, end to end."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from photogram.cli.app import app
from photogram.cli.terminal import Terminal, bars, console, show_judgement, show_report
from photogram.demonstration import judge, write_demonstration
from photogram.pipeline import load_project, run_pipeline


@app.command()
def demo(
    folder: Annotated[Path, typer.Argument(help="Where the simulated survey and its results are written.")] = Path(
        "demo"
    ),
    seed: Annotated[int, typer.Option(help="Another seed makes another site.")] = 1,
    dense: Annotated[
        bool, typer.Option("--dense", help="Make a dense surface and an orthophoto too: a minute and a half longer.")
    ] = False,
) -> None:
    """Render a small simulated survey, adjust it, and compare the result with the truth."""
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
        report = run_pipeline(survey, watcher=Terminal(progress))
    show_report(report)
    show_judgement(judge(folder, report))
    console.print(f"Project file: {path}\nResults: {survey.results}")
