"""Proposals of a point as pictures, for those who look at them without the page."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from photogram.files.tables.surveyed_points import Proposal
from photogram.marking.page.patches import PatchReader, Window
from photogram.marking.targets.kinds import title_of
from photogram.report.figures.mark_patches import MarkPatch, PhotographPatch, mark_sheet, save_sheet

HALF_PX = 32
"""Of the side of a patch: a target and what surrounds it."""


def write_contact_sheets(
    folder: Path, proposals: Iterable[Proposal], numbers: Mapping[str, int], patches: PatchReader
) -> tuple[Path, ...]:
    """Write a PNG for each point that has proposals, with a patch of each, highest scores first; returns their paths.

    ``numbers`` are those of the photographs for ``patches``. Raises WorkspaceError where nothing can be written there,
    ImageError where a photograph cannot be read.
    """
    of_point: dict[str, list[Proposal]] = {}
    for proposal in proposals:
        of_point.setdefault(proposal.mark.point, []).append(proposal)
    written = []
    for n, (point, several) in enumerate(sorted(of_point.items()), 1):
        several.sort(key=lambda proposal: -proposal.score)
        path = folder / f"{n:03d}_{_plain(point)}.png"
        save_sheet(mark_sheet(f"{point}: proposed, to be confirmed", _patches(several, numbers, patches)), path)
        written.append(path)
    return tuple(written)


def _patches(proposals: Sequence[Proposal], numbers: Mapping[str, int], patches: PatchReader) -> list[MarkPatch]:
    made = []
    for proposal in proposals:
        mark = proposal.mark
        u, v = mark.pixel
        wanted = Window(round(u) - HALF_PX, round(v) - HALF_PX, 2 * HALF_PX + 1, 2 * HALF_PX + 1)
        cut = patches.window(numbers[mark.photograph], wanted)
        sigma = "" if mark.sigma_px is None else f", ± {max(mark.sigma_px):.2f} px"
        pixels = patches.pixels(numbers[mark.photograph], wanted)
        patch = PhotographPatch(pixels, cut.left, cut.upper, half_px=HALF_PX)
        made.append(MarkPatch(mark.photograph, patch, mark.pixel, "proposed", f"{title_of(mark.kind)}{sigma}"))
    return made


def _plain(name: str) -> str:
    """Return what of a point's name every file system takes."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", name)[:60].strip(".") or "point"
