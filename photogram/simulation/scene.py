"""A made site with known truth: terrain with hills, roads, buildings, trees and painted targets.

Trees are domes of the height field; covered_site.py makes a site with leaves, water and wires in their place.

The site is a height field over a square of the world frame (x east, y north, z up, metres), bilinear between its
vertices; vertical walls are one cell wide. Everything follows from a seed, without state: the relief and the texture
are gradient noise (Perlin 2002) of an integer hash of the lattice node.
"""

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property

import numpy as np
from scipy.ndimage import map_coordinates

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array
from photogram.compilation import njit
from photogram.geodesy.frames import LocalFrame
from photogram.simulation.cover.leaves import Cover
from photogram.survey import Raster

BLOCK_CELLS = 16
"""Side, in cells, of the blocks whose highest vertex lets a ray skip them."""

RING = 1.4
"""Outer radius of the light ring around a target, in radii of the target."""

_TERRAIN_WAVELENGTH_M = np.array([120.0, 60.0, 30.0, 15.0, 7.5])
_TERRAIN_AMPLITUDE = np.array([0.9, 0.4, 0.18, 0.07, 0.025])
_SUN_AZIMUTH_DEG, _SUN_ELEVATION_DEG = 205.0, 50.0


class Material(IntEnum):
    """What covers a vertex of the height field: below TREE open ground, from ROOF_TILES on a building.

    TREE is a dome of the height field, LITTER the ground under leaves of a cover, GRASS high grass.
    """

    MEADOW = 0
    CROP = 1
    SOIL = 2
    ROAD = 3
    PAINT = 4
    TREE = 5
    LITTER = 6
    GRASS = 7
    WATER = 8
    ROOF_TILES = 9
    ROOF_SLATE = 10
    ROOF_GRAVEL = 11
    WALL = 12


PALETTE = np.array(
    [
        [0.150, 0.200, 0.065, 1.00],
        [0.250, 0.235, 0.085, 0.85],
        [0.270, 0.190, 0.115, 0.90],
        [0.170, 0.170, 0.175, 0.65],
        [0.600, 0.600, 0.580, 0.45],
        [0.075, 0.125, 0.040, 1.30],
        [0.120, 0.115, 0.065, 1.00],
        [0.165, 0.205, 0.070, 1.25],
        [0.060, 0.075, 0.050, 0.50],
        [0.330, 0.125, 0.075, 0.80],
        [0.130, 0.135, 0.150, 0.80],
        [0.360, 0.350, 0.330, 0.80],
        [0.520, 0.480, 0.400, 0.60],
    ]
)
"""Red, green and blue reflectance of each material, and the contrast of its texture."""

_GRADIENTS = np.array(
    [[1, 1, 0], [-1, 1, 0], [1, -1, 0], [-1, -1, 0], [1, 0, 1], [-1, 0, 1], [1, 0, -1], [-1, 0, -1],
     [0, 1, 1], [0, -1, 1], [0, 1, -1], [0, -1, -1], [1, 1, 0], [-1, 1, 0], [0, -1, 1], [0, -1, -1]],
    dtype=np.float64,
)  # fmt: skip


@njit(cache=True)
def _corner(node: int, x: float, y: float, z: float) -> float:
    node = (node ^ (node >> 15)) * 0x2C1B3C6D
    node = (node ^ ((node >> 12) & 0xFFFFF)) * 0x297A2D39
    g = (node >> 15) & 15
    return float(_GRADIENTS[g, 0] * x + _GRADIENTS[g, 1] * y + _GRADIENTS[g, 2] * z)


@njit(cache=True)
def gradient_noise(seed: int, x: float, y: float, z: float) -> float:
    """Return gradient noise (Perlin 2002), about −1 to 1 with mean 0, at a position in units of the lattice."""
    fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
    i, j, k = int(fx) * 73856093, int(fy) * 19349663, int(fz) * 83492791 + seed * 1013904223
    x, y, z = x - fx, y - fy, z - fz
    i1, j1, k1 = i + 73856093, j + 19349663, k + 83492791
    u = x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
    v = y * y * y * (y * (y * 6.0 - 15.0) + 10.0)
    w = z * z * z * (z * (z * 6.0 - 15.0) + 10.0)
    a, b = _corner(i ^ j ^ k, x, y, z), _corner(i1 ^ j ^ k, x - 1, y, z)
    c, d = _corner(i ^ j1 ^ k, x, y - 1, z), _corner(i1 ^ j1 ^ k, x - 1, y - 1, z)
    low = a + u * (b - a) + v * (c - a + u * (a - b - c + d))
    a, b = _corner(i ^ j ^ k1, x, y, z - 1), _corner(i1 ^ j ^ k1, x - 1, y, z - 1)
    c, d = _corner(i ^ j1 ^ k1, x, y - 1, z - 1), _corner(i1 ^ j1 ^ k1, x - 1, y - 1, z - 1)
    high = a + u * (b - a) + v * (c - a + u * (a - b - c + d))
    return float(low + w * (high - low))


@njit(cache=True, nogil=True)
def _octaves(seed: int, x: FloatArray, y: FloatArray, wavelength: FloatArray, amplitude: FloatArray) -> FloatArray:
    value = np.zeros(len(x))
    for n in range(len(x)):
        for o in range(len(wavelength)):
            s = 1.0 / wavelength[o]
            value[n] += amplitude[o] * gradient_noise(seed + o, x[n] * s, y[n] * s, 0.5)
    return value


def noise(seed: int, xy: FloatArray, wavelength_m: FloatArray, amplitude: FloatArray) -> FloatArray:
    """Return octaves (O,) of gradient noise at positions (N, 2), in units of their amplitudes."""
    x, y = np.ascontiguousarray(xy[:, 0], np.float64), np.ascontiguousarray(xy[:, 1], np.float64)
    return _octaves(seed % 2**31, x, y, wavelength_m, amplitude)


def terrain_height(seed: int, relief_m: float, xy: FloatArray) -> FloatArray:
    """Return the height (N,) of the bare terrain at positions (N, 2) of the world frame, in metres about 0.

    ``relief_m`` is roughly the height from the lowest to the highest place of a site of some 100 m.
    """
    return noise(seed, xy, _TERRAIN_WAVELENGTH_M, relief_m * _TERRAIN_AMPLITUDE)


@dataclass(frozen=True, eq=False)
class Scene:
    """A site: height field, material and light at its vertices. Beyond its edge the height of the edge continues."""

    height_m: Float32Array
    """Heights (R, C) of the vertices at (west_m + c cell_m, south_m + r cell_m)."""
    material: ByteArray
    """Material (R, C)."""
    light: ByteArray
    """255 in sunlight, 0 in cast shadow (R, C)."""
    west_m: float
    """West edge."""
    south_m: float
    """South edge."""
    cell_m: float
    """Distance of vertices."""
    targets: FloatArray
    """Centres of the painted targets (T, 2)."""
    target_radius_m: float
    """Radius of the targets."""
    finest_wavelength_m: float
    """Finest wavelength of the texture."""
    sun: FloatArray
    """Direction to the sun (3,)."""
    seed: int
    """Seed of the texture."""
    contrast: float = 1.0
    """Factor of the texture's contrast: 0.1 for a tenth of what PALETTE says."""
    cover: Cover | None = None
    """What stands on the height field and is none; None: trees are domes of the height field."""

    def height(self, xy: FloatArray) -> FloatArray:
        """Return the height (N,) of the height field at positions (N, 2), bilinear in a cell: of ground, roofs, water
        and domes of trees, without the leaves of a cover."""
        position = (np.asarray(xy, np.float64) - [self.west_m, self.south_m]) / self.cell_m
        height: FloatArray = map_coordinates(
            self.height_m, position.T[::-1], output=np.float64, order=1, mode="nearest", prefilter=False
        )
        return height

    def top(self, xy: FloatArray) -> FloatArray:
        """Return the height (N,) of what is seen from above at positions (N, 2): leaf or height field."""
        height = self.height(xy)
        if self.cover is None:
            return height
        return np.fmax(height, self.cover.height(np.asarray(xy, np.float64)))

    def open_ground(self, xy: FloatArray, reach_m: float) -> BoolArray:
        """Return which positions (N, 2) have neither a building nor a tree within ``reach_m``, and lie on the site."""
        steps = np.arange(-np.ceil(reach_m / self.cell_m), np.ceil(reach_m / self.cell_m) + 1)
        offset = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        offset = offset[np.hypot(*offset.T) * self.cell_m <= reach_m + self.cell_m]
        vertex = np.rint((np.asarray(xy)[:, None] - [self.west_m, self.south_m]) / self.cell_m + offset).astype(int)
        limit = np.array(self.height_m.shape[::-1]) - 1
        inside = np.all((vertex >= 0) & (vertex <= limit), axis=2)
        column, row = np.moveaxis(np.clip(vertex, 0, limit), 2, 0)
        return np.asarray(np.all(inside & (self.material[row, column] < Material.TREE), axis=1))

    @property
    def targets_world_m(self) -> FloatArray:
        """Return the centres (T, 3) of the targets on the surface."""
        return np.column_stack([self.targets, self.height(self.targets)])

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """Return west, south, east and north of the height field."""
        rows, columns = self.height_m.shape
        east, north = self.west_m + (columns - 1) * self.cell_m, self.south_m + (rows - 1) * self.cell_m
        return self.west_m, self.south_m, east, north

    @cached_property
    def block_max(self) -> Float32Array:
        """Return the highest vertex of each block of BLOCK_CELLS cells, its borders included."""
        highest = self.height_m
        for axis in (0, 1):
            blocks = -(-(highest.shape[axis] - 1) // BLOCK_CELLS)
            pad = [(0, 0), (0, 0)]
            pad[axis] = (0, blocks * BLOCK_CELLS + 1 - highest.shape[axis])
            whole = np.moveaxis(np.pad(highest, pad, mode="edge"), axis, 0)
            inner = whole[:-1].reshape(blocks, BLOCK_CELLS, -1).max(axis=1)
            highest = np.moveaxis(np.maximum(inner, whole[BLOCK_CELLS::BLOCK_CELLS]), 0, axis)
        return np.ascontiguousarray(highest)

    @cached_property
    def block_target(self) -> Int32Array:
        """Return the index of the target that reaches into each block, −1 for none. Raises ValueError where two do."""
        result = np.full(self.block_max.shape, -1, np.int32)
        side, reach = BLOCK_CELLS * self.cell_m, RING * self.target_radius_m + self.finest_wavelength_m
        limit = np.array(result.shape[::-1]) - 1
        for index, centre in enumerate(self.targets - [self.west_m, self.south_m]):
            c0, r0 = np.clip(np.floor((centre - reach) / side), 0, limit).astype(int)
            c1, r1 = np.clip(np.floor((centre + reach) / side), 0, limit).astype(int)
            window = result[r0 : r1 + 1, c0 : c1 + 1]
            if np.any(window >= 0):
                raise ValueError(
                    f"targets {window.max()} and {index} are too close: keep {2 * side:.1f} m between them"
                )
            window[:] = index
        return result


@dataclass(frozen=True)
class _Road:
    """A band around b = offset + bend sin(2π a / 150 m), with a along its azimuth and b to the left."""

    angle: float
    offset_m: float
    bend_m: float
    width_m: float

    def along_across(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        c, s = np.cos(self.angle), np.sin(self.angle)
        along, across = xy[..., 0] * c + xy[..., 1] * s, xy[..., 1] * c - xy[..., 0] * s
        return along, across - self.offset_m - self.bend_m * np.sin(2 * np.pi * along / 150.0)


class Builder:
    """The arrays of a scene while it is built, from the ground up."""

    def __init__(self, seed: int, extent_m: float, cell_m: float) -> None:
        n = round(extent_m / cell_m) + 1
        self.axis = (np.arange(n) - (n - 1) / 2) * cell_m
        self.cell_m, self.half_m = cell_m, float(self.axis[-1])
        self.rng = np.random.default_rng([seed, 1])
        self.xy = np.stack(np.meshgrid(self.axis, self.axis), axis=-1)
        self.material = np.zeros((n, n), np.uint8)
        self.height = np.zeros((n, n))
        self.taken: list[tuple[float, float, float]] = []

    def ground(self, seed: int, relief_m: float) -> None:
        """Lay the terrain, its fields and its roads."""
        flat = self.xy.reshape(-1, 2)
        self.height = terrain_height(seed, relief_m, flat).reshape(self.height.shape)
        field = noise(seed + 91, flat, np.array([70.0, 9.0]), np.array([1.0, 0.12])).reshape(self.height.shape)
        self.material[field > 0.22] = Material.CROP
        self.material[field < -0.32] = Material.SOIL
        angle = self.rng.uniform(0.0, np.pi)
        self.roads = (
            _Road(angle + self.rng.uniform(1.2, 1.9), self.rng.uniform(-0.2, 0.2) * self.half_m, 3.0, 1.8),
            _Road(angle, self.rng.uniform(-0.25, 0.25) * self.half_m, 5.0, 5.5),
        )
        for road, material in zip(self.roads, (Material.SOIL, Material.ROAD), strict=True):
            along, across = road.along_across(self.xy)
            self.material[np.abs(across) < road.width_m / 2] = material
        self.material[(np.abs(across) < 0.09) & (np.mod(along, 6.0) < 3.0)] = Material.PAINT

    def window(self, centre: FloatArray, reach_m: float) -> tuple[tuple[slice, slice], FloatArray]:
        """Return rows and columns of the vertices around a place (2,), and where they are."""
        first = np.clip(np.floor((centre - reach_m + self.half_m) / self.cell_m), 0, len(self.axis)).astype(int)
        last = np.clip(np.ceil((centre + reach_m + self.half_m) / self.cell_m) + 1, 0, len(self.axis)).astype(int)
        window = (slice(first[1], last[1]), slice(first[0], last[0]))
        return window, self.xy[window]

    def place(self, reach_m: float, apart_m: float, within_m: float | None = None) -> FloatArray | None:
        """Find a place off the roads and ``apart_m`` from the buildings, at most ``within_m`` from the middle of the
        site to east and north, None when there is none."""
        for _ in range(200):
            centre = self.rng.uniform(-1.0, 1.0, 2) * (self.half_m - reach_m if within_m is None else within_m)
            to_road = min(abs(road.along_across(centre)[1]) - road.width_m / 2 for road in self.roads)
            clear = all(np.hypot(x - centre[0], y - centre[1]) > r + reach_m + apart_m for x, y, r in self.taken)
            if clear and to_road > reach_m:
                return centre
        return None

    def building(self, gabled: bool) -> None:
        """Build a house, where there is room."""
        length, width = self.rng.uniform(9.0, 16.0), self.rng.uniform(7.0, 10.0)
        eaves, rise = self.rng.uniform(3.5, 6.5), self.rng.uniform(2.0, 3.5) if gabled else 0.0
        reach = float(np.hypot(length, width)) / 2
        centre = self.place(reach, 2.0)
        if centre is None:
            return
        angle = self.roads[1].angle + self.rng.integers(2) * np.pi / 2 + self.rng.normal(0.0, 0.05)
        window, xy = self.window(centre, reach)
        c, s = np.cos(angle), np.sin(angle)
        along, across = (xy - centre) @ [c, s], (xy - centre) @ [-s, c]
        inside = (np.abs(along) <= length / 2) & (np.abs(across) <= width / 2)
        base = self.height[window][inside].mean()
        roof = base + eaves + rise * (1 - np.abs(across) / (width / 2))
        chimney = np.hypot(along - length / 4, across - width / 8) < 0.4
        roof = np.where(chimney, base + eaves + rise + 0.8, roof)
        kind = (Material.ROOF_TILES, Material.ROOF_SLATE)[self.rng.integers(2)] if gabled else Material.ROOF_GRAVEL
        self.height[window] = np.where(inside, roof, self.height[window])
        self.material[window] = np.where(inside, kind, self.material[window])
        self.taken.append((float(centre[0]), float(centre[1]), reach))

    def tree(self, seed: int) -> None:
        """Put up a dome of a tree, where there is room."""
        radius = self.rng.uniform(1.2, 3.4)
        tall = radius * self.rng.uniform(1.8, 2.6)
        centre = self.place(radius, 0.0)
        if centre is None:
            return
        window, xy = self.window(centre, radius * 1.3)
        rough = noise(seed, xy.reshape(-1, 2), np.array([1.5, 0.5]), np.array([0.7, 0.6])).reshape(xy.shape[:2])
        distance = np.linalg.norm(xy - centre, axis=-1) / radius + 0.25 * rough
        dome = 0.35 + 0.65 * np.sqrt(np.clip(1 - distance**2, 0.0, 1.0)) + 0.16 * rough
        crown = self.height[window].min() + tall * dome
        inside = (distance < 1.0) & (crown > self.height[window])
        self.height[window] = np.where(inside, crown, self.height[window])
        self.material[window] = np.where(inside, Material.TREE, self.material[window])

    def scene(self, seed: int, finest_wavelength_m: float) -> Scene:
        """Return the scene as it is built, in the light of the sun."""
        azimuth, elevation = np.radians([_SUN_AZIMUTH_DEG, _SUN_ELEVATION_DEG])
        sun = np.array([np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
        height, corner = self.height.astype(np.float32), float(self.axis[0])
        return Scene(
            height, self.material, _light(height, self.cell_m, sun), corner, corner, self.cell_m, np.zeros((0, 2)), 0.0,
            finest_wavelength_m, sun, seed % 2**31,
        )  # fmt: skip


def _light(height_m: Float32Array, cell_m: float, sun: FloatArray) -> ByteArray:
    """Sweep the edge of the shadow from row to row, away from a sun in the south (sun[1] < 0, |sun[0]| ≤ |sun[1]|)."""
    depth_m = np.zeros(height_m.shape)
    column = np.arange(height_m.shape[1], dtype=np.float64)
    towards_sun, drop_m = column + sun[0] / -sun[1], cell_m * sun[2] / -sun[1]
    edge = height_m[0].astype(np.float64)
    for row in range(1, len(height_m)):
        shadow = np.interp(towards_sun, column, edge) - drop_m
        depth_m[row] = shadow - height_m[row]
        edge = np.maximum(shadow, height_m[row])
    light: ByteArray = (255.0 * (1.0 - np.clip(depth_m / 0.2, 0.0, 1.0))).astype(np.uint8)
    return light


def make_scene(
    seed: int,
    extent_m: float,
    cell_m: float,
    relief_m: float,
    buildings: int,
    trees: int,
    *,
    finest_wavelength_m: float = 0.09,
) -> Scene:
    """Make a square site of side ``extent_m`` centred at the origin of the world frame; the same seed, the same site.

    Buildings and trees keep off the roads; where no room is left there are fewer. ``finest_wavelength_m`` is the
    lattice of the finest octave of the texture: below two pixels on the ground it aliases.
    """
    builder = Builder(seed, extent_m, cell_m)
    builder.ground(seed, relief_m)
    for number in range(buildings):
        builder.building(gabled=number % 3 != 2)
    for _ in range(trees):
        builder.tree(seed + 17)
    return builder.scene(seed, finest_wavelength_m)


def target_reach(scene: Scene, radius_m: float) -> float:
    """Return how far, in metres from its centre, a target of ``radius_m`` needs open ground."""
    return 3 * radius_m + 2 * scene.cell_m


def paint_targets(scene: Scene, targets: FloatArray, radius_m: float) -> Scene:
    """Return the scene with targets of ``radius_m``, centred at ``targets`` (T, 2), painted on ground made level.

    Raises ValueError when a target touches a building, a tree or the edge of the site, or when two are too near.
    """
    centres = np.asarray(targets, np.float64).reshape(-1, 2)
    inner, outer = (RING + 0.2) * radius_m + scene.cell_m, target_reach(scene, radius_m)
    closed = np.flatnonzero(~scene.open_ground(centres, outer))
    if len(closed):
        raise ValueError(f"target {closed[0]} at {centres[closed[0]]} does not lie on open ground: move it")
    height, level = scene.height_m.copy(), scene.height(centres)
    for centre, z in zip(centres, level, strict=True):
        place = (centre - [scene.west_m, scene.south_m]) / scene.cell_m
        c0, r0 = np.floor(place - outer / scene.cell_m).astype(int)
        c1, r1 = np.ceil(place + outer / scene.cell_m).astype(int) + 1
        column, row = np.meshgrid(np.arange(c0, c1), np.arange(r0, r1))
        distance = np.hypot(column - place[0], row - place[1]) * scene.cell_m
        weight = np.clip((outer - distance) / (outer - inner), 0.0, 1.0)
        window = height[r0:r1, c0:c1]
        window += (weight * (z - window)).astype(np.float32)
    painted = replace(scene, height_m=height, targets=centres, target_radius_m=radius_m)
    painted.block_target.setflags(write=False)
    return painted


def surface_raster(scene: Scene, frame: LocalFrame, cell_m: float) -> Raster:
    """Return the surface of a scene in the map frame, exact at the centres of the cells; NaN off the site.

    The vertical of the map is a straight line, slightly tilted, in the world frame: the height on it is found by
    fixed-point iteration, each step of which shrinks the error by the tilt times the slope of the surface.
    """
    west, south, east, north = scene.extent_m
    outline = np.array([[x, y, 0.0] for x in (west, east) for y in (south, north)])
    low, high = (f(frame.map_from_world(outline)[:, :2], axis=0) for f in (np.min, np.max))
    first, last = np.ceil(low / cell_m), np.floor(high / cell_m)
    columns, rows = (last - first).astype(int)
    easting = (first[0] + np.arange(columns) + 0.5) * cell_m
    northing = (last[1] - np.arange(rows) - 0.5) * cell_m
    level = np.full(rows * columns, frame.origin_map_m[2])
    foot = np.column_stack([np.tile(easting, rows), np.repeat(northing, columns), level])
    world = frame.world_from_map(foot)
    up = (frame.world_from_map(foot + np.array([0.0, 0.0, 100.0])) - world) / 100.0
    above = np.zeros(len(level))
    for _ in range(3):
        place = world + above[:, None] * up
        above = (scene.top(place[:, :2]) - world[:, 2]) / up[:, 2]
    off = (world[:, 0] < west) | (world[:, 0] > east) | (world[:, 1] < south) | (world[:, 1] > north)
    height = np.where(off, np.nan, level + above).reshape(rows, columns).astype(np.float32)
    return Raster(height, float(first[0] * cell_m), float(last[1] * cell_m), cell_m)
