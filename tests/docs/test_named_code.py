"""What pages say of the code: functions and classes are in the files that they name, and these files are there."""

import ast
import re
from pathlib import Path

import pytest
from pages import PAGES, ROOT, text_of

NAMED_IN = re.compile(r"((?:`\w+`(?:, | and )?)+) in `([\w/]+\.py)`")
FILES = re.compile(
    r"`((?:photogram|factors|cli|benchmarks|tests|docs|examples)/[\w./-]+\.(?:py|md|js|po|jinja|yaml|png))`"
)
TO_BE_WRITTEN = {"docs/how-to-add.md"}
"""Pages that name files that a reader will write."""


def defined_in(path: Path) -> set[str]:
    """Return the names that a module defines at its top, and the methods of its classes."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    assigned = (t for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign) for t in ast.walk(node))
    return names | {t.id for t in assigned if isinstance(t, ast.Name)}


@pytest.mark.parametrize("page", [page for page in PAGES if page not in TO_BE_WRITTEN])
def test_what_a_page_names_is_there(page: str) -> None:
    text = text_of(page)
    assert [path for path in FILES.findall(text) if not (ROOT / path).exists()] == []
    wrong = []
    for names, path in NAMED_IN.findall(text):
        defined = defined_in(ROOT / path)
        wrong += [f"{name} in {path}" for name in re.findall(r"`(\w+)`", names) if name not in defined]
    assert wrong == []


def test_the_steps_of_the_assignment_are_among_them() -> None:
    assert sum(len(re.findall(r"`\w+`", names)) for names, _ in NAMED_IN.findall(text_of("docs/assignment.md"))) > 20
