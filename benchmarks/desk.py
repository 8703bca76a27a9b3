"""`photogram desk` with many photographs, and with an orthophoto of gigapixels.

    python benchmarks/desk.py [PHOTOGRAPHS] [--gigapixels 2] [--folder FOLDER]

                               default: 500

The survey is that of `marking_scale.py`: photographs of 20 megapixels in files of their own, 7 to 8 MB each. The
orthophoto is written by photogram's own writer, noise at several scales, in cells of 2 cm; nothing was run. Files in
FOLDER are used again.

    map             the photographs, points and what is odd, asked for anew: all tags are read
    coverage        counts and gaps by the tags; expected: the accuracy to expect
    memory          of the server at its most, after all of it and the orthophoto
    first picture   in Chromium, from the step until the orthophoto is drawn
    panning         at one pixel of the orthophoto to one of the screen, 400 px a second for ten seconds: frames that
                    the map has drawn a second, and the longest time between two of them. The browser draws with the
                    processor alone

Held: map within 2 s, coverage and expected accuracy within 60 s, memory within 1 GiB, first picture within 1 s, 30
frames a second.
"""

import argparse
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from lib.marking_command import MarkCommand, Page, photogram
from marking_scale import CRS, SOUTH_M, WEST_M, chromium, written_survey

from photogram.arrays import ByteArray
from photogram.files.maps.cogs import write_cog_rgba
from photogram.grid import MapGrid, Window
from photogram.result_files import ResultFolder

CELL_M, TILE = 0.02, 4096
MAP_S, FIELD_S, MEMORY_BYTES, FIRST_S, FRAMES = 2.0, 60.0, 2**30, 1.0, 30.0

FIRST = """
const end = arguments[0], from = performance.now();
location.hash = 'look';
const wait = () => { if (!window.desk?.map) return setTimeout(wait, 5);
  const map = window.desk.map; map.once('rendercomplete', () => end(performance.now() - from)); map.render(); };
wait();
"""
PANNED = """
const [cell, seconds, end] = arguments, map = window.desk.map, view = map.getView(), times = [];
view.setResolution(cell);
map.once('rendercomplete', () => {
  const [x, y] = view.getCenter(), from = performance.now();
  const drawn = () => times.push(performance.now());
  map.on('postrender', drawn);
  const step = now => {
    const gone = (now - from) / 1000;
    if (gone > seconds) { map.un('postrender', drawn); return end(times); }
    view.setCenter([x + 400 * cell * gone, y + 150 * cell * gone]);
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
});
map.render();
"""


def tiles(side: int) -> Iterator[tuple[Window, ByteArray]]:
    """Yield the tiles of a picture of noise at several scales."""
    rng = np.random.default_rng(1)
    base = np.zeros((TILE, TILE, 3), dtype=np.float32)
    for cell, dn in ((1, 6.0), (4, 10.0), (32, 14.0), (256, 25.0)):
        noise = rng.normal(0.0, dn, (TILE // cell, TILE // cell, 3)).astype(np.float32)
        base += noise.repeat(cell, axis=0).repeat(cell, axis=1)
    for row in range(0, side, TILE):
        for column in range(0, side, TILE):
            rows, columns = min(TILE, side - row), min(TILE, side - column)
            shade = rng.uniform(80.0, 160.0)
            colours = np.clip(np.roll(base, (row // 7, column // 5), axis=(0, 1))[:rows, :columns] + shade, 0, 255)
            alpha = np.full((rows, columns, 1), 255)
            yield (
                Window(row, column, row + rows, column + columns),
                np.concatenate([colours, alpha], axis=2).astype(np.uint8),
            )


def written_orthophoto(folder: Path, gigapixels: float) -> Path:
    """Write the orthophoto, unless it is there."""
    path = folder / "results" / ResultFolder.DELIVERABLES / "orthophoto.tif"
    side = round((gigapixels * 1e9) ** 0.5)
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_cog_rgba(path, MapGrid(WEST_M, SOUTH_M + side * CELL_M, CELL_M, side, side), CRS, tiles(side))
    print(f"orthophoto: {side} x {side} px, {path.stat().st_size / 1e9:.2f} GB")
    return path


@contextmanager
def serving(folder: Path) -> Iterator[MarkCommand]:
    """Run the command."""
    log = folder / "desk.txt"
    with log.open("wb") as stream:
        began_s = time.monotonic()
        process = subprocess.Popen(
            [photogram(), "desk", folder, "--no-browser"], stdin=subprocess.DEVNULL, stdout=stream, stderr=stream
        )
    command = MarkCommand(process, log, began_s)
    try:
        yield command
    finally:
        command.kill()


def asked_s(page: Page, name: str) -> float:
    """Return the seconds that an answer takes."""
    began = time.perf_counter()
    page.get(f"api/{name}")
    return time.perf_counter() - began


def said(what: str, value: float, unit: str, limit: float, *, least: bool = False) -> None:
    """Print a figure beside what is held."""
    held = value >= limit if least else value <= limit
    bound = f"{'at least' if least else 'at most'} {limit:g}"
    print(f"{what:34} {value:8.2f} {unit:8} {'held' if held else 'not held'}: {bound}")


def in_browser(port: int, token: str, scratch: Path) -> None:
    """Measure the orthophoto in Chromium."""
    with chromium(scratch) as chrome:
        if chrome is None:
            print("no Chromium: not measured in the browser")
            return
        chrome.set_script_timeout(300)
        chrome.get(f"http://127.0.0.1:{port}/{token}/#run")
        time.sleep(2.0)
        said("first picture", chrome.execute_async_script(FIRST) / 1000, "s", FIRST_S)
        drawn_ms = np.array(chrome.execute_async_script(PANNED, CELL_M, 10.0))
        gaps = np.diff(drawn_ms)
        said("panning", 1000 * len(gaps) / float(np.ptp(drawn_ms)), "frames/s", FRAMES, least=True)
        print(f"{'longest between two frames':34} {gaps.max():8.0f} ms")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("photographs", type=int, nargs="?", default=500)
    parser.add_argument("--gigapixels", type=float, default=2.0)
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch) / "survey"
        written_survey(folder, options.photographs)
        written_orthophoto(folder, options.gigapixels)
        with serving(folder) as command:
            port, token, started_s = command.address()
            print(f"{options.photographs} photographs; the address after {started_s:.1f} s")
            page = Page(port, token)
            said("map", asked_s(page, "overview"), "s", MAP_S)
            said("coverage", asked_s(page, "coverage"), "s", FIELD_S)
            said("accuracy to expect", asked_s(page, "expected"), "s", FIELD_S)
            page.close()
            in_browser(port, token, Path(scratch))
            said("memory of the server", command.peak_bytes / 2**30, "GiB", MEMORY_BYTES / 2**30)


if __name__ == "__main__":
    main()
