"""Tie points that lie on a known surface: a laser or official height model as an observation of the adjustment.

Each point was intersected from its rays; along the surface's normal it is as far from the surface as what the surface
has wrong as a whole. That is five unknowns: an offset in height, two slopes, and a shift in
plan.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray, check_shapes

UNKNOWNS = 5
"""What a known surface may be off by as a whole: its offset in height, its slopes east and north, its shift east and
north."""

IN_HEIGHT = 3
"""The first of them, that change heights of level ground too."""


@dataclass(frozen=True, eq=False)
class SurfaceControl:
    """Points (K) on a known surface and their rays (N), sorted by point; photographs are numbered as in the block."""

    name: str
    """Name of the surface."""
    photograph: IntArray
    """Index of the photograph of each ray (N,), no photograph twice for one point."""
    point: IntArray
    """Index of the point of each ray (N,)."""
    pixel: FloatArray
    """Observed image coordinates (N, 2)."""
    sigma_px: FloatArray
    """Standard deviations (N,) of each coordinate."""
    start_world_m: FloatArray
    """Roughly where the points are (K, 3): intersections begin there."""
    place_world_m: FloatArray
    """Points of the surface (K, 3), each below or above its point."""
    normal_world: FloatArray
    """Unit normals (K, 3) of the surface there."""
    common: FloatArray
    """Derivatives (K, 5) of the distances by the offset in height, both slopes, m at the edge of the points, and the
    shift in plan."""
    sigma_m: FloatArray
    """Standard deviations (K,) of the distances along the normals: of the surface, and of the intersections."""
    common_sigma_m: FloatArray
    """Prior standard deviations (5,) of what the surface is off by as a whole."""

    def __post_init__(self) -> None:
        n, k = len(self.photograph), len(self.sigma_m)
        check_shapes(self, photograph=(n,), point=(n,), pixel=(n, 2), sigma_px=(n,))
        check_shapes(self, start_world_m=(k, 3), place_world_m=(k, 3), normal_world=(k, 3))
        check_shapes(self, common=(k, UNKNOWNS), common_sigma_m=(UNKNOWNS,))

    def __len__(self) -> int:
        return len(self.sigma_m)

    def select(self, keep: BoolArray) -> SurfaceControl:
        """Return the points of the mask (K,) with their rays."""
        rays = keep[self.point]
        return SurfaceControl(
            self.name,
            self.photograph[rays],
            (np.cumsum(keep) - 1)[self.point[rays]].astype(np.int64),
            self.pixel[rays],
            self.sigma_px[rays],
            self.start_world_m[keep],
            self.place_world_m[keep],
            self.normal_world[keep],
            self.common[keep],
            self.sigma_m[keep],
            self.common_sigma_m,
        )

    def in_photographs(self, number: IntArray) -> SurfaceControl | None:
        """Return the points of which all photographs stay, with these as ``number`` (N,) counts them, −1 for those that
        do not; None where no point is left."""
        lost = np.bincount(self.point, number[self.photograph] < 0, minlength=len(self)) > 0
        if lost.all():
            return None
        part = self.select(~lost)
        return SurfaceControl(**{**vars(part), "photograph": number[part.photograph]})
