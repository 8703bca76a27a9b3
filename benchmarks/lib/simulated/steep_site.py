"""A made site of steep ground: heaps, quarry benches, terraces, gables, round crowns and walls on rolling terrain.

Faces are planes or cones of a stated angle, laid on the terrain: with its own slope they become some degrees gentler or
steeper. Where a shape finds no room it is left out; ``SteepSite.heaps`` says which heaps stand.
"""

from dataclasses import dataclass, replace

import numpy as np

from photogram.arrays import FloatArray
from photogram.simulation.scene import Builder, Material, Scene
from photogram.simulation.survey_plan import SurveyPlan

HEAP_FACES_DEG = (30.0, 35.0, 45.0, 55.0, 60.0, 65.0, 70.0, 75.0, 80.0)
BENCH_FACES_DEG = (60.0, 65.0, 70.0, 75.0, 80.0)
GABLES_DEG = (30.0, 40.0, 50.0, 60.0)
CROWNS = 24
HALLS = 3
INNER = 0.48
"""Share of the site, from its middle, that holds the shapes: there photographs overlap."""


@dataclass(frozen=True)
class Heap:
    """A frustum of a cone on the terrain: its middle in the world frame, radii of foot and top, height, face."""

    east_m: float
    north_m: float
    foot_m: float
    top_m: float
    height_m: float
    face_deg: float

    @property
    def volume_m3(self) -> float:
        """Return the volume over the terrain."""
        return float(np.pi / 3.0 * self.height_m * (self.foot_m**2 + self.foot_m * self.top_m + self.top_m**2))


@dataclass(frozen=True, eq=False)
class SteepSite:
    """A site of steep ground, and its heaps."""

    scene: Scene
    heaps: tuple[Heap, ...]


class SteepBuilder(Builder):
    """A builder of shapes with faces of a stated angle."""

    def __init__(self, seed: int, extent_m: float, cell_m: float) -> None:
        super().__init__(seed, extent_m, cell_m)
        self.heaps: list[Heap] = []

    def _room(self, reach_m: float) -> FloatArray | None:
        """Find a place for a shape, and keep others off it."""
        centre = self.place(reach_m, 1.5, INNER * self.half_m)
        if centre is not None:
            self.taken.append((float(centre[0]), float(centre[1]), reach_m))
        return centre

    def _raise(self, window: tuple[slice, slice], above_m: FloatArray, material: Material) -> None:
        """Lay a shape on the terrain, where it is above it."""
        self.height[window] += above_m
        self.material[window] = np.where(above_m > 0.0, material, self.material[window])

    def heap(self, face_deg: float) -> None:
        """Pour a heap: a frustum of a cone."""
        height, top = self.rng.uniform(2.5, 4.5), self.rng.uniform(1.5, 3.0)
        rise = float(np.tan(np.radians(face_deg)))
        foot = top + height / rise
        centre = self._room(foot)
        if centre is None:
            return
        window, xy = self.window(centre, foot)
        distance = np.linalg.norm(xy - centre, axis=-1)
        self._raise(window, np.clip((foot - distance) * rise, 0.0, height), Material.LITTER)
        self.heaps.append(Heap(float(centre[0]), float(centre[1]), foot, top, height, face_deg))

    def _oblong(self, length_m: float, width_m: float) -> tuple[tuple[slice, slice], FloatArray, FloatArray] | None:
        """Return the window of a rectangle, turned by chance, and how far its vertices are from its axes."""
        reach = float(np.hypot(length_m, width_m)) / 2.0
        centre = self._room(reach)
        if centre is None:
            return None
        window, xy = self.window(centre, reach)
        angle = self.rng.uniform(0.0, np.pi)
        c, s = np.cos(angle), np.sin(angle)
        return window, np.abs((xy - centre) @ [c, s]), np.abs((xy - centre) @ [-s, c])

    def bench(self, face_deg: float, steps: int) -> None:
        """Cut benches of a quarry, or ``steps`` of a terrace: planes of a stated angle, level strips between them."""
        height, strip = self.rng.uniform(3.0, 4.5) / steps**0.5, 1.8
        rise = float(np.tan(np.radians(face_deg)))
        width = 2.0 * steps * (height / rise + strip) + 2.0
        length = max(self.rng.uniform(10.0, 14.0), width + 2.0)
        shape = self._oblong(length, width)
        if shape is None:
            return
        window, along, across = shape
        inward = np.minimum(length / 2.0 - along, width / 2.0 - across)
        above = sum(np.clip((inward - k * (height / rise + strip)) * rise, 0.0, height) for k in range(steps))
        self._raise(window, np.asarray(above), Material.LITTER)

    def house(self, gable_deg: float | None) -> None:
        """Build a house on level footings, its gable at a stated angle; None: a hall with a flat roof."""
        length, width, eaves = self.rng.uniform(8.0, 12.0), self.rng.uniform(6.0, 8.0), self.rng.uniform(2.5, 4.0)
        shape = self._oblong(length, width)
        if shape is None:
            return
        window, along, across = shape
        inside = (along <= length / 2.0) & (across <= width / 2.0)
        rise = 0.0 if gable_deg is None else float(np.tan(np.radians(gable_deg)))
        roof = float(self.height[window][inside].mean()) + eaves + rise * (width / 2.0 - across)
        kind = Material.ROOF_GRAVEL if gable_deg is None else Material.ROOF_TILES
        self.height[window] = np.where(inside, roof, self.height[window])
        self.material[window] = np.where(inside, kind, self.material[window])

    def crown(self) -> None:
        """Let a round crown stand on the terrain: half an ellipsoid."""
        radius = self.rng.uniform(1.5, 4.0)
        tall = radius * self.rng.uniform(0.9, 1.4)
        centre = self._room(radius)
        if centre is None:
            return
        window, xy = self.window(centre, radius)
        inner = np.clip(1.0 - np.sum((xy - centre) ** 2, axis=-1) / radius**2, 0.0, 1.0)
        self._raise(window, tall * np.sqrt(inner), Material.TREE)


def steep_site(plan: SurveyPlan, seed: int, extent_m: float, contrast: float = 1.0) -> SteepSite:
    """Make the site of a plan, a square of side ``extent_m``, its texture with a factor of ``contrast``."""
    builder = SteepBuilder(seed, extent_m, plan.cell_m)
    builder.ground(seed, plan.relief_m)
    for face_deg in HEAP_FACES_DEG:
        builder.heap(face_deg)
    for number, face_deg in enumerate(BENCH_FACES_DEG):
        builder.bench(face_deg, steps=1 + number % 3)
    for gable_deg in (*GABLES_DEG, *[None] * HALLS):
        builder.house(gable_deg)
    for _ in range(CROWNS):
        builder.crown()
    scene = builder.scene(seed, 2.0 * plan.gsd_m)
    return SteepSite(replace(scene, contrast=contrast), tuple(builder.heaps))
