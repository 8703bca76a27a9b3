"""Every change of a file fails once: one sentence, nothing lost, nothing half, and the same command mends it.

    PYTHONPATH=tests python tests/chaos/faults.py FOLDER [--every 1] [--only adjust]

A survey of four photographs, all in one process. For each stage of `photogram adjust`, for a run of a finished survey
whose control points are weighted anew, and for `init`, `mark`, `deliver`, `epochs`, `compare`, `import` and `export`:
the command is run once undisturbed and its changes of files are counted (tests/failing_files.py). Then it is run once
for each of them from the same beginning, this one failing with no space, a broken disk or no permission in turn. It has
to end with one line `photogram: ...` and exit code 1, or as if nothing had been; every file has to be what it was or
what it becomes, whole; and the same command again, with no fault, has to end with the same bytes and nothing left over.

    faults     changes that failed, one run each
    refused    runs that said so and ended with 1
    unharmed   runs that did without what failed
    wrong      what does not hold, each in a line above
"""

import argparse
import hashlib
import io
import json
import re
import shutil
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import yaml
from failing_files import CODES, Changes, failing
from makers import undrawing

from photogram.cli.main import main as photogram
from photogram.pipeline.pipeline import STAGES
from photogram.report.identity import VOLATILE
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.survey_plan import SurveyPlan

PLAN = SurveyPlan(
    width_px=400, height_px=300, focal_px=600.0, flying_height_m=40.0, forward_overlap=0.75, side_overlap=0.7, strips=2,
    photographs_per_strip=2, relief_m=4.0, buildings=2, trees=6, target_radius_m=0.3, control_points=8, check_points=4,
)  # fmt: skip
TEMPORARY = re.compile(r"\.partial|\.removed|\.photogram-|^tmp|~$")
NOT_COMPARED = ("photogram.lock", "marks.lock", "node.lock")


@dataclass(frozen=True)
class Ended:
    """How a command ended, and what it said."""

    code: int
    said: str


def run(*arguments: object) -> Ended:
    """Run the command within this process."""
    out, error = io.StringIO(), io.StringIO()
    kept, sys.argv = sys.argv, ["photogram", *map(str, arguments)]
    code = 0
    try:
        with redirect_stdout(out), redirect_stderr(error):
            photogram()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    finally:
        sys.argv = kept
    return Ended(code, out.getvalue() + error.getvalue())


def _without_times(value: object) -> object:
    if isinstance(value, dict):
        return {k: _without_times(v) for k, v in value.items() if k not in VOLATILE and k != "compilation_seconds"}
    return [_without_times(v) for v in value] if isinstance(value, list) else value


def content_of(path: Path) -> str:
    """Return a checksum of what a file holds but for times and memory, or what is wrong with it."""
    data = path.read_bytes()
    if path.suffix == ".json":
        try:
            value = _without_times(json.loads(data))
        except ValueError:
            return f"no JSON, {len(data)} bytes"
        if path.name == "stage.json" and isinstance(value, dict):
            value = {k: v for k, v in value.items() if k not in ("seconds", "peak_memory_bytes", "files", "sha256")}
        data = json.dumps(value, sort_keys=True).encode()
    elif path.name == "report.html":
        page = data.decode(errors="replace")
        if "</html>" not in page:
            return f"half a page, {len(data)} bytes"
        page = re.sub(r"processed \d{4}-\d{2}-\d{2}", "", page.partition('<section id="computation">')[0])
        data = page.encode()
    elif path.name == "checksums.sha256":
        lines = data.decode(errors="replace").splitlines()
        if not all(re.fullmatch(r"[0-9a-f]{64}  .+", line) for line in lines):
            return f"a line of {len(lines)} is none of a record"
        data = "\n".join(line.partition("  ")[2] for line in lines).encode()
    return hashlib.sha256(data).hexdigest()


def contents(folder: Path) -> dict[str, str]:
    """Return what all files of a folder hold, by name."""
    files = (p for p in sorted(folder.rglob("*")) if p.is_file() and p.name not in NOT_COMPARED)
    return {p.relative_to(folder).as_posix(): content_of(p) for p in files}


def is_temporary(name: str) -> bool:
    """Return whether a file is one on its way, or lies in a folder of such."""
    return any(TEMPORARY.search(part) for part in name.split("/"))


@dataclass(frozen=True)
class Trial:
    """A command whose changes are failed one after the other: ``act`` runs it in a folder that is a copy of ``base``.

    ``volatile`` are files whose bytes differ from run to run.
    """

    name: str
    base: Path
    act: Callable[[Path], Ended]
    volatile: frozenset[str] = frozenset()


def clear(folder: Path) -> None:
    """Remove a folder."""
    shutil.rmtree(folder, ignore_errors=True)


def judged(trial: Trial, folder: Path, before: Mapping[str, str], after: Mapping[str, str], changes: Changes,
           ended: Ended) -> list[str]:  # fmt: skip
    """Return what does not hold after a command in which something failed."""
    wrong = []
    lines = [line for line in ended.said.splitlines() if line.startswith("photogram: ")]
    if ended.code not in (0, 1) or "Traceback" in ended.said or "defect of photogram" in ended.said:
        wrong.append(f"exit {ended.code}: {ended.said.strip()[-400:]}")
    elif ended.code == 1 and len(lines) != 1:
        wrong.append(f"{len(lines)} lines say why: {ended.said.strip()[-300:]}")
    there = contents(folder)
    for name, content in there.items():
        if is_temporary(name) or (name.endswith("checksums.sha256") and " " not in content):
            continue  # a record gets a line before each file takes its place
        allowed = {before.get(name), after.get(name)}
        if content not in allowed and not (name in trial.volatile and name in after):
            wrong.append(f"{name} is neither what it was nor what it becomes: {content[:40]}")
    gone = [name for name in before if name not in there and name in after]
    wrong += [f"{name} is gone" for name in gone if not name.startswith("work/")]
    if ended.code == 0:
        wrong += compared(trial, there, after)
    if changes.failed is not None and changes.failed[0] not in ("unlink", "remove", "rmdir"):
        final = [name for name in there if ".photogram-" in name and not re.search(r"\.stage\.(partial|removed)", name)]
        wrong += [f"{name} is left over" for name in final]
    return wrong


def compared(trial: Trial, there: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return how a folder differs from what a run without faults leaves."""
    wrong = [f"{name} is missing" for name in after if name not in there]
    wrong += [f"{name} is left over" for name in there if name not in after]
    differ = [n for n in after if n in there and there[n] != after[n] and n not in trial.volatile]
    return wrong + [f"{name} is another" for name in differ]


def wrong_records(folder: Path) -> list[str]:
    """Return the files of results that are not what their record says."""
    wrong = []
    for record in folder.rglob("checksums.sha256"):
        for line in record.read_text(encoding="utf-8").splitlines():
            checksum, _, name = line.partition("  ")
            path = record.parent / name
            if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != checksum:
                wrong.append(f"{name} is not what its record says")
    return wrong


def tried(trial: Trial, folder: Path, most: int | None, say: Callable[[str], None], every: int = 1) -> Counter[str]:
    """Run a command with each of its changes failing, ``every`` so many or at ``most`` so many of them, and say what
    does not hold."""

    def fresh() -> None:
        clear(folder)
        shutil.copytree(trial.base, folder)

    seen: Counter[str] = Counter()
    results = []
    for _ in range(2):
        fresh()
        before = contents(folder)
        with failing(folder) as changes:
            ended = trial.act(folder)
        if ended.code:
            raise AssertionError(f"{trial.name} without a fault: {ended.said}")
        results.append(contents(folder))
    after = results[1]
    differ = {name for name in after if results[0].get(name) != after[name]}
    trial = Trial(trial.name, trial.base, trial.act, trial.volatile | differ)
    if differ:
        say(f"{trial.name}: differ from run to run: {', '.join(sorted(differ))}")
    began = time.monotonic()
    count = len(changes.seen)
    step = every if most is None else max(1, count // most)
    for number in range(1 + step // 2, count + 1, step):
        fresh()
        code = CODES[number % len(CODES)]
        with failing(folder, number, code) as changes:
            ended = trial.act(folder)
        if changes.failed is None:
            seen["never asked for"] += 1
            continue
        kind, path = changes.failed
        seen["faults"] += 1
        seen[kind] += 1
        seen["refused" if ended.code else "unharmed"] += 1
        wrong = judged(trial, folder, before, after, changes, ended)
        again = trial.act(folder) if ended.code else ended
        if again.code:
            wrong.append(f"again: exit {again.code}: {again.said.strip()[-300:]}")
        wrong += [f"again: {text}" for text in (*compared(trial, contents(folder), after), *wrong_records(folder))]
        if wrong:
            seen["wrong"] += 1
            say(f"{trial.name}: {kind} {path} (change {number}, code {code}): {'; '.join(wrong[:6])}")
    say(f"{trial.name}: {dict(seen)}, {time.monotonic() - began:.0f} s")
    return seen


# ---- the commands --------------------------------------------------------------------------------------------------


def adjusted_until(stage: str) -> Callable[[Path], Ended]:
    """Return what runs a survey until a stage."""
    return lambda folder: run("adjust", folder / "project.yaml", "--no-check", "--until", stage)


def edited(project: Path, change: Callable[[dict[str, object]], object]) -> None:
    """Change a project file."""
    values = yaml.safe_load(project.read_text(encoding="utf-8"))
    change(values)
    project.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")


def make_surveys(folder: Path, place: Path) -> dict[str, Path]:
    """Make the survey and return a copy of its folder before each stage by the stage's name, and ``finished``; each
    was adjusted at ``place``."""
    pristine = folder / "pristine"
    project = write_demonstration(pristine, 3, lambda *_: None, PLAN)
    edited(project, lambda v: v.update(features={"maximum": 800}, work="work", results="results"))
    shutil.copytree(pristine, place)
    bases: dict[str, Path] = {}
    for stage in STAGES:
        bases[stage.name] = Path(shutil.copytree(place, folder / f"before_{stage.name}"))
        ended = adjusted_until(stage.name)(place)
        if ended.code:
            raise AssertionError(ended.said)
    bases["finished"] = Path(shutil.copytree(place, folder / "finished"))
    clear(place)
    return bases


def on_a_finished_survey(*arguments: str, again: Sequence[str] = ()) -> Callable[[Path], Ended]:
    """Return what runs a command on the survey in a folder, which ``{}`` stands for in its arguments; ``again`` are
    those that it needs where its product is there."""

    def act(folder: Path) -> Ended:
        return run(*(argument.format(folder) for argument in (*arguments, *again)))

    return act


def trials(folder: Path, bases: Mapping[str, Path]) -> list[Trial]:
    """Return all commands that are tried; what they begin with is made in ``folder``."""
    finished = bases["finished"]
    weighted = Path(shutil.copytree(finished, folder / "weighted"))
    text = (weighted / "project.yaml").read_text(encoding="utf-8")
    (weighted / "project.yaml").write_text(text + "adjustment: {outlier_threshold: 3.5}\n", encoding="utf-8")
    mark = ("mark", "{}/project.yaml", "--detect-only")
    new = ("init", "{}/photographs", "--crs", "EPSG:25832", "--focal-px", "600", "--project", "{}/own.yaml")
    all_products = ("dxf", "qgis", "landxml", "glb", "shapefile", "kmz", "copc", "3dtiles")
    to = [word for product in all_products for word in ("--to", product)]
    found = [Trial(f"adjust {stage.name}", bases[stage.name], adjusted_until(stage.name)) for stage in STAGES]
    found.append(Trial("adjust again", weighted, on_a_finished_survey("adjust", "{}/project.yaml", "--no-check")))
    found.append(Trial("init", bases["photographs"], on_a_finished_survey(*new, again=("--force",))))
    found.append(Trial("mark", finished, on_a_finished_survey(*mark)))
    found.append(Trial("deliver", finished, on_a_finished_survey("deliver", "{}/project.yaml", *to, "--zip")))
    same = ("compare", "{}/results", "--reference", "{}/results", "--output", "{}/change")
    found.append(Trial("compare", finished, on_a_finished_survey(*same)))
    exported = ("export", "{}/project.yaml", "--output", "{}/solution", "--to")
    forms = ("opf", "colmap", "metashape", "opensfm", "undistorted")
    return found + [Trial(f"export {form}", finished, on_a_finished_survey(*exported, form)) for form in forms]


def main() -> None:
    """Try every command, print what does not hold and the sums."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=1, help="fail every N-th change alone")
    parser.add_argument("--only", default="", help="commands whose name has this in it")
    given = parser.parse_args()
    folder = given.folder.absolute()
    folder.mkdir(parents=True)
    total: Counter[str] = Counter()
    with undrawing():
        for trial in trials(folder, make_surveys(folder, folder / "survey")):
            if given.only in trial.name:
                total += tried(trial, folder / "survey", None, lambda text: print(text, flush=True), given.every)
    print(f"{total['faults']} faults: {total['refused']} refused, {total['unharmed']} unharmed, {total['wrong']} wrong")
    sys.exit(total["wrong"] > 0)


if __name__ == "__main__":
    main()
