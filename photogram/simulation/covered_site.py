"""A made site with cover: trees and hedges of leaves, high grass, a pond, fences and power lines, from a seed.

Ground, roads and buildings are those of a scene; the height field holds ground, roofs, the tufts of the grass and the
level of the water, and everything above it is in the scene's cover.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from photogram.arrays import ByteArray, FloatArray, IntArray
from photogram.simulation.cover.hits import leaf_hits
from photogram.simulation.cover.leaves import Cover, CoverPlan, Grower
from photogram.simulation.scene import Builder, Material, Scene, noise

_GRASS_M = 0.15
"""Mean height of high grass above the terrain."""

_FENCE_M = 16.0
"""Length of a fence."""

_FENCED = (Material.MEADOW, Material.CROP, Material.SOIL, Material.GRASS)
"""Where fences stand."""

_SAG_M = 1.0
"""How much a wire sags between two poles."""

_INNER, _MIDDLE = 0.5, 0.35
"""How much of the site, from its middle, holds what there is little of: there photographs overlap."""

_WOOD_M = 16.0
"""Radius of the wood."""

_PLACES_AT_ONCE = 1 << 18


class CoverBuilder(Builder):
    """A builder whose trees are crowns of leaves, and which makes a pond, grass, hedges, fences and power lines."""

    def __init__(self, seed: int, extent_m: float, cell_m: float, plan: CoverPlan) -> None:
        super().__init__(seed, extent_m, cell_m)
        self.plan, self.grower = plan, Grower(plan, seed)
        self.wood_is_full = False
        self.wood: FloatArray | None = None
        self.wood_crowns: list[tuple[FloatArray, float]] = []

    def ground(self, seed: int, relief_m: float) -> None:
        """Lay the ground as in any scene, then high grass and a pond."""
        super().ground(seed, relief_m)
        flat, shape = self.xy.reshape(-1, 2), self.height.shape
        if self.plan.grass:
            field = noise(seed + 57, flat, np.array([25.0, 4.0]), np.array([1.0, 0.2])).reshape(shape)
            tufts = noise(seed + 71, flat, np.array([0.55, 0.28]), np.array([0.10, 0.07])).reshape(shape)
            high = (self.material == Material.MEADOW) & (field > 0.08)
            self.height[high] += _GRASS_M + tufts[high]
            self.material[high] = Material.GRASS
        if self.plan.pond_radius_m > 0.0:
            self.pond(seed)

    def pond(self, seed: int) -> None:
        """Dig a pond with level water and a bank."""
        reach = 1.5 * self.plan.pond_radius_m
        centre = self.place(reach, 0.0, _MIDDLE * self.half_m)
        if centre is None:
            return
        window, xy = self.window(centre, reach)
        shore = noise(seed + 83, xy.reshape(-1, 2), np.array([9.0, 2.5]), np.array([0.35, 0.08]))
        out = np.linalg.norm(xy - centre, axis=-1) / self.plan.pond_radius_m + shore.reshape(xy.shape[:2])
        level = float(self.height[window][out < 1.3].min()) - 0.1
        bank = np.clip((out - 1.0) / 0.3, 0.0, 1.0)
        ground = level + bank * (self.height[window] - level)
        self.height[window] = np.where(out < 1.3, ground, self.height[window])
        self.material[window] = np.where(out < 1.0, Material.WATER, self.material[window])
        self.taken.append((float(centre[0]), float(centre[1]), reach))

    def crown(self) -> None:
        """Let a tree of leaves grow, in the wood as long as that wants more."""
        radius = self.rng.uniform(1.2, 3.4)
        tall = radius * self.rng.uniform(1.8, 2.6)
        if len(self.wood_crowns) < self.plan.wood_trees and not self.wood_is_full:
            centre = self.wood_place(radius)
            self.wood_is_full = centre is None
        else:
            centre = self.place(radius, 0.0)
        if centre is None:
            return
        window, xy = self.window(centre, radius)
        under = np.linalg.norm(xy - centre, axis=-1) < radius
        self.material[window] = np.where(under, Material.LITTER, self.material[window])
        self.grower.crown(centre, float(self.height[window].min()), radius, tall)

    def room_m(self, place: FloatArray) -> float:
        """Return how far a place (2,) is from roads and from what is built or dug, less than 0 within."""
        roads = [abs(float(road.along_across(place)[1])) - road.width_m / 2 for road in self.roads]
        return min([*roads, *(float(np.hypot(x - place[0], y - place[1])) - r for x, y, r in self.taken)])

    def wood_place(self, radius_m: float) -> FloatArray | None:
        """Find a place in the wood, which lies where there is most room, None when it is full."""
        if self.wood is None:
            offers = self.rng.uniform(-1.0, 1.0, (200, 2)) * _MIDDLE * self.half_m
            self.wood = offers[int(np.argmax([self.room_m(offer) for offer in offers]))]
        for _ in range(500):
            offset = self.rng.uniform(-_WOOD_M, _WOOD_M, 2)
            centre = self.wood + offset
            apart = all(np.hypot(*(centre - other)) > 0.75 * (radius_m + r) for other, r in self.wood_crowns)
            if apart and np.hypot(*offset) < _WOOD_M - radius_m and self.room_m(centre) > radius_m:
                self.wood_crowns.append((centre, radius_m))
                return np.asarray(centre)
        return None

    def along(self, ends: FloatArray) -> tuple[FloatArray, IntArray, IntArray]:
        """Return places (K, 2) every cell along a line (2, 2), and their rows and columns of vertices."""
        count = max(2, int(np.ceil(np.linalg.norm(ends[1] - ends[0]) / self.cell_m)) + 1)
        places = ends[0] + np.linspace(0.0, 1.0, count)[:, None] * (ends[1] - ends[0])
        column, row = np.clip(np.rint((places + self.half_m) / self.cell_m), 0, len(self.axis) - 1).astype(int).T
        return places, row, column

    def straight(self, reach_m: float) -> FloatArray | None:
        """Find the ends (2, 2) of a straight line of length 2 reach_m on open ground."""
        centre = self.place(reach_m, 0.0, _INNER * self.half_m)
        angle = self.rng.uniform(0.0, np.pi)
        if centre is None:
            return None
        way = reach_m * np.array([np.cos(angle), np.sin(angle)])
        return np.stack([centre - way, centre + way])

    def hedge(self) -> None:
        """Plant a straight hedge."""
        ends, width = self.straight(self.rng.uniform(4.0, 8.0)), self.rng.uniform(0.9, 1.5)
        if ends is None:
            return
        _, row, column = self.along(ends)
        self.grower.hedge(ends, self.height[row, column], width, self.rng.uniform(1.2, 2.2))
        middle, reach = ends.mean(axis=0), float(np.linalg.norm(ends[1] - ends[0])) / 2
        window, xy = self.window(middle, reach + width)
        ahead = (ends[1] - ends[0]) / (2 * reach)
        off = xy - middle
        under = (np.abs(off @ ahead) < reach) & (np.abs(off[..., 0] * ahead[1] - off[..., 1] * ahead[0]) < width / 2)
        self.material[window] = np.where(under, Material.LITTER, self.material[window])
        self.taken += [(float(x), float(y), width) for x, y in np.linspace(ends[0], ends[1], 9)]

    def fence(self) -> None:
        """Put up a straight fence with three wires where nothing grows."""
        for _ in range(200):
            angle, centre = self.rng.uniform(0.0, np.pi), self.rng.uniform(-_INNER, _INNER, 2) * self.half_m
            way = _FENCE_M / 2 * np.array([np.cos(angle), np.sin(angle)])
            places, row, column = self.along(np.stack([centre - way, centre + way]))
            if np.isin(self.material[row, column], _FENCED).all():
                break
        else:
            return
        ground = np.column_stack([places, self.height[row, column]])
        step = max(1, round(2.5 / self.cell_m))
        for foot in ground[::step]:
            self.grower.line(
                foot + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.3]]), 0.05, (0.22, 0.17, 0.12), upright=True
            )
        for rail in (0.45, 0.85, 1.25):
            self.grower.line(ground[::step] + np.array([0.0, 0.0, rail]), 0.012, (0.35, 0.34, 0.33))

    def power_line(self) -> None:
        """Put up three poles where nothing is built or grows, and hang two wires over whatever lies between."""
        for _ in range(200):
            angle, centre = self.rng.uniform(0.0, np.pi), self.rng.uniform(-0.3, 0.3, 2) * self.half_m
            way = np.array([np.cos(angle), np.sin(angle)])
            poles = centre + np.linspace(-0.45, 0.45, 3)[:, None] * self.half_m * way
            column, row = np.rint((poles + self.half_m) / self.cell_m).astype(int).T
            _, under_r, under_c = self.along(poles[[0, -1]])
            built = self.material[under_r, under_c] >= Material.ROOF_TILES
            if np.all(self.material[row, column] <= Material.SOIL) and not built.any():
                break
        else:
            return
        foot = np.column_stack([poles, self.height[row, column]])
        for place in foot:
            self.grower.line(
                place + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 9.0]]), 0.13, (0.25, 0.20, 0.15), upright=True
            )
        left = np.array([-way[1], way[0], 0.0])
        share = np.linspace(0.0, 1.0, 17)[:, None]
        for side in (-0.6, 0.6):
            hung = foot + [0.0, 0.0, 8.8] + side * left
            for a, b in pairwise(hung):
                sag = np.array([0.0, 0.0, -4.0 * _SAG_M]) * share * (1.0 - share)
                self.grower.line(a + share * (b - a) + sag, 0.015, (0.10, 0.10, 0.11))


def _sunlight(scene: Scene, cover: Cover) -> ByteArray:
    """Return the light of a scene, without sun where leaves stand in its way."""
    rows, columns = scene.height_m.shape
    light = scene.light.ravel().copy()
    for start in range(0, rows * columns, _PLACES_AT_ONCE):
        vertex = np.arange(start, min(start + _PLACES_AT_ONCE, rows * columns))
        row, column = np.divmod(vertex, columns)
        origin = np.column_stack([
            scene.west_m + column * scene.cell_m, scene.south_m + row * scene.cell_m, scene.height_m[row, column]
        ])  # fmt: skip
        shaded = np.isfinite(leaf_hits(cover.at_rest, origin, np.tile(scene.sun, (len(origin), 1)), np.inf))
        light[vertex[shaded]] = 0
    return np.asarray(light.reshape(rows, columns))


def make_covered_scene(
    seed: int,
    extent_m: float,
    cell_m: float,
    relief_m: float,
    buildings: int,
    trees: int,
    *,
    finest_wavelength_m: float,
    plan: CoverPlan,
) -> Scene:
    """Make a site as scene.make_scene does, with crowns of leaves in place of its domes, and what else ``plan`` asks
    for, where there is room; the same seed, the same site."""
    builder = CoverBuilder(seed, extent_m, cell_m, plan)
    builder.ground(seed, relief_m)
    for number in range(buildings):
        builder.building(gabled=number % 3 != 2)
    for _ in range(plan.hedges):
        builder.hedge()
    for _ in range(trees):
        builder.crown()
    for _ in range(plan.fences):
        builder.fence()
    for _ in range(plan.power_lines):
        builder.power_line()
    scene = builder.scene(seed, finest_wavelength_m)
    cover = builder.grower.cover(scene.sun)
    return replace(scene, light=_sunlight(scene, cover), cover=cover)
