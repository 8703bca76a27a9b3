"""What `photogram donate` does."""

import sys
from pathlib import Path

import typer
from rich.markup import escape

from photogram.donation.donation import REMOVED, donated, write_donation
from photogram.errors import PhotogramError
from photogram.pipeline.pipeline import load_project
from photogram.terminal.console import console


def run(project: Path, output: Path | None, photographs: Path | None, *, confirmed: bool) -> None:
    """Show what stands in the file and what does not, and save it where that is confirmed."""
    path = output or project.with_name(f"{project.stem}_donation.npz.gz")
    if not path.name.endswith(".npz.gz"):
        raise PhotogramError(f"{path}: a donation is packed: give a name that ends in .npz.gz with --output")
    donation = donated(load_project(project, photographs))
    console.print("In the file:")
    for what, words in donation.content():
        console.print(f"  {what}: {escape(words)}", soft_wrap=True, highlight=False)
    console.print(f"Not in it: {REMOVED}.", soft_wrap=True, highlight=False)
    if not confirmed:
        if not sys.stdin.isatty():
            raise PhotogramError("nothing is saved unless a person has seen this: add --yes")
        typer.confirm(f"Save this to {path}?", abort=True)
    write_donation(path, donation)
    written = f"{escape(str(path))} ({path.stat().st_size / 1e6:.1f} MB)"
    console.print(f"Written: {written}. It was sent nowhere.", soft_wrap=True, highlight=False)
