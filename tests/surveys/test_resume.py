"""A run that is killed, at whatever moment, goes on where it was, and its results are those of an uninterrupted run."""

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from photogram.pipeline.pipeline import STAGES, fingerprints, load_project, open_run, run_pipeline
from photogram.pipeline.stage import Stage, Watcher
from photogram.pipeline.stages.orientation import stored_orientation
from photogram.pipeline.stages.stored_adjustment import stored_adjustment, stored_resections
from photogram.pipeline.store.stage_summary import Summary
from photogram.pipeline.store.workspace import Workspace
from photogram.report.identity import VOLATILE
from photogram.survey import Block

Run = Callable[..., Any]
Edit = Callable[[Path, Callable[[dict[str, Any]], object]], None]
NAMES = [stage.name for stage in STAGES]
PRODUCTS = {
    ".json",
    ".xml",
    ".csvt",
    ".prj",
    ".gpkg",
    ".txt",
    ".laz",
    ".tif",
    ".npz",
    ".mat",
    ".png",
    ".csv",
    ".geojson",
}

FORKING = """
import os, signal, sys
from pathlib import Path
from threading import Lock
sys.path.insert(0, sys.argv[1])
from makers import undrawing
from photogram.cli.main import main
from photogram.cli.work import adjust  # all that a run needs, so that the forks need not
from photogram.pipeline.input_validation import check_project

def kill_at(folder, place, number):
    # every change of the workspace or of the results ends in a renaming: kill in place of the one that is asked for
    rename, seen, one_at_a_time = os.replace, 0, Lock()
    def counted(source, target):
        nonlocal seen
        with one_at_a_time:  # so that all that were counted before are in their places
            within = Path(target).parent == folder / place
            seen += within
            if (number == "rename" and source == folder / place) or (within and str(seen) == number):
                os.kill(os.getpid(), signal.SIGKILL)
            rename(source, target)
    os.replace = counted

for order in sys.stdin:
    project, moment = order.rstrip("\\n").split("\\t")
    check_project(project)  # which reads the kernels that every run begins with
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if moment:
            kill_at(Path(project).parent, *moment.split(":"))
        sys.argv = ["photogram", "adjust", project]
        with undrawing():
            main()
    print(child, flush=True)
    print(os.waitpid(child, 0)[1], flush=True)
"""


class Runs:
    """Runs of `photogram adjust`, each a fork of one process and killed; their pictures are empty, so that none of
    them may be taken for one of the results."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        self._orders, self._answers = process.stdin, process.stdout

    def start(self, survey: Path, moment: str = "") -> int:
        """Start a run and return the number of its process."""
        self._orders.write(f"{survey / 'project.yaml'}\t{moment}\n")
        self._orders.flush()
        return int(self._answers.readline())

    def end(self) -> int:
        """Return how the run ended that was started last."""
        return int(self._answers.readline())

    def kill_at(self, survey: Path, *moments: str) -> None:
        """Run once for each moment, killed at it: the n-th file that a folder gets, or its renaming."""
        for moment in moments:
            self.start(survey, moment)
            assert self.end() == signal.SIGKILL, moment


@pytest.fixture(scope="module")
def runs() -> Iterator[Runs]:
    command = [sys.executable, "-c", FORKING, str(Path(__file__).parents[1])]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield Runs(process)
    assert process.returncode == 0


def without_seconds(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: without_seconds(v) for k, v in value.items() if k not in VOLATILE - {"report_id"}}
    return [without_seconds(v) for v in value] if isinstance(value, list) else value


def contents(results: Path) -> dict[str, Any]:
    """Return everything in a folder of results: the bytes of products, the report without times and memory."""
    found: dict[str, Any] = {}
    for path in sorted(p for p in results.rglob("*") if p.is_file()):
        name = path.relative_to(results).as_posix()
        if path.name == "report.json":
            found[name] = without_seconds(json.loads(path.read_text()))
        elif path.name == "report.html":
            page = path.read_text(encoding="utf-8").partition('<section id="computation">')[0]
            found[name] = re.sub(r"processed \d{4}-\d{2}-\d{2}", "", page)
        elif path.name == "checksums.sha256":
            found[name] = [line for line in path.read_text().splitlines() if "  report." not in line]
        else:
            assert path.suffix in PRODUCTS, name
            found[name] = path.read_bytes()
    return found


def check_same_results(survey: Path, uninterrupted: Path) -> None:
    found, expected = contents(survey / "results"), contents(uninterrupted / "results")
    assert found.keys() == expected.keys()
    assert [name for name in expected if found[name] != expected[name]] == []
    leftovers = [p for p in survey.rglob("*") if ".partial" in p.name or ".removed" in p.name]
    assert leftovers == []


def times(folder: Path) -> dict[str, int]:
    return {p.name: p.stat().st_mtime_ns for p in folder.glob("0*.npz")}


@dataclass
class Witness(Watcher):
    """A watcher that notes which stages ran, and which were done before."""

    ran: list[str] = field(default_factory=list)
    done: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def end(self, stage: Stage, seconds: float | None, summary: Summary) -> None:  # noqa: ARG002
        (self.done if seconds is None else self.ran).append(stage.name)

    def warn(self, text: str) -> None:
        self.warnings.append(text)


def stages_run(survey: Path, **options: Any) -> list[str]:
    """Run the survey and return the stages that did something."""
    witness = Witness()
    run_pipeline(load_project(survey / "project.yaml"), watcher=witness, **options)
    assert len(set(witness.ran + witness.done)) == len(witness.ran + witness.done)
    return witness.ran


def test_killed_in_every_stage(survey: Path, finished_survey: Path, photogram: Run, runs: Runs) -> None:
    """One chain of runs: each goes on from the last one's kill and is killed in turn, to the end."""
    work = survey / "work"
    runs.kill_at(survey, *(f"work/photographs.stage.partial:{moment}" for moment in ("1", "2", "rename")))
    runs.kill_at(survey, "work/features.stage.partial:4")
    features = times(work / "features.stage.partial")
    assert len(features) == 2
    others = ("work/features.stage.partial:2", "work/pairs.stage.partial:2", "work/matches.stage.partial:4")
    runs.kill_at(survey, *others)
    assert features.items() <= times(work / "features.stage").items()
    matches = times(work / "matches.stage.partial")
    assert len(matches) == 2
    runs.kill_at(survey, *(f"work/{name}.stage.partial:2" for name in NAMES[NAMES.index("tie_points") : -1]))
    runs.kill_at(survey, "results/technical:3", "results/technical/pictures:4", "work/results.stage.partial:rename")
    assert photogram("adjust", survey / "project.yaml").code == 0
    check_same_results(survey, finished_survey)
    assert matches.items() <= times(work / "matches.stage").items()


def finished_files(work: Path) -> int:
    """Number of whole files in a workspace that another process is writing to."""
    return sum(not name.startswith(".") for _, _, names in os.walk(work) for name in names)


def test_killed_from_outside_at_random_moments(survey: Path, finished_survey: Path, photogram: Run, runs: Runs) -> None:
    """Kills that come when the run has written a share of its files, and some milliseconds later.

    Counted in files, not in seconds, so that the speed of the machine does not matter. The last share leaves the
    pictures and the report to be made, so none of the runs comes to its end.
    """
    whole = finished_files(finished_survey / "work")
    rng = random.Random(20)
    kept = 0
    for share in (0.1, 0.3, 0.5, 0.8):
        process = runs.start(survey)
        while finished_files(survey / "work") < share * whole:
            os.kill(process, 0)  # fails where it came to its end
            time.sleep(0.01)
        time.sleep(0.02 * rng.random())
        os.kill(process, signal.SIGKILL)
        assert runs.end() == signal.SIGKILL
        complete = sum((survey / "work" / f"{name}.stage" / "stage.json").is_file() for name in NAMES)
        assert complete >= kept
        kept = complete
    assert photogram("adjust", survey / "project.yaml").code == 0
    check_same_results(survey, finished_survey)


def test_killed_between_the_removal_of_the_old_and_the_renaming_of_the_new(
    adjusted_survey: Path, edit: Edit, photogram: Run, runs: Runs
) -> None:
    """The old surface is gone, the new one is not yet in place: the next run makes it, with the new setting."""
    edit(adjusted_survey / "project.yaml", lambda v: v.update(surface={"cell_m": 0.5}))
    runs.kill_at(adjusted_survey, "work/surface.stage.partial:rename")
    assert not (adjusted_survey / "work/surface.stage").exists()
    assert stages_run(adjusted_survey, until="surface") == ["surface"]
    assert json.loads((adjusted_survey / "work/surface.stage/stage.json").read_text())["cell_m"] == 0.5
    assert photogram("adjust", adjusted_survey / "project.yaml", "--until", "surface").out.count("up to date") == 11


@pytest.mark.usefixtures("undrawn")
def test_what_is_done_is_not_done_again(adjusted_survey: Path, edit: Edit, photogram: Run) -> None:
    project, results = adjusted_survey / "project.yaml", adjusted_survey / "results"
    assert stages_run(adjusted_survey) in ([], ["results"])  # its results were made in another place
    report = (results / "quality/report.json").read_bytes()

    second = photogram("adjust", project)
    assert second.code == 0
    assert second.out.count("up to date") == len(STAGES)
    assert (results / "quality/report.json").read_bytes() == report

    (results / "technical/points_adjusted.laz").unlink()
    assert stages_run(adjusted_survey) == ["results"]
    assert (results / "technical/points_adjusted.laz").is_file()

    edit(project, lambda v: v["surface"].update(maximum_gap_m=0.5))
    assert stages_run(adjusted_survey, until="surface") == ["surface"]
    edit(project, lambda v: v["surface"].pop("maximum_gap_m"))
    assert stages_run(adjusted_survey, until="comparison") == ["surface"]

    again = ["tie_points", "orientation", "transfer", "intersection"]
    assert stages_run(adjusted_survey, start="tie_points", until="intersection") == again
    assert stages_run(adjusted_survey, until="photographs") == []
    # what was made again is what it was before, so nothing that depends on it has to be repeated
    assert stages_run(adjusted_survey) == []
    assert photogram("adjust", project, "--from", "orientation", "--until", "orientation").out.count("up to date") == 5


def test_each_setting_repeats_what_depends_on_it_and_no_more(adjusted_survey: Path, edit: Edit) -> None:
    project = adjusted_survey / "project.yaml"
    original = project.read_text()

    def marks() -> dict[str, str]:
        with open_run(load_project(project)) as run:
            return {stage.name: mark for stage, mark in fingerprints(run)}

    def depending(change: Callable[[dict[str, Any]], object]) -> list[str]:
        project.write_text(original)
        before = marks()
        edit(project, change)
        after = marks()
        return [name for name in NAMES if after[name] != before[name]]

    assert depending(lambda v: v["features"].update(maximum=700)) == NAMES[NAMES.index("features") :]
    assert depending(lambda v: v["matching"].update(ratio=0.7)) == NAMES[NAMES.index("pairs") :]
    products = ["surface", "volumes", "relief", "orthophoto"]
    surfaces = ["adjustment", "dense", *products, "comparison", "results"]
    assert depending(lambda v: v.update(adjustment={"robust_loss": "cauchy"})) == surfaces
    assert depending(lambda v: v["gnss"].update(offset_sigma_m=[1.0, 1.0, 1.0])) == surfaces
    assert depending(lambda v: v.pop("comparison")) == ["comparison", "results"]
    assert depending(lambda v: v.update(surface={"cell_m": 0.5})) == ["dense", *products, "results"]
    assert depending(lambda v: v["surface"].update(maximum_gap_m=0.5)) == [*products, "results"]
    assert depending(lambda v: v["orthophoto"].update(balance=False)) == ["orthophoto", "results"]
    marked = NAMES[NAMES.index("orientation") :]
    assert depending(lambda v: v["control_points"].update(mark_sigma_px=0.5)) == marked

    def move_a_point(v: dict[str, Any]) -> None:
        v["control_points"]["list"][0]["position_m"][0] += 0.01

    assert v_role(original) == "control"
    assert depending(move_a_point) == marked  # whose photographs are oriented from control points
    declared = {"output": "ellipsoidal", "gnss": "ellipsoidal", "control_points": "ellipsoidal"}
    assert depending(lambda v: v.pop("heights")) == depending(lambda v: v.update(heights=declared | {"geoid": "EGM96"}))
    assert depending(lambda v: v.pop("heights")) == ["photographs", "pairs", *marked]


def raise_a_point(values: dict[str, Any]) -> None:
    """Correct the height of a control point by 1 m."""
    values["control_points"]["list"][0]["position_m"][2] += 1.0


def make_a_check_point(values: dict[str, Any]) -> None:
    """Turn a control point into a check point."""
    values["control_points"]["list"][1]["role"] = "check"


def move_a_mark(values: dict[str, Any]) -> None:
    """Move one mark of a control point by 2 px."""
    marks = values["control_points"]["list"][2]["marks"]
    marks[next(iter(marks))][0] += 2.0


def test_a_corrected_control_point_repeats_the_adjustment_alone(adjusted_survey: Path, edit: Edit) -> None:
    """Where the photographs were oriented from their tie points; the result is that of a run from the beginning."""
    project = adjusted_survey / "project.yaml"
    edit(project, lambda v: v.update(orientation={"method": "attitude"}))
    assert stages_run(adjusted_survey, until="adjustment") == ["orientation", "transfer", "intersection", "adjustment"]
    for correct in (raise_a_point, make_a_check_point, move_a_mark):
        edit(project, correct)
        assert stages_run(adjusted_survey, until="adjustment") == ["adjustment"], correct.__doc__
        assert stages_run(adjusted_survey, until="adjustment") == []
    with open_run(load_project(project)) as run:
        corrected, resections = stored_adjustment(run), stored_resections(run)
    assert stages_run(adjusted_survey, start="photographs", until="adjustment") == NAMES[: NAMES.index("dense")]
    assert stages_run(adjusted_survey, until="adjustment") == []
    with open_run(load_project(project)) as run:
        anew, orientation = stored_adjustment(run), stored_orientation(run)
    assert orientation.method == "attitude"
    # tie points were transferred before the correction, so that the last hundredths of a pixel are others
    sigma_m = np.sqrt(np.linalg.eigvalsh(anew.covariances.position_m2)[:, 0])
    moved_m = np.linalg.norm(positions_map_m(corrected.block) - positions_map_m(anew.block), axis=1)
    np.testing.assert_array_less(moved_m, 0.25 * sigma_m)
    assert corrected.block.control_points.role == anew.block.control_points.role
    # resections are those from the control points as they are now
    assert any(orientation.resections)
    for found, expected in zip(resections, orientation.resections, strict=True):
        assert (found is None) == (expected is None)
        if found is not None and expected is not None:
            places = [r.refined.position_world_m[None] for r in (found, expected)]
            here, there = (
                b.frame.map_from_world(x) for b, x in zip((corrected.block, anew.block), places, strict=True)
            )
            np.testing.assert_allclose(here, there, rtol=0.0, atol=1e-6)


def positions_map_m(block: Block) -> np.ndarray[Any, Any]:
    """Return the positions of the photographs (N, 3), all of which have a pose, in the map."""
    world_m = [pose.position_world_m for pose in block.poses if pose is not None]
    assert len(world_m) == len(block.poses)
    return block.frame.map_from_world(np.array(world_m))


def v_role(project: str) -> str:
    """Return the role of the first ground point."""
    return str(yaml.safe_load(project)["control_points"]["list"][0]["role"])


def test_other_positions_repeat_the_matching_where_other_pairs_are_chosen(adjusted_survey: Path, edit: Edit) -> None:
    """Positions and control points reach the matching through the pairs alone."""
    project = adjusted_survey / "project.yaml"
    matched = times(adjusted_survey / "work/matches.stage")
    edit(project, lambda v: v.pop("heights"))
    assert stages_run(adjusted_survey, until="tie_points") == ["photographs", "pairs"]
    edit(project, lambda v: v["photographs"].update(gnss_sigma_m=[4.0, 4.0, 8.0]))
    assert stages_run(adjusted_survey, until="tie_points") == ["photographs", "pairs"]
    assert times(adjusted_survey / "work/matches.stage") == matched
    edit(project, lambda v: v.update(pairs={"maximum": 1, "neighbours": 1}))
    assert stages_run(adjusted_survey, until="tie_points") == ["pairs", "matches", "tie_points"]


def test_a_changed_photograph_is_noticed(adjusted_survey: Path) -> None:
    photographs = adjusted_survey / "photographs"
    shutil.copyfile(photographs / "sim_0002.JPG", photographs / "sim_0001.JPG")
    assert stages_run(adjusted_survey, until="features") == ["photographs", "features"]


def test_two_at_once(adjusted_survey: Path) -> None:
    command = [sys.executable, "-m", "photogram.cli.main", "adjust", str(adjusted_survey / "project.yaml")]
    with Workspace(adjusted_survey / "work").locked():
        second = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert second.returncode == 1
    assert second.stderr.startswith(
        f"photogram: {adjusted_survey / 'work'}: another photogram is running here; wait for it"
    )
    assert second.stderr.count("\n") == 1
