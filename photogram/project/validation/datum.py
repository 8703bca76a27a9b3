"""Whether the positions in the photographs' tags come into the datum of the map as well as they can.

Positions of a file are looked at where the file is read (photogram.project.heights.ProjectMap).
"""

from collections.abc import Sequence

import numpy as np

from photogram.errors import FrameError
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.crs import WGS84, changes_datum, datum_change, middle_deg
from photogram.project.findings import Finding
from photogram.project.measured.measured_positions import FROM_TAGS, sigmas_of, source_of
from photogram.project.project import Project

USUAL_M = 1.0
"""Accuracy of taking WGS 84 and a continent's own frame as one; where it is no worse, nothing is said of it."""


def datum_findings(project: Project, tags: Sequence[PhotographTags | None]) -> list[Finding]:
    """Return whether a grid is missing on the way from WGS 84 to the map, and how good that way is where it is less
    good than the positions; ``tags`` are those of ``project.photographs``."""
    pairs = [(p, t) for p, t in zip(project.photographs, tags, strict=True) if t is not None]
    tagged = [(p, t) for p, t in pairs if source_of(p, t) == FROM_TAGS]
    declared, changing = project.datum, changes_datum(WGS84, project.crs)
    of_files = any(p.file_position is not None and p.file_position.of_other_datum for p in project.photographs)
    if declared.accuracy_m is not None and not of_files and not (tagged and changing):
        text = "no GNSS position comes from another datum than the map's: it has no effect"
        return [Finding("note", "datum_accuracy_m", text, "remove it")]
    if not tagged or not changing:
        return []
    place = middle_deg(WGS84, np.array([(t.longitude_deg, t.latitude_deg) for _, t in tagged], dtype=np.float64))
    if place is None:
        return []  # positions nowhere on the globe are named with their photographs
    try:
        change = datum_change(WGS84, project.crs, place, declared.grid)
    except FrameError:
        return []  # the positions cannot be transformed either, which says what is wrong with the grid
    if change.missing is not None and declared.accuracy_m is None:
        accepted = "" if change.accuracy_m is None else f": {change.accuracy_m:g}"
        remedy = (
            f"{change.missing.remedy}, or accept what is lost with datum_accuracy_m{accepted}, which then counts in "
            "every predicted standard deviation"
        )
        return [Finding("error", "crs", change.loss, remedy)]
    believed = [s for pair in tagged if (s := sigmas_of(*pair)[0]) is not None]
    plan_m = float(np.median([np.hypot(s[0], s[1]) / np.sqrt(2.0) for s in believed])) if believed else np.inf
    if declared.accuracy_m is not None or change.accuracy_m is None or change.accuracy_m <= plan_m:
        return []
    if change.is_null and change.accuracy_m <= USUAL_M:
        return []
    how = "are taken as those of" if change.is_null else "are brought to"
    text = (
        f"GNSS positions in {change.source} {how} {change.target} by {change.operation}, accurate to "
        f"{change.accuracy_m:g} m as PROJ states"
    )
    remedy = "give datum_accuracy_m to count it; positions of an RTK network in the datum of the map are better"
    return [Finding("note", "crs", text, remedy)]
