"""The stage `comparison`: the clouds against a reference surface, where the project names one."""

from dataclasses import replace
from pathlib import Path
from typing import NotRequired

import numpy as np
from typing_extensions import TypedDict

from photogram.arrays import FloatArray
from photogram.files.clouds.points import TEXT_SUFFIXES, las_extent, read_cloud
from photogram.files.maps.rasters import open_raster, read_raster
from photogram.files.npz_json import file_fingerprint, read_json, write_json
from photogram.files.records import read_record, write_record
from photogram.geodesy.crs import NO_CRS
from photogram.geodesy.frames import map_heights
from photogram.grid import Window
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import Costs, Rate
from photogram.pipeline.stages.stored_adjustment import CLOUDS, stored_cloud
from photogram.pipeline.store.run import Run
from photogram.project.project import Project
from photogram.quality.cloud_comparison import Comparison, compare_to_reference, triangulate
from photogram.survey import PointCloud, Raster
from photogram.wording import Progress, things

RASTER_SUFFIXES = (".tif", ".tiff")


class ComparisonSummary(TypedDict):
    """What the stage says of itself."""

    clouds: int
    """Number of clouds compared."""
    doubt: NotRequired[str]
    """That the reference lies far off, in words, if it does."""


def read_reference(path: Path, crs: str = NO_CRS) -> Raster | PointCloud:
    """Read a reference surface: a GeoTIFF, or a cloud as text, LAS or LAZ, whose units are those of ``crs`` where it
    names no CRS itself. Raises ProjectError when it cannot be read."""
    return read_raster(path)[0] if path.suffix.lower() in RASTER_SUFFIXES else read_cloud(path, crs)


def _with_map_heights(project: Project, reference: Raster | PointCloud) -> Raster | PointCloud:
    """Return the reference with the heights of the map, each point or cell by itself."""
    crs, heights = project.crs, project.heights
    if heights.sign_to_map(heights.reference) == 0.0:
        return reference
    if isinstance(reference, PointCloud):
        return replace(reference, position_map_m=map_heights(crs, heights, heights.reference, reference.position_map_m))
    values = reference.values.copy()
    row, column = np.nonzero(np.isfinite(values))
    east = reference.west_map_m + (column + 0.5) * reference.cell_m
    north = reference.north_map_m - (row + 0.5) * reference.cell_m
    cells = np.column_stack([east, north, values[row, column]])
    values[row, column] = map_heights(crs, heights, heights.reference, cells)[:, 2]
    return replace(reference, values=values)


def reference_extent(project: Project) -> FloatArray | None:
    """Return the lowest and highest coordinates (2, 3) of the reference in the map, m, from its header; of a raster the
    heights are NaN. None without a reference, and for text, which has no header. Raises ProjectError, FrameError where
    the file cannot be used."""
    path = project.reference
    if path is None or path.suffix.lower() in TEXT_SUFFIXES:
        return None
    if path.suffix.lower() in RASTER_SUFFIXES:
        grid = open_raster(path).grid
        south, east = grid.north_map_m - grid.rows * grid.cell_m, grid.west_map_m + grid.columns * grid.cell_m
        return np.array([[grid.west_map_m, south, np.nan], [east, grid.north_map_m, np.nan]])
    corners = PointCloud(las_extent(path, project.product_crs))
    return _with_map_heights(project, corners).position_map_m  # type: ignore[union-attr]


def reference_heights(project: Project, raster: Path, places_map_m: FloatArray) -> FloatArray:
    """Return the heights (N,) in the map, m, of a raster as reference, in the cells that places (N, 2 or more) lie in;
    NaN without data. Raises ProjectError, FrameError where the file cannot be used."""
    file = open_raster(raster)
    windows = [Window(r, c, r + 1, c + 1) for r, c in np.column_stack(file.grid.cells_at(places_map_m)).tolist()]
    height_m = np.array([file.read(window)[0, 0] for window in windows], dtype=np.float64)
    known = np.isfinite(height_m)
    cells = PointCloud(np.column_stack([places_map_m[known, :2], height_m[known]]))
    height_m[known] = _with_map_heights(project, cells).position_map_m[:, 2]  # type: ignore[union-attr]
    return height_m


def compare_clouds(run: Run, folder: Path, progress: Progress) -> ComparisonSummary:
    """Compare the clouds with the reference, when the project names one."""
    statistics: dict[str, object] = {}
    doubts = list[str]()
    if run.project.reference is not None:
        given = _with_map_heights(run.project, read_reference(run.project.reference, run.project.product_crs))
        reference = triangulate(given) if isinstance(given, PointCloud) else given
        for name in CLOUDS:
            cloud = stored_cloud(run, name)
            if len(cloud) >= 3:
                comparison = compare_to_reference(cloud, reference)
                write_record(folder / f"{name}.npz", comparison)
                doubts += filter(None, [comparison.doubt])
                by_kind = {"cloud_to_surface": comparison.cloud_to_surface, "cloud_to_cloud": comparison.cloud_to_cloud}
                statistics[name] = {"removed": comparison.removed, **by_kind}
            progress(len(statistics), 3, name)
    write_json(folder / "statistics.json", statistics)
    summary: ComparisonSummary = {"clouds": len(statistics)}
    return {**summary, "doubt": doubts[-1]} if doubts else summary


def stored_comparisons(run: Run) -> dict[str, Comparison]:
    """Return the comparisons of all clouds with the reference, none without a reference. Needs the stage
    `comparison`."""
    return {
        name: read_record(run.workspace.file("comparison", f"{name}.npz"), Comparison)
        for name in read_json(run.workspace.file("comparison", "statistics.json"))
    }


def _words(summary: ComparisonSummary) -> str:
    clouds, doubt = summary["clouds"], summary.get("doubt")
    text = f"{things(clouds, 'cloud')} compared with the reference" if clouds else "no reference given"
    return f"{text}; {doubt}" if doubt else text


def _settings(run: Run) -> object:
    reference = run.project.reference
    return None if reference is None else [file_fingerprint(reference), run.project.heights.reference]


COMPARISON: Stage = Stage(
    "comparison",
    "Comparison",
    ("intersection", "adjustment"),
    _settings,
    compare_clouds,
    line_of(ComparisonSummary, _words),
    Costs(
        0.0,
        (Rate("comparison", 0.5, pieces=False), Rate("observations", 1e-5, pieces=False)),
        is_asked_for=lambda extent: extent.project.reference is not None,
    ),
)
