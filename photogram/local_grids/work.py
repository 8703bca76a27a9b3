"""What `photogram calibrate-site` does."""

from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from photogram.adjustment.reliability import minimal_detectable_blunder
from photogram.arrays import FloatArray
from photogram.geodesy.crs import MapUnits
from photogram.local_grids.calibration import HeightModel, SiteCalibration, Suspicion
from photogram.local_grids.site_calibration import CalibratedSite
from photogram.local_grids.site_calibration import calibrate_site as calibrated
from photogram.local_grids.tested_fit import TestedFit
from photogram.terminal.console import console
from photogram.wording import some

_DEGREE = np.rad2deg(1.0)


def run(
    pairs: Path,
    output: Path,
    crs: str,
    projection: str | None,
    scale: float | None,
    heights: HeightModel,
    sigma_m: tuple[float | None, float | None],
    unit: str,
    name: str | None,
    overwrite: bool,
) -> None:
    """Calibrate a site; show residuals, tests, parameters and scale, and write the CRS."""
    found = calibrated(
        pairs,
        output,
        crs=crs,
        projection=projection,
        scale=scale,
        heights=heights,
        sigma_plan_m=sigma_m[0],
        sigma_height_m=sigma_m[1],
        unit=unit,
        name=name,
        overwrite=overwrite,
    )
    console.print(_residuals(found))
    console.print(_left_out(found))
    console.print(_parameters(found))
    for suspicion in found.calibration.suspicions:
        console.print(f"Contradicts: {_words(found.calibration, suspicion)}", markup=False, highlight=False)
    for text in found.calibration.warnings:
        console.print(f"Warning: {text}", markup=False, highlight=False)
    if not found.calibration.suspicions and not found.calibration.warnings:
        console.print("Nothing contradicts the calibration.")
    console.print(f"Written: {escape(str(found.path))}; in a project file: crs: {escape(output.name)}", soft_wrap=True)


def _m(value: float, decimals: int = 4) -> str:
    return "" if not np.isfinite(value) else f"{value:+.{decimals}f}"


def _plain(value: float) -> str:
    return "" if not np.isfinite(value) else f"{value:.3f}"


def _rows(calibration: SiteCalibration) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return redundancy numbers, w and minimal detectable blunders (N, 3) of all pairs, NaN of what does not serve."""
    used = calibration.used
    redundancy, w, mdb = (np.full((len(used), 3), np.nan) for _ in range(3))

    def put(serving: FloatArray, axes: slice, fit: TestedFit, size: int) -> None:
        rows = np.flatnonzero(serving)
        least = minimal_detectable_blunder(fit.sigma, fit.redundancy)
        for table, values in ((redundancy, fit.redundancy), (w, fit.w), (mdb, least)):
            table[rows, axes] = values.reshape(-1, size)

    put(np.asarray(used.in_plan, dtype=np.float64), slice(0, 2), calibration.plan.fit, 2)
    if calibration.height is not None:
        put(np.asarray(used.in_height, dtype=np.float64), slice(2, 3), calibration.height.fit, 1)
    return redundancy, w, mdb


def _use(calibration: SiteCalibration, i: int) -> str:
    plan, high = bool(calibration.used.in_plan[i]), bool(calibration.used.in_height[i])
    return {(True, True): "both", (True, False): "plan", (False, True): "height"}.get((plan, high), "check")


def _residuals(site: CalibratedSite) -> Table:
    table = Table(title="Residuals, fitted minus given, m; redundancy r; w; least blunder found (MDB), m")
    for title in ("pair", "use", "E", "N", "H", "r plan", "r H", "w E", "w N", "w H", "MDB plan", "MDB H"):
        table.add_column(title, justify="left" if title in ("pair", "use") else "right")
    redundancy, w, mdb = _rows(site.calibration)
    for i, name in enumerate(site.calibration.pairs.name):
        table.add_row(
            escape(name),
            _use(site.calibration, i),
            *(_m(value) for value in site.calibration.residual_m[i]),
            *(_plain(value)[:-1] for value in (redundancy[i, :2].mean(), redundancy[i, 2])),
            *(_m(value, 1) for value in w[i]),
            *(_plain(value) for value in (mdb[i, :2].max(), mdb[i, 2])),
        )
    return table


def _left_out(site: CalibratedSite) -> Table:
    table = Table(title="Each pair left out: predicted by the others minus given, m, with standard deviations")
    for title in ("pair", "E", "N", "H", "sigma E", "sigma N", "sigma H"):
        table.add_column(title, justify="left" if title == "pair" else "right")
    for i, name in enumerate(site.calibration.pairs.name):
        values = (_m(value) for value in site.predicted_m[i])
        table.add_row(escape(name), *values, *(_plain(value) for value in site.predicted_sigma_m[i]))
    return table


def _parameters(site: CalibratedSite) -> Table:
    plan, height, units = site.calibration.plan, site.calibration.height, site.units
    table = Table(title="Parameters")
    for title in ("parameter", "value", "standard deviation"):
        table.add_column(title, justify="left" if title == "parameter" else "right")
    east, north = plan.origin_m / units.plan_m
    sigma = plan.sigma
    for title, value in (("easting of the map's origin", east), ("northing of the map's origin", north)):
        at = 0 if title.startswith("e") else 1
        table.add_row(title, _length(value, units), f"{sigma[at]:.4f} m at the middle of the pairs")
    table.add_row("rotation", f"{plan.rotation_rad * _DEGREE:.7f}°", f"{sigma[2] * _DEGREE * 3600:.2f}″")
    held = "held" if sigma[3] == 0.0 else f"{sigma[3] * 1e6:.2f} ppm"
    table.add_row("scale of the similarity", f"{plan.scale:.9f} ({(plan.scale - 1) * 1e6:+.2f} ppm)", held)
    if height is not None:
        offset, north_slope, east_slope = height.sigma.tolist()
        table.add_row("local minus ellipsoidal height", f"{height.offset_m:.4f} m", f"{offset:.4f} m")
        for title, slope, own in (
            ("slope to the north", height.slope_north, north_slope),
            ("slope to the east", height.slope_east, east_slope),
        ):
            table.add_row(title, f"{slope * 1e6:+.2f} mm/km", "held at 0" if own == 0.0 else f"{own * 1e6:.2f} mm/km")
    for name, fit in (("plan", plan.fit), ("height", None if height is None else height.fit)):
        if fit is not None and fit.degrees_of_freedom > 0:
            factor = np.sqrt(fit.weighted_square / fit.degrees_of_freedom)
            degrees = fit.degrees_of_freedom
            table.add_row(f"residuals in {name} over stated sigmas", f"{factor:.2f}", f"{degrees} degrees of freedom")
    scale = site.scale
    table.add_row("grid factor at the middle", f"{scale.grid:.9f} ({(scale.grid - 1) * 1e6:+.2f} ppm)", "")
    above = f"ellipsoidal height {site.height_m:.2f} m"
    table.add_row("height factor there", f"{scale.height:.9f} ({(scale.height - 1) * 1e6:+.2f} ppm)", above)
    combined = f"{scale.combined:.9f} ({(scale.combined - 1) * 1e6:+.2f} ppm)"
    table.add_row("combined scale factor, grid over ground", combined, "")
    table.add_row("closed loop through PROJ", f"{site.closure_m * 1000:.6f} mm", "")
    return table


def _length(value: float, units: MapUnits) -> str:
    return f"{value:.4f} {units.plan_symbol}"


def _words(calibration: SiteCalibration, suspicion: Suspicion) -> str:
    names = [calibration.pairs.name[i] for i in suspicion.pairs]
    unit = "m in plan" if suspicion.part == "plan" else "m in height"
    chance = f"p = {suspicion.probability:.1e}"
    if len(names) > 1:
        return f"one of {some(names)} in {suspicion.part}, which the others cannot tell apart ({chance}); all are used"
    return f"{names[0]}: its local coordinates are {suspicion.off_m[0]:.3f} {unit} off ({chance}); not used there"
