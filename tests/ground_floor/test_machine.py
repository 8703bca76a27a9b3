"""Processors and memory are those that this process may use, not those of the machine it runs on."""

import os
import re
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from photogram import machine
from photogram.machine import cores, memory_bytes

ROOT = Path(__file__).resolve().parents[2]
WHOLE = psutil.virtual_memory().total


@pytest.fixture
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine of 16 processors, all allowed, with a tree of control groups of our own."""
    monkeypatch.setattr(machine, "_CGROUP", tmp_path)
    monkeypatch.setattr(machine, "_MEMBERSHIP", tmp_path / "membership")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(16)), raising=False)
    return tmp_path


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_without_limits_it_is_the_whole_machine(groups: Path) -> None:
    assert (cores(), memory_bytes()) == (16, WHOLE)
    write(groups / "membership", "0::/\n")
    write(groups / "cpu.max", "max 100000\n")
    write(groups / "memory.max", "max\n")
    assert (cores(), memory_bytes()) == (16, WHOLE)


def test_affinity_counts(groups: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5}, raising=False)
    assert cores() == 2
    write(groups / "membership", "0::/\n")
    write(groups / "cpu.max", "400000 100000\n")
    assert cores() == 2


@pytest.mark.parametrize(("quota", "expected"), [("50000", 1), ("100000", 1), ("150000", 2), ("400000", 4)])
def test_a_share_of_processor_time_counts(groups: Path, quota: str, expected: int) -> None:
    write(groups / "membership", "0::/\n")
    write(groups / "cpu.max", f"{quota} 100000\n")
    assert cores() == expected


def test_the_tightest_group_around_the_process_holds(groups: Path) -> None:
    write(groups / "membership", "0::/batch/job7\n")
    write(groups / "batch/cpu.max", "300000 100000\n")
    write(groups / "batch/job7/cpu.max", "max 100000\n")
    write(groups / "batch/memory.max", "9000000\n")
    write(groups / "batch/job7/memory.max", "5000000\n")
    assert (cores(), memory_bytes()) == (3, 5_000_000)


def test_control_groups_of_version_1(groups: Path) -> None:
    write(groups / "membership", "11:memory:/docker/a\n7:cpu,cpuacct:/docker/a\n0::/\n")
    write(groups / "cpu/docker/a/cpu.cfs_quota_us", "200000\n")
    write(groups / "cpu/docker/a/cpu.cfs_period_us", "100000\n")
    write(groups / "memory/memory.limit_in_bytes", "9223372036854771712\n")
    write(groups / "memory/docker/a/memory.limit_in_bytes", "7000000\n")
    assert (cores(), memory_bytes()) == (2, 7_000_000)
    write(groups / "cpu/docker/a/cpu.cfs_quota_us", "-1\n")
    assert cores() == 16


def test_nothing_else_asks_the_machine() -> None:
    """os.cpu_count() is the machine's, wrong in a container."""
    asking = re.compile(r"cpu_count|sched_getaffinity|SC_PHYS_PAGES")
    trees = [p for tree in ("photogram", "factors", "cli") for p in (ROOT / tree).rglob("*.py")]
    assert [p for p in trees if asking.search(p.read_text(encoding="utf-8"))] == [ROOT / "photogram/machine.py"]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts the data of a process")
def test_limits_of_the_process_count() -> None:
    script = (
        "import resource, psutil\n"
        "from photogram.machine import free_memory_bytes, limited_room_bytes\n"
        "print(limited_room_bytes())\n"
        "most = psutil.Process().memory_info().data + 100 * 2**20\n"
        "resource.setrlimit(resource.RLIMIT_DATA, (most, most))\n"
        "print(limited_room_bytes() // 2**20, free_memory_bytes() // 2**20)\n"
    )
    said = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout.split()
    assert said[0] == "None"
    assert 90 <= int(said[1]) <= 100
    assert 90 <= int(said[2]) <= 100
