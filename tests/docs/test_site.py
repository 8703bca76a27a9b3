"""The site of the documentation: built without a warning, no link broken, searched by words, read on a phone."""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import run
from typing import Any

import pytest
from pages import ROOT

import photogram as pg

START = "docs/site/index.html"

pytestmark = pytest.mark.survey


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as `make docs` builds it, where a broken link between pages is a warning, and a warning a failure."""
    pytest.importorskip("furo", reason="the site is built with photogram[docs]")
    folder = tmp_path_factory.mktemp("site")
    recipe = re.search(r"-m sphinx (.+) -d \S+ \. \S+\n", (ROOT / "Makefile").read_text(encoding="utf-8"))
    assert recipe
    asked = [*recipe[1].split(), "-D", "nb_execution_mode=off"]  # test_course.py runs the notebooks
    command = [sys.executable, "-m", "sphinx", *asked, "-d", str(folder / "trees"), ".", str(folder / "html")]
    built = run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return folder / "html"


def test_every_page_is_there_with_its_pictures(site: Path) -> None:
    pages = [
        *(ROOT / "docs").glob("*.md"),
        *(ROOT / "docs" / "course").glob("*.md"),
        ROOT / "README.md",
        ROOT / "CHANGELOG.md",
    ]
    for page in pages:
        built = (site / page.relative_to(ROOT)).with_suffix(".html").read_text(encoding="utf-8")
        shown = len(re.findall(r"^!\[", page.read_text(encoding="utf-8"), re.MULTILINE))
        assert built.count("<img ") >= shown, page
    assert START in (site / "index.html").read_text(encoding="utf-8")


def test_nothing_is_asked_of_the_network(site: Path) -> None:
    loaded = re.compile(
        r"<(?:script|img|iframe)[^>]+src=\"(?:https?:)?//|<link[^>]+rel=\"stylesheet\"[^>]+href=\"https?://"
    )
    assert [page.name for page in site.rglob("*.html") if loaded.search(page.read_text(encoding="utf-8"))] == []


def test_formulae_are_mathml(site: Path) -> None:
    page = (site / "docs/mathematics.html").read_text(encoding="utf-8")
    assert page.count("<math") > 300
    assert not re.search(r"<m[ion]>\\", page)


def test_every_public_name_is_described(site: Path) -> None:
    page = (site / "docs/site/names.html").read_text(encoding="utf-8")
    assert [name for name in pg.__all__ if f'id="{name.lower().replace("_", "-")}"' not in page] == ["__version__"]
    assert "FloatArray" in page
    assert "ndarray" not in page.partition('id="classes"')[0]


@pytest.mark.parametrize("page", ["site/index", "project-file", "mathematics", "desk", "site/names"])
def test_no_page_is_wider_than_a_phone(site: Path, page: str, open_browser: Callable[..., Any]) -> None:
    with open_browser() as browser:
        screen = {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": True}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
        browser.get((site / f"docs/{page}.html").as_uri())
        assert browser.execute_script("return document.documentElement.scrollWidth") <= 400


def test_words_are_found(site: Path, open_browser: Callable[..., Any]) -> None:
    from selenium.webdriver.support.ui import WebDriverWait

    with open_browser() as browser:
        browser.get((site / "search.html").as_uri() + "?q=lever+arm")
        WebDriverWait(browser, 20).until(lambda b: b.find_elements("css selector", "#search-results li a"))
        found = [link.get_attribute("href") for link in browser.find_elements("css selector", "#search-results li a")]
    assert any("docs/project-file.html" in address for address in found)
