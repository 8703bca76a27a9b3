"""What `photogram calibrate-site` shows of a calibrated site."""

from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from photogram.adjustment.reliability import minimal_detectable_blunder
from photogram.arrays import BoolArray, FloatArray
from photogram.local_grids.calibration import SiteCalibration, Suspicion
from photogram.local_grids.site_calibration import CalibratedSite
from photogram.local_grids.tested_fit import TestedFit
from photogram.terminal.console import console
from photogram.wording import some

_DEGREE = np.rad2deg(1.0)


def show(site: CalibratedSite, target: Path) -> None:
    """Show residuals, tests, parameters and scale of a calibrated site, and where its CRS was written."""
    console.print(_residuals(site))
    console.print(_reliability(site))
    console.print(_left_out(site))
    console.print(_parameters(site))
    for suspicion in site.calibration.suspicions:
        console.print(f"Contradicts: {_words(site.calibration, suspicion)}", markup=False, highlight=False)
    for text in site.calibration.warnings:
        console.print(f"Warning: {text}", markup=False, highlight=False)
    if not site.calibration.suspicions and not site.calibration.warnings:
        console.print("Nothing contradicts the calibration.")
    console.print(f"Written: {escape(str(site.path))}; in a project file: crs: {escape(target.name)}", soft_wrap=True)


def _table(title: str, texts: tuple[str, ...], numbers: tuple[str, ...]) -> Table:
    """Return an empty table of columns of texts and, behind them, of numbers."""
    table = Table(title=title)
    for column in texts:
        table.add_column(column)
    for column in numbers:
        table.add_column(column, justify="right")
    return table


def _m(value: float, decimals: int = 4) -> str:
    return "" if not np.isfinite(value) else f"{value:+.{decimals}f}"


def _plain(value: float) -> str:
    return "" if not np.isfinite(value) else f"{value:.3f}"


def _rows(calibration: SiteCalibration) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return redundancy numbers, w and minimal detectable blunders (N, 3) of all pairs, NaN of what does not serve."""
    used = calibration.used
    redundancy, w, mdb = (np.full((len(used), 3), np.nan) for _ in range(3))

    def put(serving: BoolArray, axes: slice, fit: TestedFit) -> None:
        least = minimal_detectable_blunder(fit.sigma, fit.redundancy)
        for table, values in ((redundancy, fit.redundancy), (w, fit.w), (mdb, least)):
            table[serving, axes] = values.reshape(int(serving.sum()), -1)

    put(used.in_plan, slice(0, 2), calibration.plan.fit)
    if calibration.height is not None:
        put(used.in_height, slice(2, 3), calibration.height.fit)
    return redundancy, w, mdb


def _use(calibration: SiteCalibration, i: int) -> str:
    plan, high = bool(calibration.used.in_plan[i]), bool(calibration.used.in_height[i])
    return {(True, True): "both", (True, False): "plan", (False, True): "height"}.get((plan, high), "check")


def _residuals(site: CalibratedSite) -> Table:
    table = _table("Residuals, fitted minus given, m, and w", ("pair", "use"), ("E", "N", "H", "w E", "w N", "w H"))
    _, w, _ = _rows(site.calibration)
    for i, name in enumerate(site.calibration.pairs.name):
        residuals = (_m(value) for value in site.calibration.residual_m[i])
        table.add_row(escape(name), _use(site.calibration, i), *residuals, *(_m(value, 1) for value in w[i]))
    return table


def _reliability(site: CalibratedSite) -> Table:
    title = "Redundancy numbers r, and least blunders found (MDB), m"
    table = _table(title, ("pair",), ("r plan", "r H", "MDB plan", "MDB H"))
    redundancy, _, mdb = _rows(site.calibration)
    for i, name in enumerate(site.calibration.pairs.name):
        numbers = (_plain(value)[:-1] for value in (redundancy[i, :2].mean(), redundancy[i, 2]))
        table.add_row(escape(name), *numbers, *(_plain(value) for value in (mdb[i, :2].max(), mdb[i, 2])))
    return table


def _left_out(site: CalibratedSite) -> Table:
    title = "Each pair left out: predicted by the others minus given, m, with standard deviations"
    table = _table(title, ("pair",), ("E", "N", "H", "sigma E", "sigma N", "sigma H"))
    for i, name in enumerate(site.calibration.pairs.name):
        values = (_m(value) for value in site.predicted_m[i])
        table.add_row(escape(name), *values, *(_plain(value) for value in site.predicted_sigma_m[i]))
    return table


def _parameters(site: CalibratedSite) -> Table:
    plan, height = site.calibration.plan, site.calibration.height
    table = _table("Parameters", ("parameter",), ("value", "standard deviation"))
    sigma = plan.sigma
    for axis, value, own in zip(("easting", "northing"), plan.origin_m / site.units.plan_m, sigma[:2], strict=True):
        origin = f"{value:.4f} {site.units.plan_symbol}"
        table.add_row(f"{axis} of the map's origin", origin, f"{own:.4f} m at the middle of the pairs")
    table.add_row("rotation", f"{plan.rotation_rad * _DEGREE:.7f}°", f"{sigma[2] * _DEGREE * 3600:.2f}″")
    of_scale = "held" if sigma[3] == 0.0 else f"{sigma[3] * 1e6:.2f} ppm"
    table.add_row("scale of the similarity", _ratio(plan.scale), of_scale)
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
    table.add_row("grid factor at the middle", _ratio(site.scale.grid), "")
    table.add_row("height factor there", _ratio(site.scale.height), f"ellipsoidal height {site.height_m:.2f} m")
    table.add_row("combined scale factor, grid over ground", _ratio(site.scale.combined), "")
    table.add_row("closed loop through PROJ", f"{site.closure_m * 1000:.6f} mm", "")
    return table


def _ratio(scale: float) -> str:
    return f"{scale:.9f} ({(scale - 1) * 1e6:+.2f} ppm)"


def _words(calibration: SiteCalibration, suspicion: Suspicion) -> str:
    names = [calibration.pairs.name[i] for i in suspicion.pairs]
    unit = "m in plan" if suspicion.part == "plan" else "m in height"
    chance = f"p = {suspicion.probability:.1e}"
    if len(names) > 1:
        return f"one of {some(names)} in {suspicion.part}, which the others cannot tell apart ({chance}); all are used"
    return f"{names[0]}: its local coordinates are {suspicion.off_m[0]:.3f} {unit} off ({chance}); not used there"
