"""Compilation of kernels: numba's njit, whose compiled code is kept between runs and starts wherever photogram is.

Into the code of a kernel go other kernels that it calls and the constants that it names, of any module. So it is kept
under a digest of the source of its module and of all modules of photogram that this one imports, directly or not, where
numba would ask for its own file alone. All installations of the same sources share it, in the first of these folders
that can be written: ``NUMBA_CACHE_DIR``, the user's cache folder, or one of the user's own in the temporary directory
that nobody else may write, because the code is executed when it is read. Where there is none, every start compiles.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import pickle
import re
import shutil
import stat
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import llvmlite
import numba
from numba import config
from numba import njit as numba_njit  # noqa: TID251 - here it is wrapped
from numba.core import event
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.serialize import dumps

Function = TypeVar("Function", bound=Callable[..., Any])

KEPT_DIGESTS, KEPT_S = 3, 86_400.0  # of a module, as many states of its sources, and those that were used within a day

_STARTED = time.time()
_IMPORT = re.compile(r"^\s*(?:from|import)\s+(photogram[\w.]*)(?:\s+import\s+(\([^)]*\)|[^\n(]*))?", re.MULTILINE)

_kept: list[Any] = []  # every function whose compiled code is to be kept, as numba's dispatcher


def njit(**options: Any) -> Callable[[Function], Function]:  # noqa: ANN401 - numba's own options
    """Return numba's decorator njit with these options; with ``cache`` the compiled code is kept where it can be."""
    compiling = {name: value for name, value in options.items() if name != "cache"}

    def compiled(function: Function) -> Function:
        dispatcher = numba_njit(**compiling)(function)
        if options.get("cache"):
            with suppress(RuntimeError):  # numba's, where no place is to be had
                dispatcher._cache = _KernelCache(function)
                _kept.append(dispatcher)
        kernel: Function = dispatcher
        return kernel

    return compiled


@dataclass(frozen=True)
class _Place:
    """Tells numba where the code of a function is kept; its methods are those of numba's own locators."""

    _py_file: str
    _lineno: int
    folder: Path

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> _Place | None:
        """Return the place for a function of a file, None where its code is not to be kept."""
        root, digest = cache_folder(), sources_digest(file)
        if root is None or digest is None:
            return None
        folder = root / function.__module__ / digest
        with suppress(OSError):
            os.utime(folder)  # it is in use
        return cls(file, function.__code__.co_firstlineno, folder)

    def ensure_cache_path(self) -> None:
        """Make the folder, and with a new one remove what is out of use; without it nothing will be kept."""
        if not self.folder.exists():
            with suppress(OSError):
                self.folder.mkdir(parents=True, exist_ok=True)
                _prune(self.folder.parent)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def get_source_stamp(self) -> str:
        """Return the digest of the sources."""
        return self.folder.name

    def get_disambiguator(self) -> str:
        """Return what tells functions of one name in one module apart."""
        return str(self._lineno)


@dataclass(frozen=True)
class _CodeFiles:
    """The compiled forms of a kernel, a file for each, which is complete or absent: processes that compile at once
    cannot take each other's, and one that was killed leaves none. Its methods are those of numba's own."""

    folder: Path
    name: str

    def paths(self) -> list[Path]:
        """Return the files that there are."""
        return [*self.folder.glob(f"{self.name}.*.nbc")]

    def save(self, key: object, data: object) -> None:
        """Keep what was compiled for types and processor, ``key``; a full disk only makes the next start compile."""
        content, path = dumps((key, data)), self._path(key)
        partial = path.with_suffix(f".{uuid.uuid4().hex}")
        try:
            partial.write_bytes(hashlib.sha256(content).digest() + content)
            partial.replace(path)
        except OSError:
            partial.unlink(missing_ok=True)

    def load(self, key: object) -> object:
        """Return what was compiled for ``key``, None where that is not kept or damaged."""
        try:
            content = self._path(key).read_bytes()
        except OSError:
            return None
        if content[:32] != hashlib.sha256(content[32:]).digest():
            return None
        its_key, data = pickle.loads(content[32:])
        return data if its_key == key else None

    def flush(self) -> None:
        """Remove all files."""
        for path in self.paths():
            path.unlink(missing_ok=True)

    def _path(self, key: object) -> Path:
        """Return a key's file: two keys may have one, because addresses do not count, and ``load`` tells them apart."""
        text = re.sub(r"\b0x[0-9a-f]+", "", repr(key))
        return self.folder / f"{self.name}.{hashlib.sha256(text.encode()).hexdigest()[:16]}.nbc"


class _Stored(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = [_Place]  # noqa: RUF012 - numba reads this


class _KernelCache(FunctionCache):  # type: ignore[misc]
    """numba's cache of a function, with another place and other files."""

    _impl_class = _Stored

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _CodeFiles(Path(self.cache_path), self._impl.filename_base)


@cache
def sources_digest(file: str) -> str | None:
    """Return a digest of a source file, of all of photogram that it imports, directly or not, and of numba's version;
    None where that cannot be told. A process may have in memory what a file held before it was changed."""
    digests: dict[str, str] = {}
    ahead = {file}
    while ahead:
        path = ahead.pop()
        if not os.path.isfile(path) or _STARTED < os.path.getmtime(path) <= time.time():
            return None  # typed at a prompt, within an archive, or changed
        digests[path], imported = _source(path)
        ahead |= imported - digests.keys()
    parts = [numba.__version__, llvmlite.__version__, *sorted(digests.values())]
    return hashlib.sha256("".join(parts).encode()).hexdigest()[:20]


@cache
def _source(path: str) -> tuple[str, frozenset[str]]:
    """Return the digest of a source file, and the files of photogram that it imports."""
    text = Path(path).read_text(encoding="utf-8")
    imported = set[str]()
    for module, names in _IMPORT.findall(text):
        within = {_origin(f"{module}.{name}") or _origin(module) for name in re.findall(r"\w+", names)}
        imported |= {file for file in within or {_origin(module)} if file is not None}
    return hashlib.sha256(text.encode()).hexdigest(), frozenset(imported)


@cache
def _origin(module: str) -> str | None:
    """Return the file of a module, None where there is no module of that name. Nothing but rooms is imported for it."""
    parent = module.rpartition(".")[0]
    if parent and not (_origin(parent) or "").endswith("__init__.py"):
        return None
    spec = importlib.util.find_spec(module)
    return None if spec is None else spec.origin


def kernels(rooms: tuple[str, ...]) -> tuple[int, int]:
    """Return how many functions of the modules that have been imported and whose names begin with one of ``rooms`` are
    compiled for this machine, or kept so from an earlier run, and how many there are; those that are always inlined are
    seldom compiled by themselves, and left out."""
    own = [kernel for kernel in _kept if kernel.py_func.__module__.startswith(rooms)]
    own = [kernel for kernel in own if kernel.targetoptions.get("inline", "never") != "always"]
    return sum(_is_compiled(kernel) for kernel in own), len(own)


def _is_compiled(kernel: Any) -> bool:  # noqa: ANN401 - numba carries no types
    if kernel.signatures:
        return True
    return bool(kernel._cache._cache_file.paths())


@dataclass
class CompileTime:
    """The seconds that were spent compiling functions."""

    seconds: float = 0.0


@contextmanager
def compile_time() -> Iterator[CompileTime]:
    """Measure how long functions are compiled during the block; what is kept from an earlier run takes no time."""
    time_taken = CompileTime()

    def note(seconds: float) -> None:
        time_taken.seconds = seconds

    with event.install_timer("numba:compile", note):
        yield time_taken


@cache
def cache_folder() -> Path | None:
    """Return the folder where compiled code is kept, None where none can be written."""
    given = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")  # the latter is Windows's
    of_user = given or os.path.expanduser("~/.cache")  # stays ~ without a home
    for folder in (config.CACHE_DIR, os.path.join(of_user, "photogram", "kernels")):
        if os.path.isabs(folder) and _is_writable(Path(folder)):
            return Path(folder)
    return temporary_folder()


def _is_writable(folder: Path) -> bool:
    """Return whether files can be made in a folder, which is made if need be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _prune(folder: Path) -> None:
    """Remove what is kept for former sources of a module, but for the last ones."""
    used = sorted(((path.stat().st_mtime, path) for path in folder.iterdir()), reverse=True)
    for when, path in used[KEPT_DIGESTS:]:
        if when < time.time() - KEPT_S:
            shutil.rmtree(path, ignore_errors=True)


@cache
def temporary_folder() -> Path | None:
    """Return the user's own folder for compiled code in the temporary directory, made if need be; None where there is
    none that is safe: a real folder of this user that no one else may write or read, which Windows does not tell."""
    if not hasattr(os, "getuid"):
        return None
    try:
        folder = Path(tempfile.gettempdir()) / f"photogram-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return None
    own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077
    return folder if own else None
