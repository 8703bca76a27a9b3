"""Maps of the dense surface: orthophoto, relief, uncertainty, number of photographs and confidence."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize, to_hex
from matplotlib.figure import Figure

from photogram.arrays import BoolArray, FloatArray
from photogram.grid import MapGrid, bands, block_means, block_of, decimated
from photogram.languages.language import ENGLISH, Language
from photogram.report.figures.plan_view import ENOUGH, FEW, HALO, overlap_levels, place_labels
from photogram.report.figures.style import GREEN, VERMILION, map_axes, map_figure, new_figure, surface_figure
from photogram.report.numbers.dense_surface import DenseSurface, GroundMarks, OrthophotoPicture

MAP_CELLS = 1200
"""Cells of a drawn map along its longer side, at most."""
RAYS_CELLS = 600
"""The same of the two maps that stand beside each other."""
NO_DATA, FILLED = "#d4d4d4", "#b07ab8"
NO_DATA_TEXT = "no height"
MAXIMUM_NAMES = 60
"""Ground points that are named on a map, at most; all are drawn."""
TARGET_STEPS = (0.0, 0.25, 0.5, 1.0, 2.0)
"""Lower limits of the classes of standard deviations, in parts of the target."""
TARGET_COLOURS = ("#2c6e8f", "#7fb0c4", "#d9e6ea", "#f4c1a0", "#d5603a")
FILLED_SHARE, KNOWN_SHARE = 0.5, 0.5
"""Shares of the cells under a drawn one from which it counts as filled, or as known."""


def _halo(axes: Axes) -> None:
    """Set the north arrow of a map off from a picture under it."""
    for text in axes.texts:
        text.set_path_effects([*HALO])
        arrow = getattr(text, "arrow_patch", None)
        if arrow is not None:
            arrow.set_path_effects([*HALO])


def draw_ground(
    figure: Figure, axes: Axes, ground: GroundMarks, texts: Sequence[str], language: Language = ENGLISH
) -> None:
    """Draw control points as triangles and check points as discs, each with its text where there is room.

    The layout stands still afterwards: to be called last. Points off the map are left out.
    """
    (west, east), (south, north) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    x, y = ground.place_map_m[:, :2].T
    inside = (x > west) & (x < east) & (y > south) & (y < north)
    for checks, colour, marker, size in ((False, VERMILION, "^", 7.5), (True, GREEN, "o", 6.5)):
        chosen = inside & (ground.checks_height == checks)
        if chosen.any():
            label = _ground_label(int(np.count_nonzero(chosen)), language, checks=checks)
            axes.plot(x[chosen], y[chosen], marker, ls="", color=colour, ms=size, mec="white", mew=1.0, label=label,
                      zorder=5)  # fmt: skip
    if inside.any():
        figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    named = np.flatnonzero(inside)[:MAXIMUM_NAMES]
    place_labels(figure, axes, ground.place_map_m[named, :2], [texts[i] for i in named], ground.place_map_m[inside, :2])


def _ground_label(count: int, language: Language, *, checks: bool) -> str:
    if checks:
        return language.gettext("check points in height ({n})", n=count)
    return language.gettext("control points in height ({n})", n=count)


def orthophoto_figure(
    orthophoto: OrthophotoPicture, ground: GroundMarks, widest_in: float, language: Language = ENGLISH
) -> Figure:
    """Draw an orthophoto with coordinates, scale bar and north arrow, and the ground points on it by name."""
    shape = orthophoto.rgba.shape[:2]
    figure = map_figure(shape, widest_in, 0.8)
    axes = figure.add_subplot(facecolor=NO_DATA)
    grid = MapGrid(orthophoto.west_map_m, orthophoto.north_map_m, orthophoto.cell_m, *shape)
    axes.imshow(orthophoto.rgba, extent=grid.extent_map_m, interpolation="antialiased")
    map_axes(axes, language)
    _halo(axes)
    draw_ground(figure, axes, ground, ground.name, language)
    return figure


def _signed_cm(metres: float | None, language: Language) -> str:
    return "" if metres is None else f"\nΔh {language.figure(f'{100 * metres:+.1f}')} cm".replace("-", "−")


def relief_figure(
    dense: DenseSurface,
    ground: GroundMarks,
    differences_m: dict[str, float],
    widest_in: float,
    language: Language = ENGLISH,
) -> Figure:
    """Draw the surface lit from the north-west and tinted by height, holes grey, filled cells washed out, with the
    ground points; ``differences_m`` (surface minus survey) stand beside those that they name."""
    small, share = decimated(dense.heights, MAP_CELLS)
    known = replace(small, values=np.where(share >= KNOWN_SHARE, small.values, np.nan))
    figure = surface_figure(known, "", widest_in, language=language)
    axes = figure.axes[0]
    axes.set_facecolor(NO_DATA)
    washed = _filled_share(dense, MAP_CELLS) >= FILLED_SHARE
    if (washed & np.isfinite(known.values)).any():
        veil = np.ones((*washed.shape, 4), dtype=np.float32)
        veil[..., 3] = 0.6 * (washed & np.isfinite(known.values))
        axes.imshow(veil, extent=MapGrid.of(small).extent_map_m, interpolation="nearest")
    _halo(axes)
    texts = [f"{name}{_signed_cm(differences_m.get(name), language)}" for name in ground.name]
    draw_ground(figure, axes, ground, texts, language)
    return figure


def _filled_share(dense: DenseSurface, maximum: int) -> FloatArray:
    return block_means(dense.filled, block_of(dense.filled.shape, maximum))[0]


# ---- uncertainty ---------------------------------------------------------------------------------------------------


def target_bounds_m(target_m: float) -> FloatArray:
    """Return the limits, m, of the classes in which standard deviations are shown against a target RMSE."""
    return np.append(np.array(TARGET_STEPS) * target_m, np.inf)


def target_shares(dense: DenseSurface, target_m: float) -> FloatArray:
    """Return which share of the measured cells has its standard deviation in each of the classes, the last one open."""
    edges, counts = target_bounds_m(target_m)[1:-1].astype(np.float32), np.zeros(len(TARGET_STEPS))
    for band in bands(dense.heights.values.shape):
        sigma = dense.sigma.values[band][dense.measured(band)]
        counts += np.bincount(np.searchsorted(edges, sigma[np.isfinite(sigma)]), minlength=len(counts))
    return np.asarray(counts / max(float(counts.sum()), 1.0))


def sigma_figure(dense: DenseSurface, target_m: float | None, widest_in: float) -> Figure:
    """Draw the predicted standard deviations of the heights, m: in classes of the target where there is one, else on a
    scale to the 98th percentile; filled cells and those without a height have colours of their own."""
    measured = np.isfinite(dense.sigma.values)
    measured &= ~dense.filled
    small, share = decimated(dense.sigma, MAP_CELLS, measured)
    values = np.where(share >= KNOWN_SHARE, small.values, np.nan).astype(np.float64)
    figure = map_figure(values.shape, widest_in, 1.6)
    axes = figure.add_subplot(facecolor=NO_DATA)
    known = values[np.isfinite(values)]
    if target_m is None:
        low, high = np.percentile(known, [1, 98]) if len(known) else (0.0, 1.0)
        tint = ScalarMappable(Normalize(low, max(high, low + 1e-6)), "cividis_r")
    else:
        top = 4 * target_m  # the last class is open; its end is not written
        bounds = [*target_bounds_m(target_m)[:-1].tolist(), top]
        tint = ScalarMappable(BoundaryNorm(bounds, len(TARGET_COLOURS)), ListedColormap(list(TARGET_COLOURS)))
        values = np.minimum(values, 0.999 * top)
    _draw(axes, tint, values, MapGrid.of(small), _filled_share(dense, MAP_CELLS) >= FILLED_SHARE)
    map_axes(axes)
    _halo(axes)
    bar = figure.colorbar(tint, ax=axes, shrink=0.8, pad=0.02, spacing="uniform", extend="max" if target_m is None else
                          "neither")  # fmt: skip
    bar.ax.tick_params(labelsize=8)
    bar.set_label("predicted sigma of heights, m", fontsize=9)
    if target_m is not None:
        bar.set_ticks(bounds[:-1])
        bar.set_ticklabels([f"{b:.3g}" + ("\ntarget" if b == target_m else "") for b in bounds[:-1]])
        bar.ax.minorticks_off()
    _key(figure, axes, dense)
    return figure


def _draw(axes: Axes, tint: ScalarMappable, values: FloatArray, grid: MapGrid, filled: BoolArray) -> None:
    """Draw values in the colours of a scale; unknown ones let the ground show through, filled ones have one colour."""
    colours = np.asarray(tint.to_rgba(np.ma.masked_invalid(values)))
    colours[~np.isfinite(values)] = 0.0
    if filled.any():
        colours[filled & ~np.isfinite(values)] = (*(int(FILLED[i : i + 2], 16) / 255 for i in (1, 3, 5)), 1.0)
    axes.imshow(colours, extent=grid.extent_map_m, interpolation="nearest")


def _key(figure: Figure, axes: Axes, dense: DenseSurface) -> None:
    """Explain the colours of cells that hold no measured height, as far as there are any."""
    marks = []
    if dense.filled.any():
        marks.append((FILLED, "filled, not measured"))
    marks.append((NO_DATA, NO_DATA_TEXT))
    for colour, text in marks:
        axes.plot([], [], "s", ls="", color=colour, mec="#888888", mew=0.5, ms=8, label=text)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=8)


# ---- photographs and confidence ------------------------------------------------------------------------------------


def rays_figure(dense: DenseSurface, width_in: float) -> Figure:
    """Draw how many photographs each height was matched in, beside or above the confidence, for wide sites."""
    rows, columns = dense.heights.values.shape
    is_narrow = columns <= 1.8 * rows
    panel_in = (0.5 if is_narrow else 0.8) * width_in - 0.9
    height_in = panel_in * rows / columns
    figure = new_figure(width_in, (height_in + 1.9) if is_narrow else 2 * height_in + 1.3)
    panels: Any = figure.subplots(1, 2) if is_narrow else figure.subplots(2, 1)
    measured = dense.measured()
    block = block_of(measured.shape, RAYS_CELLS)
    filled = block_means(dense.filled, block)[0] >= FILLED_SHARE
    grid = MapGrid.of(dense.heights).coarser(block)
    rays, share = block_means(dense.rays, block, measured)
    rays = np.where(share >= KNOWN_SHARE, np.round(rays), np.nan)
    confidence, share = block_means(dense.confidence, block, measured)
    confidence = np.where(share >= KNOWN_SHARE, confidence, np.nan)
    counts, ticks, labels = rays_scale(int(np.nanmax(rays)) if np.isfinite(rays).any() else 2)
    scales = (
        (counts, rays, "photographs per matched height", ticks, labels),
        (ScalarMappable(Normalize(0.0, 1.0), "cividis"), confidence, "confidence", None, None),
    )
    for axes, (tint, values, label, ticks_at, texts) in zip(panels, scales, strict=True):
        axes.set_facecolor(NO_DATA)
        _draw(axes, tint, values, grid, filled)
        map_axes(axes)
        _halo(axes)
        for axis in (axes.xaxis, axes.yaxis):
            axis.get_major_locator().set_params(nbins=3)
        bar = figure.colorbar(tint, ax=axes, pad=0.02, aspect=30, location="bottom" if is_narrow else "right")
        bar.set_label(label, fontsize=9)
        bar.ax.tick_params(labelsize=8)
        if ticks_at is not None and texts is not None:
            bar.set_ticks(ticks_at)
            bar.set_ticklabels(texts)
            bar.ax.minorticks_off()
            bar.ax.tick_params(length=0)
    if is_narrow:
        panels[1].set_ylabel("")
    _key(figure, panels[0], dense)
    return figure


def rays_scale(most: int) -> tuple[ScalarMappable, list[float], list[str]]:
    """Return the colours of numbers of photographs up to ``most``, warm up to two, and where and what to write."""
    levels = [level for level in overlap_levels(max(most, 2)) if level >= 2]
    bounds = np.array([*levels, max(most, 2) + 1]) - 0.5
    shades = [FEW[2], *(to_hex(ENOUGH(k / max(len(levels) - 2, 1))) for k in range(len(levels) - 1))]
    colours: Colormap = ListedColormap(shades)
    last = [level - 1 for level in levels[1:]] + [max(most, 2)]
    texts = [f"{a}" if a == b else f"{a}–{b}" for a, b in zip(levels, last, strict=True)]
    scale = ScalarMappable(BoundaryNorm(bounds.tolist(), len(levels)), colours)
    return scale, ((bounds[:-1] + bounds[1:]) / 2).tolist(), texts
