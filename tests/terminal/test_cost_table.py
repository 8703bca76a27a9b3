"""The line before the work, and the table of `photogram check`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console

from photogram.pipeline.costs.forecast import Forecast, StageCost
from photogram.terminal.cost_table import cost_line, cost_table

COSTS = Forecast(
    (
        StageCost("features", "Features", 80.0, 0.0, 3e7, 9e8),
        StageCost("tie_points", "Tie points", 0.3, 0.0, 5e5, 8e8),
        StageCost("dense", "Dense matching", 260.0, 25.0, 1.1e9, 7e8),
        StageCost("comparison", "Comparison", 0.0, 0.0, 0.0, 7e8),
    ),
    1.2e9,
)


def test_one_line_says_time_disk_and_memory() -> None:
    assert cost_line(COSTS) == (
        "About 5 min 40 s (25 s of it for kernels, compiled once), 1.2 GB of disk, 0.9 GB of memory."
    )
    warm = Forecast((StageCost("features", "Features", 80.0, 1.0, 3e7, 9e8),), 3e7)
    assert cost_line(warm) == "About 1 min 20 s, 30 MB of disk, 0.9 GB of memory."


def test_the_table_has_a_row_for_each_stage_that_does_something() -> None:
    console = Console(width=120, record=True, quiet=False)
    console.print(cost_table(COSTS, 2))
    text = console.export_text()
    assert "2 cores" in text
    for words in ("1 min 20 s", "30 MB", "0.9 GB", "under 1 s", "4 min 20 s", "1.1 GB", "together", "5 min 40 s"):
        assert words in text, words
    assert "Comparison" not in text


def test_check_prints_it_and_adjust_says_it_first(survey: Path, photogram: Callable[..., Any]) -> None:
    project = survey / "project.yaml"
    checked = photogram("check", project)
    assert checked.code == 0
    assert "Predicted on this machine" in checked.out
    assert not (survey / "work").exists()
    adjusted = photogram("adjust", project, "--until", "photographs")
    assert adjusted.code == 0
    (said,) = [line for line in adjusted.out.splitlines() if line.startswith("About ")]
    assert "of disk" in said
    assert "of memory" in said
    assert adjusted.out.index("About ") < adjusted.out.index("photographs read")
