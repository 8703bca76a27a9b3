"""Positions that a table or the project gives to photographs, against those in their own tags: rows of other
photographs, another map grid, another height system."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.errors import FrameError
from photogram.files.photographs.tags import PhotographTags
from photogram.project.findings import Finding
from photogram.project.measured.measured_positions import FROM_PROJECT, FROM_TAGS, positions_map_m, sigmas_of, source_of
from photogram.project.misplaced import other_reading
from photogram.project.positions.frozen import frozen_positions
from photogram.project.project import Project, ProjectPhotograph
from photogram.wording import some

SIGMAS = 4.0

COMMON_M = np.array([2.0, 2.0, 3.0])
"""Standard deviations of what a flight's tags may be off by together, whatever they state: a base station placed by
itself, another epoch of the datum, the moment of exposure."""

UNSTATED_M = np.array([5.0, 5.0, np.inf])
"""Those of tags that state none: of a receiver by itself, and a height that may be a barometer's."""

MOST = 0.8
"""Of the positions, that agree with the tags of other photographs where rows have moved."""
SHIFTS = (1, -1, 2, -2, 3, -3)
_NEXT = {1: "", 2: "second ", 3: "third "}


def _tagged_map_m(
    project: Project, photographs: Sequence[ProjectPhotograph], tags: Sequence[PhotographTags]
) -> FloatArray:
    """Return the positions (N, 3) in the tags of photographs, NaN where these have none, or the receiver had stopped.
    Raises FrameError where they lie outside the CRS."""
    bare = [replace(p, gnss_map_m=None, file_position=None) for p in photographs]
    position_m = positions_map_m(project, bare, tags)
    position_m[frozen_positions(position_m, [t.time for t in tags], [t.capture for t in tags])] = np.nan
    return position_m


def _limits_m(photographs: Sequence[ProjectPhotograph], tags: Sequence[PhotographTags]) -> FloatArray:
    """Return by how much given positions (N, 3) and those in the tags may differ."""
    given_m = np.array([sigmas_of(p, t)[0] or (0.0, 0.0, 0.0) for p, t in zip(photographs, tags, strict=True)])
    tagged_m = np.array([UNSTATED_M if t.gnss_sigma_m is None else t.gnss_sigma_m for t in tags])
    return np.asarray(SIGMAS * np.sqrt(given_m**2 + tagged_m**2 + COMMON_M**2))


def _agree(apart_m: FloatArray, limit_m: FloatArray) -> BoolArray:
    return np.asarray(np.linalg.norm(apart_m[:, :2], axis=1) <= limit_m[:, :2].max(axis=1))


def _moved_by(given_m: FloatArray, tagged_m: FloatArray, limit_m: FloatArray) -> int:
    """Return by how many photographs the rows of positions (N, 3) have moved, 0 where that explains nothing."""
    for shift in SHIFTS:
        later, own = slice(max(shift, 0), min(shift, 0) or None), slice(max(-shift, 0), min(-shift, 0) or None)
        if len(given_m[own]) > abs(shift) and np.mean(_agree(given_m[own] - tagged_m[later], limit_m[own])) >= MOST:
            return shift
    return 0


def _in_plan(
    project: Project, names: Sequence[str], given_m: FloatArray, tagged_m: FloatArray, limit_m: FloatArray
) -> tuple[str, str] | None:
    """Return what positions (N, 3) say in plan that those in the tags contradict, and the remedy."""
    far = ~_agree(given_m - tagged_m, limit_m)
    if not far.any():
        return None
    distance_m = np.linalg.norm((given_m - tagged_m)[far, :2], axis=1)
    whose = "" if far.all() else f" ({some([n for n, f in zip(names, far, strict=True) if f])})"
    text = f"{far.sum()} of {len(far)} positions{whose} lie up to {distance_m.max():.0f} m in plan from those in the "
    text += f"tags of their photographs, {limit_m[far, :2].max():.0f} m being the most where both are right"
    shift = _moved_by(given_m, tagged_m, limit_m)
    if shift:
        text += f"; each agrees with the {_NEXT[abs(shift)]}photograph {'after' if shift > 0 else 'before'} its own"
        return text, "check that no photograph or row is missing at the beginning"
    reading = other_reading(project.crs, given_m, tagged_m) if far.all() else None
    if reading is not None:
        return f"{text}; {reading[0]} they would lie among them", reading[1]
    return text, "check that rows and photographs belong together, and the CRS of the positions"


def tagged_position_findings(
    project: Project, known: Sequence[tuple[ProjectPhotograph, PhotographTags]]
) -> list[Finding]:
    """Return which given positions contradict those in the tags by more than both can be off: in plan; in height where
    the tags state how well they know it."""
    groups: defaultdict[str, list[tuple[ProjectPhotograph, PhotographTags]]] = defaultdict(list)
    for photograph, tags in known:
        source = source_of(photograph, tags)
        if source is not None and source != FROM_TAGS:
            groups[source].append((photograph, tags))
    findings = []
    for source, pairs in groups.items():
        where = "photographs.list" if source == FROM_PROJECT else source
        photographs, tags_of = [p for p, _ in pairs], [t for _, t in pairs]
        given_m = positions_map_m(project, photographs, tags_of)
        try:
            tagged_m = _tagged_map_m(project, photographs, tags_of)
        except FrameError as error:
            text = (
                f"the positions in the tags, which are not used, cannot be compared: {str(error).removeprefix('crs: ')}"
            )
            findings.append(Finding("warning", where, text, "check crs"))
            continue
        both = np.isfinite(given_m).all(axis=1) & np.isfinite(tagged_m).all(axis=1)
        if not both.any():
            continue
        names = [photographs[i].name for i in np.flatnonzero(both).tolist()]
        given_m, tagged_m, limit_m = given_m[both], tagged_m[both], _limits_m(photographs, tags_of)[both]
        plan = _in_plan(project, names, given_m, tagged_m, limit_m)
        if plan is not None:
            findings.append(Finding("warning", where, *plan))
            continue
        off_m = float(np.median(given_m[:, 2] - tagged_m[:, 2]))
        if abs(off_m) > float(np.median(limit_m[:, 2])):
            text = f"its heights lie {abs(off_m):.1f} m {'above' if off_m > 0 else 'below'} those in the tags (median)"
            remedy = (
                "check the height system of the positions (heights beside their path), and of the tags (heights.gnss)"
            )
            findings.append(Finding("warning", where, text, remedy))
    return findings
