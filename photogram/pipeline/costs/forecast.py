"""What a survey will take on this machine: seconds, disk and memory of each stage, said before the work.

The amount of work follows from project and tags (`workload`), its cost from rates (`rates`) scaled by a short test of
this machine (`self_test`). A stage that an earlier run has left in the work folder tells better: it is thought to take
what it took (`earlier_runs`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from photogram.compilation import kernels
from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.costs.earlier_runs import corrected, measured_stages
from photogram.pipeline.costs.rates import COMPILATION_S, compilation_seconds, predicted_seconds
from photogram.pipeline.costs.self_test import Speed
from photogram.pipeline.costs.workload import workload
from photogram.pipeline.stage_names import STAGE_NAMES
from photogram.pipeline.store.workspace import Workspace
from photogram.project.project import Project
from photogram.project.validation.resources import kept_disk_bytes, machine_needs, stage_memory_bytes, surface_size


@dataclass(frozen=True)
class StageCost:
    """What a stage is predicted to take.

    ``compilation_seconds`` are part of ``seconds``, those of a first run on a machine; ``disk_bytes`` is what it
    leaves, ``memory_bytes`` the most that the process holds.
    """

    stage: str
    seconds: float
    compilation_seconds: float
    disk_bytes: float
    memory_bytes: float


@dataclass(frozen=True)
class Forecast:
    """What a survey is predicted to take: the costs of the stages that remain, the most disk at a time, and the most
    memory."""

    stages: tuple[StageCost, ...]
    disk_bytes: float

    @property
    def seconds(self) -> float:
        """Return the seconds of all stages."""
        return sum(cost.seconds for cost in self.stages)

    @property
    def compilation_seconds(self) -> float:
        """Return the part of them in which kernels are compiled."""
        return sum(cost.compilation_seconds for cost in self.stages)

    @property
    def memory_bytes(self) -> float:
        """Return the most memory of any stage."""
        return max((cost.memory_bytes for cost in self.stages), default=0.0)

    @property
    def seconds_by_stage(self) -> dict[str, float]:
        """Return the seconds of each stage."""
        return {cost.stage: cost.seconds for cost in self.stages}


def forecast(
    project: Project,
    tags: Sequence[PhotographTags | None],
    speed: Speed,
    workers: int,
    stages: Collection[str] = STAGE_NAMES,
    compiled: dict[str, float] | None = None,
) -> Forecast:
    """Return what the ``stages`` of a survey take on a machine of such a ``speed`` with so many ``workers``.

    ``tags`` are those of ``project.photographs``; ``compiled`` is the share of each stage's kernels that need not be
    compiled, by what is kept on this machine where it is not given.
    """
    work, size = workload(project, tags), surface_size(project, tags)
    seconds = corrected(predicted_seconds(work, speed, workers), measured_stages(Workspace(project.work)))
    compiling = compilation_seconds(work, compiled_share() if compiled is None else compiled, speed)
    disk, memory = kept_disk_bytes(project, size), stage_memory_bytes(project, size, workers)
    costs = list[StageCost]()
    for stage in STAGE_NAMES:
        if stage in stages:
            own = compiling.get(stage, 0.0)
            costs.append(StageCost(stage, seconds[stage] + own, own, disk.get(stage, 0.0), memory[stage][0]))
    whole = machine_needs(project, tags, workers).disk_bytes
    left = sum(disk.get(stage, 0.0) for stage in STAGE_NAMES)
    remaining = sum(cost.disk_bytes for cost in costs)
    return Forecast(tuple(costs), max(remaining, min(whole, remaining * whole / left if left else 0.0)))


def compiled_share() -> dict[str, float]:
    """Return which share of each stage's kernels is compiled for this machine."""
    found = {}
    for stage, (_, rooms) in COMPILATION_S.items():
        compiled, there = kernels(rooms)
        found[stage] = compiled / there if there else 1.0
    return found
