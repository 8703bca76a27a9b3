"""Processes of this machine: they are replaced where they are lost, and never outlive their use."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest

from photogram.errors import SettingError
from photogram.pipeline.store.pools import ProcessPool

OUTLIVED = """
import os, sys, time
from photogram.pipeline.store.pools import ProcessPool
if __name__ == "__main__":
    pool = ProcessPool(1)
    print(pool.submit(os.getpid).result(), flush=True)
    pool.submit(time.sleep, 60)
    time.sleep(60)
"""


def is_running(process: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{process}/status").read_text()
    except FileNotFoundError:
        return False


def ends(process: int) -> bool:
    """Return whether a process ends within five seconds."""
    for _ in range(100):
        if not is_running(process):
            return True
        time.sleep(0.05)
    return False


def test_a_process_that_is_lost_is_replaced() -> None:
    with ProcessPool(2) as pool:
        first = pool.submit(os.getpid).result()
        assert first != os.getpid()
        killed = [pool.submit(time.sleep, 5), pool.submit(os.kill, first, signal.SIGKILL)]
        with pytest.raises(BrokenProcessPool) as lost:
            sum(future.result() or 0 for future in killed)
        assert pool.was_lost(lost.value)
        assert not pool.was_lost(ValueError("of the piece"))
        assert pool.submit(os.getpid).result() != first


def test_an_interruption_does_not_wait_for_pieces() -> None:
    began, processes, futures = time.monotonic(), set[int](), list[Future[None]]()

    def work() -> None:
        with ProcessPool(2) as pool:
            processes.add(pool.submit(os.getpid).result())
            futures.extend(pool.submit(time.sleep, 60) for _ in range(8))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert time.monotonic() - began < 50
    assert all(future.done() for future in futures)
    assert all(ends(process) for process in processes)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="this system does not tell of processes in /proc")
def test_processes_end_with_their_parent(tmp_path: Path) -> None:
    script = tmp_path / "outlived.py"
    script.write_text(OUTLIVED)
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        process = int(parent.stdout.readline())
        assert is_running(process)
        parent.kill()
    assert ends(process)


def test_the_number_of_processes_has_limits() -> None:
    with pytest.raises(SettingError, match="workers: must be from 1 to 1024, found 0"):
        ProcessPool(0)
