"""Remedies stand alone under What to do: each is a whole sentence with its subject."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import photogram.report.numbers.ranked_warnings as module
from photogram.quality.asprs import STATE_SURVEY

ALONE = re.compile(r"\b(them|they|their|there|it|its)\b")


def texts(node: ast.AST) -> str:
    """Return the words of a string, of an f-string those between its figures."""
    parts = (n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str))
    return " … ".join(parts)


def remedies() -> Iterator[str]:
    """Yield every remedy that is written in the module: what a name `remedy` becomes, and what warnings are made
    with."""
    tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and any(getattr(t, "id", "") == "remedy" for t in node.targets):
            yield texts(node.value)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("_warning", "_several"):
            yield from (texts(k.value) for k in node.keywords if k.arg == "remedy")
            yield from (texts(argument) for argument in node.args[3:])
    yield STATE_SURVEY


def test_remedies_name_what_is_to_be_done_to_what() -> None:
    found = [text for text in remedies() if text]
    assert len(found) > 12
    allowed = ("check the marks of their points", "remove that measurement if it is wrong")
    for text in found:
        rest = text
        for words in allowed:  # of what is named just before
            rest = rest.replace(words, "")
        assert not ALONE.search(rest), text
