"""What the client's part says: what was surveyed and how well, check points, and the files that are handed over."""

from collections.abc import Sequence
from dataclasses import dataclass

from photogram.languages.language import ENGLISH, Language
from photogram.quality.asprs import AXES
from photogram.report.client.facts import Fact, survey_facts
from photogram.report.client.files import HandedOver, handed_over
from photogram.report.client.judgement import judgement_in
from photogram.report.client.measurements import MeasurementRow, measurement_rows, measurement_sentences
from photogram.report.client.volumes import VolumeRow, leading_rows, volume_rows, volume_sentences
from photogram.report.numbers.overall import FAR_APART, length
from photogram.report.numbers.traffic_lights import number
from photogram.report.numbers.wording import share
from photogram.report.record.ground import GroundPointRecord
from photogram.report.record.report import Report
from photogram.report.record.verdict import StandardRecord, VerdictFigureRecord, VerdictRecord

MOST_POINTS = 20
"""Check points in the table, so that it shares a page with the plan."""
MOST_BY_STANDARD = 10
"""The same where figures of an authority share the page too."""


@dataclass(frozen=True)
class CheckRow:
    """A check point: differences along easting, northing and height, and what they were predicted to scatter by, m;
    None along an axis that it does not check."""

    name: str
    difference_m: tuple[float | None, ...]
    sigma_m: tuple[float | None, ...]


@dataclass(frozen=True)
class ClientPart:
    """The contents of the client's part; ``checked`` counts all check points, ``check_points`` are those shown."""

    verdict: VerdictRecord
    standard: StandardRecord | None
    facts: list[Fact]
    accuracy: list[Fact]
    check_points: list[CheckRow]
    checked: int
    rmse_m: tuple[float | None, ...]
    files: list[HandedOver]
    volumes: list[VolumeRow]
    shown_volumes: list[VolumeRow]
    volume_sentences: list[str]
    measurements: list[MeasurementRow]
    measurement_sentences: list[str]


def client_part(report: Report, language: Language = ENGLISH) -> ClientPart:
    """Return the contents of the client's part of a report, in a language."""
    local = report.get("local_frame")
    scaled = local is None or local["scale_known"]
    points = [p for p in report["control_points"] if "check" in p["axis_roles"] and p["residual_m"]]
    axes = report["asprs"]["axes"]
    judgement = judgement_in(report, language)
    return ClientPart(
        judgement.verdict,
        judgement.standard,
        survey_facts(report, scaled, language),
        _accuracy(report, judgement.verdict, scaled, language),
        _check_rows(points, MOST_BY_STANDARD if report.get("standard") else MOST_POINTS) if scaled else [],
        len(points),
        (axes["easting"]["rmse_m"], axes["northing"]["rmse_m"], axes["height"]["rmse_m"]),
        handed_over(report["deliverables"], language),
        volume_rows(report, language),
        leading_rows(volume_rows(report, language)),
        volume_sentences(report, language),
        measurement_rows(report, language),
        measurement_sentences(report, language),
    )


def _check_rows(points: Sequence[GroundPointRecord], most: int) -> list[CheckRow]:
    """Return the check points in the order of the report; where they are many, the ``most`` that are furthest off."""

    def along(point: GroundPointRecord, values: Sequence[float | None] | None) -> tuple[float | None, ...]:
        roles = point["axis_roles"]
        return tuple(values[k] if values is not None and roles[k] == "check" else None for k in range(len(AXES)))

    rows = [CheckRow(p["name"], along(p, p["residual_m"]), along(p, p["sigma_m"])) for p in points]
    if len(rows) <= most:
        return rows
    worst = sorted(rows, key=lambda row: -max(abs(d) for d in row.difference_m if d is not None))[:most]
    return [row for row in rows if row in worst]


# ---- accuracy in words -----------------------------------------------------------------------------------------------


def _accuracy(report: Report, verdict: VerdictRecord, scaled: bool, language: Language) -> list[Fact]:
    """Return the verdict, and what it means: from check points, or as predicted where there are none."""
    said = [Fact("", verdict["sentence"], "verdict.sentence")]
    if verdict["also"]:
        also = language.gettext("The technical part says what else needs attention.")
        said.append(Fact("", also, "verdict.also"))
    if not scaled or not report["adjustment"]["converged"]:
        return said
    tested = [f for f in verdict["figures"] if f["n"]]
    if tested:
        return [*said, _measured(tested, language), *_completeness(report, language)]
    return [*said, *_meaning_of_prediction(verdict["figures"], language), *_completeness(report, language)]


def _measured(tested: Sequence[VerdictFigureRecord], language: Language) -> Fact:
    found = language.listed([_off(figure, language) for figure in tested])
    fewer, *more = sorted({f["n"] for f in tested})
    if more:
        sentence = language.gettext(
            "At {fewer} or {more} points that were surveyed on the ground and kept out of the computation (check "
            "points), the result differs from the survey by {found}, as the root mean square error (RMSE).",
            fewer=fewer,
            more=more[0],
            found=found,
        )
    else:
        sentence = language.ngettext(
            "At {n} point that was surveyed on the ground and kept out of the computation (check points), the result "
            "differs from the survey by {found}, as the root mean square error (RMSE).",
            "At {n} points that were surveyed on the ground and kept out of the computation (check points), the result "
            "differs from the survey by {found}, as the root mean square error (RMSE).",
            fewer,
            found=found,
        )
    return Fact("", sentence, "verdict.figures")


def _off(figure: VerdictFigureRecord, language: Language) -> str:
    rmse = length(figure["rmse_m"], language)
    if figure["where"] == "in plan":
        return language.gettext("{length} horizontally", length=rmse)
    return language.gettext("{length} vertically", length=rmse)


def _meaning_of_prediction(figures: Sequence[VerdictFigureRecord], language: Language) -> list[Fact]:
    if not any(f["absolute_sigma_m"] is not None for f in figures):
        return []
    sentences = [
        language.gettext(
            "No point on the ground was surveyed to test this: it is what the measurements themselves lead one to "
            "expect, as the standard deviation (1 sigma), which single errors may exceed twofold."
        )
    ]
    if any(number(f["absolute_sigma_m"]) > FAR_APART * number(f["relative_sigma_m"]) for f in figures):
        sentences.append(
            language.gettext(
                "Relative figures hold between points of this survey, for lengths, areas and slopes; absolute ones for "
                "coordinates in the map grid, and for comparison with other surveys."
            )
        )
    return [Fact("", " ".join(sentences), "verdict.figures")]


def _completeness(report: Report, language: Language) -> list[Fact]:
    """Return how much of the ground that photographs show has a measured height."""
    dense = report.get("dense")
    if dense is None or dense["completeness"] is None:
        return []
    sentence = language.gettext(
        "Of the ground that three photographs or more show, {share} has a measured height.",
        share=language.figure(share(dense["completeness"])),
    )
    return [Fact("", sentence, "dense.completeness")]
