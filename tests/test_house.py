"""The rooms of the house: how large they are, what they say of themselves, and where each module is tested."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ("photogram", "factors", "cli")
MOST_MODULES = 15
TABLE = Path(__file__).with_name("covered_by.txt")
PAGES = [*sorted((ROOT / "docs").glob("*.md")), *(ROOT / n for n in ("README.md", "DESIGN.md", "CONTRIBUTING.md"))]


def modules() -> dict[str, Path]:
    """Return the path of every module of the three trees by its dotted name, rooms aside."""
    paths = [p for tree in SOURCES for p in sorted((ROOT / tree).rglob("*.py")) if p.name != "__init__.py"]
    dotted = [".".join(p.relative_to(ROOT).with_suffix("").parts) for p in paths]
    return {n if n.startswith("photogram.") else f"photogram.{n}": p for n, p in zip(dotted, paths, strict=True)}


def rooms() -> list[Path]:
    """Return the __init__.py of every room."""
    return [p for tree in SOURCES for p in sorted((ROOT / tree).rglob("__init__.py"))]


def covered() -> dict[str, list[str]]:
    """Return the table of modules that a test of another name covers: the test, and the module between them if any."""
    rows = [line.split() for line in TABLE.read_text(encoding="utf-8").splitlines() if line and line[0] != "#"]
    return {module: rest for module, *rest in rows}


def imports(path: Path, name: str) -> bool:
    """Return whether a file imports a module."""
    text, (parent, _, module) = path.read_text(encoding="utf-8"), name.rpartition(".")
    return re.search(rf"\b{re.escape(name)}\b|from {re.escape(parent)} import [^\n]*\b{module}\b", text) is not None


def own_tests(name: str) -> list[Path]:
    """Return the tests that bear a module's name, in the folder of its room."""
    parts = name.split(".")[1:]
    folder = parts[0] if len(parts) > 1 else "ground_floor"
    return [p for p in (ROOT / "tests" / folder).glob("test_*.py") if p.stem == f"test_{parts[-1]}"]


@pytest.mark.parametrize("room", rooms(), ids=lambda p: p.parent.relative_to(ROOT).as_posix())
def test_a_room_is_small_and_says_what_it_is_for(room: Path) -> None:
    held = [p for p in room.parent.glob("*.py") if p.name != "__init__.py"]
    assert len(held) <= MOST_MODULES
    text = ast.get_docstring(ast.parse(room.read_text(encoding="utf-8")))
    assert text is not None
    if room.parent.name == "photogram":
        return
    assert len(text.splitlines()) == 4, "a line for what it is, an empty one, what it must not do, where to enter"
    name = ".".join(room.parent.relative_to(ROOT).parts)
    package = name if name.startswith("photogram") else f"photogram.{name}"
    for entry in re.findall(r"`([\w.]+)`", text.splitlines()[-1]):
        module, *definition = entry.split(".")
        found = importlib.import_module(f"{package}.{module}")
        assert not definition or hasattr(found, definition[0]), entry


@pytest.mark.parametrize("name", modules())
def test_every_module_has_a_test_of_its_name_or_stands_in_the_table(name: str) -> None:
    table = covered()
    if own_tests(name):
        assert name not in table, "the table lists what has no test of its name"
        return
    assert name in table, f"write tests/<room>/test_{name.split('.')[-1]}.py, or name the test that covers it"
    test, *between = table[name]
    assert (ROOT / test).is_file()
    if name.startswith("photogram.cli.commands."):
        return  # run as a command
    for user in between:
        assert imports(modules()[user], name)
    assert between or imports(ROOT / test, name)


def test_the_table_lists_no_module_that_is_gone() -> None:
    assert set(covered()) <= set(modules())


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_paths_of_modules_in_the_docs_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    paths = set(re.findall(r"(?<![\w/.])((?:photogram|factors|cli|tests|benchmarks)/[\w/]+\.py)\b", text))
    assert [p for p in sorted(paths) if not (ROOT / p).is_file()] == []
    dotted = set(re.findall(r"(?<![\w/])(photogram(?:\.[a-z_]\w*)+)", text))
    assert [d for d in sorted(dotted) if not resolves(d)] == []


def resolves(dotted: str) -> bool:
    """Return whether a dotted name is a module, a room, or something that one of them defines."""
    parts = dotted.split(".")
    if parts[-1] in ("yaml", "py", "json", "egg", "lock", "txt"):
        return True
    for count in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False
