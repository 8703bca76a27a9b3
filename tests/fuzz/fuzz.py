"""Spoilt inputs by the thousand, in one process: each is refused in words, or used as it stands.

    PYTHONPATH=tests:tests/exchange python tests/fuzz/fuzz.py --cases 10000 --seed 1 [--target polygons]

A case fails where anything but a PhotogramError is raised, where it takes more than 10 s of processor time or 1 GiB,
where a library writes to the terminal, where a message holds what a terminal would obey, or where a part of the input
is lost without a word. The same seed makes the same cases; --only NUMBER runs one of them. Inputs that failed are kept.
"""

import argparse
import faulthandler
import os
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

from cases import Bench, Target
from mutations import cut
from watching import check_sound, clear, make_bench, random_of, use, watched
from ways_in import CUT, TARGETS

from photogram.cli.streams import prepare_streams


def _case(bench: Bench, targets: dict[str, Target], seed: int, number: int) -> tuple[str, Path, bytes, bool]:
    """Return the target of a case, the sound file, what it is spoilt to, and whether it was only cut off."""
    random = random_of(seed, number)
    name = random.choices(list(targets), [t.share for t in targets.values()])[0]
    target = targets[name]
    sound = bench.corpus / random.choice(target.seeds)
    was_cut = name in CUT and random.random() < 0.25
    content = sound.read_bytes()
    return name, sound, cut(content, random) if was_cut else target.spoil(content, random), was_cut


def main() -> int:
    """Run the cases; return 1 where one failed."""
    parser = argparse.ArgumentParser(description="Spoilt inputs by the thousand.")
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="begin with this case")
    parser.add_argument("--only", type=int, help="run this case alone")
    parser.add_argument("--target", choices=list(TARGETS), action="append", help="this way in alone; may be repeated")
    parser.add_argument("--survey", type=Path, help="a small survey, adjusted; made where none is given")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"), help="folder for inputs that failed")
    options = parser.parse_args()
    faulthandler.enable(os.dup(2))  # a case that ends the process shows where
    prepare_streams()
    with tempfile.TemporaryDirectory(prefix="photogram-fuzz-") as name:
        try:
            return _run_all(Path(name), options)
        except Exception:  # noqa: BLE001 - of the fuzzer itself; the streams keep quiet about what nobody catches
            traceback.print_exc()
            return 2


def _run_all(folder: Path, options: argparse.Namespace) -> int:
    targets = {name: target for name, target in TARGETS.items() if options.target is None or name in options.target}
    bench = make_bench(folder, options.survey)
    check_sound(bench, targets)
    numbers = range(options.first, options.cases) if options.only is None else [options.only]
    counts: Counter[tuple[str, str]] = Counter()
    failed, start, used, slowest = 0, time.monotonic(), time.process_time(), 0.0
    for number in numbers:
        begin = time.monotonic()
        name, sound, content, was_cut = _case(bench, targets, options.seed, number)
        target = targets[name]
        ended, wrong = watched(
            folder / "said", lambda t=target, s=sound, c=content, w=was_cut: use(bench, t, s, c, was_cut=w)  # type: ignore[misc]
        )  # fmt: skip
        slowest = max(slowest, time.monotonic() - begin)
        counts[name, ended] += 1
        if wrong:
            failed += 1
            options.keep.mkdir(exist_ok=True, parents=True)
            for spoilt in bench.folder.iterdir():
                shutil.copy(spoilt, options.keep / f"{options.seed}-{number}-{spoilt.name}")
            sys.stdout.write(f"\n--- case {number} of seed {options.seed}, {name}, {sound.name}\n{wrong}\n")
            sys.stdout.flush()
        clear(bench)
    seconds, processor = time.monotonic() - start, time.process_time() - used
    for name in targets:
        sys.stdout.write(f"{name:15} {counts[name, 'refused']:6} refused {counts[name, 'used']:6} used\n")
    sys.stdout.write(
        f"{len(numbers)} cases, {failed} failed; {seconds:.0f} s, {processor:.0f} s of processor, "
        f"the slowest case {slowest:.1f} s\n"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
