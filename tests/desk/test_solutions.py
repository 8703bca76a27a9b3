"""A survey that goes on from another program's solution, begun on the page."""

import shutil
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from threading import Thread

import pytest
import yaml

pytest.importorskip("selenium", reason="selenium is not installed")

from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

from photogram.desk.desk import Desk
from photogram.desk.server import DeskServer
from photogram.desk.solutions import begin_with, solutions_in
from photogram.errors import ProjectError
from photogram.exchange.solution_export import export_solution

PATIENCE_S = 60.0


@pytest.fixture
def site(adjusted_survey: Path, tmp_path: Path) -> Path:
    """A folder with photographs, a table, and the project of another program."""
    folder = tmp_path / "site"
    shutil.copytree(adjusted_survey / "photographs", folder / "photographs")
    (folder / "points.csv").write_text("name,easting,northing,height\nP1,602340,5794100,30\n", encoding="utf-8")
    export_solution(adjusted_survey / "project.yaml", "opf", folder / "theirs")
    return folder


def test_solutions_are_named_with_their_programs(site: Path) -> None:
    (found,) = solutions_in(site)
    assert found["file"].startswith("theirs")
    assert "OPF" in found["program"]
    assert solutions_in(site / "photographs") == []


def test_a_solution_that_is_not_in_the_folder_is_refused(site: Path) -> None:
    with pytest.raises(ProjectError, match="no solution in"):
        begin_with(site, "../elsewhere", site / "photographs", site / "project.yaml", None)
    assert not (site / "project.yaml").exists()


def test_the_page_begins_a_survey_with_it(
    site: Path, adjusted_survey: Path, tmp_path: Path, open_browser: Callable[..., AbstractContextManager[Chrome]]
) -> None:
    with Desk(tmp_path / "desk.json") as desk, open_browser() as browser:
        desk.open(site)
        server = DeskServer(desk)
        thread = Thread(target=server.serve)
        thread.start()
        try:
            browser.get(server.url)
            browser.implicitly_wait(PATIENCE_S)
            (solution,) = solutions_in(site)
            Select(browser.find_element(By.ID, "solution")).select_by_value(solution["file"])
            browser.implicitly_wait(0.0)
            assert not browser.find_element(By.CSS_SELECTOR, "select[data-file]").is_displayed()
            browser.find_element(By.ID, "begin").click()
            end = time.monotonic() + PATIENCE_S
            while not (site / "project.yaml").exists():
                assert time.monotonic() < end, browser.find_element(By.ID, "problem").text
                time.sleep(0.2)
        finally:
            server.stop()
            thread.join(10)
    project = yaml.safe_load((site / "project.yaml").read_text(encoding="utf-8"))
    assert project["start"]["solution"] == "solution.npz"
    assert [file["path"] for file in project["control_points"]["files"]] == ["ground_points.csv"]
    surveyed = yaml.safe_load((adjusted_survey / "project.yaml").read_text(encoding="utf-8"))["control_points"]["list"]
    assert len(surveyed) == len((site / "ground_points.csv").read_text(encoding="utf-8").splitlines()) - 1
