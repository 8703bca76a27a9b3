"""What the stage `surface` has stored, read back for later stages and notebooks, and why a product was not made."""

from dataclasses import dataclass, field

import numpy as np

from photogram.arrays import FloatArray
from photogram.files.maps.rasters import read_raster
from photogram.files.npz_json import read_arrays, read_json
from photogram.geodesy.crs import NO_CRS
from photogram.pipeline.stage_names import StageName
from photogram.pipeline.store.run import Run
from photogram.survey import Raster

PLANE = "plane.json"
"""File of the stage `surface` with the plane that its rasters lie on; not there where they lie on the map."""

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
            path = self.run.workspace.file("surface", f"{name}.tif")
            local = self.run.project.crs == NO_CRS or self.run.workspace.has("surface", PLANE)
            self._rasters[name] = read_raster(path, local=local)[0]
        return self._rasters[name]
