"""What stands on the ground of a made scene and is no height field: crowns and hedges of leaves that move in the wind,
fences and wires.

A crown is a cloud of clumps, a clump a cloud of leaf discs, most of them near its surface and facing up and outwards;
between clumps lower leaves and the ground are seen. At each exposure every plant leans its own way, the more the higher
above its foot, and its branches tremble: displacements follow from the seed and the number of the exposure.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from itertools import pairwise

import numpy as np

from photogram.arrays import BoolArray, ByteArray, FloatArray, IntArray
from photogram.simulation.cover.hits import Pieces, filed, leaf_hits, leaves_over

REST = -1
"""The exposure at which nothing has moved."""

LEAF_AREA = 1.8
"""Area of the leaves of a clump over its plan area; clumps overlap."""

HEDGE_LEAF_AREA = 3.5
"""Area of the leaves of a hedge over its plan area."""

_PIECE_M = 0.6
_LEANING = 0.8  # of the sway; the rest is the trembling of branches
_LEAF_RGB = np.array([0.100, 0.155, 0.050])
_HEDGE_RGB = np.array([0.070, 0.125, 0.045])
_SKY = 0.34  # share of skylight, as the ground has it
_DARKEST = 0.15  # of the skylight, deep in a crown
_OFF_M = 0.02  # from a leaf, for rays that start on it
_THROUGH = 0.35  # of the sunlight on a leaf's other side


class PlantKind(IntEnum):
    """Kind of a plant."""

    CROWN = 0
    HEDGE = 1


@dataclass(frozen=True)
class CoverPlan:
    """What covers a site beside its buildings and trees."""

    hedges: int = 8
    """Number of hedges, where there is room."""
    fences: int = 4
    """Number of fences, where there is room."""
    power_lines: int = 1
    """Number of lines of poles with two wires, where there is room."""
    wood_trees: int = 60
    """How many of the trees stand in a wood, as close as there is room, crown to crown."""
    pond_radius_m: float = 9.0
    """Mean radius of the pond, 0 for none."""
    grass: bool = True
    """Whether parts of the meadow are high grass."""
    sway_m: float = 0.2
    """The most that the top of the highest tree moves from its place."""
    leaf_radius_m: float = 0.09
    """Mean radius of a disc of leaves."""


@dataclass(frozen=True, eq=False)
class Plants:
    """Plants by number."""

    kind: ByteArray
    """PlantKind (P,)."""
    foot_m: FloatArray
    """Height (P,) of the foot, world frame."""
    height_m: FloatArray
    """Height (P,) of the top above the foot."""
    sway_m: FloatArray
    """The most that the top moves from its place (P,)."""


@dataclass(frozen=True, eq=False)
class Leaves:
    """Discs of leaves by number."""

    centre_m: FloatArray
    """Centres (L, 3) at rest, world frame."""
    normal: FloatArray
    """Normals (L, 3), unit length."""
    radius_m: FloatArray
    """Radii (L,)."""
    rgb: FloatArray
    """Red, green and blue (L, 3) that they send to a camera, light included."""
    plant: IntArray
    """The plant (L,) of each."""
    branch: IntArray
    """The branch (L,) of each, counted over all plants."""


@dataclass(frozen=True, eq=False)
class Lines:
    """Pieces of wires, rails, posts and poles; none moves."""

    start_m: FloatArray
    """Where they begin (W, 3), world frame."""
    end_m: FloatArray
    """Where they end (W, 3)."""
    radius_m: FloatArray
    """Half their thickness (W,)."""
    rgb: FloatArray
    """Their colour (W, 3)."""
    upright: BoolArray
    """Which are posts or poles (W,)."""


@dataclass(frozen=True, eq=False)
class Cover:
    """Plants, their leaves, lines, and the seed of what moves."""

    plants: Plants
    leaves: Leaves
    lines: Lines
    seed: int
    """Seed of the wind and the water."""

    def sway_m(self, exposure: int) -> FloatArray:
        """Return how far (L, 3) each leaf is from its place at rest; none at the exposure REST.

        The top of a plant moves by no more than its sway, what is lower by the power 3/2 of its share of the height.
        """
        leaves, plants = self.leaves, self.plants
        if exposure == REST or not len(leaves.plant):
            return np.zeros_like(leaves.centre_m)
        rng = np.random.default_rng([self.seed, 7, exposure])
        share = (leaves.centre_m[:, 2] - plants.foot_m[leaves.plant]) / plants.height_m[leaves.plant]
        reach = plants.sway_m[leaves.plant] * np.clip(share, 0.0, 1.0) ** 1.5
        lean = _in_disc(rng, len(plants.kind))[leaves.plant]
        tremble = _in_disc(rng, int(leaves.branch.max()) + 1)[leaves.branch]
        moved = reach[:, None] * (_LEANING * lean + (1.0 - _LEANING) * tremble)
        return np.column_stack([moved, np.zeros(len(moved))])

    def pieces(self, exposure: int = REST) -> Pieces:
        """Return everything where it is at an exposure, filed for rays."""
        leaves, lines = self.leaves, self.lines
        return filed(
            leaves.centre_m + self.sway_m(exposure), leaves.normal, leaves.radius_m, lines.start_m, lines.end_m,
            lines.radius_m,
        )  # fmt: skip

    def height(self, xy: FloatArray) -> FloatArray:
        """Return the height (N,) of the highest leaf over positions (N, 2), at rest, NaN where there is none."""
        x, y = (np.ascontiguousarray(a) for a in xy.T)
        lowest = np.full(len(xy), -np.inf)
        return np.asarray(leaves_over(self.at_rest, x, y, lowest, np.zeros((2, 2)), 1)[0])

    @cached_property
    def at_rest(self) -> Pieces:
        """Return everything at rest, filed for rays."""
        return self.pieces()


def _in_disc(rng: np.random.Generator, count: int) -> FloatArray:
    """Draw places (count, 2) evenly in a circle of radius 1."""
    angle, radius = rng.uniform(0.0, 2 * np.pi, count), np.sqrt(rng.uniform(0.0, 1.0, count))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def _on_sphere(rng: np.random.Generator, count: int) -> FloatArray:
    v = rng.standard_normal((count, 3))
    return np.asarray(v / np.linalg.norm(v, axis=1)[:, None])


class Grower:
    """What covers a site while it grows, plant after plant, in a fixed order."""

    def __init__(self, plan: CoverPlan, seed: int) -> None:
        self.plan, self.seed = plan, seed
        self.rng = np.random.default_rng([seed, 8])
        self._plants: list[tuple[int, float, float, float]] = []
        self._leaves: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]] = []
        self._lines: list[tuple[FloatArray, FloatArray, float, tuple[float, float, float], bool]] = []
        self._branches = 0

    def _add(self, kind: PlantKind, foot: float, height: float, sway: float, parts: tuple[FloatArray, ...]) -> None:
        centre, outward, rgb, clump = parts
        n, rng = len(centre), self.rng
        normal = 0.5 * outward + [0.0, 0.0, 0.6] + 0.45 * rng.standard_normal((n, 3))
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        radius = self.plan.leaf_radius_m * rng.uniform(0.65, 1.35, n)
        rgb = rgb * np.exp(rng.normal(0.0, 0.18, n))[:, None] * np.exp(rng.normal(0.0, 0.05, (n, 3)))
        self._leaves.append((centre, normal, radius, rgb, clump.astype(np.int64) + self._branches))
        self._branches += int(clump.max()) + 1
        self._plants.append((int(kind), foot, height, sway))

    def crown(self, xy: FloatArray, foot_m: float, radius_m: float, height_m: float) -> None:
        """Let a deciduous tree grow: plan place (2,), height of its foot, radius of its crown, height of its top."""
        rng, rho = self.rng, self.plan.leaf_radius_m
        count = round(10 + 2.4 * radius_m**2)
        size = radius_m * rng.uniform(0.20, 0.34, count)
        way = _on_sphere(rng, count)
        way[:, 2] = np.where(way[:, 2] < -0.3, -way[:, 2], way[:, 2])
        way *= rng.uniform(0.75, 1.0, (count, 1)) * (1.0 - 0.9 * size[:, None] / radius_m)
        way[0] = [0.1, 0.0, 0.8]
        axes = np.array([radius_m, radius_m, 0.36 * height_m])
        clump = way * axes + [xy[0], xy[1], foot_m + 0.60 * height_m]
        leaves = np.maximum(LEAF_AREA * (size / rho) ** 2, 6).astype(int)
        of = np.repeat(np.arange(count), leaves)
        out = _on_sphere(rng, len(of))
        out[:, 2] = np.where(rng.random(len(of)) < 0.6, np.abs(out[:, 2]), out[:, 2])
        depth = rng.uniform(0.15, 1.0, (len(of), 1)) ** (1 / 2.2)
        centre = clump[of] + size[of, None] * out * depth * [1.0, 1.0, 0.6]
        centre[:, 2] = np.minimum(centre[:, 2], foot_m + height_m)
        hue = _LEAF_RGB * rng.uniform(0.75, 1.25) * np.exp(rng.normal(0.0, [0.12, 0.05, 0.08]))
        light = np.exp(rng.normal(0.0, 0.15, count))[of]
        sway = self.plan.sway_m * float(np.clip(height_m / 9.0, 0.15, 1.0))
        self._add(PlantKind.CROWN, foot_m, height_m, sway, (centre, out, hue * light[:, None], of.astype(np.float64)))

    def hedge(self, ends: FloatArray, foot_m: FloatArray, width_m: float, height_m: float) -> None:
        """Let a hedge grow from ends[0] to ends[1] (2, 2), on a ground of heights (K,) evenly along it."""
        rng = self.rng
        length = float(np.linalg.norm(ends[1] - ends[0]))
        count = int(HEDGE_LEAF_AREA * length * width_m / (np.pi * (0.8 * self.plan.leaf_radius_m) ** 2))
        along, turn = rng.random(count), rng.uniform(0.0, np.pi, count)
        depth = rng.uniform(0.1, 1.0, count) ** (1 / 3)
        side, up = np.cos(turn), np.sin(turn)
        bulk = np.maximum(np.abs(side), up)  # an arch that is nearly a box
        across, rise = (depth * s * (0.5 + 0.5 / bulk) for s in (side, up))
        ahead = (ends[1] - ends[0]) / length
        left = np.array([-ahead[1], ahead[0]])
        wave = 0.06 * np.sin(2 * np.pi * along * length / 1.7) + 0.05 * np.sin(2 * np.pi * along * length / 0.63 + 1.0)
        ground = np.interp(along, np.linspace(0.0, 1.0, len(foot_m)), foot_m)
        xy = ends[0] + along[:, None] * (ends[1] - ends[0]) + (across * (width_m / 2 + wave))[:, None] * left
        # an arch standing on the ground, filled from a third of its height
        z = ground + np.clip(rise, 0.0, 1.0) * (height_m - 0.12 + wave)
        out = np.column_stack([side[:, None] * left, up])
        branch = np.floor(along * length / 0.8)
        hue = np.tile(_HEDGE_RGB * rng.uniform(0.8, 1.2), (count, 1))
        foot = float(foot_m.min())
        height = float(z.max() - foot)
        self._add(PlantKind.HEDGE, foot, height, 0.1 * self.plan.sway_m, (np.column_stack([xy, z]), out, hue, branch))

    def line(
        self, points: FloatArray, radius_m: float, rgb: tuple[float, float, float], *, upright: bool = False
    ) -> None:
        """Hang or stand a line through points (K, 3)."""
        for a, b in pairwise(points):
            pieces = max(1, int(np.ceil(np.linalg.norm(b - a) / _PIECE_M)))
            place = a + np.linspace(0.0, 1.0, pieces + 1)[:, None] * (b - a)
            self._lines.append((place[:-1], place[1:], radius_m, rgb, upright))

    def cover(self, sun: FloatArray) -> Cover:
        """Return all that has grown, in the light of a sun in direction (3,)."""
        kind, foot, height, sway = np.array(self._plants or np.zeros((0, 4))).T
        plants = Plants(kind.astype(np.uint8), foot, height, sway)
        none = (np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0, np.int64))
        centre, normal, radius, rgb, branch = (np.concatenate(parts) for parts in zip(none, *self._leaves, strict=True))
        plant = np.repeat(np.arange(len(self._leaves)), [len(parts[0]) for parts in self._leaves])
        leaves = Leaves(centre, normal, radius, rgb, plant.astype(np.int64), branch)
        bare = Cover(plants, leaves, _lines_of(self._lines), self.seed)
        return replace(bare, leaves=replace(leaves, rgb=rgb * _leaf_light(bare, sun, self.rng)[:, None]))


def _lines_of(lines: list[tuple[FloatArray, FloatArray, float, tuple[float, float, float], bool]]) -> Lines:
    count = [len(line[0]) for line in lines]
    return Lines(
        np.concatenate([np.zeros((0, 3)), *(line[0] for line in lines)]),
        np.concatenate([np.zeros((0, 3)), *(line[1] for line in lines)]),
        np.repeat(np.array([line[2] for line in lines]), count),
        np.repeat(np.array([line[3] for line in lines]).reshape(-1, 3), count, axis=0),
        np.repeat(np.array([line[4] for line in lines], dtype=bool), count),
    )


def _leaf_light(cover: Cover, sun: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the light (L,) on each leaf: of the sun, where no other leaf is in its way, and of the sky it sees."""
    leaves, pieces = cover.leaves, cover.at_rest
    n = len(leaves.radius_m)
    lit = np.zeros(n)
    for _ in range(2):
        aim = sun + 0.02 * rng.standard_normal((n, 3))
        lit += ~np.isfinite(leaf_hits(pieces, leaves.centre_m + _OFF_M * aim, aim, 50.0)) / 2
    open_sky = np.zeros(n)
    for _ in range(3):
        aim = rng.standard_normal((n, 3))
        aim[:, 2] = np.abs(aim[:, 2]) + 0.5
        open_sky += ~np.isfinite(leaf_hits(pieces, leaves.centre_m + _OFF_M * aim, aim, 50.0)) / 3
    facing = leaves.normal @ sun
    direct = np.where(facing > 0.0, facing, -_THROUGH * facing)
    return np.asarray(_SKY * (_DARKEST + (1.0 - _DARKEST) * open_sky**1.5) + 0.86 * direct * lit)
