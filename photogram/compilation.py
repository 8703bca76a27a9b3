"""Compilation of kernels: numba's njit, which starts wherever photogram is installed.

numba keeps compiled code beside the source, or else in the user's cache folder, and raises where neither can be written
(an installation that is read-only, a user without a home). Here the code then goes to a folder of the user's own in the
temporary directory, which nobody else may write, because it is executed when it is read; where folder not found
either, nothing is kept, and every start compiles anew.
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from numba import config
from numba import njit as numba_njit  # noqa: TID251 - here it is wrapped
from numba.core import event

Function = TypeVar("Function", bound=Callable[..., Any])

_kept: list[Any] = []  # every function whose compiled code is to be kept, as numba's dispatcher


def njit(**options: Any) -> Callable[[Function], Function]:  # noqa: ANN401 - numba's own options
    """Return numba's decorator njit with these options; with ``cache`` the compiled code is kept where it can be."""

    def compiled(function: Function) -> Function:
        kernel: Function | None = None
        if options.get("cache"):
            # without a home numba would make a folder called ~ where the command runs
            kernel = _cached(function, options) if os.path.isabs(os.path.expanduser("~")) else None
            kernel = kernel or _cached_in(temporary_folder(), function, options)
        if kernel is not None:
            _kept.append(kernel)
            return kernel
        not_kept: Function = numba_njit(**{**options, "cache": False})(function)
        return not_kept

    return compiled


def _cached(function: Function, options: dict[str, Any]) -> Function | None:
    """Return the compiled function, None where numba finds no place to keep its code in."""
    try:
        kernel: Function = numba_njit(**options)(function)
    except RuntimeError:
        return None
    return kernel


def _cached_in(folder: Path | None, function: Function, options: dict[str, Any]) -> Function | None:
    """Return the compiled function, its code kept in a folder; None where that cannot be."""
    if folder is None:
        return None
    usual = config.CACHE_DIR
    config.CACHE_DIR = str(folder)  # read by the decorator, and by nothing later
    try:
        return _cached(function, options)
    finally:
        config.CACHE_DIR = usual


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
    # numba has no other way to ask for what it keeps without loading all of it
    kept = kernel._cache._cache_file._load_index()
    return bool(kept)


@dataclass
class CompileTime:
    """The seconds that were spent compiling functions."""

    seconds: float = 0.0


@contextmanager
def compile_time() -> Iterator[CompileTime]:
    """Measure how long functions are compiled during the block; what is kept from an earlier run takes no time."""
    found = CompileTime()

    def note(seconds: float) -> None:
        found.seconds = seconds

    with event.install_timer("numba:compile", note):
        yield found


@cache
def temporary_folder() -> Path | None:
    """Return the user's own folder for compiled code in the temporary directory, made if need be; None where there is
    none that is safe: a real folder of this user that no one else may write or read."""
    try:
        folder = Path(tempfile.gettempdir()) / f"photogram-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
    return folder if own else None
