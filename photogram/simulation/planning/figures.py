"""A flight before it is flown: predicted sigma in height over the site, photographs, control points, and what a change
would bring."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from photogram.report.figures.style import BLUE, GREY, VERMILION, map_axes, new_figure, save_picture
from photogram.simulation.planning.flight_plan import courses
from photogram.simulation.planning.prediction import FEWEST_RAYS, Alternative, Prediction


def _map(axes: Axes, prediction: Prediction) -> None:
    """Draw the cells of the site in the colour of their sigma in height."""
    plan, height_cm = prediction.plan, 100 * prediction.sigma_m[:, 2]
    known = prediction.rays >= FEWEST_RAYS
    x, y = np.unique(prediction.place_m[:, 0]), np.unique(prediction.place_m[:, 1])
    values = np.where(known, height_cm, np.nan).reshape(len(y), len(x))
    half = plan.width_m / 2, plan.length_m / 2
    extent = (-half[0], half[0], -half[1], half[1])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    image = axes.imshow(
        values, origin="lower", extent=extent, cmap="cividis_r", vmin=min(low, 0.5 * high), vmax=high,
        interpolation="nearest",
    )  # fmt: skip
    axes.add_patch(Rectangle((-half[0], -half[1]), plan.width_m, plan.length_m, fill=False, linewidth=1.0))
    first = 0
    for course in courses(plan):
        strip = prediction.position_m[first : first + course.photographs]
        first += course.photographs
        oblique = course.tilt_deg > 0
        axes.plot(
            strip[:, 0], strip[:, 1], "-", color=VERMILION if oblique else GREY, linewidth=0.5, alpha=0.6, zorder=2
        )
        axes.plot(
            strip[:, 0], strip[:, 1], "D" if oblique else "s", color=VERMILION if oblique else GREY, markersize=3.5,
            markeredgecolor="white", markeredgewidth=0.4, zorder=3,
        )  # fmt: skip
    names = {GREY: f"{len(prediction.position_m)} photographs"}
    if plan.oblique_strips:
        names[VERMILION] = "of them oblique"
    for colour, name in names.items():
        axes.plot([], [], "D" if colour == VERMILION else "s", color=colour, markersize=4, label=name)
    if len(prediction.control_m):
        axes.plot(
            prediction.control_m[:, 0], prediction.control_m[:, 1], "^", color="white", markeredgecolor="black",
            markersize=9, zorder=4, label=f"{len(prediction.control_m)} control points",
        )  # fmt: skip
    axes.margins(0.14)
    axes.autoscale_view()
    map_axes(axes)
    axes.set_xlabel("east of the middle, m", fontsize=9)
    axes.set_ylabel("north of the middle, m", fontsize=9)
    axes.figure.colorbar(image, ax=axes, label="predicted sigma in height, cm", shrink=0.75)


def _bars(axes: Axes, prediction: Prediction, changes: Sequence[Alternative]) -> None:
    """Draw median and worst sigma in height as planned, and with each change."""
    rows = [("as planned", prediction), *((c.what, c.prediction) for c in changes)]
    at = np.arange(len(rows))[::-1]
    median, worst = 100 * np.array([p.typical_m(p.sigma_m[:, 2]) for _, p in rows]).T
    axes.barh(at, worst, height=0.6, color=[GREY] + [BLUE] * len(changes), alpha=0.3, label="worst place")
    axes.barh(at, median, height=0.6, color=[GREY] + [BLUE] * len(changes), label="median")
    axes.axvline(median[0], color="black", linewidth=0.7, linestyle=":")
    for y, m, w in zip(at, median, worst, strict=True):
        white = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
        axes.annotate(
            f"{m:.1f} – {w:.1f}", (w, y), (5, 0), textcoords="offset points", va="center", fontsize=8, bbox=white
        )
    axes.set_yticks(at, [name for name, _ in rows], fontsize=8)
    axes.set_xlim(0, 1.25 * float(worst.max()))
    axes.tick_params(labelsize=8)
    axes.set_xlabel("predicted sigma in height, cm\nmedian (dark), worst place (light)", fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)


def prediction_picture(path: Path, prediction: Prediction, changes: Sequence[Alternative]) -> None:
    """Write the picture of a prediction as PNG. Raises WorkspaceError when the file cannot be written."""
    figure = new_figure(11.5 if changes else 6.5, 6.0)
    panels = figure.subplots(1, 2, width_ratios=(1.0, 0.85)) if changes else np.array([figure.subplots()])
    _map(panels[0], prediction)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower left", ncols=3, fontsize=8, frameon=False)
    if changes:
        _bars(panels[1], prediction, changes)
    plan, (median, worst) = prediction.plan, prediction.typical_m(prediction.sigma_m[:, 2])
    figure.suptitle(
        f"Prediction: {plan.width_m:.0f} × {plan.length_m:.0f} m, GSD {100 * plan.ground_sampling_m:.1f} cm, "
        f"{plan.height_m:.0f} m above ground; sigma in height {100 * median:.1f} cm, {100 * worst:.1f} cm at worst",
        fontsize=11,
    )
    save_picture(figure, path)
