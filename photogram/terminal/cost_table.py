"""What the terminal says of the predicted cost of a survey: a line before the work, and a table by stage."""

from rich.table import Table

from photogram.pipeline.costs.forecast import Forecast
from photogram.project.validation.resources import gigabytes
from photogram.terminal.time_left import duration
from photogram.wording import things

LEAST_COMPILATION_S = 3.0
"""Less is not worth a word."""


def _disk(count: float) -> str:
    return gigabytes(int(count)) if count >= 1e6 else "–"


def cost_line(predicted: Forecast) -> str:
    """Return what the work that remains is predicted to take, in one line."""
    needs = f"{_disk(predicted.disk_bytes)} of disk, {gigabytes(int(predicted.memory_bytes))} of memory"
    compiling = predicted.compilation_seconds
    once = f" ({duration(compiling)} of it for kernels, compiled once)" if compiling >= LEAST_COMPILATION_S else ""
    return f"About {duration(predicted.seconds)}{once}, {needs}."


def cost_table(predicted: Forecast, workers: int) -> Table:
    """Return what each stage that remains is predicted to take on this machine."""
    table = Table(title=f"Predicted on this machine, {things(workers, 'core')}")
    table.add_column("stage")
    for heading in ("time", "disk", "memory"):
        table.add_column(heading, justify="right")
    for cost in predicted.stages:
        if cost.seconds > 0:
            time = "under 1 s" if cost.seconds < 1 else duration(cost.seconds)
            table.add_row(cost.title, time, _disk(cost.disk_bytes), gigabytes(int(cost.memory_bytes)))
    table.add_section()
    whole = duration(predicted.seconds), _disk(predicted.disk_bytes), gigabytes(int(predicted.memory_bytes))
    table.add_row("together; disk and memory at most", *whole)
    return table
