"""Render two epochs of a site, adjust them together and draw what has changed: docs/pictures/epochs.png.

Call: PYTHONPATH=benchmarks python docs/pictures/epochs.py [OUTPUT].
"""

import sys
import tempfile
from pathlib import Path

from epochs import compared_together
from PIL import Image

COLOURS, WIDTH_PX = 128, 900


def main(output: Path) -> None:
    """Write the picture."""
    with (
        tempfile.TemporaryDirectory() as folder,
        Image.open(compared_together(Path(folder), 0) / "comparison.png") as drawn,
    ):
        height_px = round(drawn.height * WIDTH_PX / drawn.width)
        small = drawn.convert("RGB").resize((WIDTH_PX, height_px), Image.Resampling.LANCZOS)
        small.quantize(COLOURS, dither=Image.Dither.NONE).save(output, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"))
