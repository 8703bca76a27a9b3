"""Pictures of a finished survey: matches, surface, comparisons, residuals.

`save_picture` writes a figure as PNG, whole or not at all, the same bytes for the same data. Colours can be told apart
with every kind of colour vision (Okabe & Ito 2008; diverging scale of Brewer). Figures are drawn through matplotlib's
object interface: no global state, no display.
"""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LightSource, Normalize
from matplotlib.figure import Figure
from matplotlib.offsetbox import AnchoredOffsetbox, AnchoredText, AuxTransformBox, TextArea, VPacker
from matplotlib.patches import Rectangle
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, MaxNLocator, ScalarFormatter
from scipy.ndimage import distance_transform_edt

from photogram.arrays import BoolArray, ByteArray, FloatArray, IntArray
from photogram.camera import Camera, LensField
from photogram.files.atomic import make_folder, replacing
from photogram.grid import MapGrid, decimated
from photogram.languages.language import ENGLISH, Language
from photogram.measures.round_lengths import round_down, round_up
from photogram.quality.cloud_comparison import Comparison
from photogram.survey import Raster
from photogram.wording import percent

BLUE, ORANGE, VERMILION, GREEN, SKY = "#0072B2", "#E69F00", "#D55E00", "#009E73", "#56B4E9"
GREY, PAGE_DPI = "#666666", 130
MAXIMUM_LINES = 300
MAXIMUM_ARROWS = 400
MAXIMUM_DOTS = 20_000
MAXIMUM_RASTER_PX = 1400


class _PlainFigure(Figure):
    """A figure whose texts are what they say: a ``$`` in the name of a point begins no formula."""

    def draw(self, renderer: RendererBase) -> None:
        _make_plain(self)
        super().draw(renderer)


def _make_plain(figure: Figure) -> None:
    for text in figure.findobj(Text):
        text.set_parse_math(False)


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure of this size whose parts make room for each other."""
    figure = _PlainFigure(figsize=(width_in, height_in), dpi=PAGE_DPI, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def settle_layout(figure: Figure) -> None:
    """Give the parts of a figure their places, which stay: the layout settles in two passes, and needs no drawing."""
    engine = figure.get_layout_engine()
    if engine is None:
        return
    _make_plain(figure)
    for _ in range(2):
        engine.execute(figure)
    figure.set_layout_engine("none")
    for axes in figure.axes:
        locator: Any = axes.get_axes_locator()  # of colour bars; it draws nothing
        axes.apply_aspect(None if locator is None else locator(axes, None))


_FAST_PNG: Mapping[str, object] = {"compress_level": 2}  # half the time of level 6, files 5 % larger

_PRINTED = {
    "png": (FigureCanvasAgg, "print_png"),
    "jpeg": (FigureCanvasAgg, "print_jpg"),
    "svg": (FigureCanvasSVG, "print_svg"),
}


def write_figure(
    figure: Figure, target: Path | BinaryIO, kind: Literal["png", "jpeg", "svg"], **options: Mapping[str, object]
) -> None:
    """Draw a figure and write it as a picture, with ``options`` of matplotlib's canvas; ``savefig`` draws one that has
    a layout twice."""
    canvas, method = _PRINTED[kind]
    getattr(canvas(figure), method)(target, **options)


def save_picture(figure: Figure, path: Path) -> None:
    """Write the figure as PNG, whole or not at all, without date or program name; where it is drawn again its parts
    stand where they stood. Raises WorkspaceError if it cannot be written.
    """
    make_folder(path.parent)
    with replacing(path) as temporary:
        write_figure(figure, temporary, "png", metadata={"Software": None}, pil_kwargs=_FAST_PNG)
    figure.set_layout_engine("none")  # which else measures every text once more


def data_uri(kind: Literal["jpeg", "svg+xml"], picture: bytes) -> str:
    """Return the bytes of a picture as an address that holds them."""
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode('ascii')}"


def length_label(length_m: float, language: Language = ENGLISH) -> str:
    """Return a length with a unit that suits it: 2 mm, 5 cm, 20 m, 1 km."""
    for unit, size in (("km", 1000.0), ("m", 1.0), ("cm", 0.01)):
        if length_m >= size * (1 - 1e-9):
            return f"{language.figure(f'{length_m / size:.3g}')} {unit}"
    return f"{language.figure(f'{length_m * 1000:.3g}')} mm"


class _TickFigures(ScalarFormatter):
    """Figures of ticks as a language writes them."""

    def __init__(self, language: Language) -> None:
        super().__init__()
        self.language = language

    def __call__(self, x: float, pos: int | None = None) -> str:
        return self.language.figure(super().__call__(x, pos))


EASTING, NORTH, NORTH_UP, HEIGHTS = "easting, m", "N", "N ↑", "height, m (grey: no data)"
"""Texts of maps that mean nothing on a plane that is not level."""


def map_axes(axes: Axes, language: Language = ENGLISH) -> None:
    """Make axes a map: metres without an offset, equal scales, few ticks, a north arrow and a scale bar."""
    axes.set_aspect("equal", adjustable="box")
    label = FuncFormatter(lambda value, _: f"{value:,.0f}".replace(",", " "))
    width, height = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10], integer=True))
        axis.set_major_formatter(label)
    axes.tick_params(labelsize=8)
    axes.tick_params(axis="y", labelrotation=90)
    for tick in axes.get_yticklabels():
        tick.set_verticalalignment("center")
    axes.set_xlabel(language.gettext(EASTING), fontsize=9)
    axes.set_ylabel(language.gettext("northing, m"), fontsize=9)
    bar_m = round_down(width / 4)
    bar = AuxTransformBox(axes.transData)
    bar.add_artist(Rectangle((0, 0), bar_m, 0.006 * height, facecolor="black"))
    packed = VPacker(
        children=[bar, TextArea(length_label(bar_m, language), textprops={"size": 8})], align="center", pad=0, sep=3
    )
    axes.add_artist(AnchoredOffsetbox("lower left", child=packed, pad=0.4, borderpad=0.6))
    arrow = {"arrowstyle": "-|>", "color": "black", "shrinkA": 0, "shrinkB": 0}
    axes.annotate(
        NORTH, (0.95, 0.98), (0, -24), "axes fraction", "offset points", arrow, ha="center", va="top", fontweight="bold"
    )


def plain_axes(axes: Axes) -> None:
    """Make axes a plain diagram: small figures and labels, and no frame above and on the right."""
    axes.tick_params(labelsize=8)
    axes.xaxis.label.set_fontsize(9)
    axes.yaxis.label.set_fontsize(9)
    axes.spines[["top", "right"]].set_visible(False)


def map_figure(shape: tuple[int, ...], widest_in: float, beside_in: float) -> Figure:
    """Return an empty figure for a map of so many rows and columns, ``widest_in`` inches wide at most, with room on its
    right."""
    rows, columns = shape
    width = float(np.clip(18 / 17 * widest_in * columns / rows, 3.0, widest_in))
    return new_figure(width + beside_in, max(width * rows / columns, 2.0) + 0.9)


def relabel_plane(figure: Figure, language: Language = ENGLISH) -> None:
    """Turn the maps of a figure into views of a plane that is not level: x and y in place of easting and northing, no
    north arrow, distances in place of heights."""
    for axes in figure.axes:
        if axes.get_xlabel() == language.gettext(EASTING):
            axes.set_xlabel(language.gettext("x, to the right along the plane, m"), fontsize=9)
            axes.set_ylabel(language.gettext("y, up the plane, m"), fontsize=9)
        if axes.get_ylabel() == language.gettext(HEIGHTS):
            axes.set_ylabel(language.gettext("in front of the plane, m (grey: no data)"), fontsize=9)
        for text in [text for text in axes.texts if text.get_text() in (NORTH, NORTH_UP)]:
            text.remove()


def _evenly(count: int, maximum: int) -> IntArray:
    """Return at most ``maximum`` indices below ``count``, spread evenly over the order the data came in."""
    return (
        np.unique(np.linspace(0, count - 1, min(count, maximum)).round().astype(np.int64))
        if count
        else np.zeros(0, np.int64)
    )


def candidate_and_verified_matches(
    path: Path,
    left_rgb: ByteArray,
    right_rgb: ByteArray,
    left_px: FloatArray,
    right_px: FloatArray,
    verified_mask: BoolArray,
    title: str,
) -> None:
    """Draw two photographs (rows, columns, 3) side by side with their candidate matches, the verified ones on top.

    ``left_px`` and ``right_px`` (M, 2) are pixels of the photographs as given, ``verified_mask`` (M,). At most
    MAXIMUM_LINES are drawn, rejected and verified in their true proportion. Raises WorkspaceError when the file
    cannot be written.
    """
    scale = min(1.0, 900 / max(left_rgb.shape[1], right_rgb.shape[1]))
    left, right = _reduced(left_rgb, scale), _reduced(right_rgb, scale)
    gap = 12
    shift = np.array([left.shape[1] + gap, 0])
    canvas = np.full((max(len(left), len(right)), shift[0] + right.shape[1], 3), 255, dtype=np.uint8)
    canvas[: len(left), : left.shape[1]] = left
    canvas[: len(right), shift[0] :] = right
    segments = np.stack([(left_px + 0.5) * scale - 0.5, (right_px + 0.5) * scale - 0.5 + shift], axis=1)

    figure = new_figure(13, 13 * canvas.shape[0] / canvas.shape[1] + 0.9)
    axes = figure.add_subplot()
    axes.imshow(canvas, interpolation="none")
    total, verified = len(segments), int(verified_mask.sum())
    drawn = min(total, MAXIMUM_LINES)
    rejected_lines = round(drawn * (total - verified) / max(1, total))
    for name, mask, count, colour in (
        ("rejected", ~verified_mask, rejected_lines, ORANGE),
        ("verified", verified_mask, drawn - rejected_lines, SKY),
    ):
        chosen = segments[mask][_evenly(int(mask.sum()), count)]
        axes.add_collection(LineCollection(list(chosen), colors=colour, linewidths=0.9, alpha=0.75, label=name))
        axes.plot(*chosen.reshape(-1, 2).T, ".", color=colour, markersize=3, markeredgewidth=0)
    axes.set_axis_off()
    axes.set_title(title, fontsize=12)
    part = f" ({percent(verified / total)})" if total else ""
    legend = axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2, frameon=False, fontsize=9)
    counts = f"{verified} verified{part}, {total - verified} rejected"
    legend.set_title(f"{total} candidate matches: {counts}; {drawn} drawn")
    for line in legend.get_lines():
        line.set(linewidth=3, alpha=1)
    save_picture(figure, path)


def _reduced(rgb: ByteArray, scale: float) -> ByteArray:
    size = (max(1, round(rgb.shape[1] * scale)), max(1, round(rgb.shape[0] * scale)))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def shaded_relief(raster: Raster) -> tuple[FloatArray, ScalarMappable, float]:
    """Return a surface lit from the north-west and tinted by height (rows, columns, 4), 0 to 1, alpha 0 without data;
    what tints it; and the size of its cells, m, of which a picture has few enough."""
    small, _ = decimated(raster, MAXIMUM_RASTER_PX)
    values, cell_m = small.values.astype(np.float64), small.cell_m
    known = np.isfinite(values)
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled = values[tuple(nearest)] if known.any() else np.zeros_like(values)
    low, high = np.percentile(filled[known], [0.5, 99.5]) if known.any() else (0.0, 1.0)
    tint = ScalarMappable(Normalize(low, max(high, low + 1e-3)), "viridis")
    colours = tint.to_rgba(filled)[..., :3]
    light = LightSource(azdeg=315, altdeg=45)
    shaded = light.shade_rgb(colours, filled, blend_mode="soft", vert_exag=2.5, dx=cell_m, dy=cell_m)
    return np.dstack([shaded, known.astype(np.float64)]), tint, cell_m


def surface_figure(
    raster: Raster, title: str = "", widest_in: float = 8.5, *, upright: bool = False, language: Language = ENGLISH
) -> Figure:
    """Draw a surface, in plan or on an ``upright`` plane, lit from the north-west, tinted by height, with a colour bar;
    cells without data stay grey.

    The map is ``widest_in`` inches wide at most.
    """
    picture, tint, cell_m = shaded_relief(raster)
    figure = map_figure(picture.shape[:2], widest_in, 1.6)
    axes = figure.add_subplot(facecolor="#dddddd")
    grid = MapGrid(raster.west_map_m, raster.north_map_m, cell_m, *picture.shape[:2])
    axes.imshow(picture, extent=grid.extent_map_m, interpolation="nearest")
    map_axes(axes, language)
    axes.set_title(title, fontsize=12)
    bar = figure.colorbar(tint, ax=axes, shrink=0.8, extend="both", pad=0.02, format=_TickFigures(language))
    bar.set_label(language.gettext(HEIGHTS), fontsize=9)
    bar.ax.tick_params(labelsize=8)
    if upright:
        relabel_plane(figure, language)
    return figure


def comparison_figure(comparisons: Mapping[str, Comparison], *, upright: bool = False) -> Figure:
    """Draw height differences of clouds to their reference: a map and a histogram each, on one scale for all.

    The clouds stand side by side, or one below the other for a page that is ``upright``. Raises ValueError without a
    comparison.
    """
    if not comparisons:
        raise ValueError("no comparison to draw")
    reach_m = max(float(np.nanpercentile(np.abs(c.surface_difference_m), 95)) for c in comparisons.values())
    limit_m = round_up(max(reach_m, 1e-3))
    every = np.concatenate([c.position_map_m[:, :2] for c in comparisons.values()])
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.03 * (high - low).max() + 1e-3
    aspect = float(np.clip((high - low + 2 * margin)[1] / (high - low + 2 * margin)[0], 0.4, 1.8))

    count = len(comparisons)
    if upright:
        figure = new_figure(7.2, min(3.4 * aspect + 0.6, 3.2) * count)
        panels = figure.subplots(count, 2, squeeze=False, width_ratios=[1.35, 1.0]).T
    else:
        figure = new_figure(4.3 * count + 1.0, 4.0 * aspect + 3.8)
        panels = figure.subplots(2, count, squeeze=False, height_ratios=[4.0 * aspect, 2.4])
    scale = ScalarMappable(Normalize(-limit_m, limit_m), "RdBu_r")
    for column, (name, comparison) in enumerate(comparisons.items()):
        top, bottom = panels[:, column]
        _difference_map(top, comparison, scale)
        top.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
        map_axes(top)
        top.set_title(name, fontsize=12)
        _difference_histogram(bottom, comparison, limit_m)
        if column and not upright:
            top.set_ylabel("")
            bottom.set_ylabel("")
        if upright:
            top.yaxis.set_major_locator(MaxNLocator(nbins=2, steps=[1, 2, 5, 10], integer=True))
            bottom.set_ylim(top=1.55 * bottom.get_ylim()[1])  # the statistics stand above the bars
        if upright and column < count - 1:
            top.set_xlabel("")
            bottom.set_xlabel("")
    bar = figure.colorbar(scale, ax=panels[0, :].tolist(), extend="both", shrink=0.85, pad=0.02)
    bar.set_label("cloud minus reference, m", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    return figure


def _difference_map(axes: Axes, comparison: Comparison, scale: ScalarMappable) -> None:
    known = np.flatnonzero(np.isfinite(comparison.surface_difference_m))
    drawn = known[_evenly(len(known), MAXIMUM_DOTS)]
    size = float(np.clip(20_000 / max(len(drawn), 1), 1.5, 16.0))
    axes.set_facecolor("#c8c8c8")
    easting, northing = comparison.position_map_m[drawn, :2].T
    colours = scale.to_rgba(comparison.surface_difference_m[drawn])
    axes.scatter(easting, northing, s=size, color=colours, linewidths=0, rasterized=True)


def _difference_histogram(axes: Axes, comparison: Comparison, limit_m: float) -> None:
    figures = comparison.cloud_to_surface
    known = comparison.surface_difference_m[np.isfinite(comparison.surface_difference_m)]
    inside = known[np.abs(known) <= limit_m]
    axes.hist(inside, bins=60, range=(-limit_m, limit_m), color=SKY, edgecolor="none")
    axes.axvline(figures.median_m, color=VERMILION, linewidth=1.2)
    axes.set_xlim(-limit_m, limit_m)
    axes.set_ylim(top=axes.get_ylim()[1] * 1.05)
    axes.tick_params(labelsize=8)
    axes.set_xlabel("cloud minus reference, m", fontsize=9)
    axes.set_ylabel("points", fontsize=9)
    outside = 1 - len(inside) / len(known)
    text = (
        f"{figures.compared} of {figures.points} points\nmean {figures.mean_m:+.3f} m\nstd {figures.std_m:.3f} m\n"
        f"median {figures.median_m:+.3f} m\nNMAD {figures.nmad_m:.3f} m\noff the scale {percent(outside, 1)}"
    )
    axes.add_artist(AnchoredText(text.replace("-", "−"), "upper left", prop={"size": 8}, frameon=False, pad=0.2))


def residual_figure(
    camera: Camera, pixel: FloatArray, residual_px: FloatArray, title: str = "", width_in: float = 9.5
) -> Figure:
    """Draw residuals (N, 2) px at their pixels (N, 2) over the camera's picture plane, enlarged, with a scale arrow.

    More than MAXIMUM_ARROWS residuals are averaged over a grid, which shows what the camera model leaves and hides
    the noise.
    """
    side_px, averaged = camera.width_px / 24, len(pixel) > MAXIMUM_ARROWS
    root, vector, count = _grid_means(pixel, residual_px, side_px) if averaged else (pixel, residual_px, np.ones(1))
    typical_px = float(np.percentile(np.hypot(*vector.T), 95)) if len(vector) else 0.0
    enlargement = round_down((1.2 if averaged else 2.5) * side_px / max(typical_px, 1e-6))
    figure = new_figure(width_in, (width_in - 0.3) * camera.height_px / camera.width_px + 1.5)
    axes = figure.add_subplot()
    axes.add_patch(Rectangle((-0.5, -0.5), camera.width_px, camera.height_px, facecolor="#f4f4f4", edgecolor=GREY))
    arrows = axes.quiver(
        *root.T, *vector.T, angles="xy", scale_units="xy", scale=1 / enlargement, color=BLUE, width=0.0022, headwidth=4
    )
    axes.plot(*root.T, ".", color=BLUE, markersize=2)
    axes.plot(*camera.principal_point_px, "+", color=VERMILION, markersize=12, label="principal point")
    axes.set(xlim=(-side_px, camera.width_px + side_px), ylim=(camera.height_px + side_px, -side_px), aspect="equal")
    axes.tick_params(labelsize=8)
    axes.set_xlabel("u, px", fontsize=9)
    axes.set_ylabel("v, px", fontsize=9)
    rms_px = float(np.sqrt(np.mean(residual_px**2))) if len(residual_px) else 0.0
    drawn = f"means on a grid of {side_px:.0f} px, about {np.median(count):.0f} each" if averaged else "each drawn"
    if title:
        figure.suptitle(title, fontsize=12)
    axes.set_title(f"{len(pixel)} residuals, RMS {rms_px:.2f} px per coordinate; {drawn}", fontsize=9, pad=24)
    key_px = round_down(1.5 * side_px / enlargement)
    label = f"{key_px:g} px (enlarged {enlargement:g} times)"
    axes.quiverkey(arrows, 0.05, 1.03, key_px, label, labelpos="E", fontproperties={"size": 9})
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
    return figure


def field_figure(
    camera: Camera, field: LensField, covariance_px2: FloatArray, title: str = "", width_in: float = 9.5
) -> Figure:
    """Draw the lens field of a camera over its picture plane, shifts enlarged, on the standard deviation of a
    coordinate; ``covariance_px2`` (K, K) is that of the field's coefficients, and zeros after them."""
    known = covariance_px2[: len(field.coefficients), : len(field.coefficients)]
    sigma_px = np.sqrt(np.sum(field.functions @ known * field.functions, axis=3).mean(axis=2))
    rows, columns = sigma_px.shape
    u, v = (np.linspace(0.0, side, n) - 0.5 for side, n in ((camera.width_px, columns), (camera.height_px, rows)))
    figure = new_figure(width_in, (width_in - 0.9) * camera.height_px / camera.width_px + 1.0)
    axes = figure.add_subplot()
    right, down = 0.5 * (u[1] - u[0]), 0.5 * (v[1] - v[0])
    around = (u[0] - right, u[-1] + right, v[-1] + down, v[0] - down)
    ground = axes.imshow(sigma_px, extent=around, interpolation="bilinear", cmap="Blues", vmin=0.0)
    every = max(1, columns // 20)
    shift, size_px = field.shift[::every, ::every], float(np.linalg.norm(field.shift, axis=2).max())
    enlargement = round_down(1.4 * every * camera.width_px / columns / max(size_px, 1e-6))
    arrows = axes.quiver(
        *np.meshgrid(u[::every], v[::every]), shift[..., 0], shift[..., 1], angles="xy", scale_units="xy",
        scale=1 / enlargement, color=VERMILION, width=0.0022, headwidth=4,
    )  # fmt: skip
    axes.set(xlim=(u[0], u[-1]), ylim=(v[-1], v[0]), aspect="equal")
    axes.tick_params(labelsize=8)
    axes.set_xlabel("u, px", fontsize=9)
    axes.set_ylabel("v, px", fontsize=9)
    bar = figure.colorbar(ground, ax=axes, fraction=0.034, pad=0.02)
    bar.ax.tick_params(labelsize=8)
    bar.set_label("standard deviation of a coordinate, px", fontsize=9)
    key_px = round_down(0.7 * size_px)
    label = f"{key_px:g} px (enlarged {enlargement:g} times)"
    axes.quiverkey(arrows, 0.05, 1.04, key_px, label, labelpos="E", fontproperties={"size": 9})
    if title:
        figure.suptitle(title, fontsize=12)
    return figure


def _grid_means(
    pixel: FloatArray, residual_px: FloatArray, side_px: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean pixels (G, 2), mean residuals (G, 2) and counts (G,) of the grid cells that hold any."""
    cell = np.floor(pixel / side_px).astype(np.int64)
    _, group, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    columns = (*pixel.T, *residual_px.T)
    mean = np.column_stack([np.bincount(group, column) / count for column in columns])
    return mean[:, :2], mean[:, 2:], count.astype(np.float64)
