"""Volumes of polygons over their bases, window by window: what the stage of a survey and `photogram compare` share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import shapely

from photogram.files.maps.polygon_files import SitePolygon
from photogram.grid import Window
from photogram.volumes.differences import Correction, Difference, DifferenceCells
from photogram.volumes.outlines import window_of
from photogram.volumes.rim_base import at_level, base_of
from photogram.volumes.stable_ground import Registration
from photogram.volumes.surfaces import PATTERNS
from photogram.volumes.volumes import Volume, VolumeSums, total
from photogram.wording import Progress, silent

TILE_CELLS = 1024

LARGEST_OVERLAP = 1e-3
"""Share of the smaller of two polygons by which they may overlap and still be added up."""


@dataclass(frozen=True, eq=False)
class BasedPolygon:
    """A polygon and what its volume counts from."""

    site: SitePolygon
    """Outline and name."""
    correction: Correction | None = None
    """What is taken off the difference; None: nothing."""
    rim: Registration | None = None
    """The plane through the ground around it, over height 0; None without one."""


TakeCells = Callable[[BasedPolygon, Window, DifferenceCells, tuple[slice, slice]], None]
"""Takes a polygon, a window of the grid within its bounds, the cells around that, and where among them it lies."""


def over_rim(difference: Difference, polygon: SitePolygon) -> BasedPolygon:
    """Return a polygon over the plane through the ground around it; the difference is one from height 0. Raises
    SurfaceError where too little of that ground is measured."""
    rim, correction = base_of(difference, polygon)
    return BasedPolygon(polygon, correction, rim)


def over_height(difference: Difference, polygon: SitePolygon, level_m: float) -> BasedPolygon:
    """Return a polygon over a height; the difference is one from height 0."""
    return BasedPolygon(polygon, at_level(difference, level_m))


def measured_volumes(
    difference: Difference,
    polygons: Sequence[BasedPolygon],
    outline_sigma_m: float = 0.0,
    take_cells: TakeCells = lambda *_: None,
    progress: Progress = silent,
) -> list[VolumeSums]:
    """Return the sums of each polygon over the windows of the grid that it reaches into, each of at most TILE_CELLS
    along a side. Lengths in m; ``outline_sigma_m`` is the standard deviation of the corners. Raises ProjectError where
    a raster is damaged."""
    grid, sums = difference.grid, []
    for done, polygon in enumerate(polygons, 1):
        site = polygon.site
        part = VolumeSums(site.name, site.polygon, grid, difference.patterns(polygon.correction), outline_sigma_m)
        reach = window_of(site.polygon, grid)
        tiles = () if reach is None else (reach.common(tile) for tile in grid.tiles(TILE_CELLS))
        for window in filter(None, tiles):
            outer = window.around(difference.margin)
            cells = difference.cells(outer, polygon.correction)
            part.add(difference, cells, outer, window)
            take_cells(polygon, window, cells, window.within(outer))
        sums.append(part)
        progress(done, len(polygons), site.name)
    return sums


def sum_of(sums: Sequence[VolumeSums], *, own_bases: bool) -> Volume | None:
    """Return the volumes of all polygons together, None of none or where they overlap. Where each has its own base,
    that base's errors are its own too."""
    return total(sums, 2 * PATTERNS if own_bases else None) if sums and not _overlap(sums) else None


def _overlap(sums: Sequence[VolumeSums]) -> bool:
    tree = shapely.STRtree([part.polygon for part in sums])
    for n, part in enumerate(sums):
        for k in tree.query(part.polygon, predicate="intersects"):
            other = sums[int(k)].polygon
            common = shapely.intersection(part.polygon, other).area
            if k > n and common > LARGEST_OVERLAP * min(part.area_m2, other.area):
                return True
    return False
