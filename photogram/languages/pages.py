"""Pages in the browser: which messages their files say, and what the browser needs of a language to say them.

A page is a folder with an `index.html` and modules of JavaScript. In these a message stands in ``t("…")`` or
``nt("one", "several", n)``; of the HTML it is every text with a word in it, and every attribute that is shown or read
aloud, unless an element says ``translate="no"``; the title of the window is a name.
"""

import io
import re
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

from babel import Locale
from babel.messages.extract import extract
from typing_extensions import TypedDict

from photogram.languages.codes import CODES, LOCALES, LanguageCode
from photogram.languages.language import Language

Id = str | tuple[str, str]
"""A message, or the two of one that goes with a count."""

ATTRIBUTES = ("aria-label", "title", "placeholder", "alt")
"""That are shown or read aloud."""

_KEYWORDS = {"t": None, "nt": (1, 2)}
_WORD = re.compile(r"[^\W\d_]{2,}")
_VOID = ("area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "track", "wbr")
_SILENT = ("script", "style", "title")


class LanguageName(TypedDict):
    """A language that can be chosen."""

    code: LanguageCode
    name: str
    """As it calls itself."""


class PageWords(TypedDict):
    """What a page says in a language."""

    code: LanguageCode
    tag: str
    """What HTML and Intl call it."""
    languages: list[LanguageName]
    messages: dict[str, str | list[str]]
    """By the English text; two forms of what is counted, by that for one."""


@cache
def messages_of_page(folder: Path) -> tuple[Id, ...]:
    """Return the messages that the files of a page say, each once."""
    found: dict[Id, None] = dict.fromkeys(html_messages((folder / "index.html").read_text(encoding="utf-8")))
    for path in sorted(folder.glob("*.js")):
        found |= dict.fromkeys(script_messages(path.read_bytes()))
    return tuple(found)


def script_messages(script: bytes) -> Iterator[Id]:
    """Return the messages of a module of JavaScript."""
    for _, found, _, _ in extract("javascript", io.BytesIO(script), _KEYWORDS, (), {"parse_template_string": True}):
        if isinstance(found, str):
            yield found
        elif found[0] and found[1]:
            yield found[0], found[1]


def html_messages(html: str) -> list[str]:
    """Return the messages of a page's HTML."""
    parser = _Texts()
    parser.feed(html)
    return parser.found


class _Texts(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self._kept: list[bool] = []
        """Of the elements that are open: whether what they hold is left as it is."""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        kept = any(self._kept[-1:]) or given.get("translate") == "no" or tag in _SILENT
        if not kept:
            for name in ATTRIBUTES:
                self._take(given.get(name) or "")
        if tag not in _VOID:
            self._kept.append(kept)

    def handle_endtag(self, _tag: str) -> None:
        self._kept.pop()

    def handle_data(self, data: str) -> None:
        if not any(self._kept[-1:]):
            self._take(" ".join(data.split()))

    def _take(self, text: str) -> None:
        if _WORD.search(text):
            self.found.append(text)


def page_words(folder: Path, language: Language) -> PageWords:
    """Return what the page of a folder says in a language; a message that its catalog lacks is left out."""
    messages: dict[str, str | list[str]] = {}
    for message in () if language.is_english else messages_of_page(folder):
        try:
            if isinstance(message, str):
                messages[message] = language.message(message)
            else:
                messages[message[0]] = [language.counted_message(*message, count) for count in (1, 2)]
        except LookupError:
            continue  # the page says it in English, and a test that the catalog lacks it
    return {"code": language.code, "tag": language.tag, "languages": language_names(), "messages": messages}


def language_names() -> list[LanguageName]:
    """Return the languages there are, as they call themselves."""
    names = {code: str(Locale(code).get_display_name(code)) for code in CODES}
    return [{"code": code, "name": name[:1].upper() + name[1:]} for code, name in names.items()]


def preferred(accepted: str) -> Language:
    """Return the first language there is of those that a browser accepts (Accept-Language), English without any."""
    ranked = []
    for number, part in enumerate(accepted.split(",")):
        name, _, parameter = part.strip().partition(";")
        match = re.fullmatch(r"\s*q=([01](?:\.\d{0,3})?)\s*", parameter)
        weight = float(match[1]) if match else 0.0 if parameter else 1.0
        ranked.append((-weight, number, name.strip().lower().partition("-")[0]))
    wanted = [name for weight, _, name in sorted(ranked) if weight < 0.0]
    return Language(next((code for name in wanted for code in LOCALES if code == name), "en"))
