"""What has changed between two surfaces, and the files it is written to."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from photogram.arrays import Float32Array, FloatArray
from photogram.files.atomic import make_folder
from photogram.files.maps.cogs import Category, write_cog, write_cog_codes
from photogram.files.maps.polygon_files import SitePolygon
from photogram.files.maps.rasters import RasterFile
from photogram.files.npz_json import write_json
from photogram.geodesy.crs import plan_of
from photogram.grid import MapGrid, Window, block_of
from photogram.pipeline.stages.surfaces.volume_files import write_volumes
from photogram.pipeline.store.tiles import GridFile
from photogram.quality.cloud_comparison import CloudStatistics
from photogram.report.figures.difference_figure import DifferencePicture, difference_figure
from photogram.report.figures.style import save_picture
from photogram.volumes.differences import LOWERED, RAISED, UNCHANGED, Difference
from photogram.volumes.outlines import window_of_all
from photogram.volumes.stable_ground import Registration
from photogram.volumes.volumes import Volume, volume_words

TILE_CELLS = 1024
MOST_SHOWN = 1400
"""Cells along a side of the picture, and of what statistics are made of."""

CHANGES = (
    Category(UNCHANGED, "within the level of detection", (225, 225, 225)),
    Category(LOWERED, "lower", (33, 102, 172)),
    Category(RAISED, "higher", (178, 24, 43)),
)


@dataclass(frozen=True, eq=False)
class SurfaceChange:
    """What has changed between two surfaces, as comparison.json holds it."""

    later: str
    reference: str
    sigma_from: str
    """Where the later surface's standard deviations come from."""
    reference_sigma_from: str
    """Where the earlier one's do."""
    correlation_m: float
    reference_correlation_m: float
    cell_m: float
    rows: int
    columns: int
    resampled: tuple[str, ...]
    """Surfaces that were interpolated on the grid of the other."""
    undeclared_heights: tuple[str, ...]
    """The surface that does not say what its heights count from, where the other one does."""
    zeros_without_data: tuple[str, ...]
    """Surfaces whose zeros stand for no data, which they do not declare."""
    impossible_heights: tuple[str, ...]
    """Surfaces whose heights beyond all ground stand for no data, which they do not declare."""
    registration: Registration | None
    """How the later surface lies over the earlier one on stable ground; None without any."""
    registration_applied: bool
    """Whether it was taken off."""
    cells: int
    """Cells with a difference."""
    interpolated_cells: int
    """Of these, filled or without a standard deviation."""
    within_level: int
    """Cells within the level of detection."""
    lowered: int
    raised: int
    difference: CloudStatistics
    """Of the difference; of a large raster, of evenly chosen cells."""
    sigma_median_m: float
    """Median standard deviation of the difference."""
    common_sigma_median_m: float
    """Of it, what cells share."""
    bases: tuple[Registration, ...]
    """Planes through the rims of the polygons, over height 0, where there is one epoch alone."""
    volumes: tuple[Volume, ...]
    total: Volume | None
    """Of all polygons; None where they overlap."""
    remarks: tuple[str, ...] = ()
    """What was assumed of a surface or converted, in sentences."""


@dataclass(frozen=True, eq=False)
class Layers:
    """The difference, its standard deviation and the part that is common, in files."""

    difference: GridFile
    sigma: GridFile
    common: GridFile
    codes: GridFile


def every_cell(layer: GridFile | RasterFile, step: int, window: Window | None = None) -> FloatArray:
    """Return every ``step``-th cell along each axis of a layer, or of a window of it."""
    part = layer.grid.whole if window is None else window
    rows = [
        layer.read(Window(row, part.column, row + 1, part.column_end))[0, step // 2 :: step]
        for row in range(part.row + step // 2, part.row_end, step)
    ]
    return np.array(rows, dtype=np.float64)


def _around(polygons: Sequence[SitePolygon], grid: MapGrid) -> Window:
    """Return the window of polygons and a fifth of its longer side around them."""
    window = window_of_all([p.polygon for p in polygons], grid)
    return grid.around_window(window, max(window.shape) // 5)


def _tiles_of(layer: GridFile) -> Iterator[tuple[Window, Float32Array]]:
    return ((tile, layer.read(tile)) for tile in layer.grid.tiles(TILE_CELLS))


def write_change(
    output: Path,
    change: SurfaceChange,
    difference: Difference,
    layers: Layers,
    polygons: Sequence[SitePolygon],
    stable: Sequence[SitePolygon],
    *,
    of_polygons: bool = False,
) -> None:
    """Write what has changed, its layers and its picture into a folder, each file whole or not at all. There may be a
    difference within the polygons alone: then the picture shows these, on the ground around."""
    grid, crs = difference.grid, plan_of(difference.later.heights.crs)
    make_folder(output)
    write_cog(
        output / "difference.tif", grid, crs, _tiles_of(layers.difference), description="height, later minus earlier"
    )
    write_cog(
        output / "difference_sigma.tif", grid, crs, _tiles_of(layers.sigma),
        description="standard deviation of the difference",
    )  # fmt: skip
    codes = ((tile, values.astype(np.uint8)) for tile, values in _tiles_of(layers.codes))
    write_cog_codes(output / "change.tif", grid, crs, codes, categories=CHANGES)
    if change.volumes:
        write_volumes(output / "volumes.csv", [*change.volumes, *([change.total] if change.total else [])])
    write_json(output / "comparison.json", {Path(change.later).stem: {"method": "height", **asdict(change)}})
    window = _around(polygons, grid) if of_polygons else grid.whole
    step = block_of(window.shape, MOST_SHOWN)
    thinned = every_cell(layers.difference, step, window)
    corner = grid.west_map_m + window.column * grid.cell_m, grid.north_map_m - window.row * grid.cell_m
    picture = DifferencePicture(
        thinned, every_cell(layers.codes, step, window) == UNCHANGED,
        MapGrid(*corner, grid.cell_m * step, *thinned.shape),
        [(p.name, p.polygon) for p in polygons], [p.polygon for p in stable], change.later, change.reference,
        {v.name: volume_words(v.net_m3, v.net_sigma_m3, v.unmeasured_m2 / v.area_m2) for v in change.volumes},
    )  # fmt: skip
    if of_polygons:
        ground_m = every_cell(difference.later.heights, step, window)
        picture = replace(picture, what="height above the base, m", height_m=ground_m)
    save_picture(difference_figure(picture), output / "comparison.png")
