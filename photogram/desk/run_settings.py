"""What a person chooses of a run on the page, as lines of the project file, and what each choice is predicted to
take."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from typing_extensions import TypedDict

from photogram.desk.overview import Prediction, prediction
from photogram.errors import SettingError
from photogram.files.photographs.tags import PhotographTags
from photogram.languages.said import Said
from photogram.pipeline.pipeline import load_project
from photogram.project.draft.edits import Value, write_values
from photogram.project.project import Project

Choice = Literal["full", "quick", "own"]
Terrain = Literal["automatic", "yes", "no"]


class RunSettings(TypedDict):
    """What a run makes: None of a length leaves it to the photographs."""

    choice: Choice
    """All; a quick look, with key points in pictures of half size and a surface between tie points; or what a person
    has written, which is neither."""
    orthophoto: bool
    terrain: Terrain
    cell_m: float | None
    """Side of a cell of the surface."""
    interval_m: float | None
    """Contour interval."""


class ChoiceView(TypedDict):
    """A choice with what it is predicted to take from here on."""

    choice: Choice
    prediction: Prediction


def settings_of(project: Project) -> RunSettings:
    """Return what a project asks for."""
    choice: Choice = "own"
    if (project.quality, project.dense.enabled) == ("high", True):
        choice = "full"
    elif (project.quality, project.dense.enabled) == ("medium", False):
        choice = "quick"
    terrain = project.terrain.enabled
    return {
        "choice": choice,
        "orthophoto": project.orthophoto.enabled,
        "terrain": "automatic" if terrain is None else "yes" if terrain else "no",
        "cell_m": project.surface.cell_m,
        "interval_m": project.contours.interval_m,
    }


def choices(project: Project, tags: Sequence[PhotographTags | None]) -> list[ChoiceView]:
    """Return what can be chosen, the other settings being as they are; ``tags`` are those of the photographs."""
    full = replace(project, quality="high", dense=replace(project.dense, enabled=True))
    quick = replace(project, quality="medium", dense=replace(project.dense, enabled=False))
    offered: list[ChoiceView] = [
        {"choice": "full", "prediction": prediction(full, tags)},
        {"choice": "quick", "prediction": prediction(quick, tags)},
    ]
    if settings_of(project)["choice"] == "own":
        offered.append({"choice": "own", "prediction": prediction(project, tags)})
    return offered


def write_settings(path: Path, wanted: RunSettings) -> None:
    """Write settings to a project file, all or none of them. Raises SettingError or ProjectError where one cannot be,
    and then the file stays as it was."""
    for name in ("cell_m", "interval_m"):
        length = wanted[name]
        if length is not None and not 0.0 < length < 1e4:
            found = f"{length:g}"
            raise SettingError(name, Said("must be a positive length in metres, found {found}", found=found))
    quick = wanted["choice"] == "quick"
    matching: Mapping[tuple[str | int, ...], Value | None] = {
        ("quality",): "medium" if quick else None,
        ("dense", "enabled"): False if quick else None,
    }
    lines: Mapping[tuple[str | int, ...], Value | None] = {
        **({} if wanted["choice"] == "own" else matching),
        ("orthophoto", "enabled"): None if wanted["orthophoto"] else False,
        ("terrain", "enabled"): {"automatic": None, "yes": True, "no": False}[wanted["terrain"]],
        ("surface", "cell_m"): wanted["cell_m"],
        ("contours", "interval_m"): wanted["interval_m"],
    }
    write_values(path, lines, load_project)
