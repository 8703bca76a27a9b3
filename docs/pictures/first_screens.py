"""Draw the first screen of reports, at a desk (1280 x 900) and on a telephone (400 px), side by side.

Call: python docs/pictures/first_screens.py OUTPUT RESULTS [RESULTS …]; a row for each folder of results. Needs Chromium
and its driver. The pictures in the documentation are of the demonstration, of Brighton Beach and of dbat_sxb.
"""

import io
import shutil
import sys
import tempfile
from pathlib import Path

from PIL import Image
from selenium.webdriver import Chrome, ChromeOptions
from selenium.webdriver.chrome.service import Service

from photogram.report.printing import browser_options, find_browser

DESK_PX, TELEPHONE_PX = (1280, 900), (400, 900)
GAP_PX = 24
SHARE = 0.75
"""Of the size on the screen."""
COLOURS = 200


def screens(page: Path) -> list[Image.Image]:
    """Return what a reader sees first of a page, at a desk and on a telephone."""
    taken = []
    with tempfile.TemporaryDirectory() as profile:
        options = ChromeOptions()
        options.binary_location = find_browser() or ""
        for option in browser_options(Path(profile)):
            options.add_argument(option)
        chrome = Chrome(options=options, service=Service(shutil.which("chromedriver")))
        try:
            for width, height in (DESK_PX, TELEPHONE_PX):
                metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
                chrome.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
                chrome.get(page.absolute().as_uri())
                taken.append(Image.open(io.BytesIO(chrome.get_screenshot_as_png())).convert("RGB"))
        finally:
            chrome.quit()
    return taken


def side_by_side(rows: list[list[Image.Image]]) -> Image.Image:
    """Return pictures in rows, with gaps between them."""
    width = max(sum(p.width for p in row) + GAP_PX * (len(row) - 1) for row in rows)
    height = sum(max(p.height for p in row) for row in rows) + GAP_PX * (len(rows) - 1)
    sheet, top = Image.new("RGB", (width, height), "#888888"), 0
    for row in rows:
        left = 0
        for picture in row:
            sheet.paste(picture, (left, top))
            left += picture.width + GAP_PX
        top += max(p.height for p in row) + GAP_PX
    small = sheet.resize((round(SHARE * width), round(SHARE * height)), Image.Resampling.LANCZOS)
    return small.quantize(COLOURS, dither=Image.Dither.NONE)


if __name__ == "__main__":
    output, *folders = map(Path, sys.argv[1:])
    side_by_side([screens(folder / "deliverables" / "report.html") for folder in folders]).save(output, optimize=True)
