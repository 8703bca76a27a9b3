"""What earlier runs in the same work folder took, stage by stage, and what that says of the prediction."""

from collections.abc import Mapping
from dataclasses import dataclass

from photogram.errors import PhotogramError
from photogram.pipeline.stage_names import STAGE_NAMES
from photogram.pipeline.store.stage_summary import StageNote
from photogram.pipeline.store.workspace import Workspace

LEAST_SECONDS = 0.5
"""A stage that took less says nothing of the machine."""

MOST_FACTOR = 4.0
"""A stage whose time differs by more from the prediction was made under other settings, or beside other work."""


@dataclass(frozen=True)
class StageMeasured:
    """What a stage took: seconds without compilation, and the peak of memory, None where it was not told."""

    seconds: float
    peak_memory_bytes: int | None


def measured_stages(workspace: Workspace) -> dict[str, StageMeasured]:
    """Return what the stages took that are complete in a work folder; of damaged ones nothing."""
    measured = {}
    for name in STAGE_NAMES:
        try:
            summary = workspace.summary(name, StageNote) if workspace.mark(name) else StageNote()
        except PhotogramError:
            continue  # the run says so, and makes it again
        if "seconds" in summary:
            seconds = summary["seconds"] - summary.get("compilation_seconds", 0.0)
            measured[name] = StageMeasured(max(seconds, 0.0), summary.get("peak_memory_bytes"))
    return measured


def corrected(predicted: Mapping[str, float], measured: Mapping[str, StageMeasured]) -> dict[str, float]:
    """Return predicted seconds of stages, those that have been measured as long as they took, but for what no machine
    explains."""
    return {
        stage: measured[stage].seconds if stage in measured and _tells(seconds, measured[stage].seconds) else seconds
        for stage, seconds in predicted.items()
    }


def _tells(predicted: float, measured: float) -> bool:
    if max(predicted, measured) < LEAST_SECONDS:
        return False
    return predicted <= MOST_FACTOR * measured and measured <= MOST_FACTOR * predicted
