"""What has changed between two epochs, as tables on the terminal."""

from rich.markup import escape
from rich.table import Table

from photogram.change.cloud_change import CloudChange
from photogram.change.files.change_files import SurfaceChange
from photogram.files.maps.rasters import HIGHEST_M, LOWEST_M
from photogram.terminal.console import console
from photogram.volumes.stable_ground import Registration
from photogram.volumes.volumes import Volume, volume_label
from photogram.wording import percent


def _say(text: str) -> None:
    console.print(text, markup=False, highlight=False, soft_wrap=True)


def _figures(title: str, rows: dict[str, str]) -> None:
    table = Table(title=escape(title), show_header=False)
    table.add_column()
    table.add_column(justify="right")
    for name, value in rows.items():
        table.add_row(name, value)
    console.print(table)


def registration_words(registration: Registration, applied: bool) -> str:
    """Return what stable ground says of two epochs, in a sentence."""
    values = ", ".join(
        f"{name} {value:+.6f} ± {sigma:.6f}" if "tilt" in name or "rotation" in name else
        f"{name.removesuffix('_m')} {value:+.4f} ± {sigma:.4f} m"
        for name, value, sigma in zip(registration.names, registration.value, registration.sigma, strict=True)
    ).replace("_", " ")  # fmt: skip
    stated = registration.expected_sigma[0]
    expected = "" if not stated > 0.0 else f"; both epochs state ± {stated:.4f} m for the offset"
    remaining_m = registration.remaining_m
    rest = f", ± {remaining_m:.4f} m between its parts beyond noise" if remaining_m > 0.0 else ""
    done = "taken off" if applied else "not taken off (--coregister does)"
    return (
        f"Stable ground: {values}{expected}; {done}. Residuals: RMS {registration.after_rms_m:.4f} m over "
        f"{registration.cells}{rest}; {registration.rejected} contradict the rest."
    )


def show_surface_change(change: SurfaceChange) -> None:
    """Print the difference of two surfaces and the volumes."""
    told = max(change.within_level + change.lowered + change.raised, 1)
    d = change.difference
    rows = {
        "cells with a difference": f"{change.cells}",
        "mean, m": f"{d.mean_m:+.4f}",
        "median, m": f"{d.median_m:+.4f}",
        "NMAD, m": f"{d.nmad_m:.4f}",
        "sigma, median, m": f"{change.sigma_median_m:.4f}",
        "of it common to neighbours, m": f"{change.common_sigma_median_m:.4f}",
        "within the level of detection": percent(change.within_level / told, 1),
        "lower": percent(change.lowered / told, 1),
        "higher": percent(change.raised / told, 1),
    }
    _figures(f"{change.later} minus {change.reference}", rows)
    if change.bases:
        _say("The base of each polygon is the plane through the ground around it.")
    for remark in change.remarks:
        _say(remark)
    if change.resampled:
        _say(f"Interpolated on cells of {change.cell_m:g} m: {', '.join(change.resampled)}.")
    for name in change.undeclared_heights:
        _say(f"Heights of {name}: no height system is stated; they are taken to count from that of the other surface.")
    for name in change.zeros_without_data:
        _say(f"Zeros of {name} lie at its rim, far from all other heights: they are taken for no data.")
    for name in change.impossible_heights:
        low, high = f"{LOWEST_M:.0f}".replace("-", "−"), f"{HIGHEST_M:.0f}"
        _say(f"{name} declares no value for no data: heights below {low} m and above {high} m are taken for it.")
    if change.interpolated_cells:
        _say(f"{change.interpolated_cells} cells are filled or without a sigma: they have no level of detection.")
    if change.registration is not None:
        _say(registration_words(change.registration, change.registration_applied))
    if change.volumes:
        _show_volumes(change)


def _show_volumes(change: SurfaceChange) -> None:
    table = Table(title="Volumes, m³, with 1 sigma")
    for name in ("polygon", "fill", "cut", "net", "area, m²", "gaps, m²", "filled, m²"):
        table.add_column(name, justify="left" if name == "polygon" else "right")
    for volume in (*change.volumes, *([change.total] if change.total and len(change.volumes) > 1 else [])):
        table.add_row(*_volume_row(volume))
    console.print(table)
    if change.total is None:
        _say("Polygons overlap: no sum of them is given.")
    missing = [v.name for v in change.volumes if v.unmeasured_m2 > 0.0]
    if missing:
        _say(f"Not measured in both everywhere, and no volume is counted there: {', '.join(missing)}.")
    filled = [f"{v.name} ({v.interpolated_m3:+.2f} m³)" for v in change.volumes if v.interpolated_m2 > 0.0]
    if filled:
        _say(f"Partly from filled cells, which no sigma covers: {', '.join(filled)}.")


def _volume_row(v: Volume) -> tuple[str, ...]:
    def pair(volume: float, sigma: float) -> str:
        return volume_label(volume, sigma).removesuffix(" m³")

    return (
        escape(v.name), pair(v.fill_m3, v.fill_sigma_m3).lstrip("+"), pair(v.cut_m3, v.cut_sigma_m3).lstrip("+"),
        pair(v.net_m3, v.net_sigma_m3), f"{v.area_m2:.1f}", f"{v.unmeasured_m2:.1f}", f"{v.interpolated_m2:.1f}",
    )  # fmt: skip


def show_cloud_change(change: CloudChange) -> None:
    """Print the distances of two clouds."""
    d, told = change.distance, max(change.with_level, 1)
    rows = {
        "points": f"{change.points}",
        "with a distance": f"{change.compared}",
        "mean, m": f"{d.mean_m:+.4f}",
        "standard deviation, m": f"{d.std_m:.4f}",
        "median, m": f"{d.median_m:+.4f}",
        "NMAD, m": f"{d.nmad_m:.4f}",
    }
    if change.with_level:
        rows |= {
            "level of detection, median, m": f"{change.level_median_m:.4f}",
            "within it": percent(change.within_level / told, 1),
        }
    _figures(f"{change.later} from {change.reference}, {change.method}", rows)
    _say(f"Level of detection: {change.level_of_detection}.")
    if change.registration is not None:
        _say(registration_words(change.registration, change.registration_applied))
