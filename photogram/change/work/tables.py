"""What has changed between two epochs, as tables on the terminal."""

from rich.markup import escape
from rich.table import Table

from photogram.change.cloud_change import CloudChange
from photogram.change.files.change_files import SurfaceChange
from photogram.change.sentences import registration_words, sentences_of, volume_sentences
from photogram.terminal.console import console
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
    for sentence in sentences_of(change):
        _say(sentence)
    if change.volumes:
        _show_volumes(change)


def _show_volumes(change: SurfaceChange) -> None:
    table = Table(title="Volumes, m³, with 1 sigma")
    for name in ("polygon", "fill", "cut", "net", "area, m²", "gaps, m²", "filled, m²"):
        table.add_column(name, justify="left" if name == "polygon" else "right")
    for volume in (*change.volumes, *([change.total] if change.total and len(change.volumes) > 1 else [])):
        table.add_row(*_volume_row(volume))
    console.print(table)
    for sentence in volume_sentences(change):
        _say(sentence)


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
