"""The check before the long work: everything that can be known to be wrong from the project file, the tags of the
photographs and the machine, all at once.

Pure functions on data that others have read; `photogram check` reads it, in seconds, and shows what they find.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from photogram.arrays import BoolArray
from photogram.errors import FrameError, ProjectError
from photogram.files.photographs.headers import PhotographHeader
from photogram.files.photographs.placeholders import (
    constant_flying_heights,
    constant_heights,
    stray_zero_heights,
    without_zero_attitudes,
    zero_attitudes,
)
from photogram.files.photographs.stretches import MIXED_REMEDY, mixed_depths
from photogram.files.photographs.tags import PhotographTags, damage_by_kind
from photogram.project.findings import Finding
from photogram.project.measured.measured_survey import gnss_positions, of_tags
from photogram.project.measured.unmeasured import constant_heights_of_files
from photogram.project.project import Project
from photogram.project.validation.datum import datum_findings
from photogram.project.validation.geometry import geometry_findings
from photogram.project.validation.heights import height_system_findings
from photogram.project.validation.positions import gnss_findings
from photogram.project.validation.resources import MachineNeeds, gigabytes, machine_findings
from photogram.project.validation.rigs import rig_findings
from photogram.wording import some, things

_MOST_LINES = 10


def project_errors(path: Path, error: ProjectError) -> list[Finding]:
    """Return the errors raised by reading the project file ``path``, one finding per line."""
    findings = []
    for line in str(error).splitlines():
        place = re.match(rf"{re.escape(str(path))}:(\d+): (.*)", line)
        if place:
            findings.append(Finding("error", f"{path.name}:{place[1]}", place[2]))
        elif not line.endswith("errors:"):
            findings.append(Finding("error", path.name, line.removeprefix(f"{path}: ")))
    return findings


# ---- photographs ---------------------------------------------------------------------------------------------------


def header_findings(
    headers: Sequence[PhotographHeader], twins: Sequence[Sequence[int]] = (), fisheye: Sequence[bool] = ()
) -> list[Finding]:
    """Return what is wrong with photographs by themselves: not to be read, twice the same, of a kind not ordinary.

    ``twins`` are groups of indices of the same photograph; ``fisheye`` says which photographs the project gives
    a fisheye as camera, empty where there is no project.
    """
    unreadable = defaultdict[str, list[str]](list)
    for header in headers:
        if header.tags is None:
            unreadable[header.error].append(header.name)
    reasons = list(unreadable.items())
    findings = [Finding("error", some(names), reason) for reason, names in reasons[:_MOST_LINES]]
    rest = [name for _, names in reasons[_MOST_LINES:] for name in names]
    if rest:
        findings.append(Finding("error", some(rest), f"{things(len(rest), 'more photograph')} cannot be read"))
    for group in twins:
        names = some([headers[i].name for i in group])
        text = f"the same photograph {'twice' if len(group) == 2 else f'{len(group)} times'}: the first is used"
        findings.append(Finding("warning", names, text, "remove the copies"))
    findings += _damage_findings(headers)
    kinds: defaultdict[str, list[str]] = defaultdict(list)
    is_thermal = all(header.tags is None or header.tags.kind == "thermal" for header in headers)
    for number, header in enumerate(headers):
        if header.tags is not None and header.tags.kind != "frame" and not is_thermal:
            if header.tags.kind == "fisheye" and fisheye and fisheye[number]:
                continue
            kinds[header.tags.kind].append(header.name)
    for kind, names_of_kind in kinds.items():
        text = f"{things(len(names_of_kind), 'picture')} of the kind {kind}, not ordinary photographs"
        findings.append(Finding("warning", some(names_of_kind), text, "remove what the camera model cannot describe"))
    return findings


def _damage_findings(headers: Sequence[PhotographHeader]) -> list[Finding]:
    """Return which photographs have tags that cannot be read, one finding for each kind of damage."""
    damaged = damage_by_kind([(h.name, h.tags.damage) for h in headers if h.tags is not None])
    remedy = "use the original files of the camera if RTK standard deviations or gimbal angles are missing"
    return [Finding("warning", some(names), text, remedy) for text, names in damaged]


def _of_camera(
    project: Project, tags: Sequence[PhotographTags | None], camera: int
) -> list[tuple[str, PhotographTags]]:
    pairs = zip(project.photographs, tags, strict=True)
    return [(p.name, t) for p, t in pairs if p.camera == camera and t is not None]


def camera_findings(project: Project, tags: Sequence[PhotographTags | None]) -> list[Finding]:
    """Return which photographs do not have the size of their camera, or were taken by another than the rest."""
    findings = []
    for number, camera in enumerate(project.cameras):
        own = _of_camera(project, tags, number)
        where = f"camera {camera.name}"
        size = (camera.width_px, camera.height_px)
        other = [(n, (t.width_px, t.height_px)) for n, t in own if (t.width_px, t.height_px) != size]
        if other:
            sizes = ", ".join(f"{w} × {h}" for w, h in sorted({s for _, s in other}, key=str))
            text = (
                f"{len(other)} of {things(len(own), 'photograph')} ({some([n for n, _ in other])}) have {sizes} px, "
                f"the camera {size[0]} × {size[1]} px"
            )
            remedy = "give these photographs the camera that took them, or use the originals"
            findings.append(Finding("error", where, text, remedy))
        mixed = mixed_depths([n for n, _ in own], [t.bits for _, t in own])
        if mixed:
            findings.append(Finding("error", where, mixed, MIXED_REMEDY))
        models = Counter(" ".join(filter(None, (t.make, t.model))) for _, t in own if t.model)
        focal = Counter(f"{t.focal_mm:g} mm" for _, t in own if t.focal_mm)
        bodies = Counter(f"serial number {t.serial}" for _, t in own if t.serial)
        lenses = Counter(" no. ".join(filter(None, (t.lens, t.lens_serial))) for _, t in own if t.lens or t.lens_serial)
        kinds = (("cameras", models), ("lenses", lenses), ("focal lengths", focal), ("bodies", bodies))
        for what, values in kinds:
            if len(values) > 1:
                counts = ", ".join(f"{value} ({n})" for value, n in values.most_common(4))
                text = f"its photographs were taken with different {what}: {counts}"
                findings.append(Finding("warning", where, text, "give each its own entry under cameras"))
    return findings


def _same_moment(
    project: Project, tags: Sequence[PhotographTags | None], duplicates: Sequence[Sequence[int]]
) -> list[Finding]:
    """Return the photographs of one camera, time and position that are not the same picture."""
    known = {i for group in duplicates for i in group[1:]}
    moments: defaultdict[tuple[object, ...], list[str]] = defaultdict(list)
    for i, (photograph, tag) in enumerate(zip(project.photographs, tags, strict=True)):
        if i not in known and tag is not None and tag.time is not None and tag.longitude_deg is not None:
            # The bands of a multispectral camera are taken at once, by cameras of their own.
            place = (photograph.camera, tag.time, tag.longitude_deg, tag.latitude_deg, tag.height_m)
            moments[place].append(photograph.name)
    groups = [names for names in moments.values() if len(names) > 1]
    findings = [
        Finding("warning", some(names), "same camera, time and position", "remove all but one if they are the same")
        for names in groups[:_MOST_LINES]
    ]
    if len(groups) > _MOST_LINES:
        text = f"{len(groups) - _MOST_LINES} more groups of photographs have the same camera, time and position"
        findings.append(Finding("warning", "photographs", text, "remove all but one of each"))
    return findings


# ---- all together --------------------------------------------------------------------------------------------------


def _overview(
    project: Project, tags: Sequence[PhotographTags | None], needs: MachineNeeds, twins: Sequence[Sequence[int]]
) -> Finding:
    copies = {i for group in twins for i in group[1:]}
    own = [i for i in range(len(project.photographs)) if i not in copies]
    try:
        positioned = np.asarray(np.isfinite(gnss_positions(project, tags)).all(axis=1))
    except FrameError:
        positioned = np.zeros(len(project.photographs), dtype=bool)  # the geometry's own check says so
    roles = Counter(p.role for p in project.control_points)
    heights = [t.height_above_take_off_m for t in tags if t is not None and t.height_above_take_off_m]
    facts = [
        things(len(own), "photograph"),
        things(len(project.cameras), "camera"),
        f"{int(positioned[own].sum())} with GNSS",
        things(roles["control"], "control point"),
        things(roles["check"], "check point"),
        f"{gigabytes(needs.disk_bytes)} of disk space",
        f"{gigabytes(needs.memory_bytes)} of memory",
    ]
    if heights:
        facts.insert(3, f"{np.median(heights):.0f} m above take-off")
    return Finding("note", "survey", ", ".join(facts))


def _figures(tags: Sequence[PhotographTags | None], chosen: BoolArray, name: str) -> str:
    """Return the figures of a tag of the chosen photographs (F,) in metres, in words."""
    values = {getattr(t, name) for t, is_chosen in zip(tags, chosen.tolist(), strict=True) if t and is_chosen}
    return " and ".join(f"{value:g} m" if value else "0" for value in sorted(values))


def _placeholder_findings(project: Project, tags: Sequence[PhotographTags | None]) -> list[Finding]:
    """Return which figures of the tags stand for nothing."""
    photographs, own = project.photographs, of_tags(project)
    turned = zero_attitudes(tags) & np.array([p.attitude_deg is None for p in photographs], dtype=bool)
    same, stray = constant_heights(tags) & own, stray_zero_heights(tags) & own
    flown = constant_flying_heights(tags) & np.array([p.height_above_ground_m is None for p in photographs], dtype=bool)
    heights_m = [t.height_m for t in tags if t and t.height_m]
    texts = (
        (
            turned,
            "the tags of all {count} give an attitude of 0, 0, 0: it is not used",
            "nothing, if the camera has no sensor for it; else give the attitudes under photographs.list",
        ),
        (
            same,
            f"the tags of all {{count}} give a height of {_figures(tags, same, 'height_m')}: heights are known by "
            "control points alone, without them to a kilometre",
            "give control points, or positions with heights under photographs.positions",
        ),
        (
            flown,
            f"the tags of all {{count}} give {_figures(tags, flown, 'height_above_take_off_m')} above ground, from "
            "where neighbours would show nothing in common: it is not used",
            "nothing, or give height_above_ground_m under photographs",
        ),
        (
            stray,
            f"a height of 0 in the tags, where the others have {np.median(heights_m or [0.0]):.0f} m: this GNSS "
            "position is not used",
            "nothing, or give the position under photographs.list",
        ),
    )
    names = np.array([p.name for p in photographs], dtype=object)
    in_files = [
        Finding(
            "warning",
            source,
            f"all its {len(members)} heights are the same, and the photographs' own heights above take-off are not: "
            "heights are known by control points alone, without them to a kilometre",
            "give positions with measured heights, or control points",
        )
        for source, members in constant_heights_of_files(project, tags).items()
    ]
    return in_files + [
        Finding(
            "warning",
            some(names[chosen].tolist()),
            text.format(count=things(int(chosen.sum()), "photograph")),
            remedy,
        )
        for chosen, text, remedy in texts
        if chosen.any()
    ]


def survey_findings(
    project: Project, tags: Sequence[PhotographTags | None], duplicates: Sequence[Sequence[int]] = ()
) -> list[Finding]:
    """Return everything that project and tags show together; ``tags`` are those of ``project.photographs``, None where
    a photograph cannot be read, ``duplicates`` groups of photographs that are the same."""
    findings = _placeholder_findings(project, tags)
    tags = without_zero_attitudes(tags)
    if len(project.photographs) - sum(len(group) - 1 for group in duplicates) < 2:
        text = "a survey needs at least two photographs"
        findings.append(Finding("error", "photographs", text, "give all photographs of the flight"))
    return [
        *findings,
        *camera_findings(project, tags),
        *_same_moment(project, tags, duplicates),
        *rig_findings(project, tags, duplicates),
        *gnss_findings(project, tags),
        *datum_findings(project, tags),
        *geometry_findings(project, tags),
        *height_system_findings(project, tags),
    ]


def check_survey(
    project: Project,
    headers: Sequence[PhotographHeader],
    needs: MachineNeeds,
    twins: Sequence[Sequence[int]] = (),
    free_disk_bytes: int | None = None,
    memory: int | None = None,
) -> list[Finding]:
    """Return all findings before processing: errors, then warnings, then notes.

    ``headers`` are those of ``project.photographs``, ``twins`` groups of them that are the same photograph; ``needs``
    is what the stages will take; ``free_disk_bytes`` of the working folder's disk and ``memory`` in bytes, None where
    not known.
    """
    tags = [header.tags for header in headers]
    findings = [
        *project.warnings,
        *header_findings(headers, twins, [project.cameras[p.camera].model == "fisheye" for p in project.photographs]),
        *survey_findings(project, tags, twins),
        *machine_findings(project, needs, free_disk_bytes, memory),
        _overview(project, tags, needs, twins),
    ]
    return by_severity(findings)


def by_severity(findings: Sequence[Finding]) -> list[Finding]:
    """Return findings with the errors first and the notes last."""
    order = ("error", "warning", "note")
    return sorted(findings, key=lambda finding: order.index(finding.severity))
