"""Pictures of the marks of ground points for the report, cut from the photographs: each is decoded once, and only its
patches are kept."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photogram.camera import Camera
from photogram.errors import ImageError
from photogram.files.photographs.images import read_patches
from photogram.files.records import read_record
from photogram.machine import within_half_of_memory
from photogram.pipeline.store.run import MEASURED, Run
from photogram.pipeline.store.stored_photographs import StoredPhotographs
from photogram.report.figures.mark_patches import PhotographPatch, mark_figure, reduced, shown_marks
from photogram.report.figures.page_figures import PageFigure
from photogram.report.record.ground import GroundPointRecord, MarkRecord, NotShownRecord
from photogram.sfm.tie_points.features import BYTES_PER_PX

HALF_PX, MOST_HALF_PX = 32.0, 256.0
"""Half of the side of what is shown around a mark: a target and what surrounds it; more where the adjustment puts the
point farther off."""

FINEST_PX = 97
"""Of the side of a patch, at most: larger ones are reduced."""

Patches = dict[str, dict[str, PhotographPatch]]
"""Patches by the names of point and photograph."""


@dataclass(frozen=True, eq=False)
class MarkPictures:
    """Figures of the marks of each point, and the photographs that could not be read for them."""

    figures: list[PageFigure]
    not_shown: list[NotShownRecord]


def mark_pictures(run: Run, points: Sequence[GroundPointRecord]) -> MarkPictures:
    """Return pictures of the marks of ground points; of photographs that cannot be read, why."""
    index = {name: i for i, name in enumerate(run.names)}
    of_photograph: dict[int, list[tuple[str, MarkRecord]]] = {}
    for point in points:
        for mark in shown_marks(point):
            of_photograph.setdefault(index[mark["photograph"]], []).append((point["name"], mark))
    patches: Patches = {point["name"]: {} for point in points}
    not_shown: list[NotShownRecord] = []
    ordered = sorted(of_photograph)
    largest = max((camera.width_px * camera.height_px for camera in run.project.cameras), default=1)
    at_once = within_half_of_memory(BYTES_PER_PX * largest)
    for begin in range(0, len(ordered), at_once):
        some = ordered[begin : begin + at_once]
        for i, cut in zip(some, run.executor.map(lambda i: _cut(run, i, of_photograph[i]), some), strict=True):
            if isinstance(cut, str):
                not_shown.append({"photograph": run.names[i], "reason": cut})
                continue
            for (point_name, _), patch in zip(of_photograph[i], cut, strict=True):
                patches[point_name][run.names[i]] = patch
    figures = [mark_figure(point, patches[point["name"]]) for point in points]
    return MarkPictures([figure for figure in figures if figure is not None], not_shown)


def _cut(run: Run, index: int, wanted: Sequence[tuple[str, MarkRecord]]) -> list[PhotographPatch] | str:
    """Return the patches of marks in a photograph, or why it cannot be read."""
    source = run.project.photographs[index]
    camera = run.project.cameras[source.camera]
    windows = [_window(mark, camera) for _, mark in wanted]
    boxes = [window.box for window in windows]
    try:
        pixels = read_patches(
            source.path,
            boxes,
            (camera.width_px, camera.height_px),
            run.photograph_fingerprints[index],
            run.stretch(index),
        )
    except ImageError as error:
        return str(error).removeprefix(f"photograph {source.path}: ")
    return [
        PhotographPatch(reduced(part, w.reduction), w.box[0], w.box[1], w.reduction, w.half_px)
        for part, w in zip(pixels, windows, strict=True)
    ]


@dataclass(frozen=True)
class _Window:
    """What is cut from a photograph: left, upper, right, lower, by how much it is reduced, and half of the side of what
    is shown of it."""

    box: tuple[int, int, int, int]
    reduction: int
    half_px: float


def _window(mark: MarkRecord, camera: Camera) -> _Window:
    """Return the surroundings of a mark with the place where the adjustment puts the point, where that is near."""
    off_px = max(map(abs, mark["residual_px"] or [0.0]))
    half_px = HALF_PX if off_px > 0.8 * MOST_HALF_PX else max(HALF_PX, 1.25 * off_px)
    reduction = max(1, int(np.ceil(2.0 * half_px / FINEST_PX)))
    u, v = mark["pixel"]
    left, upper = (max(0, int(np.floor(at - half_px))) for at in (u, v))
    # at least one pixel of the patch, and whole ones
    right, lower = (
        min(side, begin + reduction * max(1, int(np.ceil((at + half_px + 1.0 - begin) / reduction))))
        for at, begin, side in ((u, left, camera.width_px), (v, upper, camera.height_px))
    )
    left, upper = min(left, right - reduction), min(upper, lower - reduction)
    return _Window((left, upper, right, lower), reduction, half_px)


def mark_kinds(run: Run) -> dict[tuple[str, str], str]:
    """Return how each mark of a ground point was measured, by the names of point and photograph. A copy of a photograph
    gives its marks to the photograph itself, as in the block. Needs the stage `photographs`."""
    original = read_record(run.workspace.file("photographs", MEASURED), StoredPhotographs).original
    own, of_copies = dict[tuple[str, str], str](), dict[tuple[str, str], str]()
    for point in run.project.control_points:
        for i, kind in zip(point.mark_photograph.tolist(), point.mark_kind, strict=True):
            kinds = own if original[i] == i else of_copies
            kinds.setdefault((point.name, run.names[original[i]]), kind)
    return {**of_copies, **own}
