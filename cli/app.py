"""The Typer application that the commands register with, and its own options.

This module and those of the commands' arguments import nothing that computes: help, completion and the answer to a
typing error come at once. Each command imports its work (``run_<command>.py``) when it is called.
"""

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from photogram import __version__
from photogram.cli.registry import COMMANDS, register_commands
from photogram.cli.streams import show_log

USAGE_ERROR: type[Exception] = next(k for k in typer.BadParameter.__mro__ if k.__name__ == "ClickException")
"""Wrong usage, which Typer answers; the class is Click's or Typer's own copy of it, by Typer's version."""


class CommandError(Exception):
    """Carries what a command raised past Typer, which would take some of it for its own: ``cause``, the name of the
    command, and how often -v was given."""

    def __init__(self, cause: BaseException, command: str | None, verbosity: int) -> None:
        super().__init__(cause)
        self.cause = cause
        self.command = command
        self.verbosity = verbosity


class Commands(TyperGroup):
    """The commands, of which what they raise is handed on as CommandError."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ANN401 - Typer's own type, which it does not export
        """Return the names of the commands as the help lists them."""
        return sorted(super().list_commands(ctx), key=list(COMMANDS).index)

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - as above
        """Run a command."""
        try:
            return super().invoke(ctx)
        except (USAGE_ERROR, typer.Exit, typer.Abort):
            raise
        except (Exception, KeyboardInterrupt) as cause:
            raise CommandError(cause, ctx.invoked_subcommand, ctx.params["verbose"]) from cause


app = typer.Typer(
    name="photogram",
    cls=Commands,
    help="From drone photographs and ground control points to a surface model with predicted accuracy.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"photogram {__version__}")
        raise typer.Exit


@app.callback()
def options(
    ctx: typer.Context,
    verbose: Annotated[
        int,
        typer.Option(
            "-v",
            "--verbose",
            count=True,
            show_default=False,
            help="Show the log: rounds, rejections, warnings of libraries; -vv: also the traceback of an error.",
        ),
    ] = 0,
    version: Annotated[  # noqa: ARG001 - its callback answers
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """From drone photographs and ground control points to a surface model with predicted accuracy."""
    if verbose:
        ctx.call_on_close(show_log())


register_commands(app)
