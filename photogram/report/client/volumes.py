"""Volumes as tables of the page and the terminal show them."""

from dataclasses import dataclass

from photogram.report.record.report import Report
from photogram.report.record.volumes import VolumeRecord
from photogram.volumes.volumes import volume_label
from photogram.wording import some

UNIT = " m³"
MOST_ROWS = 8
"""Of the client's table, which shares a page with the files."""


@dataclass(frozen=True)
class VolumeRow:
    """A polygon: volumes above and below the base and their difference, each with its standard deviation, m³; its area
    and what of it is not measured, m²."""

    name: str
    above: str
    below: str
    net: str
    area_m2: float
    unmeasured_m2: float


def _row(name: str, volume: VolumeRecord) -> VolumeRow:
    above, below = (
        volume_label(m3, sigma_m3).removesuffix(UNIT).lstrip("+")
        for m3, sigma_m3 in (
            (volume["fill_m3"], volume["fill_sigma_m3"]),
            (volume["cut_m3"], volume["cut_sigma_m3"]),
        )
    )
    net = volume_label(volume["net_m3"], volume["net_sigma_m3"]).removesuffix(UNIT)
    return VolumeRow(name, above, below, net, volume["area_m2"], volume["unmeasured_m2"])


def volume_rows(report: Report) -> list[VolumeRow]:
    """Return the polygons of a report and, of several, their sum; none where no volume was measured."""
    volumes = report.get("volumes")
    if volumes is None or "left_out" in volumes:
        return []
    rows = [_row(volume["name"], volume) for volume in volumes["polygons"]]
    total = volumes["total"]
    return [*rows, _row("all", total)] if total is not None and len(rows) > 1 else rows


def leading_rows(rows: list[VolumeRow]) -> list[VolumeRow]:
    """Return the first of many rows, and the last one, their sum."""
    return rows if len(rows) <= MOST_ROWS else [*rows[: MOST_ROWS - 1], rows[-1]]


def volume_sentences(report: Report) -> list[str]:
    """Return what belongs to the volumes in words: their base, what is missing, why there are none."""
    volumes = report.get("volumes")
    if volumes is None:
        return []
    if "left_out" in volumes:
        return [f"No volumes: {volumes['left_out']}."]
    said = [f"The base is {volumes['base_words']}."] if volumes["polygons"] else []
    missing = [f"{v['name']} ({v['unmeasured_m2']:.1f} m²)" for v in volumes["polygons"] if v["unmeasured_m2"] > 0.0]
    if missing:
        said.append(f"Not measured everywhere, and no volume is counted there: {some(missing)}.")
    filled = [
        f"{v['name']} ({v['interpolated_m3']:+.2f} m³)" for v in volumes["polygons"] if v["interpolated_m2"] > 0.0
    ]
    if filled:
        said.append(f"Partly from filled cells, which no standard deviation covers: {some(filled)}.")
    if volumes["total"] is None and len(volumes["polygons"]) > 1:
        said.append("Polygons overlap: no sum of them is given.")
    return said + [f"{entry['name']}: no volume, {entry['reason']}." for entry in volumes["not_measured"]]
