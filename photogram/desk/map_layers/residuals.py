"""Ground points of a finished survey: how far they are off, what that should be, and what is said of them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from photogram.errors import WorkspaceError
from photogram.languages.said import Said
from photogram.report.reading import read_report
from photogram.report.record.ground import GroundPointRecord
from photogram.report.record.report import Report
from photogram.result_files import result_path


class MarkResidual(TypedDict):
    """A mark of a point."""

    photograph: str
    residual_px: list[float]
    left_out: bool
    suspect: bool


class PointResidual(TypedDict):
    """A ground point; east, north, up."""

    name: str
    role: str
    position_map_m: list[float]
    """As surveyed."""
    residual_m: list[float]
    """Adjusted less surveyed."""
    sigma_m: list[float | None]
    """Standard deviations of ``residual_m``; None where nothing tests a coordinate."""
    suspect: bool
    sentences: list[str]
    """What is said of it."""
    marks: list[MarkResidual]


class Residuals(TypedDict):
    """What the results say of what was measured."""

    points: list[PointResidual]
    """Those that were surveyed and marked, suspects first."""
    others: list[str]
    """What is said of measurements that are no ground points, photographs and cameras."""


def residuals(results: Path) -> Residuals:
    """Return what the report says of ground points and of suspects. Raises WorkspaceError where there is no report,
    ReportError where it is damaged."""
    path = result_path(results, "report.json")
    if not path.is_file():
        raise WorkspaceError(Said("no results yet: start the run first"))
    report = read_report(path)
    said = _said(report)
    compared = [p for p in report["control_points"] if p["adjusted_map_m"] is not None and p["residual_m"] is not None]
    points = [_point(point, said.pop(point["name"], [])) for point in compared]
    others = [sentence for sentences in said.values() for sentence in sentences]
    return {"points": sorted(points, key=lambda point: not point["suspect"]), "others": others}


def _said(report: Report) -> dict[str, list[str]]:
    """Return the sentences on suspects and blunders by the names that they concern."""
    said: dict[str, list[str]] = {}
    for suspect in report["suspects"]:
        said.setdefault(suspect["name"], []).append(suspect["sentence"])
    for blunder in report["blunders"]:
        for name in blunder["points"] or [blunder["photograph"] or blunder["camera"] or ""]:
            said.setdefault(name, []).append(blunder["sentence"])
    return said


def _point(point: GroundPointRecord, said: Sequence[str]) -> PointResidual:
    marks: list[MarkResidual] = [
        {
            "photograph": mark["photograph"],
            "residual_px": list(mark["residual_px"]),
            "left_out": mark["left_out"],
            "suspect": bool(mark["suspect"]),
        }
        for mark in point["marks"]
        if mark["residual_px"] is not None
    ]
    verdict = [] if point["verdict"] is None or said else [f"{point['name']} {point['verdict']}."]
    return {
        "name": point["name"],
        "role": point["role"],
        "position_map_m": list(point["surveyed_map_m"]),
        "residual_m": list(point["residual_m"] or ()),
        "sigma_m": _sigma_m(point),
        "suspect": bool(point["suspect"]) or bool(said) or any(mark["suspect"] for mark in marks),
        "sentences": [*said, *verdict],
        "marks": marks,
    }


def _sigma_m(point: GroundPointRecord) -> list[float | None]:
    """Return the standard deviations of a point's residuals: of control those that its redundancy leaves of the
    survey's, of a check both of the survey and of the point."""
    surveyed = np.array(point["surveyed_sigma_m"], dtype=np.float64)
    if point["redundancy"] is not None:
        share = np.array(point["redundancy"], dtype=np.float64)
        sigma = surveyed * np.sqrt(np.where(share > 0.0, share, np.nan))
    else:
        sigma = np.hypot(surveyed, np.array(point["sigma_m"] or [np.nan] * 3, dtype=np.float64))
    return [float(value) if np.isfinite(value) else None for value in sigma]
