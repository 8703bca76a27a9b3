"""Measurements as tables of the page show them."""

from dataclasses import dataclass

import numpy as np

from photogram.languages.language import ENGLISH, Language
from photogram.languages.said import Said
from photogram.report.record.measurements import MeasuredFigureRecord, MeasurementRecord
from photogram.report.record.report import Report

MOST_ROWS = 5
"""Of the client's table, which shares a page with the files."""
NOT_FOR_CLIENTS = ("easting", "northing", "of it measured")
MOST_DIGITS = 4


@dataclass(frozen=True)
class MeasurementRow:
    """A measurement in words: each figure with its standard deviation (1 sigma) where one is known."""

    name: str
    kind: str
    figures: list[str]
    is_current: bool


def figure_label(figure: MeasuredFigureRecord, language: Language = ENGLISH) -> str:
    """Return a figure with its unit, to two digits of its standard deviation."""
    value, sigma, unit = figure["value"], figure["sigma"], figure["unit"]
    if value is None:
        return language.gettext("unknown")
    if sigma is None:
        return language.figure(f"{value:.{3 if unit == 'm' else 2}f} {unit}")
    digits = int(np.clip(1 - np.floor(np.log10(max(sigma, 1e-9))), 0, MOST_DIGITS))
    return language.figure(f"{value:.{digits}f} ± {sigma:.{digits}f} {unit}")


def measurement_rows(report: Report, language: Language = ENGLISH, *, whole: bool = False) -> list[MeasurementRow]:
    """Return the measurements of a report that have figures; the ``whole`` of them, or what a client looks for."""
    return [
        _row(measured, language, () if whole else NOT_FOR_CLIENTS)
        for measured in report.get("measurements", [])
        if measured["figures"]
    ]


def _row(measured: MeasurementRecord, language: Language, without: tuple[str, ...]) -> MeasurementRow:
    titles = {
        "height": language.gettext("Height"),
        "distance": language.gettext("Distance"),
        "profile": language.gettext("Profile"),
        "area": language.gettext("Area"),
        "volume": language.gettext("Volume"),
    }
    figures = [
        f"{Said(figure['name']).in_language(language)} {figure_label(figure, language)}"
        for figure in measured["figures"]
        if figure["name"] not in without
    ]
    return MeasurementRow(measured["name"], titles[measured["kind"]], figures, measured["is_current"])


def measurement_sentences(report: Report, language: Language = ENGLISH) -> list[str]:
    """Return what belongs to the measurements in words: whose standard deviations they have, which are outdated, which
    could not be made; none where the report has no measurements."""
    measured = report.get("measurements", [])
    if not measured:
        return []
    said = [
        language.gettext(
            "Measured on the surface model by hand; ± is one standard deviation, in which the places clicked count as "
            "exact."
        )
    ]
    outdated = [m["name"] for m in measured if m["figures"] and not m["is_current"]]
    if outdated:
        said.append(
            language.gettext(
                "Measured on the surface of an earlier run, not on this one: {names}.", names=language.some(outdated)
            )
        )
    missing = [m["name"] for m in measured if not m["figures"]]
    if missing:
        said.append(language.gettext("Could not be measured: {names}.", names=language.some(missing)))
    return said
