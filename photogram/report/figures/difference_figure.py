"""The difference of two epochs as a map: raised and lowered ground, what lies within the level of detection, polygons
with their volumes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from photogram.arrays import BoolArray, FloatArray
from photogram.grid import MapGrid
from photogram.measures.round_lengths import round_up
from photogram.report.figures.profile_figure import hillshade
from photogram.report.figures.style import map_axes, new_figure

Geometry = Any  # of shapely, which has no types
PALE = 0.45
"""How much of its colour a cell within the level of detection keeps."""

MOST_CELLS = 1000
"""Cells along a side of a picture of points."""

NO_DATA, STABLE_COLOUR = "#b0b0b0", "#009E73"


@dataclass(frozen=True, eq=False)
class DifferencePicture:
    """What the picture of a difference shows, thinned to a size for it."""

    difference_m: FloatArray
    """Later minus earlier (rows, columns)."""
    within: BoolArray
    """Within the level of detection (rows, columns)."""
    grid: MapGrid
    """Of the cells shown."""
    polygons: Sequence[tuple[str, Geometry]]
    """Names and outlines of what volumes are of."""
    stable: Sequence[Geometry]
    """Ground taken as stable."""
    later: str
    earlier: str
    volumes: Mapping[str, str] = field(default_factory=dict)
    """What is written under the name of a polygon."""
    what: str = "height, later minus earlier, m"
    """What the colours show."""
    height_m: FloatArray | None = None
    """Heights of the ground (rows, columns), shaded beside the polygons; None: nothing is shown there."""


def difference_figure(picture: DifferencePicture) -> Figure:
    """Draw a difference on a diverging scale around 0, pale within the level of detection, with polygons and what
    changed in them."""
    d, grid = picture.difference_m, picture.grid
    known = np.isfinite(d)
    changed = np.abs(d[known & ~picture.within]) if np.any(known & ~picture.within) else np.abs(d[known])
    limit_m = round_up(max(float(np.percentile(changed, 97)) if len(changed) else 0.0, 1e-3))
    scale = ScalarMappable(Normalize(-limit_m, limit_m), "RdBu_r")
    colours = scale.to_rgba(np.where(known, d, 0.0))
    pale = picture.within & known
    colours[pale, :3] = 1.0 - PALE * (1.0 - colours[pale, :3])
    colours[..., 3] = known
    width = float(np.clip(8.5 * grid.columns / grid.rows, 3.5, 8.5))
    figure = new_figure(width + 1.6, max(width * grid.rows / grid.columns, 2.2) + 1.5)
    axes = figure.add_subplot(facecolor=NO_DATA)
    if picture.height_m is not None and np.isfinite(picture.height_m).any():
        shaded = hillshade(picture.height_m, grid.cell_m)
        axes.imshow(shaded, extent=grid.extent_map_m, interpolation="nearest", cmap="gray", vmin=-0.5, vmax=1.2)
    axes.imshow(colours, extent=grid.extent_map_m, interpolation="nearest")
    frame = axes.get_xlim(), axes.get_ylim()
    for outline in picture.stable:
        _outline(axes, outline, STABLE_COLOUR, "--")
    for name, outline in picture.polygons:
        _outline(axes, outline, "black", "-")
        _label(axes, name, outline, picture.volumes.get(name))
    axes.set(xlim=frame[0], ylim=frame[1])
    map_axes(axes)
    if picture.height_m is None:
        axes.set_title(f"{picture.later} minus {picture.earlier}", fontsize=11)
    else:
        axes.set_title(f"Volumes over {picture.earlier}", fontsize=11)
    bar = figure.colorbar(scale, ax=axes, shrink=0.8, extend="both", pad=0.02)
    bar.set_label(picture.what, fontsize=9)
    bar.ax.tick_params(labelsize=8)
    missing = "not measured in both" if picture.height_m is None else "not measured"
    signs: list[Patch | Line2D] = [Patch(facecolor=NO_DATA, label=missing)]
    if pale.any():
        label = "pale: within the level of detection (95 %)"
        signs.insert(0, Patch(facecolor="#f3f3f3", edgecolor="#999999", label=label))
    if picture.stable:
        signs.append(Line2D([], [], color=STABLE_COLOUR, linestyle="--", label="stable ground"))
    figure.legend(handles=signs, loc="outside lower center", ncols=len(signs), frameon=False, fontsize=8)
    return figure


def _outline(axes: Any, polygon: Geometry, colour: str, line: str) -> None:  # noqa: ANN401 - of matplotlib
    for ring in shapely.get_rings(polygon):
        axes.plot(*shapely.get_coordinates(ring).T, color=colour, linestyle=line, linewidth=1.2)


def _label(axes: Any, name: str, polygon: Geometry, volume: str | None) -> None:  # noqa: ANN401
    text = name if volume is None else f"{name}\n{volume}"
    place = polygon.representative_point()
    halo = [withStroke(linewidth=2.5, foreground="white")]
    axes.text(place.x, place.y, text, ha="center", va="center", fontsize=7.5, path_effects=halo, clip_on=True)


def gridded(place_map_m: FloatArray, values: FloatArray, within: BoolArray) -> tuple[FloatArray, BoolArray, MapGrid]:
    """Return points (N, 2 or 3) as means over cells that hold two of them on average: values (rows, columns), NaN
    without a point; which cells have all points within the level of detection; and their grid."""
    extent = np.maximum(np.ptp(place_map_m[:, :2], axis=0), 1e-3)
    cell_m = float(max(np.sqrt(2.0 * extent.prod() / len(place_map_m)), extent.max() / MOST_CELLS))
    grid = MapGrid.around(place_map_m, cell_m)
    column = np.minimum((place_map_m[:, 0] - grid.west_map_m) // cell_m, grid.columns - 1).astype(np.int64)
    row = np.minimum((grid.north_map_m - place_map_m[:, 1]) // cell_m, grid.rows - 1).astype(np.int64)
    at, size = row * grid.columns + column, grid.rows * grid.columns
    count = np.bincount(at, minlength=size)
    mean = np.where(count > 0, np.bincount(at, values, size) / np.maximum(count, 1), np.nan)
    beyond = np.bincount(at, ~within, size)
    shape = grid.rows, grid.columns
    return mean.reshape(shape), (beyond == 0).reshape(shape), grid
