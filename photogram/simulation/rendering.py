"""Photographs of a made scene: each pixel's ray, undistorted by the full camera model, meets the height field exactly.

Within a cell the surface is bilinear, so the height of a ray above it is a quadratic of the ray's parameter and its
first root is the hit; blocks of cells that lie below the ray are skipped (Amanatides & Woo 1987, on two levels).
Nothing in here depends on the number of threads.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array
from photogram.camera import Camera, Pose, image_plane, oriented_by
from photogram.compilation import njit
from photogram.machine import cores
from photogram.projection import FOCAL, OrientedCameras, ideal_point, lens_of, without_field
from photogram.simulation.cover.hits import Pieces, first_cover, leaf_hits
from photogram.simulation.cover.leaves import REST
from photogram.simulation.ray_cells import leave_cell, next_cell
from photogram.simulation.scene import BLOCK_CELLS, PALETTE, RING, Material, Scene, gradient_noise

_COARSEST_WAVELENGTH_M = 20.0
_ROWS_PER_TASK = 16
_FINE_OCTAVES = 3
_ROOF, _WALL = int(Material.ROOF_TILES), int(Material.WALL)
_GRASS, _WATER = int(Material.GRASS), int(Material.WATER)
_BLADES_M, _GUST_M = 0.03, 1.7  # how far high grass moves, and over what distance it moves alike
_WAVES_M = np.array([2.3, 0.9, 0.35])
_WAVE_SLOPES = np.array([0.22, 0.32, 0.30])
_WATER_RGB = np.array([0.028, 0.050, 0.042])
_SKY_RGB = np.array([0.55, 0.65, 0.80])
_GLITTER, _GLITTER_SHARPNESS = 40.0, 300.0
_FAR = 1e5
_EXPOSURE_PHASE = 41.7  # lattice planes between the waves of two exposures: they have nothing in common


class _Field(NamedTuple):
    """A scene as the kernels take it; ``floor_m`` lies below and ``ceiling_m`` above everything."""

    height: Float32Array
    material: ByteArray
    light: ByteArray
    block_max: Float32Array
    block_target: Int32Array
    targets: FloatArray
    sun: FloatArray
    west: float
    south: float
    cell: float
    floor_m: float
    ceiling_m: float
    target_radius: float
    finest: float
    octaves: int
    contrast: float
    seed: int


def _field(scene: Scene) -> _Field:
    octaves = 1 + max(0, round(float(np.log2(_COARSEST_WAVELENGTH_M / scene.finest_wavelength_m))))
    floor, ceiling = float(scene.height_m.min()) - 1.0, float(scene.height_m.max()) + 1.0
    return _Field(
        scene.height_m, scene.material, scene.light, scene.block_max, scene.block_target.copy(), scene.targets.copy(),
        scene.sun, scene.west_m, scene.south_m, scene.cell_m, floor, ceiling, scene.target_radius_m,
        scene.finest_wavelength_m, octaves, scene.contrast, scene.seed,
    )  # fmt: skip


@njit(cache=True)
def _first_root(A: float, B: float, C: float) -> float:
    """Return the smallest positive root of A s² + B s + C with C > 0, infinity when there is none."""
    discriminant = B * B - 4.0 * A * C
    if discriminant < 0.0:
        return float(np.inf)
    root = np.sqrt(discriminant)
    if B < 0.0:
        return float(2.0 * C / (root - B))
    return float(-(B + root) / (2.0 * A)) if A < 0.0 else float(np.inf)


@njit(cache=True)
def _hit_in_block(
    height: Float32Array, block: tuple[int, int], o: FloatArray, d: FloatArray, start: float, end: float
) -> float:
    """Return where the ray o + t d (columns, rows, metres) first meets the cells of a block before ``end``, or NaN."""
    rows, columns = height.shape
    first_c, first_r = block[0] * BLOCK_CELLS, block[1] * BLOCK_CELLS
    c = min(max(int(np.floor(o[0] + start * d[0])), first_c), first_c + BLOCK_CELLS - 1)
    r = min(max(int(np.floor(o[1] + start * d[1])), first_r), first_r + BLOCK_CELLS - 1)
    t = start
    while t < end:
        along, up = leave_cell(c, 1, o[0], d[0]), leave_cell(r, 1, o[1], d[1])
        leave = min(along, up, end)
        c0, c1 = min(max(c, 0), columns - 1), min(max(c + 1, 0), columns - 1)
        r0, r1 = min(max(r, 0), rows - 1), min(max(r + 1, 0), rows - 1)
        a, b = np.float64(height[r0, c0]), np.float64(height[r0, c1])
        e, g = np.float64(height[r1, c0]), np.float64(height[r1, c1])
        z = o[2] + t * d[2]
        if min(z, o[2] + leave * d[2]) <= max(a, b, e, g):
            u, v = o[0] + t * d[0] - c, o[1] + t * d[1] - r
            hu, hv, huv = b - a, e - a, a - b - e + g
            above = z - (a + hu * u + hv * v + huv * u * v)
            if above <= 0.0:
                return t
            s = _first_root(-huv * d[0] * d[1], d[2] - hu * d[0] - hv * d[1] - huv * (u * d[1] + v * d[0]), above)
            if t + s <= leave:
                return float(t + s)
        c, r = next_cell(c, r, along, up, d)
        t = max(t, leave)
    return float(np.nan)


@njit(cache=True)
def _first_hit(f: _Field, origin: FloatArray, direction: FloatArray, end: float) -> float:
    """Return the parameter of the first hit of the ray origin + t direction (world, m) before ``end``, NaN for none."""
    o = np.array([(origin[0] - f.west) / f.cell, (origin[1] - f.south) / f.cell, origin[2]])
    d = np.array([direction[0] / f.cell, direction[1] / f.cell, direction[2]])
    t = 0.0
    if o[2] > f.ceiling_m:
        if d[2] >= 0.0:
            return float(np.nan)
        t = (f.ceiling_m - o[2]) / d[2]
    if d[2] < 0.0:
        end = min(end, (f.floor_m - o[2]) / d[2])
    elif d[2] > 0.0:
        end = min(end, (f.ceiling_m - o[2]) / d[2])
    rows, columns = f.block_max.shape
    c, r = int(np.floor((o[0] + t * d[0]) / BLOCK_CELLS)), int(np.floor((o[1] + t * d[1]) / BLOCK_CELLS))
    while t < end:
        along, up = leave_cell(c, BLOCK_CELLS, o[0], d[0]), leave_cell(r, BLOCK_CELLS, o[1], d[1])
        leave = min(along, up, end)
        highest = f.block_max[min(max(r, 0), rows - 1), min(max(c, 0), columns - 1)]
        if min(o[2] + t * d[2], o[2] + leave * d[2]) <= highest:
            hit = _hit_in_block(f.height, (c, r), o, d, t, leave)
            if not np.isnan(hit):
                return float(hit)
        c, r = next_cell(c, r, along, up, d)
        t = max(t, leave)
    return float(np.nan)


@njit(cache=True, nogil=True)
def _hit_all(f: _Field, origin: FloatArray, direction: FloatArray, end: float) -> FloatArray:
    t = np.empty(len(direction))
    for i in range(len(direction)):
        t[i] = _first_hit(f, origin, direction[i], end)
    return t


@njit(cache=True)
def _paint_target(f: _Field, x: float, y: float, footprint: float, rgb: FloatArray) -> None:
    """Paint a quartered disc with a light ring over ``rgb``, its edges as soft as a pixel's footprint (m)."""
    rows, columns = f.block_target.shape
    side = BLOCK_CELLS * f.cell
    r, c = int(np.floor((y - f.south) / side)), int(np.floor((x - f.west) / side))
    if r < 0 or c < 0 or r >= rows or c >= columns or f.block_target[r, c] < 0:
        return
    target = f.block_target[r, c]
    dx, dy = x - f.targets[target, 0], y - f.targets[target, 1]
    distance = np.sqrt(dx * dx + dy * dy)
    ring = min(max((RING * f.target_radius - distance) / footprint + 0.5, 0.0), 1.0)
    disc = min(max((f.target_radius - distance) / footprint + 0.5, 0.0), 1.0)
    sign = min(max(2.0 * dx / footprint, -1.0), 1.0) * min(max(2.0 * dy / footprint, -1.0), 1.0)
    quarters = 0.36 + 0.33 * sign
    for k in range(3):
        rgb[k] += ring * (0.50 - rgb[k])
        rgb[k] += disc * (quarters - rgb[k])


@njit(cache=True)
def _colour(f: _Field, x: float, y: float, z: float, footprint: float, rgb: FloatArray) -> None:
    """Fill ``rgb`` with the light that a place of the surface sends to the camera, 1 for white in full sun."""
    rows, columns = f.height.shape
    px, py = (x - f.west) / f.cell, (y - f.south) / f.cell
    c, r = min(max(int(np.floor(px)), 0), columns - 2), min(max(int(np.floor(py)), 0), rows - 2)
    u, v = min(max(px - c, 0.0), 1.0), min(max(py - r, 0.0), 1.0)
    contrast, light, roof = 0.0, 0.0, False
    for n in range(3):
        rgb[n] = 0.0
    for k in range(4):
        row, column = r + k // 2, c + k % 2
        w = (u if k % 2 else 1.0 - u) * (v if k // 2 else 1.0 - v)
        m = f.material[row, column]
        roof = roof or m >= _ROOF
        light += w * f.light[row, column] / 255.0
        contrast += w * PALETTE[m, 3]
        for n in range(3):
            rgb[n] += w * PALETTE[m, n]
    h00, h01 = np.float64(f.height[r, c]), np.float64(f.height[r, c + 1])
    h10, h11 = np.float64(f.height[r + 1, c]), np.float64(f.height[r + 1, c + 1])
    if roof and max(h00, h01, h10, h11) - min(h00, h01, h10, h11) > 1.0:
        contrast = PALETTE[_WALL, 3]
        for n in range(3):
            rgb[n] = PALETTE[_WALL, n]
    contrast *= f.contrast
    grain = hue = 0.0
    wavelength = f.finest
    for octave in range(f.octaves):
        s = 1.0 / wavelength
        value = gradient_noise(f.seed + octave, x * s, y * s, z * s)
        grain += value * (1.6 if octave < _FINE_OCTAVES else 1.0)
        if octave >= f.octaves - 3:
            hue += value
        wavelength *= 2.0
    grain = np.exp(0.36 * contrast * grain)
    rgb[0] *= grain * (1.0 + 0.18 * contrast * hue)
    rgb[1] *= grain
    rgb[2] *= grain * (1.0 - 0.15 * contrast * hue)
    _paint_target(f, x, y, footprint, rgb)
    gx = ((1 - v) * (h01 - h00) + v * (h11 - h10)) / f.cell
    gy = ((1 - u) * (h10 - h00) + u * (h11 - h01)) / f.cell
    facing = (f.sun[2] - gx * f.sun[0] - gy * f.sun[1]) / np.sqrt(1.0 + gx * gx + gy * gy)
    shade = 0.34 + 0.86 * max(facing, 0.0) * light
    for k in range(3):
        rgb[k] *= shade
    rgb[2] *= 1.0 + 0.12 * (1.0 - light)


@njit(cache=True)
def _wave(seed: int, wavelength: FloatArray, amplitude: FloatArray, x: float, y: float, exposure: int) -> float:
    value = 0.0
    for o in range(len(wavelength)):
        s = 1.0 / wavelength[o]
        value += amplitude[o] * gradient_noise(seed + o, x * s, y * s, _EXPOSURE_PHASE * exposure + 0.5)
    return value


@njit(cache=True)
def _water_colour(f: _Field, x: float, y: float, d: FloatArray, exposure: int, rgb: FloatArray) -> None:
    """Fill ``rgb`` with what water sends along a ray d: its own colour, the sky and the sun in its waves (Fresnel by
    Schlick 1994)."""
    a = _wave(f.seed + 301, _WAVES_M, _WAVE_SLOPES, x, y, exposure)
    b = _wave(f.seed + 401, _WAVES_M, _WAVE_SLOPES, x, y, exposure)
    n, length = 1.0 / np.sqrt(1.0 + a * a + b * b), np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    facing = min(max((a * d[0] + b * d[1] - d[2]) * n / length, 0.0), 1.0)
    mirror = 0.02 + 0.98 * (1.0 - facing) ** 5
    r0, r1 = d[0] / length - 2.0 * facing * a * n, d[1] / length - 2.0 * facing * b * n
    r2 = d[2] / length + 2.0 * facing * n
    towards = max(r0 * f.sun[0] + r1 * f.sun[1] + r2 * f.sun[2], 0.0)
    sun = _GLITTER * towards**_GLITTER_SHARPNESS
    sky = 1.3 - 0.6 * max(r2, 0.0)
    body = 1.0 + 2.0 * (a * f.sun[0] + b * f.sun[1])
    for k in range(3):
        rgb[k] = _WATER_RGB[k] * max(body, 0.2) + mirror * (_SKY_RGB[k] * sky) + sun * mirror


@njit(cache=True)
def _all_of(f: _Field, x: float, y: float) -> int:
    """Return the material of a place whose four vertices are alike, −1 where they are not."""
    rows, columns = f.height.shape
    c = min(max(int(np.floor((x - f.west) / f.cell)), 0), columns - 2)
    r = min(max(int(np.floor((y - f.south) / f.cell)), 0), rows - 2)
    m = f.material[r, c]
    alike = f.material[r, c + 1] == m and f.material[r + 1, c] == m and f.material[r + 1, c + 1] == m
    return int(m) if alike else -1


@njit(cache=True)
def _moving_colour(
    f: _Field, x: float, y: float, z: float, d: FloatArray, footprint: float, exposure: int, rgb: FloatArray
) -> None:
    """Fill ``rgb`` as _colour does, with water and high grass as they move: blades move to one side as a gust has it,
    and take the texture along."""
    material = _all_of(f, x, y)
    if material == _WATER:
        _water_colour(f, x, y, d, exposure, rgb)
        return
    if material == _GRASS and exposure >= 0:
        plane = _EXPOSURE_PHASE * exposure + 0.5
        gust_x = gradient_noise(f.seed + 501, x / _GUST_M, y / _GUST_M, plane)
        gust_y = gradient_noise(f.seed + 502, x / _GUST_M, y / _GUST_M, plane)
        x += _BLADES_M * min(max(2.0 * gust_x, -1.0), 1.0)
        y += _BLADES_M * min(max(2.0 * gust_y, -1.0), 1.0)
    _colour(f, x, y, z, footprint, rgb)


@njit(cache=True)
def _covered_colour(
    f: _Field, p: Pieces, colours: tuple[FloatArray, FloatArray], C: FloatArray, d: FloatArray, parts: FloatArray,
    pixel: float, exposure: int, rgb: FloatArray,
) -> None:  # fmt: skip
    """Fill ``rgb`` with what a pixel sees: what lies on its ray d, ``pixel`` wide at t = 1, behind the leaves and lines
    on the rays ``parts`` (K, 3) of its parts."""
    hit, leaf = np.empty(len(parts)), np.empty(len(parts), np.int64)
    share, line_t, line = np.empty(len(parts)), np.empty(len(parts)), np.empty(len(parts), np.int64)
    farthest = 0.0
    for k in range(len(parts)):
        hit[k], leaf[k], share[k], line_t[k], line[k] = first_cover(p, C, parts[k], _FAR, pixel / 2.0, False)
        farthest = max(farthest, min(hit[k], _FAR))
    t = _first_hit(f, C, d, farthest)
    end = _FAR if np.isnan(t) else t
    open_parts = 0
    for k in range(len(parts)):
        open_parts += leaf[k] < 0 or hit[k] >= end
    if np.isnan(t):
        rgb[:] = _SKY_RGB
    elif open_parts > 0:
        _moving_colour(f, C[0] + t * d[0], C[1] + t * d[1], C[2] + t * d[2], d, t * pixel, exposure, rgb)
    weight = 1.0 / len(parts)
    b0, b1, b2 = rgb
    rgb[:] = 0.0
    for k in range(len(parts)):
        c0, c1, c2, stop = b0, b1, b2, end
        if leaf[k] >= 0 and hit[k] < end:
            (c0, c1, c2), stop = colours[0][leaf[k]], hit[k]
        if line[k] >= 0 and line_t[k] < stop:
            c = colours[1][line[k]]
            c0, c1, c2 = c0 + share[k] * (c[0] - c0), c1 + share[k] * (c[1] - c1), c2 + share[k] * (c[2] - c2)
        rgb[0], rgb[1], rgb[2] = rgb[0] + weight * c0, rgb[1] + weight * c1, rgb[2] + weight * c2


@njit(cache=True, nogil=True)
def _render_covered_rows(
    f: _Field,
    p: Pieces,
    colours: tuple[FloatArray, FloatArray],
    cameras: OrientedCameras,
    readout: FloatArray,
    first: int,
    height_px: int,
    vignetting: float,
    exposure: int,
    out: Float32Array,
) -> None:
    """Fill rows as _render_rows does, with cover: where leaves or lines may be, a pixel has four rays for them."""
    rgb, d, parts = np.empty(3), np.empty(3), np.empty((4, 3))
    R, middle, model = cameras.rotation, cameras.position[0], cameras.model[0]
    q = lens_of(cameras.parameters, 0)
    for row in range(out.shape[0]):
        C = middle + ((first + row) / (height_px - 1.0) - 0.5) * readout
        for column in range(out.shape[1]):
            x, y = without_field(cameras, 0, column, first + row)
            x, y = ideal_point(model, q, x, y)
            for k in range(3):
                d[k] = R[0, k, 0] * x + R[0, k, 1] * y + R[0, k, 2]
            if first_cover(p, C, d, _FAR, 0.0, True)[1] < 0:
                t = _first_hit(f, C, d, _FAR)
                if np.isnan(t):
                    rgb[:] = _SKY_RGB
                else:
                    foot = t / q[FOCAL]
                    _moving_colour(f, C[0] + t * d[0], C[1] + t * d[1], C[2] + t * d[2], d, foot, exposure, rgb)
            else:
                for part in range(4):
                    u, v = column + 0.5 * (part % 2) - 0.25, first + row + 0.5 * (part // 2) - 0.25
                    u, v = without_field(cameras, 0, u, v)
                    u, v = ideal_point(model, q, u, v)
                    for k in range(3):
                        parts[part, k] = R[0, k, 0] * u + R[0, k, 1] * v + R[0, k, 2]
                _covered_colour(f, p, colours, C, d, parts, 1.0 / q[FOCAL], exposure, rgb)
            falloff = 1.0 - vignetting * (x * x + y * y)
            for k in range(3):
                out[row, column, k] = 255.0 * np.sqrt(max(rgb[k] * falloff, 0.0))


@njit(cache=True, nogil=True)
def _render_rows(
    f: _Field,
    cameras: OrientedCameras,
    readout: FloatArray,
    first: int,
    height_px: int,
    vignetting: float,
    out: Float32Array,
) -> None:
    """Fill rows of a photograph, the only one of ``cameras``, from row ``first`` on, with digital numbers; where a ray
    meets nothing it sees sky."""
    rgb, d = np.empty(3), np.empty(3)
    R, middle, model = cameras.rotation, cameras.position[0], cameras.model[0]
    q = lens_of(cameras.parameters, 0)
    for row in range(out.shape[0]):
        C = middle + ((first + row) / (height_px - 1.0) - 0.5) * readout
        for column in range(out.shape[1]):
            x, y = without_field(cameras, 0, column, first + row)
            x, y = ideal_point(model, q, x, y)
            for k in range(3):
                d[k] = R[0, k, 0] * x + R[0, k, 1] * y + R[0, k, 2]
            t = _first_hit(f, C, d, 1e5)
            if np.isnan(t):
                rgb[0], rgb[1], rgb[2] = 0.55, 0.65, 0.80
            else:
                _colour(f, C[0] + t * d[0], C[1] + t * d[1], C[2] + t * d[2], t / q[FOCAL], rgb)
            falloff = 1.0 - vignetting * (x * x + y * y)
            for k in range(3):
                out[row, column, k] = 255.0 * np.sqrt(max(rgb[k] * falloff, 0.0))


def render(
    scene: Scene,
    camera: Camera,
    pose: Pose,
    *,
    seed: int,
    noise_dn: float = 2.0,
    blur_px: float = 0.45,
    vignetting: float = 0.5,
    threads: int | None = None,
    exposure: int = REST,
) -> ByteArray:
    """Take a photograph of a scene: (height_px, width_px, 3) uint8 red, green, blue.

    ``noise_dn`` is the standard deviation of the sensor's noise in digital numbers, ``blur_px`` that of the lens's
    point spread, ``vignetting`` the loss of light at 45° off the axis; with the read-out time of the camera
    the projection centre moves on from row to row at the velocity of the pose; ``threads`` (default one per
    processor) do not change the result; ``exposure`` is the number by which what moves in a scene with cover has moved.
    Raises ImageError where the camera's distortion cannot be undone within the photograph.
    """
    corners = np.array([[u, v] for u in (0.0, camera.width_px - 1.0) for v in (0.0, camera.height_px - 1.0)])
    image_plane(camera, corners)
    field, one = _field(scene), oriented_by([camera], np.zeros(1, dtype=np.int64), [pose])
    readout = camera.readout_s * pose.velocity_world_m_s
    picture = np.empty((camera.height_px, camera.width_px, 3), np.float32)
    fill: Callable[[int, Float32Array], None]
    if scene.cover is None:

        def fill(row: int, out: Float32Array) -> None:
            _render_rows(field, one, readout, row, camera.height_px, vignetting, out)

    else:
        pieces, colours = scene.cover.pieces(exposure), (scene.cover.leaves.rgb, scene.cover.lines.rgb)

        def fill(row: int, out: Float32Array) -> None:
            _render_covered_rows(field, pieces, colours, one, readout, row, camera.height_px, vignetting, exposure, out)

    with ThreadPoolExecutor(threads or cores()) as pool:
        tasks = [
            pool.submit(fill, row, picture[row : row + _ROWS_PER_TASK])
            for row in range(0, camera.height_px, _ROWS_PER_TASK)
        ]
        for task in tasks:
            task.result()
    if blur_px > 0:
        picture = gaussian_filter(picture, (blur_px, blur_px, 0))
    if noise_dn > 0:
        picture += noise_dn * np.random.default_rng(seed).standard_normal(picture.shape, dtype=np.float32)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def _first_met(scene: Scene, origin: FloatArray, direction: FloatArray, end: float, exposure: int) -> FloatArray:
    """Return where rays (N, 3) from one place (3,) first meet ground or leaves before ``end``, NaN for none."""
    origin, direction = np.ascontiguousarray(origin, np.float64), np.ascontiguousarray(direction, np.float64)
    t = _hit_all(_field(scene), origin, direction, end)
    if scene.cover is None:
        return t
    pieces = scene.cover.at_rest if exposure == REST else scene.cover.pieces(exposure)
    leaf = leaf_hits(pieces, np.tile(origin, (len(direction), 1)), direction, end)
    return np.where(np.isfinite(leaf), np.fmin(leaf, t), t)


def intersect(scene: Scene, camera: Camera, pose: Pose, pixels: FloatArray, *, exposure: int = REST) -> FloatArray:
    """Return the places (N, 3), world frame, that pixels (N, 2) of a photograph show, exactly; NaN for the sky.

    Wires and fences are left out; leaves are where they are at the exposure.
    """
    ideal = image_plane(camera, np.asarray(pixels, np.float64))
    direction = np.column_stack([ideal, np.ones(len(ideal))]) @ pose.rotation_world_from_camera.T
    t = _first_met(scene, pose.position_world_m, direction, 1e5, exposure)
    return np.asarray(pose.position_world_m + t[:, None] * direction)


def visible(scene: Scene, pose: Pose, points_world_m: FloatArray, *, tolerance_m: float = 0.05) -> BoolArray:
    """Return which points (N, 3) of the world frame are not hidden by the scene from a projection centre.

    A point up to ``tolerance_m`` below the surface, along the ray, counts as visible; leaves are where they are at
    rest, wires hide nothing. Whether it lies in the photograph, and in front of it, is another question.
    """
    ray = points_world_m - pose.position_world_m
    t = _first_met(scene, pose.position_world_m, ray, 1.0, REST)
    hidden_m = (1.0 - t) * np.linalg.norm(ray, axis=1)
    return np.asarray(~(hidden_m > tolerance_m))
