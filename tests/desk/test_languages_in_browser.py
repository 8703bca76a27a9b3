"""The page in another language than English: nothing English is left on it, and changing it loses nothing."""

import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from messages import catalog

pytest.importorskip("starlette", reason="starlette is not installed")
selenium = pytest.importorskip("selenium", reason="selenium is not installed")

from selenium.common.exceptions import StaleElementReferenceException  # noqa: E402
from selenium.webdriver import Chrome  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.support.ui import Select  # noqa: E402

from photogram.desk.desk import Desk  # noqa: E402
from photogram.desk.server import DeskServer  # noqa: E402
from photogram.languages.codes import CODES  # noqa: E402

PATIENCE_S = 120.0
STEPS = ("start", "map", "points", "run", "look", "hand")
SAID = """
const shown = [], isEnglish = one => one.closest('[lang]').lang.startsWith('en') || one.closest('[translate=no]');
const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
for (let node = texts.nextNode(); node; node = texts.nextNode()) {
  const parent = node.parentElement, text = node.data.trim().replace(/\\s+/g, ' ');
  if (text && parent.checkVisibility() && !isEnglish(parent)) shown.push(text);
}
for (const name of ['aria-label', 'title', 'placeholder', 'alt']) {
  for (const one of document.querySelectorAll(`body [${name}]`)) {
    if (one.checkVisibility() && !isEnglish(one)) shown.push(one.getAttribute(name).trim());
  }
}
return shown;
"""
"""All that the page shows and reads aloud, but for what says that it is English."""


def english_of(code: str) -> list[re.Pattern[str]]:
    """Return the messages in English, with anything for their placeholders, that a language says otherwise."""
    found = []
    for message in catalog(code):  # type: ignore[arg-type]
        ids = [message.id] if isinstance(message.id, str) else list(message.id)
        strings = [message.string] if isinstance(message.string, str) else list(message.string or ())
        for english in ids:
            bare = re.sub(r"{\w+}", "", english)
            if english and english not in strings and re.search(r"[a-z]{3}", bare):
                found.append(re.compile(re.sub(r"\\{\w+\\}", ".+", re.escape(english))))
    return found


def left_in_english(shown: list[str], patterns: list[re.Pattern[str]]) -> list[str]:
    return [text for text in shown if any(pattern.fullmatch(text) for pattern in patterns)]


@pytest.fixture(scope="module")
def folder(finished_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(finished_survey, tmp_path_factory.mktemp("site") / "site"))


@pytest.fixture(scope="module")
def browser(open_browser: Callable[..., AbstractContextManager[Chrome]]) -> Iterator[Chrome]:
    with open_browser() as chrome:
        chrome.set_window_size(1280, 900)
        yield chrome


@pytest.fixture
def page(folder: Path, browser: Chrome, tmp_path: Path) -> Iterator[Chrome]:
    """The first step of the survey, in the language of the browser."""
    with Desk(tmp_path / "desk.json") as desk:
        desk.open(folder)
        server = DeskServer(desk)
        thread = Thread(target=server.serve)
        thread.start()
        browser.get(f"{server.url}#start")
        browser.delete_all_cookies()
        browser.refresh()
        yield browser
        browser.get("about:blank")
        server.stop()
        thread.join(10)


def until(what: Callable[[], Any]) -> Any:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            if found := what():
                return found
        except StaleElementReferenceException:
            pass  # drawn anew
        time.sleep(0.1)
    raise AssertionError("it does not come")


def one(page: Chrome, css: str, words: str = "") -> Any:
    """Return what is shown, with some words in it, once it is."""

    def shown() -> Any:
        found = page.find_elements(By.CSS_SELECTOR, css)
        return next((each for each in found if each.is_displayed() and words in each.text), None)

    return until(shown)


def speaks(page: Chrome, name: str) -> None:
    offered = until(lambda: page.find_elements(By.CSS_SELECTOR, "#language option"))
    assert len(offered) == len(CODES)
    Select(page.find_element(By.ID, "language")).select_by_visible_text(name)


def goes_to(page: Chrome, step: str) -> None:
    page.find_element(By.CSS_SELECTOR, f"[data-step={step}]").click()
    one(page, f"#{step}")


def said_on(page: Chrome) -> list[str]:
    return list(page.execute_script(SAID))


def shown_on(page: Chrome, step: str) -> list[str]:
    """Return what a step shows with everything in it unfolded, once it is drawn."""
    goes_to(page, step)
    ready = {"start": "#folders button", "map": "#findings li", "run": "#choices input", "hand": "#files tbody tr"}
    one(page, ready.get(step, f"#{step}"))
    if step == "map":
        page.find_element(By.ID, "coverage-switch").click()
        one(page, "#expected-sentences li")
    if step == "look":
        until(lambda: page.execute_script("return Boolean(window.desk)"))
        page.set_script_timeout(PATIENCE_S)
        place = page.execute_script("return window.desk.map.getView().getCenter()")
        done = "const end = arguments[arguments.length - 1]; window.desk.measure(...arguments).then(() => end(1));"
        page.execute_async_script(done, "height", [place])
        one(page, "#measurements dl")
        next(box for box in page.find_elements(By.CSS_SELECTOR, "#layers label") if box.text == "Abweichungen").click()
        one(page, "#residuals-points li")
    page.execute_script("for (const one of document.querySelectorAll('details')) one.open = true")
    if step == "points":
        one(page, "#marking")
        page.switch_to.frame("marking")
        until(lambda: page.execute_script("return document.body.dataset.ready === 'all'"))
        one(page, "figcaption", "px")
        page.find_element(By.ID, "keys").click()
        inner = said_on(page)
        page.find_element(By.ID, "help-close").click()
        page.switch_to.default_content()
        assert len(inner) > 60
        return inner
    return said_on(page)


def test_the_messages_that_are_looked_for_are_found() -> None:
    """The referee of the test below."""
    patterns = english_of("de")
    assert left_in_english(["Hand over", "12 photographs in /site.", "Aufnahmen", "Name"], patterns) == [
        "Hand over",
        "12 photographs in /site.",
    ]


def test_no_english_is_left_on_any_step(page: Chrome) -> None:
    speaks(page, "Deutsch")
    one(page, "nav", "Übergabe")
    patterns, seen = english_of("de"), list[str]()
    for step in STEPS:
        shown = shown_on(page, step)
        end = time.monotonic() + PATIENCE_S
        while step != "points" and left_in_english(shown, patterns) and time.monotonic() < end:
            time.sleep(0.1)  # on a busy machine what was there before is drawn anew a little later
            shown = said_on(page)
        assert left_in_english(shown, patterns) == [], step
        seen += shown
    assert page.find_element(By.TAG_NAME, "html").get_attribute("lang") == "de"
    assert len(seen) > 300
    assert any("± " in text and "," in text for text in seen), "figures have a decimal comma"


def test_what_the_engine_says_is_marked_as_english(page: Chrome) -> None:
    speaks(page, "Français")
    goes_to(page, "map")
    assert until(lambda: one(page, "#findings li span", "control points").get_attribute("lang") == "en")
    assert one(page, "#findings li b", "Remarque")


def test_another_language_changes_words_and_nothing_else(page: Chrome) -> None:
    one(page, "#folders button")
    path = one(page, "#path")
    path.clear()
    path.send_keys("/somewhere else")
    speaks(page, "Español")
    one(page, "#go", "Ir a")
    assert page.find_element(By.ID, "path").get_attribute("value") == "/somewhere else"
    goes_to(page, "look")
    until(lambda: page.execute_script("return Boolean(window.desk)"))
    before = page.execute_script("const v = window.desk.map.getView(); v.setZoom(v.getZoom() + 1); return v.getZoom()")
    one(page, "#layers label", "Precisión en altimetría").click()
    page.find_element(By.CSS_SELECTOR, "#compare-new > summary").click()
    page.find_element(By.ID, "compare-path").send_keys("platform.xml")
    page.find_element(By.CSS_SELECTOR, "input[value=earlier]").click()
    speaks(page, "Português")
    chosen = one(page, "#layers label", "Exatidão na altimetria").find_element(By.TAG_NAME, "input")
    until(chosen.is_selected)
    assert one(page, "#tools button", "Distância")
    assert page.execute_script("return window.desk.map.getView().getZoom()") == pytest.approx(before)
    assert page.find_element(By.ID, "compare-path").get_attribute("value") == "platform.xml"
    assert page.find_element(By.CSS_SELECTOR, "input[value=earlier]").is_selected()
    assert page.execute_script("return location.hash") == "#look"


def test_a_language_is_kept_for_the_next_time(page: Chrome) -> None:
    speaks(page, "Deutsch")
    one(page, "#steps", "Karte")
    page.refresh()
    one(page, "#steps", "Karte")
    assert Select(page.find_element(By.ID, "language")).first_selected_option.text == "Deutsch"


def test_a_browser_that_says_nothing_else_is_answered_in_english(page: Chrome) -> None:
    assert one(page, "#steps", "Hand over")
    assert until(lambda: page.find_element(By.TAG_NAME, "html").get_attribute("lang") == "en-GB")


def test_figures_are_typed_with_a_point_or_a_comma(page: Chrome) -> None:
    module = "const end = arguments[arguments.length - 1]; import('./static/words.js').then(words => end(%s))"
    values = page.execute_async_script(module % "['1234,5', ' 0.25 ', '', 'x'].map(text => String(words.typed(text)))")
    assert values == ["1234.5", "0.25", "NaN", "NaN"]
    speaks(page, "Deutsch")
    one(page, "#steps", "Karte")
    assert page.execute_async_script(module % "words.fixed(1234.5, 2)") == "1234,50"
