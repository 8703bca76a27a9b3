"""The page in a browser: a pixel that is clicked is the pixel that is kept, at any zoom, and keys alone suffice."""

import json
import re
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from makers import without_marks
from PIL import Image

from photogram.files.marks.mark_table import read_marks
from photogram.loopback.server import LoopbackServer
from photogram.marking.page.addresses import POLICY, MarkingPage
from photogram.marking.page.patches import PatchReader
from photogram.marking.page.session import MarkingSession
from photogram.marking.predictions import predicted_places
from photogram.marking.tagged_block import tagged_block
from photogram.simulation.simulated_survey import simulate_block, whole_survey_plan

selenium = pytest.importorskip("selenium", reason="selenium is not installed")

from selenium.webdriver import Chrome, Keys  # noqa: E402
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402

PATIENCE_S = 60.0
WIDTH, HEIGHT = 1280, 720
DOTS_APART = 5
DOT_SIDE_PX = 16
"""Of a pixel of the photograph on the screen at least, in the screen's own: a block that is drawn half a pixel off, as
blocks are, is then less than 0.05 px off."""


@dataclass(frozen=True)
class Page:
    """The page of a session whose photographs have a white pixel on black every DOTS_APART."""

    server: LoopbackServer
    session: MarkingSession
    marks: Path
    browser: Chrome

    def js(self, script: str, *arguments: object) -> Any:
        return self.browser.execute_script(script, *arguments)

    def until(self, script: str) -> None:
        limit = time.monotonic() + PATIENCE_S
        while not self.js(f"return {script}"):
            assert time.monotonic() < limit, script
            time.sleep(0.03)

    def open(self, ratio: float = 1.0, zoom: float = 1.0, scheme: str = "light") -> None:
        """Open the page on a screen of so many device pixels to a CSS pixel, zoomed by the browser: that makes CSS
        pixels larger, and fewer."""
        metrics = {"width": round(WIDTH / zoom), "height": round(HEIGHT / zoom), "mobile": False}
        self.browser.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride", {**metrics, "deviceScaleFactor": ratio * zoom}
        )
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
        self.browser.get("about:blank")
        self.browser.get(self.server.url)
        self.drawn()

    def drawn(self) -> None:
        self.until(
            "document.body.dataset.ready === 'all' && document.querySelectorAll('figure').length > 0 && "
            "[...document.querySelectorAll('figure')].every(f => f.dataset.drawn)"
        )

    def mouse(self, kind: str, x: float, y: float) -> None:
        pressed = {"button": "left", "clickCount": 1} if kind != "mouseMoved" else {}
        self.browser.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": kind, "x": x, "y": y, **pressed})

    def click(self, x: float, y: float) -> None:
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.mouse(kind, x, y)

    def kept(self) -> dict[tuple[str, str], tuple[float, float]]:
        return {mark.key: mark.pixel for mark in read_marks(self.marks)}

    def keys(self, *keys: str) -> None:
        ActionChains(self.browser).send_keys(*keys).perform()

    def scale(self) -> float:
        """Return how many CSS pixels show one of the photograph."""
        text = self.js("return document.querySelector('#scale').textContent")
        one, _, other = str(text).partition(" : ")
        return float(one) / float(other)

    def steps(self) -> int:
        return self.session.snapshot().undoable


@pytest.fixture(scope="module")
def page(
    open_browser: Callable[..., AbstractContextManager[Chrome]], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Page]:
    folder = tmp_path_factory.mktemp("page")
    plan = replace(whole_survey_plan(), control_points=4, check_points=1)
    block = without_marks(tagged_block(simulate_block(plan, 1).block))
    camera = block.cameras[0]
    size = camera.width_px, camera.height_px
    dots = np.zeros((size[1], size[0]), dtype=np.uint8)
    dots[::DOTS_APART, ::DOTS_APART] = 255
    Image.fromarray(dots).save(folder / "dots.png")
    patches = PatchReader([folder / "dots.png"] * len(block.photographs), [size] * len(block.photographs))
    session = MarkingSession(block, folder / "journal.sqlite", folder / "marks.csv")
    server = LoopbackServer(MarkingPage(session, patches, "dots").routes(), POLICY)
    thread = Thread(target=server.serve)
    thread.start()
    session.start()
    try:
        with open_browser() as browser:
            yield Page(server, session, folder / "marks.csv", browser)
    finally:
        server.stop()
        thread.join()
        patches.close()
        session.close()


# The middle of the bright dot nearest to the middle of the first patch, as its canvas shows it: device pixels weighted
# by their brightness, brought to the page's CSS pixels by where the canvas lies.
DOT = """
const canvas = document.querySelector('figure .picture'), {width, height} = canvas;
const data = canvas.getContext('2d').getImageData(0, 0, width, height).data;
const bright = (x, y) => Math.max(data[4 * (y * width + x)] - 60, 0);
let best = null;
for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
  if (bright(x, y) < 120) continue;
  const far = Math.hypot(x - width / 2, y - height / 2);
  if (!best || far < best[0]) best = [far, x, y];
}
const reach = arguments[0];
let sum = 0, sx = 0, sy = 0;
const [, bx, by] = best;
for (let y = by - reach; y <= by + reach; y++) for (let x = bx - reach; x <= bx + reach; x++) {
  const w = bright(x, y); sum += w; sx += w * (x + 0.5); sy += w * (y + 0.5);
}
const box = canvas.getBoundingClientRect();
return [box.left + sx / sum / width * box.width, box.top + sy / sum / height * box.height,
        document.querySelector('figure').dataset.photograph, document.querySelector('#name').textContent];
"""


@pytest.mark.parametrize(("ratio", "zoom"), [(1.0, 1.0), (1.5, 1.0), (2.0, 1.0), (1.0, 0.5), (1.0, 1.25), (1.0, 2.0)])
def test_a_pixel_that_is_clicked_comes_back(page: Page, ratio: float, zoom: float) -> None:
    page.open(ratio, zoom)
    least = DOT_SIDE_PX / (ratio * zoom)
    while (side := page.scale()) < least:
        page.keys("+")
    page.drawn()
    page.until("document.querySelector('figure').dataset.drawn === document.querySelector('figure').dataset.asked")
    x, y, photograph, point = page.js(DOT, round(side * ratio * zoom))
    before = page.steps()
    page.click(x, y)
    wait(lambda: (point, photograph) in page.kept())
    u, v = page.kept()[point, photograph]
    off = np.array([u, v]) - np.round(np.array([u, v]) / DOTS_APART) * DOTS_APART
    assert np.abs(off).max() < 0.05
    page.keys("u")
    wait(lambda: page.steps() == before)


def wait(condition: Callable[[], object]) -> None:
    limit = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < limit
        time.sleep(0.02)


def test_keys_alone_mark_move_and_take_back(page: Page) -> None:
    page.open()
    session = page.session
    point = page.js("return document.querySelector('#name').textContent")
    first = page.js("return document.activeElement.dataset.photograph")
    assert first, "the first photograph has the focus"
    before = page.steps()
    page.keys(" ")
    wait(lambda: (point, first) in page.kept())
    page.drawn()
    u, v = page.kept()[point, first]
    page.keys(*[Keys.ARROW_RIGHT] * 3)
    ActionChains(page.browser).key_down(Keys.SHIFT).send_keys(Keys.ARROW_DOWN).key_up(Keys.SHIFT).perform()
    wait(lambda: page.kept()[point, first] == pytest.approx((u + 0.3, v + 1.0)))
    page.drawn()
    page.keys("d")
    wait(lambda: read_marks(page.marks)[0].is_doubtful)
    page.keys(Keys.ENTER)
    second = page.js("return document.activeElement.dataset.photograph")
    assert second not in (None, first)
    page.keys("v")
    wait(lambda: (point, second) in session.snapshot().state.not_visible)
    page.keys("c")
    wait(lambda: session.snapshot().roles[point] == "check")
    page.keys("k")
    wait(lambda: session.snapshot().roles[point] == "control")
    ActionChains(page.browser).key_down(Keys.SHIFT).send_keys(Keys.ENTER).key_up(Keys.SHIFT).perform()
    page.keys("x")
    wait(lambda: (point, first) not in page.kept())
    page.keys("u")
    wait(lambda: (point, first) in page.kept())
    page.keys("n")
    page.until(f"document.querySelector('#name').textContent !== {json.dumps(point)}")
    page.keys("p")
    page.until(f"document.querySelector('#name').textContent === {json.dumps(point)}")
    page.drawn()
    for left in range(page.steps() - 1, before - 1, -1):
        page.keys("u")

        def undone(left: int = left) -> bool:
            return page.steps() == left

        wait(undone)


def test_ellipses_lie_where_points_are_predicted(page: Page) -> None:
    page.open()
    session = page.session
    name = page.js("return document.querySelector('#name').textContent")
    photograph = page.js("return document.querySelector('figure').dataset.photograph")
    places = predicted_places(session.block)
    g, i = session.block.control_points.name.index(name), session.numbers[photograph]
    (k,) = np.flatnonzero((places.point == g) & (places.photograph == i))
    page.keys(" ")
    wait(lambda: (name, photograph) in page.kept())
    assert page.kept()[name, photograph] == pytest.approx(tuple(places.pixel[k]), abs=1e-3)
    page.keys("u")
    wait(lambda: (name, photograph) not in page.kept())


def test_a_point_is_added_in_the_page(page: Page) -> None:
    page.open()
    page.js("document.querySelector('#add').click()")
    page.js("document.querySelector('#new input[name=name]').focus()")
    page.keys("roof", Keys.ENTER)
    page.until("document.querySelector('#name').textContent === 'roof'")
    assert page.session.roles["roof"] == "tie"
    page.keys("u")
    page.until("document.querySelector('#name').textContent !== 'roof'")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_out_of_place_at_1280_by_720(page: Page, scheme: str) -> None:
    page.open(scheme=scheme)
    page.until("document.documentElement.scrollWidth <= innerWidth")
    page.until("document.documentElement.scrollHeight <= innerHeight")
    outside = page.js("""
        const shown = [...document.querySelectorAll('#tools button, #add, #plan, figure:first-child')];
        const boxes = shown.map(e => e.getBoundingClientRect());
        return boxes.filter(r => r.left < 0 || r.top < 0 || r.right > innerWidth || r.bottom > innerHeight).length;
    """)
    assert outside == 0


def test_nothing_was_complained_of_and_nothing_asked_of_the_network(page: Page) -> None:
    """Of all that the tests before did."""
    assert [entry["message"] for entry in page.browser.get_log("browser")] == []
    asked = re.findall(
        r'"url":"(\w+://[^"]*)"', "".join(entry["message"] for entry in page.browser.get_log("performance"))
    )
    assert asked
    own = f"http://127.0.0.1:{page.server.port}/"
    assert [url for url in asked if not url.startswith((own, f"blob:{own}", "devtools://", "chrome://"))] == []
