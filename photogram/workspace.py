"""The folder of intermediate results: stages, fingerprints, atomic writes, resume.

One sub-folder per stage. A stage writes into ``<stage>.partial/`` and is renamed when complete; ``stage.json`` in it
carries its fingerprint, made of its settings and of the fingerprints of its inputs. Finished files of a partial
folder are kept when its fingerprint is still the same, so a stage with one file per photograph goes on where it was
killed. JSON for what people read, uncompressed npz for arrays, no pickle.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, is_dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from photogram.errors import WorkspaceError
from photogram.files.atomic import replacing

FORMAT = 7
"""Raised when the meaning of files in a workspace changes; older stages are then made again."""

RecordT = TypeVar("RecordT")


def _plain(value: object) -> object:
    """Return a value that JSON can hold, with the same value for the same content."""
    if is_dataclass(value) and not isinstance(value, type):
        return {name: _plain(v) for name, v in asdict(value).items()}
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, Path):
        return value.as_posix()
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, float) and not np.isfinite(value):
        return None if np.isnan(value) else ("inf" if value > 0 else "-inf")
    return value


def fingerprint(*parts: object) -> str:
    """Return the SHA-256, in hex, of values made of dataclasses, arrays, mappings, sequences, text and numbers."""
    text = json.dumps([FORMAT, _plain(parts)], sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def file_fingerprint(path: Path) -> str:
    """Return the SHA-256, in hex, of a file's content. Raises WorkspaceError when it cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as fault:
        raise WorkspaceError(f"{path}: cannot be read: {fault.strerror}") from fault


def write_json(path: Path, value: object) -> None:
    """Write ``value`` as JSON, whole or not at all; NaN becomes null."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(_plain(value), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def read_json(path: Path) -> Any:  # noqa: ANN401 - JSON is any value
    """Read JSON. Raises WorkspaceError when the file is missing or damaged."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as fault:
        raise WorkspaceError(
            f"{path}: cannot be read ({fault}); delete the folder {path.parent} and run again"
        ) from fault


def write_arrays(path: Path, arrays: Mapping[str, NDArray[np.generic]]) -> None:
    """Write arrays as uncompressed npz, whole or not at all, the same bytes for the same arrays."""
    with replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays of an npz. Raises WorkspaceError when the file is missing or damaged."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as fault:
        raise WorkspaceError(
            f"{path}: cannot be read ({fault}); delete the folder {path.parent} and run again"
        ) from fault


def record_arrays(record: object) -> dict[str, NDArray[Any]]:
    """Return the fields of a dataclass of arrays and numbers; fields that are None are left out."""
    values = {f.name: getattr(record, f.name) for f in fields(record)}  # type: ignore[arg-type]
    return {name: np.asarray(value) for name, value in values.items() if value is not None}


def write_record(path: Path, record: object) -> None:
    """Write a dataclass whose fields are arrays, or None, as npz."""
    write_arrays(path, record_arrays(record))


def read_record(path: Path, kind: type[RecordT]) -> RecordT:
    """Read a dataclass of arrays that ``write_record`` wrote; scalars come back as Python's own."""
    return kind(**{name: (a if a.ndim else a.item()) for name, a in read_arrays(path).items()})


@dataclass(frozen=True)
class Workspace:
    """The folder of intermediate results of one project."""

    folder: Path

    def stage(self, name: str) -> Path:
        """Return the folder of a complete stage."""
        return self.folder / name

    def is_complete(self, name: str, mark: str) -> bool:
        """Return whether the stage is complete with the fingerprint ``mark``."""
        path = self.stage(name) / "stage.json"
        return path.is_file() and read_json(path).get("fingerprint") == mark

    def summary(self, name: str) -> dict[str, Any]:
        """Return what a complete stage said of itself: seconds and counts."""
        return dict(read_json(self.stage(name) / "stage.json"))

    def begin(self, name: str, mark: str) -> Path:
        """Return the partial folder of a stage; what an interrupted run with the same fingerprint left there is
        kept."""
        partial = self.folder / f"{name}.partial"
        note = partial / "fingerprint"
        if not (note.is_file() and note.read_text() == mark):
            shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir(parents=True)
            with replacing(note) as temporary:
                temporary.write_text(mark)
        return partial

    def finish(self, name: str, mark: str, summary: Mapping[str, object]) -> None:
        """Make the partial folder of a stage the complete one, replacing what was there."""
        partial, complete = self.folder / f"{name}.partial", self.stage(name)
        write_json(partial / "stage.json", {"stage": name, "fingerprint": mark, "format": FORMAT, **summary})
        (partial / "fingerprint").unlink()
        # Killed from here on, a partial folder without its note remains: the stage is made again, nothing is mixed.
        shutil.rmtree(complete, ignore_errors=True)
        os.replace(partial, complete)

    def discard(self, name: str) -> None:
        """Delete what an earlier run left of a stage."""
        shutil.rmtree(self.folder / f"{name}.partial", ignore_errors=True)
        shutil.rmtree(self.stage(name), ignore_errors=True)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the workspace for this process; the lock goes with the process, however it ends.

        Raises WorkspaceError when another process holds it, or the folder cannot be made.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            stream = (self.folder / "lock").open("w")
        except OSError as fault:
            raise WorkspaceError(f"{self.folder}: cannot be used for intermediate results: {fault.strerror}") from fault
        with stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as fault:
                raise WorkspaceError(
                    f"{self.folder}: another photogram works here; wait for it, "
                    "or give each project file its own 'work' folder"
                ) from fault
            except OSError as fault:
                raise WorkspaceError(
                    f"{self.folder}: its file system knows no locks ({fault.strerror}): "
                    "put the 'work' folder on a local disk"
                ) from fault
            yield
