"""The page in a browser, used as a person would: from a folder of photographs to the archive that is handed over."""

import json
import shutil
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

pytest.importorskip("starlette", reason="starlette is not installed")
selenium = pytest.importorskip("selenium", reason="selenium is not installed")

from selenium.webdriver import Chrome  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402

import photogram as pg  # noqa: E402
from photogram.desk.desk import Desk  # noqa: E402
from photogram.desk.server import DeskServer  # noqa: E402
from photogram.pipeline.pipeline import load_project, run_pipeline  # noqa: E402
from photogram.project.draft.edits import write_value  # noqa: E402
from photogram.result_files import result_path  # noqa: E402

SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
PATIENCE_S = 120.0
MOST_CLICKS = 15
TABLES = "control.txt", "check.txt"
TITLE = "Quarry north: stage 3"
SAME = ("deliverables/dsm.tif", "deliverables/contours.gpkg", "quality/dsm_sigma.tif", "technical/points_adjusted.laz")


@pytest.fixture(scope="module")
def browser(open_browser: Callable[..., AbstractContextManager[Chrome]]) -> Iterator[Chrome]:
    with open_browser(SOFTWARE, without={"--disable-gpu"}) as chrome:
        chrome.set_window_size(1280, 800)
        yield chrome


@contextmanager
def served(desk: Desk) -> Iterator[DeskServer]:
    server = DeskServer(desk)
    thread = Thread(target=server.serve)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(10)


@pytest.fixture
def photographed(small_plan: pg.SurveyPlan, tmp_path: Path) -> Path:
    """A folder with photographs and the points marked in them, as a surveyor brings them home."""
    simulated = pg.simulate(replace(small_plan, calibration_source="exif"), 3)
    pg.write_survey(tmp_path / "quarry", simulated, pg.render_photographs(simulated))
    return tmp_path / "quarry"


class Person:
    """Clicks and looks; counts the clicks."""

    def __init__(self, browser: Chrome) -> None:
        self.browser, self.clicks = browser, 0

    def sees(self, css: str, words: str = "") -> Any:
        """Wait until something is shown, with some words in it."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            for one in self.browser.find_elements(By.CSS_SELECTOR, css):
                if one.is_displayed() and words in one.text:
                    return one
            problem = self.browser.find_element(By.ID, "problem")
            assert not problem.is_displayed(), problem.text
            time.sleep(0.2)
        raise AssertionError(f"{css} {words!r} is not shown: {self.browser.find_element(By.TAG_NAME, 'main').text}")

    def clicks_on(self, css: str, words: str = "") -> None:
        self.sees(css, words).click()
        self.clicks += 1

    def goes_to(self, step: str) -> None:
        self.clicks_on(f"[data-step={step}]")
        self.sees(f"#{step}")


def complaints(browser: Chrome) -> list[str]:
    return [entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]


def test_from_photographs_to_the_archive(
    photographed: Path, browser: Chrome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(photographed.parent))
    other = Path(shutil.copytree(photographed, tmp_path / "elsewhere" / "quarry"))
    with Desk(tmp_path / "desk.json") as desk, served(desk) as server:
        browser.get(server.url)
        person = Person(browser)
        person.clicks_on("#folders button", "quarry")
        person.sees("#inside", "no survey")
        person.clicks_on("#open")
        person.sees("#open-survey", "control.txt")
        person.clicks_on("#begin")
        person.sees("#facts", "control")
        person.goes_to("run")
        person.clicks_on("#run-start")
        person.sees("#run-words", "Finished")
        person.goes_to("look")
        person.sees("#result-map canvas")
        person.goes_to("hand")
        title = person.sees("#texts input[name=name]")
        title.send_keys(TITLE)
        begun = desk.survey.runs().view().began_unix_s
        person.clicks_on("#texts button")
        while (view := desk.survey.runs().view()).began_unix_s == begun or view.state == "running":
            time.sleep(0.2)
        person.sees("#deliver:enabled")
        for box in browser.find_elements(By.CSS_SELECTOR, "#products input"):
            if box.is_selected() and box.get_attribute("value") not in ("dxf", "shapefile"):
                box.click()  # the others are tested elsewhere, and take a while
        person.clicks_on("#deliver")
        person.clicks_on("#package")
        assert person.clicks <= MOST_CLICKS
        assert not complaints(browser)
    assert not person.browser.find_element(By.ID, "problem").is_displayed()

    pg.init(other / "photographs", control=other / TABLES[0], check=other / TABLES[1], project=other / "project.yaml")
    write_value(other / "project.yaml", ("report", "name"), TITLE)
    run_pipeline(load_project(other / "project.yaml"))
    pg.deliver(other / "project.yaml", ["dxf", "shapefile"], package=True)
    assert (other / "project.yaml").read_bytes() == (photographed / "project.yaml").read_bytes()
    archives = (folder / "results/survey.zip" for folder in (photographed, other))
    with zipfile.ZipFile(next(archives)) as own, zipfile.ZipFile(next(archives)) as by:
        assert own.namelist() == by.namelist()
        for name in SAME:
            assert own.read(name) == by.read(name), name
        assert json.loads(own.read("quality/report.json"))["survey"]


def test_whatever_ends_nothing_is_lost(survey: Path, browser: Chrome, tmp_path: Path) -> None:
    recent = tmp_path / "desk.json"
    with Desk(recent) as desk:
        desk.open(survey)
        with served(desk) as server:
            browser.get(f"{server.url}#run")
            person = Person(browser)
            person.clicks_on("#run-start")
            person.sees("#stages li")
            browser.refresh()
            person.sees("#stages li")
            person.clicks_on("#run-pause")
            person.sees("#run-words", "Paused")
    with Desk(recent) as desk:  # the server was killed; another one finds the run where it was
        assert desk.recent() == [str(survey)]
        desk.open(survey)
        with served(desk) as server:
            browser.get(f"{server.url}#run")
            browser.refresh()
            person.sees("#run-words", "Paused")
            first = browser.current_window_handle
            browser.switch_to.new_window("tab")
            browser.get(f"{server.url}#run")
            person.clicks_on("#run-resume")
            browser.switch_to.window(first)
            browser.refresh()
            person.sees("#run-words", "Finished")
            begun = desk.survey.runs().view().began_unix_s
            person.goes_to("look")
            person.sees("#tools button", "Height")
            browser.set_script_timeout(60)
            place = browser.execute_script("return window.desk.map.getView().getCenter()")
            done = "const end = arguments[arguments.length - 1]; window.desk.measure(...arguments).then(() => end(1));"
            browser.execute_async_script(done, "height", [place])
            figures = person.sees("#measurements dl").text
            browser.refresh()
            assert person.sees("#measurements dl").text == figures
            assert "±" in figures
            assert desk.survey.runs().view().began_unix_s == begun
    assert result_path(survey / "results", "report.json").is_file()
