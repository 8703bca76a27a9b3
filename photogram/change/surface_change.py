"""Two surfaces compared, tile by tile: the difference, its standard deviation, what has changed, volumes."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from photogram.arrays import FloatArray
from photogram.change.differences import (
    LOWERED,
    RAISED,
    UNCHANGED,
    Correction,
    Difference,
    difference_of,
)
from photogram.change.outlines import window_of
from photogram.change.stable_ground import Motion, Registration, registration_of
from photogram.change.surfaces import StatedSigma, labels, open_surface
from photogram.change.volumes import Volume, VolumeSums, total
from photogram.crs import plan_of
from photogram.errors import ProjectError
from photogram.files.atomic import make_folder, replacing, scratch_folder, temporary_name
from photogram.files.maps.cogs import Category, write_cog, write_cog_codes
from photogram.files.maps.polygon_files import SitePolygon, read_polygons
from photogram.files.npz_json import write_json
from photogram.grid import MapGrid, Window, block_of
from photogram.pipeline.store.tiles import GridFile
from photogram.quality.cloud_comparison import CloudStatistics, statistics
from photogram.report.figures.change_figure import DifferencePicture, difference_picture

TILE_CELLS = 1024
MOST_SHOWN = 1400
"""Cells along a side of the picture, and of what statistics are made of."""

LARGEST_OVERLAP = 1e-3
"""Share of the smaller of two polygons by which they may overlap and still be added up."""

CHANGES = (
    Category(UNCHANGED, "within the level of detection", (225, 225, 225)),
    Category(LOWERED, "lower", (33, 102, 172)),
    Category(RAISED, "higher", (178, 24, 43)),
)

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class SurfaceRequest:
    """What is to be compared, and how."""

    later: Path
    earlier: Path
    polygons: Path | None = None
    """What volumes are asked for."""
    stable: Path | None = None
    """Ground that has not moved."""
    coregister: Motion | None = None
    """What is taken off; None: it is reported alone."""
    sigma: StatedSigma | None = None
    """Of the later surface, in place of its files."""
    earlier_sigma: StatedSigma | None = None
    """Of the earlier one."""
    correlation_m: float | None = None
    """Width over which own errors correlate; None: that of the windows of the matching."""
    outline_sigma_m: float = 0.0
    """Standard deviation of the corners of the polygons, east and north each."""


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
    volumes: tuple[Volume, ...]
    total: Volume | None
    """Of all polygons; None without any, or where they overlap."""


@dataclass(frozen=True, eq=False)
class _Layers:
    """The difference, its standard deviation and the part that is common, in files."""

    difference: GridFile
    sigma: GridFile
    common: GridFile
    codes: GridFile


def compare_surfaces(request: SurfaceRequest, output: Path, progress: Progress) -> SurfaceChange:
    """Compare two surfaces and write difference.tif, difference_sigma.tif, change.tif, volumes.csv, comparison.json and
    comparison.png into a folder; nothing of it is written where anything is wrong with what is read."""
    if request.coregister is not None and request.stable is None:
        raise ProjectError("co-registration: name the ground that has not moved (--stable POLYGONS)")
    if request.coregister == "rigid":
        raise ProjectError("co-registration: a rigid motion is one of clouds: choose offset or tilt for surfaces")
    if not 0.0 <= request.outline_sigma_m < np.inf:
        raise ProjectError(f"sigma of the outlines {request.outline_sigma_m:g} m: a length of 0 or more is expected")
    progress(0, 0, "reading")
    difference = difference_of(
        open_surface(request.earlier, request.earlier_sigma, request.correlation_m),
        open_surface(request.later, request.sigma, request.correlation_m),
    )
    crs = difference.later.heights.crs
    polygons = [] if request.polygons is None else read_polygons(request.polygons, crs)
    stable = [] if request.stable is None else read_polygons(request.stable, crs)
    registration, correction = None, None
    if stable:
        progress(0, 0, "stable ground")
        motion: Literal["offset", "tilt"] = "tilt" if request.coregister == "tilt" else "offset"
        registration, found = registration_of(difference, [p.polygon for p in stable], motion)
        correction = found if request.coregister is not None else None
    for polygon in polygons:
        if window_of(polygon.polygon, difference.grid) is None:
            raise ProjectError(
                f"polygons {request.polygons}: {polygon.name!r} lies beyond what both surfaces cover: remove it"
            )
    with scratch_folder(temporary_name(_existing(output))) as folder:
        layers = _Layers(*(GridFile(folder / name, difference.grid) for name in ("d", "sigma", "common", "codes")))
        sums, counts = _over_tiles(difference, correction, polygons, request.outline_sigma_m, layers, progress)
        change = _summary(difference, registration, correction is not None, sums, counts, layers)
        progress(0, 0, "writing")
        _write(output, change, difference, layers, polygons, stable)
    return change


def _existing(folder: Path) -> Path:
    """Return a folder, or the nearest one above it that is there."""
    return next(place for place in (folder.absolute(), *folder.absolute().parents) if place.is_dir())


def _over_tiles(
    difference: Difference,
    correction: Correction | None,
    polygons: Sequence[SitePolygon],
    outline_sigma_m: float,
    layers: _Layers,
    progress: Progress,
) -> tuple[list[VolumeSums], NDArray[np.int64]]:
    """Fill the layers tile by tile; return the sums of each polygon, and cells by code and, last, interpolated ones."""
    grid, patterns = difference.grid, difference.patterns(correction)
    sums = [VolumeSums(p.name, p.polygon, grid, patterns, outline_sigma_m) for p in polygons]
    windows = [window_of(p.polygon, grid) for p in polygons]
    tiles = list(grid.tiles(TILE_CELLS))
    counts = np.zeros(4, np.int64)
    for layer in vars(layers).values():
        layer.make()
    for done, tile in enumerate(tiles, 1):
        margin = difference.margin
        outer = Window(tile.row - margin, tile.column - margin, tile.row_end + margin, tile.column_end + margin)
        cells, inner = difference.cells(outer, correction), tile.within(outer)
        codes, sigma = cells.codes[inner], cells.sigma_m[inner]
        layers.difference.write(tile, cells.difference_m[inner].astype(np.float32))
        layers.sigma.write(tile, sigma.astype(np.float32))
        layers.common.write(tile, np.sqrt(np.sum(cells.pattern_m**2, axis=0))[inner].astype(np.float32))
        layers.codes.write(tile, codes.astype(np.float32))
        counts[:3] += np.bincount(codes[codes < 3], minlength=3)
        counts[3] += int((cells.interpolated & cells.known)[inner].sum())
        for part, window in zip(sums, windows, strict=True):
            if window is not None and _meet(window, tile):
                part.add(difference, cells, outer, tile)
        progress(done, len(tiles), f"{grid.columns} × {grid.rows} cells of {grid.cell_m:g} m")
    if not counts.sum():
        raise ProjectError(
            f"surfaces {difference.later.heights.path} and {difference.earlier.heights.path}: nowhere do both have a "
            "height: check that they are of the same site"
        )
    return sums, counts


def _meet(first: Window, second: Window) -> bool:
    return (
        first.row < second.row_end
        and second.row < first.row_end
        and first.column < second.column_end
        and second.column < first.column_end
    )


def _every(layer: GridFile, step: int) -> FloatArray:
    """Return every ``step``-th cell along each axis of a layer."""
    grid = layer.grid
    rows = [
        layer.read(Window(row, 0, row + 1, grid.columns))[0, step // 2 :: step]
        for row in range(step // 2, grid.rows, step)
    ]
    return np.array(rows, dtype=np.float64)


def _summary(
    difference: Difference,
    registration: Registration | None,
    applied: bool,
    sums: Sequence[VolumeSums],
    counts: NDArray[np.int64],
    layers: _Layers,
) -> SurfaceChange:
    grid, (earlier, later) = difference.grid, (difference.earlier, difference.later)
    step = block_of((grid.rows, grid.columns), MOST_SHOWN)
    d, sigma, common = (_every(layer, step) for layer in (layers.difference, layers.sigma, layers.common))
    told = np.isfinite(sigma)
    return SurfaceChange(
        *labels(later.heights.path, earlier.heights.path), later.told_by, earlier.told_by, later.correlation_m,
        earlier.correlation_m, grid.cell_m, grid.rows, grid.columns, difference.resampled, registration, applied,
        int(counts.sum()), int(counts[3]), int(counts[0]), int(counts[1]), int(counts[2]), statistics(d.ravel()),
        float(np.median(sigma[told])) if told.any() else float("nan"),
        float(np.median(common[told])) if told.any() else float("nan"),
        tuple(part.volume() for part in sums), total(sums) if sums and not _overlap(sums) else None,
    )  # fmt: skip


def _overlap(sums: Sequence[VolumeSums]) -> bool:
    tree = shapely.STRtree([part.polygon for part in sums])
    for n, part in enumerate(sums):
        for k in tree.query(part.polygon, predicate="intersects"):
            other = sums[int(k)].polygon
            common = shapely.intersection(part.polygon, other).area
            if k > n and common > LARGEST_OVERLAP * min(part.area_m2, other.area):
                return True
    return False


def _tiles_of(layer: GridFile) -> Iterator[tuple[Window, NDArray[np.float32]]]:
    return ((tile, layer.read(tile)) for tile in layer.grid.tiles(TILE_CELLS))


def _write(
    output: Path,
    change: SurfaceChange,
    difference: Difference,
    layers: _Layers,
    polygons: Sequence[SitePolygon],
    stable: Sequence[SitePolygon],
) -> None:
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
        write_volumes(output / "volumes.csv", change)
    write_json(output / "comparison.json", {Path(change.later).stem: {"method": "height", **asdict(change)}})
    step = block_of((grid.rows, grid.columns), MOST_SHOWN)
    thinned = _every(layers.difference, step)
    shown = MapGrid(grid.west_map_m, grid.north_map_m, grid.cell_m * step, *thinned.shape)
    picture = DifferencePicture(
        thinned, _every(layers.codes, step) == UNCHANGED, shown,
        [(p.name, p.polygon) for p in polygons], [p.polygon for p in stable], change.later, change.reference,
        [(v.name, v.net_m3, v.net_sigma_m3) for v in change.volumes],
    )  # fmt: skip
    difference_picture(output / "comparison.png", picture)


def write_volumes(path: Path, change: SurfaceChange) -> None:
    """Write a line for each polygon and, where they do not overlap, one for all; whole or not at all."""
    rows: list[dict[str, Any]] = [asdict(v) for v in (*change.volumes, *([change.total] if change.total else []))]
    with replacing(path) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, [f.name for f in fields(Volume)], lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: v if isinstance(v, str) else f"{v:.4f}" for k, v in row.items()})
