"""Tasks that are not complete yet: files that come in parts, in whatever order, over days if need be.

Each is a folder as that of a task, which becomes one by its name once all is there. What is on the disk counts, so that
a server that ends loses nothing of it.
"""

import secrets
import shutil
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from photogram.errors import WorkspaceError
from photogram.files.atomic import make_folder
from photogram.node.assets import checked_outputs
from photogram.node.options import checked_options
from photogram.node.received import FileKind, Room, keep, kind_of
from photogram.node.refusals import RequestError
from photogram.node.tasks import IMAGES, Task, TaskFolder, is_uuid
from photogram.wording import printable, shortened

RESERVE_BYTES = 1 << 30
"""Of the disk, which uploads leave free."""

_INCOMING = ".incoming"
_LONGEST_NAME = 200
_KNOWN = ("name", "options", "dateCreated", "outputs", "skipPostProcessing")
_REFUSED = {
    "zipurl": "this node fetches nothing from addresses: send the photographs",
    "webhook": "this node calls no addresses: ask for /task/UUID/info",
}


def new_task(fields: Mapping[str, str], wanted_uuid: str) -> Task:
    """Return the task that a form describes. Raises RequestError with what is wrong with it."""
    if wanted_uuid and not is_uuid(wanted_uuid.lower()):
        raise RequestError(f"set-uuid: {shortened(printable(wanted_uuid))} is no UUID")
    for name, value in fields.items():
        if value and name in _REFUSED:
            raise RequestError(f"{name}: {_REFUSED[name]}")
        if name not in (*_KNOWN, *_REFUSED, "token"):
            raise RequestError(f"{shortened(printable(name))}: this is no field of a task")
    created = fields.get("dateCreated", "").strip()
    if created and not (created.isdecimal() and len(created) < 15):
        raise RequestError(f"dateCreated: milliseconds since 1970 are expected, found {shortened(printable(created))}")
    now_s = time.time()
    usual = f"Task of {datetime.fromtimestamp(now_s, UTC).isoformat(timespec='seconds')}"
    return Task(
        uuid=wanted_uuid.lower() or str(uuid.uuid4()),
        name=shortened(printable(fields.get("name", "").strip()), _LONGEST_NAME).replace("\n", " ") or usual,
        created_unix_ms=int(created) if created else round(1000 * now_s),
        options=checked_options(fields.get("options", "")),
        outputs=checked_outputs(fields.get("outputs", "")),
        skips_tiles=fields.get("skipPostProcessing", "").strip().lower() == "true",
    )


class Uploads:
    """The uploads in a folder. May be asked from several threads at once."""

    def __init__(self, folder: Path, max_images: int | None, most_bytes: int | None) -> None:
        self._folder, self._max_images, self._most_bytes = folder, max_images, most_bytes
        self._used: dict[str, int] = {}
        make_folder(folder)
        for path in folder.glob("*"):  # what requests of a server that was killed have left
            if path.name.startswith(_INCOMING):
                shutil.rmtree(path, ignore_errors=True)
            else:
                shutil.rmtree(path / _INCOMING, ignore_errors=True)

    def __contains__(self, name: str) -> bool:
        return is_uuid(name) and self._of(name).note.is_file()

    def _of(self, name: str) -> TaskFolder:
        return TaskFolder(self._folder / name)

    def _known(self, name: str) -> TaskFolder:
        if name not in self:
            raise RequestError(f"{shortened(printable(name))} not found: begin with /task/new/init")
        return self._of(name)

    def begin(self, task: Task) -> None:
        """Begin an upload. Raises WorkspaceError where it cannot be written."""
        folder = self._of(task.uuid)
        try:
            folder.path.mkdir()
        except FileExistsError:
            raise RequestError(f"{task.uuid}: a task of this UUID is there already") from None
        except OSError as error:
            raise WorkspaceError(f"{folder.path}: cannot be made ({error.strerror})") from error
        folder.write(task)

    def describe(self, task: Task) -> None:
        """Note what the task of an upload is that was begun without. Raises RequestError where there is no such
        upload, WorkspaceError where it cannot be written."""
        self._known(task.uuid).write(task)

    @contextmanager
    def incoming(self, name: str) -> Iterator[Path]:
        """Give a folder for what a request of an upload brings; it is gone afterwards. Raises RequestError where there
        is no such upload."""
        folder = self._known(name).path / _INCOMING / secrets.token_hex(8)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Give a folder for a request that is of no upload yet; it is gone afterwards."""
        folder = self._folder / f"{_INCOMING}-{secrets.token_hex(8)}"
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def room(self, name: str = "") -> Room:
        """Return what an upload may still bring, or one that is not begun yet."""
        free = shutil.disk_usage(self._folder).free - RESERVE_BYTES
        if self._most_bytes is None or not name:
            return Room(free)
        folder = self._of(name).path
        if name not in self._used:
            self._used[name] = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        return Room(min(free, self._most_bytes - self._used[name]))

    def keep(self, name: str, files: Sequence[Path]) -> None:
        """Keep files that have arrived. Raises RequestError as ``received.keep``, and where there are too many."""
        folder = self._known(name)
        if not files:
            raise RequestError("Need at least 1 file.")
        for file in files:
            size, new = file.stat().st_size, keep(file, folder.path, self.room(name))
            if name in self._used:
                self._used[name] += size
            if new and self._max_images is not None:
                self._check_number(self._photographs(folder))

    def commit(self, name: str, target: Path) -> Task:
        """Make a task of an upload that is complete, as a folder of its UUID in ``target``, and return it. Raises
        RequestError where it has no photographs, or too many."""
        folder = self._known(name)
        count = self._photographs(folder)
        if count == 0:
            raise RequestError("Need at least 1 file: no photograph is among what was sent.")
        self._check_number(count)
        shutil.rmtree(folder.path / _INCOMING, ignore_errors=True)
        task = folder.read()
        folder.path.rename(target / name)
        return replace(task, images=count)

    def remove(self, name: str) -> None:
        """Remove an upload that nobody completes."""
        shutil.rmtree(self._of(name).path, ignore_errors=True)

    def older_than(self, unix_s: float) -> list[str]:
        """Return the uploads to which nothing has come since a time."""
        folders = [path for path in self._folder.iterdir() if is_uuid(path.name)]
        return [path.name for path in folders if _last_change_s(path) < unix_s]

    def _photographs(self, folder: TaskFolder) -> int:
        names = [path.name for path in (folder.path / IMAGES).glob("*") if path.is_file()]
        return sum(kind_of(name) is FileKind.PHOTOGRAPH for name in names)

    def _check_number(self, count: int) -> None:
        if self._max_images is not None and count > self._max_images:
            raise RequestError(f"{count} images uploaded, but this node can only process up to {self._max_images}.")


def _last_change_s(folder: Path) -> float:
    return max(path.stat().st_mtime for path in (folder, folder / IMAGES, folder / _INCOMING) if path.exists())
