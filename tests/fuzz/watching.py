"""Where cases are run, and how each is watched: what it raises, its time, its memory and what it says."""

import os
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from random import Random
from types import FrameType

from cases import Bench, Case, Target
from corpus import make_corpus, make_survey

from photogram.errors import PhotogramError

MOST_SECONDS, MOST_WAITED_S, MOST_BYTES = 10, 60, 2**30
"""Of a case: processor time, which other programs do not lengthen, time in all, and memory."""
LONGEST_MESSAGE, MOST_LINES = 2500, 250
STATUS, CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


class TooSlowError(BaseException):
    """A case took too long; no handler of faults may catch it."""


def _late(_number: int, _frame: FrameType | None) -> None:
    raise TooSlowError(f"longer than {MOST_SECONDS} s of processor time, or {MOST_WAITED_S} s in all")


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


def make_bench(folder: Path, survey: Path | None) -> Bench:
    """Return where cases are run: a corpus and a survey in ``folder``; a small one is adjusted where none is given."""
    if survey is None:
        survey = folder / "adjusted"
        make_survey(survey)
    make_corpus(folder / "corpus", survey)
    (folder / "spoilt").mkdir()
    shutil.copytree(survey, folder / "survey", ignore=shutil.ignore_patterns("work", "results"))
    shutil.copy(survey / "project.yaml", folder / "corpus")
    return Bench(folder / "corpus", folder / "survey", folder / "spoilt")


def place_of(bench: Bench, sound: Path) -> Path:
    """Return where the spoilt form of a file of the corpus is written."""
    return bench.folder / f"spoilt{sound.suffix}" if sound.name != "report.json" else bench.folder / "report.json"


def check_sound(bench: Bench, targets: dict[str, Target]) -> None:
    """Use every sound input: what refuses those would refuse all others, and try nothing."""
    for target in targets.values():
        for seed in target.seeds:
            path = place_of(bench, bench.corpus / seed)
            shutil.copy(bench.corpus / seed, path)
            with redirect_stdout(StringIO()):
                target.use(Case(bench, path, bench.corpus / seed, False))
            clear(bench)


def clear(bench: Bench) -> None:
    """Remove what a case left."""
    for left in bench.folder.iterdir():
        left.unlink()


def use(bench: Bench, target: Target, sound: Path, content: bytes, *, was_cut: bool = False) -> str:
    """Run a case of a content in place of a sound file; return how it ended."""
    path = place_of(bench, sound)
    path.write_bytes(content)
    try:
        target.use(Case(bench, path, sound, was_cut))
    except PhotogramError as fault:
        _check_message(fault)
        return "refused"
    return "used"


def watched(said: Path, work: Callable[[], str]) -> tuple[str, str]:
    """Do some work and watch it: how it ended, and what is wrong, empty where nothing is."""
    said.write_bytes(b"")
    kept = [os.dup(1), os.dup(2)]
    stream = said.open("a", encoding="utf-8")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)  # of libraries in C, which the command drops too
    os.close(nowhere)
    error, sys.stderr = sys.stderr, stream
    _reset_peak()
    before, start = _peak_bytes(), time.process_time()
    signal.signal(signal.SIGALRM, _late)
    signal.signal(signal.SIGPROF, _late)
    signal.alarm(MOST_WAITED_S)
    signal.setitimer(signal.ITIMER_PROF, MOST_SECONDS)
    wrong, ended = "", ""
    try:
        ended = work()
    except (Exception, TooSlowError):  # noqa: BLE001 - this is what is looked for
        wrong = traceback.format_exc()
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        sys.stdout.flush()
        for there, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, there)
        for copy in kept:
            os.close(copy)
        sys.stderr = error
        stream.close()
    seconds, memory = time.process_time() - start, _peak_bytes() - before
    text = said.read_text(errors="replace")
    if not wrong and memory > MOST_BYTES:
        wrong = f"{memory / 2**20:.0f} MiB"
    if not wrong and seconds > MOST_SECONDS:
        wrong = f"{seconds:.1f} s"
    if not wrong and text and not text.startswith("photogram: ") and "Usage:" not in text:
        wrong = f"on the terminal: {text[:1000]}"
    if not wrong and any(ord(c) < 32 and c not in "\n\t" for c in text):
        wrong = f"control characters on the terminal: {text[:1000]!r}"
    return ended, wrong


def random_of(seed: int, number: int) -> Random:
    """Return the random numbers of a case."""
    return Random(f"{seed}/{number}")
