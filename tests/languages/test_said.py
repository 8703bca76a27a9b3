"""Texts that are said in English until they are asked for in a language."""

import ast
from copy import deepcopy

import pytest
from messages import ROOT, said

from photogram.errors import SettingError, WorkspaceError
from photogram.languages.language import Language
from photogram.languages.said import Figures, Said, in_language, said_of, some_of

GERMAN = Language("de")


def test_what_is_said_is_english_text() -> None:
    area = Said("Seen by two photographs or more: {two}; by three: {three}; by five: {five}.", two=1, three=2, five=3)
    assert area == "Seen by two photographs or more: 1; by three: 2; by five: 3."
    assert Said.plural("{n} mark", "{n} marks", 1) == "1 mark"
    assert Said.plural("{n} mark", "{n} marks", 2) == "2 marks"


def test_it_is_asked_for_in_a_language_with_its_figures_lists_and_parts() -> None:
    sigma = Figures("1.2 m")
    known = Said.plural("{n} mark, sigma of the point {sigma}", "{n} marks, sigma of the point {sigma}", 3, sigma=sigma)
    assert known.in_language(GERMAN) == "3 Marken, Sigma des Punktes 1,2 m"
    assert Said("{words}: more gain little", words=known).in_language(GERMAN) == (
        "3 Marken, Sigma des Punktes 1,2 m: weitere bringen wenig"
    )
    weak = Said.plural(
        "Weak on one side, {sides}: fewer than {least} photographs see most of that edge of the survey.",
        "Weak on {n} sides, {sides}: fewer than {least} photographs see most of these edges of the survey.",
        2, sides=[Said("north"), Said("west")], least=5,
    )  # fmt: skip
    assert "2 sides, north and west:" in weak
    assert "an 2 Seiten, Nord und West:" in weak.in_language(GERMAN)
    assert some_of(list("abc"), 1) == "a and 2 more"
    assert Said("{file} of the results", file=some_of(list("abc"), 1)).in_language(GERMAN).startswith("a und noch 2")


def test_what_no_catalog_has_is_said_in_english() -> None:
    assert Said("no catalog has {this}", this=Figures("1.5")).in_language(GERMAN) == "no catalog has 1.5"


def test_what_is_sent_is_in_one_language_and_all_else_as_it_is() -> None:
    content = {"severity": "note", "text": Said("none"), "values": [1.5, 2.5], "rows": [["a", Said("surface")], None]}
    assert in_language(content, Language()) is content
    there = {"severity": "note", "text": "ohne", "values": [1.5, 2.5], "rows": [["a", "Oberfläche"], None]}
    assert in_language(content, GERMAN) == there
    assert in_language(deepcopy(content), GERMAN) == there


def test_an_error_says_what_it_says() -> None:
    there_is_none = Said("no survey is open: choose a folder first")
    assert said_of(WorkspaceError(there_is_none)) is there_is_none
    assert said_of(SettingError("path", there_is_none)) is there_is_none
    assert str(SettingError("path", there_is_none)).startswith("path: no survey")
    assert said_of(WorkspaceError("by the engine")) is None


def messages_of(call: ast.Call) -> list[str | None]:
    """Return the messages of a call of Said, None for what is no literal."""
    counted = isinstance(call.func, ast.Attribute)
    return [arg.value if isinstance(arg, ast.Constant) else None for arg in call.args[: 1 + counted]]  # type: ignore[misc]


def calls(tree: ast.AST) -> list[ast.Call]:
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            function = node.func.value if isinstance(node.func, ast.Attribute) else node.func
            if isinstance(function, ast.Name) and function.id == "Said":
                found.append(node)
    return found


def test_every_message_that_is_said_is_found_for_the_catalogs() -> None:
    """A second reader of the code: whatever surrounds a call, the extractor must not miss its message."""
    known = said()
    flat = {part for message in known for part in ((message,) if isinstance(message, str) else message)}
    literal = []
    for path in sorted((ROOT / "photogram").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "Said" in text and path.name != "said.py":
            literal += [m for call in calls(ast.parse(text)) for m in messages_of(call) if m is not None]
    assert len(literal) > 150
    assert [message for message in literal if message not in flat] == []


@pytest.mark.parametrize("text", ["Said(name)", "Said(f'{a} b')"])
def test_the_second_reader_knows_what_is_no_literal(text: str) -> None:
    assert messages_of(calls(ast.parse(text))[0]) == [None]
