"""The Typer application that the commands register with."""

from __future__ import annotations

from typing import Annotated

import typer

from photogram import __version__

app = typer.Typer(
    name="photogram",
    help="From drone photographs and ground control to a surface model that says how good it is.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"photogram {__version__}")
        raise typer.Exit


@app.callback()
def options(
    verbose: Annotated[int, typer.Option("-v", "--verbose", count=True, help="-vv shows where an error arose.")] = 0,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    """From drone photographs and ground control to a surface model that says how good it is."""
