"""Messages of pages in the browser, and what a browser is given of a language."""

import re
from pathlib import Path

import pytest
from messages import PAGES, ROOT, catalog

from photogram.languages.codes import CODES
from photogram.languages.language import Language
from photogram.languages.pages import (
    ATTRIBUTES,
    html_messages,
    language_names,
    messages_of_page,
    page_words,
    preferred,
    script_messages,
)

WORDS_JS = ROOT / "photogram/loopback/words.js"
SCRIPTS = [path for page in PAGES for path in sorted((ROOT / page).glob("*.js"))]
CALL = re.compile(r"(?<![\w.$])(n?t)\(\s*(?P<first>[^\s)])")


def test_messages_of_html_are_texts_and_attributes() -> None:
    html = (
        "<html><head><title>photogram</title><style>p { color: red }</style></head><body>"
        '<p title="Key T">Find  \n targets<br><input placeholder="from the tags"> now</p><b>3-D</b>'
        '<div translate="no"><p aria-label="not this">nor this</p></div><p>but this</p></body></html>'
    )
    assert html_messages(html) == ["Key T", "Find targets", "from the tags", "now", "but this"]


def test_messages_of_scripts_are_literals_of_two_functions() -> None:
    script = (
        'const a = t("One {name}.", { name }), b = `${t("Within")} ${nt("{n} thing", "{n} things", n)}`;\n'
        'part("no"); x.map(t => t * 2); Math.cos(t); // t("a comment")\n'
    )
    assert list(script_messages(script.encode())) == ["One {name}.", "Within", ("{n} thing", "{n} things")]


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_every_message_of_a_script_is_a_literal(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert [m[0] for m in CALL.finditer(text) if m["first"] != '"'] == []
    said = [m for m in CALL.finditer(text) if m["first"] == '"']
    assert len(said) == len(list(script_messages(text.encode()))), "the extractor misses some"
    assert not said or "./words.js" in text


def test_a_page_and_its_browser_take_the_same_texts() -> None:
    """The module that says them in the browser names the same attributes."""
    line = next(line for line in WORDS_JS.read_text().splitlines() if line.startswith("const ATTRIBUTES"))
    assert tuple(re.findall(r'"([^"]+)"', line)) == ATTRIBUTES


@pytest.mark.parametrize("page", PAGES)
def test_a_browser_is_given_the_messages_of_its_page_alone(page: str) -> None:
    said = messages_of_page(ROOT / page)
    given = page_words(ROOT / page, Language("de"))
    assert set(given["messages"]) == {m if isinstance(m, str) else m[0] for m in said}
    assert (given["code"], given["tag"]) == ("de", "de")
    assert len(given["messages"]) < len(catalog("de"))
    assert page_words(ROOT / page, Language())["messages"] == {}


def test_what_is_counted_has_two_forms() -> None:
    given = page_words(ROOT / PAGES[0], Language("fr"))["messages"]
    assert given["{n} photograph"] == ["{n} photographie", "{n} photographies"]


def test_languages_call_themselves_by_name() -> None:
    assert [one["name"] for one in language_names()] == ["English", "Deutsch", "Español", "Português", "Français"]
    assert [one["code"] for one in language_names()] == list(CODES)


@pytest.mark.parametrize(
    ("accepted", "code"),
    [
        ("de-AT,de;q=0.9,en;q=0.8", "de"),
        ("nl,pt-BR;q=0.7,en;q=0.9", "en"),
        ("pt", "pt"),
        ("fr;q=0,es", "es"),
        ("nl", "en"),
        ("", "en"),
        ("*", "en"),
        ("de;q=x", "en"),
    ],
)
def test_the_first_language_that_a_browser_accepts(accepted: str, code: str) -> None:
    assert preferred(accepted).code == code
