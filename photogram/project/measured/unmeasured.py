"""What nothing measured though tags give it, taken out of what is noted of photographs."""

from collections.abc import Sequence

from photogram.files.photographs.placeholders import (
    constant_flying_heights,
    constant_heights,
    stray_zero_heights,
    zero_attitudes,
)
from photogram.files.photographs.tags import PhotographTags
from photogram.gnss import UNKNOWN_M
from photogram.project.measured.measured_block import PhotographNote
from photogram.project.measured.measured_positions import FROM_TAGS
from photogram.project.project import Project


def withdraw_position(note: PhotographNote) -> None:
    """Note that a photograph has no position; what was known of its source stays noted."""
    note["gnss_map_m"] = note["gnss_sigma_m"] = None


def withdraw_placeholders(
    project: Project, notes: Sequence[PhotographNote], tags: Sequence[PhotographTags | None]
) -> None:
    """Note that attitudes, heights of positions, positions and flying heights are unknown where placeholders stand for
    them in the ``tags`` (F,) that they come from. A height goes alone: its position counts in plan."""
    masks = zero_attitudes(tags), constant_heights(tags), stray_zero_heights(tags), constant_flying_heights(tags)
    for source, note, turned, high, stray, flown in zip(
        project.photographs, notes, *(mask.tolist() for mask in masks), strict=True
    ):
        sigma_m, of_tags = note["gnss_sigma_m"], note.get("gnss_source") == FROM_TAGS
        if turned and source.attitude_deg is None:
            note["attitude_deg"] = None
        if high and of_tags and sigma_m is not None:
            note["gnss_sigma_m"] = [*sigma_m[:2], UNKNOWN_M]
        if stray and of_tags:
            withdraw_position(note)
        if flown and source.height_above_ground_m is None:
            note["height_above_ground_m"] = None
