"""How much memory a stage of work takes at its highest, and what it leaves unused given back."""

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import psutil

from photogram.errors import WorkspaceError
from photogram.machine import cores, limited_room_bytes

_RESET, _STATUS = Path("/proc/self/clear_refs"), Path("/proc/self/status")
LEAST_BYTES, OF_A_CORE_BYTES = 160 * 2**20, 20 * 2**20
"""What a stage takes however small the survey is, and its threads by the core."""

_UNIT = 1 if sys.platform == "darwin" else 1024  # of ru_maxrss: bytes on macOS, KiB elsewhere


@dataclass
class Peak:
    """The most memory that the process held during a measurement, in bytes; None where it cannot be told."""

    bytes: int | None = None


def _lifetime_peak() -> int | None:
    try:
        resource = import_module("resource")
    except ImportError:  # Windows tells it elsewhere
        peak: int | None = getattr(psutil.Process().memory_info(), "peak_wset", None)
        return peak
    return int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * _UNIT


def highest_memory() -> int | None:
    """Return the most memory that the process held since the last reset, in bytes, None where the system has no such
    mark."""
    with suppress(OSError, ValueError, IndexError):
        line = next((s for s in _STATUS.read_text().splitlines() if s.startswith("VmHWM:")), "")
        return int(line.split()[1]) * 1024
    return None


def reset_highest_memory() -> bool:
    """Bring the high-water mark down to the present; False where the system cannot."""
    try:
        _RESET.write_text("5")
    except OSError:
        return False
    return True


def check_room() -> None:
    """Raise WorkspaceError where the limits of this process leave less than any stage takes: what starts threads and
    loads compiled functions then ends the process, or waits for ever."""
    room, least = limited_room_bytes(), LEAST_BYTES + cores() * OF_A_CORE_BYTES
    if room is not None and room < least:
        raise WorkspaceError(
            f"memory: this process may take {room // 2**20} MB more, a stage takes {least // 2**20} MB for its threads "
            "and compiled functions alone: raise the limit (ulimit -v unlimited, ulimit -d unlimited)"
        )


def give_back_free_memory() -> None:
    """Give memory that nothing holds any more back to the system, where the allocator keeps it (glibc)."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


@contextmanager
def peak_memory() -> Iterator[Peak]:
    """Measure the most memory that this process holds during the block, all its threads together.

    On Linux the system's high-water mark is reset before. Elsewhere only a peak above all earlier ones can be told.
    """
    peak, before = Peak(), _lifetime_peak()
    is_reset = reset_highest_memory()
    try:
        yield peak
    finally:
        after = _lifetime_peak()
        if is_reset:
            peak.bytes = highest_memory()
        elif after is not None and before is not None and after > before:
            peak.bytes = after
