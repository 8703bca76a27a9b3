"""report.html in a browser: on a screen, on a telephone, on paper; nothing asked of the network, nothing cut."""

import base64
import io
import json
import re
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from copy import deepcopy
from pathlib import Path

import pytest
from makers import Json, read_json

from photogram.errors import ReportError
from photogram.languages.codes import CODES, LanguageCode
from photogram.languages.language import Language
from photogram.report.identity import grouped
from photogram.report.page import report_page
from photogram.report.printing import print_pdf
from photogram.result_files import RESULT_FILES

selenium = pytest.importorskip("selenium", reason="selenium is not installed")
pypdf = pytest.importorskip("pypdf", reason="pypdf is not installed")

from selenium.webdriver import Chrome  # noqa: E402

A4_PT = (595, 842)
PRINTED_WIDTH_PX = 680  # 180 mm between the margins, at 96 px to the inch
TABLES = 33
FIGURES, MARKED_POINTS = 14, 12
SMALLEST_PX = 12.0


@pytest.fixture(scope="module")
def browser(open_browser: Callable[..., AbstractContextManager[Chrome]]) -> Iterator[Chrome]:
    with open_browser() as chrome:
        yield chrome


@pytest.fixture(scope="module")
def pages(full_report: Json, finished_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The page of the small survey as it is written, and one of a report with everything."""
    figures = read_json(finished_survey / "work/results.stage/figures.json")
    full = tmp_path_factory.mktemp("page") / "full.html"
    full.write_text(report_page(full_report, figures), encoding="utf-8")
    return {"small survey": finished_survey / "results/deliverables/report.html", "everything": full}


def show(browser: Chrome, page: Path, width_px: int, media: str = "screen") -> None:
    phone = width_px < 600
    size = {"width": width_px, "height": 900, "deviceScaleFactor": 1, "mobile": phone}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": media})
    browser.get(page.as_uri())


def open_points(browser: Chrome) -> None:
    """Open what is folded up: the marks of each point."""
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")


def requests(browser: Chrome, page: Path) -> list[str]:
    """Return the addresses that a page asked for since the last call; not those of the browser's own first tab."""
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [m["params"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    return [p["request"]["url"] for p in sent if p["documentURL"] == page.as_uri()]


NAMES = pytest.mark.parametrize("name", ["small survey", "everything"])


@NAMES
def test_page_opens_without_a_complaint_and_without_the_network(
    browser: Chrome, pages: dict[str, Path], name: str
) -> None:
    requests(browser, pages[name])
    browser.get_log("browser")
    show(browser, pages[name], 1200)
    assert browser.get_log("browser") == []
    asked = requests(browser, pages[name])
    assert pages[name].as_uri() in asked
    assert [url for url in asked if url != pages[name].as_uri() and not url.startswith("data:")] == []


def test_complaints_and_requests_would_show(browser: Chrome, tmp_path: Path) -> None:
    """The referee of the test above: a page that logs an error and asks for a picture beside it is found out."""
    page = tmp_path / "bad.html"
    page.write_text("<img src='absent.png'><script>console.error('fault')</script>")
    requests(browser, page)
    show(browser, page, 1200)
    assert any("absent.png" in url for url in requests(browser, page))
    assert any("fault" in entry["message"] for entry in browser.get_log("browser"))


@NAMES
def test_every_picture_is_drawn_and_every_table_is_filled(browser: Chrome, pages: dict[str, Path], name: str) -> None:
    show(browser, pages[name], 1200)
    open_points(browser)
    pictures = browser.execute_script(
        """return [...document.images].map(i => i.complete && i.naturalWidth > 100
            && i.getBoundingClientRect().height > 100)"""
    )
    assert pictures == [True] * (FIGURES + MARKED_POINTS)
    rows = browser.execute_script(
        "return [...document.querySelectorAll('table')].map(t => [t.id, t.tBodies.length && t.tBodies[0].rows.length])"
    )
    assert all(count > 0 for _, count in rows), rows
    if name == "everything":
        assert len(rows) == TABLES + 1  # and the verdicts
    broken = browser.execute_script(
        "return [...document.querySelectorAll('nav a')].filter(a => !document.querySelector(a.hash)).length"
    )
    assert broken == 0


@NAMES
@pytest.mark.parametrize("width_px", [400, 1200])
def test_page_fits_the_screen_and_can_be_read(
    browser: Chrome, pages: dict[str, Path], name: str, width_px: int
) -> None:
    show(browser, pages[name], width_px)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width_px
    # what is wider than the screen stands in a box of its own that scrolls
    wide = browser.execute_script(
        """const limit = document.documentElement.clientWidth + 1;
        return [...document.querySelectorAll('body *')].filter(e => e.getBoundingClientRect().right > limit
            && !e.closest('.scroll') && !e.closest('.picture')).map(e => e.outerHTML.slice(0, 80))"""
    )
    assert wide == []
    sizes = browser.execute_script(
        """const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), found = [];
        for (let node = walk.nextNode(); node; node = walk.nextNode())
          if (node.data.trim() && !node.parentElement.closest('sub'))
            found.push(parseFloat(getComputedStyle(node.parentElement).fontSize));
        return found"""
    )
    assert len(sizes) > 200
    assert min(sizes) >= SMALLEST_PX
    lines = browser.execute_script("return parseFloat(getComputedStyle(document.body).lineHeight)")
    assert lines >= 1.4 * 16


@NAMES
def test_at_400_px_nothing_is_cut_and_no_column_is_a_letter_wide(
    browser: Chrome, pages: dict[str, Path], name: str
) -> None:
    """Pictures stand whole within the window; tables of words are read from top to bottom, not sideways."""
    show(browser, pages[name], 400)
    open_points(browser)
    pictures = browser.execute_script(
        "return [...document.images].map(i => i.getBoundingClientRect()).map(r => [r.left, r.right, r.width])"
    )
    assert len(pictures) == FIGURES + MARKED_POINTS
    assert all(left >= 0 and right <= 400 for left, right, _ in pictures), pictures
    assert min(width for *_, width in pictures) > 100
    tables = browser.execute_script(
        """return [...document.querySelectorAll('table.texts')].map(t => [t.id, t.closest('.scroll').scrollWidth
            - t.closest('.scroll').clientWidth, Math.min(...[...t.querySelectorAll('tbody td, tbody th')]
            .map(c => c.getBoundingClientRect().width))])"""
    )
    assert len(tables) >= 3
    for table, beyond, narrowest in tables:
        assert beyond <= 0, table
        assert narrowest > 200, table


@NAMES
@pytest.mark.parametrize(("width_px", "height_px"), [(1280, 900), (400, 900)])
def test_the_first_screen_says_how_good_the_survey_is(
    browser: Chrome, pages: dict[str, Path], name: str, width_px: int, height_px: int
) -> None:
    """Verdict, both figures with their targets, what to do and the pictures stand above the fold."""
    show(browser, pages[name], width_px)
    bottom = browser.execute_script(
        """return ['.judgement', '.targets', '.to-do', '.thumbs'].map(
            s => document.querySelector('#verdict ' + s).getBoundingClientRect().bottom)"""
    )
    assert all(0 < b <= height_px for b in bottom), bottom
    said = browser.execute_script("return document.querySelector('.judgement').innerText")
    assert re.search(r"check point|predicted", said)


def test_verdict_is_told_by_word_and_shape_with_contrast(browser: Chrome, pages: dict[str, Path]) -> None:
    """Not by colour alone; and the word stands out from its ground by 4.5 to 1 (WCAG 2.2, 1.4.3)."""
    for scheme in ("light", "dark"):
        show(browser, pages["everything"], 1200)
        feature = {"name": "prefers-color-scheme", "value": scheme}
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
        grades = browser.execute_script(
            """return [...document.querySelectorAll('.grade')].map(g => [g.innerText.trim(),
                getComputedStyle(g).color, getComputedStyle(g).backgroundColor])"""
        )
        assert len(grades) == 12  # the verdict on the whole, and eleven lights
        assert {text for text, *_ in grades} <= {"● Good", "◆ Good, few points", "▲ Attention", "■ Bad", "○ Not tested"}
        assert len({text for text, *_ in grades}) >= 3
        for text, ink, ground in grades:
            assert contrast(ink, ground) >= 4.5, (scheme, text)


def contrast(one: str, other: str) -> float:
    def luminance(colour: str) -> float:
        parts = [int(v) / 255 for v in re.findall(r"\d+", colour)[:3]]
        linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@NAMES
def test_page_prints_on_a4_and_nothing_is_cut(browser: Chrome, pages: dict[str, Path], name: str) -> None:
    show(browser, pages[name], PRINTED_WIDTH_PX, "print")
    cut = browser.execute_script(
        """const limit = document.body.getBoundingClientRect().right + 1;
        return [...document.querySelectorAll('main *')].filter(e => e.getBoundingClientRect().right > limit)
            .map(e => e.outerHTML.slice(0, 80))"""
    )
    assert cut == []
    printed = browser.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True, "printBackground": True})
    check_pages(base64.b64decode(printed["data"]), browser)


def compact(text: str) -> str:
    """Return a text without spaces, ligatures and capitals, which are the matter of font and style."""
    return "".join(unicodedata.normalize("NFKC", text).split()).casefold()


def check_pages(document: bytes, browser: Chrome) -> None:
    """Check size and number of pages, and that every word of the tables is on one, heads of long tables on each."""
    reader = pypdf.PdfReader(io.BytesIO(document))
    for page in reader.pages:
        assert (float(page.mediabox.width), float(page.mediabox.height)) == pytest.approx(A4_PT, abs=2)
    assert 5 <= len(reader.pages) <= 31
    texts = [unicodedata.normalize("NFKC", page.extract_text()) for page in reader.pages]
    whole = compact("".join(texts))
    cells = browser.execute_script(
        "return [...document.querySelectorAll('td, th, figcaption')].map(c => c.textContent)"
    )
    missing = [cell for cell in cells if compact(cell) not in whole and "RMSE" not in cell]
    assert missing == []
    heads = sum("Surveyed" in text and "Difference" in text for text in texts)
    with_points = sum(bool(re.search(r"\b[GC]0\d\b", text)) and "northing" in text for text in texts)
    assert heads >= with_points > 0


def test_browser_prints_the_page_as_pdf(browser: Chrome, pages: dict[str, Path], tmp_path: Path) -> None:
    target = tmp_path / "report.pdf"
    print_pdf(pages["small survey"], target)
    show(browser, pages["small survey"], 1200)
    check_pages(target.read_bytes(), browser)


CLIENT_PAGES = 4


@NAMES
def test_the_clients_part_is_four_printed_pages(pages: dict[str, Path], tmp_path: Path, name: str) -> None:
    """Survey and accuracy, pictures, plan and check points, files and signature; then the technical part begins."""
    target = tmp_path / "report.pdf"
    print_pdf(pages[name], target)
    texts = [compact(page.extract_text()) for page in pypdf.PdfReader(target).pages]
    heads = ("The survey", "surface", "Plan and check points", "What is handed over", "Technical part")
    for n, head in enumerate(heads):
        assert compact(head) in texts[n], (n + 1, head)
    assert compact("How the figures were found") in texts[CLIENT_PAGES]
    assert compact("Signature") in texts[CLIENT_PAGES - 1]


@pytest.mark.parametrize(("code", "measured"), [*((code, "volumes") for code in CODES), ("de", "measurements")])
def test_the_clients_part_keeps_to_four_pages_when_all_is_long(
    full_report: Json, finished_survey: Path, tmp_path: Path, code: LanguageCode, measured: str
) -> None:
    report = deepcopy(full_report)
    model = next(p for p in report["control_points"] if p["role"] == "check" and p["residual_m"])
    report["control_points"] += [{**model, "name": f"Boundary stone {n} by the old mill"} for n in range(60)]
    names = [f"{file.folder}/{file.pattern}" for file in RESULT_FILES if file.pattern != "report.html"]
    report["deliverables"] = [{"file": name, "bytes": 1, "sha256": "0" * 64} for name in names]
    report["survey"] |= {
        "client": "The Regional Office for Roads and Bridges of the Upper Valley " * 2,
        "language": code,
    }
    volumes = report["volumes"]
    volumes["polygons"] = [{**volumes["polygons"][0], "name": f"Heap of gravel {n}"} for n in range(60)]
    if measured == "measurements":
        report.pop("volumes")
        names = ["length in plan", "lowest", "highest", "height difference"]
        figures_of_one = [{"name": name, "value": 1234.5, "sigma": 0.012, "unit": "m"} for name in names]
        one = {**report["measurements"][0], "kind": "profile", "figures": figures_of_one, "is_current": False}
        report["measurements"] = [{**one, "name": f"Profile along the upper road {n}"} for n in range(60)]
    page, target = tmp_path / "long.html", tmp_path / "long.pdf"
    figures = read_json(finished_survey / "work/results.stage/figures.json")
    page.write_text(report_page(report, figures), encoding="utf-8")
    print_pdf(page, target)
    texts = [compact(p.extract_text()) for p in pypdf.PdfReader(target).pages]
    assert compact("How the figures were found") in texts[CLIENT_PAGES]
    assert compact(Language(code).gettext("Place and date")) in texts[CLIENT_PAGES - 1]


def test_every_printed_page_says_what_it_belongs_to(full_report: Json, tmp_path: Path) -> None:
    """Survey, client, identifier, date, version and page n of m, on each; also with names that mean to break out."""
    report = deepcopy(full_report)
    report["survey"] |= {"name": 'Pit "7" </style>{}', "client": "Müller & Söhne"}
    page, target = tmp_path / "report.html", tmp_path / "report.pdf"
    page.write_text(report_page(report, []), encoding="utf-8")
    print_pdf(page, target)
    texts = [compact(p.extract_text()) for p in pypdf.PdfReader(target).pages]
    assert len(texts) >= 4
    identifier, processed, version = grouped(report["report_id"]), report["processed"], report["photogram"]
    for n, text in enumerate(texts, 1):
        for words in (
            'Pit "7" </style>{}', "Müller & Söhne", f"Report {identifier}, processed {processed}, photogram {version}",
            f"Page {n} of {len(texts)}",
        ):  # fmt: skip
            assert compact(words) in text, (n, words)


def test_a_browser_that_prints_no_margins_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    old = tmp_path / "chromium"
    old.write_text("#!/bin/sh\necho Chromium 120.0.1\n")
    old.chmod(0o755)
    monkeypatch.setenv("CHROME", str(old))
    with pytest.raises(ReportError, match=r"is version 120.* 131 or newer"):
        print_pdf(tmp_path / "report.html", tmp_path / "report.pdf")
