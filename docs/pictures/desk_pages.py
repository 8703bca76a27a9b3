"""Draw the page of `photogram desk` at each of its steps, in a browser without a window.

Call: python docs/pictures/desk_pages.py FOLDER SURVEY [NARROW]: a picture of each step of a finished survey into a
folder, `desk_STEP.png`, of the map `desk_coverage.png` and `desk_expected.png` too, of the results
`desk_residuals.png`; with NARROW as on a telephone, `desk_STEP_narrow.png`. Needs Chromium and its driver. The pictures
in the documentation are of the built-in simulated survey, of Brighton Beach, and, of the coverage, of a simulated
survey that lacks photographs; `desk_compared.py` draws comparisons.
"""

import io
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

from PIL import Image
from selenium.webdriver import Chrome, ChromeOptions
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.ui import Select

from photogram.desk.desk import Desk
from photogram.desk.server import DeskServer
from photogram.report.printing import browser_options, find_browser

STEPS = ("start", "map", "points", "run", "look", "hand")
WIDE, NARROW = "1280,940", "500,940"
COLOURS, DRAWN_AFTER_S = 256, 4.0


@contextmanager
def shown(survey: Path, size: str) -> Iterator[tuple[Chrome, str]]:
    """Give a browser and the address of the page of a survey."""
    with tempfile.TemporaryDirectory() as scratch, Desk(Path(scratch) / "desk.json") as desk:
        desk.open(survey)
        server = DeskServer(desk)
        thread = Thread(target=server.serve)
        thread.start()
        options = ChromeOptions()
        options.binary_location = str(find_browser())
        drawn = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
        usual = [option for option in browser_options(Path(scratch) / "profile") if option != "--disable-gpu"]
        for option in (*usual, *drawn, f"--window-size={size}"):
            options.add_argument(option)
        browser = Chrome(options=options, service=Service(shutil.which("chromedriver")))
        try:
            yield browser, server.url
        finally:
            browser.quit()
            server.stop()
            thread.join()


def main(folder: Path, survey: Path, narrow: bool) -> None:
    """Open the survey, go through its steps and take a picture of each."""
    with shown(survey, NARROW if narrow else WIDE) as (browser, address):
        browser.get(address)
        for step in STEPS:
            browser.execute_script("location.hash = arguments[0]", step)
            time.sleep(DRAWN_AFTER_S)
            draw(browser, folder, step, narrow)
            if step == "map":
                browser.find_element("id", "coverage-switch").click()
                time.sleep(DRAWN_AFTER_S)
                draw(browser, folder, "coverage", narrow)
                Select(browser.find_element("id", "coverage-kind")).select_by_value("height_m")
                time.sleep(DRAWN_AFTER_S)
                draw(browser, folder, "expected", narrow)
            if step == "look" and not narrow:
                boxes = browser.find_elements("css selector", "#layers label")
                for box in [box for box in boxes if box.text == "Residuals"]:  # none before a run
                    box.click()
                    time.sleep(DRAWN_AFTER_S)
                    draw(browser, folder, "residuals", narrow)


def draw(browser: Chrome, folder: Path, step: str, narrow: bool) -> None:
    """Take a picture of what is shown."""
    picture = Image.open(io.BytesIO(browser.get_screenshot_as_png())).convert("RGB")
    name = f"desk_{step}{'_narrow' if narrow else ''}.png"
    picture.quantize(COLOURS, kmeans=3, dither=Image.Dither.NONE).save(folder / name, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), "NARROW" in sys.argv[3:])
