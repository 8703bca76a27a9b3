"""How languages write figures, dates, lists and counts; what no catalog has is no English."""

from datetime import date

import pytest

from photogram.languages.codes import CODES
from photogram.languages.language import ENGLISH, Language

OTHERS = [code for code in CODES if code != "en"]


def test_english_is_said_as_it_stands() -> None:
    assert ENGLISH.gettext("no catalog has {this}", this="it") == "no catalog has it"
    assert ENGLISH.figure("1\u202f234.5") == "1\u202f234.5"
    assert ENGLISH.listed(["a", "b", "c"]) == "a, b and c"
    assert ENGLISH.clauses(["a", "b", "c"]) == "a; b; c"
    assert ENGLISH.some(list("abcdefg")) == "a, b, c, d, e and 2 more"
    assert ENGLISH.tag == "en-GB"


@pytest.mark.parametrize("code", OTHERS)
def test_figures_have_a_decimal_comma_and_thousands_apart(code: str) -> None:
    language = Language(code)  # type: ignore[arg-type]
    assert language.figure("+12,345.67") == "+12\u202f345,67"
    assert language.figure("−0.018") == "−0,018"


@pytest.mark.parametrize(
    ("code", "written", "tag"),
    [
        ("en", "2 June 2024", "en-GB"),
        ("de", "2. Juni 2024", "de"),
        ("es", "2 de junio de 2024", "es"),
        ("pt", "2 de junho de 2024", "pt-BR"),
        ("fr", "2 juin 2024", "fr"),
    ],
)
def test_dates_are_written_out(code: str, written: str, tag: str) -> None:
    language = Language(code)  # type: ignore[arg-type]
    assert language.date(date(2024, 6, 2)) == written
    assert language.tag == tag


@pytest.mark.parametrize(
    ("code", "none", "one", "two"),
    [
        ("en", "0 pictures", "1 picture", "2 pictures"),
        ("de", "0 Bilder", "1 Bild", "2 Bilder"),
        ("es", "0 imágenes", "1 imagen", "2 imágenes"),
        ("pt", "0 imagem", "1 imagem", "2 imagens"),
        ("fr", "0 image", "1 image", "2 images"),
    ],
)
def test_a_count_has_the_form_of_its_language(code: str, none: str, one: str, two: str) -> None:
    language = Language(code)  # type: ignore[arg-type]
    written = [language.ngettext("{n} picture", "{n} pictures", n) for n in (0, 1, 2)]
    assert written == [none, one, two]
    assert language.ngettext("{n} picture", "{n} pictures", 1_000_000).split()[1] == two.split()[1]


@pytest.mark.parametrize("code", OTHERS)
def test_a_message_that_a_catalog_lacks_is_an_error(code: str) -> None:
    language = Language(code)  # type: ignore[arg-type]
    with pytest.raises(LookupError, match="no translation: 'no catalog has this'"):
        language.gettext("no catalog has this")
    with pytest.raises(LookupError, match="no translation: 'nor this'"):
        language.ngettext("nor this", "nor these", 2)


def test_what_stands_for_a_placeholder_is_no_message() -> None:
    assert Language("de").gettext("{length} in plan", length="{height}") == "{height} in der Lage"
