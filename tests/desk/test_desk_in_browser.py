"""The page in a browser, used as a person would: from a folder of photographs to the archive that is handed over."""

import io
import json
import shutil
import time
import urllib.request
import zipfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from PIL import Image

selenium = pytest.importorskip("selenium", reason="selenium is not installed")

from selenium.webdriver import Chrome  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402

import photogram as pg  # noqa: E402
from photogram.desk.desk import Desk  # noqa: E402
from photogram.desk.server import DeskServer  # noqa: E402
from photogram.pipeline.pipeline import load_project, run_pipeline  # noqa: E402
from photogram.project.draft.edits import write_values  # noqa: E402
from photogram.result_files import result_path  # noqa: E402

SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
PATIENCE_S = 600.0
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


@pytest.fixture
def flown_with_a_gap(small_plan: pg.SurveyPlan, tmp_path: Path) -> Path:
    """The folder of a project of four strips of five photographs whose pictures are black; the second was not flown."""
    plan = replace(
        small_plan, strips=4, photographs_per_strip=5, forward_overlap=0.8, side_overlap=0.35,
        calibration_source="exif", relief_m=0.5, position_noise_m=0.1, control_marks_per_photograph=0,
    )  # fmt: skip
    survey = pg.simulate(plan, 4)
    black = np.zeros((plan.height_px, plan.width_px, 3), dtype=np.uint8)
    names = [photograph.name for i, photograph in enumerate(survey.photographs) if i // 5 != 1]
    folder = tmp_path / "quarry"
    pg.write_survey(folder, survey, ((name, black) for name in names))
    pg.init(folder / "photographs", control=folder / "points.csv", project=folder / "project.yaml")
    return folder


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
    write_values(other / "project.yaml", {("report", "name"): TITLE}, load_project)
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
            while not browser.execute_script("return Boolean(window.desk)"):
                time.sleep(0.2)
            browser.set_script_timeout(PATIENCE_S)
            place = browser.execute_script("return window.desk.map.getView().getCenter()")
            done = "const end = arguments[arguments.length - 1]; window.desk.measure(...arguments).then(() => end(1));"
            browser.execute_async_script(done, "height", [place])
            figures = person.sees("#measurements dl").text
            browser.refresh()
            assert person.sees("#measurements dl").text == figures
            assert "±" in figures
            assert desk.survey.runs().view().began_unix_s == begun
    assert result_path(survey / "results", "report.json").is_file()


def test_the_switch_draws_the_coverage(flown_with_a_gap: Path, browser: Chrome, tmp_path: Path) -> None:
    with Desk(tmp_path / "desk.json") as desk:
        desk.open(flown_with_a_gap)
        with served(desk) as server:
            browser.get("about:blank")
            complaints(browser)  # of a page of another test, whose server has ended
            browser.get(f"{server.url}#map")
            person = Person(browser)
            person.sees("#facts", "control")
            legend = browser.find_element(By.ID, "coverage-legend")
            assert not legend.is_displayed()
            person.clicks_on("#coverage-switch")
            person.sees("#coverage-sentences .warning", "1 gap within the survey")
            assert legend.is_displayed()
            assert colours(browser) > 4
            with urllib.request.urlopen(person.sees("#gaps-kml").get_attribute("href"), timeout=30) as answer:
                assert b"Gap 1: " in answer.read()
            person.clicks_on("#coverage-switch")
            assert not legend.is_displayed()
            assert not browser.find_element(By.ID, "gaps-kml").is_displayed()
            assert not complaints(browser)


def colours(browser: Chrome) -> int:
    """Return how many colours the map shows over areas, once its picture is drawn."""
    end = time.monotonic() + PATIENCE_S
    count = 0
    while count <= 4 and time.monotonic() < end:
        png = browser.find_element(By.ID, "overview-map").screenshot_as_png
        count = sum(n > 500 for n, _ in Image.open(io.BytesIO(png)).convert("RGB").getcolors(1 << 24) or [])
        time.sleep(0.2)
    return count
