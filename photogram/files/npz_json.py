"""JSON and npz files, and fingerprints of what they hold."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, is_dataclass
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from photogram.errors import WorkspaceError
from photogram.files.arrays import read_npz
from photogram.files.atomic import replacing

FORMAT = 13
"""Raised when the meaning of files in a workspace changes; older stages are then made again."""


JsonT = TypeVar("JsonT")


def plain(value: object) -> object:
    """Return a value that JSON can hold, the same for the same content."""
    if is_dataclass(value) and not isinstance(value, type):
        return {name: plain(v) for name, v in asdict(value).items()}
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, Path):
        return value.as_posix()
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, float) and not np.isfinite(value):
        return None if np.isnan(value) else ("inf" if value > 0 else "-inf")
    return value


def fingerprint(*parts: object) -> str:
    """Return the SHA-256, in hex, of values made of dataclasses, arrays, mappings, sequences, text and numbers."""
    text = json.dumps([FORMAT, plain(parts)], sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def file_fingerprint(path: Path) -> str:
    """Return the SHA-256, in hex, of a file's content. Raises WorkspaceError when it cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise WorkspaceError(f"{path}: cannot be read: {error.strerror}") from error


def text_of(value: object) -> str:
    """Return ``value`` as JSON; NaN becomes null."""
    return json.dumps(plain(value), indent=2, ensure_ascii=False) + "\n"


def write_json(path: Path, value: object) -> None:
    """Write ``value`` as JSON, whole or not at all; NaN becomes null."""
    with replacing(path) as temporary:
        temporary.write_text(text_of(value), encoding="utf-8")


def read_json(path: Path) -> Any:  # noqa: ANN401 - JSON is any value
    """Read JSON. Raises WorkspaceError when the file is missing or damaged."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise WorkspaceError(f"{path}: cannot be read ({error}): delete it and run again") from error


_types: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)


def read_json_as(path: Path, kind: type[JsonT]) -> JsonT:
    """Read JSON of a kind, as its type checks it; keys that it does not know are left out. Raises WorkspaceError when
    the file is missing or damaged, or holds something else."""
    try:
        value: JsonT = _types(kind).validate_json(path.read_bytes(), strict=True)
        return value
    except ValidationError as error:
        place = ".".join(map(str, error.errors(include_url=False)[0]["loc"])) or "JSON"
        raise WorkspaceError(f"{path}: cannot be read ({place} is damaged): delete it and run again") from error
    except OSError as error:
        raise WorkspaceError(f"{path}: cannot be read ({error}): delete it and run again") from error


def write_arrays(path: Path, arrays: Mapping[str, NDArray[np.generic]]) -> None:
    """Write arrays as uncompressed npz, whole or not at all, the same bytes for the same arrays."""
    with replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]


def read_arrays(path: Path, *names: str) -> dict[str, NDArray[Any]]:
    """Read the arrays of an npz, those of some ``names`` or all. Raises WorkspaceError when the file is missing or
    damaged."""
    try:
        return read_npz(path, *names)
    except OSError as error:
        raise WorkspaceError(f"{path}: cannot be read ({error}): delete it and run again") from error
