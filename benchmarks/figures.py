"""Run the benchmarks whose figures the documentation shows, one after the other, and write what they print.

    python benchmarks/figures.py [--only NAME] [--list]             or: make figures [ONLY=name]
    python benchmarks/figures.py --compare COMMIT [--only NAME]     or: make figures COMPARE=v0.3.0 [ONLY=name]

The commands are those that the pages name: `<!-- figures: benchmarks/NAME.py … -->`; the last one is all tests, with
all seeds of their statistics. What a command printed is kept in build/figures/ under a digest of the sources: a second
call goes on where the first one stopped, and after a change of the sources all run again. Everything goes to
docs/figures.json, with the seconds that it took, from which the next call says how long it will take. Between
`<!-- printed: COMMAND -->` and `<!-- end of printed -->` a page gets what the command printed. Tables made by hand stay
as they are: commands that print other figures than in docs/figures.json are listed with the pages to correct, and
what moved, cell by cell. With `--compare` nothing is written: the commands that both have run here and in a checkout of
COMMIT, over the same seeds, and what moved is printed.
"""

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypedDict

from lib.moved import moved
from lib.study import PrintedTable, tables_of

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ("photogram", "factors", "cli", "benchmarks")
TESTS = "tests/suite.py"
ALL_SEEDS = {"PHOTOGRAM_SEEDS": "all"}
_MARKER = re.compile(r"<!-- figures: (.*?) -->")
_COMMAND = re.compile(r"(?:python )?(benchmarks/\w+\.py(?: .*)?)")
_PRINTED = re.compile(r"(<!-- printed: (.*?) -->\n\n).*?(\n<!-- end of printed -->)", re.DOTALL)


class Printed(TypedDict):
    """What a command printed: lines outside of tables, tables, the seconds it took, and the digest of its sources."""

    lines: list[str]
    tables: list[PrintedTable]
    seconds: float
    sources: str


def commands_of(pages: Iterable[Path]) -> dict[str, list[str]]:
    """Return the benchmarks' commands that pages name, each with the names of its pages; the tests come last."""
    found: dict[str, list[str]] = defaultdict(list)
    for page in pages:
        for marker in _MARKER.finditer(page.read_text(encoding="utf-8")):
            for part in marker[1].split(", "):
                command = _COMMAND.fullmatch(part)
                if command is not None and page.name not in found[command[1]]:
                    found[command[1]].append(page.name)
    return {**found, TESTS: []}


def sources_digest(root: Path) -> str:
    """Return a digest of all sources that figures depend on."""
    digest = hashlib.sha256()
    files = (path for folder in SOURCES for path in (root / folder).rglob("*.py"))
    for path in sorted(files):
        digest.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def printed(root: Path, command: str, folder: Path) -> Printed:
    """Return what a command prints, from ``folder`` if it is there. Raises CalledProcessError where it fails."""
    kept = folder / (re.sub(r"\W+", "_", command) + ".json")
    if not kept.is_file():
        environment = {**os.environ, "PYTHONPATH": str(root), **(ALL_SEEDS if command == TESTS else {})}
        began = time.monotonic()
        done = subprocess.run(
            [sys.executable, *command.split()], cwd=root, env=environment, stdout=subprocess.PIPE, text=True, check=True
        )
        lines = [line for line in done.stdout.splitlines() if line.strip() and not line.startswith("|")]
        found: Printed = {
            "lines": lines,
            "tables": tables_of(done.stdout),
            "seconds": round(time.monotonic() - began, 1),
            "sources": folder.name,
        }
        folder.mkdir(parents=True, exist_ok=True)
        kept.with_suffix(".txt").write_text(done.stdout, encoding="utf-8")
        kept.write_text(json.dumps(found, ensure_ascii=False), encoding="utf-8")
    stored: Printed = json.loads(kept.read_text(encoding="utf-8"))
    return stored


def markdown(found: Printed) -> str:
    """Return what was printed as a page has it: the lines, then the tables."""
    parts = [" ".join(found["lines"])] if found["tables"] else ["```text\n" + "\n".join(found["lines"]) + "\n```"]
    for table in found["tables"]:
        rows = [table["columns"], ["---"] * len(table["columns"]), *table["rows"]]
        parts.append("\n".join("| " + " | ".join(row) + " |" for row in rows))
    return "\n\n".join(part for part in parts if part) + "\n"


def with_printed(text: str, figures: dict[str, Printed]) -> str:
    """Return a page with what its commands printed; other commands' parts stay as they are."""

    def part(match: re.Match[str]) -> str:
        return match[1] + markdown(figures[match[2]]) + match[3] if match[2] in figures else match[0]

    return _PRINTED.sub(part, text)


def says_otherwise(before: Printed | None, after: Printed) -> bool:
    """Return whether a command printed other figures than before, or did so for the first time."""
    return before is None or (before["tables"], before["lines"]) != (after["tables"], after["lines"])


def estimate(commands: Iterable[str], figures: dict[str, Printed]) -> str:
    """Return how long commands took the last time, as a sentence."""
    known = [figures[command]["seconds"] for command in commands if command in figures]
    new = sum(command not in figures for command in commands)
    many = "command" if len(known) == 1 else "commands"
    return f"{len(known)} {many} took {sum(known) / 60.0:.0f} minutes the last time; {new} were not timed yet"


def write_figures(root: Path, only: str = "", show: bool = False) -> list[str]:
    """Run the commands whose text has ``only`` in it, or list them, and write pages and JSON. Returns what failed."""
    docs, digest = root / "docs", sources_digest(root)
    pages, path = sorted(docs.glob("*.md")), docs / "figures.json"
    commands = {command: names for command, names in commands_of(pages).items() if only in command}
    figures: dict[str, Printed] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    print(estimate(list(commands), figures))
    failures = []
    for number, (command, names) in enumerate(commands.items(), start=1):
        print(f"{number} of {len(commands)}: {command}", flush=True)
        if show:
            continue
        try:
            found = printed(root, command, root / "build" / "figures" / digest)
        except subprocess.CalledProcessError as failure:
            failures.append(f"{command} ended with {failure.returncode}")
            continue
        if says_otherwise(figures.get(command), found):
            print(f"  new figures, {found['seconds']:.0f} s; compare the tables of: {', '.join(names) or 'no page'}")
            print_moved(figures.get(command), found)
        figures[command] = found
        text = json.dumps(dict(sorted(figures.items())), ensure_ascii=False, indent=1)
        path.write_text(text + "\n", encoding="utf-8")
        for page in pages:
            page.write_text(with_printed(page.read_text(encoding="utf-8"), figures), encoding="utf-8")
    return failures


def print_moved(before: Printed | None, after: Printed) -> None:
    """Print what a command says otherwise than before."""
    for change in [] if before is None else moved(before["tables"], after["tables"]):
        print(f"  {change.sentence}")


@contextmanager
def checked_out(root: Path, commit: str) -> Iterator[Path]:
    """Give the sources of a commit in a folder of their own. Raises CalledProcessError where there is no such one."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / root.name
        subprocess.run(["git", "worktree", "add", "--detach", "--quiet", folder, commit], cwd=root, check=True)
        try:
            yield folder
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", folder], cwd=root, check=True)


def compare_figures(root: Path, commit: str, only: str = "") -> list[str]:
    """Run the commands whose text has ``only`` in it here and at a commit, and print what moved. Returns what
    failed."""
    commands = [command for command in commands_of(sorted((root / "docs").glob("*.md"))) if only in command]
    failures, digest = list[str](), sources_digest(root)
    with checked_out(root, commit) as earlier:
        earlier_digest = sources_digest(earlier)
        for number, command in enumerate(commands, start=1):
            print(f"{number} of {len(commands)}: {command}", flush=True)
            if not (earlier / command.split()[0]).is_file():
                print(f"  not there at {commit}")
                continue
            try:
                before = printed(earlier, command, root / "build" / "figures" / earlier_digest)
                after = printed(root, command, root / "build" / "figures" / digest)
            except subprocess.CalledProcessError as failure:
                failures.append(f"{command} ended with {failure.returncode}")
                continue
            print_moved(before, after)
    return failures


def main() -> int:
    """Write or compare the figures, and return 1 where a command failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", metavar="NAME", help="commands with this in their text alone")
    parser.add_argument("--list", action="store_true", help="say what would be run")
    parser.add_argument("--compare", metavar="COMMIT", help="run all here and at a commit, and say what moved")
    given = parser.parse_args()
    if given.compare:
        failures = compare_figures(ROOT, given.compare, given.only)
    else:
        failures = write_figures(ROOT, given.only, given.list)
    print("".join(f"failed: {failure}\n" for failure in failures), end="")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
