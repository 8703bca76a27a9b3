"""The known surface of a project as the adjustment takes it: the cells around the survey, with the heights of the map,
and of these the stable ones."""

from pathlib import Path

import numpy as np
import shapely

from photogram.amendments.surfaces.known_heights import KnownSurface
from photogram.amendments.surfaces.known_surface_settings import COMMON_SIGMA_M
from photogram.arrays import FloatArray
from photogram.errors import ProjectError
from photogram.files.clouds.ground_cells import read_ground_cells
from photogram.files.clouds.points import LAS_SUFFIXES
from photogram.files.maps.polygon_files import read_polygons
from photogram.files.maps.rasters import open_raster
from photogram.files.npz_json import file_fingerprint
from photogram.geodesy.crs import NO_CRS, crs_label, same_plan
from photogram.geodesy.frames import map_heights
from photogram.grid import Window
from photogram.project.project import Project
from photogram.survey import Block, Raster

MARGIN = 0.3
"""Of the extent of the survey, by which more of a surface is read on each side: positions may be off."""

LEAST_MARGIN_M = 50.0

OUTERMOST = 0.5
"""Percent of the tie points on each side that may be mismatches anywhere."""


def known_surface_fingerprint(project: Project) -> object:
    """Return what the adjustment depends on of a known surface, None without one."""
    settings = project.known_surface
    if settings.path is None:
        return None
    stable = None if settings.stable is None else file_fingerprint(Path(settings.stable))
    own = settings.sigma_m, settings.common_sigma_m, settings.heights
    return [file_fingerprint(Path(settings.path)), stable, *own, project.heights]


def _check_plan(path: Path, crs: str, project: Project, remedy: str) -> None:
    """Raise ProjectError where a file is of another map than the project."""
    if not same_plan(crs, project.crs):
        raise ProjectError(
            f"known_surface {path}: its CRS is {crs_label(crs)}, that of the project {crs_label(project.crs)}: "
            f"reproject it ({remedy})"
        )


def _height_model(path: Path, project: Project, low: FloatArray, high: FloatArray) -> tuple[Raster, float] | None:
    """Return the cells of a GeoTIFF between two corners (2,) of the map, None where it has none, and 1: what is stated
    is the standard deviation of a cell."""
    file = open_raster(path)
    _check_plan(path, file.crs, project, "gdalwarp -t_srs CRS IN.tif OUT.tif")
    grid = file.grid
    first = np.floor(np.array([grid.north_map_m - high[1], low[0] - grid.west_map_m]) / grid.cell_m)
    last = np.ceil(np.array([grid.north_map_m - low[1], high[0] - grid.west_map_m]) / grid.cell_m)
    window = grid.common(Window(*(int(edge) for edge in np.clip([*first, *last], -1e9, 1e9))))
    if window is None:
        return None
    west, north = grid.west_map_m + window.column * grid.cell_m, grid.north_map_m - window.row * grid.cell_m
    return Raster(file.read(window), west, north, grid.cell_m), 1.0


def _ground_cells(path: Path, project: Project, low: FloatArray, high: FloatArray) -> tuple[Raster, float] | None:
    """Return the ground points of a cloud in cells, as ``_height_model``, and by how much the standard deviation of a
    cell is smaller than that of a point, which is stated."""
    ground = read_ground_cells(path, low, high, project.crs)
    if ground is None:
        return None
    if ground.crs != NO_CRS:
        _check_plan(path, ground.crs, project, "pdal translate IN OUT reprojection --filters.reprojection.out_srs=CRS")
    return ground.raster, ground.of_point


def surface_around(project: Project, extent_map_m: FloatArray) -> KnownSurface | None:
    """Return the known surface of a project around places whose extent in the map is (2, 2 or more), None without one,
    or where it has no cell there. Raises ProjectError or FrameError where its files cannot be used."""
    settings = project.known_surface
    if settings.path is None or settings.sigma_m is None:
        return None
    path, margin = Path(settings.path), extent_map_m[1, :2] - extent_map_m[0, :2]
    margin = np.maximum(MARGIN * margin, LEAST_MARGIN_M)
    low, high = extent_map_m[0, :2] - margin, extent_map_m[1, :2] + margin
    is_cloud = path.suffix.lower() in LAS_SUFFIXES
    found = _ground_cells(path, project, low, high) if is_cloud else _height_model(path, project, low, high)
    if found is None:
        return None
    raster, of_cell = found
    values, west, north, cell_m = raster.values, raster.west_map_m, raster.north_map_m, raster.cell_m
    row, column = np.nonzero(np.isfinite(values))
    east = west + (column + 0.5) * cell_m
    cells = np.column_stack([east, north - (row + 0.5) * cell_m, values[row, column]])
    values[row, column] = map_heights(project.crs, project.heights, settings.heights, cells)[:, 2]
    if settings.stable is not None:
        inside = np.zeros(len(cells), dtype=bool)
        for polygon in read_polygons(Path(settings.stable), project.crs):
            inside |= shapely.contains_xy(polygon.polygon, cells[:, 0], cells[:, 1])
        values[row[~inside], column[~inside]] = np.nan
    common = COMMON_SIGMA_M if settings.common_sigma_m is None else settings.common_sigma_m
    return KnownSurface(path.name, raster, of_cell * settings.sigma_m, common, settings.common_sigma_m is None)


def known_surface(project: Project, block: Block) -> KnownSurface | None:
    """Return the known surface of a project around its block, None without one. Raises ProjectError or FrameError where
    its files cannot be used, or it lies beside the block."""
    if project.known_surface.path is None or block.is_free:
        return None
    places = block.tie_points.position_world_m
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        places = np.array([pose.position_world_m for pose in block.poses if pose is not None])
    extent_m = np.percentile(block.frame.map_from_world(places), [OUTERMOST, 100.0 - OUTERMOST], axis=0)
    surface = surface_around(project, extent_m)
    if surface is None:
        raise ProjectError(f"known_surface: {project.known_surface.path} does not overlap the survey: check its CRS")
    return surface
