"""A surface on disk, and what its rasters and its owner say of its errors.

An error of a cell has two parts. Its own differs from cell to cell, and is correlated over the window of the matching
alone. What is common is a sum of patterns over the whole survey, each times one random number with standard deviation
1: a shift in plan, which raises slopes, a tilt, and the rest.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import BoolArray, Float32Array, FloatArray
from photogram.errors import ProjectError, SettingError
from photogram.files.maps.rasters import RasterFile, open_raster
from photogram.grid import MapGrid, Window
from photogram.result_files import ResultFolder, result_path
from photogram.surface.dsm import FILLED, INTERPOLATED, WATER, measured_in

WINDOW_CELLS = 5.0
"""Width of the windows in which heights were matched, in cells, at most (2.5 to 5): what their errors are correlated
over unless it is stated."""

SLOPE_STEPS = 2
"""Cells to each side over which a slope is taken."""

SURFACE_SUFFIXES = (".tif", ".tiff")
"""Of files of surfaces, in lower case."""

LARGEST_M = 20_000.0
"""Of a height or its standard deviation: what is larger is damage."""

PATTERNS = 5
"""Patterns of a surface: shifts east and north, tilts east and north, the rest."""


@dataclass(frozen=True)
class StatedSigma:
    """What is stated of a surface or cloud whose files do not say it."""

    own_m: float
    """Standard deviation of a height of its own."""
    common_m: float
    """Of what all heights share."""

    def __post_init__(self) -> None:
        if not (0.0 <= self.own_m < np.inf and 0.0 <= self.common_m < np.inf):
            raise ProjectError(f"sigma {self.own_m:g} {self.common_m:g}: two lengths in m are expected, 0 or more")


@dataclass(frozen=True)
class BlockErrors:
    """What an adjustment says of the errors of its whole block, 1 sigma."""

    shift_east_m: float
    """Common shift, east."""
    shift_north_m: float
    """Common shift, north."""
    tilt: float
    """Rise over run, about each axis."""
    middle_map_m: tuple[float, float] | None = None
    """What it tilts about; None: the middle of the raster."""

    @staticmethod
    def of(shift_east_m: float, shift_north_m: float, tilt_m: float, radius_m: float) -> "BlockErrors":
        """Return the errors of a block that tilts by ``tilt_m`` over ``radius_m``, by nothing where that is 0."""
        return BlockErrors(shift_east_m, shift_north_m, tilt_m / radius_m if radius_m > 0.0 else 0.0)


@dataclass(frozen=True)
class SurfaceFiles:
    """A surface and the rasters beside it."""

    heights: RasterFile
    sigma: RasterFile | None
    """Standard deviations, both parts."""
    own: RasterFile | None
    """The part of its own."""
    source: RasterFile | None
    """Codes of the cells: which are filled, which were measured in larger ones."""
    stated: StatedSigma | None
    """In place of the rasters."""
    block: BlockErrors | None
    """None where nothing tells it: then all that is common is alike everywhere."""
    correlation_m: float
    """Width over which own errors correlate."""

    @property
    def sigma_source(self) -> str:
        """Return in words where its standard deviations come from."""
        if self.stated is not None:
            return f"stated: {self.stated.own_m:g} m own, {self.stated.common_m:g} m common"
        assert self.sigma is not None
        if self.own is None:
            return f"{self.sigma.path.name}, the whole of it taken as common"
        report = ", report.json" if self.block is not None else ""
        return f"{self.sigma.path.name}, {self.own.path.name}{report}"


SURFACE = "dsm.tif"
"""The surface of a survey, among its results."""


def labels(later: Path, earlier: Path) -> tuple[str, str]:
    """Return what two files are called: by their names, with their folders where these are alike."""
    if later.name != earlier.name:
        return later.name, earlier.name
    folders = [path.absolute().parent for path in (later, earlier)]
    results = [f.parent if f.name in tuple(ResultFolder) else f for f in folders]
    names = [(f.parent if f.name == "results" else f).name for f in results]
    return f"{names[0]}/{later.name}", f"{names[1]}/{earlier.name}"


def in_survey(path: Path, name: str) -> Path:
    """Return a file of the folder of a survey, or of its results, a path to a file as it is."""
    if not path.is_dir():
        return path
    places = (result_path(path, name), result_path(path / "results", name))
    return next((place for place in places if place.is_file()), path / name)


def surface_path(path: Path) -> Path:
    """Return the surface of the folder of a survey, or of its results, a path to a file as it is."""
    return in_survey(path, SURFACE)


def open_rasters(
    path: Path,
    stated: StatedSigma | None,
    correlation_m: float | None,
    block: BlockErrors | None,
    *,
    local: bool,
    assumed_crs: str | None = None,
) -> SurfaceFiles:
    """Return a surface and the rasters beside it: of ``NAME.tif`` or ``NAME_filled.tif`` ``NAME_sigma``,
    ``NAME_sigma_own`` and ``NAME_source``. ``block`` is what is known of the errors of its whole block, ``local``
    whether it may lie in a frame without a CRS, ``assumed_crs`` that of a file that names none.

    Raises ProjectError or FrameError where one is damaged or does not fit the others, or nothing says how large its
    errors are.
    """
    heights = open_raster(path, local=local, assumed_crs=assumed_crs)
    name = path.stem.removesuffix("_filled")
    sigma, own, source = (
        _beside(heights, f"{name}_{part}.tif", local, assumed_crs) for part in ("sigma", "sigma_own", "source")
    )
    if stated is None and sigma is None:
        raise ProjectError(
            f"surface {path}: no standard deviations beside it ({name}_sigma.tif): state two, of a height by itself "
            "and of what all share (--sigma OWN COMMON, --reference-sigma OWN COMMON, m)"
        )
    if stated is None and source is None and correlation_m is None:
        raise ProjectError(
            f"surface {path}: no {name}_source.tif beside it, it was not matched cell by cell: state over which length "
            "its errors are alike (--correlation, m), of a triangulated surface the distance of its points"
        )
    length_m = correlation_over(heights.grid, correlation_m)
    return SurfaceFiles(heights, sigma, own, source, stated, None if stated is not None else block, length_m)


def correlation_over(grid: MapGrid, stated_m: float | None) -> float:
    """Return the width over which own errors of cells correlate, m: as stated, else that of the windows of the
    matching. Raises SettingError for no length."""
    length_m = WINDOW_CELLS * grid.cell_m if stated_m is None else stated_m
    if not 0.0 < length_m < np.inf:
        raise SettingError("correlation", f"must be a positive length, found {length_m:g} m")
    return length_m


def accompanying(surface: Path, name: str) -> Path:
    """Return where a file that goes with a surface lies: beside it, or in the other folder of its survey."""
    beside, results = surface.with_name(name), surface.absolute().parent.parent
    sorted_out = surface.absolute().parent.name == ResultFolder.DELIVERABLES and not beside.is_file()
    return results / ResultFolder.QUALITY / name if sorted_out else beside


def _beside(heights: RasterFile, name: str, local: bool, assumed_crs: str | None) -> RasterFile | None:
    path = accompanying(heights.path, name)
    if not path.is_file():
        return None
    raster = open_raster(path, local=local, assumed_crs=assumed_crs)
    if raster.grid != heights.grid:
        raise ProjectError(f"raster {path}: its cells are not those of {heights.path.name}: make both again together")
    return raster


@dataclass(frozen=True, eq=False)
class SurfaceCells:
    """A window of a surface, (rows, columns) each; NaN heights where it has none."""

    height_m: FloatArray
    own_m: FloatArray
    """Standard deviation of their own, NaN where none is known: filled cells."""
    width: FloatArray
    """Width of the errors' correlation in that of the surface: 1, 2, 4, 8 where cells were measured in larger ones."""
    pattern_m: FloatArray
    """Common errors (PATTERNS, rows, columns), each of standard deviation 1 times this."""
    interpolated: BoolArray
    """Filled from neighbours, or for another reason without a standard deviation."""


def surface_cells(surface: SurfaceFiles, grid: MapGrid, window: Window) -> SurfaceCells:
    """Return a window of a grid over a surface; its own grid is read as it is, another one is interpolated bilinearly
    between cells that all have heights. Slopes at the window's outermost SLOPE_STEPS cells are taken as 0."""
    height = _on_grid(surface.heights, grid, window, -LARGEST_M)
    nothing = np.zeros(height.shape)
    width, interpolated = np.ones(height.shape), np.zeros(height.shape, dtype=bool)
    if surface.source is not None:
        code = _nearest(surface.source, grid, window)
        interpolated = np.isin(code, (FILLED, WATER, INTERPOLATED))
        width = np.maximum(measured_in(np.nan_to_num(code, nan=0.0).astype(np.uint8)), 1).astype(np.float64)
    if surface.stated is not None:
        own, common = nothing + surface.stated.own_m, nothing + surface.stated.common_m
    else:
        assert surface.sigma is not None
        whole = _on_grid(surface.sigma, grid, window)
        own = nothing.copy() if surface.own is None else np.minimum(_on_grid(surface.own, grid, window), whole)
        common = np.sqrt(np.maximum(whole**2 - own**2, 0.0))
        own[np.isnan(whole)] = np.nan
    pattern = _patterns(surface, grid, window, height, np.nan_to_num(common))
    return SurfaceCells(height, own, width, pattern, (interpolated | np.isnan(own)) & np.isfinite(height))


def _patterns(
    surface: SurfaceFiles, grid: MapGrid, window: Window, height_m: FloatArray, common_m: FloatArray
) -> FloatArray:
    """Return the patterns (PATTERNS, rows, columns), whose squares add up to those of what is common (rows, columns).

    Where the block's shift and tilt alone are more than that, they are made smaller.
    """
    pattern = np.zeros((PATTERNS, *height_m.shape))
    if surface.block is not None:
        east, north = grid.centres_map_m(window)
        middle_east, middle_north = surface.block.middle_map_m or _middle(surface.heights.grid)
        slope_north, slope_east = slopes(height_m, grid.cell_m)
        pattern[0] = -surface.block.shift_east_m * slope_east
        pattern[1] = surface.block.shift_north_m * slope_north  # rows go south
        pattern[2] = surface.block.tilt * (east - middle_east)
        pattern[3] = surface.block.tilt * (north - middle_north)[:, None]
    by_block = np.sqrt(np.sum(pattern**2, axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        pattern *= np.where(by_block > common_m, common_m / by_block, 1.0)
    pattern[4] = np.sqrt(np.maximum(common_m**2 - by_block**2, 0.0))
    return pattern


def _middle(grid: MapGrid) -> tuple[float, float]:
    half_east_m, half_north_m = grid.columns * grid.cell_m / 2, grid.rows * grid.cell_m / 2
    return grid.west_map_m + half_east_m, grid.north_map_m - half_north_m


def slopes(height_m: FloatArray, cell_m: float) -> tuple[FloatArray, FloatArray]:
    """Return rise over run southwards along the rows and eastwards along the columns (rows, columns), 0 where
    neighbours have no height."""
    return _slope(height_m, 0) / cell_m, _slope(height_m, 1) / cell_m


def _slope(height_m: FloatArray, axis: int) -> FloatArray:
    """Return the rise (rows, columns) from a cell to the next along an axis, 0 where neighbours have no height."""
    lines = np.moveaxis(height_m, axis, 0)
    slope = np.zeros_like(lines)
    if len(lines) > 2 * SLOPE_STEPS:
        slope[SLOPE_STEPS:-SLOPE_STEPS] = (lines[2 * SLOPE_STEPS :] - lines[: -2 * SLOPE_STEPS]) / (2 * SLOPE_STEPS)
    return np.nan_to_num(np.moveaxis(slope, 0, axis))


def same_cells(first: MapGrid, second: MapGrid) -> bool:
    """Return whether the cells of two grids lie on each other, to a thousandth of a cell over the whole of them."""
    most = max(first.rows, first.columns, second.rows, second.columns)
    if abs(first.cell_m - second.cell_m) * most > 1e-3 * first.cell_m:
        return False
    steps = (
        (first.west_map_m - second.west_map_m) / first.cell_m,
        (first.north_map_m - second.north_map_m) / first.cell_m,
    )
    return all(abs(step - round(step)) < 1e-3 for step in steps)


def _on_grid(raster: RasterFile, grid: MapGrid, window: Window, least: float = 0.0) -> FloatArray:
    """Return a window of a grid over a raster. Raises ProjectError where a value cannot be: below ``least``, or larger
    than LARGEST_M; a damaged block may be decoded to anything."""
    values = _resampled(raster, grid, window)
    wrong = (values < least) | (values > LARGEST_M)
    if wrong.any():
        raise ProjectError(
            f"raster {raster.path}: it holds {values[wrong][0]:.6g} m, which cannot be: it is damaged, copy or make it "
            "again"
        )
    return values


def _resampled(raster: RasterFile, grid: MapGrid, window: Window) -> FloatArray:
    own = raster.grid
    if same_cells(own, grid):
        down = round((own.north_map_m - grid.north_map_m) / grid.cell_m)
        right = round((grid.west_map_m - own.west_map_m) / grid.cell_m)
        at = Window(window.row + down, window.column + right, window.row_end + down, window.column_end + right)
        return _doubled(raster.read(at))
    east, north = grid.centres_map_m(window)
    column, row = (east - own.west_map_m) / own.cell_m - 0.5, (own.north_map_m - north) / own.cell_m - 0.5
    read = Window(
        int(np.floor(row[0])), int(np.floor(column[0])), int(np.floor(row[-1])) + 2, int(np.floor(column[-1])) + 2
    )
    values = _doubled(raster.read(read))
    values = _between(values, row - read.row)
    return np.ascontiguousarray(_between(values.T, column - read.column).T)


def _doubled(values: Float32Array) -> FloatArray:
    with np.errstate(invalid="ignore"):  # a damaged block may hold NaN that signal
        return np.asarray(values, dtype=np.float64)


def _between(values: FloatArray, place: FloatArray) -> FloatArray:
    """Return rows at places (K,) between rows of values, linear; a row that counts nothing does not matter."""
    below = np.floor(place).astype(int)
    share = (place - below)[:, None]
    above = np.minimum(below + 1, len(values) - 1)
    return np.asarray(np.where(share > 0.0, (1.0 - share) * values[below] + share * values[above], values[below]))


def _nearest(raster: RasterFile, grid: MapGrid, window: Window) -> FloatArray:
    """Return the codes of the cells that the centres of a window lie in, NaN beyond the raster."""
    own = raster.grid
    east, north = grid.centres_map_m(window)
    column = np.floor((east - own.west_map_m) / own.cell_m).astype(int)
    row = np.floor((own.north_map_m - north) / own.cell_m).astype(int)
    read = Window(int(row[0]), int(column[0]), int(row[-1]) + 1, int(column[-1]) + 1)
    return np.asarray(raster.read(read)[np.ix_(row - read.row, column - read.column)], dtype=np.float64)
