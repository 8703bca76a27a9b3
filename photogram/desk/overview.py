"""What is known of a survey before anything is processed: places of photographs and points, and what is odd."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from typing_extensions import TypedDict

from photogram.arrays import FloatArray
from photogram.errors import FrameError
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.crs import NO_CRS, crs_label
from photogram.languages.said import Said
from photogram.pipeline.input_validation import CheckedProject, predicted_costs
from photogram.project.document import Document
from photogram.project.measured.measured_positions import positions_map_m
from photogram.project.measured.measured_survey import stated_positions
from photogram.project.project import Project, ProjectPhotograph

Severity = Literal["error", "warning", "note"]


class PhotographPlace(TypedDict):
    """Where a photograph was taken."""

    name: str
    flight: str
    camera: str
    position_map_m: list[float] | None
    """Easting, northing, height; None where nothing tells them."""


class PointPlace(TypedDict):
    """A ground point."""

    name: str
    role: str
    position_map_m: list[float] | None
    marks: int


class FindingText(TypedDict):
    """What is odd."""

    severity: Literal["error", "warning", "note"]
    where: str
    text: str
    remedy: str


class Assumption(TypedDict):
    """A figure that nobody has stated, so that photogram assumed it."""

    name: str
    """Which of ASSUMED."""
    title: str
    value_m: list[float]
    cost: str
    """What it costs that nobody states it."""


class Overview(TypedDict):
    """A survey on its map."""

    title: str
    crs: str
    cameras: list[str]
    photographs: list[PhotographPlace]
    points: list[PointPlace]
    findings: list[FindingText]
    assumptions: list[Assumption]


class Prediction(TypedDict):
    """What is predicted of the work that is not done yet."""

    seconds: float
    memory_bytes: float
    disk_bytes: float
    stages: list[str]


ASSUMED = {"gnss": ("photographs", "gnss_sigma"), "control": ("control_points", "sigma")}
"""Block and key, less its ending, of the figures that may be assumed: ``_m`` states it, ``_assumed`` says that nobody
did. Ground points may say it for each of their files too."""


def assumed_places(path: Path, name: str) -> list[tuple[str | int, ...]]:
    """Return where a project file says that a figure of ASSUMED is assumed: the keys of its blocks, and its own less
    the ending. Raises ProjectError where the file cannot be read."""
    block, key = ASSUMED[name]
    said = Document(path).value
    within = said.get(block) if isinstance(said, dict) else None
    if not isinstance(within, dict):
        return []
    places: list[tuple[str | int, ...]] = [(block, key)] if within.get(f"{key}_assumed") is True else []
    files = within.get("files")
    for number, file in enumerate(files if isinstance(files, list) else []):
        if isinstance(file, dict) and file.get(f"{key}_assumed") is True:
            places.append((block, "files", number, key))
    return places


def overview(project: Project, checked: CheckedProject) -> Overview:
    """Return a survey on its map, with what the check of its project has found."""
    return {
        "title": project.report.name or project.path.absolute().parent.name,
        "crs": Said("none") if project.crs == NO_CRS else crs_label(project.crs),
        "cameras": [camera.name for camera in project.cameras],
        "photographs": [
            {
                "name": photograph.name,
                "flight": photograph.flight,
                "camera": project.cameras[photograph.camera].name,
                "position_map_m": _known(place),
            }
            for photograph, place in zip(project.photographs, photograph_places(project, checked.tags), strict=True)
        ],
        "points": [
            {
                "name": point.name,
                "role": point.role,
                "position_map_m": _known(point.position_map_m),
                "marks": len(point.mark_photograph),
            }
            for point in project.control_points
        ],
        "findings": [
            {"severity": f.severity, "where": f.where, "text": f.text, "remedy": f.remedy} for f in checked.findings
        ],
        "assumptions": assumptions(project),
    }


def assumptions(project: Project) -> list[Assumption]:
    """Return the figures that nobody has stated."""
    assumed = list[Assumption]()
    unsure = [p for p in project.photographs if p.gnss_sigma_assumed and p.gnss_sigma_m is not None]
    if unsure:
        assumed.append(
            {
                "name": "gnss",
                "title": Said("Accuracy of the camera positions"),
                "value_m": _known(unsure[0].gnss_sigma_m) or [],
                "cost": Said(
                    "If nobody states it: estimated from the photographs where they tell it; state it where the "
                    "receiver gave it."
                ),
            }
        )
    points = [p for p in project.control_points if p.sigma_assumed]
    if points:
        assumed.append(
            {
                "name": "control",
                "title": Said("Accuracy of the ground points"),
                "value_m": _known(points[0].sigma_m) or [],
                "cost": Said(
                    "If nobody states it: the absolute accuracy of the survey cannot be better known than its points."
                ),
            }
        )
    return assumed


def prediction(project: Project, tags: Sequence[PhotographTags | None]) -> Prediction:
    """Return what the work that is not done yet is predicted to take on this machine, as if it were as fast as the
    reference. Where an earlier run has left anything it reads the photographs whole, for their checksums."""
    costs = predicted_costs(project, tags, test=False)
    return {
        "seconds": costs.seconds,
        "memory_bytes": costs.memory_bytes,
        "disk_bytes": costs.disk_bytes,
        "stages": [stage.stage for stage in costs.stages],
    }


def photograph_places(project: Project, tags: Sequence[PhotographTags | None]) -> FloatArray:
    """Return the positions (F, 3) of the photographs in the map, NaN where there is none, or none in the map."""
    try:
        return stated_positions(project, tags)
    except FrameError:
        return np.concatenate([_one_place(project, *one) for one in zip(project.photographs, tags, strict=True)])


def _one_place(project: Project, photograph: ProjectPhotograph, tags: PhotographTags | None) -> FloatArray:
    try:
        return positions_map_m(project, [photograph], [tags])
    except FrameError:
        return np.full((1, 3), np.nan)  # the findings say why


def _known(values: FloatArray | Sequence[float] | None) -> list[float] | None:
    if values is None or not np.isfinite(values).all():
        return None
    return [float(value) for value in values]
