"""Draw comparisons on the page of `photogram desk`: a design, and two epochs side by side.

Call: python docs/pictures/desk_compared.py FOLDER SURVEY, SURVEY made by `photogram demo SURVEY --dense`. Writes
`desk_design.png`, `desk_epochs.png` and `desk_swipe.png` into the folder. Both other surfaces are made up beside a copy
of the survey: a basin to be dug, and an earlier survey without a heap of 1.2 m and a pit of 0.8 m. Needs Chromium and
its driver.
"""

import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from desk_pages import DRAWN_AFTER_S, WIDE, draw, shown
from selenium.webdriver import Chrome

from photogram.arrays import FloatArray
from photogram.desk.kept_measurements import FILE, KeptMeasurements
from photogram.desk.map_layers.asked import Asked
from photogram.desk.map_layers.kept_comparisons import KeptComparisons
from photogram.files.maps.rasters import read_raster, write_raster
from photogram.grid import MapGrid
from photogram.result_files import result_path
from photogram.survey import Raster

ASKED: Asked = {
    "path": "", "relation": "design", "own": "surface", "parts": [], "sigma_m": None, "correlation_m": None,
    "outlines": [], "stable": [], "taken_off": None,
}  # fmt: skip
BASIN_M, FLOOR_M, DEPTH_M, RIM_M = np.array([15.0, 11.0]), np.array([10.0, 7.0]), 1.2, 0.8


def main(folder: Path, survey: Path) -> None:
    """Make the other surfaces and the comparisons, and take the pictures."""
    with tempfile.TemporaryDirectory() as scratch:
        site = Path(shutil.copytree(survey, Path(scratch) / "quarry_june"))
        surface, crs = read_raster(result_path(site / "results", "dsm.tif"))
        place = _places(surface)
        known = np.isfinite(surface.values)
        middle, height_m = place[known].mean(axis=0), float(np.median(surface.values[known]))
        measured = KeptMeasurements(site / FILE, site / "results", crs)
        measured.add("area", (middle + np.array([[-10, -7], [10, -7], [10, 7], [-10, 7]])).tolist())
        measured.rename(0, "Basin floor")
        design = _basin(Path(scratch) / "basin.xml", middle, height_m)
        earlier = _earlier(site, Path(scratch) / "quarry_may", surface, crs, place - middle)
        _compare(site, {**ASKED, "path": str(earlier), "relation": "earlier"}, measured)
        _compare(site, {**ASKED, "path": str(design), "own": "terrain", "outlines": [0]}, measured)
        with shown(site, WIDE) as (browser, address):
            browser.get(f"{address}#look")
            time.sleep(DRAWN_AFTER_S)
            _press(browser, 0, "Difference")
            draw(browser, folder, "design", narrow=False)
            _press(browser, 1, "Swipe: surface")
            draw(browser, folder, "swipe", narrow=False)
            _press(browser, 1, "Difference")
            draw(browser, folder, "epochs", narrow=False)


def _places(surface: Raster) -> FloatArray:
    east, north = MapGrid.of(surface).centres_map_m(MapGrid.of(surface).whole)
    return np.stack(np.meshgrid(east, north), axis=-1)


def _basin(path: Path, middle: FloatArray, height_m: float) -> Path:
    """Write a basin with a level floor and slopes around it."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    plan = np.concatenate([middle + signs * BASIN_M, middle + signs * FLOOR_M])
    heights = np.repeat([height_m + RIM_M, height_m - DEPTH_M], 4)
    rows = zip(plan.tolist(), heights.tolist(), strict=True)
    points = "".join(f'<P id="{n}">{y:.3f} {x:.3f} {z:.3f}</P>' for n, ((x, y), z) in enumerate(rows, 1))
    sides = [(k, k % 4 + 1, k % 4 + 5, k + 4) for k in range(1, 5)]
    faces = "".join(f"<F>{a} {b} {c}</F><F>{a} {c} {d}</F>" for a, b, c, d in [*sides, (5, 6, 7, 8)])
    path.write_text(
        '<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2"><Units><Metric linearUnit="meter"/>'
        f'</Units><Surfaces><Surface name="Basin"><Definition surfType="TIN"><Pnts>{points}</Pnts>'
        f"<Faces>{faces}</Faces></Definition></Surface></Surfaces></LandXML>"
    )
    return path


def _earlier(site: Path, there: Path, surface: Raster, crs: str, from_middle: FloatArray) -> Path:
    """Write the survey as it might have been before."""
    shutil.copytree(site / "results", there / "results")
    heap = 1.2 * np.exp(-((from_middle[..., 0] / 16.0) ** 2) - (from_middle[..., 1] / 11.0) ** 2)
    pit = 0.8 * np.exp(-(((from_middle[..., 0] + 20.0) / 9.0) ** 2) - ((from_middle[..., 1] + 16.0) / 9.0) ** 2)
    before = (surface.values - heap + pit).astype(np.float32)
    path = result_path(there / "results", "dsm.tif")
    write_raster(path, Raster(before, surface.west_map_m, surface.north_map_m, surface.cell_m), crs)
    return there


def _compare(site: Path, asked: Asked, measured: KeptMeasurements) -> None:
    kept = KeptComparisons(site)
    kept.start(asked, site / "results", measured)
    while kept.view()["under_way"]["name"] is not None:
        time.sleep(0.2)


def _press(browser: Chrome, number: int, words: str) -> None:
    """Press a button of a comparison."""
    item = browser.find_elements("css selector", "#comparisons li")[number]
    button = next(one for one in item.find_elements("css selector", "button") if one.text == words)
    browser.execute_script("arguments[0].click()", button)
    item = browser.find_elements("css selector", "#comparisons li")[number]
    browser.execute_script("arguments[0].scrollIntoView()", item)
    time.sleep(DRAWN_AFTER_S)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
