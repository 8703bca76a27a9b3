"""What the photographs of two epochs do to the difference of their surfaces, where one adjustment has both.

Errors that both epochs share, of calibration, control and everything that common tie points carry over, drop out of the
difference. What is left has a joint covariance at places over the site, F Fᵀ with a column of F for each independent
cause; between the places it is interpolated.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.ndimage import map_coordinates

from photogram.arrays import FloatArray
from photogram.grid import MapGrid, Window

NODE_CELLS = 32
"""Cells between the nodes at which a cause is evaluated; it changes over many photographs, not over cells."""


@dataclass(frozen=True, eq=False)
class JointErrors:
    """Errors of the difference of two epochs, later minus earlier, 1 sigma each: at places ``place_map_m`` (Q, 2)
    ``factor_m`` (Q, 3, R) along easting, northing and height, for R independent causes."""

    place_map_m: FloatArray
    factor_m: FloatArray

    @property
    def causes(self) -> int:
        """Return R."""
        return int(self.factor_m.shape[2])

    def patterns(self, grid: MapGrid, window: Window, rise_south: FloatArray, rise_east: FloatArray) -> FloatArray:
        """Return what each cause does to the heights of a window (R, rows, columns), m, by the slopes (rows, columns)
        of the ground: where it rises, a shift in plan is a difference in height."""
        east, north, up = self._at(grid, window)
        return np.asarray(up - rise_east * east + rise_south * north)

    def _at(self, grid: MapGrid, window: Window) -> FloatArray:
        """Return the causes at the cells of a window (3, R, rows, columns)."""
        rows, columns = (np.arange(-1, -(-count // NODE_CELLS) + 2) * NODE_CELLS for count in window.shape)
        easts, norths = grid.centres_map_m(window)
        step = grid.cell_m
        nodes = np.stack(
            np.meshgrid(easts[0] + columns * step, norths[0] - rows * step, indexing="xy"), axis=-1
        ).reshape(-1, 2)
        values = self._interpolated(nodes).reshape(len(rows), len(columns), -1)
        at = np.meshgrid(
            np.arange(window.shape[0]) / NODE_CELLS + 1.0, np.arange(window.shape[1]) / NODE_CELLS + 1.0, indexing="ij"
        )
        fine = [map_coordinates(values[:, :, k], at, order=1) for k in range(values.shape[2])]
        return np.asarray(fine).reshape(3, self.causes, *window.shape)

    def _interpolated(self, nodes: FloatArray) -> FloatArray:
        """Return the factors at nodes (N, 3 R): linear between the places, beyond them those of their rim."""
        flat = self.factor_m.reshape(len(self.place_map_m), -1)
        nearest = NearestNDInterpolator(self.place_map_m, flat)
        hull = shapely.MultiPoint(self.place_map_m).convex_hull
        if hull.geom_type != "Polygon":
            return np.asarray(nearest(nodes))
        points, rim = shapely.points(nodes), hull.exterior
        on_rim = shapely.get_coordinates(shapely.line_interpolate_point(rim, shapely.line_locate_point(rim, points)))
        within = np.where(shapely.intersects(hull, points)[:, None], nodes, on_rim)
        linear = LinearNDInterpolator(self.place_map_m, flat)(within)
        return np.asarray(np.where(np.isnan(linear), nearest(within), linear))
