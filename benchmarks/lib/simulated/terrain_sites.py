"""Sites whose bare terrain is known, as photogrammetry gives their surface: smooth edges, noise, holes beside walls.

Nothing is rendered: objects stand on a terrain of waves, the surface over both is blurred and gets noise that
neighbours share. All sites have CELLS × CELLS cells of CELL_M, a GSD of GSD_M.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter, maximum_filter, minimum_filter

from photogram.arrays import BoolArray, FloatArray
from photogram.survey import Raster

CELLS, CELL_M, GSD_M = 560, 0.25, 0.125
SIDE_M = CELLS * CELL_M
NOISE_GSD = 0.75
OBJECT_M, GROUND_M = 0.3, 0.1
"""What stands so high above the terrain is an object, what lies lower than that on the ground; between, neither."""

_BLUR_CELLS, _SHARED_CELLS = 1.0, 1.0
_HOLES_BESIDE_WALLS, _HOLES = 0.25, 0.004


@dataclass(frozen=True, eq=False)
class TerrainSite:
    """A surface with noise and holes, standard deviation of its heights, its terrain, and what is ground and object
    without doubt (rows, columns)."""

    surface: Raster
    sigma: Raster
    terrain_m: FloatArray
    ground: BoolArray
    objects: BoolArray


@dataclass(frozen=True, eq=False)
class _Land:
    """A site in the making: positions, terrain and heights of what stands on it, over the terrain's datum."""

    rng: np.random.Generator
    x: FloatArray
    y: FloatArray
    terrain: FloatArray
    top: FloatArray

    def box(self, x: float, y: float, length: float, width: float, angle: float) -> tuple[FloatArray, FloatArray]:
        """Return how far along and across the cells lie from a centre, in halves of length and width."""
        dx, dy = self.x - x, self.y - y
        along, across = dx * np.cos(angle) + dy * np.sin(angle), dy * np.cos(angle) - dx * np.sin(angle)
        return along / (length / 2), across / (width / 2)

    def house(self, x: float, y: float, length: float, width: float, eaves: float, pitch: float, angle: float) -> None:
        """Put up a house whose eaves stand so high above the highest ground beside it; its roof has a ridge."""
        along, across = self.box(x, y, length, width, angle)
        inside = (np.abs(along) <= 1) & (np.abs(across) <= 1)
        if inside.any():
            roof = self.terrain[inside].max() + eaves + pitch * width / 2 * (1 - np.abs(across))
            self.top[inside] = np.maximum(self.top, roof)[inside]

    def tree(self, x: float, y: float, height: float, radius: float) -> None:
        """Plant a tree with a round, rough crown down to a quarter of its height."""
        row, column = (slice(max(int((c - radius) / CELL_M), 0), int((c + radius) / CELL_M) + 2) for c in (y, x))
        near = np.hypot(self.x[row, column] - x, self.y[row, column] - y) / radius
        terrain, top = self.terrain[row, column], self.top[row, column]
        inside = near < 1
        if inside.any():
            rough = self.rng.normal(0, 0.25, near.shape)
            crown = height * (0.25 + 0.75 * np.sqrt(np.maximum(1 - near**2, 0))) + rough
            foot = terrain[np.unravel_index(np.argmin(near), near.shape)]
            top[inside] = np.maximum(top, foot + crown)[inside]

    def places(self, count: int, apart: float) -> list[tuple[float, float]]:
        """Return up to so many places that lie apart."""
        chosen: list[tuple[float, float]] = []
        for x, y in self.rng.uniform(0, SIDE_M, (count * 20, 2)):
            if len(chosen) < count and all(np.hypot(x - a, y - b) >= apart for a, b in chosen):
                chosen.append((float(x), float(y)))
        return chosen


def _waves(rng: np.random.Generator, x: FloatArray, y: FloatArray, relief_m: float) -> FloatArray:
    """Return heights of waves of 90 to 3 m, the longest of which rise so high."""
    total = np.zeros(x.shape)
    for length in (90.0, 45.0, 22.0, 11.0, 6.0, 3.0):
        for _ in range(3):
            angle, phase = rng.uniform(0, 2 * np.pi, 2)
            wave = np.sin(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / length + phase)
            total += relief_m / 3 * (length / 90.0) ** 1.3 * wave
    return total


def _land(seed: int, slope_deg: float, relief_m: float) -> _Land:
    rng = np.random.default_rng(seed)
    at = (np.arange(CELLS) + 0.5) * CELL_M
    y, x = np.meshgrid(at, at, indexing="ij")
    angle = rng.uniform(0, 2 * np.pi)
    plane = np.tan(np.radians(slope_deg)) * (x * np.cos(angle) + y * np.sin(angle))
    terrain = 200.0 + plane + _waves(rng, x, y, relief_m)
    return _Land(rng, x, y, terrain, terrain.copy())


def _cars(land: _Land, count: int) -> None:
    for x, y in land.places(count, 5.0):
        land.house(x, y, 4.4, 1.8, 1.4, 0.0, land.rng.choice([0.0, np.pi / 2]))


def _town(seed: int) -> _Land:
    land = _land(seed, 2.0, 1.5)
    for east, north, length, width, height in ((32, 34, 44, 40, 9), (108, 36, 50, 24, 5), (70, 108, 38, 36, 14)):
        land.house(east, north, length, width, height, 0.0, land.rng.uniform(0, np.pi))
    land.house(104, 32, 14, 12, 9, 0.0, 0.4)
    for x, y in land.places(22, 17.0):
        size = land.rng.uniform(8, 16, 2)
        pitch = land.rng.choice([0.0, 0.6, 1.0])
        land.house(x, y, size.max(), size.min(), land.rng.uniform(2.5, 9), pitch, land.rng.uniform(0, np.pi))
    _cars(land, 40)
    for x, y in land.places(25, 8.0):
        land.tree(x, y, land.rng.uniform(5, 12), land.rng.uniform(1.5, 4))
    return land


def _wood(seed: int) -> _Land:
    """Crowns so dense that about an eighth of the ground is seen."""
    land = _land(seed, 22.0, 4.0)
    while np.mean(land.top > land.terrain + OBJECT_M) < 0.86:
        for x, y in land.rng.uniform(0, SIDE_M, (40, 2)):
            land.tree(float(x), float(y), land.rng.uniform(8, 20), land.rng.uniform(2.0, 4.0))
    return land


def _bare(slope_deg: float) -> Callable[[int], _Land]:
    def bare(seed: int) -> _Land:
        return _land(seed, slope_deg, 4.0)

    return bare


def _houses_on_slope(seed: int) -> _Land:
    land = _land(seed, 26.0, 2.0)
    for x, y in land.places(14, 22.0):
        land.house(x, y, land.rng.uniform(9, 16), land.rng.uniform(8, 10), 2.5, 0.6, land.rng.uniform(0, np.pi))
    for x, y in land.places(40, 9.0):
        land.tree(x, y, land.rng.uniform(4, 12), land.rng.uniform(1.5, 4))
    return land


def _stand_on(land: _Land, terrain: FloatArray) -> _Land:
    return _Land(land.rng, land.x, land.y, terrain, terrain.copy())


def _terraces(seed: int) -> _Land:
    """Terraces with walls, a cut of 5 m with faces of 60°, an embankment of 4 m with faces of 34°, a heap."""
    land = _land(seed, 0.0, 1.0)
    down = land.y + 4 * np.sin(land.x / 25)
    part = np.clip(down, 0, 66)
    stair = 2.2 * np.floor(part / 11) + 0.03 * part
    cut = -np.clip(5 - np.maximum(np.abs(land.x - 30 - 0.2 * land.y) - 5, 0) * np.tan(np.radians(60)), 0, None)
    bank = np.clip(4 - np.maximum(np.abs(land.y - 112) - 4, 0) * np.tan(np.radians(34)), 0, None)
    heap = np.clip(6 - np.hypot(land.x - 110, land.y - 88) * 0.75, 0, None)
    land = _stand_on(land, land.terrain - stair + np.where(land.y > 72, bank, 0) + heap + np.where(land.x < 70, cut, 0))
    for x, y in land.places(12, 20.0):
        land.tree(x, y, land.rng.uniform(3, 8), land.rng.uniform(1, 3))
    return land


def _street(seed: int) -> _Land:
    land = _land(seed, 3.0, 1.0)
    across = np.abs(land.y - 70 - 0.1 * (land.x - 70))
    land = _stand_on(land, land.terrain - 0.14 * (across < 6))
    lane = np.linspace(4, SIDE_M - 4, 22)
    for x in lane[land.rng.uniform(size=22) < 0.8]:
        for offset in (-4.8, 4.8):
            if land.rng.uniform() < 0.8:
                land.house(x, 70 + 0.1 * (x - 70) + offset, 4.5, 1.8, 1.45, 0.0, 0.1)
    for x in np.arange(10, SIDE_M, 25):
        land.house(x, 77 + 0.1 * (x - 70), 0.5, 0.5, 6.0, 0.0, 0.0)
        land.house(x + 8, 58 + 0.1 * (x - 70), 3.0, 12.0, 2.6, 0.0, 0.1)  # a van, a lorry
    for x in np.arange(8, SIDE_M, 18):
        land.house(x, 92 + 0.1 * (x - 70), 11, 9, 5.5, 0.8, 0.1)
        land.house(x + 9, 82 + 0.1 * (x - 70), 0.8, 8.0, 1.6, 0.0, 0.1)  # a hedge
        land.house(x, 40, 12, 10, 6.5, 0.0, 0.1)
    _cars(land, 15)
    return land


def _bridge(seed: int) -> _Land:
    """A road on dams over a valley, and its deck of 32 × 9 m, 7 m above it."""
    land = _land(seed, 0.0, 1.5)
    valley = -7.0 * np.clip(1.6 - np.abs(land.x - 70) / 16, 0, 1)
    road = np.abs(land.y - 70)
    base = land.terrain - np.where(road < 14, land.terrain - 200, 0) * np.clip(1.5 - road / 10, 0, 1)
    dam = np.clip(1.0 - np.maximum(road - 4.5, 0) * 0.67, -20, None)
    shore = np.abs(land.x - 70) > 16
    land = _stand_on(land, np.where(shore, np.maximum(base + valley, 200 + dam), base + valley))
    deck = (np.abs(land.x - 70) <= 16) & (road <= 4.5)
    land.top[deck] = 201.0
    for x, y in land.places(25, 9.0):
        if abs(y - 70) > 12:
            land.tree(x, y, land.rng.uniform(4, 10), land.rng.uniform(1.5, 4))
    return land


def _village(seed: int) -> _Land:
    land = _land(seed, 8.0, 4.0)
    for x, y in land.places(14, 20.0):
        length = land.rng.uniform(9, 24)
        land.house(x, y, length, land.rng.uniform(7, 12), land.rng.uniform(2.5, 6), 0.8, land.rng.uniform(0, np.pi))
    for x, y in land.places(8, 12.0):
        land.house(x, y, 14, 0.9, 1.5, 0.0, land.rng.uniform(0, np.pi))
    for x, y in land.places(70, 5.0):
        land.tree(x, y, land.rng.uniform(3, 14), land.rng.uniform(1, 4.5))
    _cars(land, 12)
    return land


SITES: dict[str, Callable[[int], _Land]] = {
    "town, flat roofs to 40 m": _town,
    "wood on a slope of 22°": _wood,
    "bare slope of 15°": _bare(15.0),
    "bare slope of 30°": _bare(30.0),
    "bare slope of 40°": _bare(40.0),
    "houses and trees, 26°": _houses_on_slope,
    "terraces, cut, dam, heap": _terraces,
    "street with cars and poles": _street,
    "bridge": _bridge,
    "village": _village,
}


def terrain_site(name: str, seed: int) -> TerrainSite:
    """Return the site of a class of SITES that follows from a seed."""
    land = SITES[name](seed)
    rng = land.rng
    smooth = gaussian_filter(land.top, _BLUR_CELLS)
    above = smooth - land.terrain
    noise = gaussian_filter(rng.normal(size=smooth.shape), _SHARED_CELLS)
    sigma_m = NOISE_GSD * GSD_M
    surface = smooth + sigma_m * noise / noise.std()
    walls = maximum_filter(land.top, 5) - minimum_filter(land.top, 5) > 3.0
    hidden = gaussian_filter(rng.normal(size=smooth.shape), 3.0)
    hidden /= hidden.std()
    holes = (walls & (hidden > np.quantile(hidden, 1 - _HOLES_BESIDE_WALLS))) | (
        hidden > np.quantile(hidden, 1 - _HOLES)
    )
    surface[holes] = np.nan
    # the blur rounds the terrain's own edges too: what lies on them is ground all the same
    bare_edge = binary_dilation(np.abs(land.top - land.terrain) > 1e-6, np.ones((9, 9), bool))
    ground = (~bare_edge) | ((np.abs(above) < GROUND_M) & (land.top <= land.terrain))
    objects = (above > OBJECT_M) & (land.top > land.terrain)
    known = np.isfinite(surface)

    def raster(values: FloatArray) -> Raster:
        return Raster(values.astype(np.float32), 0.0, SIDE_M, CELL_M)

    sigmas = np.where(known, sigma_m, np.nan)
    return TerrainSite(
        raster(surface), raster(sigmas), gaussian_filter(land.terrain, _BLUR_CELLS), ground & known, objects & known
    )
