"""Draw the page view.html with the surface shown, as Chromium draws it: docs/pictures/view_surface.png.

Call: python docs/pictures/view_surface.py OUTPUT RESULTS, after photogram view. Needs Chromium. The picture in the
documentation is of the built-in simulated survey, photogram demo --dense.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from photogram.report.printing import browser_options, find_browser
from photogram.result_files import result_path

WIDTH_PX, HEIGHT_PX, COLOURS = 1280, 800, 250
PATIENCE_MS = 60_000
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def main(output: Path, results: Path) -> None:
    """Open the page with the surface in place of the cloud, and keep what the screen shows."""
    browser = find_browser()
    if browser is None:
        raise SystemExit("no Chromium is installed")
    address = f"{result_path(results, 'view.html').absolute().as_uri()}#drawn=surface"
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        shot = Path(folder) / "page.png"
        options = [option for option in browser_options(Path(folder) / "profile") if option != "--disable-gpu"]
        options += [*SOFTWARE, f"--window-size={WIDTH_PX},{HEIGHT_PX}", f"--virtual-time-budget={PATIENCE_MS}"]
        subprocess.run([browser, *options, f"--screenshot={shot}", address], check=True, capture_output=True)
        picture = Image.open(shot).convert("RGB")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(output, optimize=True)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
