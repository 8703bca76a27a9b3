"""What this process may use of the machine: its processors and its memory, within what a container allows."""

import os
from contextlib import suppress
from importlib import import_module
from math import ceil
from pathlib import Path

import psutil

_CGROUP = Path("/sys/fs/cgroup")
_MEMBERSHIP = Path("/proc/self/cgroup")


def cores() -> int:
    """Return how many threads this process can run at once, 1 at least.

    Counts the processors that its affinity allows, where the system tells them (Linux), and of a control group (cgroup
    v1 and v2) the share of processor time.
    """
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(min([allowed, *(ceil(share) for share in _processor_shares())]), 1)


def memory_bytes() -> int:
    """Return the memory that this process may take: the machine's, or less where a control group limits it."""
    return min([int(psutil.virtual_memory().total), *_memory_limits()])


def within_half_of_memory(bytes_each: float) -> int:
    """Return how many pieces of work of so many bytes half of the memory holds at once, 1 at least."""
    return max(1, int(0.5 * memory_bytes() // bytes_each))


def free_memory_bytes() -> int:
    """Return the memory that this process may take and that nothing else holds now."""
    room = limited_room_bytes()
    limits = [*_memory_limits(), *([] if room is None else [room])]
    return min([int(psutil.virtual_memory().available), *limits])


def limited_room_bytes() -> int | None:
    """Return how much more memory the limits of this process let it take (``ulimit -v``, ``ulimit -d``), None where
    there are none."""
    try:
        resource = import_module("resource")
    except ImportError:  # Windows has none
        return None
    taken = psutil.Process().memory_info()
    rooms = []
    for limit, used in ((resource.RLIMIT_AS, taken.vms), (resource.RLIMIT_DATA, getattr(taken, "data", None))):
        most = resource.getrlimit(limit)[0]
        if most != resource.RLIM_INFINITY and used is not None:
            rooms.append(max(int(most - used), 0))
    return min(rooms, default=None)


def _groups(controller: str) -> list[Path]:
    """Return the folders of the control groups that this process is in, and of those around them, outermost first.

    Within a container the group of the process is often mounted as the root itself, whatever the system calls it.
    """
    folders: list[Path] = []
    with suppress(OSError):
        for line in _MEMBERSHIP.read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            if controllers and controller not in controllers.split(","):
                continue
            folder = _CGROUP / controller if controllers else _CGROUP
            folders.append(folder)
            for part in Path(path).parts[1:]:
                folder = folder / part
                folders.append(folder)
    return folders


def _words(file: Path) -> list[str]:
    """Return what a file of a control group says, nothing where there is no such file."""
    with suppress(OSError):
        return file.read_text().split()
    return []


def _processor_shares() -> list[float]:
    """Return the limits on processors, in processors; a limit of ``max`` or -1 is none."""
    shares = []
    for folder in _groups("cpu"):
        quota, period = [*_words(folder / "cpu.max"), "", ""][:2]
        if not period:  # version 1
            quota, period = ("".join(_words(folder / f"cpu.cfs_{name}_us")) for name in ("quota", "period"))
        if quota.isdecimal() and period.isdecimal() and int(period):
            shares.append(int(quota) / int(period))
    return shares


def _memory_limits() -> list[int]:
    """Return the limits on memory, in bytes."""
    limits = []
    for folder in _groups("memory"):
        limit = "".join(_words(folder / "memory.max") or _words(folder / "memory.limit_in_bytes"))
        if limit.isdecimal():
            limits.append(int(limit))
    return limits
