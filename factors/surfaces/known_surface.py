"""Distances of intersected points from a known surface, as factors on the photographs that see them.

A tie point X has the normal matrix V from its rays, and of the surface one observation more, n·(X − S) = 0 with the
surface's point S, its unit normal n and the variance σ². With the point eliminated from all of them, the rays leave
what they leave without the surface, and the surface leaves one row on the cameras,

    n·(X̂ − S) + k·c = 0,    variance σ² + nᵀ V⁻¹ n,

X̂ being where the rays intersect: min over X of (X − X̂)ᵀ V (X − X̂) + (n·(X − S))²/σ² is (n·(X̂ − S))² / (σ² + nᵀV⁻¹n)
(Förstner & Wrobel 2016, sec. 4.2.7: the update of an estimate by one observation). So the point stays among the tie
points, which eliminate it as any other, and the surface is an observation of cameras: X̂ moves with them by −V⁻¹ Wᵀ.
c is what the surface is off by as a whole, k its effect on the distance.

The adjusted tie points are where their rays have them: the surface places the block, not the point.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import calibrations
from photogram.constraints.known_surface import SurfaceControl
from photogram.factors.elimination.reprojection import Linearisation, Observations, linearise
from photogram.factors.linearised.alike import Factors, Linearised, Values
from photogram.factors.variables import CALIBRATION, COMMON_ERROR, POSE, key
from photogram.projection import OrientedCameras, recalibrated
from photogram.survey import Block

MOST_STEPS = 20  # of an intersection
SETTLED_M = 1e-10


@dataclass(frozen=True, eq=False)
class Lenses:
    """The cameras of a block as they are given: ``oriented``, their ``parameters`` (C, 12 + K), which are ``free``, and
    the units ``scale`` (C, 12 + K) of their calibration variables."""

    oriented: OrientedCameras
    parameters: FloatArray
    free: tuple[IntArray, ...]
    scale: FloatArray


@dataclass(frozen=True, eq=False)
class KnownSurfaceFactors(Factors):
    """Distances of points (n), each seen in m photographs, from a known surface: on their poses, on the calibrations of
    the ``cameras`` that have free parameters, and on what the surface is off by.

    ``pixel`` (n, m, 2) and ``sigma_px`` (n, m) of the rays, ``start`` (n, 3) for the intersections, ``place`` and
    ``normal`` (n, 3) of the surface, ``common`` (n, 5), ``sigma_m`` (n,).
    """

    pixel: FloatArray
    sigma_px: FloatArray
    start: FloatArray
    place: FloatArray
    normal: FloatArray
    common: FloatArray
    sigma_m: FloatArray
    cameras: tuple[int, ...]
    lenses: Lenses

    @property
    def rows(self) -> int:
        """Return how many observations each factor has."""
        return 1

    def _seen(self, values: Values) -> OrientedCameras:
        """Return the photographs of each ray (n m) at values."""
        n, m = self.sigma_px.shape
        own, index = self.lenses.oriented, self.index[:, :m]
        rotation, position, velocity = np.empty((n, m, 3, 3)), np.empty((n, m, 3)), np.empty((n, m, 3))
        for j in range(m):
            rotation[:, j], position[:, j] = values.poses(self.variables[:, j])
            moving = values.velocities(self.variables[:, j])
            velocity[:, j] = own.velocity[index[:, j]] if moving is None else moving
        parameters = self.lenses.parameters.copy()
        for i, c in enumerate(self.cameras):
            free = self.lenses.free[c]
            parameters[c, free] = values.vectors(self.variables[:1, m + i])[0] * self.lenses.scale[c][free]
        seen = own._replace(
            camera=own.camera[index.ravel()],
            rotation=rotation.reshape(-1, 3, 3),
            position=position.reshape(-1, 3),
            velocity=velocity.reshape(-1, 3),
        )
        return recalibrated(seen, parameters)

    def linearised(self, values: Values) -> Linearised:
        """Return the distances linearised at values."""
        n, m = self.sigma_px.shape
        seen = self._seen(values)
        rays = Observations(
            np.arange(n * m), np.repeat(np.arange(n), m), self.pixel.reshape(-1, 2), self.sigma_px.ravel()
        )
        X, linear, turned = _intersected(rays, seen, self.start, self.normal)
        pulled = np.einsum("nri,ni->nr", linear.point, turned[rays.point])
        of_pose = -np.einsum("nr,nrk->nk", pulled, linear.pose).reshape(n, 6 * m)
        of_lens = -np.einsum("nr,nrk->nk", pulled, linear.calibration)
        jacobian = [of_pose]
        for c in self.cameras:
            free = self.lenses.free[c]
            own = np.where((linear.camera == c)[:, None], of_lens[:, free], 0.0)
            jacobian.append(own.reshape(n, m, len(free)).sum(axis=1) * self.lenses.scale[c][free])
        jacobian.append(self.common)
        off = values.vectors(self.variables[:, -1])
        distance = np.einsum("ni,ni->n", X - self.place, self.normal) + np.einsum("ni,ni->n", self.common, off)
        return Linearised((distance / self.sigma_m)[:, None], (np.hstack(jacobian) / self.sigma_m[:, None])[:, None, :])


def _intersected(
    rays: Observations, cameras: OrientedCameras, start: FloatArray, normal: FloatArray
) -> tuple[FloatArray, Linearisation, FloatArray]:
    """Return where rays intersect (n, 3), by Gauss–Newton from ``start``, the rays linearised there, and V⁻¹ n (n, 3)
    of the ``normal`` (n, 3); zero for points that their cameras have behind them."""
    X = start
    for _ in range(MOST_STEPS):
        linear = linearise(rays, cameras, X)
        V, g = np.zeros((len(X), 3, 3)), np.zeros((len(X), 3))
        np.add.at(V, rays.point, np.einsum("nri,nrj->nij", linear.point, linear.point))
        np.add.at(g, rays.point, np.einsum("nri,nr->ni", linear.point, linear.residual))
        lost = ~(np.linalg.det(V) > 1e-18 * np.trace(V, axis1=1, axis2=2) ** 3)
        V[lost] = np.eye(3)
        step = np.where(lost[:, None], 0.0, np.linalg.solve(V, g[..., None])[..., 0])
        if np.abs(step).max(initial=0.0) < SETTLED_M:
            break
        X = X - step
    return X, linear, np.where(lost[:, None], 0.0, np.linalg.solve(V, normal[..., None])[..., 0])


def intersected_distances(
    control: SurfaceControl, cameras: OrientedCameras
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return where the rays of a control's points intersect with these cameras (K, 3), in the world, m, how far that is
    above the surface (K,) along its normal, m, and nᵀ V⁻¹ n (K,) of the intersections, m²."""
    rays = Observations(control.photograph, control.point, control.pixel, control.sigma_px)
    X, _, turned = _intersected(rays, cameras, control.start_world_m, control.normal_world)
    distance = np.einsum("ni,ni->n", X - control.place_world_m, control.normal_world)
    return X, distance, np.einsum("ni,ni->n", control.normal_world, turned)


def surface_factors(block: Block, free: tuple[IntArray, ...], scale: FloatArray) -> Iterator[Factors]:
    """Yield the factors of a block's known surface, those with as many rays in the same cameras together; ``free`` and
    ``scale`` as in Problem. The block has the common error of the surface."""
    control = block.known_surface
    if control is None:
        return
    error = next(k for k, error in enumerate(block.common_errors) if error.kind == "known_surface")
    lenses = Lenses(block.oriented_cameras(), calibrations(block.cameras), free, scale)
    first = np.searchsorted(control.point, np.arange(len(control) + 1))
    camera = lenses.oriented.camera[control.photograph]
    groups: dict[tuple[int, tuple[int, ...]], list[int]] = {}
    for p in range(len(control)):
        seen_by = camera[first[p] : first[p + 1]]
        cameras = tuple(c for c in np.unique(seen_by).tolist() if len(free[c]))
        groups.setdefault((len(seen_by), cameras), []).append(p)
    for (m, cameras), points in groups.items():
        own = np.array(points)
        rays = first[own][:, None] + np.arange(m)
        variables = np.empty((len(own), m + len(cameras) + 1), dtype=np.int64)
        variables[:, :m] = [[key(POSE, i) for i in row] for row in control.photograph[rays].tolist()]
        variables[:, m:] = [*(key(CALIBRATION, c) for c in cameras), key(COMMON_ERROR, error)]
        yield KnownSurfaceFactors(
            variables, control.pixel[rays], control.sigma_px[rays], control.start_world_m[own],
            control.place_world_m[own], control.normal_world[own], control.common[own], control.sigma_m[own], cameras,
            lenses,
        )  # fmt: skip
