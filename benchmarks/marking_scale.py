"""Waiting times and memory of `photogram mark` with many photographs of 20 megapixels, beside a few.

    python benchmarks/marking_scale.py [PHOTOGRAPHS] [--compare 10] [--folder FOLDER] [--pause 5] [--no-browser]

                                                                                        default: 1000

A lawnmower flight 100 m above 20 ground points, 5472 × 3648 px, 80/70 % overlap: every photograph is a file of its own
with its own tags and 7 to 8 MB; the pixels behind the tags are those of four pictures. (EXIF's own size entries say
8 × 8 px; photogram reads the size from the picture itself.) 1 000 photographs take 8 GB, in FOLDER or a temporary one,
and those in FOLDER are used again. Where memory suffices, files come from the system's cache.

    started         the command's start until it gives the address, while it reads all tags, and the time after
    places          from the address until the places are predicted
    first shown     the page is opened until the first patches of the first point are there, places being known
    next shown      the next point is chosen until its first patches are there, `pause` seconds after the page asked to
                    read it ahead: the median and the longest of all points
    marks           from three marks each of two points until all places are predicted anew; then first and next again:
                    ellipses are smaller, and patches in the photograph's own pixels
    browser         in Chromium, where it is installed, until all patches in view are drawn: "first" from the snapshot
                    the places are known, the page having been opened as soon as there was an address, as the command
                    does it; "from the address" the same from there on; "opened anew" from opening the page again, and
                    "next" from choosing the point; its JavaScript memory at the end
    peak memory     of the server, after all points

Requests are those of the page, over six connections as a browser makes them; the first patches are twelve.

Held: the first point within 1 s and the next within 0.3 s (the median), with and without marks; memory within 1 GB, and
with many photographs at most 150 MB above that with few, which the factors of their poses take. What is kept of
pictures, 256 MB, does not grow with the number of photographs.
"""

from __future__ import annotations

import argparse
import io
import json
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING
from urllib.parse import quote

import cv2
import numpy as np
from lib.marking_command import Answer, MarkCommand, Page, photogram, running
from PIL import Image

from photogram.arrays import ByteArray
from photogram.files.photographs.images import write_photograph
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.frames import geodetic_from_map
from photogram.marking.page.addresses import scale_for
from photogram.report.printing import browser_options, find_browser

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

WIDTH_PX, HEIGHT_PX, FOCAL_MM, FOCAL_35MM_MM = 5472, 3648, 8.8, 24.0
FLYING_HEIGHT_M, ALONG_M, ACROSS_M = 100.0, 20.0, 45.0
CRS, WEST_M, SOUTH_M, GROUND_M = "EPSG:25832", 600000.0, 5800000.0, 120.0
PICTURES, QUALITY = 4, 92
POINTS = 20
FIRST_PATCHES, CONNECTIONS = 12, 6
SIDE_PX = 300
"""Of a patch on the screen."""
MARKED_POINTS, MARKS_EACH = 2, 3
FIRST_S, NEXT_S, PEAK_BYTES, MORE_BYTES = 1.0, 0.3, 1.0e9, 150e6
STATIC = ("mark.css", "main.js", "api.js", "loupe.js", "patch.js", "plan.js")


# ---- the survey ------------------------------------------------------------------------------------------------------


def picture(rng: np.random.Generator) -> bytes:
    """Return a JPEG of ground-like texture at all scales."""
    pixels = np.full((HEIGHT_PX, WIDTH_PX, 3), 110.0, np.float32)
    for cell, dn, bands in ((1, 4.0, 1), (2, 6.0, 1), (8, 10.0, 3), (64, 14.0, 3), (400, 25.0, 3)):
        grid = rng.normal(0.0, dn, (HEIGHT_PX // cell + 2, WIDTH_PX // cell + 2, bands)).astype(np.float32)
        wide = np.asarray(cv2.resize(grid, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_CUBIC), np.float32)
        pixels += wide if bands > 1 else wide[..., None]
    stream = io.BytesIO()
    rounded: ByteArray = np.clip(pixels, 0.0, 255.0).astype(np.uint8)
    Image.fromarray(rounded).save(stream, "JPEG", quality=QUALITY, subsampling="4:2:2")
    return stream.getvalue()


def parts_of(jpeg: bytes) -> tuple[bytes, bytes]:
    """Return the segments of a JPEG that hold tags (APPn), and all that follows them."""
    place = 2
    while 0xE0 <= jpeg[place + 1] <= 0xEF:
        place += 2 + int.from_bytes(jpeg[place + 2 : place + 4], "big")
    return jpeg[2:place], jpeg[place:]


def flight(count: int) -> list[tuple[float, float, float]]:
    """Return easting, northing and yaw of photographs in lines of 2.5 times their number, or as near to that."""
    lines = max(round((count / 2.5) ** 0.5), 1)
    each = -(-count // lines)
    found = []
    for k in range(count):
        line, place = divmod(k, each)
        north = place if line % 2 == 0 else each - 1 - place
        found.append((WEST_M + line * ACROSS_M, SOUTH_M + north * ALONG_M, 0.0 if line % 2 == 0 else 180.0))
    return found


def tags_of(k: int, place: tuple[float, float, float]) -> PhotographTags:
    """Return what a drone without RTK writes into photograph ``k``."""
    east, north, yaw = place
    height = GROUND_M + FLYING_HEIGHT_M
    lon, lat, _ = (float(v) for v in geodetic_from_map(CRS, np.array([[east, north, height]]))[0])
    return PhotographTags(
        make="DJI", model="FC6310R", focal_mm=FOCAL_MM, focal_35mm_mm=FOCAL_35MM_MM,
        time=datetime(2024, 6, 1, 10) + timedelta(seconds=2.5 * k), longitude_deg=lon, latitude_deg=lat,
        height_m=height, height_above_take_off_m=FLYING_HEIGHT_M, gimbal_yaw_deg=yaw, gimbal_pitch_deg=-90.0,
        gimbal_roll_deg=0.0,
    )  # fmt: skip


def written_survey(folder: Path, count: int) -> Path:
    """Write photographs, points and project, unless they are there, and return the project."""
    project, photographs = folder / "project.yaml", folder / "photographs"
    if project.exists():
        return project
    photographs.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    scans = [parts_of(picture(rng))[1] for _ in range(PICTURES)]
    places = flight(count)
    for k, place in enumerate(places):
        header = folder / "header.jpg"
        write_photograph(header, np.zeros((8, 8, 3), np.uint8), tags_of(k, place))
        tags = parts_of(header.read_bytes())[0]
        (photographs / f"DJI_{k + 1:04d}.JPG").write_bytes(b"\xff\xd8" + tags + scans[k % PICTURES])
        header.unlink()
    ground = np.array(places)[:, :2]
    low, high = ground.min(axis=0), ground.max(axis=0)
    rows = ["name,easting,northing,height,sigma_easting,sigma_northing,sigma_height"]
    for g, share in enumerate(rng.uniform(0.05, 0.95, (POINTS, 2))):
        east, north = low + share * (high - low)
        rows.append(f"P{g + 1},{east:.3f},{north:.3f},{GROUND_M + rng.normal(0.0, 2.0):.3f},0.02,0.02,0.03")
    (folder / "points.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    command: list[str | Path] = [photogram(), "init", photographs, "--control", folder / "points.csv"]
    options: list[str | Path] = ["--crs", CRS, "--heights", "ellipsoidal", "--project", project]
    subprocess.run([*command, *options], check=True, stdout=subprocess.DEVNULL)
    return project


# ---- what the page asks for ------------------------------------------------------------------------------------------


class Pages:
    """The connections of one browser."""

    def __init__(self, port: int, token: str) -> None:
        self._free: SimpleQueue[Page] = SimpleQueue()
        for _ in range(CONNECTIONS):
            self._free.put(Page(port, token))
        self._pool = ThreadPoolExecutor(CONNECTIONS)

    def all_of(self, addresses: Sequence[str]) -> list[bytes]:
        """Return what is answered to several requests, made in their order over all connections."""
        return list(self._pool.map(self._one, addresses))

    def _one(self, address: str) -> bytes:
        page = self._free.get()
        try:
            return page.get(address)
        finally:
            self._free.put(page)

    def act(self, **action: object) -> None:
        """Have something done."""
        page = self._free.get()
        try:
            page.act(action)
        finally:
            self._free.put(page)

    def record(self, address: str) -> Answer:
        """Return an object that is answered."""
        value = json.loads(self._one(address))
        if not isinstance(value, dict):
            raise SystemExit(f"{address}: no object")
        return value

    def close(self) -> None:
        """Close the connections."""
        self._pool.shutdown()
        while not self._free.empty():
            self._free.get().close()

    def wait(self) -> None:
        """Follow the events until nothing is being computed."""
        while True:
            state = self.record("state")
            if not state["computing"]:
                return
            self._one(f"events?after={state['version']}")

    def known_at(self) -> float:
        """Wait until the places are known, and return when that was, a time of the system."""
        self.wait()
        return time.time()

    def opened(self) -> tuple[float, Answer]:
        """Open the page; return the seconds until the first patches of its first point, and that point."""
        began = time.perf_counter()
        self._one("")
        self.all_of([f"static/{name}" for name in STATIC])
        state = self.record("state")
        points = state["points"]
        assert isinstance(points, list)
        first = next((p for p in points if not p["enough"]), points[0])["name"]
        _, view = self._shown(str(first))
        return time.perf_counter() - began, view

    def chosen(self, name: str) -> tuple[float, Answer]:
        """Choose a point; return the seconds until its first patches, and the point."""
        began = time.perf_counter()
        _, view = self._shown(name)
        return time.perf_counter() - began, view

    def _shown(self, name: str) -> tuple[list[bytes], Answer]:
        content, _ = self.all_of([f"state?point={quote(name, safe='')}", "plan"])
        view: Answer = json.loads(content)["shown"]
        addresses = [patch_address(record, view) for record in photographs_of(view)[:FIRST_PATCHES]]
        return self.all_of([address for address in addresses if address]), view

    def ahead(self, name: str) -> None:
        """Have a point read ahead."""
        self._one(f"ahead/{quote(name, safe='')}?shown={FIRST_PATCHES}&side={SIDE_PX}")


def photographs_of(view: Answer) -> list[Answer]:
    """Return the photographs of a point."""
    found = view["photographs"]
    assert isinstance(found, list)
    return found


def patch_address(record: Answer, view: Answer) -> str:
    """Return the address of the patch that the page asks for, empty where none lies in the photograph."""
    span = _number(view["span_px"])
    mark = record["mark"] or record["proposal"] or record
    assert isinstance(mark, dict)
    u, v = (WIDTH_PX / 2, HEIGHT_PX / 2) if mark["u"] is None else (_number(mark["u"]), _number(mark["v"]))
    u, v = min(max(u, 0.0), WIDTH_PX - 1.0), min(max(v, 0.0), HEIGHT_PX - 1.0)
    left, upper, side = int(u - span / 2 + 0.5), int(v - span / 2 + 0.5), int(span) + 2
    name = quote(str(record["name"]), safe="")
    return f"patch?photograph={name}&x={left}&y={upper}&width={side}&height={side}&scale={scale_for(span, SIDE_PX)}"


def _number(value: object) -> float:
    assert isinstance(value, int | float)
    return float(value)


# ---- measurements ----------------------------------------------------------------------------------------------------


@dataclass
class Waiting:
    """Seconds until the first point and the next ones were shown."""

    first_s: float = float("nan")
    next_s: list[float] = field(default_factory=list)
    scale: int = 0

    @property
    def median_s(self) -> float:
        """The median of the next points."""
        return statistics.median(self.next_s)

    @property
    def is_held(self) -> bool:
        """Whether both are short."""
        return self.first_s <= FIRST_S and self.median_s <= NEXT_S


@dataclass
class Measurement:
    """What was measured of one survey."""

    photographs: int
    started_s: tuple[float, float] = (float("nan"), float("nan"))
    places_s: float = float("nan")
    unmarked: Waiting = field(default_factory=Waiting)
    marks_s: float = float("nan")
    marked: Waiting = field(default_factory=Waiting)
    peak_bytes: int = 0
    browser: Waiting | None = None
    whole_s: float = float("nan")
    anew_s: float = float("nan")
    heap_bytes: float = float("nan")

    @property
    def waiting(self) -> list[Waiting]:
        """All waiting times."""
        return [self.unmarked, self.marked, *([self.browser] if self.browser else [])]


def visited(pages: Pages, pause_s: float) -> Waiting:
    """Open the page, and go on from point to point, each read ahead."""
    found = Waiting()
    found.first_s, view = pages.opened()
    found.scale = scale_for(_number(view["span_px"]), SIDE_PX)
    for _ in range(POINTS - 1):
        name = str(view["next"])
        pages.ahead(name)
        time.sleep(pause_s)
        seconds, view = pages.chosen(name)
        found.next_s.append(seconds)
    return found


def marked(pages: Pages, names: Sequence[str]) -> float:
    """Mark points where they are predicted; return the seconds until all places are predicted with the marks."""
    for name in names:
        for record in photographs_of(pages.record(f"point/{name}"))[:MARKS_EACH]:
            place = {"photograph": record["name"], "u": record["u"], "v": record["v"]}
            pages.act(do="mark", point=name, raw=True, **place)
    began = time.perf_counter()
    pages.wait()
    return time.perf_counter() - began


def served(project: Path, count: int, pause_s: float) -> Measurement:
    """Measure over HTTP."""
    found, log = Measurement(count), project.with_name("log.txt")
    with running(project, log) as command:
        first_s = command.address()[2]
    with running(project, log) as command:
        port, token, again_s = command.address()
        found.started_s = first_s, again_s
        pages = Pages(port, token)
        began = time.perf_counter()
        pages.wait()
        found.places_s = time.perf_counter() - began
        found.unmarked = visited(pages, pause_s)
        found.marks_s = marked(pages, [f"P{g + 1}" for g in range(MARKED_POINTS)])
        found.marked = visited(pages, pause_s)
        found.peak_bytes = command.peak_bytes
        pages.close()
    return found


@contextmanager
def chromium(folder: Path) -> Iterator[Chrome | None]:
    """Give a browser without a window, None where there is none."""
    binary, driver = find_browser(), shutil.which("chromedriver")
    if binary is None or driver is None:
        yield None
        return
    from selenium.webdriver import Chrome, ChromeOptions
    from selenium.webdriver.chrome.service import Service

    options = ChromeOptions()
    options.binary_location = binary
    for option in (*browser_options(folder / "profile"), "--window-size=1600,1000"):
        options.add_argument(option)
    chrome = Chrome(options=options, service=Service(driver))
    try:
        yield chrome
    finally:
        chrome.quit()


DRAWN = """
const seen = [...document.querySelectorAll('figure')].filter(f => {
  const box = f.getBoundingClientRect(); return box.top < innerHeight && box.bottom > 0; });
return Boolean(document.body.dataset.ready) && seen.length > 0 && seen.every(f => f.dataset.drawn)
  && (arguments[0] === null || document.getElementById('name').textContent === arguments[0]);
"""


LAST_DRAWN = """
const [last] = performance.getEntriesByName('drawn').slice(-1); return (performance.timeOrigin + last.startTime) / 1000;
"""


def drawn_s(chrome: Chrome, began: float, name: str | None) -> float:
    """Wait until all patches in view are drawn, and return the seconds from ``began``, a time of the system, to the
    last of them, as the page has it: asking often would keep the browser from its work."""
    while not chrome.execute_script(DRAWN, name):
        if time.time() > began + 120.0:
            raise SystemExit("the page is not drawn")
        time.sleep(0.1)
    return float(chrome.execute_script(LAST_DRAWN)) - began


def in_browser(command: MarkCommand, chrome: Chrome, pause_s: float, measured: Measurement) -> None:
    """Measure in the browser."""
    port, token, _ = command.address()
    pages, found = Pages(port, token), Waiting()
    address, began = f"http://127.0.0.1:{port}/{token}/", time.time()
    with ThreadPoolExecutor(1) as beside:
        known = beside.submit(pages.known_at)
        chrome.get(address)
        measured.whole_s = drawn_s(chrome, began, None)
    found.first_s = began + measured.whole_s - known.result()
    names = [str(p["name"]) for p in _points(pages)]
    for _ in names[1:]:
        name = str(pages.record(f"point/{_chosen(chrome)}")["next"])
        time.sleep(pause_s)
        began = time.time()
        chrome.execute_script("document.getElementById('next').click()")
        found.next_s.append(drawn_s(chrome, began, name))
    chrome.get("about:blank")
    began = time.time()
    chrome.get(address)
    measured.anew_s = drawn_s(chrome, began, None)
    pages.close()
    chrome.execute_cdp_cmd("Performance.enable", {})
    metrics = chrome.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
    measured.browser, measured.heap_bytes = found, next(m["value"] for m in metrics if m["name"] == "JSHeapUsedSize")


def _chosen(chrome: Chrome) -> str:
    return str(chrome.execute_script("return document.getElementById('name').textContent"))


def _points(pages: Pages) -> list[Answer]:
    points = pages.record("state")["points"]
    assert isinstance(points, list)
    return points


def measured(folder: Path, count: int, pause_s: float, browser: bool) -> Measurement:
    """Measure a survey of so many photographs, which is written where it is missing."""
    began = time.perf_counter()
    project = written_survey(folder / str(count), count)
    print(f"{count} photographs: written in {time.perf_counter() - began:.0f} s", flush=True)
    _forget(project)
    found = served(project, count, pause_s)
    if browser:
        _forget(project, marks_alone=True)
        with tempfile.TemporaryDirectory() as profile, chromium(Path(profile)) as chrome:
            if chrome is not None:
                with running(project, project.with_name("log.txt")) as command:
                    in_browser(command, chrome, pause_s, found)
    return found


def _forget(project: Path, marks_alone: bool = False) -> None:
    """Remove what an earlier measurement has left: marks, and the tags that were read."""
    work = project.with_name("work")
    shutil.rmtree(work / "marking" if marks_alone else work, ignore_errors=True)
    for path in project.parent.glob("marks*.csv"):
        path.unlink()


def rows_of(found: Measurement) -> dict[str, str]:
    """Return what the table says of one survey."""
    rows = {
        "started, tags read": f"{found.started_s[0]:.1f} s",
        "started again": f"{found.started_s[1]:.1f} s",
        "places": f"{found.places_s:.1f} s",
    }
    for words, one in (("", found.unmarked), ("with marks, ", found.marked), ("browser, ", found.browser)):
        if one is None:
            continue
        if one is found.marked:
            rows["marks"] = f"{found.marks_s:.1f} s"
        rows[f"{words}first shown"] = f"{one.first_s:.2f} s" + (f", 1 : {one.scale}" if one.scale else "")
        rows[f"{words}next shown"] = f"{one.median_s:.2f} s, longest {max(one.next_s):.2f} s"
    if found.browser is not None:
        rows["browser, from the address"] = f"{found.whole_s:.2f} s"
        rows["browser, opened anew"] = f"{found.anew_s:.2f} s"
        rows["browser, JavaScript memory"] = f"{found.heap_bytes / 1e6:.0f} MB"
    return {**rows, "peak memory": f"{found.peak_bytes / 1e6:.0f} MB"}


def main() -> None:
    """Print the table, and what is held."""
    parser = argparse.ArgumentParser()
    parser.add_argument("photographs", type=int, nargs="?", default=1000)
    parser.add_argument("--compare", type=int, default=10)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--pause", type=float, default=5.0)
    parser.add_argument("--no-browser", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder.absolute() if given.folder else Path(temporary)
        found = [
            measured(folder, count, given.pause, not given.no_browser) for count in (given.compare, given.photographs)
        ]
    columns = [rows_of(one) for one in found]
    print(f"{'':28}" + "".join(f"{one.photographs:>30}" for one in found))
    for name in columns[-1]:
        print(f"{name:28}" + "".join(f"{column.get(name, ''):>30}" for column in columns))
    few, many = found
    waits = all(one.is_held for one in many.waiting) and not many.anew_s > FIRST_S
    memory = many.peak_bytes <= PEAK_BYTES and many.peak_bytes - few.peak_bytes <= MORE_BYTES
    print(f"{'held' if waits else 'not held'}: the first point within {FIRST_S:g} s, the next within {NEXT_S:g} s")
    print(
        f"{'held' if memory else 'not held'}: the server within {PEAK_BYTES / 1e6:.0f} MB, and at most "
        f"{MORE_BYTES / 1e6:.0f} MB above what it needs for {few.photographs} photographs"
    )


if __name__ == "__main__":
    main()
