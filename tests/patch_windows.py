"""Windows of patches that are all alike."""

import numpy as np

from photogram.surface.dense.lattice import GroundCells
from photogram.surface.dense.window_sums import PatchWindows


def same_windows(ground: GroundCells, half: int, noise: float, kept: float) -> PatchWindows:
    """Return the windows of a block whose every patch has the same."""
    shape = ground.views.shape[:2]
    return PatchWindows(np.full(shape, half), np.full(shape, kept), noise)
