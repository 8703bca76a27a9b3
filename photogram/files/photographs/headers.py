"""Many photographs looked at in parallel without decoding them: their tags, and which are the same file twice."""

import hashlib
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from photogram.errors import ImageError
from photogram.files.photographs.images import inspect_photograph
from photogram.files.photographs.tags import PhotographTags
from photogram.files.reading import regular_file_size

_HEAD_BYTES = 65536


@dataclass(frozen=True)
class PhotographHeader:
    """The tags of one photograph, or None and the ``error`` that keeps them from being read."""

    name: str
    tags: PhotographTags | None
    error: str = ""


def _read_header(path: Path) -> PhotographHeader:
    try:
        return PhotographHeader(path.name, inspect_photograph(path))
    except ImageError as error:
        return PhotographHeader(path.name, None, str(error).removeprefix(f"photograph {path}: "))


def read_headers(paths: Sequence[Path], executor: Executor) -> list[PhotographHeader]:
    """Return the header of each photograph; one that is missing or damaged has an error instead of tags."""
    return list(executor.map(_read_header, paths))


def _head(path: Path) -> tuple[int, bytes] | None:
    try:
        size = regular_file_size(path)
        with path.open("rb") as stream:
            return size, hashlib.sha256(stream.read(_HEAD_BYTES)).digest()
    except OSError:
        return None  # read_headers says that it cannot be read


def _content(path: Path) -> bytes:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").digest()


def equal_files(paths: Sequence[Path], executor: Executor) -> list[tuple[int, ...]]:
    """Return groups of indices of files with the same content; only those of one size and beginning are read whole."""
    heads: dict[tuple[int, bytes], list[int]] = {}
    for i, head in enumerate(executor.map(_head, paths)):
        if head is not None:
            heads.setdefault(head, []).append(i)
    alike = [i for group in heads.values() if len(group) > 1 for i in group]
    contents: dict[bytes, list[int]] = {}
    for i, content in zip(alike, executor.map(_content, [paths[i] for i in alike]), strict=True):
        contents.setdefault(content, []).append(i)
    return sorted(tuple(group) for group in contents.values() if len(group) > 1)
