"""What photographs show of the blocks of an orthophoto: one photograph at a time, in any order, wherever its pixels are
decoded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from photogram.arrays import ByteArray, FloatArray, IntArray
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid
from photogram.surface.ortho.colour_balance import Places, colours_in
from photogram.surface.ortho.masked_cells import Masks
from photogram.surface.ortho.seamlines import Lattice, sample_blocks
from photogram.surface.ortho.visibility import SeenCells, SurfaceModel
from photogram.surface.views import Views

_SEEN = ("seen", "inside", "grey", "masked")


def seen_cells(views: Views, frame: LocalFrame, terrain: SurfaceModel, masks: Masks | None) -> SeenCells:
    """Return what views see of a terrain, in the pixels that their masks leave."""
    if masks is None:
        return SeenCells(terrain)
    return SeenCells(terrain, masked=lambda view: masks.cells(views, frame, terrain, view))


@dataclass(frozen=True, eq=False)
class BlockSamples:
    """What is needed to look at a photograph, and what has been seen: the ``lattice`` of the blocks of a ``grid``,
    filled photograph by photograph, and the ``places`` at which photographs are compared."""

    views: Views
    frame: LocalFrame
    terrain: SurfaceModel
    grid: MapGrid
    lattice: Lattice
    places: Places
    seen: SeenCells

    @staticmethod
    def of(
        views: Views,
        frame: LocalFrame,
        terrain: SurfaceModel,
        grid: MapGrid,
        lattice: Lattice,
        masks: Masks | None = None,
    ) -> BlockSamples:
        """Return it for a lattice that nobody has looked at."""
        seen = seen_cells(views, frame, terrain, masks)
        return BlockSamples(views, frame, terrain, grid, lattice, Places.of(lattice, grid.cell_m), seen)

    def at(self, view: int, picture: ByteArray) -> tuple[IntArray, FloatArray]:
        """Look at a photograph (H, W, 3), and return its colours at the places as ``colours_in``. Photographs may be
        looked at in any order, and at the same time."""
        sample_blocks(self.views, self.frame, self.terrain, self.grid, self.lattice, self.seen, view, picture)
        return colours_in(self.views, self.lattice, self.places, view, picture)

    def of_view(self, view: int) -> dict[str, NDArray[Any]]:
        """Return what was seen in a photograph of the blocks that list it, in their order."""
        listed = self.lattice.candidate == view
        return {name: getattr(self.lattice, name)[listed] for name in _SEEN}

    def take(self, view: int, samples: Mapping[str, NDArray[Any]]) -> None:
        """Fill in what ``of_view`` returned elsewhere."""
        listed = self.lattice.candidate == view
        for name in _SEEN:
            getattr(self.lattice, name)[listed] = samples[name]
