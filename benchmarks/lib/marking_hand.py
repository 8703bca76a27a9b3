"""A simulated hand on the page of photogram mark: it knows where targets are, and clicks beside them as people do."""

import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from selenium.webdriver import Chrome, ChromeOptions
from selenium.webdriver.chrome.service import Service

from photogram.arrays import FloatArray
from photogram.report.printing import browser_options, find_browser

WIDTH_PX, HEIGHT_PX = 1280, 720
PATIENCE_S = 120.0
ALT = 1
"""Modifier of a mouse event of Chrome's DevTools protocol."""

Truth = Mapping[str, Mapping[str, FloatArray]]


@contextmanager
def marking(project: Path) -> Iterator[str]:
    """Run photogram mark on a project, and give the address of its page; ends it as Ctrl-C does."""
    command = [str(Path(sys.executable).with_name("photogram")), "mark", str(project), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as served:
        assert served.stdout is not None
        said = ""
        while not (address := re.search(r"http://127\.0\.0\.1:\d+/\S+/", said)):
            line = served.stdout.readline()
            if not line:
                raise SystemExit(f"photogram mark ended: {said}")
            said += line
        try:
            yield address[0]
        finally:
            served.terminate()


@contextmanager
def browser() -> Iterator[Chrome]:
    """Open a browser without a window, of the size of a small screen."""
    binary, driver = find_browser(), shutil.which("chromedriver")
    if binary is None or driver is None:
        raise SystemExit("install Chromium and its driver (chromium, chromium-driver)")
    options = ChromeOptions()
    options.binary_location = binary
    with TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        for option in browser_options(Path(profile)):
            options.add_argument(option)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        chrome = Chrome(options=options, service=Service(driver))
        try:
            metrics = {"width": WIDTH_PX, "height": HEIGHT_PX, "mobile": False, "deviceScaleFactor": 1}
            chrome.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
            yield chrome
        finally:
            chrome.quit()


class Hand:
    """Clicks and keys on the page, counted."""

    def __init__(self, chrome: Chrome, address: str, truth: Truth, noise_px: float, seed: int) -> None:
        self.chrome, self.address, self.truth, self.noise_px = chrome, address, truth, noise_px
        self.rng, self.done = np.random.default_rng(seed), 0
        chrome.get("about:blank")
        chrome.get(address)
        self.until(lambda: self.js("return Boolean(document.querySelector('figure'))"))

    def leave(self) -> None:
        """Leave the page."""
        self.chrome.get("about:blank")

    def js(self, script: str, *arguments: object) -> Any:  # noqa: ANN401 - what a page answers
        """Run a script in the page."""
        return self.chrome.execute_script(script, *arguments)

    def ask(self, address: str) -> Any:  # noqa: ANN401 - as above
        """Return what the server answers the page."""
        script = "const done = arguments[1]; fetch(arguments[0]).then((r) => r.json()).then(done)"
        return self.chrome.execute_async_script(script, address)

    def act(self, **action: object) -> None:
        """Do something as the page does, without the mouse."""
        script = """
            const done = arguments[1];
            fetch("action", {method: "POST", headers: {"Content-Type": "application/json"}, body: arguments[0]})
              .then((r) => r.json()).then(done)"""
        answer = self.chrome.execute_async_script(script, json.dumps(action))
        if "error" in answer:
            raise SystemExit(answer["error"])

    def until(self, condition: Callable[[], object]) -> None:
        """Wait for a condition."""
        limit = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > limit:
                raise SystemExit("the page does not answer")
            time.sleep(0.01)

    def settled(self) -> dict[str, Any]:
        """Return the state once everything that follows from the marks is known, and shown."""
        while (state := self.ask("state"))["computing"]:
            time.sleep(0.02)
        self.until(lambda: int(self.js("return document.body.dataset.version || 0")) >= state["version"])
        return dict(state)

    @property
    def point(self) -> str:
        """The point that is shown."""
        return str(self.js("return document.querySelector('#name').textContent"))

    def photographs(self) -> list[str]:
        """Return the photographs that are shown, in order."""
        names = self.js("return [...document.querySelectorAll('figure')].map((f) => f.dataset.photograph)")
        return [str(name) for name in names]

    def key(self, key: str) -> None:
        """Press a key."""
        self.done += 1
        for kind in ("keyDown", "keyUp"):
            event = {"type": kind, "key": key, **({"text": key} if kind == "keyDown" else {})}
            self.chrome.execute_cdp_cmd("Input.dispatchKeyEvent", event)

    def undo(self) -> None:
        """Undo the last step, and wait until it is undone: the page sends what hands do one after the other, so a key
        may take effect after something that is asked of the server directly."""
        before = self.ask("state")["undoable"]
        self.key("u")
        self.until(lambda: self.ask("state")["undoable"] == before - 1)

    def next(self) -> None:
        """Go to the next point."""
        last = self.point
        self.key("n")
        self.until(lambda: self.point != last and self.photographs())

    def choose(self, point: str) -> None:
        """Click on a point in the list."""
        self.done += 1
        self.js("document.querySelector(`#points [data-point='${arguments[0]}']`).click()", point)
        self.until(lambda: self.point == point and self.photographs())

    def click(self, photograph: str, pixel: Sequence[float] | FloatArray, alt: bool = False) -> None:
        """Click on a pixel of a photograph, which is brought into view; the scale is made smaller where it is not."""
        while (place := self._place(photograph, pixel)) is None:
            self.key("-")
        while True:  # what lies under the pointer stays where it is
            self._mouse("mouseMoved", place, alt)
            there = self._place(photograph, pixel)
            if there in (place, None):
                break
            place = there
        self.done += 1
        for kind in ("mousePressed", "mouseReleased"):
            self._mouse(kind, place, alt)

    def _mouse(self, kind: str, place: tuple[float, float], alt: bool) -> None:
        pressed = {"button": "left", "clickCount": 1} if kind != "mouseMoved" else {}
        event = {"type": kind, "x": place[0], "y": place[1], "modifiers": ALT if alt else 0, **pressed}
        self.chrome.execute_cdp_cmd("Input.dispatchMouseEvent", event)

    def _place(self, photograph: str, pixel: Sequence[float] | FloatArray) -> tuple[float, float] | None:
        """Return the CSS pixels of a pixel of a photograph, None where its patch does not show it."""
        script = """
            const figure = document.querySelector(`figure[data-photograph="${arguments[0]}"]`);
            figure.scrollIntoView({block: "nearest"});
            const {left, top, width} = figure.querySelector(".drawing").getBoundingClientRect();
            return [left, top, width, ...figure.dataset.view.split(" ").map(Number)];"""
        left, top, width, u, v, span, turn = self.js(script, photograph)
        across, down = float(pixel[0]) - u, float(pixel[1]) - v
        x, y = (
            (np.cos(turn) * across - np.sin(turn) * down) / span,
            (np.sin(turn) * across + np.cos(turn) * down) / span,
        )
        if max(abs(x), abs(y)) > 0.48:
            return None
        return round(left + (x + 0.5) * width), round(top + (y + 0.5) * width)  # a mouse is on whole pixels

    def mark(self, photograph: str) -> None:
        """Mark the point that is shown as a person does: with noise, and snapping."""
        point = self.point
        before = self.marked(point)
        self.click(photograph, self.truth[point][photograph] + self.rng.normal(0.0, self.noise_px, 2))
        self.until(lambda: self.marked(point) > before)

    def marked(self, point: str) -> int:
        """Return how many marks a point has."""
        return sum(p["mark"] is not None for p in self.ask(f"point/{point}")["photographs"])
