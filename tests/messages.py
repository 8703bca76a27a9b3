"""The catalogs of messages in photogram/languages, made to fit what the code says.

    python tests/messages.py

adds messages that are new, without a translation, and takes out those that nobody says any more.
"""

import io
from collections.abc import Iterator
from pathlib import Path

from babel.messages.catalog import Catalog
from babel.messages.extract import extract
from babel.messages.pofile import read_po, write_po

from photogram.languages.codes import CODES, LOCALES, LanguageCode
from photogram.languages.pages import Id, messages_of_page
from photogram.marking.targets.kinds import TITLES
from photogram.quality.asprs import STATE_SURVEY
from photogram.report.figures.style import EASTING, HEIGHTS
from photogram.report.figures.thumbnails import THUMBNAIL_TEXTS
from photogram.report.numbers.overall import RED_SUBJECTS
from photogram.report.page import GRADES
from photogram.result_files import LATER_FILES, PURPOSES, RESULT_FILES, contents_of

ROOT = Path(__file__).resolve().parents[1]
CATALOGS = ROOT / "photogram" / "languages"
TABLES: tuple[str, ...] = (
    STATE_SURVEY,
    EASTING,
    HEIGHTS,
    *THUMBNAIL_TEXTS,
    *RED_SUBJECTS,
    *(words for _, words in GRADES.values()),
    *PURPOSES.values(),
    *TITLES.values(),
    *(file.contents for file in (*RESULT_FILES, *LATER_FILES)),
    contents_of("dsm.tif.aux.xml"),
)
"""Messages that tables of the code hold, and that are looked up by a name."""

_HEADER = """msgid ""
msgstr ""
"Project-Id-Version: photogram\\n"
"Language: {language}\\n"
"Content-Type: text/plain; charset=utf-8\\n"
"Content-Transfer-Encoding: 8bit\\n"
"Plural-Forms: {plural}\\n"

"""

PAGES = "photogram/desk/static", "photogram/marking/page/static"
"""Folders of pages in the browser."""


def said() -> dict[Id, list[str]]:
    """Return the messages of code, templates and tables, with the files that say them."""
    found: dict[Id, list[str]] = {text: [] for text in TABLES}
    for path in sorted([*(ROOT / "photogram").rglob("*.py"), *(ROOT / "photogram/report/templates").iterdir()]):
        for message in _in_file(path):
            found.setdefault(message, []).append(path.relative_to(ROOT).as_posix())
    for page in PAGES:
        for message in messages_of_page(ROOT / page):
            found.setdefault(message, []).append(page)
    return found


def _in_file(path: Path) -> Iterator[Id]:
    text = path.read_bytes()
    method, options = "python", {}
    if path.suffix != ".py":
        method, options = "jinja2", {"trim_blocks": "true", "lstrip_blocks": "true"}
    elif not any(call in text for call in (b"gettext(", b"Said(", b"Said.plural(")):
        return
    keywords: dict[str, tuple[int, int] | None] = {"Said": None, "plural": (1, 2)}
    if path.suffix != ".py" or b"gettext(" in text:
        keywords |= {"gettext": None, "ngettext": (1, 2), "say": None, "message": None}
    for _, found, _, _ in extract(method, io.BytesIO(text), keywords, (), options):
        if isinstance(found, str):
            yield found
        elif found[0] and found[1]:
            yield found[0], found[1]


def catalog(code: LanguageCode) -> Catalog:
    """Return a catalog as it is kept."""
    with (CATALOGS / f"{code}.po").open("rb") as stream:
        return read_po(stream, locale=LOCALES[code])


def text_of(new: Catalog) -> str:
    """Return the text of a catalog, sorted by message: the same for the same messages."""
    stream = io.BytesIO()
    write_po(stream, new, sort_output=True, omit_header=True)
    return _HEADER.format(language=new.locale, plural=new.plural_forms) + stream.getvalue().decode("utf-8")


def updated(code: LanguageCode) -> Catalog:
    """Return a catalog with the messages of today: new ones are empty."""
    kept, today = catalog(code), said()
    ids = [message.id for message in kept if message.id]
    for message in ids:
        if message not in today:
            kept.delete(message)
    for message in today:
        if message not in kept:
            kept.add(message)
    return kept


if __name__ == "__main__":
    for code in CODES:
        if code != "en":
            (CATALOGS / f"{code}.po").write_text(text_of(updated(code)), encoding="utf-8")
