"""The check of masks: files that do not fit their photographs, and marks of ground points in what they leave out."""

from collections.abc import Callable, Sequence

import numpy as np

from photogram.arrays import BoolArray
from photogram.project.findings import Finding
from photogram.project.project import Project
from photogram.wording import some, things

_MOST_LINES = 10


def marks_in_masks(project: Project, mask_of: Callable[[int], BoolArray | None]) -> list[str]:
    """Return the marks of ground points that lie in masked pixels, as `P1 in IMG_1.JPG`. ``mask_of`` gives which pixels
    (H, W) of a photograph are used, by its number, None for all; it is asked once for each that has marks."""
    marks = [
        (point.name, int(photograph), pixel)
        for point in project.control_points
        for photograph, pixel in zip(point.mark_photograph, point.mark_pixel, strict=True)
    ]
    masked = []
    for photograph in sorted({i for _, i, _ in marks}):
        used = mask_of(photograph)
        if used is None:
            continue
        for name, i, pixel in marks:
            column, row = np.rint(pixel).astype(np.int64).tolist()
            inside = 0 <= row < used.shape[0] and 0 <= column < used.shape[1]
            if i == photograph and inside and not used[row, column]:
                masked.append(f"{name} in {project.photographs[photograph].name}")
    return masked


def mask_findings(errors: Sequence[str], masked_marks: Sequence[str]) -> list[Finding]:
    """Return what is wrong with masks: the ``errors`` of files, and marks that lie in what masks leave out."""
    findings = [Finding("error", "masks", error.removeprefix("mask ")) for error in errors[:_MOST_LINES]]
    if len(errors) > _MOST_LINES:
        findings.append(Finding("error", "masks", f"{len(errors) - _MOST_LINES} more cannot be used"))
    if masked_marks:
        lie = "lies" if len(masked_marks) == 1 else "lie"
        text = f"{things(len(masked_marks), 'mark')} of ground points {lie} in masked pixels: {some(masked_marks)}"
        remedy = "they are used; check that the right points are marked, or that the masks fit their photographs"
        findings.append(Finding("warning", "masks", text, remedy))
    return findings
