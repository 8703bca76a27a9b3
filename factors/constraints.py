"""Constraints between points as factors: distances, height differences, points of one level surface or of one plane.

A surface has unknowns of its own, its height or the three of a plane, that nothing else observes. They are eliminated
where the factor is made: of the whitened distances d of its points from the surface that fits them best, with the
Jacobian A on these unknowns, the factor has Bᵀd, B an orthonormal basis of what is across the columns of A. That is the
reduced system of the observations d with the unknowns in it (Förstner & Wrobel 2016, sec. 4.2.2). Of a plane, d lies
across A by itself where it fits best, so Bᵀ keeps its length, and the gradient is exact (variable projection, Golub &
Pereyra 1973).

Heights are those of the map: the vertical of every point is its own, with the ellipsoid's curvature and the slope of a
geoid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.constraints.between_points import CommonSurface, Constraint, Distance, HeightDifference
from photogram.constraints.rigs import give_scale
from photogram.factors.linearised.alike import Factors, Linearised, Values
from photogram.factors.linearised.poses import DistanceFactors
from photogram.factors.variables import CONTROL_POINT, POSE, key
from photogram.geodesy.frames import LocalFrame
from photogram.survey import Block

EARTH_RADIUS_M = 6_371_000.0
_STEP_M = 10.0  # from which slopes of heights are taken


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights of the map around places (n, 3): ``height_m`` (n,) there, ``slope`` (n, 3), and half of the curvature."""

    place_world_m: FloatArray
    height_m: FloatArray
    slope: FloatArray
    bend_per_m: float

    @classmethod
    def near(cls, frame: LocalFrame, place_world_m: FloatArray) -> Heights:
        """Return the heights around places (n, 3) of the world."""
        if frame.kind == "grid" and frame.geoid is None:
            up = np.zeros_like(place_world_m)
            up[:, 2] = 1.0
            return cls(place_world_m, frame.map_from_world(place_world_m)[:, 2], up, 0.0)
        steps = _STEP_M * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
        around = frame.map_from_world((place_world_m[:, None] + steps).reshape(-1, 3))[:, 2].reshape(-1, 7)
        bend = 0.0 if frame.kind == "grid" else 0.5 / EARTH_RADIUS_M
        return cls(place_world_m, around[:, 0], (around[:, 1:4] - around[:, 4:]) / (2.0 * _STEP_M), bend)

    def at(self, position_world_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the heights (n,) of positions (n, 3), and their derivatives (n, 3)."""
        off = position_world_m - self.place_world_m
        across = off - np.einsum("ni,ni->n", off, self.slope)[:, None] * self.slope
        height = self.height_m + np.einsum("ni,ni->n", off, self.slope)
        height = height + self.bend_per_m * np.einsum("ni,ni->n", across, across)
        return height, self.slope + 2.0 * self.bend_per_m * across


@dataclass(frozen=True, eq=False)
class Rows:
    """The observations (m) of a constraint linearised at its n points."""

    misfit_m: FloatArray
    """Adjusted minus measured (m,); of a surface, how far each point is from the one that fits them best."""
    jacobian: FloatArray
    """Derivatives (m, n, 3) by the points, those of the surface's own unknowns left out."""
    common: FloatArray
    """Derivatives (m, k) by these unknowns; k is 0 for what has none."""


def basis_across(common: FloatArray) -> FloatArray:
    """Return an orthonormal basis (m, m − k) of what is across the columns of a matrix (m, k)."""
    return np.asarray(np.linalg.qr(common, mode="complete")[0][:, common.shape[1] :])


@dataclass(frozen=True, eq=False)
class FittedPlane:
    """A plane through ``centre`` (3,) with the unit ``normal`` (3,) and two directions ``along`` (3, 2) in it."""

    centre: FloatArray
    normal: FloatArray
    along: FloatArray

    @classmethod
    def of(cls, points: FloatArray, sigma_m: FloatArray) -> FittedPlane:
        """Fit points (n, 3) by orthogonal regression with their standard deviations (n,) across the plane."""
        weight = 1.0 / sigma_m**2
        centre = weight @ points / weight.sum()
        off = (points - centre) / sigma_m[:, None]
        along, normal = np.split(np.linalg.svd(off)[2].T, [2], axis=1)
        sign = np.sign(normal[np.argmax(np.abs(normal)), 0])
        return cls(centre, sign * normal[:, 0], along)


def rows_of(constraint: Constraint, places: FloatArray, sigma_m: FloatArray, heights: Heights) -> Rows:
    """Return the observations of a constraint at its points (n, 3) with standard deviations (m,); those of infinite
    ones have no say in where a surface lies."""
    if isinstance(constraint, Distance):
        apart = places[1] - places[0]
        length = float(np.linalg.norm(apart))
        along = apart / length
        return Rows(np.array([length - constraint.length_m]), np.stack([-along, along])[None], np.zeros((1, 0)))
    if isinstance(constraint, HeightDifference):
        height, slope = heights.at(places)
        misfit = np.array([height[1] - height[0] - constraint.difference_m])
        return Rows(misfit, np.stack([-slope[0], slope[1]])[None], np.zeros((1, 0)))
    own, used = np.arange(len(places)), np.isfinite(sigma_m)
    jacobian = np.zeros((len(places), len(places), 3))
    if constraint.kind == "level surface":
        height, jacobian[own, own] = heights.at(places)
        weight = np.where(used, 1.0 / sigma_m**2, 0.0)
        return Rows(height - weight @ height / weight.sum(), jacobian, np.ones((len(places), 1)))
    plane = FittedPlane.of(places[used], sigma_m[used])
    jacobian[own, own] = plane.normal
    off = places - plane.centre
    return Rows(off @ plane.normal, jacobian, np.column_stack([np.ones(len(places)), off @ plane.along]))


@dataclass(frozen=True, eq=False)
class Placed:
    """A constraint that takes part: ``index`` (n,) of its photographs, or of its points among those of role control,
    and the numbers ``rows`` (m,) of its observations that take part."""

    number: int
    constraint: Constraint
    index: IntArray
    rows: IntArray

    @property
    def sigma_m(self) -> FloatArray:
        """Standard deviations (m,) of the observations that take part."""
        return np.array(self.constraint.sigmas_m)[self.rows]


def unknowns_of(constraint: Constraint) -> int:
    """Return the number of unknowns of its own."""
    return {"level surface": 1, "plane": 3}.get(constraint.kind, 0)


def taking_part(block: Block) -> list[Placed]:
    """Return the constraints of role control of which enough takes part to say something: distances and height
    differences with both ends, surfaces with more points than unknowns of their own."""
    roles = zip(block.control_points.name, block.control_points.role, strict=True)
    control = {name: i for i, name in enumerate(name for name, role in roles if role == "control")}
    photographs = {p.name: i for i, p in enumerate(block.photographs)}
    placed = []
    for number, constraint in enumerate(block.constraints):
        ends = photographs if constraint.of_photographs else control
        index = np.array([ends.get(name, -1) for name in constraint.points], dtype=np.int64)
        sigma_m = np.array(constraint.sigmas_m)
        if constraint.role != "control":
            continue
        if isinstance(constraint, CommonSurface):
            rows = np.flatnonzero((index >= 0) & np.isfinite(sigma_m))
            if len(rows) > unknowns_of(constraint):
                placed.append(Placed(number, constraint, index[rows], rows))
        elif np.all(index >= 0) and np.isfinite(sigma_m).all():
            placed.append(Placed(number, constraint, index, np.zeros(1, dtype=np.int64)))
    return placed


def is_scaled(block: Block) -> bool:
    """Return whether a distance takes part, or a given baseline between two cameras of one body."""
    return give_scale(block.rigs) or any(isinstance(placed.constraint, Distance) for placed in taking_part(block))


@dataclass(frozen=True, eq=False)
class SurfaceFactors(Factors):
    """One constraint of heights or a surface on its control points, in the standard deviations ``sigma_m`` (m,) of its
    observations, its own unknowns eliminated."""

    constraint: Constraint
    sigma_m: tuple[float, ...]
    heights: Heights

    @property
    def rows(self) -> int:
        """Return how many observations are left where its own unknowns are eliminated."""
        return len(self.sigma_m) - unknowns_of(self.constraint)

    def linearised(self, values: Values) -> Linearised:
        """Return the constraint linearised at values."""
        sigma_m, places = np.array(self.sigma_m), values.vectors(self.variables[0])
        rows = rows_of(self.constraint, places, sigma_m, self.heights)
        B = basis_across(rows.common / sigma_m[:, None]).T / sigma_m
        jacobian = np.einsum("rm,mni->rni", B, rows.jacobian)
        return Linearised((B @ rows.misfit_m)[None], jacobian.reshape(1, len(B), -1))


def constraint_factor(placed: Placed, frame: LocalFrame, control_world_m: FloatArray) -> Factors:
    """Return the factor of a constraint; heights are linearised about the control points (G, 3)."""
    constraint = placed.constraint
    kind = POSE if constraint.of_photographs else CONTROL_POINT
    variables = np.array([[key(kind, i) for i in placed.index.tolist()]], dtype=np.int64)
    if isinstance(constraint, Distance):
        return DistanceFactors(variables, np.array([constraint.length_m]), np.array([constraint.sigma_m]))
    heights = Heights.near(frame, control_world_m[placed.index])
    return SurfaceFactors(variables, constraint, tuple(placed.sigma_m.tolist()), heights)


def without_shape(constraint: Constraint, places: FloatArray, used: BoolArray) -> bool:
    """Return whether points (n, 3), those that are ``used`` (n,), lie in one line and so on no plane in particular."""
    if constraint.kind != "plane":
        return False
    size = np.linalg.svd(places[used] - places[used].mean(axis=0), compute_uv=False)
    return bool(size[1] < IN_LINE * size[0])


IN_LINE = 1e-3
"""Width over length of a set of points, below which they lie in one line."""
