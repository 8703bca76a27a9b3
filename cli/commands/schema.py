"""photogram schema: what the files of results may hold. Arguments only."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

DocumentName = Literal["report", "events"]


def schema(
    document: Annotated[
        DocumentName,
        typer.Argument(help="Document: report, for report.json; events, for a line of --json.", show_default=False),
    ],
) -> None:
    """Print the JSON Schema of report.json or of the events of --json: keys, their types and units."""
    from photogram.cli.work.schema import run

    run(document)
