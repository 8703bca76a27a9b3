"""The catalogs: every message in every language with its placeholders, none that nobody says, no text beside them."""

import io
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from string import Formatter

import pytest
from babel.messages.catalog import Message
from babel.messages.pofile import read_po
from jinja2 import Environment, nodes
from messages import ROOT, catalog, said, text_of, updated

from photogram.languages.codes import CODES, LOCALES, LanguageCode

OTHERS: list[LanguageCode] = [code for code in CODES if code != "en"]
SAME_WORDS = 4
"""Of a message, from which it cannot be the same in two languages by chance."""


def forms(message: Message) -> list[tuple[str, str]]:
    """Return each form of a message in a language with the English one that it stands for."""
    if isinstance(message.id, str):
        return [(message.id, str(message.string))]
    assert isinstance(message.string, tuple)
    return [(message.id[min(k, 1)], text) for k, text in enumerate(message.string)]


def placeholders(text: str) -> set[str]:
    return {name for _, name, *_ in Formatter().parse(text) if name is not None}


def test_messages_are_found() -> None:
    """The referee of the tests below: code, templates and tables are searched."""
    messages = said()
    assert len(messages) > 250
    assert "All figures of the report" in messages
    assert "photogram/report/templates/client.jinja" in messages["Place and date"]
    assert any(isinstance(message, tuple) for message in messages)


@pytest.mark.parametrize("code", OTHERS)
def test_every_message_is_in_every_language_and_no_other(code: LanguageCode) -> None:
    kept = {message.id: message for message in catalog(code) if message.id}
    assert set(kept) - set(said()) == set(), "run python tests/messages.py"
    assert set(said()) - set(kept) == set(), "run python tests/messages.py, and translate what is new"
    empty = [english for message in kept.values() for english, text in forms(message) if not text.strip()]
    assert empty == []
    counted = [message for message in kept.values() if not isinstance(message.id, str)]
    assert {len(forms(message)) for message in counted} == {2}
    assert not any(message.fuzzy for message in kept.values())


@pytest.mark.parametrize("code", OTHERS)
def test_every_message_has_the_placeholders_of_the_english_one(code: LanguageCode) -> None:
    for message in catalog(code):
        for english, text in forms(message) if message.id else ():
            assert placeholders(text) == placeholders(english), (code, english)
            assert text.endswith(".") == english.endswith("."), (code, english)


@pytest.mark.parametrize("code", OTHERS)
def test_messages_are_translated(code: LanguageCode) -> None:
    same = [english for message in catalog(code) if message.id for english, text in forms(message) if text == english]
    assert [english for english in same if len(re.findall(r"\b[a-z]+\b", english)) >= SAME_WORDS] == []


@pytest.mark.parametrize("code", OTHERS)
def test_a_catalog_that_is_written_anew_says_the_same(code: LanguageCode) -> None:
    kept = {message.id: message.string for message in catalog(code) if message.id}
    again = read_po(io.BytesIO(text_of(updated(code)).encode("utf-8")), locale=LOCALES[code])
    assert {message.id: message.string for message in again if message.id} == kept
    assert again.num_plurals == 2


class _Texts(HTMLParser):
    """What a page shows and says: its texts, and attributes that are read aloud or shown."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, _tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value or "" for name, value in attrs if name in ("alt", "title", "aria-label", "data-label")]

    def handle_data(self, data: str) -> None:
        self.found.append(data)


def shown_texts(node: nodes.Node) -> Iterator[str]:
    """Return the texts that an expression of a template shows as they stand: no keys, and no arguments of calls."""
    if isinstance(node, nodes.Const):
        yield str(node.value)
    elif not isinstance(node, nodes.Call | nodes.Compare | nodes.Getitem | nodes.TemplateData):
        for child in node.iter_child_nodes(exclude=("args", "test")):
            yield from shown_texts(child)


def words_beside(text: str) -> list[str]:
    """Return the words that a template shows and takes from no catalog."""
    tree = Environment(trim_blocks=True, lstrip_blocks=True).parse(text)
    page = _Texts()
    page.feed("".join(part.data for part in tree.find_all(nodes.TemplateData)))
    words = [word for part in page.found for word in re.findall(r"[^\W\d_]{2,}", part)]
    constants = [text for output in tree.find_all(nodes.Output) for text in shown_texts(output)]
    return words + [text for text in constants if re.match(r"[A-Z]", text) or re.search(r"[a-z]{2,} [a-z]{2,}", text)]


def test_no_text_of_the_clients_part_stands_beside_the_catalogs() -> None:
    folder = ROOT / "photogram/report/templates"
    assert words_beside((folder / "client.jinja").read_text(encoding="utf-8")) == []
    verdict, _, _ = (folder / "verdict.jinja").read_text(encoding="utf-8").partition("<nav")
    assert words_beside(verdict) == []
    margins = re.sub(r"{{.*?}}", "", (folder / "print.css.jinja").read_text(encoding="utf-8"))
    assert '"' not in margins


@pytest.mark.parametrize(
    "text",
    [
        "<p>{{ gettext('A') }} beside it</p>",
        '<td data-label="Area">{{ x }}</td>',
        '{{ "Plan" if x else gettext("Plan") }}',
        '{{ ("plan of it" if x else "") | e }}',
    ],
)
def test_a_text_beside_the_catalogs_is_found(text: str) -> None:
    assert words_beside(text) != []
