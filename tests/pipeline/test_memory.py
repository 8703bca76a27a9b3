"""Peak memory of a block of work."""

import platform
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest

from photogram.pipeline.store import memory
from photogram.pipeline.store.memory import peak_memory

MIB = 2**20


SCRIPT = """
import numpy as np
from photogram.pipeline.store.memory import peak_memory
for mib in (1, 300, 1):
    with peak_memory() as peak:
        np.ones(mib * 2**20 // 8).sum()
    print(peak.bytes)
"""


def test_peak_grows_with_what_is_held_and_is_that_of_its_own_block() -> None:
    """In a process of its own: a large one may lose pages to the system meanwhile."""
    output = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True).stdout
    small, large, after = (None if text == "None" else int(text) for text in output.split())
    if small is None or large is None:
        pytest.skip("this system tells peaks of the process alone")
    assert 280 * MIB < large - small < 400 * MIB
    if after is None:
        pytest.skip("this system cannot bring the high-water mark down")
    assert after < large - 250 * MIB


def test_peak_holds_what_is_let_go_again() -> None:
    def fail() -> None:
        block = np.ones(400 * MIB // 8)
        raise RuntimeError(len(block))

    with peak_memory() as peak, pytest.raises(RuntimeError):
        fail()
    assert peak.bytes is None or peak.bytes > 400 * MIB


def test_a_system_without_these_calls_tells_its_peak_or_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "resource", None)
    monkeypatch.setattr(memory, "reset_highest_memory", lambda: False)
    told = iter([100, 700, 700, 700])
    monkeypatch.setattr(psutil.Process, "memory_info", lambda _: SimpleNamespace(peak_wset=next(told)))
    with peak_memory() as grown:
        pass
    with peak_memory() as below:
        pass
    assert (grown.bytes, below.bytes) == (700, None)
    monkeypatch.setattr(psutil.Process, "memory_info", lambda _: SimpleNamespace())
    with peak_memory() as untold:
        pass
    assert untold.bytes is None


IN_PIECES = """
from pathlib import Path
from photogram.pipeline.store.memory import give_back_free_memory
def held():
    return int(next(s for s in Path("/proc/self/status").read_text().splitlines() if s.startswith("VmRSS")).split()[1])
pieces = [b"x" * (60_000 + n) for n in range(4_000)]
last = bytearray(60_000)
before = held()
del pieces
give_back_free_memory()
print((before - held()) // 1024)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the allocator is not that of glibc")
def test_what_lies_free_below_something_held_is_given_back() -> None:
    output = subprocess.run([sys.executable, "-c", IN_PIECES], capture_output=True, text=True, check=True).stdout
    assert int(output) > 180


LIMITED = """
import resource, sys
from pathlib import Path
import psutil
from photogram.cli.main import main
from photogram.cli.work import adjust
info = psutil.Process().memory_info()
most = {"DATA": info.data, "AS": info.vms}[sys.argv[2]] + int(sys.argv[3]) * 2**20
resource.setrlimit(getattr(resource, f"RLIMIT_{sys.argv[2]}"), (most, most))
sys.argv = ["photogram", "adjust", sys.argv[1], "--no-check", "--until", "features"]
main()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts the data of a process")
@pytest.mark.parametrize("limit", ["DATA", "AS"])
def test_a_run_that_may_take_too_little_is_refused_before_it_begins(survey: Path, limit: str) -> None:
    command = [sys.executable, "-c", LIMITED, str(survey / "project.yaml"), limit, "60"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.count("photogram: ") == 1
    assert re.search(r"photogram: memory: this process may take \d+ MB more, a stage takes \d+ MB", done.stderr)
    assert "raise the limit (ulimit -v unlimited, ulimit -d unlimited)" in done.stderr
    assert not (survey / "work").exists()


def test_without_limits_there_is_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "limited_room_bytes", lambda: None)
    memory.check_room()
    monkeypatch.setattr(memory, "limited_room_bytes", lambda: 10 * 2**30)
    memory.check_room()
