"""What the stage `surface` has stored, read back for later stages and notebooks, and why a product was not made."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.files.maps.rasters import RasterFile, open_raster, read_codes, read_raster
from photogram.files.npz_json import read_arrays, read_json
from photogram.geodesy.crs import NO_CRS
from photogram.grid import MapGrid
from photogram.pipeline.stage_names import StageName
from photogram.pipeline.store.run import Run
from photogram.surface.dsm import INTERPOLATED
from photogram.survey import Raster

PLANE = "plane.json"
"""File of the stage `surface` with the plane that its rasters lie on; not there where they lie on the map."""

SOURCE = "dsm_source.tif"
"""What each cell of a matched DSM is."""

LEFT_OUT = "left_out.json"
"""File of a stage that has made no product, with the reason; not there where it has."""


def reason_left_out(run: Run, stage: StageName) -> str:
    """Return why a stage has made no product, empty where it has."""
    if not run.workspace.has(stage, LEFT_OUT):
        return ""
    return str(read_json(run.workspace.file(stage, LEFT_OUT))["left_out"])


@dataclass(frozen=True)
class StoredSurface:
    """The DSM of a run, with its standard deviations, each read once. Needs the stage `surface`."""

    run: Run
    _rasters: dict[str, Raster] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def is_there(self) -> bool:
        """Return whether there is a DSM."""
        return self.run.workspace.has("surface", "dsm.tif")

    def heights(self) -> Raster:
        """Return the DSM."""
        return self._raster("dsm")

    def filled(self) -> Raster:
        """Return the DSM with its holes closed where it was matched, the DSM as it is otherwise."""
        matched = self.run.workspace.has("surface", "dsm_filled.tif")
        return self._raster("dsm_filled" if matched else "dsm")

    def filled_nearby(self) -> Raster:
        """Return the DSM with its holes closed from their neighbours alone: what is interpolated from farther off has
        no height."""
        filled = self.filled()
        if not self.run.workspace.has("surface", SOURCE):
            return filled
        grid = MapGrid.of(filled)
        far = read_codes(self.run.workspace.file("surface", SOURCE), grid.whole) == INTERPOLATED
        return grid.raster(np.where(far, np.float32(np.nan), filled.values))

    def measured(self) -> RasterFile:
        """Return the DSM, of which windows are read."""
        return open_raster(self._path("dsm"), local=self._is_local)

    def files(self) -> tuple[RasterFile, RasterFile]:
        """Return the DSM, with its holes closed where it was matched, and its standard deviations, of which windows
        are read."""
        matched = self.run.workspace.has("surface", "dsm_filled.tif")
        names = "dsm_filled" if matched else "dsm", "dsm_sigma"
        heights, sigma = (open_raster(self._path(name), local=self._is_local) for name in names)
        return heights, sigma

    def own_sigma(self) -> RasterFile | None:
        """Return the part of its standard deviations that cells do not share, None where it is not known."""
        known = self.run.workspace.has("surface", "dsm_sigma_own.tif")
        return open_raster(self._path("dsm_sigma_own"), local=self._is_local) if known else None

    def sigma(self) -> Raster:
        """Return the standard deviations of the DSM."""
        return self._raster("dsm_sigma")

    def relative_sigma(self) -> Raster | None:
        """Return the standard deviations of the DSM without the datum's part, None where they are not known."""
        known = self.run.workspace.has("surface", "dsm_sigma_relative.tif")
        return self._raster("dsm_sigma_relative") if known else None

    def held_out_m(self) -> FloatArray:
        """Return what the DSM is off by at tie points that were held out of it."""
        return np.asarray(read_arrays(self.run.workspace.file("surface", "held_out.npz"))["held_out_m"])

    def _raster(self, name: str) -> Raster:
        if name not in self._rasters:
            self._rasters[name] = read_raster(self._path(name), local=self._is_local)[0]
        return self._rasters[name]

    def _path(self, name: str) -> Path:
        return self.run.workspace.file("surface", f"{name}.tif")

    @property
    def _is_local(self) -> bool:
        return self.run.project.crs == NO_CRS or self.run.workspace.has("surface", PLANE)
