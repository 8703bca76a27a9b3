"""Patches of photographs around a ground point, side by side at one scale, with what was marked or proposed in them,
and where the adjustment puts the point."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from matplotlib.font_manager import findfont
from PIL import Image, ImageColor, ImageDraw, ImageFont

from photogram.arrays import ByteArray, FloatArray
from photogram.files.atomic import make_folder, replacing
from photogram.report.figures.page_figures import PageFigure
from photogram.report.figures.style import BLUE, SKY, VERMILION, data_uri
from photogram.report.marks import UNKNOWN, by_misfit, largest_w, residual_length_px
from photogram.report.numbers.wording import signed
from photogram.report.record.ground import GroundPointRecord, MarkRecord
from photogram.wording import things

ACROSS = 5
"""Patches beside each other."""
DPI, QUALITY = 165, 82
"""Of a sheet, and as JPEG on the page, which a print takes over as it is."""
SIDE_PX, GAP_PX, WORDS_PX, TITLE_PX = 198, 13, 69, 50
WORDS_PT, TITLE_PT = 6.8, 9.0

MOST_PATCHES = 20
"""Of a point on the page: those that fit worst."""

Sign = Literal["marked", "rejected", "proposed"]
_COLOURS = {"marked": "#ffe14d", "rejected": VERMILION, "proposed": "#e9b0ff"}
_BESIDE, _TEXT = "#dfe5e9", "black"
_THICK_PX, _THIN_PX = 6, 3  # of what is drawn, black below and its colour above
_SUBPIXELS = 4  # bits of a pixel by which lines are placed


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


def mark_sheet(title: str, patches: Sequence[MarkPatch]) -> ByteArray:
    """Return a picture, RGB (rows, columns, 3), of the patches of one point; an empty ``title`` takes no room."""
    rows = -(-len(patches) // ACROSS)
    top, row_px = TITLE_PX if title else GAP_PX, SIDE_PX + WORDS_PX
    sheet = np.full((top + rows * row_px, ACROSS * (SIDE_PX + GAP_PX) + GAP_PX, 3), 255, dtype=np.uint8)
    corners = [(GAP_PX + n % ACROSS * (SIDE_PX + GAP_PX), top + n // ACROSS * row_px) for n in range(len(patches))]
    for (left, upper), patch in zip(corners, patches, strict=True):
        sheet[upper : upper + SIDE_PX, left : left + SIDE_PX] = _drawn(patch)
    picture = Image.fromarray(sheet)
    pen = ImageDraw.Draw(picture)
    pen.text((GAP_PX, 14), title, _TEXT, _font(TITLE_PT))
    for (left, upper), patch in zip(corners, patches, strict=True):
        words = f"{_short(patch.photograph)}\n{patch.words}"
        place = (left + SIDE_PX / 2, upper + SIDE_PX + 6)
        pen.multiline_text(place, words, _TEXT, _font(WORDS_PT), anchor="ma", align="center", spacing=3)
    return np.asarray(picture)


def save_sheet(sheet: ByteArray, path: Path) -> None:
    """Write a sheet as PNG, whole or not at all. Raises WorkspaceError if it cannot be written."""
    make_folder(path.parent)
    with replacing(path) as temporary:
        Image.fromarray(sheet).save(temporary, "PNG")


@cache
def _font(size_pt: float) -> ImageFont.FreeTypeFont:
    """Return the font of the other figures in a size."""
    return ImageFont.truetype(findfont("DejaVu Sans"), size_pt * DPI / 72.0)


@dataclass(frozen=True)
class _Window:
    """What of a photograph a square shows: its left and upper edge, and the square's pixels to one of its own."""

    left_px: float
    upper_px: float
    scale: float

    def places(self, *places: tuple[float, float]) -> FloatArray:
        """Return where places of the photograph (n, 2) are, in pixels of the square."""
        return (np.array(places) - (self.left_px, self.upper_px)) * self.scale - 0.5


def _drawn(patch: MarkPatch) -> ByteArray:
    """Return a patch with its signs, framed, RGB (SIDE_PX, SIDE_PX, 3)."""
    photograph, (u, v) = patch.patch, patch.mark_px
    rows, columns = (photograph.reduction * side for side in photograph.pixels.shape[:2])
    left, upper = photograph.left_px - 0.5, photograph.upper_px - 0.5
    half = photograph.half_px
    if half is None:
        half, u, v = max(rows, columns) / 2.0, left + columns / 2.0, upper + rows / 2.0
    window = _Window(u - half, v - half, SIDE_PX / (2.0 * half))
    at = (np.arange(SIDE_PX) + 0.5) / window.scale
    of_rows = np.floor((at + (window.upper_px - upper)) / photograph.reduction).astype(np.intp)
    of_columns = np.floor((at + (window.left_px - left)) / photograph.reduction).astype(np.intp)
    shown_rows = (of_rows >= 0) & (of_rows < photograph.pixels.shape[0])
    shown_columns = (of_columns >= 0) & (of_columns < photograph.pixels.shape[1])
    square = np.full((SIDE_PX, SIDE_PX, 3), ImageColor.getrgb(_BESIDE), dtype=np.uint8)
    square[np.ix_(shown_rows, shown_columns)] = photograph.pixels[
        np.ix_(of_rows[shown_rows], of_columns[shown_columns])
    ]
    unit = 2.0 * half / 30.0
    _draw(square, _sign(patch, unit), window, _COLOURS[patch.sign])
    if patch.adjusted_px is not None:
        _draw(square, [_adjusted(patch.adjusted_px, patch.mark_px, unit)], window, SKY)
    frame, width = (VERMILION, 3) if patch.sign == "rejected" else (BLUE, 1)
    for edge in (square[:width], square[-width:], square[:, :width], square[:, -width:]):
        edge[:] = ImageColor.getrgb(frame)
    return square


def _draw(square: ByteArray, lines: Sequence[Sequence[tuple[float, float]]], window: _Window, colour: str) -> None:
    """Draw lines through places of the photograph, smooth, on black."""
    places = [np.rint(window.places(*line) * 2**_SUBPIXELS).astype(np.int32) for line in lines]
    for width, shade in ((_THICK_PX, "black"), (_THIN_PX, colour)):
        cv2.polylines(square, places, False, ImageColor.getrgb(shade), width, cv2.LINE_AA, _SUBPIXELS)


def _sign(patch: MarkPatch, unit: float) -> list[list[tuple[float, float]]]:
    """Return the lines of a mark's sign."""
    u, v = patch.mark_px
    if patch.sign == "proposed":
        return [_ring((u, v), 5 * unit), [(u, v), (u, v)]]
    lines = [
        [(u + 2 * du * unit, v + 2 * dv * unit), (u + 6 * du * unit, v + 6 * dv * unit)]
        for du, dv in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    if patch.sign == "rejected":
        far = 8 * unit
        lines.append([(u, v - far), (u + far, v), (u, v + far), (u - far, v), (u, v - far)])
    return lines


def _adjusted(place: tuple[float, float], mark: tuple[float, float], unit: float) -> list[tuple[float, float]]:
    """Return a ring where the adjustment puts the point, or a line towards it where that is beyond what is shown."""
    du, dv = place[0] - mark[0], place[1] - mark[1]
    far = max(abs(du), abs(dv)) / unit
    if far <= 14:
        return _ring(place, 1.5 * unit)
    return [(mark[0] + by / far * du, mark[1] + by / far * dv) for by in (9.5, 14.0)]


def _ring(centre: tuple[float, float], radius: float) -> list[tuple[float, float]]:
    """Return a circle as a closed line."""
    turns = np.linspace(0.0, 2.0 * np.pi, 49)
    return [(centre[0] + radius * x, centre[1] + radius * y) for x, y in zip(np.cos(turns), np.sin(turns), strict=True)]


def _short(name: str) -> str:
    """Return a name that fits under a patch: its end tells photographs apart."""
    return name if len(name) <= 20 else f"…{name[-19:]}"


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


def _uri(sheet: ByteArray) -> str:
    """Return a sheet as a data URI."""
    stream = io.BytesIO()
    Image.fromarray(sheet).save(stream, "JPEG", quality=QUALITY, optimize=True, dpi=(DPI, DPI))
    return data_uri("jpeg", stream.getvalue())


def reduced(pixels: ByteArray, reduction: int) -> ByteArray:
    """Return pixels (rows, columns, 3) whose every pixel is the mean of a square of so many across; what is left over
    at the right and lower edge is cut off."""
    rows, columns = (side // reduction for side in pixels.shape[:2])
    whole = pixels[: rows * reduction, : columns * reduction].astype(np.float64)
    mean = whole.reshape(rows, reduction, columns, reduction, 3).mean(axis=(1, 3))
    return np.asarray(np.rint(mean), dtype=np.uint8)
