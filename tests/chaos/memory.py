"""Each stage with too little memory: it ends with one sentence, and goes on where there is enough.

    PYTHONPATH=tests python tests/chaos/memory.py FOLDER [--limit as] [--only surface]

A survey of four photographs. Each stage of `photogram adjust` runs in processes of its own whose address space
(RLIMIT_AS) or data (RLIMIT_DATA) may grow by so many megabytes and no more, ever less until nothing can start. It has
to end with exit code 0, or with one line `photogram: ...` and exit code 1, never with a signal, a traceback or a
defect; and the same stage again, without the limit, has to write the same files.

    enough     runs that came to their end all the same
    refused    runs that said so and ended with 1
    wrong      any other end, each in a line above
"""

import argparse
import os
import resource
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from chaos.faults import clear, contents, make_surveys
from chaos.interruptions import forked

from photogram.cli.commands import adjust  # noqa: F401 - loaded before the children are made
from photogram.cli.work import adjust as work  # noqa: F401 - with all that computes
from photogram.pipeline.pipeline import STAGES

LIMITS = {"as": resource.RLIMIT_AS, "data": resource.RLIMIT_DATA}
_COUNTED = {"as": "VmSize:", "data": "VmData:"}
LONGEST_S = 180.0
STEPS_MB = (300, 100, 50, 35, 25, 15, 8, 3)


def taken_bytes(limit: str) -> int:
    """Return what counts against a limit so far."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return int(next(line for line in lines if line.startswith(_COUNTED[limit])).split()[1]) * 1024


def child(folder: Path, stage: str, limit: str, megabytes: int | None) -> tuple[int, str]:
    """Run a stage in a process of its own that may take so much more; return its status and what it said."""
    said = folder.with_name("said.txt")

    def limited() -> None:
        if megabytes is not None:
            most = taken_bytes(limit) + megabytes * 2**20
            resource.setrlimit(LIMITS[limit], (most, most))

    number = forked(["adjust", str(folder / "project.yaml"), "--no-check", "--until", stage], said, limited)
    status = _waited_for(number)
    return status, said.read_text(encoding="utf-8", errors="replace")


def _waited_for(number: int) -> int:
    """Return how a process ended; one that does not is killed."""
    ends = time.monotonic() + LONGEST_S
    while time.monotonic() < ends:
        done, status = os.waitpid(number, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.kill(number, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])


def fault_of(status: int, said: str) -> str:
    """Return what is wrong with the end of a run, empty where nothing is."""
    if status == 0:
        return ""
    lines = [line for line in said.splitlines() if line.startswith("photogram: ")]
    if status == 1 and len(lines) == 1 and "Traceback" not in said:
        return ""
    return f"exit {status}: {said.strip()[-600:]}"


def main() -> None:
    """Print the outcome of each run that is wrong, and the sums of each stage."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--limit", choices=list(LIMITS), action="append")
    parser.add_argument("--steps", type=int, nargs="*", default=STEPS_MB, help="megabytes")
    parser.add_argument("--only", default="", help="stages whose name has this in it")
    given = parser.parse_args()
    folder = given.folder.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    place, total = folder / "survey", Counter[str]()
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as other:
        bases = other.submit(make_surveys, folder, place).result()
    for limit in given.limit or list(LIMITS):
        for stage in STAGES:
            if given.only in stage.name:
                total += tried(bases[stage.name], place, stage.name, limit, given.steps)
    print(f"{total['enough']} enough, {total['refused']} refused, {total['wrong']} wrong")
    sys.exit(total["wrong"] > 0)


def tried(base: Path, place: Path, stage: str, limit: str, steps: Sequence[int]) -> Counter[str]:
    """Run a stage with ever less memory."""

    def fresh() -> None:
        clear(place)
        shutil.copytree(base, place)

    fresh()
    status, said = child(place, stage, limit, None)
    if status:
        raise AssertionError(said)
    expected, seen, words = contents(place), Counter[str](), list[str]()
    for megabytes in steps:
        fresh()
        status, said = child(place, stage, limit, megabytes)
        wrong = fault_of(status, said)
        seen["wrong" if wrong else "refused" if status else "enough"] += 1
        words += [said.strip().splitlines()[-1][:160]] if status and not wrong else []
        again, more = child(place, stage, limit, None) if status else (0, "")
        differ = [f"exit {again}: {more[-300:]}"] if again else _differences(contents(place), expected)
        if wrong or differ:
            seen["wrong"] += not wrong
            print(f"{stage}, {limit} + {megabytes} MB: {wrong} {'; '.join(differ[:4])}", flush=True)
    for word in dict.fromkeys(words):
        print(f"    {word}")
    print(f"{stage}, {limit}: {dict(seen)}", flush=True)
    return seen


def _differences(there: dict[str, str], expected: dict[str, str]) -> list[str]:
    wrong = [f"{name} is missing" for name in expected if name not in there]
    wrong += [f"{name} is left over" for name in there if name not in expected]
    return wrong + [f"{name} is another" for name in expected if name in there and there[name] != expected[name]]


if __name__ == "__main__":
    main()
