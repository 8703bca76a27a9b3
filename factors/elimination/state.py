"""The values of everything that is adjusted."""

from __future__ import annotations

from dataclasses import dataclass

from photogram.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class State:
    """Values of all variables: ``rotation`` (N, 3, 3) world from camera, ``position`` (N, 3), ``parameters``
    (cameras, 11), ``tie_point`` (P, 3), ``control`` (G, 3), ``offset`` (flights, 3); positions in the world, m."""

    rotation: FloatArray
    position: FloatArray
    parameters: FloatArray
    tie_point: FloatArray
    control: FloatArray
    offset: FloatArray
