"""Another process that compiles kernels: when it is started, what it leaves, and that it ends."""

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from photogram.pipeline import precompilation as early_kernels
from photogram.pipeline.costs.forecast import compiled_share
from photogram.pipeline.pipeline import STAGES

ASLEEP = (sys.executable, "-c", "import time; time.sleep(600)")


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[subprocess.Popen[bytes]]:
    """Two cores, nothing compiled; the processes that are started, which only sleep."""
    processes: list[subprocess.Popen[bytes]] = []
    popen = subprocess.Popen

    def watched(*arguments: Any, **options: Any) -> subprocess.Popen[bytes]:
        processes.append(popen(*arguments, **options))
        return processes[-1]

    monkeypatch.setattr(early_kernels, "COMMAND", ASLEEP)
    monkeypatch.setattr(early_kernels, "cores", lambda: 2)
    monkeypatch.setattr(early_kernels, "compiled_share", lambda _: {"adjustment": 0.0})
    monkeypatch.setattr(subprocess, "Popen", watched)
    return processes


def test_the_process_ends_with_the_work(started: list[subprocess.Popen[bytes]]) -> None:
    """It is ended and not waited for, whether the work ends well or not."""
    with early_kernels.compiling_early():
        assert started[0].poll() is None
    with pytest.raises(KeyboardInterrupt), early_kernels.compiling_early():
        raise KeyboardInterrupt
    assert [process.returncode for process in started] == [-signal.SIGTERM, -signal.SIGTERM]


def test_a_process_that_has_ended_is_no_fault(
    started: list[subprocess.Popen[bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever it ended with: the kernels are compiled where they are needed."""
    monkeypatch.setattr(early_kernels, "COMMAND", (sys.executable, "-c", "raise SystemExit(3)"))
    with early_kernels.compiling_early():
        started[0].wait()
    assert started[0].returncode == 3


@pytest.mark.usefixtures("started")
def test_a_process_that_cannot_be_started_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the machine refuses it the work goes on without."""
    monkeypatch.setattr(early_kernels, "COMMAND", ("/nowhere/python",))
    done = []
    with early_kernels.compiling_early():
        done.append("work")
    assert done == ["work"]


def test_nothing_is_imported_from_the_folder_of_the_survey(tmp_path: Path) -> None:
    """A numpy.py beside the photographs is not executed."""
    (tmp_path / "beside.py").write_text("")
    python = early_kernels.COMMAND[: early_kernels.COMMAND.index("-m")]
    found = subprocess.run([*python, "-c", "import beside"], cwd=tmp_path, capture_output=True, check=False)
    assert b"No module named 'beside'" in found.stderr


def test_one_core_or_kept_kernels_need_none(
    started: list[subprocess.Popen[bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would only be in the way."""
    monkeypatch.setattr(early_kernels, "cores", lambda: 1)
    with early_kernels.compiling_early():
        pass
    monkeypatch.setattr(early_kernels, "cores", lambda: 2)
    monkeypatch.setattr(early_kernels, "compiled_share", lambda _: {"adjustment": 1.0})
    with early_kernels.compiling_early():
        pass
    assert started == []


def test_it_compiles_what_orientation_adjustment_and_orthophoto_need() -> None:
    """Most kernels of these stages; the others are those of surveys with more than positions, control and ties, and of
    orthophotos with masks or several bands."""
    early_kernels.compile_all()
    share = compiled_share(STAGES)
    assert share["adjustment"] > early_kernels.KEPT
    assert share["orientation"] > early_kernels.KEPT
    assert share["orthophoto"] > early_kernels.KEPT
