"""What ``.plot()`` of the main data types draws: in the current axes of matplotlib, for a notebook or a script."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from photogram.grid import MapGrid
from photogram.results import Adjustment
from photogram.survey import PointCloud, Raster

MOST_POINTS = 20_000
"""Of a cloud, evenly chosen."""

ERROR_SHARE = 0.05
"""Length of the largest residual of a control point, as a share of the survey."""


def plot_raster(raster: Raster) -> None:
    """Draw a raster as a picture in the map, with a bar of its values."""
    axes = plt.gca()
    picture = axes.imshow(raster.values, extent=MapGrid.of(raster).extent_map_m, cmap="terrain")
    plt.colorbar(picture, ax=axes, label="m")
    _name(axes)


def plot_cloud(cloud: PointCloud) -> None:
    """Draw a cloud from above: in its own colours, or by height."""
    step = max(1, -(-len(cloud) // MOST_POINTS))
    east, north, height = cloud.position_map_m[::step].T
    axes = plt.gca()
    if cloud.colour is not None:
        axes.scatter(east, north, s=1.0, c=cloud.colour[::step] / 255.0)
    else:
        plt.colorbar(axes.scatter(east, north, s=1.0, c=height, cmap="terrain"), ax=axes, label="height, m")
    _name(axes)


def plot_adjustment(result: Adjustment) -> None:
    """Draw photographs and ground points from above, with the residuals of the control points (adjusted minus surveyed,
    in plan) as arrows that a scale explains."""
    block, axes = result.block, plt.gca()
    centre = np.array([pose.position_world_m for pose in block.poses if pose is not None])
    axes.plot(*block.frame.map_from_world(centre)[:, :2].T, "^", color="tab:blue", label="photographs")
    roles = np.array(block.control_points.role, dtype=np.str_)
    for role, mark in (("control", "s"), ("check", "o")):
        chosen = roles == role
        if chosen.any():
            place = block.frame.map_from_world(block.control_points.position_world_m[chosen])
            axes.plot(*place[:, :2].T, mark, fillstyle="none", label=f"{role} points")
    control = np.flatnonzero(roles == "control")
    if len(control):
        _draw_residuals(axes, result, control)
    axes.legend()
    _name(axes)


def _draw_residuals(axes: Axes, result: Adjustment, control: np.ndarray[tuple[int], np.dtype[np.int64]]) -> None:
    points, frame = result.block.control_points, result.block.frame
    surveyed = frame.map_from_world(points.position_world_m[control])
    residual_m = (frame.map_from_world(result.estimates.ground_world_m[control]) - surveyed)[:, :2]
    known = np.isfinite(residual_m).all(axis=1)
    longest_m = float(np.linalg.norm(residual_m[known], axis=1).max(initial=0.0))
    if longest_m == 0.0:
        return
    extent_m = float(np.ptp(axes.dataLim.get_points(), axis=0).max())
    scale = longest_m / (ERROR_SHARE * extent_m)
    arrows = axes.quiver(*surveyed[known, :2].T, *residual_m[known].T, angles="xy", scale_units="xy", scale=scale)
    axes.quiverkey(arrows, 0.85, 1.03, longest_m, f"{1000.0 * longest_m:.1f} mm", labelpos="E")


def _name(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel("easting, m")
    axes.set_ylabel("northing, m")
    axes.ticklabel_format(useOffset=False, style="plain")
