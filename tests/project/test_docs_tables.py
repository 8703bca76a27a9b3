"""The documentation's tables of settings: one of each section, as the code has it now."""

from collections import Counter
from pathlib import Path

import pytest
from docs_tables import DOCS, sections_shown, with_tables

from photogram.project.project import SECTIONS

PAGES = sorted(DOCS.glob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_tables_of_a_page_are_those_of_the_code(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert with_tables(text) == text, "run python tests/docs_tables.py"


def test_every_section_has_one_table() -> None:
    shown = Counter(section for page in PAGES for section in sections_shown(page.read_text(encoding="utf-8")))
    assert shown == Counter(dict.fromkeys(SECTIONS, 1))
