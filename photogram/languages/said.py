"""Texts that are said in English until somebody asks for them in a language: what a page of this machine answers.

``Said("{n} gaps", n=4)`` is the English text, a str as any other, and remembers how it was put together.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Self

from photogram.languages.language import MOST_LISTED, Language


class Figures(str):
    """Figures with their units, written as English does: their decimal signs are those of the language."""

    __slots__ = ()

    def in_language(self, language: Language) -> str:
        """Return them as a language writes them."""
        return language.figure(str(self))


class Said(str):
    """A message in English. What stands for its placeholders may be one itself, ``Figures``, or a list, which is
    written as a and b."""

    english: str
    several: str | None
    number: int
    values: Mapping[str, object]

    def __new__(cls, english: str, /, **values: object) -> Self:
        """Say a message."""
        return cls._made(english, None, 0, values)

    @classmethod
    def plural(cls, one: str, several: str, count: int, /, **values: object) -> Self:
        """Say a message in the form that goes with a count, which is its placeholder ``n``."""
        return cls._made(one, several, count, {**values, "n": count})

    @classmethod
    def _made(cls, english: str, several: str | None, count: int, values: Mapping[str, object]) -> Self:
        form = english if several is None or count == 1 else several
        made = super().__new__(cls, _filled(form, values, Language()))
        made.english, made.several, made.number, made.values = english, several, count, values
        return made

    def in_language(self, language: Language) -> str:
        """Return the message in a language; in English where its catalog lacks it, which a test finds."""
        try:
            if self.several is None:
                form = language.message(self.english)
            else:
                form = language.counted_message(self.english, self.several, self.number)
        except LookupError:
            return str(self)
        return _filled(form, self.values, language)


def _filled(form: str, values: Mapping[str, object], language: Language) -> str:
    return form.format(**{name: _written(value, language) for name, value in values.items()}) if values else form


def _written(value: object, language: Language) -> object:
    if isinstance(value, Said | Figures):
        return value.in_language(language)
    if isinstance(value, list | tuple):
        return language.listed([str(_written(part, language)) for part in value])
    return value


def some_of(names: Sequence[str], most: int = MOST_LISTED) -> str:
    """Return the first names of a list, and how many more there are."""
    first, more = ", ".join(names[:most]), len(names) - most
    return first if more <= 0 else Said.plural("{names} and {n} more", "{names} and {n} more", more, names=first)


def in_language(content: object, language: Language) -> object:
    """Return what is to be sent, mappings and sequences of anything, with all that is said in a language."""
    if language.is_english or isinstance(content, int | float):
        return content
    if isinstance(content, Said | Figures):
        return content.in_language(language)
    if isinstance(content, Mapping):
        return {key: in_language(value, language) for key, value in content.items()}
    if isinstance(content, list | tuple):
        numbers = bool(content) and isinstance(content[0], int | float)
        return content if numbers else [in_language(part, language) for part in content]
    return content


def said_of(error: Exception) -> Said | None:
    """Return what an error says, None where it says it in English alone: of a setting the text without its name."""
    texts: Iterable[object] = (getattr(error, "text", None), *error.args)
    return next((text for text in texts if isinstance(text, Said)), None)
