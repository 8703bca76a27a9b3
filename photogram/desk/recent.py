"""The surveys that were open before on this machine, and what runs of them do now."""

import json
import os
from pathlib import Path
from typing import Literal

from typing_extensions import TypedDict

from photogram.background.runs import Runs, RunState
from photogram.errors import ProjectError
from photogram.files.atomic import make_folder, replacing
from photogram.pipeline.project_file import PROJECT_FILE
from photogram.pipeline.stage_names import StageName
from photogram.project.document import Document
from photogram.project.schema import ProjectFile
from photogram.result_files import result_path

MOST = 12

RUNS = "desk"
"""Folder of the runs within that of intermediate results."""


class RecentSurvey(TypedDict):
    """A survey that was open before."""

    folder: str
    name: str
    run: RunState
    """What its last run does."""
    stage: StageName | None
    """That it is in."""
    seconds_left: float | None
    has_results: bool


class RecentSurveys:
    """Remembers which surveys were open, in a file, the last one first."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def folders(self) -> list[Path]:
        """Return those that are still there."""
        try:
            known = json.loads(self._file.read_text(encoding="utf-8"))
        except (FileNotFoundError, ValueError):
            return []
        return [Path(folder) for folder in known if isinstance(folder, str) and Path(folder).is_dir()]

    def remember(self, folder: Path) -> None:
        """Put a survey first."""
        others = [other for other in self.folders() if other != folder]
        make_folder(self._file.parent)
        with replacing(self._file) as path:
            path.write_text(json.dumps([str(one) for one in (folder, *others)][:MOST]), encoding="utf-8")

    def views(self) -> list[RecentSurvey]:
        """Return what the surveys do."""
        return [_view(folder) for folder in self.folders()]


def recent_file() -> Path:
    """Return the file of this user that remembers which surveys were open (XDG base directories; Windows' own)."""
    state = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(state) if state else Path.home() / ".local" / "state") / "photogram" / "desk.json"


def folder_of(survey: Path, key: Literal["work", "results"]) -> Path:
    """Return a folder of a survey: as its project file says, where that can be read."""
    try:
        named = Document(survey / PROJECT_FILE).at((key,))
    except ProjectError:
        named = None
    return survey / (named if isinstance(named, str) else str(ProjectFile.model_fields[key].default))


def _view(folder: Path) -> RecentSurvey:
    view = Runs(folder_of(folder, "work") / RUNS).view()
    goes_on = view.state in ("running", "paused") and view.last is not None
    return {
        "folder": str(folder),
        "name": folder.name,
        "run": view.state,
        "stage": view.last["stage"] if goes_on and view.last else None,
        "seconds_left": view.last["seconds_left"] if goes_on and view.last else None,
        "has_results": result_path(folder_of(folder, "results"), "report.json").is_file(),
    }
