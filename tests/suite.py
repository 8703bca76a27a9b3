"""What `make test` runs: ruff, then the tests, or those that a change reaches, with mypy and import-linter beside them.

python tests/suite.py [--changed REVISION] [options of pytest]
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from selection import ROOT, changed_files, own_suite

Commands = tuple[tuple[str, ...], ...]

BIN = Path(sys.executable).parent
RUFF: Commands = (("ruff", "check", "."), ("ruff", "format", "--check", "."))
BESIDE: Commands = (("mypy",), ("lint-imports",))
# two workers keep two cores busy, and threads of BLAS only wait for each other: with one of them an adjustment takes
# 0.6 of the processor time; the order of the files is that of conftest.py
PYTEST: tuple[str, ...] = ("pytest", "-n", "2", "--dist", "loadfile", "--no-loadscope-reorder", "--durations", "30")
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def called(command: Sequence[str]) -> list[str]:
    """Return a command with the path of its program."""
    return [str(BIN / command[0]), *command[1:]]


def selected(revision: str) -> list[str]:
    """Return the test files for what has changed since a revision, none where it may be all, and say which."""
    changed, suite = changed_files(revision), own_suite()
    tests = suite.reached_by(changed)
    count = "all" if tests is None else f"{len(tests)} of {len(suite.tests)}"
    print(f"{len(changed)} files have changed since {revision}: {count} test files", flush=True)  # noqa: T201
    return tests or []


def main() -> int:
    """Run all that is asked for, and return 0 if nothing fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--changed", metavar="REVISION", help="run only tests that changes since there can reach")
    given, options = parser.parse_known_args()
    for command in RUFF:
        if subprocess.run(called(command), cwd=ROOT).returncode:
            return 1
    tests = selected(given.changed) if given.changed else []
    beside = [
        subprocess.Popen(
            ["nice", *called(command)], cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        for command in BESIDE
    ]
    testing = called((*PYTEST, *options, *tests))
    ends = {PYTEST[0]: subprocess.run(testing, cwd=ROOT, env=os.environ | ONE_THREAD).returncode}
    for command, process in zip(BESIDE, beside, strict=True):
        said, _ = process.communicate()
        print(f"{command[0]}:\n{said}", flush=True)  # noqa: T201
        ends[command[0]] = process.returncode
    failed = [name for name, end in ends.items() if end]
    print(f"failed: {', '.join(failed)}" if failed else "ruff, pytest, mypy and import-linter: passed")  # noqa: T201
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
