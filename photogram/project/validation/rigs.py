"""The check of rigs: which photographs are exposures of cameras on one body, before anything is computed."""

from collections.abc import Sequence
from dataclasses import dataclass

from photogram.files.photographs.tags import PhotographTags
from photogram.project.findings import Finding
from photogram.project.project import Project
from photogram.project.rigs.grouping import grouped
from photogram.wording import some, things


@dataclass(frozen=True)
class _Tagged:
    """What groups a photograph to an exposure, from its tags."""

    name: str
    capture: str | None
    time_s: float | None


def rig_findings(
    project: Project, tags: Sequence[PhotographTags | None], duplicates: Sequence[Sequence[int]] = ()
) -> list[Finding]:
    """Return what is wrong with the exposures of rigs, and how many there are; ``duplicates`` are groups of photographs
    that are the same, of which the first counts."""
    if not project.rigs:
        return []
    tagged = [
        _Tagged(
            p.name,
            None if t is None else t.capture,
            None if t is None or t.time is None else t.time.timestamp(),
        )
        for p, t in zip(project.photographs, tags, strict=True)
    ]
    rigs = grouped(project.rigs, tagged, {i for group in duplicates for i in group[1:]})
    findings = []
    for error in rigs.errors:
        where, _, text = error.partition(": ")
        findings.append(Finding("error", where, text))
    for companion, alone in zip(rigs.companions, rigs.alone, strict=True):
        where = f"rig of {companion.master}"
        if companion.exposures:
            counts = f"{things(len(companion.exposures), 'exposure')} with camera {companion.name}"
            findings.append(Finding("note", where, counts))
        if alone and companion.exposures:
            count = things(len(alone), "photograph")
            text = f"{count} of camera {companion.name} without one of the master: {some(alone)}"
            remedy = "add the master's photographs; these are oriented by themselves"
            findings.append(Finding("warning", where, text, remedy))
    return findings
