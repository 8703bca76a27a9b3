"""view.html in a browser: drawn without a complaint, without the network, and what is clicked on is what is told."""

from __future__ import annotations

import base64
import io
import json
import re
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from photogram.files.described_points import DescribedCloud, read_described
from photogram.files.previews import previews
from photogram.report.printing import find_browser
from photogram.report.view_record import view_record
from photogram.report.viewer import view_page

selenium = pytest.importorskip("selenium", reason="selenium is not installed")

from selenium.webdriver import Chrome  # noqa: E402

Json = dict[str, Any]
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WIDE, NARROW = (960, 640), (400, 720)
PATIENCE_S = 30.0


@pytest.fixture(scope="module")
def browser(open_browser: Callable[..., AbstractContextManager[Chrome]]) -> Iterator[Chrome]:
    with open_browser(SOFTWARE, without={"--disable-gpu"}) as chrome:
        chrome.get("data:text/html,<canvas>")
        if not chrome.execute_script("return !!document.querySelector('canvas').getContext('webgl2')"):
            pytest.skip(f"{find_browser()} draws no WebGL 2 on this machine")
        yield chrome


@pytest.fixture(scope="module")
def cloud(finished_survey: Path) -> DescribedCloud:
    """The adjusted tie points, with a confidence of each as a dense cloud has it."""
    read = read_described(finished_survey / "results/points_adjusted.laz")
    confidence = np.random.default_rng(2).uniform(0, 1, len(read))
    return DescribedCloud(read.position_map_m, read.colour, {**read.figures, "confidence": confidence})


@pytest.fixture(scope="module")
def page(
    full_report: Json, cloud: DescribedCloud, finished_survey: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    path = tmp_path_factory.mktemp("view") / "view.html"
    paths = {p.name: p for p in sorted((finished_survey / "photographs").glob("*.JPG"))}
    pictures, _ = previews(paths, lambda *_: None)
    text = view_page(cloud, view_record(json.dumps(full_report)), "dense.laz", 100_000, pictures)
    path.write_text(text, encoding="utf-8")
    return path


def wait_until(browser: Chrome, script: str) -> None:
    limit = time.monotonic() + PATIENCE_S
    while not browser.execute_script(f"return {script}"):
        assert time.monotonic() < limit, script
        time.sleep(0.05)


def show(browser: Chrome, page: Path, size: tuple[int, int] = WIDE, scheme: str = "light", **address: object) -> None:
    width, height = size
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    features = [
        {"name": "prefers-color-scheme", "value": scheme},
        {"name": "prefers-reduced-motion", "value": "reduce"},
    ]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    browser.get("about:blank")
    text = "&".join(f"{name}={value}" for name, value in address.items())
    browser.get(page.as_uri() + (f"#{text}" if text else ""))
    wait_until(browser, "location.hash.includes('distance') && picture.dataset.drawn === 'all'")


def picture(browser: Chrome, size: tuple[int, int] = WIDE) -> NDArray[np.uint8]:
    """Return what the screen shows of the cloud (rows, columns, 3), without the cards."""
    browser.execute_script(
        "document.querySelectorAll('.card, #labels').forEach(e => { e.style.visibility = 'hidden'; })"
    )
    png = base64.b64decode(browser.get_screenshot_as_base64())
    browser.execute_script("document.querySelectorAll('.card, #labels').forEach(e => { e.style.visibility = ''; })")
    image = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
    assert image.shape == (size[1], size[0], 3)
    return image


def click(browser: Chrome, x: float, y: float, kind: str = "left") -> None:
    for event in ("mousePressed", "mouseReleased"):
        facts = {"type": event, "x": float(x), "y": float(y), "button": kind, "clickCount": 1}
        browser.execute_cdp_cmd("Input.dispatchMouseEvent", facts)


def press(browser: Chrome, key: str, modifiers: int = 0) -> None:
    browser.execute_script("picture.focus()")
    for event in ("keyDown", "keyUp"):
        browser.execute_cdp_cmd("Input.dispatchKeyEvent", {"type": event, "key": key, "modifiers": modifiers})


def said(browser: Chrome) -> dict[str, str]:
    wait_until(browser, "!said.hidden")
    rows = browser.execute_script(
        "return [...said.querySelectorAll('dt')].map(t => [t.textContent, t.nextSibling.textContent])"
    )
    return {"title": browser.execute_script("return said.querySelector('h2').textContent"), **dict(rows)}


def metres(text: str) -> float:
    return float(text.removesuffix(" m").split(" ± ")[0].replace("−", "-"))


def sigma_metres(text: str) -> float:
    return float(text.removesuffix(" m").split(" ± ")[1])


def coordinates(card: dict[str, str]) -> list[float]:
    return [metres(card[name]) for name in ("Easting", "Northing", "Height")]


def address(browser: Chrome) -> dict[str, str]:
    return dict(part.split("=") for part in browser.execute_script("return location.hash.slice(1)").split("&"))


def expected_pixel(
    place_map_m: NDArray[np.float64], view: dict[str, str], size: tuple[int, int]
) -> NDArray[np.float64]:
    """Project a place of the map as the page should: a second implementation, by rotation matrices."""
    azimuth, tilt, distance = (float(view[name]) for name in ("azimuth", "tilt", "distance"))
    a, t = np.radians(azimuth), np.radians(tilt)
    level = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    lift = np.array([[1, 0, 0], [0, np.cos(t), np.sin(t)], [0, -np.sin(t), np.cos(t)]])
    x, y, z = lift @ level @ (place_map_m - np.array([float(v) for v in view["at"].split(",")]))
    focal = size[1] / 2 / np.tan(np.pi / 8)
    depth = distance if view["parallel"] == "1" else distance - z
    return np.array([size[0] / 2 + focal * x / depth, size[1] / 2 - focal * y / depth])


def in_sight(x: float, y: float) -> bool:
    """Say whether a pixel of the wide screen lies beside all cards."""
    width, height = WIDE
    return 20 < x < width - 330 and 130 < y < height - 120 and not (x < 350 and y > height - 330)


def test_page_is_drawn_without_a_complaint_and_without_the_network(browser: Chrome, page: Path) -> None:
    browser.get_log("browser")
    browser.get_log("performance")
    show(browser, page)
    assert browser.get_log("browser") == []
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    assert any(url.startswith(page.as_uri()) for url in sent)
    assert [u for u in sent if not u.startswith((page.as_uri(), "data:", "about:", "chrome:"))] == []
    image = picture(browser)
    sky = image[-3, WIDE[0] // 2]
    assert np.mean(np.any(image != sky, axis=2)) > 0.01
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 200


def test_every_colour_mode_changes_the_picture_and_has_its_legend(browser: Chrome, page: Path) -> None:
    pictures = {}
    for key, mode in enumerate(("colour", "height", "sigma", "confidence"), start=1):
        show(browser, page) if key == 1 else press(browser, str(key))
        wait_until(browser, f"location.hash.includes('colour={mode}')")
        pictures[mode] = picture(browser)
        legend = browser.execute_script("return ramp.hidden ? '' : ramp.innerText")
        assert (legend == "") == (mode == "colour")
        assert "m" in legend or mode in {"colour", "confidence"}
    names = list(pictures)
    for i, one in enumerate(names):
        for other in names[:i]:
            assert np.mean(np.any(pictures[one] != pictures[other], axis=2)) > 0.003, (one, other)


@pytest.mark.parametrize("parallel", [0, 1])
def test_a_ground_point_is_where_it_should_be_and_tells_its_coordinates(
    browser: Chrome, page: Path, full_report: Json, parallel: int
) -> None:
    show(browser, page, parallel=parallel)
    press(browser, "T") if parallel else press(browser, "ArrowLeft")
    wait_until(browser, "picture.dataset.drawn === 'all'")
    time.sleep(0.6)  # the view comes to rest, and writes its address
    view = address(browser)
    assert view["parallel"] == str(parallel)
    shown = 0
    for point in full_report["control_points"]:
        x, y = expected_pixel(np.array(point["surveyed_map_m"]), view, WIDE)
        if not in_sight(x, y):
            continue
        shown += 1
        click(browser, x, y)
        card = said(browser)
        if not card["title"].startswith(f"{point['name']}, "):
            continue  # another sign lies nearer
        assert coordinates(card) == pytest.approx(point["surveyed_map_m"], abs=6e-4)
        if point["residual_m"] is not None:
            given = [float(v.replace("−", "-")) for v in card["Residuals E, N, H, m"].split()]
            assert given == pytest.approx(point["residual_m"], abs=6e-4)
        break
    else:
        pytest.fail(f"none of the {shown} points in sight was found where it was clicked on")


def test_a_point_of_the_cloud_tells_its_coordinates_and_sigmas(
    browser: Chrome, page: Path, cloud: DescribedCloud
) -> None:
    """Straight from above, at the pixel where a point of the cloud must be."""
    sigma = cloud.figures["sigma z"]
    # a key point found twice makes two points at one place: one that stands alone is asked for
    alone = np.flatnonzero(cKDTree(cloud.position_map_m[:, :2]).query(cloud.position_map_m[:, :2], k=2)[0][:, 1] > 0.3)
    away = cloud.position_map_m[alone] - np.median(cloud.position_map_m, axis=0)
    index = alone[np.argmin(np.linalg.norm(away, axis=1))]
    place = cloud.position_map_m[index]
    at = ",".join(f"{v:.3f}" for v in place)
    show(browser, page, at=at, azimuth=30, tilt=0, distance=6)
    for name in ("photographs", "control", "check"):
        browser.execute_script(f"document.getElementById('show-{name}').click()")
    press(browser, "Enter")  # what is in the middle
    card = said(browser)
    assert card["title"] == "Point of the cloud"
    assert coordinates(card) == pytest.approx(place.tolist(), abs=6e-4)
    assert metres(card["Sigma of height"]) == pytest.approx(sigma[index], abs=6e-4)
    assert float(card["Confidence"]) == pytest.approx(cloud.figures["confidence"][index], abs=0.01)


def test_a_distance_between_two_signs_is_theirs(browser: Chrome, page: Path, full_report: Json) -> None:
    show(browser, page)
    press(browser, "T")
    time.sleep(0.6)
    press(browser, "m")
    view, points = address(browser), full_report["control_points"]
    pixels = [expected_pixel(np.array(p["surveyed_map_m"]), view, WIDE) for p in points]
    ends = [k for k, (x, y) in enumerate(pixels) if in_sight(x, y)]
    far = max(((i, j) for i in ends for j in ends), key=lambda ij: float(np.linalg.norm(pixels[ij[0]] - pixels[ij[1]])))
    for k in far:
        click(browser, *pixels[k])
    wait_until(browser, "said.innerText.includes('In plan')")
    card = said(browser)
    e, n, h = np.subtract(points[far[1]]["surveyed_map_m"], points[far[0]]["surveyed_map_m"])
    assert metres(card["In plan"]) == pytest.approx(np.hypot(e, n), abs=6e-4)
    assert metres(card["Height difference"]) == pytest.approx(h, abs=6e-4)
    assert metres(card["Slope distance"]) == pytest.approx(np.sqrt(e**2 + n**2 + h**2), abs=6e-4)
    press(browser, "Escape")
    wait_until(browser, "said.hidden")


def test_scale_bar_is_as_long_as_it_says(browser: Chrome, page: Path) -> None:
    show(browser, page, parallel=1, tilt=0)
    view = address(browser)
    text, bar = browser.execute_script(
        "return [document.getElementById('scale-length').textContent,"
        " document.getElementById('scale-bar').getBoundingClientRect().width]"
    )
    value, unit = re.fullmatch(r"([\d.]+) (km|m|cm|mm)", text).groups()  # type: ignore[union-attr]
    length = float(value) * {"km": 1000, "m": 1, "cm": 0.01, "mm": 0.001}[unit]
    metres_per_pixel = float(view["distance"]) * np.tan(np.pi / 8) * 2 / WIDE[1]
    assert bar * metres_per_pixel == pytest.approx(length, rel=0.02)


def test_hands_turn_move_and_come_nearer(browser: Chrome, page: Path) -> None:
    show(browser, page)

    def after(act: Any) -> dict[str, str]:
        before = address(browser)
        act()
        wait_until(browser, f"location.hash.slice(1) !== {json.dumps('&'.join(f'{k}={v}' for k, v in before.items()))}")
        time.sleep(0.4)
        return address(browser)

    def drag(kind: str, dx: int, dy: int) -> None:
        for event, x, y in (("Pressed", 400, 300), ("Moved", 400 + dx, 300 + dy), ("Released", 400 + dx, 300 + dy)):
            facts = {"type": f"mouse{event}", "x": x, "y": y, "button": kind, "clickCount": 1}
            facts["buttons"] = {"left": 1, "right": 2}[kind]
            browser.execute_cdp_cmd("Input.dispatchMouseEvent", facts)

    first = address(browser)
    turned = after(lambda: drag("left", 120, 0))
    assert abs(float(turned["azimuth"]) - float(first["azimuth"])) == pytest.approx(np.degrees(120 * 0.006), abs=0.01)
    moved = after(lambda: drag("right", 60, 0))
    assert moved["azimuth"] == turned["azimuth"]
    assert moved["at"] != turned["at"]
    wheel = {"type": "mouseWheel", "x": 400, "y": 400, "deltaX": 0, "deltaY": -300}
    nearer = after(lambda: browser.execute_cdp_cmd("Input.dispatchMouseEvent", wheel))
    assert float(nearer["distance"]) < 0.9 * float(moved["distance"])
    upright = after(lambda: browser.execute_script("document.getElementById('top').click()"))
    assert (float(upright["tilt"]), float(upright["azimuth"])) == (0, 0)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_fits_a_telephone(browser: Chrome, page: Path, scheme: str) -> None:
    show(browser, page, NARROW, scheme, colour="sigma")
    press(browser, "Enter")
    outside = """return [...document.querySelectorAll('body *')].filter(e => {
        const b = e.getBoundingClientRect();
        return b.width && e.checkVisibility() && (b.right > innerWidth + 1 || b.left < -1)
          && !e.closest('#labels'); }).map(e => e.outerHTML.slice(0, 90))"""
    assert browser.execute_script("return document.documentElement.scrollWidth") <= NARROW[0]
    assert browser.execute_script(outside) == []
    browser.execute_script("panel.open = true")
    assert browser.execute_script(outside) == []
    cards = browser.execute_script(
        """panel.open = false;
        const boxes = ['title', 'panel', 'measures', 'ramp'].map(
          id => document.getElementById(id).getBoundingClientRect());
        return boxes.flatMap((a, i) => boxes.slice(0, i).map(b =>
          a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom))"""
    )
    assert not any(cards)
    image = picture(browser, NARROW)
    assert (image[NARROW[1] // 2, 12].mean() < 60) == (scheme == "dark")


def test_page_says_so_where_the_browser_cannot_draw(browser: Chrome, page: Path) -> None:
    source = "HTMLCanvasElement.prototype.getContext = () => null;"
    made = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": source})
    try:
        browser.get("about:blank")
        browser.get(page.as_uri())
        said = "const box = document.getElementById('fault'); return box.hidden ? '' : box.innerText"
        assert "WebGL 2" in browser.execute_script(said)
    finally:
        browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", made)
