"""Compare on the page, by the keyboard: a design, another survey side by side, contour lines."""

import io
import json
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from makers import write_platform
from PIL import Image

pytest.importorskip("starlette", reason="starlette is not installed")
selenium = pytest.importorskip("selenium", reason="selenium is not installed")

from selenium.webdriver import Chrome  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402

import photogram as pg  # noqa: E402
from photogram.desk.desk import Desk  # noqa: E402
from photogram.desk.server import DeskServer  # noqa: E402
from photogram.files.maps.rasters import read_raster  # noqa: E402
from photogram.grid import MapGrid  # noqa: E402
from photogram.result_files import result_path  # noqa: E402

PATIENCE_S = 120.0
GREY, RED = (154, 163, 168), (178, 24, 43)


@pytest.fixture(scope="module")
def folder(finished_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(finished_survey, tmp_path_factory.mktemp("site") / "june"))


@pytest.fixture(scope="module")
def raised(folder: Path) -> Path:
    """An earlier survey of the site that is 5 m lower in its western half, and the same elsewhere."""
    there = Path(shutil.copytree(folder, folder.parent / "may"))
    path = result_path(there / "results", "dsm.tif")
    surface, crs = read_raster(path)
    values = surface.values.copy()
    values[:, : values.shape[1] // 2] -= 5.0
    pg.write_raster(path, pg.Raster(values, surface.west_map_m, surface.north_map_m, surface.cell_m), crs)
    return there


@pytest.fixture(scope="module")
def design(folder: Path) -> Path:
    """A level platform over the middle of the survey."""
    surface = read_raster(result_path(folder / "results", "dsm.tif"))[0]
    east, north = MapGrid.of(surface).centres_map_m(MapGrid.of(surface).whole)
    middle = np.array([np.median(east), np.median(north)])
    height = float(np.nanmedian(surface.values)) + 2.0
    corner = middle + 5.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return write_platform(folder.parent / "platform.xml", corner, height)


@pytest.fixture(scope="module")
def browser(open_browser: Callable[..., AbstractContextManager[Chrome]]) -> Iterator[Chrome]:
    with open_browser() as chrome:
        chrome.set_window_size(1280, 900)
        yield chrome


@pytest.fixture
def page(folder: Path, browser: Chrome, tmp_path: Path) -> Iterator[Chrome]:
    """The step Measure of the survey, without what another test compared."""
    shutil.rmtree(folder / "comparisons", ignore_errors=True)
    with Desk(tmp_path / "desk.json") as desk:
        desk.open(folder)
        server = DeskServer(desk)
        thread = Thread(target=server.serve)
        thread.start()
        browser.get("about:blank")
        browser.get_log("browser")  # of a page of another test, whose server has ended
        browser.get(f"{server.url}#look")
        until(browser, lambda: browser.execute_script("return Boolean(window.desk)"))
        yield browser
        complaints = [entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
        server.stop()
        thread.join(10)
        assert complaints == []


def until(browser: Chrome, is_so: Callable[[], object]) -> Any:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        if answer := is_so():
            return answer
        problem = browser.find_element(By.ID, "problem")
        assert not problem.is_displayed(), problem.text
        time.sleep(0.1)
    raise AssertionError(browser.find_element(By.TAG_NAME, "main").text)


def one(browser: Chrome, css: str, words: str = "") -> Any:
    return until(
        browser, lambda: next((e for e in browser.find_elements(By.CSS_SELECTOR, css) if words in e.text), None)
    )


def typed(browser: Chrome, *keys: str) -> None:
    browser.switch_to.active_element.send_keys(*keys)


def share(browser: Chrome, colour: tuple[int, int, int], half: str = "both", tolerance: int = 60) -> float:
    """Return the share of the map's pixels that are near a colour."""
    png = browser.find_element(By.ID, "result-map").screenshot_as_png
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int)
    middle = pixels.shape[1] // 2
    part = {"both": pixels, "left": pixels[:, :middle], "right": pixels[:, middle:]}[half]
    return float((np.abs(part - colour).sum(axis=2) <= tolerance).mean())


def begun(browser: Chrome, path: Path, relation: str) -> None:
    """Fill in the form with the keyboard alone, and send it."""
    summary = one(browser, "#compare-new > summary")
    browser.execute_script("arguments[0].focus()", summary)
    typed(browser, Keys.ENTER, Keys.TAB)
    assert browser.switch_to.active_element.get_attribute("id") == "compare-path"
    typed(browser, str(path), Keys.TAB, Keys.TAB)
    for _ in range(("design", "earlier", "later").index(relation)):
        typed(browser, Keys.ARROW_DOWN)
    assert browser.switch_to.active_element.get_attribute("value") == relation
    browser.execute_script("document.getElementById('compare-start').focus()")
    typed(browser, Keys.ENTER)


def test_a_design_is_drawn_with_its_cut_and_fill(page: Chrome, design: Path, folder: Path) -> None:
    begun(page, design, "design")
    shown = one(page, "#comparisons li", "platform.xml: a design").text
    told = json.loads((folder / "comparisons/001_platform/comparison.json").read_text())["platform"]
    (volume,) = told["volumes"]
    assert volume["fill_m3"] > 10.0 * volume["fill_sigma_m3"]
    assert "everywhere" in shown
    assert f"{volume['area_m2']:.2f} m²" in shown
    legend = one(page, "#legend", "within the level of detection").text
    assert "cut −" in legend
    assert "m fill" in legend
    pressed = one(page, "#comparisons button[aria-pressed=true]", "Difference")
    until(page, lambda: share(page, RED, tolerance=260) > 0.01)  # any of its reds
    pressed.send_keys(Keys.ENTER)
    until(page, lambda: not page.find_elements(By.CSS_SELECTOR, "#comparisons button[aria-pressed=true]"))
    assert page.switch_to.active_element.text == "Difference"
    page.find_element(By.CSS_SELECTOR, "#comparisons summary").click()
    assert "what is still to be placed" in one(page, "#comparisons details").text
    one(page, "#comparisons button", "Remove").click()
    until(page, lambda: not page.find_elements(By.CSS_SELECTOR, "#comparisons li"))
    assert not (folder / "comparisons/001_platform").exists()


def test_of_several_surfaces_one_is_ticked(page: Chrome, design: Path) -> None:
    other = design.with_name("two.xml")
    text = design.read_text()
    surface = text[text.index("<Surface name") : text.index("</Surfaces>")]
    other.write_text(text.replace("</Surfaces>", surface.replace('"platform"', '"rim"') + "</Surfaces>"))
    one(page, "#compare-new > summary").click()
    page.find_element(By.ID, "compare-path").send_keys(str(other), Keys.TAB)
    assert "Which surface" in one(page, "#compare-parts").text
    one(page, "#compare-parts label", "rim").click()
    page.find_element(By.ID, "compare-start").click()
    assert "everywhere" in one(page, "#comparisons li", "two.xml: a design").text


def test_two_epochs_lie_side_by_side_under_a_line_that_keys_move(page: Chrome, raised: Path) -> None:
    begun(page, raised, "earlier")
    one(page, "#comparisons li", "may: an earlier survey")
    until(page, lambda: share(page, RED, "left", 200) > 0.02 and share(page, GREY, "right") > 0.02)
    assert share(page, RED, "right", 60) < 0.01
    one(page, "#comparisons button", "Swipe: surface").send_keys(Keys.ENTER)
    slider = one(page, "#swipe-share")
    assert slider.get_attribute("aria-valuetext") == "50 % of the map shows may"
    assert page.find_element(By.CSS_SELECTOR, "label[for=swipe-share]").get_attribute("textContent")
    slider.send_keys(Keys.ARROW_RIGHT * 3)
    assert slider.get_attribute("aria-valuetext") == "53 % of the map shows may"
    left, right = (one(page, f"#result-map .swipe-{side}") for side in ("left", "right"))
    width = page.find_element(By.ID, "result-map").size["width"]
    clips = [page.execute_script("return getComputedStyle(arguments[0]).clipPath", canvas) for canvas in (left, right)]
    assert clips == ["inset(0px 47% 0px 0px)", "inset(0px 0px 0px 53%)"]
    line = page.find_element(By.ID, "swipe-line").location["x"] - page.find_element(By.ID, "result-map").location["x"]
    assert line == pytest.approx(0.53 * width, abs=4)
    one(page, "#layers label", "Surface heights").click()
    assert not page.find_element(By.ID, "swipe").is_displayed()


def test_contour_lines_are_switched_on_and_drawn_anew(page: Chrome) -> None:
    heights = (
        "const drawn = window.desk.map.getAllLayers().map(layer => layer.getSource().getFeatures?.() ?? []);"
        "return drawn.flat().map(feature => feature.get('height')).filter(height => height !== undefined)"
    )
    assert page.execute_script(heights) == []
    one(page, "#layers label", "Contour lines").click()
    one(page, "#hint", "contours.gpkg of the results")
    delivered = set(page.execute_script(heights))
    assert delivered
    one(page, "#layers input[type=number]").send_keys("0.5", Keys.TAB)
    one(page, "#hint", "every 0.5 m")
    anew = set(page.execute_script(heights))
    assert anew
    assert anew != delivered
    assert all((2.0 * height).is_integer() for height in map(float, anew))


def test_what_cannot_be_compared_is_said_in_one_sentence(page: Chrome, folder: Path) -> None:
    begun(page, folder.parent / "nothing.xml", "design")
    deadline = time.monotonic() + PATIENCE_S
    problem = page.find_element(By.ID, "problem")
    while not problem.is_displayed() and time.monotonic() < deadline:
        time.sleep(0.1)
    assert "nothing.xml: not found" in problem.text
    assert page.find_element(By.ID, "compare-path").is_displayed()
    page.get_log("browser")  # the refused request is one of its lines


def test_a_file_is_chosen_in_a_list(page: Chrome, folder: Path, design: Path) -> None:
    page.find_element(By.CSS_SELECTOR, "#compare-new > summary").click()
    page.find_element(By.ID, "compare-choose").click()
    one(page, "#compare-entries button", "the folder above").click()
    until(page, lambda: page.find_element(By.ID, "compare-folder").text == str(folder.parent))
    one(page, "#compare-entries button", design.name).click()
    assert page.find_element(By.ID, "compare-path").get_attribute("value") == str(design)
    assert not page.find_element(By.ID, "compare-listing").is_displayed()
