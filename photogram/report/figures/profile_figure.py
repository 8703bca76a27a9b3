"""Profiles of the dense surface with their uncertainty, and how its standard deviations are spread."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LightSource
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from scipy.ndimage import distance_transform_edt

from photogram.arrays import BoolArray, FloatArray
from photogram.grid import MapGrid, bands, decimated
from photogram.report.figures.plan_view import BLACK, HALO
from photogram.report.figures.profiles import Profile
from photogram.report.figures.style import (
    BLUE,
    GREEN,
    GREY,
    NORTH_UP,
    SKY,
    VERMILION,
    new_figure,
    plain_axes,
    settle_layout,
)
from photogram.report.numbers.dense_surface import DenseSurface
from photogram.wording import percent

PLAN_CELLS = 500
BAND_SIGMAS = 2.0
LINE_COLOURS = {"A": BLUE, "B": "#AA3377", "C": VERMILION}
GAP = "#dedede"
SIGMA_BINS, LEAST_SIGMA_M = 4000, 1e-6
"""Classes in which standard deviations are counted, and the least that is told from nought, in m."""
DRAWN_BINS = 80
MAXIMUM_RAYS_SHOWN = 16
"""Numbers of photographs that the figure of standard deviations tells apart, at most."""


# ---- profiles ------------------------------------------------------------------------------------------------------


def profile_figure(dense: DenseSurface, profiles: Sequence[Profile], width_in: float) -> Figure:
    """Draw profiles one below the other, each with a strip of its uncertainty, and beside the last where they run.

    Raises ValueError without a profile.
    """
    if not profiles:
        raise ValueError("no profile to draw")
    count = len(profiles)
    figure = new_figure(width_in, 2.35 * count + 0.5)
    grid = figure.add_gridspec(count, 2, width_ratios=[1.55, 1.0])
    drawn = []
    for row, profile in enumerate(profiles):
        place = grid[row, 0] if row == count - 1 else grid[row, :]
        parts = place.subgridspec(2, 1, height_ratios=[2.6, 1.0], hspace=0.0)
        upper = figure.add_subplot(parts[0])
        lower = figure.add_subplot(parts[1], sharex=upper)
        _heights(upper, profile)
        _strip(lower, profile)
        drawn.append((upper, profile))
    _plan(figure.add_subplot(grid[count - 1, 1]), dense, profiles)
    handles, labels = drawn[0][0].get_legend_handles_labels()
    if any(profile.check_points.name for profile in profiles):
        handles.append(drawn[0][0].plot([], [], "o", ls="", color=GREEN, mec="white", ms=6)[0])
        labels.append("check point beside the line, as surveyed")
    if any(np.isnan(profile.height_m).any() for profile in profiles):
        handles.append(drawn[0][0].fill_between([], [], color=GAP))
        labels.append("gap: no measured height")
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    _exaggerations(figure, drawn)
    return figure


def gaps(profile: Profile) -> list[tuple[float, float]]:
    """Return from and to which distances, m, a profile has no height, half a step beyond the samples."""
    unknown = np.isnan(profile.height_m)
    step = float(profile.distance_m[1] - profile.distance_m[0])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], unknown, [False]]).astype(np.int8)))
    low, high = profile.distance_m[edges[::2]] - step / 2, profile.distance_m[edges[1::2] - 1] + step / 2
    return list(zip(low.tolist(), high.tolist(), strict=True))


def _shade_gaps(axes: Axes, profile: Profile) -> None:
    for low, high in gaps(profile):
        axes.axvspan(low, high, color=GAP, linewidth=0, zorder=0)


def _heights(axes: Axes, profile: Profile) -> None:
    colour = LINE_COLOURS[profile.line.letter]
    band = BAND_SIGMAS * profile.sigma_m
    _shade_gaps(axes, profile)
    axes.fill_between(
        profile.distance_m, profile.height_m - band, profile.height_m + band, color=SKY, alpha=0.6, linewidth=0,
        label="± 2 sigma",
    )  # fmt: skip
    axes.plot(profile.distance_m, profile.height_m, color=BLACK, linewidth=0.8, label="surface")
    points = profile.check_points
    axes.plot(profile.check_distance_m, points.place_map_m[:, 2], "o", color=GREEN, mec="white", ms=6, zorder=5)
    for name, distance_m, height_m in zip(points.name, profile.check_distance_m, points.place_map_m[:, 2], strict=True):
        axes.annotate(name, (distance_m, height_m), (0, 7), textcoords="offset points", ha="center", fontsize=7.5,
                      path_effects=HALO, zorder=6)  # fmt: skip
    known = profile.height_m[np.isfinite(profile.height_m)]
    if len(known):
        low, high = float(known.min()), float(known.max())
        margin = 0.12 * (high - low) + 1e-3
        axes.set_ylim(low - margin, high + 1.6 * margin)
    axes.set_xlim(profile.distance_m[0], profile.distance_m[-1])
    axes.set_ylabel("height, m", fontsize=8)
    axes.tick_params(labelsize=7.5, labelbottom=False)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=5))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.6g}"))
    axes.spines[["top", "right"]].set_visible(False)
    letter: dict[str, Any] = {"fontsize": 11, "fontweight": "bold", "color": colour, "ha": "center", "va": "bottom"}
    axes.annotate(profile.line.letter, (0.0, 1.01), xycoords="axes fraction", **letter)
    axes.annotate(f"{profile.line.letter}′", (1.0, 1.01), xycoords="axes fraction", **letter)


def _strip(axes: Axes, profile: Profile) -> None:
    """Draw ± 2 sigma around nought, on a scale on which it can be seen, and by what check points lie off."""
    band_m = BAND_SIGMAS * profile.sigma_m
    survey_m, off_m = BAND_SIGMAS * profile.check_points.sigma_m[:, 2], profile.check_difference_m
    known = band_m[np.isfinite(band_m)]
    usual_m = float(np.percentile(known, 97)) if len(known) else 0.0
    reach_m = 1.15 * max(usual_m, float(np.max((np.abs(off_m) + survey_m)[np.isfinite(off_m)], initial=1e-4)))
    unit, scale = next((u, s) for u, s in (("m", 1.0), ("cm", 100.0), ("mm", 1000.0)) if s * reach_m >= 1 or u == "mm")
    _shade_gaps(axes, profile)
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    axes.fill_between(profile.distance_m, -scale * band_m, scale * band_m, color=SKY, alpha=0.6, linewidth=0)
    axes.errorbar(profile.check_distance_m, scale * off_m, scale * survey_m, fmt="o", color=GREEN, mec="white", ms=5,
                  elinewidth=1.2)  # fmt: skip
    axes.set_ylim(-scale * reach_m, scale * reach_m)
    axes.set_ylabel(unit, fontsize=8)
    axes.set_xlabel("distance, m", fontsize=8, labelpad=1)
    axes.tick_params(labelsize=7.5)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=3, symmetric=True))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "−")))
    axes.spines[["top", "right"]].set_visible(False)


def _plan(axes: Axes, dense: DenseSurface, profiles: Sequence[Profile]) -> None:
    """Draw where the profiles run, over the shaded surface."""
    small, share = decimated(dense.heights, PLAN_CELLS)
    shaded = hillshade(np.where(share >= 0.5, small.values, np.nan).astype(np.float64), small.cell_m)
    axes.set_facecolor("white")
    axes.imshow(shaded, cmap="gray", vmin=-0.6, vmax=1.15, extent=MapGrid.of(small).extent_map_m)
    axes.set(xticks=[], yticks=[], aspect="equal")
    axes.spines[:].set_visible(False)
    axes.annotate(NORTH_UP, (0.99, 0.99), xycoords="axes fraction", ha="right", va="top", fontsize=9, fontweight="bold")
    for profile in profiles:
        line = profile.line
        ends = np.stack([line.start_map_m, line.end_map_m])
        axes.plot(*ends.T, color=LINE_COLOURS[line.letter], linewidth=1.6, solid_capstyle="butt", path_effects=HALO)
        for end, name, way in ((ends[0], line.letter, -1), (ends[1], f"{line.letter}′", 1)):
            text: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 9, "fontweight": "bold"}
            text |= {"color": LINE_COLOURS[line.letter], "path_effects": HALO, "annotation_clip": False}
            axes.annotate(name, tuple(end), tuple(way * 6 * line.direction), textcoords="offset points", **text)
        axes.plot(*profile.check_points.place_map_m[:, :2].T, "o", color=GREEN, mec="white", ms=4.5, mew=0.6)


def hillshade(values: FloatArray, cell_m: float) -> FloatArray:
    """Return how much light of the north-west a surface throws back, 0 to 1, NaN where there is none."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(values.shape, np.nan)
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    light = LightSource(azdeg=315, altdeg=45).hillshade(values[tuple(nearest)], vert_exag=2.5, dx=cell_m, dy=cell_m)
    return np.where(known, light, np.nan)


def _exaggerations(figure: Figure, drawn: Sequence[tuple[Axes, Profile]]) -> None:
    """Write over each profile what it is, how long, and how many times its heights are enlarged against its length."""
    for axes, profile in drawn:  # the title takes its room before the scales are known
        axes.set_title(profile.line.why, fontsize=8.5)
    settle_layout(figure)
    for axes, profile in drawn:
        box = axes.get_window_extent()
        low, high = axes.get_ylim()
        enlarged = (box.height / (high - low)) / (box.width / profile.line.length_m)
        text = f"{profile.line.why}, {profile.line.length_m:.3g} m; heights × {enlarged:.2g}"
        axes.set_title(text, fontsize=8.5)


# ---- how standard deviations are spread ----------------------------------------------------------------------------


def _known(dense: DenseSurface, rows: slice) -> BoolArray:
    return np.asarray(dense.measured(rows) & np.isfinite(dense.sigma.values[rows]))


def sigma_counts(dense: DenseSurface) -> tuple[FloatArray, FloatArray]:
    """Return numbers (256, SIGMA_BINS) of measured cells by how many photographs they were matched in and by their
    standard deviation, and the limits (SIGMA_BINS + 1,) of its classes, m.

    The classes are in equal ratios from the least to the largest: a few cells may be thousands of times worse than
    most.
    """
    shape = dense.heights.values.shape
    least, most = np.inf, LEAST_SIGMA_M
    for band in bands(shape):
        sigma = dense.sigma.values[band][_known(dense, band)]
        least, most = min(least, float(sigma.min(initial=np.inf))), max(most, float(sigma.max(initial=0.0)))
    least = max(min(least, 0.999 * most), 1e-3 * LEAST_SIGMA_M)
    edges = np.geomspace(least, most, SIGMA_BINS + 1)
    counts, classes_per_e = np.zeros(256 * SIGMA_BINS), SIGMA_BINS / np.log(most / least)
    for band in bands(shape):
        known = _known(dense, band)
        place = (np.log(np.maximum(dense.sigma.values[band][known], least) / least) * classes_per_e).astype(np.int64)
        both = dense.rays[band][known].astype(np.int64) * SIGMA_BINS + np.clip(place, 0, SIGMA_BINS - 1)
        counts += np.bincount(both, minlength=len(counts))
    return counts.reshape(256, SIGMA_BINS), edges


def quantiles(counts: FloatArray, edges: FloatArray, parts: Sequence[float]) -> FloatArray:
    """Return the quantiles of values counted in classes, linear within a class; NaN of nothing."""
    if not counts.sum() > 0:
        return np.full(len(parts), np.nan)
    reached = np.concatenate([[0.0], np.cumsum(counts)]) / counts.sum()
    rising = np.concatenate([[True], np.diff(reached) > 0])
    return np.asarray(np.interp(parts, reached[rising], edges[rising]))


def sigma_histogram_figure(dense: DenseSurface, target_m: float | None, width_in: float) -> Figure:
    """Draw how the standard deviations of the heights are spread over the cells, and how they fall with the number of
    photographs: the median and the middle two thirds."""
    counts, edges = sigma_counts(dense)
    total = counts.sum(axis=0)
    nearest, median, far, furthest = quantiles(total, edges, (0.005, 0.5, 0.95, 0.995))
    figure = new_figure(width_in, 2.8)
    left, right = figure.subplots(1, 2)
    reach = max(float(furthest), 0.0 if target_m is None or target_m > 3 * furthest else 1.05 * target_m)
    start = float(nearest) if nearest > 0.6 * reach else 0.0
    bins = np.linspace(start, reach if reach > start else start + 1.0, DRAWN_BINS + 1)
    cumulated = np.interp(bins, edges, np.concatenate([[0.0], np.cumsum(total)]))
    left.stairs(100 * np.diff(cumulated) / max(total.sum(), 1.0), bins, fill=True, color=SKY)
    marks = [(median, BLACK, "-", f"median {median:.3f} m"), (far, BLACK, "--", f"95 % below {far:.3f} m")]
    if target_m is not None and target_m <= reach:
        marks.append((target_m, VERMILION, "-", f"target {target_m:g} m"))
    for place, colour, style, label in marks:
        if np.isfinite(place):
            left.axvline(place, color=colour, linestyle=style, linewidth=1.1, label=label)
    left.set(xlabel="predicted sigma of heights, m", ylabel="cells, %", xlim=(bins[0], bins[-1]))
    left.legend(framealpha=1.0, edgecolor="none", fontsize=8)
    _by_rays(right, counts, edges)
    for axes in (left, right):
        plain_axes(axes)
    return figure


def _by_rays(axes: Axes, counts: FloatArray, edges: FloatArray) -> None:
    share = counts.sum(axis=1) / max(counts.sum(), 1.0)
    rays = np.flatnonzero(share > 1e-4)[:MAXIMUM_RAYS_SHOWN]
    low, middle, high = np.array([quantiles(counts[n], edges, (1 / 6, 0.5, 5 / 6)) for n in rays]).reshape(-1, 3).T
    axes.errorbar(rays, middle, [middle - low, high - middle], fmt="o", color=BLUE, ms=4.5, elinewidth=1.4, capsize=0)
    axes.set(xlabel="photographs per matched height", ylabel="predicted sigma, m")
    axes.set_ylim(0.0, 1.25 * float(high.max(initial=1e-6)))
    if len(rays):
        axes.set(xlim=(rays[0] - 0.7, rays[-1] + 0.7), xticks=rays)
    for n, top in zip(rays.tolist(), high.tolist(), strict=True):
        axes.annotate(percent(share[n]), (n, top), (0, 4), textcoords="offset points", ha="center", fontsize=7)
