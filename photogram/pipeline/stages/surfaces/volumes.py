"""The stage `volumes`: what the survey's own surface holds within polygons, over a base."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from photogram.arrays import Float32Array
from photogram.errors import SurfaceError
from photogram.files.maps.polygon_files import read_polygons
from photogram.files.npz_json import file_fingerprint, write_arrays, write_json
from photogram.files.records import read_record
from photogram.geodesy.crs import NO_CRS
from photogram.grid import MapGrid, Window, block_of
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import Costs, Rate
from photogram.pipeline.stages.stored_adjustment import COVARIANCES
from photogram.pipeline.stages.stored_surface import StoredSurface, reason_left_out
from photogram.pipeline.stages.surface_frame import made_frame
from photogram.pipeline.stages.surfaces.volume_files import PICTURE, PICTURE_GRID, RECORD, TABLE, write_volumes
from photogram.pipeline.store.run import Run
from photogram.quality.datum_precision import datum_precision
from photogram.report.record.volumes import UnmeasuredPolygonRecord, VolumeRecord, VolumesRecord
from photogram.report.surveyed_surfaces import NamedSurface, open_surface, triangulation_over
from photogram.report.values import record_of
from photogram.results import AdjustmentCovariances
from photogram.volumes.differences import Difference, DifferenceCells, difference_of
from photogram.volumes.measured_volumes import BasedPolygon, measured_volumes, over_height, over_rim, sum_of
from photogram.volumes.outlines import coverage, window_of, window_of_all
from photogram.volumes.rim_base import RIM_WIDTHS, over_level
from photogram.volumes.surfaces import BlockErrors, StatedSigma, SurfaceFiles, accompanying, open_rasters, surface_path
from photogram.volumes.volume_settings import VolumeSettings
from photogram.wording import Progress, things

MOST_SHOWN = 1400
"""Cells along a side of the picture."""

TILE_CELLS = 1024


class VolumesSummary(TypedDict, total=False):
    """What the stage says of itself, nothing where no volumes are asked for."""

    polygons: int
    """Number of polygons that were measured."""
    not_measured: list[str]
    """Names of those that could not be."""
    left_out: str
    """Why none is."""


def survey_surface(run: Run) -> SurfaceFiles:
    """Return the measured surface of a run with its errors, as ``open_surface`` finds it among the results. Needs the
    stage `surface`."""
    settings, shape = run.project.volumes, made_frame(run).shape()
    known = read_record(run.workspace.file("adjustment", COVARIANCES), AdjustmentCovariances).deformation
    placed, block = datum_precision(known), None
    if shape is not None and placed is not None:
        east_m, north_m = np.nan_to_num(np.sqrt(np.diag(shape.datum_covariance_m2)[:2])).tolist()
        tilt_m, radius_m = np.nan_to_num([placed.tilt_m, placed.radius_m]).tolist()
        block = BlockErrors.of(east_m, north_m, tilt_m, radius_m)
    path = run.workspace.file("surface", "dsm.tif")
    return open_rasters(path, None, settings.correlation_m, block, local=run.project.crs == NO_CRS)


def named_reference(settings: VolumeSettings) -> NamedSurface:
    """Return the surface that is the base, with what is stated of its errors."""
    assert settings.reference is not None
    own_m, common_m = settings.reference_own_sigma_m, settings.reference_common_sigma_m
    stated = None if own_m is None or common_m is None else StatedSigma(own_m, common_m)
    return NamedSurface(Path(settings.reference), stated)


def _reference(settings: VolumeSettings, survey: SurfaceFiles) -> SurfaceFiles:
    """Return the surface that is the base, a triangulation on the cells of the survey's. Raises as ``open_surface`` and
    ``triangulation_over``."""
    named = named_reference(settings)
    if named.is_triangulation:
        return triangulation_over(named, survey.heights, settings.correlation_m)[0]
    return open_surface(named.path, named.stated, settings.correlation_m)


def measure_volumes(run: Run, folder: Path, progress: Progress) -> VolumesSummary:
    """Measure the volumes that the project asks for: volumes.csv, what report.json says of them, and their picture,
    thinned. A polygon that cannot be measured is named with the reason. Raises FrameError, ProjectError where the
    reference does not fit or is damaged."""
    settings = run.project.volumes
    if settings.polygons is None:
        return {}
    if not StoredSurface(run).is_there:
        reason = f"there is no surface: {reason_left_out(run, 'surface')}"
        write_json(folder / RECORD, {"left_out": reason})
        return {"left_out": reason}
    survey = survey_surface(run)
    difference = over_level(survey)
    if settings.base == "reference":
        difference = difference_of(_reference(settings, survey), survey)
    based, unmeasured = _based(run, difference)
    picture = _Picture.of(difference, based)
    sums = measured_volumes(difference, based, settings.polygon_sigma_m, picture.take, progress)
    for part in [part for part in sums if not part.measured_m2 + part.interpolated_m2 > 0.0]:
        unmeasured.append({"name": part.name, "reason": "the surface has no height in it"})
    sums = [part for part in sums if part.measured_m2 + part.interpolated_m2 > 0.0]
    volumes, total = [part.volume() for part in sums], sum_of(sums, own_bases=settings.base != "reference")
    write_volumes(folder / TABLE, [*volumes, *([total] if total else [])])
    record: VolumesRecord = {
        "base": settings.base,
        "level_m": settings.level_m,
        "reference": settings.reference and surface_path(Path(settings.reference)).name,
        "base_words": _base_words(settings),
        "sigma_from": survey.sigma_source,
        "correlation_m": survey.correlation_m,
        "cell_m": difference.grid.cell_m,
        "polygons": [record_of(VolumeRecord, volume) for volume in volumes],
        "total": None if total is None else record_of(VolumeRecord, total),
        "not_measured": unmeasured,
    }
    write_json(folder / RECORD, record)
    picture.write(folder)
    return {"polygons": len(volumes), "not_measured": [entry["name"] for entry in unmeasured]}


def _based(run: Run, difference: Difference) -> tuple[list[BasedPolygon], list[UnmeasuredPolygonRecord]]:
    """Return the polygons on their bases, and those that cannot have one."""
    settings = run.project.volumes
    based, unmeasured = list[BasedPolygon](), list[UnmeasuredPolygonRecord]()
    for polygon in read_polygons(Path(str(settings.polygons)), run.project.crs):
        if window_of(polygon.polygon, difference.grid) is None:
            unmeasured.append({"name": polygon.name, "reason": "it lies beyond the surface"})
            continue
        try:
            if settings.base == "rim":
                based.append(over_rim(difference, polygon))
            elif settings.level_m is not None:
                based.append(over_height(difference, polygon, settings.level_m))
            else:
                based.append(BasedPolygon(polygon))
        except SurfaceError as error:
            unmeasured.append({"name": polygon.name, "reason": str(error)})
    return based, unmeasured


def _base_words(settings: VolumeSettings) -> str:
    if settings.base == "rim":
        return "the plane through the ground around each polygon"
    if settings.level_m is not None:
        return f"the height {settings.level_m:g} m"
    return f"the surface {surface_path(Path(str(settings.reference))).name}"


class _Picture:
    """What the polygons and their surroundings show, every ``step``-th cell along each axis of a window."""

    def __init__(self, difference: Difference, window: Window) -> None:
        self.difference, self.window = difference, window
        self.step = block_of(window.shape, MOST_SHOWN)
        rows, columns = (len(range(self.step // 2, n, self.step)) for n in window.shape)
        whole = difference.grid
        self.grid = MapGrid(
            whole.west_map_m + window.column * whole.cell_m, whole.north_map_m - window.row * whole.cell_m,
            whole.cell_m * self.step, rows, columns,
        )  # fmt: skip
        self.difference_m, self.height_m = (np.full((rows, columns), np.nan, np.float32) for _ in range(2))
        self.within = np.zeros((rows, columns), dtype=bool)

    @staticmethod
    def of(difference: Difference, polygons: list[BasedPolygon]) -> "_Picture":
        """Return the empty picture of polygons and a margin as wide as their rims, a fifth of their extent at least."""
        grid = difference.grid
        around = window_of_all([p.site.polygon for p in polygons], grid)
        rim = int(np.ceil(RIM_WIDTHS * difference.later.correlation_m / grid.cell_m))
        return _Picture(difference, grid.around_window(around, max(rim, max(around.shape) // 5)))

    def _places(self, window: Window) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
        """Return where in a window of the surface the chosen cells are, and where in the picture."""
        of, to = list[slice](), list[slice]()
        spans = ((window.row, window.row_end, self.window.row), (window.column, window.column_end, self.window.column))
        for start, end, first in spans:
            k = -(-max(start - first - self.step // 2, 0) // self.step)
            place = first + self.step // 2 + k * self.step
            count = max(-(-(end - place) // self.step), 0)
            of.append(slice(place - start, place - start + count * self.step, self.step))
            to.append(slice(k, k + count))
        return (of[0], of[1]), (to[0], to[1])

    def take(self, polygon: BasedPolygon, window: Window, cells: DifferenceCells, inner: tuple[slice, slice]) -> None:
        """Take the cells of a polygon."""
        of, to = self._places(window)
        chosen = coverage(polygon.site.polygon, self.difference.grid, window)[of] > 0.0
        shown, code = cells.difference_m[inner][of], cells.codes[inner][of]
        self.difference_m[to] = np.where(chosen, shown, self.difference_m[to])
        self.within[to] = np.where(chosen, code == 0, self.within[to])

    def write(self, folder: Path) -> None:
        """Write the picture with the heights around the polygons."""
        heights, grid = self.difference.later.heights, self.difference.grid
        right = round((grid.west_map_m - heights.grid.west_map_m) / grid.cell_m)
        down = round((heights.grid.north_map_m - grid.north_map_m) / grid.cell_m)
        own = heights.grid.cell_m == grid.cell_m
        for tile in self.window.tiles(TILE_CELLS) if own else ():
            at = Window(tile.row + down, tile.column + right, tile.row_end + down, tile.column_end + right)
            of, to = self._places(tile)
            values: Float32Array = heights.read(at)
            self.height_m[to] = values[of]
        arrays = {"difference_m": self.difference_m, "within": self.within, "height_m": self.height_m}
        write_arrays(folder / PICTURE, arrays)
        write_json(folder / PICTURE_GRID, asdict(self.grid))


def _settings(run: Run) -> object:
    settings = run.project.volumes
    if settings.polygons is None:
        return None
    said = {name: value for name, value in asdict(settings).items() if name not in ("polygons", "reference")}
    if settings.reference is None:
        return [said, file_fingerprint(Path(settings.polygons))]
    path = surface_path(Path(settings.reference))
    name = path.stem.removesuffix("_filled")
    beside = (*(f"{name}_{part}.tif" for part in ("sigma", "sigma_own", "source")), "report.json")
    files = [path, *(accompanying(path, own) for own in beside)]
    return [said, file_fingerprint(Path(settings.polygons)), [file_fingerprint(f) for f in files if f.is_file()]]


def _words(summary: VolumesSummary) -> str:
    if "polygons" not in summary:
        return "not requested"
    missing = summary.get("not_measured", [])
    more = f"; not measured: {', '.join(missing)}" if missing else ""
    return f"volumes of {things(summary['polygons'], 'polygon')}{more}"


CELLS_S = 0.2
"""Seconds for a million cells of the surface, a tenth of them in polygons: 0.05 to read them, 1.9 for those in
polygons, measured on twenty million cells."""

VOLUMES: Stage = Stage(
    "volumes",
    "Volumes",
    ("adjustment", "surface"),
    _settings,
    measure_volumes,
    line_of(VolumesSummary, _words),
    Costs(
        0.5,
        (Rate("raster_mcells", CELLS_S, pieces=False),),
        is_asked_for=lambda extent: extent.project.volumes.polygons is not None,
    ),
    products=(TABLE,),
)
