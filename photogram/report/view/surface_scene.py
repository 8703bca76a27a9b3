"""The surface as the page holds it: heights as few bytes, and what the page must know of them."""

import base64
from typing import Any

from photogram.report.view.drawn_surface import DrawnSurface
from photogram.report.view.packing import UNKNOWN, as_text, pack_heights

Json = dict[str, Any]


def surface_scene(surface: DrawnSurface | None) -> tuple[Json | None, dict[str, str]]:
    """Return what the page must know of a surface, and its bytes as text; nothing where there is none.

    ``heights``: 16 bits for each corner, row by row from the north-west; ``squares``: what each is, 8 bits; and
    ``orthophoto``: a JPEG.
    """
    if surface is None:
        return None, {}
    steps, low_map_m, step_m = pack_heights(surface.height_m)
    grid = surface.corner_grid
    scene = {
        "file": surface.file,
        "every": surface.every,
        "rows": grid.rows,
        "columns": grid.columns,
        "spacing_m": grid.cell_m,
        "first_map_m": [grid.west_map_m + grid.cell_m / 2, grid.north_map_m - grid.cell_m / 2],
        "low_map_m": low_map_m,
        "step_m": step_m,
        "unknown": UNKNOWN,
        "rms_m": surface.rms_m,
        "has_sources": surface.has_sources,
        "picture_m": list(surface.picture_m),
    }
    picture = base64.b64encode(surface.jpeg).decode()
    return scene, {"heights": as_text(steps), "squares": as_text(surface.kind), "orthophoto": picture}
