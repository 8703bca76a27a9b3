"""The queue of tasks, and what is asked of it: each task is a process of its own, which outlives this one.

What is on the disk is what counts: a server that is started again finds its tasks as they are, goes on watching those
that work, and queues again those whose process ended with the machine.
"""

import logging
import shutil
import time
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, RLock, Thread
from types import TracebackType
from typing import BinaryIO

from typing_extensions import TypedDict

from photogram import __version__
from photogram.background.runs import Runs
from photogram.errors import PhotogramError, WorkspaceError
from photogram.files.atomic import make_folder
from photogram.files.portable import try_lock
from photogram.machine import cores, free_memory_bytes, memory_bytes
from photogram.node.assets import place_of
from photogram.node.options import checked_options
from photogram.node.progress import all_events, from_line, last_error, lines_of, share_percent
from photogram.node.refusals import RequestError
from photogram.node.tasks import RUN, Status, Task, TaskFolder, TaskInfo, after_its_process, is_uuid, task_info
from photogram.node.uploads import Uploads
from photogram.wording import printable, shortened

API_VERSION = "2.2.1"
"""Of NodeODM, whose interface this is."""

ENGINE = "photogram"
PATIENCE_S = 120.0
"""In which a process that is told to end does so; then it is killed."""

_PAUSE_S = 0.5
_DAY_S = 86_400.0
_ENDED = (Status.FAILED, Status.COMPLETED, Status.CANCELED)
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class NodeSettings:
    """How a node works; ``folder`` holds its tasks."""

    folder: Path
    parallel_tasks: int = 1
    max_images: int | None = None
    most_task_bytes: int | None = None
    keep_days: float | None = None
    """After which tasks that have ended, and uploads that nobody completes, are deleted; None keeps all."""


class NodeInfo(TypedDict):
    """What a node is, as `/info` tells it."""

    version: str
    taskQueueCount: int
    maxImages: int | None
    maxParallelTasks: int
    totalMemory: int
    availableMemory: int
    cpuCores: int
    engine: str
    engineVersion: str


class Node:
    """The tasks in a folder. May be asked from several threads at once."""

    def __init__(self, settings: NodeSettings) -> None:
        """Raises WorkspaceError where the folder cannot be used, another node has it, or a task in it is damaged."""
        self._settings = settings
        make_folder(settings.folder)
        self._lock_file = _locked(settings.folder)
        self._folder = settings.folder / "tasks"
        make_folder(self._folder)
        self.uploads = Uploads(settings.folder / "uploads", settings.max_images, settings.most_task_bytes)
        self._lock, self._ending = RLock(), Event()
        folders = [TaskFolder(path) for path in sorted(self._folder.iterdir()) if is_uuid(path.name)]
        self._tasks = {folder.path.name: folder.read() for folder in folders}
        self._runs = {name: Runs(self._folder / name / RUN) for name in self._tasks}
        self._told_to_end = dict[str, float]()
        self._thread = Thread(target=self._watch, name="tasks", daemon=True)

    def __enter__(self) -> "Node":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ending.set()
        self._thread.join()
        self._lock_file.close()

    # ---- what is asked ---------------------------------------------------------------------------------------------

    def info(self) -> NodeInfo:
        """Return what the node is."""
        with self._lock:
            waiting = sum(task.status in (Status.QUEUED, Status.RUNNING) for task in self._tasks.values())
        return {
            "version": API_VERSION,
            "taskQueueCount": waiting,
            "maxImages": self._settings.max_images,
            "maxParallelTasks": self._settings.parallel_tasks,
            "totalMemory": memory_bytes(),
            "availableMemory": free_memory_bytes(),
            "cpuCores": cores(),
            "engine": ENGINE,
            "engineVersion": __version__,
        }

    def uuids(self) -> list[str]:
        """Return the UUIDs of all tasks, the oldest first."""
        with self._lock:
            known = [task for task in self._tasks.values() if not task.removed]
        return [task.uuid for task in sorted(known, key=lambda task: task.created_unix_ms)]

    def task(self, name: str, first_line: int | None = None) -> TaskInfo:
        """Return what a task does, with the lines of its console from one on. Raises RequestError where there is no
        such task."""
        task = self._known(name)
        events = [] if task.status is Status.QUEUED else all_events(self._runs[name])
        info = task_info(task, share_percent(events), time.time())
        if first_line is not None:
            info["output"] = from_line(lines_of(events), first_line)
        return info

    def output(self, name: str, first_line: int) -> list[str]:
        """Return the lines of the console of a task from one on. Raises as ``task``."""
        return self.task(name, first_line)["output"]

    def asset(self, name: str, asset: str) -> Path:
        """Return a file that a task hands back. Raises RequestError where there is no such task or file, or the task
        has not completed."""
        task, place = self._known(name), place_of(asset)
        shown = shortened(printable(asset))
        if asset != "all.zip" and place is None:
            raise RequestError(f"{shown}: no file that a task hands back is called so")
        if task.status is not Status.COMPLETED:
            raise RequestError(f"{shown}: the task has not completed")
        folder = TaskFolder(self._folder / name)
        path = folder.archive if place is None else folder.assets / place
        if not path.is_file():
            raise RequestError(f"{shown}: this task has made none")
        return path

    # ---- what is to be done ----------------------------------------------------------------------------------------

    def begin(self, task: Task) -> None:
        """Begin the upload of a task. Raises RequestError where its UUID is taken, WorkspaceError as ``Uploads``."""
        with self._lock:
            if task.uuid in self._tasks:
                raise RequestError(f"{task.uuid}: a task of this UUID is there already")
            self.uploads.begin(task)

    def commit(self, name: str) -> None:
        """Queue a task whose files have come. Raises RequestError as ``Uploads.commit``."""
        with self._lock:
            if name in self._tasks:  # said twice, because the first answer was lost
                return
            task = self.uploads.commit(name, self._folder)
            self._runs[name] = Runs(self._folder / name / RUN)
            self._set(replace(task, queued_unix_s=time.time()))

    def cancel(self, name: str) -> None:
        """Cancel a task; what it has finished is kept for a restart. Raises RequestError where it has ended."""
        with self._lock:
            task = self._known(name)
            if task.status in _ENDED:
                raise RequestError("the task has ended already")
            self._set(replace(task, status=Status.CANCELED, ended_unix_s=time.time()))
            self._end(name)

    def remove(self, name: str) -> None:
        """Remove a task and all of its files. Raises RequestError where there is no such task."""
        with self._lock:
            task = self._known(name)
            self._set(replace(task, removed=True))
            self._end(name)

    def restart(self, name: str, options: str | None) -> None:
        """Queue a task again that has ended, with other options where they are given; what is finished and still holds
        is not done again. Raises RequestError where it has not ended, or an option cannot be."""
        with self._lock:
            task = self._known(name)
            if task.status not in _ENDED:
                raise RequestError("the task has not ended: cancel it first")
            queued = Task(
                task.uuid, task.name, task.created_unix_ms,
                task.options if options is None else checked_options(options),
                task.outputs, task.skips_tiles, task.images, queued_unix_s=time.time(),
            )  # fmt: skip
            self._set(queued)

    # ---- the queue -------------------------------------------------------------------------------------------------

    def _known(self, name: str) -> Task:
        with self._lock:
            task = self._tasks.get(name)
        if task is None or task.removed:
            raise RequestError(f"{shortened(printable(name))} not found")
        return task

    def _end(self, name: str) -> None:
        self._told_to_end.setdefault(name, time.monotonic())
        self._runs[name].stop()

    def _set(self, task: Task) -> None:
        """Note what a task is now. Where the disk takes nothing, it is known to this process alone, until the next
        change."""
        self._tasks[task.uuid] = task
        try:
            TaskFolder(self._folder / task.uuid).write(task)
        except PhotogramError as error:
            _LOG.warning("%s", error)

    def _watch(self) -> None:
        while not self._ending.is_set():
            try:
                self.step()
            except (PhotogramError, OSError) as error:  # of one step: the disk is full, for example
                _LOG.warning("%s", error)
            except Exception:  # noqa: BLE001 - a defect, which is said and must not stop the queue
                _LOG.exception("a defect of photogram, in the queue of tasks")
            self._ending.wait(_PAUSE_S)

    def step(self) -> None:
        """Look after all tasks once: note which have ended, delete what is to be deleted, start what is queued."""
        with self._lock:
            working = {name for name in self._unsettled() if self._runs[name].goes_on()}
            self._told_to_end = {name: at for name, at in self._told_to_end.items() if name in working}
            for name, at in self._told_to_end.items():
                if time.monotonic() - at > PATIENCE_S:
                    self._runs[name].kill()
            for name, task in list(self._tasks.items()):
                if task.status is Status.RUNNING and name not in working and not task.removed:
                    runs = self._runs[name]
                    self._set(after_its_process(task, runs.view(), last_error(all_events(runs)), time.time()))
            gone = [name for name, task in self._tasks.items() if task.removed and name not in working]
            waiting = [t for t in self._tasks.values() if t.status is Status.QUEUED and not t.removed]
            free = self._settings.parallel_tasks - len(working)
            for task in sorted(waiting, key=lambda task: task.queued_unix_s):
                if free > 0 and task.uuid not in working:
                    self._start(task)
                    free -= 1
        for name in gone:
            shutil.rmtree(self._folder / name, ignore_errors=True)
            with self._lock:
                if not (self._folder / name).exists():
                    del self._tasks[name], self._runs[name]
        self._delete_old(time.time())

    def _unsettled(self) -> list[str]:
        """Return the tasks that may have a process: not those that ended by themselves."""
        settled = (Status.COMPLETED, Status.FAILED)
        return [name for name, task in self._tasks.items() if task.removed or task.status not in settled]

    def _start(self, task: Task) -> None:
        path = self._folder / task.uuid
        began = time.time() if task.began_unix_s is None else task.began_unix_s
        started = replace(task, status=Status.RUNNING, began_unix_s=began, attempts=task.attempts + 1)
        try:
            self._runs[task.uuid].start("task", [str(path)], "photogram.node.process")
        except (PhotogramError, OSError) as error:
            started = replace(started, status=Status.FAILED, error=str(error), ended_unix_s=time.time())
        self._set(started)

    def _delete_old(self, now_unix_s: float) -> None:
        if self._settings.keep_days is None:
            return
        before = now_unix_s - self._settings.keep_days * _DAY_S
        with self._lock:
            for task in list(self._tasks.values()):
                if task.status in _ENDED and not task.removed and (task.ended_unix_s or now_unix_s) < before:
                    self._set(replace(task, removed=True))
            for name in self.uploads.older_than(before):
                self.uploads.remove(name)


def _locked(folder: Path) -> BinaryIO:
    """Lock the folder of a node for this process. Raises WorkspaceError where another has it."""
    lock = (folder / "node.lock").open("ab")
    if not try_lock(lock.fileno()):
        lock.close()
        raise WorkspaceError(f"{folder}: another node works with this folder: end it, or give another with --folder")
    return lock
