"""photogram demo: the built-in simulated survey, end to end. Arguments only."""

from pathlib import Path
from typing import Annotated

import typer

from photogram.terminal.arguments import AsJson, QuietOption


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
    from photogram.terminal.events import event_lines

    with event_lines(as_json) as lines:
        from photogram.simulation.work.demo import run

        run(folder, seed, dense, quiet=quiet, lines=lines)
