"""photogram adjust: the whole survey. Arguments only."""

from typing import Annotated

import typer

from photogram.pipeline.stage_names import STAGE_NAMES, StageName
from photogram.terminal.arguments import AsJson, Pdf, Photographs, ProjectFile, QuietOption
from photogram.terminal.fast_checks import check_project_file


def adjust(
    project: ProjectFile,
    photographs: Photographs = None,
    start: Annotated[
        StageName | None,
        typer.Option("--from", metavar="STAGE", help=f"Re-run from this stage on: {', '.join(STAGE_NAMES)}."),
    ] = None,
    until: Annotated[StageName | None, typer.Option("--until", metavar="STAGE", help="Stop after this stage.")] = None,
    pdf: Pdf = False,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Exit with 1 if a measurement was rejected because the others contradict it."),
    ] = False,
    check: Annotated[
        bool, typer.Option("--check/--no-check", help="Validate the project first, as photogram check does.")
    ] = True,
    quiet: QuietOption = False,
    as_json: AsJson = False,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Work in N processes of this machine, not in threads."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Work on the Dask cluster of this scheduler, tcp://host:8786 for example."
        ),
    ] = None,
) -> None:
    """Process a survey: match, orient and adjust the photographs, then produce point clouds, DSM and orthophoto.

    An interrupted run resumes where it was. The stages stand with --from, in their
    order.
    """
    if workers is not None and scheduler is not None:
        raise typer.BadParameter("give --workers or --scheduler, not both", param_hint="'--scheduler'")
    from photogram.terminal.events import event_lines

    with event_lines(as_json) as lines:
        check_project_file(project)
        from photogram.cli.work.adjust import run

        run(
            project,
            photographs,
            start=start,
            until=until,
            pdf=pdf,
            strict=strict,
            check=check,
            quiet=quiet,
            lines=lines,
            workers=workers,
            scheduler=scheduler,
        )
