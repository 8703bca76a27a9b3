"""Kills, full disks and damaged files: a run that goes on after them writes the same bytes as one that nothing
happened to.

    python tests/chaos/interruptions.py FOLDER [--kills 60] [--full-disks 20] [--damages 200] [--seed 1]

A survey of four photographs is run once undisturbed. Then it is killed at random, at the moment when a file is about to
take its name or at any other, gone on with and killed again, until it comes to its end; and its work or its results are
put on a disk (tmpfs, which the superuser alone may mount) that is too small, which has to end in one line and exit code
1, and then grows. Last, one bit or one digit is changed in one file of one stage at a time, any of them: the file has
to be named, and its stage alone made again. Every product and every intermediate file is compared.
"""

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import yaml

from photogram.cli.commands import (
    adjust,  # noqa: F401 - loaded before the children are made
    report,  # noqa: F401 - loaded before the children are made
)
from photogram.cli.main import main as photogram
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.survey_plan import SurveyPlan

PLAN = SurveyPlan(
    width_px=400, height_px=300, focal_px=600.0, flying_height_m=40.0, forward_overlap=0.75, side_overlap=0.7, strips=2,
    photographs_per_strip=2, relief_m=4.0, buildings=2, trees=6, target_radius_m=0.3, control_points=8, check_points=4,
)  # fmt: skip
RUNS_DIFFER = ("stage.json", "report.json", "report.html", "checksums.sha256", "photogram.lock")
KILLS_A_CHAIN = 10


def forked(arguments: Sequence[str], said: Path, before: Callable[[], None] = lambda: None) -> int:
    """Begin `photogram` with ``arguments`` in a process of its own, ``before`` called first in it, what it says written
    to ``said``; return its number. From a process that never computes: threads would not come along."""
    number = os.fork()
    if number == 0:
        out = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(out, 1)
        os.dup2(out, 2)
        before()
        sys.argv = ["photogram", *arguments]
        code = 0
        try:
            photogram()
        except SystemExit as end:
            code = int(end.code or 0)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return number


def child(project: Path, stop: Callable[[], None] = lambda: None) -> int:
    """Run `photogram adjust` in a process of its own, ``stop`` called first in it; return its status."""
    return os.waitpid(forked(["adjust", str(project), "--no-check"], project.parent / "said.txt", stop), 0)[1]


def kill_at_renaming(number: int) -> None:
    """Kill this process in place of its ``number``-th renaming, with which every change of a folder ends."""
    rename, lock, left = os.replace, threading.Lock(), [number]

    def counted(source: Path, target: Path) -> None:
        with lock:
            left[0] -= 1
            if not left[0]:
                os.kill(os.getpid(), signal.SIGKILL)
            rename(source, target)

    os.replace = counted  # type: ignore[assignment]


def kill_after(seconds: float) -> None:
    """Kill this process after a time, whatever it does then."""
    timer = threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGKILL))
    timer.daemon = True
    timer.start()


def without_times(path: Path) -> bytes:
    """Return what a report says but for times and memory."""
    said = json.loads(path.read_text(encoding="utf-8"))
    for part in (said, said["adjustment"], *said["adjustment"]["effort"]):
        for name in ("seconds", "peak_memory_bytes"):
            part.pop(name, None)
    return json.dumps(said, sort_keys=True).encode()


def contents(work: Path, results: Path) -> dict[str, str]:
    """Return the checksums of all files of two folders but of what holds times, and of the report without them."""
    found = {}
    for folder in (work, results):
        for path in sorted(p for p in folder.rglob("*") if p.is_file()):
            name = f"{folder.name}/{path.relative_to(folder)}"
            if path.name == "report.json":
                found[name] = hashlib.sha256(without_times(path)).hexdigest()
            elif path.name not in RUNS_DIFFER:
                found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def fresh(pristine: Path, folder: Path, **folders: str) -> Path:
    """Copy the survey that was not run yet and return its project file; ``folders`` are its work and results."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(pristine, folder)
    project = folder / "project.yaml"
    values = yaml.safe_load(project.read_text(encoding="utf-8"))
    project.write_text(yaml.safe_dump({**values, **folders}, sort_keys=False), encoding="utf-8")
    return project


def killed(pristine: Path, folder: Path, kills: int, expected: dict[str, str], rng: random.Random) -> tuple[int, int]:
    """Kill chains of runs; return how many kills there were and how many chains ended differently."""
    done, wrong, chain = 0, 0, 0
    while done < kills:
        project, here, chain = fresh(pristine, folder / "killed"), 0, chain + 1
        while here < KILLS_A_CHAIN and done + here < kills:
            if rng.random() < 0.7:
                number = rng.randrange(1, 25)
                status = child(project, partial(kill_at_renaming, number))
            else:
                seconds = rng.uniform(0.0, 3.0)
                status = child(project, partial(kill_after, seconds))
            if status != signal.SIGKILL:
                break  # it came to its end
            here += 1
        done += here
        status = child(project)
        same = contents(project.parent / "work", project.parent / "results") == expected
        wrong += status != 0 or not same
        print(f"chain {chain}: {here} kills, {'the same' if same else 'DIFFERENT'}, exit {status >> 8}", flush=True)
    return done, wrong


def on_full_disks(pristine: Path, folder: Path, count: int, expected: dict[str, str], needs: dict[str, int]) -> int:
    """Run with work or results on a disk that is too small, then on one that is not; return how many went wrong."""
    wrong, disk = 0, folder / "disk"
    disk.mkdir(exist_ok=True)
    for number in range(count):
        which = ("work", "results")[number % 2]
        share = (number // 2 + 0.5) / (count / 2)
        size = 4096 * max(4, int(share * share * 0.9 * needs[which] / 4096))
        project = fresh(pristine, folder / "filled", **{which: str(disk / which)})
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(disk)], check=True)
        try:
            status = child(project) >> 8
            said = (project.parent / "said.txt").read_text(encoding="utf-8")
            faults = [line for line in said.splitlines() if line.startswith("photogram: ")]
            clear = status == 1 and len(faults) == 1 and "Traceback" not in said
            subprocess.run(["mount", "-o", "remount,size=256m", str(disk)], check=True)
            end = child(project) >> 8
            places = {"work": project.parent / "work", "results": project.parent / "results", which: disk / which}
            same = contents(places["work"], places["results"]) == expected
        finally:
            subprocess.run(["umount", str(disk)], check=True)
        wrong += not (clear and same and end == 0)
        words = faults[0][:150] if faults else "NO FAULT"
        print(f"{which} on {size / 1e3:.0f} kB: exit {status}, then {end}, {'same' if same else 'DIFFERENT'}: {words}")
        sys.stdout.flush()
    return wrong


def spoilt(content: bytes, rng: random.Random) -> tuple[str, bytes]:
    """Return what is changed in a file, one bit or one of its digits, and the file with the change."""
    digits = [i for i, byte in enumerate(content) if 48 <= byte < 58]
    if digits and rng.random() < 0.5:
        place = rng.choice(digits)
        other = 48 + (content[place] - 48 + rng.randrange(1, 10)) % 10
        return "digit", content[:place] + bytes([other]) + content[place + 1 :]
    place = rng.randrange(len(content))
    return "bit", content[:place] + bytes([content[place] ^ 1 << rng.randrange(8)]) + content[place + 1 :]


def notes(work: Path) -> dict[str, tuple[int, int]]:
    """Return of every stage which file its note is: another one where it was made again."""
    found = {path.parent.name: path.stat() for path in work.glob("*.stage/stage.json")}
    return {name: (status.st_ino, status.st_mtime_ns) for name, status in found.items()}


def damaged(project: Path, count: int, expected: dict[str, str], rng: random.Random) -> int:
    """Change one bit or digit in files of stages, run, and return how often that was not found, not named, or not
    mended by its stage alone."""
    work, wrong, kinds = project.parent / "work", 0, {"bit": 0, "digit": 0}
    stages: dict[str, int] = {}
    for _ in range(count):
        path = rng.choice(sorted(p for p in work.glob("*.stage/**/*") if p.is_file() and p.stat().st_size))
        stage = path.relative_to(work).parts[0]
        kind, content = spoilt(path.read_bytes(), rng)
        before = notes(work)
        path.write_bytes(content)
        status = child(project) >> 8
        said = (project.parent / "said.txt").read_text(encoding="utf-8")
        after = notes(work)
        again = [name for name in after if after[name] != before.get(name)]
        named = path.name in "".join(said.split()) and "was modified since it was written" in " ".join(said.split())
        same = contents(work, project.parent / "results") == expected
        kinds[kind] += 1
        stages[stage] = stages.get(stage, 0) + 1
        if status or not named or again != [stage] or not same:
            wrong += 1
            print(f"{kind} of {path.relative_to(work)}: exit {status}, named: {named}, again: {again}, same: {same}")
            sys.stdout.flush()
    where = ", ".join(f"{name} {number}" for name, number in stages.items())
    print(f"damaged: {kinds['bit']} bits, {kinds['digit']} digits, in {where}")
    return wrong


def quiet(done: int, total: int, text: str) -> None:
    """Take progress, and say nothing."""


def main() -> None:
    """Print a line for each chain of kills, each disk and each damage that is not mended, and the sums."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kills", type=int, default=60)
    parser.add_argument("--full-disks", type=int, default=20)
    parser.add_argument("--damages", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    folder = given.folder.absolute()
    folder.mkdir(parents=True)
    pristine = folder / "pristine"
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as other:
        project = other.submit(write_demonstration, pristine, 3, quiet, PLAN).result()
    values = yaml.safe_load(project.read_text(encoding="utf-8"))
    values |= {"features": {"maximum": 800}, "work": "work", "results": "results"}
    project.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    began = time.monotonic()
    whole = fresh(pristine, folder / "whole")
    if child(whole):
        sys.exit((whole.parent / "said.txt").read_text(encoding="utf-8"))
    expected = contents(whole.parent / "work", whole.parent / "results")
    places = {name: (whole.parent / name).rglob("*") for name in ("work", "results")}
    needs = {name: sum(p.stat().st_size for p in inside if p.is_file()) for name, inside in places.items()}
    print(f"undisturbed: {len(expected)} files, {time.monotonic() - began:.0f} s", flush=True)
    kills, wrong = killed(pristine, folder, given.kills, expected, random.Random(given.seed))
    print(f"{kills} kills: {wrong} chains ended differently", flush=True)
    if given.full_disks and os.geteuid() == 0:
        unmended = on_full_disks(pristine, folder, given.full_disks, expected, needs)
        print(f"{given.full_disks} full disks: {unmended} went wrong")
        wrong += unmended
    elif given.full_disks:
        print("full disks: not tried, the superuser alone may mount them")
    unnamed = damaged(whole, given.damages, expected, random.Random(given.seed))
    print(f"{given.damages} damaged files: {unnamed} not found, named and mended by their stage alone")
    sys.exit(wrong + unnamed > 0)


if __name__ == "__main__":
    main()
