"""Pictures of the RANSAC experiment: what iterations, sample size and threshold do to the number of inliers."""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties
from matplotlib.ticker import FuncFormatter

from photogram.report.figures.style import GREY, MAXIMUM_DOTS, VERMILION, new_figure, save_picture
from photogram.teaching.ransac_study import RansacStudy, needed_iterations, success_probability

MARKERS = "os^Dv<>P"
MAXIMUM_ITERATIONS_SHOWN = 1e9


def _shades(count: int) -> list[tuple[float, float, float, float]]:
    """Return distinguishable colours for ordered values, the lightest dark enough for white paper."""
    return [matplotlib.colormaps["viridis"](x) for x in np.linspace(0.0, 0.85, count)]


def _threshold_label(study: RansacStudy, threshold: int) -> str:
    """Return the threshold with its unit; an algebraic residual has none."""
    unit = "" if study.residual == "algebraic" else " px"
    return f"{study.thresholds_px[threshold]:g}{unit}"


def inliers_by_iteration(path: Path, study: RansacStudy, threshold: int) -> None:
    """Draw, for one of the study's thresholds (its index), the inliers of each iteration and the best so far.

    Below: the probability that one sample at least was free of outliers by then, 1 − (1 − wˢ)ⁿ, with w as the study
    found it. Raises WorkspaceError when the file cannot be written.
    """
    total = study.inliers.shape[2]
    iteration = np.arange(1, total + 1)
    dots = np.unique(np.geomspace(1, total, max(2, MAXIMUM_DOTS // (10 * len(study.sample_sizes)))).astype(int))
    fraction = float(study.inlier_fraction[threshold])
    figure = new_figure(9.5, 8.0)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    for s, (size, colour) in enumerate(zip(study.sample_sizes, _shades(len(study.sample_sizes)), strict=True)):
        counts = study.inliers[s, threshold]
        above.plot(dots, counts[dots - 1], ".", color=colour, markersize=4, alpha=0.5, markeredgewidth=0, zorder=1)
        best = study.running_best[s, threshold]
        above.step(iteration, best, where="post", color=colour, linewidth=1.8, label=f"{size}", zorder=3)
        below.plot(iteration, success_probability(fraction, size, iteration), color=colour, linewidth=1.8)
    above.axhline(study.points, color=GREY, linewidth=0.8, linestyle="--", zorder=2)
    above.annotate(
        f"all {study.points} matches", (1, study.points), (2, 3), "data", "offset points", color=GREY, fontsize=8
    )
    above.set(xscale="log", xlim=(0.9, total * 1.1), ylim=(0, study.points * 1.1))
    above.set_ylabel("inliers (dots: of each iteration; lines: best so far)", fontsize=9)
    # The legend stands outside: the lines end anywhere inside.
    legend = above.legend(fontsize=9, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    legend.set_title("sample size", prop=FontProperties(size=9))
    limit = f"{study.residual.capitalize()} residual up to {_threshold_label(study, threshold)}"
    above.set_title(f"RANSAC on the fundamental matrix: {limit}", fontsize=12)
    below.axhline(0.99, color=GREY, linewidth=0.8, linestyle="--")
    below.annotate("99 %", (1, 0.99), (2, -3), "data", "offset points", color=GREY, fontsize=8, va="top")
    below.set(ylim=(0, 1.04))
    below.set_xlabel("iteration n", fontsize=9)
    below.set_ylabel(f"1 − (1 − wˢ)ⁿ for w = {fraction:.2f}", fontsize=9)
    below.set_title("Probability that a sample free of outliers has been drawn", fontsize=10)
    for axes in (above, below):
        _plain(axes)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    save_picture(figure, path)


def inliers_by_sample_size(path: Path, study: RansacStudy) -> None:
    """Draw, against the sample size, the most inliers and the iterations it took, with the number theory asks for.

    Theory is N = log(1 − p) / log(1 − wˢ) with p = 0.99 and, for each threshold, w as the study found it; the marks
    are the iterations after which 95 % of the most inliers of any sample size had been reached, hollow where they
    never were. Raises WorkspaceError when the file cannot be written.
    """
    total = study.inliers.shape[2]
    sizes = np.array(study.sample_sizes)
    smooth = np.linspace(sizes.min(), sizes.max(), 100)
    reached = study.first_reached(0.95)
    figure = new_figure(11.5, 5.2)
    left, right = figure.subplots(1, 2)
    for t, colour in enumerate(_shades(len(study.thresholds_px))):
        fraction = float(study.inlier_fraction[t])
        marker = MARKERS[t % len(MARKERS)]
        label = f"{_threshold_label(study, t)} (w = {fraction:.2f})"
        left.plot(sizes, study.inliers[:, t].max(axis=1), marker + "-", color=colour, label=label, markersize=6)
        right.plot(smooth, needed_iterations(fraction, smooth, 0.99), color=colour, linewidth=1.4)
        done = reached[:, t] > 0
        # Marks of several thresholds would hide each other.
        apart = sizes + 0.3 * (t - (len(study.thresholds_px) - 1) / 2)
        right.plot(apart[done], reached[done, t], marker, color=colour, markersize=6)
        right.plot(
            apart[~done], np.full(int((~done).sum()), total), marker, color=colour, markersize=6, fillstyle="none"
        )
    right.axhline(total, color=VERMILION, linewidth=0.9, linestyle="--")
    end = (float(sizes.max()), float(total))
    text = f"{total} iterations were run"
    right.annotate(text, end, (0, 7), "data", "offset points", color=VERMILION, fontsize=8, ha="right")
    left.set_ylim(0, study.points * 1.05)
    right.set_yscale("log")
    right.set_ylim(0.8, min(right.get_ylim()[1], MAXIMUM_ITERATIONS_SHOWN))
    left.set_title(f"Most inliers of {study.points} matches", fontsize=10)
    right.set_title(
        "Iterations needed: lines, theory for 99 %\nmarks, 95 % of the most inliers (hollow: not reached)", fontsize=10
    )
    for axes in (left, right):
        axes.set_xticks(sizes)
        axes.set_xlabel("matches in a sample", fontsize=9)
        _plain(axes)
    left.set_ylabel("inliers", fontsize=9)
    right.set_ylabel("iterations", fontsize=9)
    handles, labels = left.get_legend_handles_labels()
    legend = figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    legend.set_title(f"{study.residual.capitalize()} residual up to", prop=FontProperties(size=9))
    save_picture(figure, path)


def _plain(axes: Axes) -> None:
    axes.tick_params(labelsize=8)
    axes.grid(visible=True, color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
