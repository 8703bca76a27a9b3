"""A run that is killed, at whatever moment, goes on where it was, and its results are those of an uninterrupted run."""

from __future__ import annotations

import json
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from photogram.pipeline import STAGES, load_project, run_pipeline
from photogram.stages import Stage
from photogram.workspace import Workspace

Run = Callable[..., Any]
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
NAMES = [stage.name for stage in STAGES]
PRODUCTS = {".txt", ".laz", ".tif", ".npz", ".mat", ".png"}

KILLED_AT = """
import json, os, signal, sys
from pathlib import Path
from photogram.cli import adjust, compare, demo, study
from photogram.cli.main import main

project, *moments = sys.argv[1:]
folder = Path(project).parent

def kill_at(place, number):
    # every change of the workspace or of the results ends in a renaming: kill in place of the one that is asked for
    rename, seen = os.replace, 0
    def counted(source, target):
        nonlocal seen
        within = Path(target).parent == folder / place
        seen += within
        if (number == "rename" and source == folder / place) or (within and str(seen) == number):
            os.kill(os.getpid(), signal.SIGKILL)
        rename(source, target)
    os.replace = counted

ends = []
for moment in moments:
    child = os.fork()
    if child == 0:
        kill_at(*moment.split(":"))
        sys.argv = ["photogram", "adjust", project]
        main()
        os._exit(0)
    ends.append(os.waitpid(child, 0)[1])
print(json.dumps(ends), file=sys.stderr)
"""


def killed_at(survey: Path, *moments: str) -> None:
    """Run `photogram adjust` once for each moment, killed at it: the n-th file that a folder gets, or its renaming."""
    command = [sys.executable, "-c", KILLED_AT, str(survey / "project.yaml"), *moments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stderr.splitlines()[-1]) == [signal.SIGKILL] * len(moments), dict(zip(moments, done.stderr))


def without_seconds(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: without_seconds(v) for k, v in value.items() if k != "seconds"}
    return [without_seconds(v) for v in value] if isinstance(value, list) else value


def contents(results: Path) -> dict[str, Any]:
    """Return everything in a folder of results: the bytes of products, the report without its times."""
    found: dict[str, Any] = {}
    for path in sorted(p for p in results.rglob("*") if p.is_file()):
        name = path.relative_to(results).as_posix()
        if name == "report.json":
            found[name] = without_seconds(json.loads(path.read_text()))
        else:
            assert path.suffix in PRODUCTS, name
            found[name] = path.read_bytes()
    return found


def check_same_results(survey: Path, uninterrupted: Path) -> None:
    found, expected = contents(survey / "results"), contents(uninterrupted / "results")
    assert found.keys() == expected.keys()
    assert [name for name in expected if found[name] != expected[name]] == []
    leftovers = [p for p in survey.rglob("*") if ".partial" in p.name]
    assert leftovers == []


def times(folder: Path) -> dict[str, int]:
    return {p.name: p.stat().st_mtime_ns for p in folder.glob("0*.npz")}


@dataclass
class Witness:
    """A watcher that notes which stages ran, and which were done before."""

    ran: list[str] = field(default_factory=list)
    done: list[str] = field(default_factory=list)

    def begin(self, stage: Stage) -> None:
        pass

    def advance(self, stage: Stage, done: int, total: int, text: str) -> None:
        pass

    def end(self, stage: Stage, seconds: float | None, summary: Mapping[str, Any]) -> None:  # noqa: ARG002
        (self.done if seconds is None else self.ran).append(stage.name)


def stages_run(survey: Path, **options: Any) -> list[str]:
    """Run the survey and return the stages that did something."""
    witness = Witness()
    run_pipeline(load_project(survey / "project.yaml"), watcher=witness, **options)
    assert [name for name in NAMES if name in witness.ran + witness.done] == sorted(
        witness.ran + witness.done, key=NAMES.index
    )
    return witness.ran


def test_killed_in_every_stage(survey: Path, finished_survey: Path, photogram: Run) -> None:
    """One chain of runs: each goes on from the last one's kill and is killed in turn, to the end."""
    work = survey / "work"
    killed_at(survey, "photographs.partial:1", "photographs.partial:2", "photographs.partial:rename")
    killed_at(survey, "orientation.partial:2", "orientation.partial:rename", "features.partial:4")
    features = times(work / "features.partial")
    assert sorted(features) == ["00000.npz", "00001.npz"]
    killed_at(survey, "features.partial:2", "features.partial:rename")
    assert not (work / "features").exists()
    killed_at(survey, "matches.partial:4")
    matches = times(work / "matches.partial")
    assert len(matches) == 2
    moments = [f"{name}.partial:2" for name in ("matches", *NAMES[4:-1])]
    killed_at(survey, *moments, "results:3", "results/pictures:4", "results.partial:rename")
    assert photogram("adjust", survey / "project.yaml").code == 0
    check_same_results(survey, finished_survey)
    assert matches.items() <= times(work / "matches").items()
