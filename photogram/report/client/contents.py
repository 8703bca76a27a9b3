"""What the client's part says: what was surveyed and how well, check points, and the files that are handed over."""

from collections.abc import Sequence
from dataclasses import dataclass

from photogram.quality.asprs import AXES
from photogram.report.client.facts import Fact, survey_facts
from photogram.report.client.files import HandedOver, handed_over
from photogram.report.client.volumes import VolumeRow, leading_rows, volume_rows, volume_sentences
from photogram.report.numbers.overall import FAR_APART, length
from photogram.report.numbers.traffic_lights import number
from photogram.report.numbers.wording import share
from photogram.report.record.ground import GroundPointRecord
from photogram.report.record.report import Report
from photogram.report.record.verdict import VerdictFigureRecord

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

    facts: list[Fact]
    accuracy: list[Fact]
    check_points: list[CheckRow]
    checked: int
    rmse_m: tuple[float | None, ...]
    files: list[HandedOver]
    volumes: list[VolumeRow]
    shown_volumes: list[VolumeRow]
    volume_sentences: list[str]


def client_part(report: Report) -> ClientPart:
    """Return the contents of the client's part of a report."""
    local = report.get("local_frame")
    scaled = local is None or local["scale_known"]
    points = [p for p in report["control_points"] if "check" in p["axis_roles"] and p["residual_m"]]
    axes = report["asprs"]["axes"]
    return ClientPart(
        survey_facts(report, scaled),
        _accuracy(report, scaled),
        _check_rows(points, MOST_BY_STANDARD if report.get("standard") else MOST_POINTS) if scaled else [],
        len(points),
        (axes["easting"]["rmse_m"], axes["northing"]["rmse_m"], axes["height"]["rmse_m"]),
        handed_over(report["deliverables"]),
        volume_rows(report),
        leading_rows(volume_rows(report)),
        volume_sentences(report),
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


def _accuracy(report: Report, scaled: bool) -> list[Fact]:
    """Return the verdict, and what it means: from check points, or as predicted where there are none."""
    verdict = report["verdict"]
    said = [Fact("", verdict["sentence"], "verdict.sentence")]
    if verdict["also"]:
        said.append(Fact("", "The technical part says what else needs attention.", "verdict.also"))
    if not scaled or not report["adjustment"]["converged"]:
        return said
    tested = [f for f in verdict["figures"] if f["n"]]
    if tested:
        return [*said, *_measured(tested), *_completeness(report)]
    return [*said, *_meaning_of_prediction(verdict["figures"]), *_completeness(report)]


def _measured(tested: Sequence[VerdictFigureRecord]) -> list[Fact]:
    where = {"in plan": "horizontally", "in height": "vertically"}
    found = " and ".join(f"{length(f['rmse_m'])} {where[f['where']]}" for f in tested)
    counts = sorted({f["n"] for f in tested})
    count = " or ".join(str(n) for n in counts)
    points = "point that was" if counts == [1] else "points that were"
    sentence = (
        f"At {count} {points} surveyed on the ground and kept out of the computation (check points), the result "
        f"differs from the survey by {found}, as the root mean square error (RMSE)."
    )
    return [Fact("", sentence, "verdict.figures")]


def _meaning_of_prediction(figures: Sequence[VerdictFigureRecord]) -> list[Fact]:
    if not any(f["absolute_sigma_m"] is not None for f in figures):
        return []
    far = any(number(f["absolute_sigma_m"]) > FAR_APART * number(f["relative_sigma_m"]) for f in figures)
    apart = (
        " Relative figures hold between points of this survey, for lengths, areas and slopes; absolute ones for "
        "coordinates in the map grid, and for comparison with other surveys."
        if far
        else ""
    )
    sentence = (
        "No point on the ground was surveyed to test this: it is what the measurements themselves lead one to expect, "
        f"as the standard deviation (1 sigma), which single errors may exceed twofold.{apart}"
    )
    return [Fact("", sentence, "verdict.figures")]


def _completeness(report: Report) -> list[Fact]:
    """Return how much of the ground that photographs show has a measured height."""
    dense = report.get("dense")
    if dense is None or dense["completeness"] is None:
        return []
    rays = "three photographs or more"
    sentence = f"Of the ground that {rays} show, {share(dense['completeness'])} has a measured height."
    return [Fact("", sentence, "dense.completeness")]
