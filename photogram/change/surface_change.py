"""Two surfaces compared, tile by tile: the difference, its standard deviation, what has changed, volumes."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from photogram.arrays import IntArray
from photogram.change.files.change_files import MOST_SHOWN, TILE_CELLS, Layers, SurfaceChange, every_cell, write_change
from photogram.errors import ProjectError
from photogram.files.atomic import scratch_folder, temporary_name
from photogram.files.maps.polygon_files import SitePolygon, read_polygons
from photogram.grid import MapGrid, Window, block_of
from photogram.pipeline.store.tiles import GridFile
from photogram.quality.cloud_comparison import statistics
from photogram.report.surveyed_surfaces import NamedSurface, open_surface, open_surfaces
from photogram.volumes.differences import Correction, Difference, DifferenceCells, difference_of
from photogram.volumes.joint_errors import JointErrors
from photogram.volumes.measured_volumes import BasedPolygon, measured_volumes, over_height, over_rim, sum_of
from photogram.volumes.outlines import box_of, coverage, window_of
from photogram.volumes.rim_base import over_level
from photogram.volumes.stable_ground import Motion, Registration, registration_of
from photogram.volumes.surfaces import StatedSigma, labels
from photogram.volumes.volumes import VolumeSums
from photogram.wording import Progress, silent

JOINT = "dsm_sigma_own.tif, and the joint adjustment of both epochs"
"""Where the standard deviations of epochs come from that were adjusted together."""
EVERYWHERE = "everywhere"
"""What the volume of all that two surfaces cover is called."""


@dataclass(frozen=True)
class SurfaceRequest:
    """What is to be compared, and how."""

    later: Path
    earlier: Path | None
    """None: ``level_m``, or planes through the rims of the polygons."""
    polygons: Path | None = None
    """What volumes are asked for; None: everything that both surfaces cover."""
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
    level_m: float | None = None
    """A height that volumes count from, in place of an earlier surface; None without."""
    parts: tuple[str, ...] = ()
    """Which surfaces of a LandXML file, or layers of a drawing, are read; none: the only one."""


def compare_surfaces(
    request: SurfaceRequest, output: Path, progress: Progress = silent, joint: JointErrors | None = None
) -> SurfaceChange:
    """Compare two surfaces and write difference.tif, difference_sigma.tif, change.tif, volumes.csv, comparison.json and
    comparison.png into a folder. Lengths in m; ``joint`` are the errors of the difference of epochs that were adjusted
    together.

    Raises PhotogramError where a file is missing or damaged, the two do not fit together or the request contradicts
    itself; then nothing is written.
    """
    if request.coregister is not None and request.stable is None:
        raise ProjectError("co-registration: name the ground that has not moved (--stable POLYGONS)")
    if request.coregister == "rigid":
        raise ProjectError("co-registration: a rigid motion is one of clouds: choose offset or tilt for surfaces")
    if not 0.0 <= request.outline_sigma_m < np.inf:
        raise ProjectError(f"sigma of the outlines {request.outline_sigma_m:g} m: a length of 0 or more is expected")
    if request.level_m is not None and (request.earlier is not None or not np.isfinite(request.level_m)):
        raise ProjectError(f"volumes over the height {request.level_m:g} m: give one base, a height or a surface")
    progress(0, 0, "reading")
    if request.earlier is None:
        later = open_surface(request.later, request.sigma, request.correlation_m)
        return _over_bases(request, over_level(later), output, progress)
    named = NamedSurface(request.earlier, request.earlier_sigma), NamedSurface(request.later, request.sigma)
    opened = open_surfaces(*named, request.correlation_m, request.parts)
    difference = difference_of(opened.earlier, opened.later, joint)
    crs = difference.later.heights.crs
    drawn = [] if request.polygons is None else read_polygons(request.polygons, crs)
    polygons = drawn or [SitePolygon(EVERYWHERE, box_of(difference.grid))]
    stable = [] if request.stable is None else read_polygons(request.stable, crs)
    registration, correction = None, None
    if stable:
        progress(0, 0, "stable ground")
        motion: Literal["offset", "tilt"] = "tilt" if request.coregister == "tilt" else "offset"
        registration, correction = registration_of(difference, [p.polygon for p in stable], motion)
        correction = correction if request.coregister is not None else None
    _check_place(request, polygons, difference.grid)
    outline_sigma_m = request.outline_sigma_m if drawn else 0.0
    with _scratch_layers(output, difference.grid) as layers:
        sums, counts = _over_tiles(difference, correction, polygons, outline_sigma_m, layers, progress)
        names = labels(difference.later.heights.path, difference.earlier.heights.path)
        if not drawn:
            sums[0].area_m2 = sums[0].measured_m2 + sums[0].interpolated_m2
        change = _summary(
            difference, names, registration, correction is not None, (), sums, counts, layers, own_bases=False
        )
        change = replace(change, remarks=opened.remarks)
        progress(0, 0, "writing")
        write_change(output, change, difference, layers, drawn, stable)
    return change


def _check_place(request: SurfaceRequest, polygons: Sequence[SitePolygon], grid: MapGrid) -> None:
    for polygon in polygons:
        if window_of(polygon.polygon, grid) is None:
            raise ProjectError(
                f"polygons {request.polygons}: {polygon.name!r} lies beyond what the surfaces cover: remove it"
            )


def _over_bases(request: SurfaceRequest, difference: Difference, output: Path, progress: Progress) -> SurfaceChange:
    """Compare a surface with a height or with the planes through the rims of its polygons, and write what
    ``compare_surfaces`` does: there is a difference within the polygons alone."""
    level_m = request.level_m
    of = "volumes over the rims of polygons" if level_m is None else "volumes over a height"
    if request.polygons is None:
        raise ProjectError(f"{of}: name the polygons (--polygons FILE)")
    if request.stable is not None or request.earlier_sigma is not None:
        raise ProjectError(f"{of} are of one epoch: leave out what says how two lie")
    grid = difference.grid
    polygons = read_polygons(request.polygons, difference.later.heights.crs)
    _check_place(request, polygons, grid)
    based = [over_rim(difference, p) if level_m is None else over_height(difference, p, level_m) for p in polygons]
    with _scratch_layers(output, grid) as layers:
        counts = np.zeros(4, np.int64)
        _make_empty(layers)

        def fill(polygon: BasedPolygon, window: Window, cells: DifferenceCells, inner: tuple[slice, slice]) -> None:
            counts[:] += _fill(grid, cells, window, inner, layers, polygon.site)

        sums = measured_volumes(difference, based, request.outline_sigma_m, fill, progress)
        if not counts.sum():
            raise ProjectError(f"surface {request.later}: it has no height in any of the polygons: check both")
        base = "the plane through the rim" if level_m is None else f"the height {level_m:g} m"
        names = labels(difference.later.heights.path, Path(base))
        rims = tuple(polygon.rim for polygon in based if polygon.rim is not None)
        change = _summary(difference, names, None, False, rims, sums, counts, layers, own_bases=True)
        progress(0, 0, "writing")
        write_change(output, change, difference, layers, polygons, (), of_polygons=True)
    return change


@contextmanager
def _scratch_layers(output: Path, grid: MapGrid) -> Iterator[Layers]:
    """Yield layers that lie beside the folder of results until they are written there."""
    above = (output.absolute(), *output.absolute().parents)
    with scratch_folder(temporary_name(next(place for place in above if place.is_dir()))) as folder:
        yield Layers(*(GridFile(folder / name, grid) for name in ("d", "sigma", "common", "codes")))


def _make_empty(layers: Layers) -> None:
    for layer, nothing in (
        (layers.difference, np.nan),
        (layers.sigma, np.nan),
        (layers.common, 0),
        (layers.codes, 255),
    ):
        layer.make()
        for tile in layer.grid.tiles(TILE_CELLS):
            layer.write(tile, np.full(tile.shape, nothing, np.float32))


def _fill(
    grid: MapGrid,
    cells: DifferenceCells,
    tile: Window,
    inner: tuple[slice, slice],
    layers: Layers,
    within: SitePolygon | None = None,
) -> IntArray:
    """Fill a tile of the layers, of a polygon alone if there is one, from the ``inner`` ones of the cells around it;
    return cells by code and, last, interpolated ones."""
    counts = np.zeros(4, np.int64)
    values = (
        cells.difference_m[inner], cells.sigma_m[inner], np.sqrt(np.sum(cells.pattern_m**2, axis=0))[inner],
        cells.codes[inner].astype(np.float64),
    )  # fmt: skip
    chosen = np.ones(tile.shape, dtype=bool)
    if within is not None:
        chosen = coverage(within.polygon, grid, tile) > 0.0
    for layer, new in zip(vars(layers).values(), values, strict=True):
        layer.write(tile, np.where(chosen, new, layer.read(tile)).astype(np.float32))
    codes = cells.codes[inner][chosen]
    counts[:3] = np.bincount(codes[codes < 3], minlength=3)
    counts[3] = int((cells.interpolated & cells.known)[inner][chosen].sum())
    return counts


def _over_tiles(
    difference: Difference,
    correction: Correction | None,
    polygons: Sequence[SitePolygon],
    outline_sigma_m: float,
    layers: Layers,
    progress: Progress,
) -> tuple[list[VolumeSums], IntArray]:
    """Fill the layers tile by tile; return the sums of each polygon, and cells by code and, last, interpolated ones."""
    grid, patterns = difference.grid, difference.patterns(correction)
    sums = [VolumeSums(p.name, p.polygon, grid, patterns, outline_sigma_m) for p in polygons]
    windows = [window_of(p.polygon, grid) for p in polygons]
    tiles = list(grid.tiles(TILE_CELLS))
    counts = np.zeros(4, np.int64)
    for layer in vars(layers).values():
        layer.make()
    for done, tile in enumerate(tiles, 1):
        parts = [part for part, window in zip(sums, windows, strict=True) if window and window.common(tile)]
        outer = tile.around(difference.margin)
        cells = difference.cells(outer, correction)
        counts += _fill(grid, cells, tile, tile.within(outer), layers)
        for part in parts:
            part.add(difference, cells, outer, tile)
        progress(done, len(tiles), f"{grid.columns} × {grid.rows} cells of {grid.cell_m:g} m")
    if not counts.sum():
        raise ProjectError(
            f"surfaces {difference.later.heights.path} and {difference.earlier.heights.path}: nowhere do both have a "
            "height: check that they are of the same site"
        )
    return sums, counts


def _summary(
    difference: Difference,
    names: tuple[str, str],
    registration: Registration | None,
    applied: bool,
    bases: tuple[Registration, ...],
    sums: Sequence[VolumeSums],
    counts: IntArray,
    layers: Layers,
    *,
    own_bases: bool,
) -> SurfaceChange:
    grid, (earlier, later) = difference.grid, (difference.earlier, difference.later)
    step = block_of((grid.rows, grid.columns), MOST_SHOWN)
    d, sigma, common = (every_cell(layer, step) for layer in (layers.difference, layers.sigma, layers.common))
    known = np.isfinite(sigma)
    return SurfaceChange(
        later=names[0],
        reference=names[1],
        sigma_from=later.sigma_source if difference.joint is None else JOINT,
        reference_sigma_from=_base_sigma(bases)
        if own_bases
        else earlier.sigma_source
        if difference.joint is None
        else JOINT,
        correlation_m=later.correlation_m,
        reference_correlation_m=earlier.correlation_m,
        cell_m=grid.cell_m,
        rows=grid.rows,
        columns=grid.columns,
        resampled=difference.resampled,
        undeclared_heights=() if own_bases else difference.undeclared_heights,
        zeros_without_data=difference.zeros_without_data,
        impossible_heights=difference.impossible_heights,
        registration=registration,
        registration_applied=applied,
        cells=int(counts.sum()),
        interpolated_cells=int(counts[3]),
        within_level=int(counts[0]),
        lowered=int(counts[1]),
        raised=int(counts[2]),
        difference=statistics(d.ravel()),
        sigma_median_m=float(np.median(sigma[known])) if known.any() else float("nan"),
        common_sigma_median_m=float(np.median(common[known])) if known.any() else float("nan"),
        bases=bases,
        volumes=tuple(part.volume() for part in sums),
        total=sum_of(sums, own_bases=own_bases),
    )


def _base_sigma(rims: Sequence[Registration]) -> str:
    return "the ground around each polygon" if rims else "none: a height without errors"
