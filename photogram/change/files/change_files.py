"""What has changed between two surfaces, and the files it is written to."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import Float32Array, FloatArray
from photogram.files.atomic import make_folder
from photogram.files.maps.cogs import Category, write_cog, write_cog_codes
from photogram.files.maps.polygon_files import SitePolygon
from photogram.files.npz_json import write_json
from photogram.geodesy.crs import plan_of
from photogram.grid import MapGrid, Window, block_of
from photogram.pipeline.stages.surfaces.volume_files import write_volumes
from photogram.pipeline.store.tiles import GridFile
from photogram.quality.cloud_comparison import CloudStatistics
from photogram.report.figures.difference_figure import DifferencePicture, difference_figure
from photogram.report.figures.style import save_picture
from photogram.volumes.differences import LOWERED, RAISED, UNCHANGED, Difference
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
    """Of all polygons; None without any, or where they overlap."""


@dataclass(frozen=True, eq=False)
class Layers:
    """The difference, its standard deviation and the part that is common, in files."""

    difference: GridFile
    sigma: GridFile
    common: GridFile
    codes: GridFile


def every_cell(layer: GridFile, step: int) -> FloatArray:
    """Return every ``step``-th cell along each axis of a layer."""
    grid = layer.grid
    rows = [
        layer.read(Window(row, 0, row + 1, grid.columns))[0, step // 2 :: step]
        for row in range(step // 2, grid.rows, step)
    ]
    return np.array(rows, dtype=np.float64)


def _tiles_of(layer: GridFile) -> Iterator[tuple[Window, Float32Array]]:
    return ((tile, layer.read(tile)) for tile in layer.grid.tiles(TILE_CELLS))


def write_change(
    output: Path,
    change: SurfaceChange,
    difference: Difference,
    layers: Layers,
    polygons: Sequence[SitePolygon],
    stable: Sequence[SitePolygon],
) -> None:
    """Write what has changed, its layers and its picture into a folder, each file whole or not at all."""
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
    step = block_of((grid.rows, grid.columns), MOST_SHOWN)
    thinned = every_cell(layers.difference, step)
    coarse = MapGrid(grid.west_map_m, grid.north_map_m, grid.cell_m * step, *thinned.shape)
    picture = DifferencePicture(
        thinned, every_cell(layers.codes, step) == UNCHANGED, coarse,
        [(p.name, p.polygon) for p in polygons], [p.polygon for p in stable], change.later, change.reference,
        {v.name: volume_words(v.net_m3, v.net_sigma_m3, v.unmeasured_m2 / v.area_m2) for v in change.volumes},
    )  # fmt: skip
    save_picture(difference_figure(picture), output / "comparison.png")
