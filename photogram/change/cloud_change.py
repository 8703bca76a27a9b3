"""Two clouds compared by M3C2, or a cloud with a mesh of the reference; written at the end."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import BoolArray, FloatArray
from photogram.change.cloud_registration import RigidMotion, register_clouds
from photogram.change.files.compared_clouds import ComparedCloud, read_compared, write_distances
from photogram.change.m3c2 import M3C2, CloudErrors, M3C2Settings, m3c2, spacing_of
from photogram.change.mesh_distances import mesh_distances, mesh_of
from photogram.errors import FrameError, ProjectError
from photogram.files.atomic import make_folder
from photogram.files.maps.polygon_files import read_polygons
from photogram.files.maps.rasters import RasterFile, open_raster, read_raster
from photogram.files.npz_json import write_json
from photogram.geodesy.crs import NO_CRS, plan_of, same_plan
from photogram.grid import Window, known_cells_map_m
from photogram.quality.cloud_comparison import CloudStatistics, statistics
from photogram.report.figures.difference_figure import DifferencePicture, difference_figure, gridded
from photogram.report.figures.style import save_picture
from photogram.survey import PointCloud, Raster
from photogram.volumes.differences import LEVEL
from photogram.volumes.stable_ground import Motion, Registration
from photogram.volumes.surfaces import SURFACE_SUFFIXES, WINDOW_CELLS, StatedSigma, accompanying, labels
from photogram.wording import Progress, silent

Method = Literal["m3c2", "mesh"]


@dataclass(frozen=True)
class CloudRequest:
    """What is to be compared, and how."""

    later: Path
    earlier: Path
    method: Method
    stable: Path | None = None
    coregister: Motion | None = None
    sigma: StatedSigma | None = None
    earlier_sigma: StatedSigma | None = None
    correlation_m: float | None = None
    scales: M3C2Settings = field(default_factory=M3C2Settings)


@dataclass(frozen=True, eq=False)
class CloudChange:
    """Distances of a later cloud from an earlier one, as comparison.json holds them."""

    later: str
    reference: str
    method: str
    level_of_detection: str
    """What it is made of, in words."""
    registration: Registration | None
    registration_applied: bool
    points: int
    """Core points, or points of the later cloud."""
    compared: int
    """Of these, with a distance."""
    with_level: int
    """Of these, with a level of detection."""
    within_level: int
    """Of these, within it."""
    distance: CloudStatistics
    level_median_m: float
    """Median level of detection."""
    roughness_level_median_m: float
    """Of M3C2, by roughness alone."""
    scales: M3C2Settings | None
    """Of M3C2, as used."""


@dataclass(frozen=True, eq=False)
class _Distances:
    place_map_m: FloatArray
    distance_m: FloatArray
    level_m: FloatArray
    m3c2: M3C2 | None = None


def compare_clouds(request: CloudRequest, output: Path, progress: Progress = silent) -> CloudChange:
    """Compare a later cloud with an earlier one, or with a mesh of a surface; write distances.laz, comparison.json and
    comparison.png into a folder. Lengths in m.

    Raises PhotogramError where a file is missing or damaged, the two do not fit together, the request contradicts
    itself, or M3C2 is not installed; then nothing is written.
    """
    if request.coregister is not None and request.stable is None:
        raise ProjectError("co-registration: name the ground that has not moved (--stable POLYGONS)")
    progress(0, 0, f"reading {request.later.name}")
    later = read_compared(request.later)
    progress(0, 0, f"reading {request.earlier.name}")
    earlier, raster = _reference(request)
    crs = _common_crs(later, earlier)
    registration, motion = None, None
    if request.stable is not None:
        progress(0, 0, "stable ground")
        polygons = [p.polygon for p in read_polygons(request.stable, crs)]
        length = request.correlation_m or WINDOW_CELLS * spacing_of(later.points)
        kind = request.coregister or "offset"
        registration, motion = register_clouds(earlier.points, later.points, polygons, kind, length)
        motion = motion if request.coregister is not None else None
    if motion is not None:
        moved = PointCloud(motion.apply(later.points.position_map_m))
        later = ComparedCloud(later.path, moved, later.sigma_height_m, later.crs)
    errors = _errors(request, earlier, later, aligned=motion is not None)
    progress(0, 0, "distances")
    if request.method == "m3c2":
        distances = _by_m3c2(request, earlier, later, errors, motion)
    else:
        distances = _by_mesh(earlier.points if raster is None else raster, later, errors, motion)
    change = _summary(request, distances, errors, registration, motion is not None)
    progress(0, 0, "writing")
    _write(output, change, distances, crs)
    return change


def _reference(request: CloudRequest) -> tuple[ComparedCloud, Raster | None]:
    """Return the earlier epoch as a cloud, and as the raster that it was, if it was one."""
    if request.earlier.suffix.lower() not in SURFACE_SUFFIXES:
        return read_compared(request.earlier), None
    if request.method == "m3c2":
        raise ProjectError(f"M3C2 compares clouds, {request.earlier} is a surface: give its cloud, dense.laz")
    raster, crs = read_raster(request.earlier)
    return ComparedCloud(request.earlier, PointCloud(known_cells_map_m(raster)), None, crs), raster


def _common_crs(later: ComparedCloud, earlier: ComparedCloud) -> str:
    """Return the map that both lie in, NO_CRS where neither file names one. Raises FrameError where they differ."""
    if later.crs is not None and earlier.crs is not None and not same_plan(later.crs, earlier.crs):
        raise FrameError(
            f"point clouds {later.path} and {earlier.path}: their CRS differ: reproject one to the other's "
            "(pdal translate IN OUT reprojection)"
        )
    named = later.crs or earlier.crs
    return NO_CRS if named is None else plan_of(named)


def _errors(
    request: CloudRequest, earlier: ComparedCloud, later: ComparedCloud, aligned: bool
) -> tuple[CloudErrors, CloudErrors] | None:
    """Return the standard deviations of both epochs, None where one tells none; without what is common where they were
    ``aligned`` on stable ground: the uncertainty of that takes its place."""
    first = _errors_of(earlier, request.earlier_sigma, request.correlation_m)
    second = _errors_of(later, request.sigma, request.correlation_m)
    if first is None or second is None:
        return None
    if aligned:
        first, second = (replace(errors, common_m=np.zeros_like(errors.common_m)) for errors in (first, second))
    return first, second


def _errors_of(cloud: ComparedCloud, stated: StatedSigma | None, correlation_m: float | None) -> CloudErrors | None:
    count = len(cloud.points)
    length = WINDOW_CELLS * spacing_of(cloud.points) if correlation_m is None else correlation_m
    if stated is not None:
        return CloudErrors(np.full(count, stated.own_m), np.full(count, stated.common_m), length)
    stem = "dsm" if cloud.path.name == "dense.laz" else cloud.path.stem.removesuffix("_filled")
    whole = accompanying(cloud.path, f"{stem}_sigma.tif")
    sigma = cloud.sigma_height_m
    if sigma is None and cloud.path.suffix.lower() in SURFACE_SUFFIXES and whole.is_file():
        sigma = _sampled(open_raster(whole), cloud.points.position_map_m)
    if sigma is None:
        return None
    part = accompanying(cloud.path, f"{stem}_sigma_own.tif")
    if not part.is_file():  # the whole of it counts as common
        return CloudErrors(np.zeros(count), sigma, length)
    own = np.minimum(np.nan_to_num(_sampled(open_raster(part), cloud.points.position_map_m)), sigma)
    return CloudErrors(own, np.sqrt(sigma**2 - own**2), length)


def _sampled(raster: RasterFile, points_map_m: FloatArray) -> FloatArray:
    """Return the values (N,) of the cells that points lie in, NaN without any; read by bands of rows."""
    grid = raster.grid
    row, column = grid.cells_at(points_map_m)
    out = np.full(len(points_map_m), np.nan)
    for first in range(0, grid.rows, 1024):
        chosen = np.flatnonzero((row >= first) & (row < first + 1024))
        if len(chosen):
            band = raster.read(Window(first, 0, min(first + 1024, grid.rows), grid.columns))
            out[chosen] = band[row[chosen] - first, column[chosen]]
    return out


def _by_m3c2(
    request: CloudRequest,
    earlier: ComparedCloud,
    later: ComparedCloud,
    errors: tuple[CloudErrors, CloudErrors] | None,
    motion: RigidMotion | None,
) -> _Distances:
    aligned = None if motion is None else motion.sigma_m
    result = m3c2(earlier.points, later.points, request.scales, errors, aligned)
    return _Distances(result.core_map_m, result.distance_m, result.level_m, result)


def _by_mesh(
    reference: Raster | PointCloud,
    later: ComparedCloud,
    errors: tuple[CloudErrors, CloudErrors] | None,
    motion: RigidMotion | None,
) -> _Distances:
    """Return the distances of all points from the mesh; what a level of detection needs of the mesh's own errors is
    the median of its points'."""
    place = later.points.position_map_m
    distance = mesh_distances(place, mesh_of(reference))
    level = np.full(len(place), np.nan)
    if errors is not None:
        of_mesh = float(np.nanmedian(errors[0].own_m ** 2 + errors[0].common_m ** 2))
        variance = of_mesh + errors[1].own_m ** 2 + errors[1].common_m ** 2
        if motion is not None:
            variance = variance + motion.sigma_m(place, np.tile([0.0, 0.0, 1.0], (len(place), 1))) ** 2
        level = np.where(np.isfinite(distance), LEVEL * np.sqrt(variance), np.nan)
    return _Distances(place, distance, level)


def _summary(
    request: CloudRequest,
    distances: _Distances,
    errors: tuple[CloudErrors, CloudErrors] | None,
    registration: Registration | None,
    applied: bool,
) -> CloudChange:
    if not np.any(np.isfinite(distances.distance_m)):
        raise ProjectError(
            f"clouds {request.later} and {request.earlier}: no distance is found anywhere: check that both are of the "
            "same site and in the same CRS, or look further along the normals (--max-distance)"
        )
    distance_m = distances.distance_m
    level_m = distances.level_m
    of_m3c2 = distances.m3c2
    tested = np.isfinite(level_m) & np.isfinite(distance_m)
    later, reference = labels(request.later, request.earlier)
    return CloudChange(
        later=later,
        reference=reference,
        method=request.method,
        level_of_detection=_words(request.method, errors, applied),
        registration=registration,
        registration_applied=applied,
        points=len(distance_m),
        compared=int(np.isfinite(distance_m).sum()),
        with_level=int(tested.sum()),
        within_level=int((np.abs(distance_m[tested]) <= level_m[tested]).sum()),
        distance=statistics(distance_m),
        level_median_m=float(np.median(level_m[tested])) if tested.any() else float("nan"),
        roughness_level_median_m=float("nan") if of_m3c2 is None else float(np.nanmedian(of_m3c2.roughness_level_m)),
        scales=None if of_m3c2 is None else of_m3c2.settings,
    )


def _words(method: Method, errors: tuple[CloudErrors, CloudErrors] | None, applied: bool) -> str:
    """Return what a level of detection is made of."""
    aligned = ", alignment on stable ground" if applied else ""
    if errors is not None:
        return f"standard deviations of both epochs{aligned}"
    if method == "mesh":
        return "none: the files say no standard deviations and none are stated"
    return f"roughness{aligned or '; the alignment taken as free of errors, nothing says how large they are'}"


def _write(output: Path, change: CloudChange, distances: _Distances, crs: str) -> None:
    known: BoolArray = np.isfinite(distances.distance_m)
    fields: dict[str, tuple[NDArray[np.generic], str]] = {
        "distance": (distances.distance_m[known].astype(np.float32), "later minus earlier [m]"),
        "lod": (distances.level_m[known].astype(np.float32), "level of detection, 95 % [m]"),
        "significant": (
            (np.abs(distances.distance_m) > distances.level_m)[known].astype(np.uint8), "1: distance beyond lod",
        ),
    }  # fmt: skip
    if distances.m3c2 is not None:
        normal, count = distances.m3c2.normal[known], distances.m3c2.points[known]
        fields["lod roughness"] = (distances.m3c2.roughness_level_m[known].astype(np.float32), "Lague et al. 2013 [m]")
        for name, values in zip(("normal x", "normal y", "normal z"), normal.T, strict=True):
            fields[name] = (values.astype(np.float32), "of the earlier ground")
        for name, values in zip(("points earlier", "points later"), count.T, strict=True):
            fields[name] = (np.minimum(values, 65535).astype(np.uint16), "in the cylinder")
    make_folder(output)
    write_distances(output / "distances.laz", distances.place_map_m[known], crs, fields)
    write_json(output / "comparison.json", {Path(change.later).stem: asdict(change)})
    within = np.abs(distances.distance_m) <= distances.level_m
    what = "M3C2 distance, m" if change.method == "m3c2" else "distance to the mesh, m"
    values, pale, grid = gridded(distances.place_map_m[known], distances.distance_m[known], within[known])
    picture = DifferencePicture(values, pale, grid, (), (), change.later, change.reference, what=what)
    save_picture(difference_figure(picture), output / "comparison.png")
