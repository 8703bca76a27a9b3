"""What the experiments of `photogram study` do."""

from pathlib import Path

from rich.markup import escape
from rich.table import Table

from photogram.pipeline.input_validation import predicted_costs, tags_of
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.teaching.pair_study import study_pair, write_study
from photogram.teaching.ransac_study import RansacStudy, Residual, needed_iterations
from photogram.terminal.console import bars, console
from photogram.terminal.progress import Terminal


def _show(result: RansacStudy) -> None:
    best = [f"best of {n}" for n in result.iterations]
    table = Table(
        "sample",
        "threshold" if result.residual == "algebraic" else "px",
        *best,
        "needed for 99 %",
        title="Inliers by sample size and threshold",
    )
    for s, size in enumerate(result.sample_sizes):
        for t, threshold in enumerate(result.thresholds_px):
            needed = float(needed_iterations(float(result.inlier_fraction[t]), size))
            best_counts = [str(int(n)) for n in result.best_inliers[s, t]]
            table.add_row(str(size), f"{threshold:g}", *best_counts, f"{needed:.0f}")
    console.print(table)


def run(
    project: Path,
    photographs: Path | None,
    pair: tuple[str, str] | None,
    counts: list[int],
    sizes: list[int],
    limits_px: list[float],
    residual: Residual,
    ratio: float,
    seed: int,
) -> None:
    """Run RANSAC with many settings on one pair of photographs; show its inliers, and write them and pictures."""
    survey = load_project(project, photographs)
    with bars() as progress:
        predicted = predicted_costs(survey, tags_of(survey), until="matches")
        run_pipeline(survey, watcher=Terminal(progress, predicted.seconds_by_stage), until="matches")
    study = study_pair(survey, pair or (), ratio, counts, sizes, limits_px, seed, residual)
    pictures = f"{escape(study.first)} and {escape(study.second)}"
    console.print(f"{pictures}: {study.result.points} candidate matches at ratio {ratio:g}, {residual} distance")
    _show(study.result)
    folder = write_study(survey.results, study)
    console.print(f"Written: {escape(str(folder))}", soft_wrap=True)
