"""What the page works on: the survey that is open, those that were open before, and the marking of its points."""

import os
import secrets
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from types import TracebackType

from starlette.exceptions import HTTPException
from starlette.routing import Router
from starlette.types import Receive, Scope, Send
from typing_extensions import TypedDict

from photogram.desk.map_layers.basemap import Basemap, tile_origin
from photogram.desk.recent import RecentSurveys, recent_file
from photogram.desk.survey_folder import SurveyFolder
from photogram.errors import WorkspaceError
from photogram.files.photographs.names import SUFFIXES
from photogram.languages.said import Said
from photogram.marking.detection import marking_session
from photogram.marking.marking_survey import open_marking
from photogram.marking.page.addresses import MarkingPage
from photogram.marking.page.session import MarkingSession
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.project_file import PROJECT_FILE
from photogram.project.draft.roles import write_roles
from photogram.survey import Role

MOST_LISTED = 500
"""Folders within one that are listed."""


class FolderEntry(TypedDict):
    """A folder within another."""

    name: str
    path: str
    photographs: int
    """Up to 9999 are counted."""
    has_project: bool


class Listing(TypedDict):
    """What lies in a folder, for choosing one."""

    path: str
    above: str | None
    photographs: int
    has_project: bool
    folders: list[FolderEntry]


class MarkingView(TypedDict):
    """Where points are marked."""

    address: str
    """Below that of the desk."""
    notes: list[str]
    """What the project file needs for the marks to count."""


@dataclass(frozen=True)
class _Marking:
    key: str
    session: MarkingSession
    pages: Router
    notes: tuple[str, ...]
    closing: ExitStack


class Desk:
    """The surveys of a session. May be asked from several threads at once."""

    def __init__(self, recent: Path | None = None, tiles: str | None = None) -> None:
        """``recent`` is the file that remembers which surveys were open; that of this user if None. ``tiles`` is the
        address of a basemap. Raises WorkspaceError where that is none."""
        self.tiles, self.tile_origin = tiles, None if tiles is None else tile_origin(tiles)
        self.recent = RecentSurveys(recent or recent_file())
        self._lock = Lock()
        self._survey: SurveyFolder | None = None
        self._marking: _Marking | None = None

    def __enter__(self) -> "Desk":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end_marking()

    @property
    def has_survey(self) -> bool:
        """Whether one is open."""
        return self._survey is not None

    @property
    def survey(self) -> SurveyFolder:
        """The survey that is open. Raises WorkspaceError where none is."""
        if self._survey is None:
            raise WorkspaceError(Said("no survey is open: choose a folder first"))
        return self._survey

    def basemap(self) -> Basemap | None:
        """Return the tiles under the map of the survey, None without."""
        return None if self.tiles is None else self.survey.basemap(self.tiles)

    def open(self, folder: Path) -> None:
        """Open a folder. Raises WorkspaceError where it is none."""
        if not folder.is_dir():
            raise WorkspaceError(Said("{folder}: folder not found: choose another", folder=folder))
        self.end_marking()
        self._survey = SurveyFolder(folder)
        self.recent.remember(self._survey.folder)

    def close(self) -> None:
        """Close the survey, and go back to the choice of one; a run goes on."""
        self.end_marking()
        self._survey = None

    def mark(self) -> MarkingView:
        """Return where the page of marking is, begun where it is not yet. Raises as ``open_marking``."""
        with self._lock:
            if self._marking is None:
                survey = open_marking(self.survey.project_path)
                with ExitStack() as stack:
                    session, patches = stack.enter_context(marking_session(survey))
                    page = MarkingPage(session, patches, self.survey.folder.name)
                    session.start()
                    page.begin()
                    notes = survey.lines_to_add()
                    self._marking = _Marking(
                        secrets.token_urlsafe(9), session, Router(page.routes()), notes, stack.pop_all()
                    )
            return {"address": f"marking/{self._marking.key}/", "notes": list(self._marking.notes)}

    async def marking(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request of the page of marking. Each session has an address of its own, so that a page that was
        left open marks nothing in another survey."""
        marking = self._marking
        if marking is None or scope["path_params"]["key"] != marking.key:
            raise HTTPException(404, "this marking has ended: go to Points again")
        await marking.pages(scope, receive, send)

    def set_role(self, name: str, role: Role) -> None:
        """Give a ground point a role, in the project file. Raises as ``write_roles``, ControlPointError as the
        session of marking where one is open."""
        with self._lock:
            if self._marking is not None:
                self._marking.session.set_role(name, role)
            else:
                write_roles(self.survey.project_path, {name: role}, load_project)

    def end_marking(self) -> None:
        """End the marking; every mark is on the disk already."""
        with self._lock:
            if self._marking is not None:
                self._marking.closing.close()
            self._marking = None


def listing(folder: Path) -> Listing:
    """Return what lies in a folder. Raises WorkspaceError where it cannot be read."""
    folder = folder.absolute()
    try:
        within = sorted(entry for entry in folder.iterdir() if entry.is_dir() and not entry.name.startswith("."))
    except OSError as error:
        said = Said("{folder}: cannot be read ({reason}): choose another folder", folder=folder, reason=error.strerror)
        raise WorkspaceError(said) from error
    return {
        "path": str(folder),
        "above": str(folder.parent) if folder.parent != folder else None,
        "photographs": _pictures(folder),
        "has_project": (folder / PROJECT_FILE).is_file(),
        "folders": _entries(within[:MOST_LISTED]),
    }


def _entries(folders: Sequence[Path]) -> list[FolderEntry]:
    return [
        {
            "name": folder.name,
            "path": str(folder),
            "photographs": _pictures(folder),
            "has_project": (folder / PROJECT_FILE).is_file(),
        }
        for folder in folders
    ]


def _pictures(folder: Path) -> int:
    try:
        with os.scandir(folder) as entries:
            return sum(entry.name.lower().endswith(SUFFIXES) for entry in entries)
    except OSError:
        return 0  # a folder that cannot be read shows none, and says why when it is chosen
