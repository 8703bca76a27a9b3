"""The survey in plan: photographs, what disagrees with GNSS and ground points, and how often the ground is seen."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, ListedColormap, to_hex
from matplotlib.figure import Figure
from matplotlib.offsetbox import AnchoredOffsetbox
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation
from scipy.spatial import cKDTree
from shapely import MultiPoint

from photogram.arrays import BoolArray, FloatArray, IntArray, check_shape
from photogram.grid import MapGrid
from photogram.languages.language import ENGLISH, Language
from photogram.measures.round_lengths import round_down
from photogram.report.figures.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    length_label,
    map_axes,
    new_figure,
    settle_layout,
)
from photogram.report.numbers.numbers import gnss_residual_m
from photogram.report.numbers.overlap import Overlap
from photogram.results import Adjustment
from photogram.survey import Raster, Role

BLACK = "#111111"
FLIGHT_SYMBOLS = (("s", BLUE), ("D", "#AA3377"), ("h", ORANGE), ("P", BLACK), ("p", "#7A5C00"), ("d", "#555555"))
"""Marker and colour of the flights in turn; the last is shared by all that follow."""

MAXIMUM_PHOTOGRAPH_NAMES = 40
MAXIMUM_OUTSIDER_NAMES = 12
MAXIMUM_CLEAR = 150
MAXIMUM_GROUND_NAMES = 60
TYPICAL_PERCENTILE = 90
AROUND = ((1, 1), (1, -1), (-1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1))
HALO = [withStroke(linewidth=2, foreground="white")]
PLACES_PT = tuple((dx * far, dy * far) for far in (5, 12) for dx, dy in AROUND)
"""Offsets of a label from its point, tried in this order."""
SIDES = {1: ("left", "bottom"), -1: ("right", "top"), 0: ("center", "center")}

FEW = ("#e98b6b", "#f4c1a0", "#fae6b0")
"""Colours of ground that none, one and two photographs see: its heights are unknown, or not checked."""
ENOUGH = LinearSegmentedColormap.from_list("enough", ["#e6eff2", "#87a9bb"])


@dataclass(frozen=True, eq=False)
class PlanContents:
    """What a plan shows, in the map frame, m; residuals are adjusted minus measured or surveyed.

    ``photograph_map_m`` (N, 3) with ``photograph_names``, ``flights`` and ``gnss_residual_m`` (N, 3), NaN rows without
    GNSS; a photograph that is not ``registered`` (N,) stands where GNSS says, NaN where nothing does;
    ``component`` (N,) is the number from 0 of what hangs together by tie points, −1 for none;
    ``ground_map_m`` (G, 3) with ``ground_names``, ``ground_roles`` and ``ground_residual_m`` (G, 3); ``overlap`` is the
    number of photographs that see each cell of the ground.
    """

    photograph_names: Sequence[str]
    flights: Sequence[str]
    registered: BoolArray
    photograph_map_m: FloatArray
    gnss_residual_m: FloatArray
    ground_names: Sequence[str]
    ground_roles: Sequence[Role]
    ground_map_m: FloatArray
    ground_residual_m: FloatArray
    overlap: Raster | None = None
    component: IntArray | None = None

    def __post_init__(self) -> None:
        count = len(self.photograph_names)
        check_shape("flights", np.asarray(self.flights, dtype=str), (count,))
        check_shape("registered", self.registered, (count,))
        check_shape("photograph_map_m", self.photograph_map_m, (count, 3))
        check_shape("gnss_residual_m", self.gnss_residual_m, (count, 3))
        check_shape("ground_map_m", self.ground_map_m, (len(self.ground_names), 3))
        check_shape("ground_residual_m", self.ground_residual_m, self.ground_map_m.shape)
        check_shape("ground_roles", np.asarray(self.ground_roles, dtype=str), (len(self.ground_names),))


def plan_contents(result: Adjustment, overlap: Overlap | None, component: IntArray | None = None) -> PlanContents:
    """Gather what the plan of an adjusted block shows; GNSS residuals without the offsets of the flights."""
    block = result.block
    frame = result.block.frame
    points = result.block.control_points
    place = np.full((len(block.photographs), 3), np.nan)
    for i, (photograph, pose) in enumerate(zip(block.photographs, block.poses, strict=True)):
        if pose is not None:
            place[i] = pose.position_world_m
        elif photograph.gnss_world_m is not None:
            place[i] = photograph.gnss_world_m
    surveyed = frame.map_from_world(points.position_world_m)
    return PlanContents(
        block.photograph_names,
        [photograph.flight for photograph in block.photographs],
        block.registered,
        frame.map_from_world(place),
        gnss_residual_m(result),
        points.name,
        points.role,
        surveyed,
        frame.map_from_world(result.estimates.ground_world_m) - surveyed,
        None if overlap is None else overlap.photographs,
        component,
    )


@dataclass(frozen=True, eq=False)
class _Sheet:
    """The area of a plan and its scale: corners (2,), spacing of the photographs in m, and points per metre."""

    low: FloatArray
    high: FloatArray
    spacing_m: float
    points_per_m: float

    @property
    def span_m(self) -> FloatArray:
        return self.high - self.low

    def holds(self, places_m: FloatArray) -> BoolArray:
        return np.asarray(np.all((places_m[:, :2] > self.low) & (places_m[:, :2] < self.high), axis=1))


def plan_figure(
    contents: PlanContents, title: str = "", widest_in: float = 9.0, language: Language = ENGLISH
) -> Figure:
    """Draw the survey in plan: photographs by flight, ground points, residuals as enlarged arrows, and the overlap.

    GNSS residuals and ground residuals have a scale each; the height residual stands beside the name of a ground
    point. Photographs are named when they are few. Names that find no free place are left out, and counted, as are
    photographs that are not registered and lie far off. The map is ``widest_in`` inches wide at most. Raises
    ValueError when there is neither a registered photograph nor a ground point.
    """
    if not contents.registered.any() and not len(contents.ground_names):
        raise ValueError("no registered photograph and no ground point to draw")
    sheet = _sheet(contents)
    width_in = float(min(widest_in, 11 / 9 * widest_in * sheet.span_m[0] / sheet.span_m[1]))
    height_in = width_in * float(sheet.span_m[1] / sheet.span_m[0])
    figure = new_figure(width_in + 1.6, height_in + 1.8)
    axes = figure.add_subplot(facecolor="#fafafa")
    axes.set(xlim=(sheet.low[0], sheet.high[0]), ylim=(sheet.low[1], sheet.high[1]))
    map_axes(axes, language)
    axes.grid(visible=True, color="#bbbbbb", linewidth=0.5, alpha=0.7)
    axes.set_axisbelow(True)
    if contents.overlap is not None and np.isfinite(contents.overlap.values).any():
        _draw_overlap(figure, axes, contents.overlap, language)
    _draw_components(axes, contents, sheet)
    _draw_photographs(axes, contents, sheet, language)
    _draw_ground(axes, contents, language)
    tips = _draw_residuals(axes, contents, sheet, 1 + 14 / (72 * height_in), language)
    if title:
        figure.suptitle(title, fontsize=12)
    axes.set_title(" ", fontsize=14)  # room for the scales of the arrows
    figure.legend(loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    _annotate(figure, axes, contents, sheet, tips, language)
    return figure


def _sheet(contents: PlanContents) -> _Sheet:
    """Return the area that holds all but photographs that are not registered."""
    registered = contents.photograph_map_m[contents.registered, :2]
    corners = [contents.ground_map_m[:, :2], registered]
    if contents.overlap is not None:
        rows, columns = np.nonzero(np.isfinite(contents.overlap.values))
        west = contents.overlap.west_map_m
        north = contents.overlap.north_map_m
        cell_m = contents.overlap.cell_m
        corners += [np.column_stack([west + (columns + e) * cell_m, north - (rows + e) * cell_m]) for e in (0, 1)]
    every = np.vstack(corners)
    low, high = every.min(axis=0), every.max(axis=0)
    margin_m = 0.06 * float((high - low).max()) + 1.0
    # A single flight line would make a plan as thin as a thread; the scales of the arrows need some width.
    thin = np.maximum(np.array([0.6, 0.35]) * (high - low).max() - (high - low), 0.0) / 2
    low, high = low - thin - margin_m, high + thin + margin_m
    spacing_m = float((high - low).max()) / 4
    if len(registered) > 1:
        spacing_m = float(np.median(np.asarray(cKDTree(registered).query(registered, 2)[0])[:, 1]))
    return _Sheet(low, high, spacing_m, 600.0 / float((high - low).max()))


def overlap_levels(most: int) -> list[int]:
    """Return the smallest numbers of the classes in which numbers of photographs up to ``most`` are shown."""
    if most <= 10:
        return list(range(most + 1))
    steps = [0, 1, 2, 3, 4, 5, 6, 8, *(step * 10**decade for decade in range(1, 7) for step in (1, 1.5, 2, 3, 5, 7))]
    return [int(step) for step in steps if step <= most]


def _draw_overlap(figure: Figure, axes: Axes, overlap: Raster, language: Language) -> None:
    most = int(np.nanmax(overlap.values))
    levels = overlap_levels(most)
    enough = max(len(levels) - len(FEW), 0)
    shades = [to_hex(ENOUGH(k / max(enough - 1, 1))) for k in range(enough)]
    bounds = np.array([*levels, most + 1]) - 0.5
    scale = ScalarMappable(BoundaryNorm(bounds.tolist(), len(levels)), ListedColormap([*FEW[: len(levels)], *shades]))
    limits = axes.get_xlim(), axes.get_ylim()
    colours = scale.to_rgba(np.ma.masked_invalid(overlap.values))
    axes.imshow(colours, extent=MapGrid.of(overlap).extent_map_m, interpolation="nearest", zorder=0.4)
    axes.set(xlim=limits[0], ylim=limits[1])
    bar = figure.colorbar(scale, ax=axes, shrink=0.7, pad=0.015, spacing="uniform", aspect=28)
    bar.set_ticks(((bounds[:-1] + bounds[1:]) / 2).tolist())
    last = [level - 1 for level in levels[1:]] + [most]
    bar.set_ticklabels([f"{a}" if a == b else f"{a}–{b}" for a, b in zip(levels, last, strict=True)])
    bar.ax.minorticks_off()
    bar.ax.tick_params(labelsize=8, length=0)
    bar.set_label(language.gettext("photographs that see the ground"), fontsize=9)


def _draw_components(axes: Axes, contents: PlanContents, sheet: _Sheet) -> None:
    """Draw a line around the photographs of each component, with its number, where there are several."""
    if contents.component is None or contents.component[contents.registered].max(initial=0) < 1:
        return
    for number in np.unique(contents.component[contents.registered & (contents.component >= 0)]).tolist():
        own = contents.registered & (contents.component == number)
        rim = MultiPoint(contents.photograph_map_m[own, :2]).convex_hull.buffer(0.3 * sheet.spacing_m)
        x, y = np.array(rim.exterior.coords).T
        axes.plot(x, y, "--", color=BLACK, linewidth=1.0, zorder=3.5)
        axes.annotate(
            str(number + 1), (x[np.argmin(x)], y[np.argmax(y)]), fontsize=12, fontweight="bold", path_effects=HALO,
            zorder=6,
        )  # fmt: skip


def _draw_photographs(axes: Axes, contents: PlanContents, sheet: _Sheet, language: Language) -> None:
    flights = np.asarray(contents.flights, dtype=str)
    names = list(dict.fromkeys(flights[contents.registered].tolist()))
    shared = len(FLIGHT_SYMBOLS) - 1 if len(names) > len(FLIGHT_SYMBOLS) else len(names)
    size = float(np.clip(0.4 * sheet.spacing_m * sheet.points_per_m, 2.2, 6.0))
    groups = [[name] for name in names[:shared]] + ([names[shared:]] if names[shared:] else [])
    for members, (marker, colour) in zip(groups, FLIGHT_SYMBOLS, strict=False):
        chosen = contents.registered & np.isin(flights, members)
        count = int(np.count_nonzero(chosen))
        if len(groups) == 1:
            label = language.gettext("photographs ({n})", n=count)
        elif len(members) == 1:
            label = language.gettext("flight {name} ({n})", name=members[0], n=count)
        else:
            label = language.gettext("{flights} more flights ({n})", flights=len(members), n=count)
        places = contents.photograph_map_m[chosen, :2].T
        axes.plot(*places, marker, color=colour, markersize=size, mec="white", mew=0.1 * size, label=label, zorder=4)
    outside = ~contents.registered
    if outside.any():
        places = contents.photograph_map_m[outside, :2].T
        label = language.gettext("not registered ({n})", n=int(np.count_nonzero(outside)))
        size = max(size, 4.0)
        axes.plot(*places, "s", color="none", markersize=size, mec=GREY, mew=0.9, zorder=4.4)
        axes.plot(*places, "x", color=BLACK, markersize=1.5 * size, mew=1.5, label=label, zorder=4.5)


def _draw_ground(axes: Axes, contents: PlanContents, language: Language) -> None:
    roles = np.asarray(contents.ground_roles, dtype=str)
    for role, colour, marker, size in (("control", VERMILION, "^", 8.0), ("check", GREEN, "o", 7.0)):
        chosen = roles == role
        if chosen.any():
            places, count = contents.ground_map_m[chosen, :2].T, int(np.count_nonzero(chosen))
            control = language.gettext("control points ({n})", n=count)
            label = control if role == "control" else language.gettext("check points ({n})", n=count)
            axes.plot(*places, marker, color=colour, markersize=size, mec="white", mew=0.7, label=label, zorder=5)


def _draw_residuals(axes: Axes, contents: PlanContents, sheet: _Sheet, above: float, language: Language) -> FloatArray:
    """Draw the arrows and, at the height ``above`` in the axes' own units, their scales; return places (V, 2) along the
    arrows.
    """
    roles = np.asarray(contents.ground_roles, dtype=str)
    ground_m = float(min(sheet.span_m.max() / 14, sheet.span_m[0] / 10))
    gnss_m = float(np.clip(1.2 * sheet.spacing_m, sheet.span_m.max() / 40, ground_m))
    gnss_scale = enlargement(contents.gnss_residual_m, gnss_m)
    ground_scale = enlargement(contents.ground_residual_m, ground_m)
    ground = contents.ground_map_m, contents.ground_residual_m
    layers = (
        (
            language.gettext("GNSS residuals"),
            contents.photograph_map_m,
            contents.gnss_residual_m,
            gnss_scale,
            gnss_m,
            BLACK,
        ),
        (
            language.gettext("control residuals"),
            *(a[roles == "control"] for a in ground),
            ground_scale,
            ground_m,
            VERMILION,
        ),
        (language.gettext("check residuals"), *(a[roles == "check"] for a in ground), ground_scale, ground_m, GREEN),
    )
    along, place = [np.zeros((0, 2))], 0.0
    for name, root, vector, scale, length_m, colour in layers:
        known = np.isfinite(vector).all(axis=1) & np.isfinite(root).all(axis=1)
        if scale is None or not known.any():
            continue
        width = float(np.clip(0.06 * length_m * sheet.points_per_m, 1.2, 2.2))
        style: dict[str, Any] = {"units": "dots", "width": width, "headwidth": 4, "headlength": 5, "zorder": 6}
        style |= {"angles": "xy", "scale_units": "xy", "scale": 1 / scale, "color": colour}
        arrows = axes.quiver(*root[known, :2].T, *vector[known, :2].T, **style)
        key_m = round_down(0.95 * length_m / scale)
        text = f"{name}, {length_label(key_m, language)} (× {language.figure(f'{scale:g}')})"
        shift = key_m * scale / sheet.span_m[0]
        axes.quiverkey(
            arrows, place + shift, above, key_m, text, labelpos="E", labelsep=0.06, fontproperties={"size": 8}
        )
        place += 0.33
        steps = np.linspace(0.34, 1.0, 3)[:, None, None]
        along.append((root[known, :2] + steps * scale * vector[known, :2]).reshape(-1, 2))
    return np.vstack(along)


def enlargement(vectors_m: FloatArray, typical_m: float) -> float | None:
    """Return the round factor that draws a long but usual one of vectors (N, 3) in plan about ``typical_m`` long.

    Usual: 90 of 100 are no longer, so that one wrong fix does not shrink all others. None without a vector.
    """
    length_m = np.hypot(vectors_m[:, 0], vectors_m[:, 1])
    length_m = length_m[np.isfinite(length_m) & (length_m > 0)]
    return round_down(typical_m / float(np.percentile(length_m, TYPICAL_PERCENTILE))) if len(length_m) else None


def _annotate(
    figure: Figure, axes: Axes, contents: PlanContents, sheet: _Sheet, tips: FloatArray, language: Language
) -> None:
    """Name ground points and, when they are few, photographs; say what is not shown."""
    places = contents.photograph_map_m[:, :2]
    inside = sheet.holds(places)
    named = np.flatnonzero(inside)
    if len(named) > MAXIMUM_PHOTOGRAPH_NAMES:
        outsiders = np.flatnonzero(inside & ~contents.registered)
        named = outsiders if len(outsiders) <= MAXIMUM_OUTSIDER_NAMES else outsiders[:0]
    ground = min(len(contents.ground_names), MAXIMUM_GROUND_NAMES)
    texts = [
        f"{contents.ground_names[g]}{_height_label(contents.ground_residual_m[g], language)}" for g in range(ground)
    ]
    texts += [Path(contents.photograph_names[i]).stem for i in named.tolist()]
    anchors = np.vstack([contents.ground_map_m[:ground, :2], places[named]])
    # among hundreds of photographs no name would find a free place: there it may cover some
    crowded = np.count_nonzero(inside) > MAXIMUM_CLEAR
    obstacles = np.vstack(
        [contents.ground_map_m[:, :2], places[named if crowded else inside], tips[:0] if crowded else tips]
    )
    left_out = len(texts) - place_labels(figure, axes, anchors, texts, obstacles)
    notes = []
    if left_out:
        notes.append(language.gettext("{some} of {all} names omitted for lack of space", some=left_out, all=len(texts)))
    nowhere = int(np.count_nonzero(np.isnan(places[:, 0])))
    far = int(np.count_nonzero(~inside)) - nowhere
    if far:
        notes.append(language.gettext("{n} not registered, outside the plan", n=far))
    if nowhere:
        notes.append(language.gettext("{n} not registered, without a position", n=nowhere))
    if notes:
        text = "\n".join(notes)
        place: dict[str, Any] = {"xycoords": "axes fraction", "ha": "right", "va": "bottom", "zorder": 7}
        axes.annotate(text, (0.99, 0.01), fontsize=8, color=GREY, path_effects=HALO, **place)


def _height_label(residual_m: FloatArray, language: Language) -> str:
    if not np.isfinite(residual_m[2]):
        return ""
    sign = "−" if residual_m[2] < 0 else "+"
    return f"\nΔh {sign}{language.figure(f'{abs(residual_m[2]) * 100:.1f}')} cm"


def place_labels(figure: Figure, axes: Axes, anchors: FloatArray, texts: Sequence[str], obstacles: FloatArray) -> int:
    """Write each text beside its anchor (N, 2) where it covers no obstacle (M, 2) and no other text.

    Returns how many found a place.
    """
    settle_layout(figure)  # the texts must not move it again
    frame = axes.get_window_extent()
    blocked = axes.transData.transform(obstacles)
    artists = [child for child in axes.get_children() if isinstance(child, AnchoredOffsetbox | Annotation)]
    taken = np.array([artist.get_window_extent().extents for artist in artists]).reshape(-1, 4)
    placed = 0
    for anchor, text in zip(anchors, texts, strict=True):
        for dx, dy in PLACES_PT:
            side: dict[str, Any] = {
                "ha": SIDES[np.sign(dx)][0],
                "va": SIDES[np.sign(dy)][1],
                "fontsize": 7.5,
                "zorder": 6,
            }
            label = axes.annotate(text, tuple(anchor), (dx, dy), "data", "offset points", path_effects=HALO, **side)
            west, south, east, north = box = label.get_window_extent().padded(1.5).extents
            covered = (taken[:, :2] < (east, north)).all(axis=1) & (taken[:, 2:] > (west, south)).all(axis=1)
            hit = (blocked > (west, south)).all(axis=1) & (blocked < (east, north)).all(axis=1)
            clear = not covered.any() and not hit.any()
            if clear and frame.x0 < west and frame.x1 > east and frame.y0 < south and frame.y1 > north:
                taken = np.vstack([taken, box])
                placed += 1
                break
            label.remove()
    return placed
