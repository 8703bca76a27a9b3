"""The folder of intermediate results: stages, fingerprints, atomic writes, resume.

One sub-folder per stage, called as ``stage_folders`` says. A stage writes into a partial folder that is renamed when it
is complete; ``stage.json`` in it carries its fingerprint, made of its settings and of the fingerprints of its inputs,
and the checksum of every file. Finished files of a partial folder are kept when its fingerprint is still the same, so a
stage with one file per photograph goes on where it was killed. Of a complete stage nothing is used that is not what the
stage wrote. JSON for what people read, uncompressed npz for arrays, no pickle.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path

from photogram.errors import DamagedStageError, WorkspaceError
from photogram.files.npz_json import FORMAT, plain, write_json
from photogram.files.portable import through_no_link, try_lock
from photogram.files.stage_folders import (
    COMPLETE,
    LOCK,
    NOTE,
    PARTIAL,
    errors_of,
    is_made_here,
    make_stage_folder,
    remove_stage_folder,
)
from photogram.pipeline.store.stage_files import (
    StageFile,
    files_of,
    is_unchanged,
    journals,
    keep_whole_files,
    looks_unchanged,
    remove_all_leftovers,
)
from photogram.pipeline.store.stage_summary import StageNote, Summary, SummaryT, summary_from

_MISSING, _CHANGED = "is missing", "was modified since it was written"
_UNKNOWN = "was not written by the stage"


@dataclass(frozen=True)
class _Note:
    """What ``stage.json`` of a complete stage says, and when that file was written."""

    value: Summary
    files: dict[str, StageFile]
    mtime_ns: int


def _seal(value: Mapping[str, object]) -> str:
    """Return the checksum that a note carries of itself."""
    return hashlib.sha256(json.dumps(plain(value), sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class Workspace:
    """The folder of intermediate results of one project."""

    folder: Path
    _notes: dict[str, _Note] = field(default_factory=dict, init=False, repr=False, compare=False)
    _checked: set[Path] = field(default_factory=set, init=False, repr=False, compare=False)

    def stage(self, name: str) -> Path:
        """Return the folder of a complete stage."""
        return self.folder / f"{name}{COMPLETE}"

    def partial(self, name: str) -> Path:
        """Return the folder of a stage that works."""
        return self.folder / f"{name}{PARTIAL}"

    def _note(self, name: str) -> _Note:
        """Return what a complete stage says of itself. Raises DamagedStageError where its note is missing or damaged,
        or the stage is not there."""
        path = self.stage(name) / NOTE
        try:
            mtime_ns = os.lstat(path).st_mtime_ns
            known = self._notes.get(name)
            if known is None or known.mtime_ns != mtime_ns:
                value = json.loads(path.read_text(encoding="utf-8"))
                if value.pop("sha256") != _seal(value):
                    raise DamagedStageError(name, path, _CHANGED)
                files = {n: StageFile(**f) for n, f in value.pop("files").items()}
                known = _Note(value, files, mtime_ns)
                self._notes[name] = known
        except (FileNotFoundError, NotADirectoryError) as error:
            raise DamagedStageError(name, path, _MISSING) from error
        except (AttributeError, LookupError, TypeError, ValueError, RecursionError) as error:
            raise DamagedStageError(name, path, _CHANGED) from error
        except OSError as error:
            if isinstance(error, DamagedStageError):
                raise
            raise DamagedStageError(name, path, f"cannot be read ({error.strerror})") from error
        return known

    def mark(self, name: str) -> str | None:
        """Return the fingerprint that a complete stage carries, None where there is none of it.

        Raises DamagedStageError where its note is damaged, WorkspaceError where there is something at its place that
        photogram did not make.
        """
        folder = self.stage(name)
        if not is_made_here(folder) or not any(folder.iterdir()):
            return None
        return str(self.summary(name, StageNote).get("fingerprint"))

    def is_complete(self, name: str, mark: str) -> bool:
        """Return whether the stage is complete with the fingerprint ``mark``.

        Raises DamagedStageError where a file of it is missing or was written to since and holds something else,
        WorkspaceError where there is something at its place that photogram did not make.
        """
        if self.mark(name) != mark:
            return False
        for written, known in self._note(name).files.items():
            self._compare(name, self.stage(name) / written, known, looks_unchanged)
        return True

    def _compare(
        self, name: str, path: Path, known: StageFile, is_as_written: Callable[[Path, StageFile], bool]
    ) -> None:
        try:
            if is_as_written(path, known):
                return
        except OSError as error:
            raise DamagedStageError(name, path, f"cannot be read ({error.strerror})") from error
        raise DamagedStageError(name, path, _CHANGED if os.path.lexists(path) else _MISSING)

    def has(self, name: str, *parts: str) -> bool:
        """Return whether a complete stage has written a file, whatever became of it since. Raises DamagedStageError
        where its note is damaged."""
        return "/".join(parts) in self._note(name).files

    def file(self, name: str, *parts: str) -> Path:
        """Return the path of a file of a complete stage, as ``checked`` does."""
        return self.checked(self.stage(name).joinpath(*parts))

    def checked(self, path: Path) -> Path:
        """Return the path of a file of a complete stage once its content is known to be what the stage wrote.

        Its checksum is taken once in a process. Raises DamagedStageError where it is missing or holds something else.
        """
        if path not in self._checked:
            folder, *parts = path.relative_to(self.folder).parts
            name = folder.removesuffix(COMPLETE)
            known = self._note(name).files.get("/".join(parts))
            if known is None:
                raise DamagedStageError(name, path, _UNKNOWN)
            self._compare(name, path, known, is_unchanged)
            self._checked.add(path)
        return path

    def stored(self, name: str) -> Summary:
        """Return what a complete stage said of itself, and what is stored of every stage."""
        return self._note(name).value

    def summary(self, name: str, kind: type[SummaryT]) -> SummaryT:
        """Return what a complete stage said of itself, as the TypedDict of that stage, or what is stored of every one,
        as a StageNote. Raises DamagedStageError where it is something else."""
        try:
            return summary_from(self._note(name).value, kind)
        except ValueError as error:
            raise DamagedStageError(name, self.stage(name) / NOTE, _CHANGED) from error

    def begin(self, name: str, mark: str, warn: Callable[[str], None] = lambda _: None) -> Path:
        """Return the partial folder of a stage; what an interrupted run with the same fingerprint left there is kept,
        but for what has been damaged since, of which ``warn`` is told.

        Raises WorkspaceError where the folder cannot be created, or somebody else's has its place.
        """
        partial, note = self.partial(name), {"stage": name, "fingerprint": mark, "format": FORMAT}
        is_made_here(self.stage(name))  # else hours of work could not take their place
        if is_made_here(partial) and _is_note(partial / NOTE, note):
            for path in keep_whole_files(partial):
                warn(f"{path}: {_CHANGED}: it will be computed again")
        else:
            remove_stage_folder(partial)
            make_stage_folder(partial)
            write_json(partial / NOTE, note)
        return partial

    def finish(self, name: str, mark: str, summary: Summary) -> None:
        """Make the partial folder of a stage the complete one, replacing what was there."""
        partial, complete = self.partial(name), self.stage(name)
        with errors_of(partial):
            remove_all_leftovers(partial)  # of processes of a pool that were lost
            files = {written: asdict(known) for written, known in files_of(partial).items()}
            note = {"stage": name, "fingerprint": mark, "format": FORMAT, **summary, "files": files}
            write_json(partial / NOTE, {**note, "sha256": _seal(note)})
            for journal in journals(partial):
                journal.unlink()
        # Killed from here on, a partial folder with a finished note remains: the stage is made again, nothing is mixed.
        self.forget(name)
        remove_stage_folder(complete)
        with errors_of(complete):
            os.replace(partial, complete)

    def forget(self, name: str) -> None:
        """Take nothing of a stage as known any more: its files are compared again when they are read."""
        folder = self.stage(name)
        self._notes.pop(name, None)
        self._checked.difference_update([path for path in self._checked if path.is_relative_to(folder)])

    def discard(self, name: str) -> None:
        """Delete what an earlier run left of a stage."""
        self.forget(name)
        remove_stage_folder(self.partial(name))
        remove_stage_folder(self.stage(name))

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the workspace for this process; the lock goes with the process, however it ends.

        Raises WorkspaceError when another process holds it, or the folder cannot be created.
        """
        with errors_of(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            # neither a link is followed nor anything emptied that is called so
            lock = open(self.folder / LOCK, "ab", opener=through_no_link)  # noqa: SIM115 - below
        with lock:
            try:
                is_free = try_lock(lock.fileno())
            except OSError as error:
                raise WorkspaceError(
                    f"{self.folder}: its file system does not support locks ({error.strerror}): "
                    "put the 'work' folder on a local disk"
                ) from error
            if not is_free:
                raise WorkspaceError(
                    f"{self.folder}: another photogram is running here; wait for it, "
                    "or give each project file its own 'work' folder"
                )
            yield


def _is_note(path: Path, note: Mapping[str, object]) -> bool:
    """Return whether a partial folder says that it is of this stage and fingerprint, and not finished."""
    try:
        return bool(json.loads(path.read_text(encoding="utf-8")) == note)
    except (OSError, ValueError, RecursionError):
        return False
