"""A task on disk: its folder, what is kept of it, and what its information says.

tasks/UUID/
├── task.json        what is kept of it
├── images/          photographs, masks of theirs in masks/, files of positions
├── tables/          ground points
├── project.yaml, work/, results/
├── run/             the process: what it said, and how it ended
└── assets/, all.zip what is handed back
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from pathlib import Path
from typing import NotRequired

from pydantic import TypeAdapter, ValidationError
from typing_extensions import TypedDict

from photogram.background.runs import RunView
from photogram.errors import WorkspaceError
from photogram.files.atomic import write_whole
from photogram.node.options import GivenOption, OptionValue, given_options

NOTE, IMAGES, MASKS, TABLES, RUN, ASSETS, ARCHIVE = (
    "task.json", "images", "masks", "tables", "run", "assets", "all.zip",
)  # fmt: skip
PROJECT = "project.yaml"
GROUPS = "image_groups.txt"

MOST_ATTEMPTS = 3
"""Of a task whose process ended with the machine; then it fails."""

_UUID = re.compile(r"[0-9a-f]{8}-[0-9a-f]{4}-[1-5][0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}")


class Status(IntEnum):
    """NodeODM's codes of what a task does."""

    QUEUED = 10
    RUNNING = 20
    FAILED = 30
    COMPLETED = 40
    CANCELED = 50


@dataclass(frozen=True)
class Task:
    """What is kept of a task."""

    uuid: str
    name: str
    created_unix_ms: int
    options: Mapping[str, OptionValue] = field(default_factory=dict)
    outputs: tuple[str, ...] = ()
    """Of what is handed back, the only ones wanted; all where there are none."""
    skips_tiles: bool = False
    """Whether nobody looks at the point cloud in a browser."""
    images: int = 0
    status: Status = Status.QUEUED
    error: str = ""
    began_unix_s: float | None = None
    ended_unix_s: float | None = None
    queued_unix_s: float = 0.0
    attempts: int = 0
    """How often its process was started since it was queued by somebody."""
    removed: bool = False
    """Whether it waits for the end of its process to be deleted."""


_TASK = TypeAdapter(Task)


class StatusView(TypedDict):
    """What a task does, and why it failed."""

    code: int
    errorMessage: NotRequired[str]


class TaskInfo(TypedDict):
    """A task, as `/task/UUID/info` tells it; times in milliseconds."""

    uuid: str
    name: str
    dateCreated: int
    processingTime: int
    status: StatusView
    options: list[GivenOption]
    imagesCount: int
    progress: float
    output: NotRequired[list[str]]


@dataclass(frozen=True)
class TaskFolder:
    """The folder of a task."""

    path: Path

    @property
    def images(self) -> Path:
        """Return the folder of its photographs."""
        return self.path / IMAGES

    @property
    def project(self) -> Path:
        """Return its project file."""
        return self.path / PROJECT

    @property
    def assets(self) -> Path:
        """Return the folder of what is handed back."""
        return self.path / ASSETS

    @property
    def archive(self) -> Path:
        """Return the archive of what is handed back."""
        return self.path / ARCHIVE

    @property
    def note(self) -> Path:
        """Return the file of what is kept of it."""
        return self.path / NOTE

    def read(self) -> Task:
        """Return what is kept of the task. Raises WorkspaceError where that is damaged."""
        try:
            return _TASK.validate_json(self.note.read_bytes())
        except (OSError, ValidationError) as error:
            raise WorkspaceError(f"{self.note}: cannot be read ({error}): remove the folder of this task") from error

    def write(self, task: Task) -> None:
        """Keep what a task is. Raises WorkspaceError where it cannot be written."""
        write_whole(self.note, _TASK.dump_json(task, indent=1))


def is_uuid(text: str) -> bool:
    """Return whether a text can be the UUID of a task, and so the name of its folder."""
    return _UUID.fullmatch(text) is not None


def task_info(task: Task, progress: float, now_unix_s: float) -> TaskInfo:
    """Return a task as its information tells it; ``progress`` is its share in per cent."""
    status: StatusView = {"code": int(task.status)}
    if task.error:
        status["errorMessage"] = task.error
    began = task.began_unix_s
    took_s = -1.0 if began is None else max((task.ended_unix_s or now_unix_s) - began, 0.0)
    return {
        "uuid": task.uuid,
        "name": task.name,
        "dateCreated": task.created_unix_ms,
        "processingTime": -1 if began is None else round(1000 * took_s),
        "status": status,
        "options": given_options(task.options),
        "imagesCount": task.images,
        "progress": 100.0 if task.status is Status.COMPLETED else round(progress, 1),
    }


def after_its_process(task: Task, view: RunView, said: str, now_unix_s: float) -> Task:
    """Return what a task is once its process has ended, which ``said`` an error last, or none: queued again where it
    ended with the machine."""
    if view.exit_code is None and view.state != "stopped" and task.attempts < MOST_ATTEMPTS:
        return replace(task, status=Status.QUEUED)
    status = {"done": Status.COMPLETED, "stopped": Status.CANCELED}.get(view.state, Status.FAILED)
    error = "" if status is not Status.FAILED else said or view.text.strip() or "the process ended without a word"
    return replace(task, status=status, error=error, ended_unix_s=now_unix_s)
