"""Patches of photographs around a ground point, side by side at one scale, with what was marked or proposed in them,
and where the adjustment puts the point."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from photogram.arrays import ByteArray
from photogram.report.figures.page_figures import PageFigure
from photogram.report.figures.style import BLUE, SKY, VERMILION, data_uri, new_figure, write_figure
from photogram.report.marks import UNKNOWN, by_misfit, largest_w, residual_length_px
from photogram.report.numbers.wording import signed
from photogram.report.record.ground import GroundPointRecord, MarkRecord
from photogram.wording import things

ACROSS = 5
"""Patches beside each other."""
SIDE_IN, GAP_IN = 1.2, 0.08
WORDS_IN, TITLE_IN = 0.42, 0.3
POINTS = 6.8
"""Size of the words."""

MOST_PATCHES = 20
"""Of a point on the page: those that fit worst."""

DPI, QUALITY = 165, 82
"""Of a sheet on the page, as JPEG, which a print takes over as it is."""

Sign = Literal["marked", "rejected", "proposed"]
_COLOURS = {"marked": "#ffe14d", "rejected": VERMILION, "proposed": "#e9b0ff"}
_THICK, _THIN = 2.8, 1.4  # of what is drawn, black below and its colour above


@dataclass(frozen=True, eq=False)
class PhotographPatch:
    """What a photograph shows around a mark."""

    pixels: ByteArray
    """RGB (rows, columns, 3); the centre of the photograph's pixel in its top-left corner is at ``left_px``,
    ``upper_px``."""
    left_px: float
    upper_px: float
    reduction: int = 1
    """Of how many of the photograph's pixels, across, one of the patch is the mean."""
    half_px: float | None = None
    """Half of the side of what is drawn around the mark; None for the whole patch."""


@dataclass(frozen=True, eq=False)
class MarkPatch:
    """A patch of a photograph, with what was marked in it."""

    photograph: str
    patch: PhotographPatch
    mark_px: tuple[float, float]
    """Where the mark is, u and v."""
    sign: Sign
    """How it is drawn: a cross, a cross in a diamond, or a ring with a dot."""
    words: str
    """What is said of it."""
    adjusted_px: tuple[float, float] | None = None
    """Where the adjustment puts the point, drawn as a ring; None where that is not known."""


def mark_sheet(title: str, patches: Sequence[MarkPatch]) -> Figure:
    """Return a figure of the patches of one point, one at least; an empty ``title`` takes no room."""
    rows = -(-len(patches) // ACROSS)
    top, row_in = TITLE_IN if title else GAP_IN, SIDE_IN + WORDS_IN
    width, height = ACROSS * (SIDE_IN + GAP_IN) + GAP_IN, top + rows * row_in
    figure = new_figure(width, height)
    figure.set_layout_engine("none")  # places are reckoned here, in a tenth of the time
    if title:
        figure.text(GAP_IN / width, 1.0 - 0.06 / height, title, fontsize=9, va="top", ha="left")
    for n, patch in enumerate(patches):
        row, column = divmod(n, ACROSS)
        left, upper = GAP_IN + column * (SIDE_IN + GAP_IN), top + row * row_in
        place = (left / width, 1.0 - (upper + SIDE_IN) / height, SIDE_IN / width, SIDE_IN / height)
        _draw(figure.add_axes(place), patch)
    return figure


def _draw(axes: Axes, patch: MarkPatch) -> None:
    photograph, (u, v) = patch.patch, patch.mark_px
    rows, columns = (photograph.reduction * side for side in photograph.pixels.shape[:2])
    left, upper = photograph.left_px - 0.5, photograph.upper_px - 0.5
    whole = (left, left + columns, upper + rows, upper)
    axes.imshow(photograph.pixels, extent=whole, interpolation="nearest")
    half = photograph.half_px
    limits = whole if half is None else (u - half, u + half, v + half, v - half)
    unit = (limits[1] - limits[0]) / 30.0
    for thick, shade in ((_THICK, "black"), (_THIN, _COLOURS[patch.sign])):
        _sign(axes, patch, unit, thick, shade)
    if patch.adjusted_px is not None:
        for thick, shade in ((_THICK, "black"), (_THIN, SKY)):
            _adjusted(axes, patch.adjusted_px, (u, v), unit, thick, shade)
    axes.set_xlim(limits[:2])
    axes.set_ylim(limits[2:])
    axes.set_facecolor("#dfe5e9")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(VERMILION if patch.sign == "rejected" else BLUE)
        spine.set_linewidth(1.4 if patch.sign == "rejected" else 0.6)
    axes.set_xlabel(f"{_short(patch.photograph)}\n{patch.words}", fontsize=POINTS, labelpad=2, linespacing=1.25)


def _sign(axes: Axes, patch: MarkPatch, unit: float, thick: float, shade: str) -> None:
    u, v = patch.mark_px
    if patch.sign == "proposed":
        axes.add_patch(Circle((u, v), 5 * unit, fill=False, linewidth=thick, edgecolor=shade))
        axes.plot([u], [v], ".", color=shade, markersize=thick + 1.5)
        return
    for du, dv in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        axes.plot([u + 2 * du * unit, u + 6 * du * unit], [v + 2 * dv * unit, v + 6 * dv * unit], "-",
                  color=shade, linewidth=thick)  # fmt: skip
    if patch.sign == "rejected":
        ring = 8 * unit
        axes.plot([u, u + ring, u, u - ring, u], [v - ring, v, v + ring, v, v - ring], color=shade, linewidth=thick)


def _adjusted(
    axes: Axes, place: tuple[float, float], mark: tuple[float, float], unit: float, thick: float, shade: str
) -> None:
    """Draw a ring where the adjustment puts the point, or a line towards it where that is beyond what is shown."""
    du, dv = place[0] - mark[0], place[1] - mark[1]
    far = max(abs(du), abs(dv)) / unit
    if far <= 14:
        axes.add_patch(Circle(place, 1.5 * unit, fill=False, linewidth=thick, edgecolor=shade))
        return
    inner, outer = 9.5 / far, 14 / far
    axes.plot([mark[0] + inner * du, mark[0] + outer * du], [mark[1] + inner * dv, mark[1] + outer * dv], "-",
              color=shade, linewidth=thick)  # fmt: skip


def _short(name: str) -> str:
    """Return a name that fits under a patch: its end tells photographs apart."""
    return name if len(name) <= 22 else f"…{name[-21:]}"


# ---- on the page ---------------------------------------------------------------------------------------------------


def figure_key(point: str) -> str:
    """Return the key of the figure of a point's marks."""
    return f"marks {point}"


def shown_marks(point: GroundPointRecord) -> list[MarkRecord]:
    """Return the marks of a point whose patches are shown: of many those that fit worst."""
    return by_misfit(point["marks"])[:MOST_PATCHES]


def mark_figure(point: GroundPointRecord, patches: Mapping[str, PhotographPatch]) -> PageFigure | None:
    """Return the marks of a point in the patches that photographs gave, by their names; None without any."""
    marks = [mark for mark in shown_marks(point) if mark["photograph"] in patches]
    if not marks:
        return None
    total, name = len(point["marks"]), point["name"]
    some = f"{len(marks)} of {things(total, 'mark')}" if len(marks) < total else things(total, "mark")
    caption = f"{name}: {some}, those first that fit worst."
    sheet = mark_sheet("", [_patch(mark, patches[mark["photograph"]]) for mark in marks])
    return PageFigure(figure_key(name), caption, f"Patches of photographs with {some} of {name}", _uri(sheet))


def _patch(mark: MarkRecord, patch: PhotographPatch) -> MarkPatch:
    (u, v), residual_px = mark["pixel"], mark["residual_px"]
    return MarkPatch(
        mark["photograph"],
        patch,
        (u, v),
        "rejected" if mark["left_out"] else "marked",
        _words(mark),
        None if residual_px is None else (u + residual_px[0], v + residual_px[1]),
    )


def _words(mark: MarkRecord) -> str:
    """Return how a mark was measured with its sigma, and below how it fits."""
    sigma = f" ± {mark['sigma_px']:.2g} px" if "sigma_px" in mark else ""
    length, w = residual_length_px(mark), largest_w(mark)
    fit = "not adjusted" if length is None else f"Δ {length:.2f} px" if length < 100 else f"Δ {length:.0f} px"
    tested = "rejected, " if mark["left_out"] else ""
    return f"{mark.get('kind', UNKNOWN)}{sigma}\n{tested}{fit}{'' if w is None else f', w {signed(w, 1)}'}"


def _uri(figure: Figure) -> str:
    """Return a figure as a data URI, as large as it is on the page with some to spare."""
    stream = io.BytesIO()
    figure.dpi = DPI
    write_figure(figure, stream, "jpeg", pil_kwargs={"quality": QUALITY, "optimize": True})
    return data_uri("jpeg", stream.getvalue())


def reduced(pixels: ByteArray, reduction: int) -> ByteArray:
    """Return pixels (rows, columns, 3) whose every pixel is the mean of a square of so many across; what is left over
    at the right and lower edge is cut off."""
    rows, columns = (side // reduction for side in pixels.shape[:2])
    whole = pixels[: rows * reduction, : columns * reduction].astype(np.float64)
    mean = whole.reshape(rows, reduction, columns, reduction, 3).mean(axis=(1, 3))
    return np.asarray(np.rint(mean), dtype=np.uint8)
