"""Makes a Python of this system lack what Windows lacks, and GTSAM: with this folder on PYTHONPATH it is run before all
else. Locks are those of a stand-in for ``msvcrt``."""

import ctypes
import errno
import os
import signal
import sys
import types

import psutil  # noqa: F401 - it asks each system for what that has

GONE = ("fcntl", "resource", "pwd", "grp", "termios", "gtsam")
GONE_OF_OS = (
    *("getuid", "geteuid", "getgid", "O_NOFOLLOW", "O_CLOEXEC", "sysconf", "fork", "forkpty", "killpg", "getpgid"),
    *("setsid", "mkfifo", "sched_getaffinity"),
)
GONE_OF_SIGNALS = ("SIGKILL", "SIGHUP", "SIGSTOP", "SIGCONT", "SIGUSR1")

for name in GONE:
    sys.modules[name] = None  # type: ignore[assignment]
for owner, names in ((os, GONE_OF_OS), (signal, GONE_OF_SIGNALS)):
    for name in names:
        if hasattr(owner, name):
            delattr(owner, name)

flock = ctypes.CDLL(None, use_errno=True).flock


def locking(descriptor: int, mode: int, _count: int) -> None:
    """Lock a file without waiting, as Windows does."""
    assert mode == 2
    if flock(descriptor, 2 | 4):  # LOCK_EX | LOCK_NB
        raise PermissionError(errno.EACCES, "Permission denied")


msvcrt = types.ModuleType("msvcrt")
msvcrt.__dict__.update(LK_NBLCK=2, locking=locking)
sys.modules["msvcrt"] = msvcrt
