"""Spoilt inputs by the thousand, in one process: each is refused in words, or used as it stands.

    python tests/fuzz/fuzz.py --cases 10000 --seed 1

A case fails where anything but a PhotogramError is raised, where it takes more than 10 s or 1 GiB, where a library
writes to the terminal, where a message holds what a terminal would obey, or where a part of the input is lost without a
word. The same seed makes the same cases; --only NUMBER runs one of them. Inputs that failed are kept.
"""

import argparse
import faulthandler
import os
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from random import Random
from types import FrameType

from cases import CUT, TARGETS, Bench, Case
from corpus import make_corpus, make_survey
from mutations import cut

from photogram.cli.streams import prepare_streams
from photogram.errors import PhotogramError

MOST_SECONDS, MOST_BYTES = 10, 2**30
LONGEST_MESSAGE, MOST_LINES = 2500, 250
STATUS, CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


class TooSlowError(BaseException):
    """A case took too long; no handler of faults may catch it."""


def _late(_number: int, _frame: FrameType | None) -> None:
    raise TooSlowError(f"longer than {MOST_SECONDS} s")


def _peak_bytes() -> int:
    """Return the largest resident memory since the last reset, 0 where the system does not say."""
    if not STATUS.exists():
        return 0
    line = next(line for line in STATUS.read_text().splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) * 1024


def _reset_peak() -> None:
    if CLEAR.exists():
        CLEAR.write_text("5")


def _check_message(fault: PhotogramError) -> None:
    lines = str(fault).splitlines()
    if not lines or len(lines) > MOST_LINES:
        raise AssertionError(f"a message of {len(lines)} lines")
    for line in lines:
        if len(line) > LONGEST_MESSAGE:
            raise AssertionError(f"a line of {len(line)} characters: {line[:200]!r}")


def _place(bench: Bench, sound: Path) -> Path:
    return bench.folder / f"spoilt{sound.suffix}" if sound.name != "report.json" else bench.folder / "report.json"


def _check_sound(bench: Bench) -> None:
    """Use every sound input: what refuses those would refuse all others, and try nothing."""
    for target in TARGETS.values():
        for seed in target.seeds:
            path = _place(bench, bench.corpus / seed)
            shutil.copy(bench.corpus / seed, path)
            with redirect_stdout(StringIO()):
                target.use(Case(bench, path, bench.corpus / seed, False))
            path.unlink()


def _run(bench: Bench, seed: int, number: int) -> tuple[str, str]:
    """Run a case; return its target and how it ended."""
    random = Random(f"{seed}/{number}")
    name = random.choices(list(TARGETS), [t.share for t in TARGETS.values()])[0]
    target = TARGETS[name]
    sound = bench.corpus / random.choice(target.seeds)
    was_cut = name in CUT and random.random() < 0.25
    content = sound.read_bytes()
    path = _place(bench, sound)
    path.write_bytes(cut(content, random) if was_cut else target.spoil(content, random))
    try:
        target.use(Case(bench, path, sound, was_cut))
    except PhotogramError as fault:
        _check_message(fault)
        return name, "refused"
    return name, "used"


def _watched(bench: Bench, seed: int, number: int, said: Path) -> tuple[str, str, str]:
    """Run a case and watch it: target, how it ended, and what is wrong, empty where nothing is."""
    said.write_bytes(b"")
    kept = [os.dup(1), os.dup(2)]
    stream = said.open("a", encoding="utf-8")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)  # of libraries in C, which the command drops too
    os.close(nowhere)
    error, sys.stderr = sys.stderr, stream
    _reset_peak()
    before, start = _peak_bytes(), time.monotonic()
    signal.alarm(MOST_SECONDS)
    wrong, name, ended = "", "", ""
    try:
        name, ended = _run(bench, seed, number)
    except (Exception, TooSlowError):  # noqa: BLE001 - this is what is looked for
        wrong = traceback.format_exc()
    finally:
        signal.alarm(0)
        sys.stdout.flush()
        for there, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, there)
        for copy in kept:
            os.close(copy)
        sys.stderr = error
        stream.close()
    seconds, memory = time.monotonic() - start, _peak_bytes() - before
    text = said.read_text(errors="replace")
    if not wrong and memory > MOST_BYTES:
        wrong = f"{memory / 2**20:.0f} MiB"
    if not wrong and seconds > MOST_SECONDS:
        wrong = f"{seconds:.1f} s"
    if not wrong and text and not text.startswith("photogram: ") and "Usage:" not in text:
        wrong = f"on the terminal: {text[:1000]}"
    if not wrong and any(ord(c) < 32 and c not in "\n\t" for c in text):
        wrong = f"control characters on the terminal: {text[:1000]!r}"
    return name, ended, wrong


def main() -> int:
    """Run the cases; return 1 where one failed."""
    parser = argparse.ArgumentParser(description="Spoilt inputs by the thousand.")
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="begin with this case")
    parser.add_argument("--only", type=int, help="run this case alone")
    parser.add_argument("--survey", type=Path, help="a small survey, adjusted; made where none is given")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"), help="folder for inputs that failed")
    options = parser.parse_args()
    faulthandler.enable(os.dup(2))  # a case that ends the process shows where
    prepare_streams()
    signal.signal(signal.SIGALRM, _late)
    with tempfile.TemporaryDirectory(prefix="photogram-fuzz-") as name:
        try:
            return _run_all(Path(name), options)
        except Exception:  # noqa: BLE001 - of the fuzzer itself; the streams keep quiet about what nobody catches
            traceback.print_exc()
            return 2


def _run_all(folder: Path, options: argparse.Namespace) -> int:
    survey = options.survey
    if survey is None:
        survey = folder / "adjusted"
        make_survey(survey)
    make_corpus(folder / "corpus", survey)
    (folder / "spoilt").mkdir()
    shutil.copytree(survey, folder / "survey", ignore=shutil.ignore_patterns("work", "results"))
    shutil.copy(survey / "project.yaml", folder / "corpus")
    bench = Bench(folder / "corpus", folder / "survey", folder / "spoilt")
    _check_sound(bench)
    numbers = range(options.first, options.cases) if options.only is None else [options.only]
    counts: Counter[tuple[str, str]] = Counter()
    failed, start, used, slowest = 0, time.monotonic(), time.process_time(), 0.0
    for number in numbers:
        begin = time.monotonic()
        target, ended, wrong = _watched(bench, options.seed, number, folder / "said")
        slowest = max(slowest, time.monotonic() - begin)
        counts[target, ended] += 1
        if wrong:
            failed += 1
            options.keep.mkdir(exist_ok=True, parents=True)
            for spoilt in bench.folder.iterdir():
                shutil.copy(spoilt, options.keep / f"{options.seed}-{number}-{spoilt.name}")
            sys.stdout.write(f"\n--- case {number} of seed {options.seed}\n{wrong}\n")
        for spoilt in bench.folder.iterdir():
            spoilt.unlink()
    seconds, processor = time.monotonic() - start, time.process_time() - used
    for name in TARGETS:
        sys.stdout.write(f"{name:12} {counts[name, 'refused']:6} refused {counts[name, 'used']:6} used\n")
    sys.stdout.write(
        f"{len(numbers)} cases, {failed} failed; {seconds:.0f} s, {processor:.0f} s of processor, "
        f"the slowest case {slowest:.1f} s\n"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
