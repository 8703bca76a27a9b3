"""Which test files a change can reach: by what imports what, read from the sources, nothing being imported.

A test stands on the modules that it names, that its helpers name, that the fixtures and commands it uses stand on, and
on all that these import. A wing counts only where a test itself names it or calls one of its commands; simulation,
which makes the surveys of many tests, only in its own tests. Of a file that is not known, all tests are named.
"""

import ast
import re
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath

import grimp

from photogram.cli.registry import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
ALWAYS = r'rglob\("\*\.py"\)'  # tests that read the sources of every module
DOOR = "photogram"
MAKER = "photogram.simulation"
CONFTEST = "tests/conftest.py"

_IMPORT = re.compile(r"^\s*from\s+(photogram[\w.]*)\s+import\s+(\([^)]*\)|[^\n(]*)", re.MULTILINE)
_DOTTED = re.compile(r"\bphotogram(?:\.\w+)+")
_HELPER = re.compile(r"^\s*(?:from|import)\s+([a-z]\w*(?:\.\w+)*)(?:\s+import\s+(\([^)]*\)|[^\n(]*))?", re.MULTILINE)


def import_graph() -> Mapping[str, frozenset[str]]:
    """Return the modules that each module of photogram imports. Who asks the front door for the version alone does not
    import what it gives out."""
    graph = grimp.build_graph("photogram", cache_dir=str(ROOT / ".import_linter_cache"))
    found = {module: frozenset(graph.find_modules_directly_imported_by(module)) for module in graph.modules}
    return {module: imported - {DOOR} for module, imported in found.items()}


def changed_files(revision: str) -> list[str]:
    """Return the files that differ from where this branch left ``revision``, or are not in git yet.

    Raises
    ------
    subprocess.CalledProcessError
        There is no such revision.
    """

    def lines(*arguments: str) -> list[str]:
        git = ["git", "-c", "core.quotepath=false", *arguments]
        return subprocess.run(git, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()

    [base] = lines("merge-base", revision, "HEAD")
    return [*lines("diff", "--name-only", "--no-renames", base), *lines("ls-files", "--others", "--exclude-standard")]


@dataclass(frozen=True)
class Suite:
    """The tests, and what they stand on: ``texts`` by path of tests, their helpers and benchmarks, ``imported`` as
    ``import_graph`` gives it, ``commands`` as `photogram.cli.registry` names them."""

    texts: Mapping[str, str]
    imported: Mapping[str, frozenset[str]]
    commands: Mapping[str, str]

    def reached_by(self, changed: Iterable[str]) -> list[str] | None:
        """Return the test files that changed files reach, None where it may be any."""
        modules, tests = set[str](), self._mentioning(ALWAYS)
        for path in changed:
            reached = self._of_file(path)
            if reached is None:
                return None
            tests |= reached[0]
            modules |= reached[1]
        modules = self._with_importers(modules)
        tests |= {test for test in self.tests if self.stands_on(test) & modules}
        return sorted(test for test in tests if test in self.texts)

    @cached_property
    def tests(self) -> list[str]:
        """Return the paths of all test files."""
        return [
            path for path in self.texts if path.startswith("tests/") and PurePosixPath(path).name.startswith("test_")
        ]

    def stands_on(self, test: str) -> set[str]:
        """Return the modules that a test names, or uses through helpers, fixtures and commands."""
        helpers, given = self._with_helpers(test) - {test}, set[str]()
        for file in (test, *helpers):
            given |= self._named(self.texts[file])
        for fixture in _parameters(self.texts[test]) & self._fixtures.keys():
            given |= self._fixtures[fixture]
        own = self._named(self.texts[test])
        if not test.startswith(f"tests/{MAKER.rpartition('.')[2]}/"):
            own = {module for module in own if not f"{module}.".startswith(f"{MAKER}.")}
        modules = own | {module for module in given if not self._is_of_wing(module)}
        if "photogram.cli.main" in modules:
            called = [name for name in self.commands if f'"{name}"' in self.texts[test]]
            modules |= {self.commands[name].split(":")[0] for name in called or self.commands}
        return modules

    def _is_of_wing(self, module: str) -> bool:
        """Return whether a module is of a room that brings commands, the command line itself aside."""
        wings = {place.split(".")[1] for place in self.commands.values()} - {"cli"}
        return module.split(".")[1:2] != [] and module.split(".")[1] in wings

    def _of_file(self, path: str) -> tuple[set[str], set[str]] | None:
        """Return the tests and the modules that a changed file is or belongs to, None where that is not known."""
        place, name = PurePosixPath(path), PurePosixPath(path).name
        if path in (CONFTEST, "photogram/__init__.py"):
            return None
        if place.suffix == ".md":
            return self._mentioning(r"\bdocs\b|\.md\b"), set()
        if place.parts[0] in ("photogram", "factors", "cli"):
            module = ".".join(place.with_suffix("").parts).removesuffix(".__init__")
            module = module if place.parts[0] == "photogram" else f"photogram.{module}"
            if place.suffix == ".py":
                return set(), {module}
            room = module.split(".")[:-1]
            while ".".join(room) not in self.imported:
                room = room[:-1]
            own = {m for m in self.imported if m.rpartition(".")[0] == ".".join(room)}
            of_room = {test for test in self.tests if self._named(self.texts[test]) & own}
            return of_room | self._mentioning(re.escape(name)), set()
        if path in self.texts:
            return {test for test in self.tests if path in self._with_helpers(test)}, set()
        mentioned = self._mentioning(re.escape(name))
        return (mentioned, set()) if mentioned and place.parts[0] in ("tests", "examples", "benchmarks") else None

    def _mentioning(self, pattern: str) -> set[str]:
        return {test for test in self.tests if re.search(pattern, self.texts[test])}

    def _with_importers(self, modules: set[str]) -> set[str]:
        """Return modules and all that import one of them, directly or not."""
        reached, ahead = set(modules), list(modules)
        while ahead:
            module = ahead.pop()
            new = {user for user, imported in self.imported.items() if module in imported} - reached
            reached |= new
            ahead += new
        return reached

    def _with_helpers(self, test: str) -> set[str]:
        """Return a test file and the files of tests and benchmarks that it imports, directly or not."""
        files, ahead = {test}, [test]
        while ahead:
            new = self._helpers_of(self.texts[ahead.pop()]) - files
            files |= new
            ahead += new
        return files

    def _helpers_of(self, text: str) -> set[str]:
        files = set[str]()
        for module, names in _HELPER.findall(text):
            dotted = [module, *(f"{module}.{name}" for name in re.findall(r"\w+", names))]
            paths = [f"{folder}/{name.replace('.', '/')}.py" for name in dotted for folder in ("tests", "benchmarks")]
            files |= {path for path in paths if path in self.texts}
        return files

    def _named(self, text: str) -> set[str]:
        """Return the modules that a text imports or names in any other way, such as in the code of another process."""
        modules = {self._module_of(dotted) for dotted in _DOTTED.findall(text)}
        for room, names in _IMPORT.findall(text):
            modules |= {self._module_of(f"{room}.{name}") or room for name in re.findall(r"\w+", names)}
        door = {DOOR} if re.search(r"^\s*import photogram\b(?!\.)", text, re.MULTILINE) else set()
        return {module for module in modules if module is not None} | door

    def _module_of(self, dotted: str) -> str | None:
        """Return the module that a dotted name begins with."""
        while dotted != DOOR and dotted not in self.imported:
            dotted = dotted.rpartition(".")[0] or DOOR
        return dotted if dotted != DOOR else None

    @cached_property
    def _fixtures(self) -> dict[str, set[str]]:
        """Return what the fixtures that all tests share stand on; those that every test has aside."""
        text = self.texts.get(CONFTEST, "")
        tree = ast.parse(text)
        places = {
            alias.asname or alias.name: self._module_of(f"{node.module}.{alias.name}")
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module is not None and node.module.startswith("photogram")
            for alias in node.names
        }
        uses = {
            node.name: {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}
            | {part.arg for part in ast.walk(node) if isinstance(part, ast.arg)}
            for node in tree.body
            if isinstance(node, ast.FunctionDef | ast.ClassDef)
        }
        for name in uses:
            ahead = list(uses[name] & uses.keys())
            while ahead:
                new = uses[ahead.pop()] - uses[name]
                uses[name] |= new
                ahead += new & uses.keys()
        fixtures = {node.name for node in tree.body if isinstance(node, ast.FunctionDef) and _is_named_fixture(node)}
        return {name: {m for u in uses[name] if (m := places.get(u)) is not None} for name in fixtures}


def _parameters(text: str) -> set[str]:
    """Return the names of the parameters of a file's functions, and of the fixtures that it asks for in quotes."""
    asked = re.findall(r"(?:usefixtures|getfixturevalue)\(([^)]*)\)", text)
    quoted = {name for names in asked for name in re.findall(r"\w+", names)}
    return quoted | {node.arg for node in ast.walk(ast.parse(text)) if isinstance(node, ast.arg)}


def _is_named_fixture(node: ast.FunctionDef) -> bool:
    marks = [ast.unparse(mark) for mark in node.decorator_list]
    return any("pytest.fixture" in mark and "autouse" not in mark for mark in marks)


def own_suite() -> Suite:
    """Return the suite of this repository."""
    files = [path for folder in ("tests", "benchmarks") for path in sorted((ROOT / folder).rglob("*.py"))]
    texts = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in files}
    return Suite(texts, import_graph(), COMMANDS)
