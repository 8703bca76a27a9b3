"""The page in a browser, used as a person would: from a folder of photographs to the archive that is handed over."""

import csv
import io
import json
import shutil
import time
import urllib.request
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any, ClassVar

import numpy as np
import pytest
from PIL import Image

selenium = pytest.importorskip("selenium", reason="selenium is not installed")

from selenium.common.exceptions import StaleElementReferenceException  # noqa: E402
from selenium.webdriver import Chrome  # noqa: E402
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402

import photogram as pg  # noqa: E402
from photogram.desk.desk import Desk  # noqa: E402
from photogram.desk.server import DeskServer  # noqa: E402
from photogram.files.marks.mark_table import read_marks  # noqa: E402
from photogram.files.tables.surveyed_points import MarkKey  # noqa: E402
from photogram.pipeline.pipeline import load_project, run_pipeline  # noqa: E402
from photogram.project.draft.edits import write_values  # noqa: E402
from photogram.result_files import result_path  # noqa: E402

PATIENCE_S = 600.0
MOST_CLICKS = 15
GSD_M = 0.067
"""Of the small survey: 40 m above ground by a focal length of 600 px."""
TABLES = "control.txt", "check.txt"
TITLE = "Quarry north: stage 3"
SAME = ("deliverables/dsm.tif", "deliverables/contours.gpkg", "quality/dsm_sigma.tif", "technical/points_adjusted.laz")


@pytest.fixture(scope="module")
def browser(open_browser: Callable[..., AbstractContextManager[Chrome]]) -> Iterator[Chrome]:
    with open_browser() as chrome:
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


@pytest.fixture
def unmarked(photographed: Path) -> tuple[Path, dict[MarkKey, tuple[float, float]]]:
    """A folder with photographs and tables of coordinates alone, and where the points lie in the photographs."""
    with (photographed / "points.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for role in ("control", "check"):
        with (photographed / f"{role}.csv").open("w", newline="") as file:
            table = csv.DictWriter(file, rows[0].keys())
            table.writeheader()
            table.writerows(row for row in rows if row["role"] == role)
    places = {mark.key: mark.pixel for mark in read_marks(photographed / "marks.csv")}
    for name in (*TABLES, "points.csv", "marks.csv"):
        (photographed / name).unlink()
    return photographed, places


class Person:
    """Clicks and looks; counts the clicks."""

    def __init__(self, browser: Chrome) -> None:
        self.browser, self.clicks = browser, 0

    def sees(self, css: str, words: str = "") -> Any:
        """Wait until something is shown, with some words in it."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            for one in self.browser.find_elements(By.CSS_SELECTOR, css):
                with suppress(StaleElementReferenceException):  # the page has drawn its list anew
                    if one.is_displayed() and words in one.text:
                        return one
            problem = self.browser.find_element(By.ID, "problem")
            assert not problem.is_displayed(), problem.text
            time.sleep(0.2)
        raise AssertionError(f"{css} {words!r} is not shown: {self.browser.find_element(By.TAG_NAME, 'main').text}")

    def clicks_on(self, css: str, words: str = "") -> None:
        try:
            self.sees(css, words).click()
        except StaleElementReferenceException:
            self.sees(css, words).click()
        self.clicks += 1

    def goes_to(self, step: str) -> None:
        self.clicks_on(f"[data-step={step}]")
        self.sees(f"#{step}")


class Hand:
    """Marks points on the page within the page, where a person sees them."""

    def __init__(self, browser: Chrome, places: Mapping[MarkKey, tuple[float, float]], table: Path) -> None:
        self.browser, self.places, self.table = browser, places, table

    def __enter__(self) -> "Hand":
        Person(self.browser).sees("#marking")
        self.browser.switch_to.frame("marking")
        self.until("document.body.dataset.ready === 'all' && document.querySelector('figure')")
        return self

    def __exit__(self, *_: object) -> None:
        self.browser.switch_to.default_content()

    def until(self, script: str) -> None:
        end = time.monotonic() + PATIENCE_S
        while not self.browser.execute_script(f"return {script}"):
            assert time.monotonic() < end, script
            time.sleep(0.1)

    def marks(self, point: str) -> None:
        """Mark a point in two photographs."""
        self.browser.execute_script(f"document.querySelector('#points [data-point={point}]').click()")  # drawn anew
        self.until(f"document.querySelector('#name').textContent === '{point}'")
        for photograph in [name for of, name in self.places if of == point][:2]:
            self.until(f"document.querySelector('figure[data-photograph=\"{photograph}\"]')?.dataset.drawn")
            self.clicks_at(photograph, self.places[point, photograph])
            end = time.monotonic() + PATIENCE_S
            while (point, photograph) not in {mark.key for mark in read_marks(self.table)}:
                assert time.monotonic() < end, photograph
                time.sleep(0.1)

    def clicks_at(self, photograph: str, pixel: tuple[float, float]) -> None:
        figure = self.browser.find_element(By.CSS_SELECTOR, f"figure[data-photograph='{photograph}']")
        self.browser.execute_script("arguments[0].scrollIntoView({block: 'nearest'})", figure)
        picture = figure.find_element(By.CSS_SELECTOR, ".drawing")
        u, v, span, turn = map(float, (figure.get_attribute("data-view") or "").split())
        across, down = pixel[0] - u, pixel[1] - v
        scale = picture.size["width"] / span
        x, y = (
            scale * (np.cos(turn) * across - np.sin(turn) * down),
            scale * (np.sin(turn) * across + np.cos(turn) * down),
        )
        if max(abs(x), abs(y)) > 0.48 * picture.size["width"]:  # a smaller scale shows it
            self.browser.find_element(By.ID, "out").click()
            self.clicks_at(photograph, pixel)
        else:
            ActionChains(self.browser).move_to_element_with_offset(picture, round(x), round(y)).click().perform()


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
        assert desk.recent.folders() == [survey]
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
            next(
                box for box in browser.find_elements(By.CSS_SELECTOR, "#layers label") if box.text == "Residuals"
            ).click()
            person.clicks_on("#residuals-points summary", "control")
            person.clicks_on("#residuals-points details[open] button", "Show the marks")
            person.sees("#marking")
            assert desk.survey.runs().view().began_unix_s == begun
    assert result_path(survey / "results", "report.json").is_file()


def test_from_coordinates_alone_points_are_marked_run_and_checked(
    unmarked: tuple[Path, dict[MarkKey, tuple[float, float]]], browser: Chrome, tmp_path: Path
) -> None:
    folder, places = unmarked
    table = folder / "marks.csv"
    controls = [p for p in sorted({point for point, _ in places}) if p.startswith("G")][:4]
    with Desk(tmp_path / "desk.json") as desk:
        desk.open(folder)
        with served(desk) as server:
            browser.get(server.url)
            person = Person(browser)
            person.sees("#open-survey", "check.csv")
            person.clicks_on("#begin")
            person.sees("#facts", "0 marked")
            person.goes_to("points")
            with Hand(browser, places, table) as hand:
                for point in controls[:2]:
                    hand.marks(point)
            browser.refresh()
            with Hand(browser, places, table) as hand:
                hand.marks(controls[2])
    marked = table.read_bytes()
    with Desk(tmp_path / "desk.json") as desk:  # the server was killed
        desk.open(folder)
        with served(desk) as server:
            browser.get(f"{server.url}#points")
            browser.switch_to.new_window("tab")
            browser.get(f"{server.url}#points")
            with Hand(browser, places, table) as hand:
                assert table.read_bytes() == marked
                hand.marks(controls[3])
                browser.find_element(By.ID, "find").click()
                hand.until("/^Confirm/.test(document.querySelector('#confirm').textContent)")
                browser.find_element(By.ID, "confirm").click()
                hand.until("document.querySelector('#confirm').hidden || document.querySelector('#confirm').disabled")
            person.goes_to("run")
            person.clicks_on("#choices input[value=quick]")
            person.clicks_on("#run-start")  # at once: it waits for the choice
            person.sees("#run-words", "Finished")
            person.goes_to("hand")
            person.sees("#headline", "check points")
            browser.close()
            browser.switch_to.window(browser.window_handles[0])
            browser.get("about:blank")
    report = json.loads(result_path(folder / "results", "report.json").read_text())
    assert "dense" not in report
    checks = report["check_points"]
    assert len(read_marks(table)) > 3 * len(controls)
    assert checks["n"] == len({point for point, _ in places if point.startswith("C")})
    assert max(checks["rmse_h_m"], checks["rmse_v_m"]) < GSD_M


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


class Tiles(BaseHTTPRequestHandler):
    """Gives one magenta tile at every address, and notes them."""

    addresses: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        self.addresses.append(self.path)
        content = io.BytesIO()
        Image.new("RGB", (256, 256), (255, 0, 255)).save(content, "PNG")
        self.send_response(200)
        self.send_header("Content-Type", "image/png")
        self.end_headers()
        self.wfile.write(content.getvalue())

    def log_message(self, format: str, *args: object) -> None:
        pass


def test_tiles_of_the_address_that_was_given_lie_under_the_map(
    flown_with_a_gap: Path, browser: Chrome, tmp_path: Path
) -> None:
    tiles = ThreadingHTTPServer(("127.0.0.1", 0), Tiles)
    Thread(target=tiles.serve_forever, daemon=True).start()
    with Desk(tmp_path / "desk.json", f"http://127.0.0.1:{tiles.server_port}/{{z}}/{{x}}/{{y}}.png") as desk:
        desk.open(flown_with_a_gap)
        with served(desk) as server:
            browser.get(f"{server.url}#map")
            Person(browser).sees("#overview-map .ol-attribution", "127.0.0.1")
            end, share = time.monotonic() + PATIENCE_S, 0.0
            while share < 0.5 and time.monotonic() < end:
                png = browser.find_element(By.ID, "overview-map").screenshot_as_png
                share = float(
                    np.mean(np.all(np.array(Image.open(io.BytesIO(png)).convert("RGB")) == [255, 0, 255], axis=2))
                )
                time.sleep(0.2)
    tiles.shutdown()
    tiles.server_close()
    assert share > 0.5
    lon, lat = 9.0 + (602340.0 - 500000.0) / (111320.0 * np.cos(np.radians(52.28))), 52.28
    z, x, y = map(int, Tiles.addresses[-1].removesuffix(".png").split("/")[1:])
    assert x == pytest.approx(2**z * (lon + 180) / 360, abs=2 + 2**z * 1e-5)
    assert y == pytest.approx(2**z * (1 - np.arcsinh(np.tan(np.radians(lat))) / np.pi) / 2, abs=2 + 2**z * 1e-4)


def colours(browser: Chrome) -> int:
    """Return how many colours the map shows over areas, once its picture is drawn."""
    end = time.monotonic() + PATIENCE_S
    count = 0
    while count <= 4 and time.monotonic() < end:
        png = browser.find_element(By.ID, "overview-map").screenshot_as_png
        count = sum(n > 500 for n, _ in Image.open(io.BytesIO(png)).convert("RGB").getcolors(1 << 24) or [])
        time.sleep(0.2)
    return count
