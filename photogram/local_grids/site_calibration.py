"""Calibration of a site from a table of pairs, to the CRS of its local grid in a file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.errors import ControlPointError, FrameError, WorkspaceError
from photogram.files.atomic import write_whole
from photogram.geodesy.crs import WGS84, MapUnits, crs_label, height_system_of, is_on_gnss_ellipsoid, map_units, plan_of
from photogram.geodesy.frames import CombinedScale, LocalFrame, degrees_of, geodetic_of, map_from_crs
from photogram.local_grids.calibration import (
    CalibrationSettings,
    HeightModel,
    SiteCalibration,
    calibrate,
    predictions,
    radii_m,
)
from photogram.local_grids.definition import UNITS, local_grid, site_map
from photogram.local_grids.pairs import SitePairs
from photogram.local_grids.site_pairs import PairFile, read_pairs
from photogram.wording import some, things

SUFFIX = ".wkt2"
_SEMI_MAJOR_M, _SEMI_MINOR_M = 6378137.0, 6356752.3141
_CLOSURE_M = 1e-4
_MIDDLE_DECIMALS = 8


@dataclass(frozen=True, eq=False)
class CalibratedSite:
    """A site that was calibrated, and the CRS that was written."""

    calibration: SiteCalibration
    """What was estimated."""
    predicted_m: FloatArray
    """Predicted minus given (N, 3) of each pair as all others have it."""
    predicted_sigma_m: FloatArray
    """Standard deviations of that (N, 3)."""
    scale: CombinedScale
    """Scale at the middle of the site."""
    height_m: float
    """Mean ellipsoidal height of the site, at which that holds."""
    closure_m: float
    """Farthest that a pair comes off on its way through PROJ to the local grid, from what was estimated, and back."""
    units: MapUnits
    """Units of the local grid."""
    wkt: str
    """The CRS."""
    path: Path | None
    """The file that holds it, None where none was written."""


def calibrate_site(
    pairs: Path | str,
    target: Path | str | None = None,
    *,
    crs: str = WGS84,
    projection: str | None = None,
    scale: float | None = None,
    heights: HeightModel = "plane",
    sigma_plan_m: float | None = None,
    sigma_height_m: float | None = None,
    unit: str = "m",
    name: str | None = None,
    overwrite: bool = False,
) -> CalibratedSite:
    """Calibrate a site by the pairs of a table, and write the CRS of its local grid as WKT to ``target``, if given.

    ``crs`` is that of the table's longitude and latitude, or easting and northing; ``projection`` a map that the local
    grid is a similarity of, instead of a transverse Mercator about the site; ``scale`` is held where it is given;
    standard deviations are for pairs that have none of their own; ``unit`` is that of the local grid: m, ft or ftUS.
    Raises ControlPointError where table or pairs do not serve, FrameError where a CRS does not, WorkspaceError where
    the file cannot be written.
    """
    path = Path(pairs)
    if unit not in UNITS:
        raise FrameError(f"unit {unit!r}: a local grid is in {', '.join(UNITS)}")
    if scale is not None and not 0.5 < scale < 2.0:
        raise FrameError(f"scale {scale:g}: must be from 0.5 to 2, a length in the local grid over that on the map")
    given_map = None if projection is None else plan_of(projection)
    table = read_pairs(path)
    written = None if target is None else _target(Path(target), path, overwrite)
    site = _pairs(table, crs, UNITS[unit], heights, (sigma_plan_m, sigma_height_m))
    if not site.in_plan.any():
        raise ControlPointError(f"{path}: no pair serves in plan: give use both or plan to two at least")
    middle = np.round(site.place_deg[site.in_plan].mean(axis=0), _MIDDLE_DECIMALS)
    start = site_map(crs, middle) if given_map is None else given_map
    if heights != "none":
        _check_heights(crs, start)

    def to_map(place_deg: FloatArray) -> FloatArray:
        flat = np.column_stack([place_deg, np.zeros(len(place_deg))])
        return map_from_crs(degrees_of(crs), start, flat)[:, :2]

    radii = radii_m(float(middle[1]), _SEMI_MAJOR_M, _SEMI_MINOR_M)
    try:
        calibration = calibrate(site, to_map, middle, radii, CalibrationSettings(scale, heights))
    except ControlPointError as error:
        raise ControlPointError(f"{path}: {error}") from error
    title = name or (written or path).stem.replace("_", " ")
    wkt = local_grid(title, crs, middle, calibration.plan, calibration.height, UNITS[unit], given_map)
    difference, sigma = predictions(calibration, to_map(site.place_deg), radii)
    closure = _closure_m(crs, wkt, calibration)
    if not closure <= _CLOSURE_M:
        raise FrameError(f"{path}: PROJ comes off by {closure:.3g} m through the local grid: it is too wide for one")
    if written is not None:
        write_whole(written, wkt.rstrip() + "\n")
    scale_there, height_m = _scale(wkt, calibration), _height_m(calibration)
    return CalibratedSite(calibration, difference, sigma, scale_there, height_m, closure, UNITS[unit], wkt, written)


def _check_heights(crs: str, start: str) -> None:
    """Raise FrameError where heights of these two are not above the ellipsoid of GNSS."""
    for each in (crs, start):
        if not is_on_gnss_ellipsoid(each):
            raise FrameError(
                f"crs: {crs_label(each)} is not on the ellipsoid of GNSS, so that heights above it are not those of "
                "GNSS: give one on WGS 84, ETRS89 or NAD83, or --heights none"
            )
    if height_system_of(crs)[0] == "orthometric":
        raise FrameError(f"crs: {crs_label(crs)} has heights above a geoid: give ellipsoidal ones, and a crs without")


def _target(target: Path, table: Path, overwrite: bool) -> Path:
    """Return the file that is to be written. Raises WorkspaceError where it may not be."""
    if target.suffix.lower() not in (SUFFIX, ".wkt"):
        raise WorkspaceError(f"{target}: the CRS is written as WKT: give a name that ends in {SUFFIX}")
    if target.is_dir() or target.resolve() == table.resolve():
        raise WorkspaceError(f"{target}: is a folder, or the table itself: give another name")
    if not overwrite and (target.exists() or target.is_symlink()):
        raise WorkspaceError(f"{target}: is there already: give another name, or --overwrite")
    return target


def _pairs(
    table: PairFile, crs: str, units: MapUnits, heights: HeightModel, sigma_m: tuple[float | None, float | None]
) -> SitePairs:
    """Return the pairs in degrees and metres, with what each serves for."""
    position = geodetic_of(crs, table.position, geographic=table.geographic)
    position[:, 2] *= 1.0 if table.geographic else map_units(crs).height_m
    local_m = table.local * units.factors
    known_plan: BoolArray = np.asarray(np.isfinite(local_m[:, :2]).all(axis=1))
    known_height: BoolArray = np.asarray(np.isfinite(local_m[:, 2]) & np.isfinite(position[:, 2]))
    in_plan = known_plan & np.array([use in ("both", "plan") for use in table.use])
    in_height = known_height & np.array([use in ("both", "height") for use in table.use]) & (heights != "none")
    for use, known, what in (("plan", known_plan, "easting and northing"), ("height", known_height, "both heights")):
        bare = [n for n, u, k in zip(table.name, table.use, known, strict=True) if u == use and not k]
        if bare:
            raise ControlPointError(f"{table.path}: {some(bare)} cannot serve in {use} without {what}: give them")
    sigma = table.sigma_m.copy()
    for column, (serving, value, option) in enumerate(
        ((in_plan, sigma_m[0], "plan"), (in_height, sigma_m[1], "height"))
    ):
        lacking = np.isnan(sigma[:, column])
        if value is None and (lacking & serving).any():
            names = [n for n, bare in zip(table.name, lacking & serving, strict=True) if bare]
            raise ControlPointError(
                f"{table.path}: {things(len(names), 'pair')} ({some(names)}) without a standard deviation in {option}: "
                f"give a column sigma_{option}, or --sigma-{option}-m for all, of the two measurements together"
            )
        sigma[lacking, column] = np.nan if value is None else value
    return SitePairs(table.name, position[:, :2], position[:, 2], local_m, sigma, in_plan, in_height)


def _closure_m(crs: str, wkt: str, calibration: SiteCalibration) -> float:
    """Return how far PROJ takes the pairs from where the estimated parameters take them, in plan, and back."""
    pairs = calibration.pairs
    flat = np.column_stack([pairs.place_deg, np.zeros(len(pairs))])
    through = map_from_crs(degrees_of(crs), plan_of(wkt), flat)
    expected = pairs.local_m[:, :2] + calibration.residual_m[:, :2]
    known = np.isfinite(expected).all(axis=1)
    off = np.abs(through[known, :2] - expected[known]).max(initial=0.0)
    back = geodetic_of(plan_of(wkt), through / np.array([*[map_units(wkt).plan_m] * 2, 1.0]), geographic=False)
    degrees = np.abs(back[:, :2] - pairs.place_deg).max() if plan_of(wkt) else 0.0
    return float(max(off, np.deg2rad(degrees) * _SEMI_MAJOR_M))


def _height_m(calibration: SiteCalibration) -> float:
    """Return the mean ellipsoidal height of the pairs, 0 where none is known."""
    known = np.isfinite(calibration.used.height_m)
    return float(calibration.used.height_m[known].mean()) if known.any() else 0.0


def _scale(wkt: str, calibration: SiteCalibration) -> CombinedScale:
    """Return the scale at the middle of the pairs in plan, at their mean height."""
    easting, northing = calibration.used.local_m[calibration.used.in_plan, :2].mean(axis=0).tolist()
    height = _height_m(calibration)
    return LocalFrame(plan_of(wkt), (easting, northing, height)).combined_scale(np.array([easting, northing, height]))
