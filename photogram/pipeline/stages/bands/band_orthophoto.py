"""Bands on the grid of the orthophoto: `orthophoto_bands.tif` of the companions that no other product is made of.

Each band is an orthophoto of the photographs of its camera alone, on the same surface and the same cells as that of the
master, beside whose red, green and blue it stands. Registration is measured while the tiles pass, between the mean of
the master's colours and the band.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import ByteArray, FloatArray
from photogram.files.maps.cogs import write_cog_bands
from photogram.files.npz_json import read_json_as, write_json
from photogram.grid import MapGrid, Window
from photogram.pipeline.stages.orthophoto_pieces import CachedPhotographs, masks_of
from photogram.pipeline.stages.surface_frame import SurfaceFrame
from photogram.pipeline.store.run import Run
from photogram.project.rigs.entries import bands_of
from photogram.report.record.rigs import BandRecord
from photogram.surface.ortho.orthophoto import ONLY_MASKED, TILE_CELLS, Orthophoto, plan_orthophoto
from photogram.surface.ortho.outline import cells_inside
from photogram.surface.ortho.registration import Registration, shifts_in
from photogram.surface.ortho.visibility import WindowedSurface
from photogram.surface.views import Views

BANDS_FILE = "orthophoto_bands.tif"
REGISTRATION_FILE = "bands.json"

Pixels = Callable[[int], ByteArray]


@dataclass(frozen=True, eq=False)
class _Band:
    """A band: its name, its orthophoto, and the photographs that it is made of."""

    name: str
    orthophoto: Orthophoto
    pixels_of: Pixels


def _planned(run: Run, site: SurfaceFrame, surface: WindowedSurface, grid: MapGrid) -> list[_Band]:
    """Return the bands of a run that have photographs with a pose."""
    planned = []
    for name, numbers in bands_of(run.project.rigs).items():
        block = site.block(numbers)
        views = Views.of(block)
        if not len(views):
            continue
        pixels = CachedPhotographs.of(run, views, share=2)
        orthophoto = plan_orthophoto(
            views, block.frame, surface, pixels, run.executor, run.project.orthophoto, grid=grid,
            masks=masks_of(run, views),
        )  # fmt: skip
        planned.append(_Band(name, orthophoto, pixels))
    return planned


def make_bands(
    run: Run,
    folder: Path,
    site: SurfaceFrame,
    surface: WindowedSurface,
    master: Orthophoto,
    sides: FloatArray,
    pixels_of: Pixels,
) -> None:
    """Write the bands of companions beside the master's colours, within the ``sides`` (N, 4) of its rim, and how they
    lie on them; nothing where there are none. A cell that not all of them show has no data."""
    planned = _planned(run, site, surface, master.grid)
    if not planned:
        return
    shifts: dict[str, list[FloatArray]] = {band.name: [] for band in planned}
    grid = master.grid

    def tiles() -> Iterator[tuple[Window, ByteArray]]:
        for window in grid.tiles(TILE_CELLS):
            colours = master.tile(window, pixels_of)
            has_data = (colours[..., 3] > ONLY_MASKED) & cells_inside(sides, grid, window)
            layers = [colours[..., k] for k in range(3)]
            grey = colours[..., :3].mean(axis=2)
            for band in planned:
                own = band.orthophoto.tile(window, band.pixels_of)
                values = own[..., :3].mean(axis=2)
                both = has_data & (own[..., 3] > ONLY_MASKED)
                shifts[band.name].append(shifts_in(grey, values, both))
                layers.append(np.rint(values).astype(np.uint8))
                has_data = both
            # 0 is no data
            yield window, np.where(has_data[..., None], np.maximum(np.stack(layers, axis=-1), 1), 0).astype(np.uint8)

    names = ("red", "green", "blue", *(band.name for band in planned))
    write_cog_bands(folder / BANDS_FILE, grid, site.plan, names, tiles(), note=site.note)
    records = {name: _record(Registration.of(np.concatenate(own))) for name, own in shifts.items()}
    write_json(folder / REGISTRATION_FILE, records)


def _record(registration: Registration) -> BandRecord:
    known = registration.patches > 0
    return {
        "patches": registration.patches,
        "mean_px": list(registration.mean_cells) if known else None,
        "rms_px": registration.rms_cells if known else None,
    }


def band_records(run: Run) -> Mapping[str, BandRecord]:
    """Return what the stage `orthophoto` has measured of bands, by camera; nothing where it made none."""
    if not run.workspace.has("orthophoto", REGISTRATION_FILE):
        return {}
    return read_json_as(run.workspace.file("orthophoto", REGISTRATION_FILE), dict[str, BandRecord])
