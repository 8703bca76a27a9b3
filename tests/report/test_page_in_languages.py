"""The page in five languages: the client's part has no English left, and the technical part has nothing else."""

import re
from html import unescape
from pathlib import Path
from string import Formatter

import pytest
from makers import Json, read_json
from messages import said

from photogram.languages.codes import CODES, LanguageCode
from photogram.languages.language import Language
from photogram.quality.asprs import ReportSettings
from photogram.report.numbers.completion import complete
from photogram.report.page import report_page

OTHERS: list[LanguageCode] = [code for code in CODES if code != "en"]
TECHNICAL = '<header class="part">'


@pytest.fixture(scope="module")
def figures(finished_survey: Path) -> list[dict[str, str]]:
    drawn: list[dict[str, str]] = read_json(finished_survey / "work/results.stage/figures.json")
    return drawn


def page_in(report: Json, figures: list[dict[str, str]], code: LanguageCode) -> tuple[str, str]:
    """Return the client's part and the technical part of the page in a language."""
    settings = ReportSettings(
        language=code, client="Ltd", author="A.", place="X", standard="pec-pcd", target_rmse_h_m=0.05
    )
    client, mark, technical = report_page(complete(report, settings), figures).partition(TECHNICAL)
    assert mark
    return client, technical


def plain(text: str) -> str:
    """Return what a page shows, without its style and the contents of the technical part."""
    text = re.sub(r"(?s)<nav.*?</nav>|<style>.*?</style>|data:[^\"]*", " ", text)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", text)).split())


def fixed_parts() -> list[str]:
    """Return what is long enough in English messages, between placeholders, to tell that a text is English."""
    texts = [text for message in said() for text in ([message] if isinstance(message, str) else message)]
    parts = [literal.strip() for text in texts for literal, *_ in Formatter().parse(text)]
    return [part for part in parts if len(re.findall(r"[a-z]{2,}", part)) >= 3]


def test_english_is_found_on_the_english_page(full_report: Json, figures: list[dict[str, str]]) -> None:
    """The referee of the test below."""
    client = plain(page_in(full_report, figures, "en")[0])
    assert sum(part in client for part in fixed_parts()) > 40


@pytest.mark.parametrize("code", OTHERS)
def test_nothing_of_the_clients_part_stays_in_english(
    full_report: Json, figures: list[dict[str, str]], code: LanguageCode
) -> None:
    client, _ = page_in(full_report, figures, code)
    assert [part for part in fixed_parts() if part in plain(client)] == []
    assert f'<html lang="{Language(code).tag}">' in client
    assert '<div lang="en-GB">' in client
    assert Language(code).gettext("The technical part, which follows, is in English.") in client
    assert not re.search(r"\d\.\d", re.sub(r"photogram \d[\d.]*|1:\d+|\d{4}-\d\d-\d\d", "", plain(client)))


@pytest.mark.parametrize("code", OTHERS)
def test_the_technical_part_is_the_same_in_every_language(
    full_report: Json, figures: list[dict[str, str]], code: LanguageCode
) -> None:
    def without_marks(technical: str) -> str:
        technical = re.sub(r"[0-9a-f]{4}(-[0-9a-f]{4}){3}", "ID", technical)
        return technical.replace('</div>\n</main>\n<footer lang="en-GB">', "</main>\n<footer>")

    english, other = (page_in(full_report, figures, own)[1] for own in ("en", code))
    assert without_marks(other) == without_marks(english)


@pytest.mark.parametrize("code", OTHERS)
def test_a_volume_that_is_missing_points_to_the_technical_part(full_report: Json, code: LanguageCode) -> None:
    report = full_report | {"volumes": {"left_out": "there is no surface: none was matched"}}
    client, technical = page_in(report, [], code)
    assert "there is no surface" not in client
    assert "there is no surface" in technical


def test_a_language_that_is_left_leaves_no_trace(full_report: Json) -> None:
    german = complete(full_report, ReportSettings(language="de"))
    assert german["survey"]["language"] == "de"
    assert complete(german, ReportSettings()) == complete(full_report, ReportSettings())
    assert german["report_id"] != complete(full_report, ReportSettings())["report_id"]
