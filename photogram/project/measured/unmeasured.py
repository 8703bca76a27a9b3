"""What nothing measured though tags give it, taken out of what is noted of photographs."""

from collections import defaultdict
from collections.abc import Sequence
from itertools import chain

import numpy as np

from photogram.files.photographs.placeholders import (
    FEWEST,
    constant_flying_heights,
    constant_heights,
    is_no_height,
    stray_zero_heights,
    zero_attitudes,
)
from photogram.files.photographs.tags import PhotographTags
from photogram.gnss import UNKNOWN_M
from photogram.project.measured.measured_block import PhotographNote
from photogram.project.measured.measured_positions import FROM_TAGS
from photogram.project.project import Project

ALIKE_M = 0.01
"""Between the highest and the lowest of heights that are the same figure: a geoid bends them by millimetres."""


def withdraw_position(note: PhotographNote) -> None:
    """Note that a photograph has no position; what was known of its source stays noted."""
    note["gnss_map_m"] = note["gnss_sigma_m"] = None


def constant_heights_of_files(project: Project, tags: Sequence[PhotographTags | None]) -> dict[str, list[int]]:
    """Return the photographs of each file of positions whose heights are one, and none that was measured."""
    of_file = defaultdict[str, list[int]](list)
    for i, photograph in enumerate(project.photographs):
        if photograph.gnss_map_m is None and photograph.file_position is not None:
            of_file[photograph.file_position.source].append(i)
    constant = {}
    for source, members in of_file.items():
        own = [project.photographs[i].file_position for i in members]
        heights_m = np.array([position.position_map_m[2] for position in own if position is not None])
        if len(members) >= FEWEST and np.ptp(heights_m) < ALIKE_M and is_no_height(tags, members, heights_m[0]):
            constant[source] = members
    return constant


def withdraw_placeholders(
    project: Project, notes: Sequence[PhotographNote], tags: Sequence[PhotographTags | None]
) -> None:
    """Note that attitudes, heights of positions, positions and flying heights are unknown where placeholders stand for
    them in the ``tags`` (F,) that they come from. A height goes alone: its position counts in plan."""
    of_files = set(chain.from_iterable(constant_heights_of_files(project, tags).values()))
    masks = zero_attitudes(tags), constant_heights(tags), stray_zero_heights(tags), constant_flying_heights(tags)
    for i, (source, note, turned, high, stray, flown) in enumerate(
        zip(project.photographs, notes, *(mask.tolist() for mask in masks), strict=True)
    ):
        sigma_m, of_tags = note["gnss_sigma_m"], note.get("gnss_source") == FROM_TAGS
        if turned and source.attitude_deg is None:
            note["attitude_deg"] = None
        if ((high and of_tags) or i in of_files) and sigma_m is not None:
            note["gnss_sigma_m"] = [*sigma_m[:2], UNKNOWN_M]
        if stray and of_tags:
            withdraw_position(note)
        if flown and source.height_above_ground_m is None:
            note["height_above_ground_m"] = None
