"""One epoch alone: heaps over a height, or over the plane through the ground around their polygons.

The plane is fitted to the strip outside of the outline as two epochs are to stable ground: against a surface of height
0 without errors. So a shift and a tilt of the block leave the volume alone, and what the ground around says of itself,
its noise and how far it is from a plane, is in its standard deviation.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from photogram.arrays import Float32Array
from photogram.errors import PhotogramError, SurfaceError
from photogram.files.maps.polygon_files import SitePolygon
from photogram.files.maps.rasters import RasterFile
from photogram.grid import Window
from photogram.volumes.differences import Correction, Difference
from photogram.volumes.stable_ground import Registration, registration_of
from photogram.volumes.surfaces import StatedSigma, SurfaceFiles

RIM_WIDTHS = 3.0
"""Width of the strip around a polygon in widths of the windows of the matching."""


@dataclass(frozen=True)
class _Level(RasterFile):
    """Height 0 everywhere."""

    def read(self, window: Window) -> Float32Array:
        return np.zeros(window.shape, np.float32)


def over_level(surface: SurfaceFiles) -> Difference:
    """Return a surface minus height 0, which has no errors."""
    heights = surface.heights
    level = _Level(heights.path, heights.grid, heights.crs)
    earlier = SurfaceFiles(level, None, None, None, StatedSigma(0.0, 0.0), None, surface.correlation_m)
    return Difference(earlier, surface, heights.grid)


def at_level(difference: Difference, level_m: float) -> Correction:
    """Return what makes a difference from height 0 one from another height, which has no errors either."""
    return Correction(
        np.zeros(2), np.array([level_m]), np.zeros((1, 0)), np.zeros((difference.patterns(), 1)), remaining_m=0.0
    )


def rim_of(polygon: Any, width_m: float) -> Any:  # noqa: ANN401 - of shapely, which has no types
    """Return the strip of a width around a polygon."""
    return shapely.difference(shapely.buffer(polygon, width_m), polygon)


def base_of(difference: Difference, polygon: SitePolygon) -> tuple[Registration, Correction]:
    """Return the plane through the rim of a polygon, as an offset and a tilt over height 0. Raises SurfaceError where
    too little of the rim is measured."""
    rim = rim_of(polygon.polygon, RIM_WIDTHS * difference.later.correlation_m)
    try:
        return registration_of(difference, [rim], "tilt")
    except PhotogramError as error:
        raise SurfaceError(f"base of {polygon.name!r}, in a strip around it: {error}") from error
