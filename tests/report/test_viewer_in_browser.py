"""view.html in a browser: drawn without a complaint, without the network, and what is clicked on is what is told."""

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
from PIL import Image
from scipy.spatial import cKDTree
from surface_files import CELL_M, COLOUR, COLUMNS, FILLED, HOUSE, HOUSE_M, ROWS, surface_on, write_surface

from photogram.arrays import ByteArray, FloatArray
from photogram.files.clouds.described_points import DescribedCloud, read_described
from photogram.files.photographs.previews import previews
from photogram.report.printing import find_browser
from photogram.report.reading import report_of
from photogram.report.view.drawn_surface import drawn_surface
from photogram.report.view.viewer import view_page
from photogram.survey import Raster

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
    read = read_described(finished_survey / "results/technical/points_adjusted.laz")
    confidence = np.random.default_rng(2).uniform(0, 1, len(read))
    return DescribedCloud(read.position_map_m, read.colour, {**read.figures, "confidence": confidence})


@pytest.fixture(scope="module")
def page(
    full_report: Json, cloud: DescribedCloud, finished_survey: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    path = tmp_path_factory.mktemp("view") / "view.html"
    paths = {p.name: p for p in sorted((finished_survey / "photographs").glob("*.JPG"))}
    pictures, _ = previews(paths, lambda *_: None)
    text = view_page(cloud, report_of(json.dumps(full_report)), "dense.laz", 100_000, pictures)
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


def picture(browser: Chrome, size: tuple[int, int] = WIDE) -> ByteArray:
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


def expected_pixel(place_map_m: FloatArray, view: dict[str, str], size: tuple[int, int]) -> FloatArray:
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
    apart_m, _ = cKDTree(cloud.position_map_m[:, :2]).query(cloud.position_map_m[:, :2], k=2)
    alone = np.flatnonzero(np.asarray(apart_m)[:, 1] > 0.3)
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
    said = re.fullmatch(r"([\d.]+) (km|m|cm|mm)", text)
    assert said is not None
    value, unit = said.groups()
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


# ---- what a first look meets -----------------------------------------------------------------------------------------


def fresh_key(browser: Chrome, key: str) -> None:
    """Press a key without giving anything the focus."""
    for event in ("keyDown", "keyUp"):
        browser.execute_cdp_cmd("Input.dispatchKeyEvent", {"type": event, "key": key})


WHEEL = """
const [clientX, clientY, deltaY, times, done] = arguments;
let left = times;
(function turn() {
  for (let k = 0; k < 5 && left; k++, left--)
    picture.dispatchEvent(new WheelEvent("wheel", { clientX, clientY, deltaY, bubbles: true, cancelable: true }));
  left ? requestAnimationFrame(turn) : done();
})();
"""


def wheel(browser: Chrome, x: float, y: float, delta: float, times: int) -> None:
    """Turn the wheel so often, five times for each picture that is drawn: drawing them all would take a minute."""
    browser.execute_async_script(WHEEL, x, y, delta, times)


def cloud_share(browser: Chrome, size: tuple[int, int] = WIDE) -> float:
    image = picture(browser, size)
    return float(np.mean(np.any(image != image[-3, size[0] // 2], axis=2)))


def pixels_of(browser: Chrome, cloud: DescribedCloud, size: tuple[int, int]) -> FloatArray:
    view = address(browser)
    return np.array([expected_pixel(place, view, size) for place in cloud.position_map_m])


@pytest.mark.parametrize("size", [WIDE, NARROW])
def test_first_view_is_filled_by_the_ground_from_the_south(
    browser: Chrome, page: Path, cloud: DescribedCloud, size: tuple[int, int]
) -> None:
    show(browser, page, size)
    view = address(browser)
    assert float(view["azimuth"]) == 0
    assert 20 < float(view["tilt"]) < 60
    inner = np.percentile(pixels_of(browser, cloud, size), [1, 99], axis=0)
    assert np.all(inner > 0)
    assert np.all(inner < size)
    wide, high = np.ptp(inner, axis=0)
    free = size[0] - (310 if size == WIDE else 56)
    assert wide > 0.75 * free or high > 0.6 * size[1]


def test_keys_act_without_a_click_and_home_comes_back(browser: Chrome, page: Path) -> None:
    show(browser, page)
    assert browser.execute_script("return document.activeElement.id") == "picture"
    first = address(browser)
    for key, then in (("2", "colour=height"), ("1", "colour=colour"), ("t", "tilt=0&")):
        fresh_key(browser, key)
        wait_until(browser, f"location.hash.includes('{then}')")
    browser.execute_script("document.getElementById('whole').click()")
    time.sleep(0.5)
    fresh_key(browser, "h")
    wait_until(browser, f"location.hash.includes('tilt={first['tilt']}&')")
    # once the picture rests the distance is that of the ground in its middle: the one it opened with
    apart = f"Number(new URLSearchParams(location.hash.slice(1)).get('distance')) / {first['distance']} - 1"
    wait_until(browser, f"Math.abs({apart}) < 0.01")
    again = address(browser)
    assert {k: again[k] for k in ("azimuth", "tilt")} == {k: first[k] for k in ("azimuth", "tilt")}
    fresh_key(browser, "?")
    wait_until(browser, "document.getElementById('help').open")


def test_a_button_that_was_clicked_on_leaves_the_keys_to_the_picture(browser: Chrome, page: Path) -> None:
    show(browser, page)
    x, y = browser.execute_script(
        "const b = document.getElementById('top').getBoundingClientRect();"
        "return [b.x + b.width / 2, b.y + b.height / 2]"
    )
    click(browser, x, y)
    wait_until(browser, "location.hash.includes('tilt=0&')")
    assert browser.execute_script("return document.activeElement.id") == "picture"
    browser.execute_script("document.getElementById('top').focus()")
    before = address(browser)
    fresh_key(browser, "ArrowLeft")  # a control that has the focus by Tab keeps its keys
    time.sleep(0.5)
    assert address(browser) == before


def test_the_wheel_over_the_sky_comes_to_the_ground_and_stays_near(browser: Chrome, page: Path) -> None:
    show(browser, page)
    press(browser, "w")
    time.sleep(0.6)
    wheel(browser, 480, 3, -300, 30)
    time.sleep(1.2)
    nearest = address(browser)
    assert cloud_share(browser) > 0
    assert browser.execute_script("return picture.dataset.drawn") == "all"
    press(browser, "Enter")
    assert said(browser)["title"]  # something is in the middle, or near it
    wheel(browser, 480, 3, 300, 60)
    time.sleep(1.2)
    farthest = address(browser)
    assert float(farthest["distance"]) > 5 * float(nearest["distance"])
    assert cloud_share(browser) > 2e-3  # still to be seen
    assert browser.execute_script("return document.getElementById('tip').hidden")


def test_a_name_does_not_stay_where_its_sign_has_left(browser: Chrome, page: Path, full_report: Json) -> None:
    show(browser, page)
    press(browser, "t")
    time.sleep(0.6)
    view = address(browser)
    pixels = [expected_pixel(np.array(p["surveyed_map_m"]), view, WIDE) for p in full_report["control_points"]]
    x, y = next(p for p in pixels if in_sight(*p))
    browser.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": "mouseMoved", "x": x, "y": y})
    wait_until(browser, "!document.getElementById('tip').hidden")
    press(browser, "ArrowUp")
    fresh_key(browser, "ArrowRight")
    wait_until(browser, "document.getElementById('tip').hidden")


def test_a_distance_tells_its_sigma_and_what_it_holds(browser: Chrome, page: Path, full_report: Json) -> None:
    show(browser, page)
    press(browser, "T")
    time.sleep(0.6)
    found = browser.execute_script(
        """const scene = JSON.parse(document.getElementById('scene').textContent), errors = new Errors(scene);
        const cloud = new Cloud(scene), all = [...Array(scene.shown).keys()];
        const ends = [0, 1, 2, 3].map(k => { const i = all[Math.floor(k * (scene.shown - 1) / 3)];
          return { cloud: cloud.figures(i), place: cloud.place(i) }; });
        const points = scene.points.slice(0, 2).map(point => ({ point, place: local(scene, point.surveyed_map_m) }));
        return { grid: scene.errors, origin: scene.origin_map_m, ends,
          joint: errors.distance(ends[0], ends[3]), same: errors.distance(ends[0], ends[0]),
          surveyed: errors.distance(...points), mixed: errors.distance(ends[0], points[0]) };"""
    )
    grid, (a, *_, b) = found["grid"], found["ends"]
    (sigma_a, factor_a), (sigma_b, factor_b) = (at_nodes(grid, np.array(end["place"])) for end in (a, b))

    def own(end: Json, sigma: FloatArray) -> float:
        total, shared, usual = end["cloud"]["sigma_m"] ** 2, sigma[2] ** 2, grid["own_m"][1]
        return float(min(usual**2, total) if shared > 0.8 * total and usual is not None else max(total - shared, 0))

    height = np.sqrt(np.sum((factor_a - factor_b)[2] ** 2) + own(a, sigma_a) + own(b, sigma_b))
    assert found["joint"]["kind"] == "joint"
    assert found["joint"]["sigma"][1] == pytest.approx(height, rel=1e-6)
    assert found["same"]["sigma"][1] == pytest.approx(np.sqrt(2 * own(a, sigma_a)), rel=1e-6)
    assert found["joint"]["sigma"][1] < np.hypot(a["cloud"]["sigma_m"], b["cloud"]["sigma_m"]) * 1.5
    one, other = (full_report["control_points"][k]["surveyed_sigma_m"] for k in (0, 1))
    assert found["surveyed"]["kind"] == "surveyed"
    assert found["surveyed"]["sigma"][1] == pytest.approx(np.hypot(one[2], other[2]))
    assert found["mixed"]["kind"] == "alone"
    press(browser, "m")
    view = address(browser)
    pixels = [expected_pixel(np.array(p["surveyed_map_m"]), view, WIDE) for p in full_report["control_points"]]
    ends = [p for p in pixels if in_sight(*p)]
    click(browser, *ends[0])
    click(browser, *ends[-1])
    wait_until(browser, "said.innerText.includes('In plan')")
    card = said(browser)
    assert 0 < sigma_metres(card["Height difference"]) < 1
    assert 0 < sigma_metres(card["Slope distance"]) < 1
    assert "1 sigma" in browser.execute_script("return said.innerText")


def at_nodes(grid: Json, place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sigmas (3,) and factor (3, R) at a place, bilinear: a second implementation."""
    n = grid["nodes"]
    u, v = (float(np.clip((place[k] - grid["low_m"][k]) / grid["step_m"][k], 0, n - 1)) for k in (0, 1))
    c, r = min(int(u), n - 2), min(int(v), n - 2)
    p, q = u - c, v - r
    weights = {(0, 0): (1 - p) * (1 - q), (0, 1): p * (1 - q), (1, 0): (1 - p) * q, (1, 1): p * q}
    sigma, factor = (
        sum((w * np.array(grid[key][(r + i) * n + c + j]) for (i, j), w in weights.items()), start=np.zeros(()))
        for key in ("sigma_m", "factor_m")
    )
    return sigma, factor


def test_a_photograph_and_a_place_show_their_picture(browser: Chrome, page: Path, full_report: Json) -> None:
    show(browser, page)
    name = next(n for n, p in full_report["photographs"].items() if p["registered"])
    press(browser, "w")
    time.sleep(0.6)
    x, y = expected_pixel(np.array(full_report["photographs"][name]["position_map_m"]), address(browser), WIDE)
    click(browser, x, y)
    card = said(browser)
    shown = full_report["photographs"][card["title"]]
    assert card["Tie points"] == str(shown["tie_points"])
    given = [float(v.replace("−", "-")) for v in card["Sigmas E, N, H, m"].split()]
    assert given == pytest.approx(shown["sigma_m"], abs=6e-4)
    wait_until(browser, "said.querySelector('img').complete")
    assert browser.execute_script("return said.querySelector('img').naturalWidth") == 320
    browser.execute_script("document.getElementById('show-photographs').click()")
    press(browser, "T")
    time.sleep(0.6)
    point = next(
        p for p in full_report["control_points"]
        if in_sight(*expected_pixel(np.array(p["surveyed_map_m"]), address(browser), WIDE))
    )  # fmt: skip
    click(browser, *expected_pixel(np.array(point["surveyed_map_m"]), address(browser), WIDE))
    wait_until(browser, "said.querySelector('figure i')")
    text, left, top = browser.execute_script(
        "const i = said.querySelector('figure i');"
        "return [said.querySelector('figcaption button').textContent, i.style.left, i.style.top]"
    )
    photograph = full_report["photographs"][text]
    camera = full_report["cameras"][photograph["camera"]]
    title = said(browser)["title"]
    place = next(p for p in full_report["control_points"] if title.startswith(f"{p['name']}, "))["surveyed_map_m"]
    seen = np.array(photograph["rotation_camera_from_map"]) @ np.subtract(place, photograph["position_map_m"])
    pixel = camera["focal_px"] * seen[:2] / seen[2] + camera["principal_point_px"]
    marked = np.array([float(left[:-1]) * camera["width_px"], float(top[:-1]) * camera["height_px"]]) / 100
    assert np.abs(marked - pixel).max() < 0.03 * camera["width_px"]  # but for the distortion


def test_fingers_turn_and_pinch(browser: Chrome, page: Path) -> None:
    show(browser, page, NARROW)
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 2})

    def touch(kind: str, *places: tuple[int, int]) -> None:
        points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places)]
        browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points})

    try:
        first = address(browser)
        touch("Start", (150, 360))
        for k in range(1, 6):
            touch("Move", (150 + 16 * k, 360))
        touch("End")
        time.sleep(0.8)
        turned = address(browser)
        assert turned["azimuth"] != first["azimuth"]
        touch("Start", (180, 360), (220, 360))
        for k in range(1, 6):
            touch("Move", (180 - 16 * k, 360), (220 + 16 * k, 360))
        touch("End")
        time.sleep(0.8)
        nearer = address(browser)
        assert float(nearer["distance"]) < 0.6 * float(turned["distance"])
        assert cloud_share(browser, NARROW) > 0.05
    finally:
        browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})


EVERY = 2
"""Cells of the raster from a corner of the mesh to the next."""


@pytest.fixture(scope="module")
def raster(cloud: DescribedCloud) -> Raster:
    east, north, height = np.median(cloud.position_map_m, axis=0).round()
    return surface_on(east - COLUMNS * CELL_M / 2, north + ROWS * CELL_M / 2, height)


@pytest.fixture(scope="module")
def surface_page(
    full_report: Json, cloud: DescribedCloud, raster: Raster, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A page with a surface of which every second cell is a corner."""
    folder = tmp_path_factory.mktemp("surface")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("photogram.report.view.drawn_surface.MOST_CORNERS", ROWS * COLUMNS // EVERY**2 + 1)
        surface = drawn_surface(*write_surface(folder, raster, full_report["crs"]))
    assert surface is not None
    assert surface.every == EVERY
    text = view_page(cloud, report_of(json.dumps(full_report)), "dense.laz", 100_000, surface=surface)
    (folder / "view.html").write_text(text, encoding="utf-8")
    return folder / "view.html"


def cell_place(raster: Raster, row: int, column: int) -> FloatArray:
    east, north = raster.west_map_m + (column + 0.5) * CELL_M, raster.north_map_m - (row + 0.5) * CELL_M
    return np.array([east, north, raster.values[row, column]], dtype=np.float64)


def looking_at(place_map_m: FloatArray, **more: object) -> Json:
    return {"at": ",".join(f"{v:.3f}" for v in place_map_m), "azimuth": 0, "tilt": 0, "distance": 20} | more


def hide_signs(browser: Chrome) -> None:
    for name in ("photographs", "control", "check", "errors"):
        browser.execute_script(f"document.getElementById('show-{name}').click()")


def around_the_middle(image: ByteArray, pixels: int = 12) -> ByteArray:
    row, column = (length // 2 for length in image.shape[:2])
    return image[row - pixels : row + pixels, column - pixels : column + pixels].reshape(-1, 3)


def test_a_page_without_a_surface_has_no_control_for_one(browser: Chrome, page: Path) -> None:
    show(browser, page)
    assert browser.execute_script("return ['show-surface', 'faces'].map(id => document.getElementById(id))") == [
        None,
        None,
    ]
    press(browser, "s")
    press(browser, "T")
    wait_until(browser, "location.hash.includes('tilt=0&')")
    assert "drawn" not in address(browser)
    assert browser.get_log("browser") == []


def test_the_surface_takes_the_place_of_the_cloud_and_is_kept_in_the_address(
    browser: Chrome, surface_page: Path, raster: Raster
) -> None:
    browser.get_log("browser")
    browser.get_log("performance")
    show(browser, surface_page, **looking_at(cell_place(raster, 90, 40)))
    assert address(browser)["drawn"] == "cloud"
    assert browser.execute_script("return document.getElementById('faces').hidden")
    before = picture(browser)
    press(browser, "s")
    wait_until(browser, "picture.dataset.surface === 'drawn' && location.hash.endsWith('drawn=surface')")
    hide_signs(browser)
    time.sleep(0.5)
    shown = picture(browser)
    assert np.mean(np.any(shown != before, axis=2)) > 0.3
    middle = np.abs(around_the_middle(shown).astype(int) - COLOUR).max(axis=1)
    assert np.mean(middle < 30) > 0.8, "the orthophoto, hardly shaded, behind the cross of the keys"
    legend = browser.execute_script("return document.getElementById('faces').innerText")
    assert "one cell of 2 × 2 of dsm_filled.tif" in legend
    assert legend.count("not measured") == 2
    kept = address(browser)
    show(browser, surface_page, WIDE, "light", **kept)
    wait_until(browser, "picture.dataset.surface === 'drawn'")
    assert browser.execute_script(
        "return ['cloud', 'surface'].map(n => document.getElementById('show-' + n).checked)"
    ) == [
        False,
        True,
    ]
    press(browser, "2")  # heights are colours of the surface too
    wait_until(browser, "location.hash.includes('colour=height')")
    assert np.mean(np.any(picture(browser) != shown, axis=2)) > 0.3
    press(browser, "s")
    wait_until(browser, "location.hash.endsWith('drawn=cloud')")
    assert browser.get_log("browser") == []
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    assert [u for u in sent if not u.startswith((surface_page.as_uri(), "data:", "about:", "chrome:"))] == []


@pytest.mark.parametrize(("row", "column"), [(90, 40), (56, 70), (20, 100)])
def test_a_pixel_of_the_surface_tells_the_height_of_the_raster(
    browser: Chrome, surface_page: Path, raster: Raster, row: int, column: int
) -> None:
    """From above in the middle of the page, and obliquely at a pixel beside it, in perspective and parallel."""
    place = cell_place(raster, row, column)
    show(browser, surface_page, **looking_at(place, drawn="surface"))
    wait_until(browser, "picture.dataset.surface === 'drawn'")
    hide_signs(browser)
    press(browser, "Enter")
    card = said(browser)
    assert card["title"] == "Point of the surface"
    assert coordinates(card) == pytest.approx(place.tolist(), abs=1.1e-3)
    for parallel in (0, 1):
        aside = place + np.array([1.0, -1.0, 0.5])
        show(browser, surface_page, **looking_at(aside, drawn="surface", azimuth=160, tilt=40, parallel=parallel))
        wait_until(browser, "picture.dataset.surface === 'drawn'")
        hide_signs(browser)
        # whole pixels are clicked on, and the ground leans
        x, y = expected_pixel(place, address(browser), WIDE).round()
        click(browser, x, y)
        told = np.array(coordinates(said(browser)))
        assert np.abs(told - place).max() < 0.06
        assert expected_pixel(told, address(browser), WIDE) == pytest.approx([x, y], abs=0.1)


def test_walls_and_what_is_interpolated_look_so_and_say_so(browser: Chrome, surface_page: Path, raster: Raster) -> None:
    show(browser, surface_page)
    tone = {name: browser.execute_script(f"return colourOf('--{name}')") for name in ("wall", "unmeasured")}
    at_the_wall = cell_place(raster, 55, HOUSE[1].start) - np.array([CELL_M, 0.0, HOUSE_M / 2])
    for place, tilt, words, name in (
        (cell_place(raster, 90, FILLED[1].start + 10), 0, "Interpolated: not measured.", "unmeasured"),
        (at_the_wall, 60, "A wall, interpolated", "wall"),
    ):
        show(browser, surface_page, **looking_at(place, drawn="surface", distance=12, azimuth=90, tilt=tilt))
        wait_until(browser, "picture.dataset.surface === 'drawn'")
        hide_signs(browser)
        time.sleep(0.5)
        pixels = around_the_middle(picture(browser), 6).astype(int)
        near = np.abs(pixels - tone[name]).max(axis=1) < 40
        assert near.mean() > 0.25
        assert not (np.abs(pixels - COLOUR).max(axis=1) < 30).any(), "nothing of the orthophoto's colours"
        press(browser, "Enter")
        said(browser)
        assert words in browser.execute_script("return said.innerText")


def test_a_distance_to_what_nobody_has_measured_has_no_sigma(browser: Chrome, surface_page: Path) -> None:
    show(browser, surface_page)
    measured, mixed = browser.execute_script(
        """const scene = JSON.parse(document.getElementById('scene').textContent), errors = new Errors(scene);
        const end = (surface, east) => ({ surface, cloud: NO_FIGURES, place: [east, 0, 0] });
        return [MEASURED, WALL].map(kind => errors.distance(end(MEASURED, 0), end(kind, 9)));"""
    )
    assert measured["kind"] == "shape"
    assert measured["sigma"][1] > 0
    assert mixed is None


def test_a_page_with_a_surface_fits_a_telephone(browser: Chrome, surface_page: Path) -> None:
    show(browser, surface_page, NARROW, drawn="surface", colour="height")
    wait_until(browser, "picture.dataset.surface === 'drawn'")
    outside = """return ['title', 'panel', 'measures', 'ramp', 'faces'].map(id => document.getElementById(id))
        .filter(e => { const b = e.getBoundingClientRect(); return b.right > innerWidth || b.bottom > innerHeight; })
        .map(e => e.id)"""
    assert browser.execute_script(outside) == []
    assert cloud_share(browser, NARROW) > 0.05
