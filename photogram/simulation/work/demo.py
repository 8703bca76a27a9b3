"""What `photogram demo` does."""

from pathlib import Path

from rich.markup import escape
from rich.table import Table

from photogram.pipeline.input_validation import predicted_costs, tags_of
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.pipeline.precompilation import compiling_early
from photogram.report.titles import CLOUD_TITLES
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.judgement import Judgement, judge
from photogram.terminal.console import console
from photogram.terminal.events import EventLines
from photogram.terminal.output_modes import say_results, voice_of
from photogram.terminal.report_tables import show_report


def run(folder: Path, seed: int, dense: bool, *, quiet: bool = False, lines: EventLines | None = None) -> None:
    """Render the simulated survey, process it, and show how far its result is from the truth; with ``lines`` in
    events."""
    voice = voice_of(quiet, lines)
    with compiling_early():
        with voice.preparing("Simulated survey") as step:
            path = write_demonstration(folder, seed, step, dense=dense)
        survey = load_project(path)
        predicted = predicted_costs(survey, tags_of(survey), test=False)  # a known survey, and people wait
        voice.forecast(predicted)
        with voice.watching(predicted.seconds_by_stage) as watcher:
            report = run_pipeline(survey, watcher=watcher)
    if quiet or lines is not None:
        voice.result(survey, report)
        return
    show_report(report)
    show_judgement(judge(folder, report))
    console.print(f"Project file: {escape(str(path))}", soft_wrap=True)
    say_results(survey)


def show_judgement(judgement: Judgement) -> None:
    """Print a simulated survey's result against its truth."""
    j = judgement
    table = Table("simulated survey against its truth", "value", "in GSD")
    table.add_row("ground sampling distance, planned", f"{j.gsd_m:.4f} m", "1")
    for what, error_m in (
        (f"{j.check_points} check points, RMSE in plan", j.check_rmse_plan_m),
        (f"{j.check_points} check points, RMSE in height", j.check_rmse_height_m),
        ("projection centres, RMS error", j.camera_rmse_m),
    ):
        table.add_row(what, f"{error_m:.4f} m", f"{error_m / j.gsd_m:.2f}")
    table.add_row("focal length, error (predicted sigma)", f"{j.focal_error_px:+.3f} px ({j.focal_sigma_px:.3f})", "")
    for name, nmad in j.nmad_m.items():
        table.add_row(f"{CLOUD_TITLES[name]} cloud, NMAD of heights", f"{nmad:.4f} m", f"{nmad / j.gsd_m:.2f}")
    table.add_row("adjusted closer to the truth than three-view", f"{j.gain:.1f} times", "")
    console.print(table)
