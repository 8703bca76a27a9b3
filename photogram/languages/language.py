"""A language: messages from its catalog, and how it writes figures, dates and lists.

A message is a whole sentence or phrase in English with named placeholders, and is looked up by that text in
``<code>.po``, a catalog of gettext. Thousands stand apart by a thin space in every language, as ISO 80000 has it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from functools import cache, reduce
from gettext import NullTranslations
from importlib.resources import files
from io import BytesIO
from typing import NoReturn

from babel import Locale
from babel.dates import format_date
from babel.lists import format_list
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po
from babel.numbers import get_decimal_symbol
from babel.support import Translations

from photogram.languages.codes import LOCALES, LanguageCode
from photogram.wording import THIN_SPACE

MOST_LISTED = 5


class _Untranslated(NullTranslations):
    """What a catalog falls back to: nothing, since a text in two languages is a defect."""

    def gettext(self, message: str) -> NoReturn:
        raise LookupError(f"no translation: {message!r}")

    def ngettext(self, msgid1: str, msgid2: str, n: int) -> NoReturn:  # noqa: ARG002
        raise LookupError(f"no translation: {msgid1!r}")


@cache
def _catalog(code: LanguageCode) -> NullTranslations:
    if code == "en":
        return NullTranslations()
    with files(__package__).joinpath(f"{code}.po").open("rb") as stream:
        catalog = read_po(stream, locale=LOCALES[code])
    compiled = BytesIO()
    write_mo(compiled, catalog)
    compiled.seek(0)
    translations = Translations(compiled)
    translations.add_fallback(_Untranslated())
    return translations


@dataclass(frozen=True)
class Language:
    """A language by its code. What it writes of a message that its catalog lacks is a LookupError, no English."""

    code: LanguageCode = "en"

    @property
    def tag(self) -> str:
        """Return what HTML calls the language: pt-BR."""
        return LOCALES[self.code].replace("_", "-")

    @property
    def name(self) -> str:
        """Return what English calls the language: German."""
        return str(Locale(self.code).english_name)

    @property
    def is_english(self) -> bool:
        """Return whether the messages are said as they stand in the code."""
        return self.code == "en"

    def message(self, english: str) -> str:
        """Return a message with its placeholders."""
        return _catalog(self.code).gettext(english)

    def counted_message(self, one: str, several: str, count: int) -> str:
        """Return a message with its placeholders, in the form that goes with a count."""
        return _catalog(self.code).ngettext(one, several, count)

    def gettext(self, english: str, /, **values: object) -> str:
        """Return a message with what stands for its placeholders."""
        return self.message(english).format(**values)

    def ngettext(self, one: str, several: str, count: int, /, **values: object) -> str:
        """Return a message in the form that goes with a count, which is its placeholder ``n``."""
        return self.counted_message(one, several, count).format(n=count, **values)

    def figure(self, text: str) -> str:
        """Return a figure that is written in English with the decimal sign of the language."""
        if self.is_english:
            return text
        return text.replace(",", THIN_SPACE).replace(".", get_decimal_symbol(LOCALES[self.code]))

    def date(self, day: date) -> str:
        """Return a date written out: 2 June 2024."""
        return format_date(day, "long", locale=LOCALES[self.code])

    def listed(self, phrases: Sequence[str]) -> str:
        """Return phrases of one kind in a row: a, b and c."""
        return format_list(phrases, locale=LOCALES[self.code])

    def some(self, names: Sequence[str], most: int = MOST_LISTED) -> str:
        """Return the first names of a list, and how many more there are."""
        first, more = ", ".join(names[:most]), len(names) - most
        return self.ngettext("{names} and {n} more", "{names} and {n} more", more, names=first) if more > 0 else first

    def clauses(self, clauses: Sequence[str]) -> str:
        """Return clauses, each of them whole, as one sentence without its full stop."""
        return reduce(lambda first, then: self.gettext("{first}; {then}", first=first, then=then), clauses)


ENGLISH = Language()
