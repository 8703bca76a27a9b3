"""Mutation testing: whether the tests notice when one operator, number or condition of the sources is changed.

A sample of the changes that cosmic-ray makes, at most one a place, is tried one by one on a copy of the tree:

    python tests/mutants.py --sample 500 --seed 1
    python tests/mutants.py --modules photogram/triangulation.py --tests tests/ground_floor

pytest collects the tests once, and each mutant runs in a fork of that process, its functions given the changed code, so
that most are decided in a second. First it is recorded, also in forks, which test runs which lines and how long it
takes; of each mutant those tests run that execute its line, the quickest first, then others of their files, until
``--seconds`` are used up. A test that takes longer than ``--slowest`` takes no part. Compiled kernels run as Python,
in a session of their own. Code outside of functions is changed in the file, in a new process.

Not sampled: annotations, decorators, ``__all__``, what only type checkers read, strings and what stands in them, and
the words of errors. Replacements are those that mean something to numbers: a minus for a plus, not a bit-shift.

What is done is kept in build/mutants: a second call goes on where the first stopped, and tries survivors on tests that
are new, or that the ``--seconds`` of the first did not reach. Where a test has changed, delete that folder.
"""

from __future__ import annotations

import argparse
import ast
import gc
import hashlib
import importlib
import json
import os
import pkgutil
import random
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from types import CodeType, FunctionType
from typing import Generic, Literal, TypeVar, cast

import pytest

import photogram

ROOT = Path(os.environ.get("PHOTOGRAM_MUTANTS_OF") or Path(__file__).resolve().parents[1])
WORK = ROOT / "build" / "mutants"
TREE = WORK / "tree"
MODULES = (
    *("factors", "photogram/adjustment", "photogram/quality"),
    *("photogram/projection.py", "photogram/triangulation.py"),
)
GROUND_FLOOR = tuple(f"tests/ground_floor/test_{name}.py" for name in ("camera", "projection", "triangulation"))
TESTS = (*GROUND_FLOOR, "tests/lens", "tests/factors", "tests/adjustment", "tests/quality")
TESTS_OF_KERNELS = (*GROUND_FLOOR, "tests/lens", "tests/factors", "tests/adjustment/test_own_velocities.py")
REPLACED = {
    **{"Add": ("Sub",), "Sub": ("Add",), "Mul": ("Div",), "Div": ("Mul",), "Pow": ("Mul",), "FloorDiv": ("Mul",)},
    **{"Mod": ("Mul",), "BitAnd": ("BitOr",), "BitOr": ("BitAnd",), "RShift": ("LShift",), "LShift": ("RShift",)},
    **{"Lt": ("LtE", "GtE"), "LtE": ("Lt", "Gt"), "Gt": ("GtE", "LtE"), "GtE": ("Gt", "Lt")},
    **{"Eq": ("NotEq",), "NotEq": ("Eq",), "Is": ("IsNot",), "IsNot": ("Is",)},
    **{"USub": ("UAdd",), "Delete": ("Not", "Invert")},
}
"""What cosmic-ray puts in the place of an operator, of all that it can."""
OPERATORS = (
    *(f"core/{name}" for name in ("AddNot", "NumberReplacer", "ExceptionReplacer", "ZeroIterationForLoop")),
    *(f"core/Replace{name}" for name in ("AndWithOr", "OrWithAnd", "TrueWithFalse", "FalseWithTrue")),
    *(f"core/Replace{name}" for name in ("BreakWithContinue", "ContinueWithBreak")),
    *(
        f"core/Replace{kind}Operator_{before}_{after}"
        for before, possible in REPLACED.items()
        for after in possible
        for kind in ("Binary", "Unary", "Comparison")
    ),
)
MOST_S = 120  # of one mutant: what takes longer does not end

Outcome = Literal["killed", "survived", "timed out", "failed"]
Session = Literal["compiled", "interpreted", "module"]
SESSIONS: tuple[Session, ...] = ("interpreted", "compiled")
Noted = TypeVar("Noted", "Record", "Result")


@dataclass(frozen=True)
class Mutant:
    """A change: of which file, by which operator of cosmic-ray, at which of its places there, and the line and column
    of that; ``lines`` are those of the statement, ``session`` says how it is run, ``digest`` is that of the file."""

    path: str
    operator: str
    occurrence: int
    line: int
    column: int
    lines: tuple[int, int]
    session: Session
    digest: str

    @property
    def name(self) -> str:
        """Return what tells it apart."""
        what = f"{self.operator.removeprefix('core/')} {self.occurrence}"
        return f"{self.path}:{self.line}:{self.column} {what} of {self.digest}"


def files_of(modules: Iterable[str]) -> list[Path]:
    """Return the sources of folders and files, as paths within the repository."""
    given = [ROOT / module for module in modules]
    found = [file for place in given for file in ([place] if place.suffix == ".py" else sorted(place.rglob("*.py")))]
    return [file.relative_to(ROOT) for file in found]


def sampled(modules: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """Return so many mutants of modules, in random order: of each place at most one."""
    places = [places for file in files_of(modules) for places in _places(file)]
    chance = random.Random(seed)
    chance.shuffle(places)
    return [chance.choice(place) for place in places[:count]]


def _places(file: Path) -> list[list[Mutant]]:
    """Return the mutants of a file, those of one place together."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    text = (ROOT / file).read_text(encoding="utf-8")
    tree, nodes = ast.parse(text), list(ast_nodes(get_ast(text)))
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    left_out, places = list(_left_out(tree)), dict[tuple[int, int], list[Mutant]]()
    around = cache(partial(_surroundings, tree))
    for operator in sorted(set(OPERATORS) & set(operator_names()), key=OPERATORS.index):
        acting = get_operator(operator)()
        starts = [start for node in nodes for start, _ in acting.mutation_positions(node)]
        for occurrence, (line, column) in enumerate(starts):
            if not any(start <= (line, column) < end for start, end in left_out):
                where = (file.as_posix(), operator, occurrence, line, column)
                places.setdefault((line, column), []).append(Mutant(*where, *around(line), digest))
    return [places[place] for place in sorted(places)]


def _left_out(tree: ast.Module) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Yield where there is nothing to be tested: types, decorators, strings, the words of errors."""
    for node in ast.walk(tree):
        for part in _untested(node, node in tree.body):
            if part is not None and part.end_lineno is not None and part.end_col_offset is not None:
                yield (part.lineno, part.col_offset), (part.end_lineno, part.end_col_offset)


def _untested(node: ast.AST, is_of_module: bool) -> Sequence[ast.expr | ast.stmt | None]:
    """Return the parts of a node where there is nothing to be tested."""
    match node:
        case ast.FunctionDef(args=given):
            every = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
            return [*node.decorator_list, node.returns, *(arg.annotation for arg in every if arg is not None)]
        case ast.ClassDef():
            return node.decorator_list
        case ast.AnnAssign():
            return [node.annotation]
        case ast.JoinedStr():
            return [node]
        case ast.Raise(exc=ast.Call(args=given, keywords=named)):
            return [*given, *(keyword.value for keyword in named)]
        case ast.Call(func=ast.Name(id="isinstance" | "cast" | "TypeVar")):
            return node.args
        case ast.Assign(targets=[ast.Name(id="__all__")]) | ast.If(test=ast.Name(id="TYPE_CHECKING")):
            return [node]
        case ast.Assign(value=ast.BinOp() | ast.Subscript() as value) if is_of_module:
            return [value] if any(isinstance(part, ast.Subscript) for part in ast.walk(value)) else []
    return []


def _surroundings(tree: ast.Module, line: int) -> tuple[tuple[int, int], Session]:
    """Return the lines of the innermost statement at a line, without the statements in it, and how it is to be run."""
    statements = [node for node in ast.walk(tree) if isinstance(node, ast.stmt)]
    held = [node for node in statements if node.lineno <= line <= (node.end_lineno or node.lineno)]
    inner = max(held, key=lambda node: node.lineno)
    within = [node.lineno for node in ast.walk(inner) if isinstance(node, ast.stmt) and node is not inner]
    last = min(within) - 1 if within else inner.end_lineno or line
    functions = [node for node in held if isinstance(node, ast.FunctionDef) and node.body[0].lineno <= line]
    of_numba = [node for node in tree.body if isinstance(node, ast.Assign) and "njit(" in ast.unparse(node.value)]
    kernels = ("njit", *(ast.unparse(target) for node in of_numba for target in node.targets))
    marks = [ast.unparse(mark) for node in functions for mark in node.decorator_list]
    compiled = any(mark.startswith(kernels) for mark in marks)
    session: Session = "interpreted" if compiled else "compiled" if functions else "module"
    return (inner.lineno, max(last, inner.lineno)), session


def text_of(mutant: Mutant) -> str:
    """Return the changed source of a mutant's file."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    text = (TREE / mutant.path).read_text(encoding="utf-8")
    return cast(str, mutate_code(text, get_operator(mutant.operator)(), mutant.occurrence))


@dataclass
class Record:
    """What a test takes, in seconds, whether it passes, and which lines of which files it runs."""

    seconds: float
    passed: bool
    lines: dict[str, list[int]]


@dataclass
class Result:
    """What became of a mutant: the test that failed, the seconds that it took, and the tests that were tried."""

    outcome: Outcome
    by: str
    seconds: float
    tests: list[str]


class Notes(Generic[Noted]):
    """A file of lines of JSON, a name and what is known of it in each, the last of a name holding."""

    def __init__(self, path: Path, kind: type[Noted]) -> None:
        self._path = path
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        self.known: dict[str, Noted] = {name: kind(**value) for name, value in map(json.loads, lines)}

    def add(self, name: str, value: Noted) -> None:
        """Note something, at once."""
        self.known[name] = value
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps([name, vars(value)]) + "\n")


def records(kind: Session, modules: Sequence[str]) -> Notes[Record]:
    """Return what is known of the tests and which lines of modules they run, as long as no source changes."""
    texts = [file.read_bytes() for folder in ("photogram", "factors") for file in sorted((TREE / folder).rglob("*.py"))]
    digest = hashlib.sha256(b"".join([*texts, *(module.encode() for module in modules)])).hexdigest()[:16]
    return Notes(WORK / f"tests-{kind}-{digest}.jsonl", Record)


def results() -> Notes[Result]:
    """Return what is known of the mutants."""
    return Notes(WORK / "results.jsonl", Result)


@dataclass(frozen=True)
class Orders:
    """What a session of pytest is told through the environment."""

    session: Session
    mutants: list[Mutant]
    modules: Sequence[str]
    seconds: float
    slowest_s: float


def pytest_runtestloop(session: pytest.Session) -> bool:
    """Run no test here, but each that is wanted in a fork: a hook of pytest, which loads this file as a plugin."""
    told = Orders(**json.loads(os.environ["PHOTOGRAM_MUTANTS"]))
    if session.testsfailed:
        raise session.Interrupted(f"{session.testsfailed} files of tests cannot be read")
    for module in pkgutil.walk_packages(photogram.__path__, "photogram."):
        with suppress(ImportError):  # what is not installed
            importlib.import_module(module.name)
    items, recorded = {item.nodeid: item for item in session.items}, records(told.session, told.modules)
    for name, item in items.items():
        if name not in recorded.known:
            recorded.add(name, _recorded(item, told))
    tests, noted = {name: recorded.known[name] for name in items}, results()
    for given in told.mutants:
        mutant = Mutant(**given)  # type: ignore[arg-type]
        chosen = wanted(mutant, tests, noted, told.seconds)
        if chosen is not None:
            tried = [items[name] for name in chosen]
            _note(noted, mutant, chosen, partial(_in_fork, partial(_first_failing, mutant, tried)))
    return True


def wanted(mutant: Mutant, tests: dict[str, Record], noted: Notes[Result], seconds: float) -> list[str] | None:
    """Return the tests to try on a mutant: those that run its lines, the quickest first, then others of their files;
    where none does, those of files that run its file. Of a test with parameters one comes before the next such test,
    the others after. Together they take so many seconds, but one is always tried. Those that were tried before are
    left out: each call tries survivors on more. Return None where a test has failed before, or none is left."""
    first, last = mutant.lines
    known = noted.known.get(mutant.name)
    if known is not None and known.outcome != "survived":
        return None
    passing = {name: record for name, record in tests.items() if record.passed}
    of_file = [name for name, record in passing.items() if mutant.path in record.lines]
    direct = [name for name in of_file if any(first <= line <= last for line in passing[name].lines[mutant.path])]
    files = {name.split("::")[0] for name in direct or of_file}
    others = [name for name in passing if name.split("::")[0] in files and name not in set(direct)]
    seconds_of = {name: record.seconds for name, record in passing.items()}
    chosen, taken, tried = list[str](), 0.0, set(known.tests if known else [])
    for name in [*_various(direct, seconds_of), *_various(others, seconds_of)]:
        if name in tried:
            continue
        taken += passing[name].seconds
        if chosen and taken > seconds:
            break
        chosen.append(name)
    return chosen if chosen or known is None else None


def _various(tests: Iterable[str], seconds: Mapping[str, float]) -> list[str]:
    """Return tests in the order of their time, but each function once before any with another parameter."""
    ordered, count = sorted(tests, key=lambda name: seconds[name]), Counter[str]()
    turns = list[tuple[int, float, str]]()
    for name in ordered:
        function = name.partition("[")[0]
        turns.append((count[function], seconds[name], name))
        count[function] += 1
    return [name for _, _, name in sorted(turns)]


def _note(noted: Notes[Result], mutant: Mutant, tests: list[str], tried: Callable[[], tuple[Outcome, str]]) -> None:
    """Try a mutant and note what became of it."""
    began = time.monotonic()
    outcome, by = tried()
    took, known = time.monotonic() - began, noted.known.get(mutant.name)
    noted.add(mutant.name, Result(outcome, by, round(took, 1), sorted({*tests, *(known.tests if known else [])})))
    print(f"{outcome:9} {took:6.1f} s {len(tests):4} tests  {mutant.name}  {by}", file=sys.__stderr__, flush=True)


def _run(item: pytest.Item, following: pytest.Item | None) -> bool:
    """Run a test and return whether it passes; one that is skipped does."""
    from _pytest.runner import runtestprotocol

    return not any(report.failed for report in runtestprotocol(item, log=False, nextitem=following))


def _recorded(item: pytest.Item, told: Orders) -> Record:
    """Return the record of a test, run in a fork."""
    tops = [f"{TREE}/{top}{module}" for module in told.modules for top in ("", "photogram/")]
    places = [*tops, *(f"{top}/*" for top in tops)]

    def run() -> tuple[Outcome, str]:
        import coverage

        measured = coverage.Coverage(data_file=None, config_file=False, include=places)
        measured.set_option("run:disable_warnings", ["no-data-collected"])
        began = time.monotonic()
        measured.start()
        passed = _run(item, None)
        measured.stop()
        took, data = time.monotonic() - began, measured.get_data()
        sources = {os.path.relpath(os.path.realpath(file), TREE): data.lines(file) for file in data.measured_files()}
        lines = {file: sorted(of_file or []) for file, of_file in sources.items()}
        return "survived", json.dumps(vars(Record(round(took, 3), passed, lines)))

    outcome, text = _in_fork(run, told.slowest_s)
    return Record(**json.loads(text)) if outcome == "survived" else Record(told.slowest_s, False, {})


def _first_failing(mutant: Mutant, tests: list[pytest.Item]) -> tuple[Outcome, str]:
    """Change the functions of this process, and return the first test that fails."""
    change_code(TREE / mutant.path, text_of(mutant))
    for test, following in zip(tests, [*tests[1:], None], strict=True):
        if not _run(test, following):
            return "killed", test.nodeid
    return "survived", ""


def change_code(file: Path, text: str) -> None:
    """Give the functions of a file, wherever they are referred to, the code of a changed text.

    Raises
    ------
    RuntimeError
        No function has other code by it.
    """
    both = (compile(each, str(file), "exec", dont_inherit=True) for each in (file.read_text(encoding="utf-8"), text))
    becomes = dict(zip(*map(_codes, both), strict=True))
    # no isinstance: it asks what a weak reference stands for, which may be gone
    functions = [each for each in gc.get_objects() if type(each) is FunctionType and each.__code__ in becomes]
    own = [each for each in functions if os.path.realpath(each.__code__.co_filename) == str(file)]
    differing = [each for each in own if becomes[each.__code__] != each.__code__]
    if not differing:
        raise RuntimeError(f"{file}: no function is changed")
    for function in differing:
        function.__code__ = becomes[function.__code__]


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _codes(part)


def _in_fork(work: Callable[[], tuple[Outcome, str]], most_s: float = MOST_S) -> tuple[Outcome, str]:
    """Return what a fork of this process returns; what ends otherwise is killed, what does not end timed out."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.setsid()
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        try:
            said = json.dumps(work())
        except BaseException:  # noqa: BLE001 - or the child would go on as the parent
            said = json.dumps(["failed", traceback.format_exc()])
        with os.fdopen(writing, "w", encoding="utf-8") as pipe:
            pipe.write(said)
        os._exit(0)
    os.close(writing)
    signal.signal(signal.SIGALRM, lambda *_: os.killpg(child, signal.SIGKILL))
    signal.setitimer(signal.ITIMER_REAL, most_s)
    with os.fdopen(reading, encoding="utf-8") as pipe:
        text = pipe.read()
    _, status = os.waitpid(child, 0)
    signal.setitimer(signal.ITIMER_REAL, 0)
    if text:
        outcome, by = json.loads(text)
        return outcome, by
    return ("timed out", "") if status == signal.SIGKILL else ("killed", f"the process ended with status {status}")


def _environment(kind: Session, told: Orders | None = None) -> dict[str, str]:
    """Return the environment of a session of pytest in the copy."""
    return {
        **os.environ,
        "PHOTOGRAM_MUTANTS_OF": str(ROOT),
        "PHOTOGRAM_MUTANTS": json.dumps(asdict(told)) if told else "",
        "PYTHONPATH": os.pathsep.join(str(TREE / folder) for folder in (".", "tests")),
        "PYTHONDONTWRITEBYTECODE": "1",
        "NUMBA_DISABLE_JIT": "1" if kind == "interpreted" else "0",
    }


PYTEST = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--basetemp", str(WORK / "temporary")]


def copy_tree() -> None:
    """Copy what git knows or would, to where it can be changed."""
    shutil.rmtree(TREE, ignore_errors=True)
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    files = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    for file in [name for name in files if name and os.path.lexists(ROOT / name)]:
        (TREE / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / file, TREE / file, follow_symlinks=False)


def try_outside_functions(mutants: list[Mutant], modules: Sequence[str], seconds: float) -> None:
    """Try mutants of module and class level: the file is changed, and pytest started anew."""
    noted = results()
    for mutant in mutants:
        has_kernels = not mutant.path.startswith(("photogram/adjustment", "photogram/quality"))
        kind: Session = "interpreted" if has_kernels else "compiled"
        chosen = wanted(mutant, records(kind, modules).known, noted, seconds)
        if chosen is not None:
            _note(noted, mutant, chosen, partial(_in_file, mutant, kind, chosen))


def _in_file(mutant: Mutant, kind: Session, tests: list[str]) -> tuple[Outcome, str]:
    """Return the outcome of tests with a mutant in its file."""
    if not tests:
        return "survived", ""
    file, text = TREE / mutant.path, (TREE / mutant.path).read_text(encoding="utf-8")
    file.write_text(text_of(mutant), encoding="utf-8")
    run = partial(subprocess.run, cwd=TREE, env=_environment(kind), capture_output=True, text=True, timeout=2 * MOST_S)
    try:
        ended = run([*PYTEST, "-x", *tests])
    except subprocess.TimeoutExpired:
        return "timed out", ""
    finally:
        file.write_text(text, encoding="utf-8")
    failed = [line for line in ended.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return ("killed", failed[0][:200] if failed else "pytest") if ended.returncode else ("survived", "")


def table(mutants: list[Mutant]) -> str:
    """Return what became of mutants, by room, and the survivors."""
    noted, rows = results().known, dict[str, Counter[str]]()
    tried = [mutant for mutant in mutants if mutant.name in noted]
    for mutant in tried:
        for row in (mutant.path.removeprefix("photogram/").partition("/")[0], "together"):
            rows.setdefault(row, Counter())[noted[mutant.name].outcome] += 1
    lines = ["| room | mutants | killed | timed out | survived | noticed |", "|---|---|---|---|---|---|"]
    for room in sorted(rows, key=lambda room: (room == "together", room)):
        of_room = rows[room]
        noticed = (of_room["killed"] + of_room["timed out"]) / of_room.total()
        figures = [of_room.total(), of_room["killed"], of_room["timed out"], of_room["survived"] + of_room["failed"]]
        lines.append(f"| {room} | {' | '.join(map(str, figures))} | {noticed:.1%} |")
    survivors = [mutant for mutant in tried if noted[mutant.name].outcome in ("survived", "failed")]
    for mutant in sorted(survivors, key=lambda mutant: (mutant.path, mutant.line)):
        before, after = (TREE / mutant.path).read_text(encoding="utf-8"), text_of(mutant)
        pairs = zip(before.splitlines(), after.splitlines(), strict=True)
        lines += ["", f"{mutant.path}:{mutant.line}"]
        lines += [f"- {old.strip()}\n+ {new.strip()}" for old, new in pairs if old != new]
    return "\n".join(lines)


def main() -> None:
    """Sample, record, try, and print the table."""
    parser = argparse.ArgumentParser(description="Change the sources in one place at a time: do the tests notice?")
    parser.add_argument("--sample", type=int, default=500, help="how many mutants")
    parser.add_argument("--seed", type=int, default=1, help="of the sample")
    parser.add_argument("--modules", nargs="+", default=MODULES, help="folders and files of sources")
    parser.add_argument("--tests", nargs="+", default=TESTS, help="folders and files of tests")
    parser.add_argument("--seconds", type=float, default=25, help="of tests for each mutant")
    parser.add_argument("--slowest", type=float, default=12, help="seconds of the slowest test that takes part")
    parser.add_argument("--table", action="store_true", help="print what is known, and try nothing")
    asked = parser.parse_args()
    if find_spec("cosmic_ray") is None or find_spec("coverage") is None:
        sys.exit("cosmic-ray makes the mutants and coverage chooses the tests: pip install cosmic-ray coverage")
    if not hasattr(os, "fork"):
        sys.exit("Mutants are tried in forks of a process, which this system does not have. Use Linux or macOS.")
    mutants = sampled(asked.modules, asked.sample, asked.seed)
    if not asked.table:
        WORK.mkdir(parents=True, exist_ok=True)
        copy_tree()
        for kind in SESSIONS:
            own = [mutant for mutant in mutants if mutant.session == kind]
            told = Orders(kind, own, asked.modules, asked.seconds, asked.slowest)
            tests = TESTS_OF_KERNELS if asked.tests is TESTS and kind == "interpreted" else asked.tests
            subprocess.run([*PYTEST, "-p", "mutants", *tests], cwd=TREE, env=_environment(kind, told), check=True)
        try_outside_functions([m for m in mutants if m.session == "module"], asked.modules, asked.seconds)
    print(table(mutants))


if __name__ == "__main__":
    main()
