"""photogram study: teaching experiments on single processing steps. Arguments only."""

from typing import Annotated, Literal

import typer

from photogram.terminal.arguments import Photographs, ProjectFile
from photogram.terminal.fast_checks import check_project_file

experiments = typer.Typer(help="Teaching experiments on single processing steps.", no_args_is_help=True)


def _numbers(text: str, option: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise typer.BadParameter(f"{option}: {text!r} is not a list of numbers such as 8,10,12") from error
    return values


def _counts(text: str, option: str) -> list[int]:
    values = _numbers(text, option)
    if any(not value.is_integer() for value in values):
        raise typer.BadParameter(f"{option}: {text!r} is not a list of whole numbers such as 8,10,12")
    return [int(value) for value in values]


@experiments.callback()
def study() -> None:
    """Teaching experiments on single processing steps."""


@experiments.command()
def ransac(
    project: ProjectFile,
    photographs: Photographs = None,
    pair: Annotated[
        tuple[str, str] | None,
        typer.Option(metavar="NAME NAME", help="The two photographs; default: the first matched pair."),
    ] = None,
    iterations: Annotated[str, typer.Option(metavar="N,N,…", help="Numbers of iterations.")] = "10,100,1000",
    sample_sizes: Annotated[
        str, typer.Option(metavar="N,N,…", help="Matches per sample, at least 8.")
    ] = "8,10,12,16,24",
    thresholds: Annotated[str, typer.Option(metavar="PX,PX,…", help="Inlier thresholds in px.")] = "0.5,1,2,4",
    residual: Annotated[
        Literal["sampson", "symmetric", "algebraic"], typer.Option(help="Distance compared with the threshold.")
    ] = "sampson",
    ratio: Annotated[
        float,
        typer.Option(
            min=0.01, max=1.0, help="Ratio test of the candidate matches; closer to 1 admits more wrong ones."
        ),
    ] = 0.95,
    seed: Annotated[int, typer.Option(help="Seed of the random samples.")] = 0,
) -> None:
    """Run the textbook RANSAC with the 8-point algorithm on candidate matches, and plot its inliers."""
    sizes, counts = _counts(sample_sizes, "--sample-sizes"), _counts(iterations, "--iterations")
    limits_px = _numbers(thresholds, "--thresholds")
    check_project_file(project)
    from photogram.teaching.work import run

    run(project, photographs, pair, counts, sizes, limits_px, residual, ratio, seed)
