"""photogram verify: a report derived again from its observations. Arguments only."""

from pathlib import Path
from typing import Annotated

import typer


def verify(
    results: Annotated[Path, typer.Argument(help="Folder of results, or its report.json.", show_default=False)],
) -> None:
    """Derive a report again from its observations, with mathematics that share nothing with the adjustment."""
    from rich.markup import escape

    from photogram.errors import ReportError
    from photogram.terminal.console import console
    from photogram.verification.check import verify_report

    try:
        done = verify_report(results)
    except ValueError as error:
        raise ReportError(f"{error}: run photogram adjust again, or give the folder of its results") from error
    for line in done.lines:
        console.print(f"{line.outcome}: {escape(line.what)}: {escape(line.words)}", soft_wrap=True, highlight=False)
    share = f"{done.derived} of {done.figures} figures of report.json were derived"
    if not done.holds:
        count = sum(line.outcome == "differs" for line in done.lines)
        console.print(f"DIFFERS in {count} places; {share}.", soft_wrap=True)
        raise typer.Exit(1)
    only = "" if done.derived else ", but checksums alone were compared"
    console.print(f"Nothing differs{only}; {share}.", soft_wrap=True)
