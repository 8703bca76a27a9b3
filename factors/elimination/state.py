"""The values of everything that is adjusted."""

from dataclasses import dataclass, field

import numpy as np

from photogram.arrays import FloatArray
from photogram.projection import OrientedCameras


class OfCameras:
    """Values among which are ``cameras``, with their parts by name."""

    cameras: OrientedCameras

    @property
    def rotation(self) -> FloatArray:
        """Return the rotations (N, 3, 3) of the photographs, world from camera."""
        return self.cameras.rotation

    @property
    def position(self) -> FloatArray:
        """Return the projection centres (N, 3) in the world, m."""
        return self.cameras.position

    @property
    def velocity(self) -> FloatArray:
        """Return the velocities (N, 3) of the projection centres in the world, m/s."""
        return self.cameras.velocity

    @property
    def parameters(self) -> FloatArray:
        """Return the interior orientations (cameras, 12)."""
        return self.cameras.parameters


@dataclass(frozen=True, eq=False)
class State(OfCameras):
    """Values of all variables: ``cameras`` interior and exterior orientation, ``tie_point`` (P, 3), ``control`` (G, 3),
    ``offset`` (flights, 3), positions in the world, m; ``common`` (Σ d,) the other common errors, one after the
    other, then the relative poses of the rigs that are estimated."""

    cameras: OrientedCameras
    tie_point: FloatArray
    control: FloatArray
    offset: FloatArray
    common: FloatArray = field(default_factory=lambda: np.zeros(0))
