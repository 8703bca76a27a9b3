"""Spoilt inputs that a fuzzer makes which sees what lines of photogram's readers each one reaches (atheris, libFuzzer).

    PYTHONPATH=tests:tests/exchange python tests/fuzz/guided.py --target polygons --seconds 180

The targets, what must hold, and the inputs to begin with are those of fuzz.py. What fails is kept, once for each place
where it fails, and the search goes on; inputs that reach new lines are kept in --corpus, where a next search begins.
atheris has wheels for Linux and is no part of the test tools: pip install atheris.
"""

import argparse
import io
import os
import random
import shutil
import sys
import tempfile
import time
import traceback
import zipfile
import zlib
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stderr
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cases import Bench

READERS = (
    "photogram.files", "photogram.exchange", "photogram.marking.files", "photogram.verification", "photogram.node",
    "photogram.local_grids", "photogram.project", "photogram.geodesy", "photogram.constraints", "photogram.settings",
)  # fmt: skip
"""What the fuzzer watches: modules that read, none of which has compiled code."""


COUNTED = "cases.txt"


def _unwatched() -> list[str]:
    """Return the modules of photogram that are no readers: atheris takes a package whole, and numba cannot compile what
    is watched."""
    package = find_spec("photogram")
    roots = [] if package is None else list(package.submodule_search_locations or ())
    names = [f"photogram.{m}" for root in roots for m in _modules_below(Path(root))]
    return ["photogram", *(n for n in names if not any(n == r or n.startswith(f"{r}.") for r in READERS))]


def _modules_below(root: Path) -> list[str]:
    paths = [Path(folder) / name for folder, _, names in os.walk(root, followlinks=True) for name in names]
    own = [path.relative_to(root).with_suffix("") for path in paths if path.suffix == ".py"]
    return [".".join(part for part in path.parts if part != "__init__") for path in own if path.name != "__main__"]


def _place(wrong: str) -> str:
    """Return where a case failed: the last line of photogram in a traceback, and the error without its figures."""
    lines = [line.strip() for line in wrong.splitlines() if line.strip()]
    frames = [line for line in lines if line.startswith("File ") and "tests/fuzz" not in line]
    own = [line for line in frames if "/photogram/" in line] or frames or [""]
    return f"{own[-1]} {lines[-1].split(':')[0]}"


def _make_survey(folder: Path) -> None:
    from corpus import make_survey

    make_survey(folder)


def search(bench: "Bench", name: str, seconds: int, corpus: Path, keep: Path) -> None:
    """Search for inputs on which a target fails; does not return."""
    import atheris
    from watching import clear, use, watched
    from ways_in import TARGETS

    target = TARGETS[name]
    for number, seed in enumerate(target.seeds):
        (corpus / f"seed-{number}").write_bytes(bytes([number]) + (bench.corpus / seed).read_bytes())
    places, counted = set[str](), bench.folder.with_name(COUNTED)
    count, last = 0, bench.folder.with_name("last")

    def case(data: bytes) -> None:
        nonlocal count
        count += 1
        if count % 10 == 0:
            counted.write_text(str(count), encoding="utf-8")
        if not data:
            return
        last.write_bytes(data)
        sound = bench.corpus / target.seeds[data[0] % len(target.seeds)]
        _, wrong = watched(bench.folder.with_name("said"), lambda: use(bench, target, sound, data[1:]))
        if wrong and _place(wrong) not in places:
            places.add(_place(wrong))
            path = keep / f"{name.replace(' ', '_')}-{len(places)}{sound.suffix}"
            path.write_bytes(data[1:])
            path.with_name(f"{path.name}.why.txt").write_text(f"{sound.name}\n{wrong}", encoding="utf-8")
        clear(bench)

    def spoilt(data: bytes, most: int, seed: int) -> bytes:
        chance = random.Random(seed)
        if data and chance.random() < 0.6:
            try:
                return (data[:1] + target.spoil(data[1:], chance))[:most]
            except (
                ValueError,
                LookupError,
                RecursionError,
                NotImplementedError,
                OSError,
                EOFError,
                zlib.error,
                zipfile.BadZipFile,
            ):
                pass  # what was spoilt before is of its kind no more
        return bytes(atheris.Mutate(data, most))

    most = 2 * max(path.stat().st_size for path in corpus.iterdir())
    options = [f"-max_total_time={seconds}", f"-max_len={most}", "-timeout=0", "-rss_limit_mb=0"]
    options += [f"-artifact_prefix={bench.folder.parent}/", "-report_slow_units=1000"]
    atheris.Setup([sys.argv[0], str(corpus), *options], case, custom_mutator=spoilt)
    atheris.Fuzz()


def _searched(bench: "Bench", name: str, given: argparse.Namespace) -> int:
    """Search in a process of its own, say what was found and return how much."""
    corpus: Path = given.corpus.absolute() / name.replace(" ", "_")
    corpus.mkdir(parents=True, exist_ok=True)
    counted = bench.folder.with_name(COUNTED)
    counted.unlink(missing_ok=True)
    before, began = set(given.keep.glob("*.why.txt")), time.monotonic()
    sys.stdout.flush()
    child = os.fork()  # libFuzzer ends the process
    if child == 0:
        try:
            search(bench, name, given.seconds, corpus, given.keep.absolute())
        except BaseException:  # noqa: BLE001 - of the fuzzer itself
            traceback.print_exc()
            os._exit(2)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    found = sorted(set(given.keep.glob("*.why.txt")) - before)
    for path in found:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        print(f"--- {path}", *(line[:300] for line in lines if line[:1] != " "), sep="\n")
    cases = counted.read_text(encoding="utf-8") if counted.exists() else "0"
    inputs, seconds = sum(1 for _ in corpus.iterdir()), time.monotonic() - began
    if status:
        print(f"{name}: the search ended by itself, {status}: the last input is kept")
        shutil.copy(bench.folder.with_name("last"), given.keep / f"{name.replace(' ', '_')}-last")
    print(f"{name}: {cases} cases, {inputs} inputs kept, {len(found)} failures, {seconds:.0f} s", flush=True)
    return len(found) + (status != 0)


def main() -> int:
    """Search one target after the other; return 1 where something was found."""
    parser = argparse.ArgumentParser(description="Spoilt inputs, guided by what they reach.")
    parser.add_argument("--target", action="append", help="a way in of tests/fuzz/ways_in.py; may be repeated, or all")
    parser.add_argument("--seconds", type=int, default=180, help="for each target")
    parser.add_argument("--survey", type=Path, help="a small survey, adjusted; made where none is given")
    parser.add_argument(
        "--corpus", type=Path, default=Path("fuzz-inputs"), help="folder of inputs that reach new lines"
    )
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"), help="folder for inputs that failed")
    given = parser.parse_args()
    if find_spec("atheris") is None:
        sys.exit("the guided search needs atheris, which is not installed: pip install atheris (Linux)")
    import atheris

    with redirect_stderr(io.StringIO()), atheris.instrument_imports(include=["photogram"], exclude=_unwatched()):
        from watching import check_sound, make_bench
        from ways_in import TARGETS

        from photogram.cli.streams import prepare_streams
    names = list(TARGETS) if given.target in (None, ["all"]) else given.target
    unknown = [name for name in names if name not in TARGETS]
    if unknown:
        sys.exit(f"{unknown[0]!r} is no way in: give one of {', '.join(TARGETS)}")
    prepare_streams()
    given.keep.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="photogram-guided-") as temporary:
        survey = given.survey
        if survey is None:
            survey = Path(temporary) / "adjusted"
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as other:  # threads would not survive a fork
                other.submit(_make_survey, survey).result()
        bench = make_bench(Path(temporary), survey)
        check_sound(bench, {name: TARGETS[name] for name in names})
        return int(sum(_searched(bench, name, given) for name in names) > 0)


if __name__ == "__main__":
    sys.exit(main())
