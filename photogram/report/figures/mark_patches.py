"""Patches of photographs around a ground point, side by side at one scale, with what was marked or proposed in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from photogram.arrays import ByteArray
from photogram.report.figures.style import BLUE, VERMILION, new_figure

ACROSS = 6
"""Patches beside each other."""
SIDE_IN = 1.35
WORDS_IN = 0.42
TITLE_IN = 0.35

Sign = Literal["marked", "rejected", "proposed"]


@dataclass(frozen=True, eq=False)
class MarkPatch:
    """A patch of a photograph."""

    photograph: str
    pixels: ByteArray
    """RGB (rows, columns, 3); the centre of the top-left pixel is at ``left_px``, ``upper_px`` of the photograph."""
    left_px: float
    upper_px: float
    mark_px: tuple[float, float]
    """Where the mark is, u and v."""
    sign: Sign
    """How it is drawn: a cross, a cross in a diamond, or a ring."""
    words: str
    """What is said of it."""


def mark_sheet(title: str, patches: Sequence[MarkPatch]) -> Figure:
    """Return a figure of the patches of one point, one at least."""
    columns = min(ACROSS, len(patches))
    rows = -(-len(patches) // columns)
    figure = new_figure(max(columns, 3) * SIDE_IN, TITLE_IN + rows * (SIDE_IN + WORDS_IN))
    figure.suptitle(title, fontsize=10, x=0.01, ha="left")
    grid = figure.subplots(rows, max(columns, 3), squeeze=False)
    for n, axes in enumerate(grid.flat):
        if n < len(patches):
            _draw(axes, patches[n])
        else:
            axes.set_axis_off()
    return figure


def _draw(axes: Axes, patch: MarkPatch) -> None:
    rows, columns = patch.pixels.shape[:2]
    left, upper = patch.left_px - 0.5, patch.upper_px - 0.5
    axes.imshow(patch.pixels, extent=(left, left + columns, upper + rows, upper), interpolation="nearest")
    u, v = patch.mark_px
    unit = columns / 30.0
    colour = {"marked": "#ffe14d", "rejected": VERMILION, "proposed": "#e9b0ff"}[patch.sign]
    for thick, shade in ((2.6, "black"), (1.2, colour)):
        if patch.sign == "proposed":
            axes.add_patch(Circle((u, v), 5 * unit, fill=False, linewidth=thick, edgecolor=shade))
            axes.plot([u], [v], ".", color=shade, markersize=thick + 1.5)
        else:
            for du, dv in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                axes.plot([u + 1.5 * du * unit, u + 5 * du * unit], [v + 1.5 * dv * unit, v + 5 * dv * unit], "-",
                          color=shade, linewidth=thick)  # fmt: skip
        if patch.sign == "rejected":
            ring = 7.5 * unit
            axes.plot([u, u + ring, u, u - ring, u], [v - ring, v, v + ring, v, v - ring], color=shade, linewidth=thick)
    axes.set_xlim(left, left + columns)
    axes.set_ylim(upper + rows, upper)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(VERMILION if patch.sign == "rejected" else BLUE)
        spine.set_linewidth(0.6)
    axes.set_xlabel(f"{_short(patch.photograph)}\n{patch.words}", fontsize=6.5, labelpad=2)


def _short(name: str) -> str:
    """Return a name that fits under a patch: its end tells photographs apart."""
    return name if len(name) <= 22 else f"…{name[-21:]}"
