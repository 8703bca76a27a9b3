"""photogram demo: the built-in simulated survey, end to end. Arguments only; the work is in `photogram.cli.work`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from photogram.cli.app import app
from photogram.cli.arguments import AsJson, QuietOption


@app.command()
def demo(
    folder: Annotated[Path, typer.Argument(help="Folder for the simulated survey and its results.")] = Path("demo"),
    seed: Annotated[int, typer.Option(help="Seed of the simulated site.")] = 1,
    dense: Annotated[
        bool, typer.Option("--dense", help="Also produce a dense surface and an orthophoto (90 s longer).")
    ] = False,
    quiet: QuietOption = False,
    as_json: AsJson = False,
) -> None:
    """Render a small simulated survey, process it, and compare the result with the truth."""
    from photogram.cli.events import event_lines

    with event_lines(as_json) as lines:
        from photogram.cli.work.demo import run

        run(folder, seed, dense, quiet=quiet, lines=lines)
