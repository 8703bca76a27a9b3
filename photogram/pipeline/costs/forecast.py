"""What a survey will take on this machine: seconds, disk and memory of each stage, said before the work.

The amount of work follows from project and tags (`workload`), its cost from rates (`rates`) scaled by a short test of
this machine (`self_test`). A stage that an earlier run has left in the work folder tells better: it is thought to take
what it took (`earlier_runs`).
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from photogram.compilation import kernels
from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.costs.earlier_runs import corrected, measured_stages
from photogram.pipeline.costs.rates import compilation_seconds, predicted_seconds
from photogram.pipeline.costs.self_test import Speed
from photogram.pipeline.costs.space import kept_disk_bytes, machine_needs, stage_memory_bytes
from photogram.pipeline.costs.workload import workload
from photogram.pipeline.stage import Stage
from photogram.pipeline.stage_costs import Extent
from photogram.pipeline.store.workspace import Workspace
from photogram.project.project import Project
from photogram.project.validation.resources import surface_size


@dataclass(frozen=True)
class StageCost:
    """What a stage is predicted to take.

    ``compilation_seconds`` are part of ``seconds``, those of a first run on a machine; ``disk_bytes`` is what it
    leaves, ``memory_bytes`` the most that the process holds.
    """

    stage: str
    title: str
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
    stages: Sequence[Stage],
    project: Project,
    tags: Sequence[PhotographTags | None],
    speed: Speed,
    workers: int,
    remaining: Collection[str] | None = None,
    compiled: dict[str, float] | None = None,
) -> Forecast:
    """Return what all ``stages`` of a survey, or those that are ``remaining``, by name, take on a machine of such a
    ``speed`` with so many ``workers``.

    ``tags`` are those of ``project.photographs``; ``compiled`` is the share of each stage's kernels that need not be
    compiled, by what is kept on this machine where it is not given.
    """
    work, size = workload(project, tags), surface_size(project, tags)
    extent = Extent(project, size, workers)
    asked_for = [stage for stage in stages if stage.costs.is_asked_for(extent)]
    predicted: dict[str, float] = dict.fromkeys((stage.name for stage in stages), 0.0)
    predicted |= predicted_seconds(asked_for, work, speed, workers)
    seconds = corrected(predicted, measured_stages(Workspace(project.work)))
    compiling = compilation_seconds(asked_for, compiled_share(stages) if compiled is None else compiled, speed)
    disk, memory = kept_disk_bytes(stages, extent), stage_memory_bytes(stages, extent)
    costs = list[StageCost]()
    for stage in stages:
        name = stage.name
        if remaining is None or name in remaining:
            own = compiling.get(name, 0.0)
            costs.append(StageCost(name, stage.title, seconds[name] + own, own, disk[name], memory[name][0]))
    whole = machine_needs(stages, project, tags, workers).disk_bytes
    left = sum(disk.values())
    kept = sum(cost.disk_bytes for cost in costs)
    return Forecast(tuple(costs), max(kept, min(whole, kept * whole / left if left else 0.0)))


def compiled_share(stages: Sequence[Stage]) -> dict[str, float]:
    """Return which share of each stage's kernels is compiled for this machine."""
    share = dict[str, float]()
    for stage in stages:
        compiled, there = kernels(stage.costs.kernels)
        share[stage.name] = compiled / there if there else 1.0
    return share
