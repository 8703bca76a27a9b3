"""Volumes as tables of the page and the terminal show them."""

from dataclasses import dataclass

from photogram.languages.language import ENGLISH, Language
from photogram.report.record.report import Report
from photogram.report.record.volumes import VolumeRecord, VolumesRecord
from photogram.volumes.volumes import volume_label

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


def _row(name: str, volume: VolumeRecord, language: Language) -> VolumeRow:
    above, below = (
        language.figure(volume_label(m3, sigma_m3).removesuffix(UNIT).lstrip("+"))
        for m3, sigma_m3 in (
            (volume["fill_m3"], volume["fill_sigma_m3"]),
            (volume["cut_m3"], volume["cut_sigma_m3"]),
        )
    )
    net = language.figure(volume_label(volume["net_m3"], volume["net_sigma_m3"]).removesuffix(UNIT))
    return VolumeRow(name, above, below, net, volume["area_m2"], volume["unmeasured_m2"])


def volume_rows(report: Report, language: Language = ENGLISH) -> list[VolumeRow]:
    """Return the polygons of a report and, of several, their sum; none where no volume was measured."""
    volumes = report.get("volumes")
    if volumes is None or "left_out" in volumes:
        return []
    rows = [_row(volume["name"], volume, language) for volume in volumes["polygons"]]
    total = volumes["total"]
    return [*rows, _row(language.gettext("all"), total, language)] if total is not None and len(rows) > 1 else rows


def leading_rows(rows: list[VolumeRow]) -> list[VolumeRow]:
    """Return the first of many rows, and the last one, their sum."""
    return rows if len(rows) <= MOST_ROWS else [*rows[: MOST_ROWS - 1], rows[-1]]


def reason_in(reason: str, language: Language) -> str:
    """Return a reason that report.json has in English; in another language, where it is to be read."""
    return reason if language.is_english else language.gettext("the technical part says why")


def _base(volumes: VolumesRecord, language: Language) -> str:
    if volumes["base"] == "rim":
        return language.gettext("The base is the plane through the ground around each polygon.")
    if volumes["level_m"] is not None:
        return language.gettext("The base is the height {level} m.", level=language.figure(f"{volumes['level_m']:g}"))
    return language.gettext("The base is the surface {name}.", name=volumes["reference"])


def volume_sentences(report: Report, language: Language = ENGLISH) -> list[str]:
    """Return what belongs to the volumes in words: their base, what is missing, why there are none."""
    volumes = report.get("volumes")
    if volumes is None:
        return []
    if "left_out" in volumes:
        return [language.gettext("No volumes: {reason}.", reason=reason_in(volumes["left_out"], language))]
    said = [_base(volumes, language)] if volumes["polygons"] else []
    missing = [
        f"{v['name']} ({language.figure(format(v['unmeasured_m2'], '.1f'))} m²)"
        for v in volumes["polygons"]
        if v["unmeasured_m2"] > 0.0
    ]
    if missing:
        names = language.some(missing)
        said.append(
            language.gettext("Not measured everywhere, and no volume is counted there: {polygons}.", polygons=names)
        )
    filled = [
        f"{v['name']} ({language.figure(format(v['interpolated_m3'], '+.2f'))} m³)"
        for v in volumes["polygons"]
        if v["interpolated_m2"] > 0.0
    ]
    if filled:
        names = language.some(filled)
        said.append(
            language.gettext(
                "Partly from filled cells, which no standard deviation covers: {polygons}.", polygons=names
            )
        )
    if volumes["total"] is None and len(volumes["polygons"]) > 1:
        said.append(language.gettext("Polygons overlap: no sum of them is given."))
    return said + [
        language.gettext(
            "{name}: no volume, {reason}.", name=entry["name"], reason=reason_in(entry["reason"], language)
        )
        for entry in volumes["not_measured"]
    ]
