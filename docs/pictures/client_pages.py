"""Draw the client's part of a report as it is printed, its four pages side by side.

Call: python docs/pictures/client_pages.py OUTPUT RESULTS. Needs Chromium, and pdftoppm of Poppler. The picture in the
documentation is of Brighton Beach.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from photogram.report.printing import print_pdf
from photogram.result_files import result_path

PAGES, DOTS_PER_INCH, GAP_PX, COLOURS = 4, 55, 12, 200


def main(output: Path, results: Path) -> None:
    """Print the report and draw its first pages."""
    with tempfile.TemporaryDirectory() as folder:
        printed = Path(folder) / "report.pdf"
        print_pdf(result_path(results, "report.html"), printed)
        call = [
            "pdftoppm",
            "-png",
            "-r",
            str(DOTS_PER_INCH),
            "-l",
            str(PAGES),
            str(printed),
            str(Path(folder) / "page"),
        ]
        subprocess.run(call, check=True)
        pages = [Image.open(path).convert("RGB") for path in sorted(Path(folder).glob("page*.png"))]
    width, height = sum(page.width + GAP_PX for page in pages) + GAP_PX, max(page.height for page in pages) + 2 * GAP_PX
    sheet, left = Image.new("RGB", (width, height), "#888888"), GAP_PX
    for page in pages:
        sheet.paste(page, (left, GAP_PX))
        left += page.width + GAP_PX
    sheet.quantize(COLOURS, dither=Image.Dither.NONE).save(output, optimize=True)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
