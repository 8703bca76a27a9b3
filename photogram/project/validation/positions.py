"""What is wrong with the measured positions of photographs before anything is adjusted.

Where they are missing, how good they claim to be, whose they are, and whether they were taken with the photographs.
"""

from collections import defaultdict
from collections.abc import Sequence
from datetime import datetime, timedelta

import numpy as np

from photogram.arrays import FloatArray
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.crs import NO_CRS
from photogram.gnss import Solution
from photogram.project.findings import Finding, Severity
from photogram.project.measured.measured_positions import (
    FROM_TAGS,
    claims_too_much,
    needs_attitude,
    sigmas_of,
    solution_of,
    source_of,
)
from photogram.project.project import Project, ProjectPhotograph
from photogram.project.validation.tagged_positions import tagged_position_findings
from photogram.wording import some, things

CLOCK_S = 3.0
"""Camera clocks count whole seconds and drift; the difference common to a file is taken off before."""

LONG_ARM_M, LONGEST_ARM_M = 3.0, 20.0
"""Drones are smaller than the first, and aircraft that carry cameras than the second."""

Pair = tuple[ProjectPhotograph, PhotographTags]

_WORDS: dict[Solution, tuple[str, str]] = {
    "float": ("float solution", "float solutions"),
    "single": ("single (autonomous) solution", "single (autonomous) solutions"),
}
_ONE_FLIGHT = timedelta(hours=12)


def _names(pairs: Sequence[Pair]) -> str:
    return some([photograph.name for photograph, _ in pairs])


def missing_findings(project: Project, known: Sequence[Pair]) -> list[Finding]:
    """Return which photographs have no GNSS position, and which positions have no standard deviation."""
    without = [pair for pair in known if source_of(*pair) is None]
    bare = [pair for pair in known if source_of(*pair) is not None and sigmas_of(*pair)[0] is None]
    findings = []
    if bare:
        text = f"{things(len(bare), 'GNSS position')} without a standard deviation, in the tags or in the project"
        remedy = "give photographs.gnss_sigma_m (0.02 to 0.05 m with RTK, 2 to 5 m without)"
        findings.append(Finding("error", _names(bare), text, remedy))
    if without and len(without) < len(project.photographs):
        text = f"{len(without)} of {len(project.photographs)} photographs have no GNSS position"
        remedy = "they are oriented by tie points and control points alone"
        findings.append(Finding("warning", _names(without), text, remedy))
    elif without:
        text = "no photograph has a GNSS position: control points alone define the datum"
        findings.append(Finding("note", "photographs", text))
    return findings


def solution_findings(known: Sequence[Pair]) -> list[Finding]:
    """Return which positions claim to be better than their solution allows, and which weigh less than a fix does."""
    claimed: defaultdict[Solution, list[Pair]] = defaultdict(list)
    weaker: defaultdict[Solution, list[Pair]] = defaultdict(list)
    for pair in known:
        solution = solution_of(*pair)
        believed, stated = sigmas_of(*pair)
        if source_of(*pair) is None or believed is None or stated is None or solution not in ("float", "single"):
            continue
        (claimed if claims_too_much(solution, believed, stated) else weaker)[solution].append(pair)
    findings = []
    for solution, pairs in claimed.items():
        believed_m, stated_m = (np.min(np.array([sigmas_of(*p)[k] for p in pairs]), axis=0) for k in (0, 1))
        text = (
            f"{things(len(pairs), *_WORDS[solution])} stated with {_metres(stated_m)}: weighted with "
            f"{_metres(believed_m)} or more"
        )
        remedy = "centimetres need fixed ambiguities: give a PPK solution under photographs.positions"
        findings.append(Finding("warning", _names(pairs), text, remedy))
    for solution, pairs in weaker.items():
        text = f"{things(len(pairs), *_WORDS[solution])}, not fixed: weighted accordingly"
        findings.append(Finding("note", _names(pairs), text))
    return findings


def flight_findings(known: Sequence[Pair]) -> list[Finding]:
    """Return the flights that last longer than any battery: their photographs do not share one GNSS offset."""
    times: defaultdict[str, list[datetime]] = defaultdict(list)
    for photograph, tags in known:
        if tags.time is not None and source_of(photograph, tags) is not None:
            times[photograph.flight].append(tags.time.replace(tzinfo=None))
    findings = []
    for flight, taken in times.items():
        if max(taken) - min(taken) > _ONE_FLIGHT:
            days = len({time.date() for time in taken})
            text = (
                f"its photographs were taken on {things(days, 'day')}, {min(taken):%Y-%m-%d} to {max(taken):%Y-%m-%d}"
            )
            remedy = "give each day its own flight: each flight has its own GNSS offset, and the site may have changed"
            findings.append(Finding("warning", f"flight {flight}", text, remedy))
    return findings


def long_arm_findings(known: Sequence[Pair]) -> list[Finding]:
    """Return lever arms that are longer than an aircraft; an error where only millimetres can have been meant."""
    arms: defaultdict[tuple[float, ...], list[Pair]] = defaultdict(list)
    for pair in known:
        if pair[0].lever_arm_m is not None and np.linalg.norm(pair[0].lever_arm_m) > LONG_ARM_M:
            arms[tuple(float(x) for x in pair[0].lever_arm_m)].append(pair)
    findings = []
    for arm_m, pairs in arms.items():
        length_m = float(np.linalg.norm(arm_m))
        figures = ", ".join(f"{x:g}" for x in arm_m)
        text = f"a lever arm of [{figures}] m is {length_m:.0f} m from antenna to camera: typed in millimetres?"
        metres = ", ".join(f"{x / 1000:g}" for x in arm_m)
        remedy = f"give it in metres, [{metres}] if these are millimetres"
        severity: Severity = "error" if length_m > LONGEST_ARM_M else "warning"
        findings.append(Finding(severity, f"gnss.lever_arm_m of {_names(pairs)}", text, remedy))
    return findings


def _metres(sigma_m: FloatArray) -> str:
    return ", ".join(f"{s:.3g}" for s in sigma_m) + " m"


def lever_arm_findings(known: Sequence[Pair]) -> list[Finding]:
    """Return where a lever arm is missing, cannot be turned, or would be counted twice."""
    findings = []
    unturned = [pair for pair in known if source_of(*pair) is not None and needs_attitude(*pair)]
    if unturned:
        count = things(len(unturned), "photograph")
        text = f"the lever arm of {count} cannot be applied: the aircraft's attitude, yaw, pitch and roll, is missing"
        remedy = "give them in a file of positions, or, for a camera fixed to look down, gnss.lever_arm_axes: camera"
        findings.append(Finding("error", _names(unturned), text, remedy))
    without = [
        (p, t)
        for p, t in known
        if p.gnss_map_m is None
        and p.file_position is not None
        and p.file_position.position_of == "antenna"
        and p.file_position.lever_arm_m is None
        and p.lever_arm_m is None
    ]
    if without:
        text = f"{things(len(without), 'position')} of the antenna, and no lever arm to the camera"
        remedy = "give lever_arms: FILE.MRK with the file, or gnss.lever_arm_m: [forward, right, down]"
        findings.append(Finding("warning", _names(without), text, remedy))
    twice = [
        (p, t)
        for p, t in known
        if source_of(p, t) == FROM_TAGS
        and p.lever_arm_m is not None
        and t.rtk_flag is not None
        and (t.make or "").upper() == "DJI"
    ]
    if twice:
        text = "DJI's RTK aircraft write the camera's position into the tags: gnss.lever_arm_m would apply it twice"
        findings.append(Finding("warning", _names(twice), text, "remove it, unless the residuals say otherwise"))
    return findings


def file_findings(known: Sequence[Pair]) -> list[Finding]:
    """Return which photographs the files of positions leave out."""
    listed = [pair for pair in known if pair[0].file_position is not None]
    left = [pair for pair in known if pair[0].file_position is None and source_of(*pair) == FROM_TAGS]
    findings = []
    if listed and left:
        text = f"{things(len(left), 'photograph')} in no position file: the position in the tags is used"
        remedy = "give positions for all, or remove these photographs"
        findings.append(Finding("warning", _names(left), text, remedy))
    return findings


def time_findings(taken: Sequence[tuple[ProjectPhotograph, datetime | None]]) -> list[Finding]:
    """Return which photographs the files of positions put at another time than their own clock, ``taken``, does."""
    sources: defaultdict[str, list[tuple[ProjectPhotograph, float]]] = defaultdict(list)
    for photograph, time in taken:
        listed = photograph.file_position
        if listed is not None and listed.gps_time is not None and time is not None:
            ahead_s = (time.replace(tzinfo=None) - listed.gps_time).total_seconds()
            sources[listed.source].append((photograph, ahead_s))
    findings = []
    for source, timed in sources.items():
        ahead = np.array([s for _, s in timed])
        apart = np.abs(ahead - np.median(ahead))
        wrong = [photograph for (photograph, _), a in zip(timed, apart, strict=True) if a > CLOCK_S]
        if not wrong:
            continue
        names = some([photograph.name for photograph in wrong])
        text = (
            f"{len(wrong)} of {things(len(timed), 'photograph')} ({names}) were taken at other times than "
            f"their rows state, by up to {apart.max():.0f} s relative to the others"
        )
        by_order = any(p.file_position is not None and p.file_position.by_order for p in wrong)
        remedy = "check that the file belongs to these photographs, and that no photograph is missing"
        findings.append(Finding("error" if by_order else "warning", source, text, remedy))
    return findings


def gnss_findings(project: Project, tags: Sequence[PhotographTags | None]) -> list[Finding]:
    """Return everything that project, files of positions and tags show of the measured positions."""
    known = [(p, t) for p, t in zip(project.photographs, tags, strict=True) if t is not None]
    if project.crs == NO_CRS:
        unused = [pair for pair in known if source_of(*pair) == FROM_TAGS]
        text = f"{things(len(unused), 'GNSS position')} in the tags, not used with crs: none"
        return [Finding("warning", _names(unused), text, "name the CRS of the site to use them")] if unused else []
    return [
        *missing_findings(project, known),
        *solution_findings(known),
        *flight_findings(known),
        *lever_arm_findings(known),
        *long_arm_findings(known),
        *file_findings(known),
        *time_findings([(photograph, tags.time) for photograph, tags in known]),
        *tagged_position_findings(project, known),
    ]
