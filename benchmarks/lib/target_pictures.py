"""Photographs of targets whose centre is known: every pixel is the mean of many points, seen in perspective.

Nothing here is shared with what measures targets: patterns are black or white at a point, blur, noise and JPEG are
applied to the picture.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from photogram.arrays import FloatArray

FOCAL_PX = 4000.0
FINER = 8
"""Points along the side of a pixel."""
SHAPES = ("checker disc", "checker square", "chequered", "cross", "corner", "circle", "ring", "april", "aruco")


@dataclass(frozen=True, eq=False)
class Picture:
    """A photograph (H, W) uint8 of a target; its centre (2,) px, its width before it was tilted, px."""

    grey: np.ndarray
    centre_px: np.ndarray
    shape: str
    width_px: float
    tilt_deg: float
    blur_px: float
    to_target: np.ndarray
    """Homography (3, 3) from the photograph to the target."""


def texture(rng: np.random.Generator, height: int, width: int, kind: str) -> FloatArray:
    """Return grey values (H, W) of natural ground: gravel, grass, tiles, shadow, cars, manholes or asphalt."""
    noise = rng.normal(size=(height, width)).astype(np.float32)

    def rough(scale: float, spread: float) -> FloatArray:
        blurred = cv2.GaussianBlur(rng.normal(size=(height, width)).astype(np.float32), (0, 0), scale)
        return np.asarray(spread * blurred / blurred.std(), np.float64)

    base = rng.uniform(70, 160)
    v, u = np.mgrid[:height, :width].astype(np.float32)
    turn = rng.uniform(0, np.pi)
    across, along = u * np.cos(turn) + v * np.sin(turn), v * np.cos(turn) - u * np.sin(turn)
    if kind == "asphalt":
        return np.asarray(base + rough(1.0, 4) + rough(12, 5), np.float64)
    if kind == "gravel":
        stones = np.full((height, width), base * 0.6, np.float32)
        for _ in range(int(height * width / rng.uniform(8, 60))):
            axes = rng.uniform(1.0, 5.0) * np.array([1.0, rng.uniform(0.5, 1.0)])
            middle = (rng.uniform(0, width) * 16, rng.uniform(0, height) * 16)
            value = float(base + rng.normal(0, 30))
            box = (middle, (32 * axes[0], 32 * axes[1]), float(rng.uniform(0, 180)))
            points = (
                cv2.boxPoints(box)
                if rng.random() < 0.3
                else cv2.ellipse2Poly(
                    (int(middle[0]), int(middle[1])), (int(16 * axes[0]), int(16 * axes[1])), int(box[2]), 0, 360, 30
                )
            )
            cv2.fillPoly(stones, [np.round(points).astype(np.int32)], value, cv2.LINE_8, 4)
        return np.asarray(cv2.GaussianBlur(stones, (0, 0), rng.uniform(0.5, 1.2)) + rough(1.0, 4), np.float64)
    if kind == "grass":
        blades = cv2.blur(noise, (1, int(rng.integers(3, 9))))
        return np.asarray(base + rng.uniform(10, 25) * blades / blades.std() + rough(6, 12), np.float64)
    if kind == "tiles":
        pitch, depth = rng.uniform(6, 18), rng.uniform(15, 45)
        wave = np.cos(2 * np.pi * across / pitch) + 0.7 * np.sign(
            np.cos(2 * np.pi * along / (pitch * rng.uniform(1, 2)))
        )
        return np.asarray(base + depth * wave + rough(1.0, 5) + rough(8, 6), np.float64)
    if kind == "shadow":
        edge = across - float(rng.uniform(0.2, 0.8)) * width + rough(5, rng.uniform(0, 4))
        other = along - float(rng.uniform(-0.3, 0.7)) * width
        dark = (edge < 0) | ((other < 0) & (rng.random() < 0.5))
        light = cv2.GaussianBlur(np.where(dark, 0.4, 1.0).astype(np.float32), (0, 0), rng.uniform(0.6, 2.5))
        return np.asarray((base + 50 + rough(1.2, 7) + rough(8, 8)) * light, np.float64)
    if kind == "cars":
        ground = np.asarray(base + rough(1.0, 5) + rough(10, 6), np.float32)
        for _ in range(int(rng.integers(1, 4))):
            place, size = rng.uniform(0.1, 0.9, 2) * width, rng.uniform(12, 30)
            angle = float(rng.uniform(0, 180))
            for scale, value in (
                (1.0, rng.uniform(20, 240)),
                (0.55, rng.uniform(10, 200)),
                (0.3, rng.uniform(10, 240)),
            ):
                box = cv2.boxPoints((tuple(place * 16), (16 * size * 2 * scale, 16 * size * scale**0.3), angle))
                cv2.fillPoly(ground, [np.round(box).astype(np.int32)], float(value), cv2.LINE_8, 4)
        return np.asarray(cv2.GaussianBlur(ground, (0, 0), 0.8), np.float64)
    if kind == "planks":
        lines = np.abs(across % rng.uniform(9, 22)) < rng.uniform(1, 2.5)
        joints = np.abs(along % rng.uniform(25, 60)) < 1.5
        dark = np.where(lines | joints, -rng.uniform(20, 60), 0.0).astype(np.float32)
        return np.asarray(base + 20 + cv2.GaussianBlur(dark, (0, 0), 0.8) + rough(1.5, 6) + rough(9, 8), np.float64)
    if kind == "shrubs":
        leaves = rough(rng.uniform(1.2, 3.5), 1.0)
        return np.asarray(base + rng.uniform(25, 50) * np.tanh(1.5 * leaves) + rough(1.0, 6), np.float64)
    raise ValueError(kind)


TEXTURES = ("asphalt", "gravel", "grass", "tiles", "shadow", "cars", "planks", "shrubs")


def _tag(shape: str, number: int) -> np.ndarray:
    """Return the fields of a coded target, with its white rim."""
    name, cells = (cv2.aruco.DICT_APRILTAG_36h11, 8) if shape == "april" else (cv2.aruco.DICT_4X4_50, 6)
    dictionary = cv2.aruco.getPredefinedDictionary(name)
    return np.pad(cv2.aruco.generateImageMarker(dictionary, number, cells), 1, constant_values=255) / 255.0


def pattern(shape: str, x: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return brightness from 0 to 1 of points of a target of half width 1, and which of them belong to it."""
    inverted = rng.random() < 0.5
    if shape.startswith("checker"):
        value = (x * y > 0).astype(np.float32)
        inside = np.hypot(x, y) < 1 if shape.endswith("disc") else np.maximum(abs(x), abs(y)) < 1
    elif shape == "chequered":
        value = ((np.floor(x) + np.floor(y)) % 2).astype(np.float32)
        inside = np.maximum(abs(x), abs(y)) < 2
    elif shape == "cross":
        wide = rng.uniform(0.12, 0.3)
        value = ((abs(x) < wide) | (abs(y) < wide)).astype(np.float32)
        inside = np.maximum(abs(x), abs(y)) < 1
        if inverted:  # painted on the ground, without a board
            inside &= value > 0.5
    elif shape == "corner":
        wide = rng.uniform(0.25, 0.5)
        first, second = (x > 0) & (x < 2) & (y > 0) & (y < wide), (y > 0) & (y < 2) & (x > 0) & (x < wide)
        inside = first | second
        value = np.ones_like(x)
        return (value if not inverted else 1 - value), inside
    elif shape == "circle":
        inside = np.hypot(x, y) < 1
        value = np.ones_like(x)
    elif shape == "ring":
        hole = rng.uniform(0.4, 0.65)
        inside = np.hypot(x, y) < 1
        value = (np.hypot(x, y) > hole).astype(np.float32)
    else:
        bits = _tag(shape, int(rng.integers(0, 50)))
        n = len(bits)
        column, row = ((n * (q + 1) / 2).astype(int) for q in (x, y))
        inside = (column >= 0) & (row >= 0) & (column < n) & (row < n)
        return bits[np.clip(row, 0, n - 1), np.clip(column, 0, n - 1)].astype(np.float32), inside
    return (1 - value if inverted else value), inside


def render(
    rng: np.random.Generator,
    shape: str,
    width_px: float,
    tilt_deg: float,
    blur_px: float,
    ground: str | None = None,
) -> Picture:
    """Return a photograph of a target of a shape, its width before it is tilted, and blurred by a Gaussian."""
    side_px = int(max(64, 34 + (2.6 if shape in ("chequered", "corner") else 1.6) * width_px))
    n = side_px * FINER
    centre = np.array([side_px / 2, side_px / 2]) + rng.uniform(-3, 3, 2)
    turn, direction, tilt = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi), np.deg2rad(tilt_deg)

    def rotation(a: float) -> np.ndarray:
        return np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])

    lean = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    attitude = rotation(direction) @ lean @ rotation(turn)
    distance = FOCAL_PX / (width_px / 2)
    camera = np.array([[FOCAL_PX, 0, centre[0]], [0, FOCAL_PX, centre[1]], [0, 0, 1.0]])
    to_photograph = camera @ np.column_stack([attitude[:, 0], attitude[:, 1], [0, 0, distance]])
    back = np.linalg.inv(to_photograph)
    step = (np.arange(n) + 0.5) / FINER - 0.5
    u, v = np.meshgrid(step, step)
    scale = back[2, 0] * u + back[2, 1] * v + back[2, 2]
    x = ((back[0, 0] * u + back[0, 1] * v + back[0, 2]) / scale).astype(np.float32)
    y = ((back[1, 0] * u + back[1, 1] * v + back[1, 2]) / scale).astype(np.float32)
    value, inside = pattern(shape, x, y, rng)
    # nobody paints on gravel
    is_painted = shape in ("circle", "corner") or (shape == "cross" and float(np.ptp(value[inside])) < 0.5)
    grounds = ["asphalt", "grass", "shadow"] if is_painted else ["asphalt", "gravel", "grass", "shadow"]
    soil = texture(rng, side_px, side_px, ground or str(rng.choice(grounds)))
    soil = cv2.resize(soil.astype(np.float32), (n, n), interpolation=cv2.INTER_CUBIC)
    dark, bright = rng.uniform(20, 55), rng.uniform(180, 235)
    whole = np.where(inside, dark + (bright - dark) * value, soil).astype(np.float32)
    if is_painted:
        ground_grey = float(np.median(soil))
        if value[inside].mean() > 0.5:
            whole = np.where(inside, max(bright, ground_grey + 90), soil)
        else:
            whole = np.where(inside, dark, soil + max(0.0, dark + 90 - ground_grey))
    if blur_px > 0:
        whole = cv2.GaussianBlur(whole.astype(np.float32), (0, 0), blur_px * FINER)
    grey = whole.reshape(side_px, FINER, side_px, FINER).mean(axis=(1, 3))
    return Picture(finish(rng, grey), centre, shape, width_px, tilt_deg, blur_px, back)


def finish(rng: np.random.Generator, grey: np.ndarray) -> np.ndarray:
    """Return grey values as a photograph has them: noise of 2 to 4 DN, and JPEG."""
    noisy = np.clip(np.round(grey + rng.normal(0, rng.uniform(2, 4), grey.shape)), 0, 255).astype(np.uint8)
    _, packed = cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(85, 96))])
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE))


def bare(rng: np.random.Generator, kind: str, side_px: int = 96) -> np.ndarray:
    """Return a photograph of ground without a target."""
    return finish(rng, texture(rng, side_px, side_px, kind))


def crowded(rng: np.random.Generator, kind: str, side_px: int) -> np.ndarray:
    """Return a photograph of ground with a target in each quarter."""
    grey = bare(rng, kind, side_px)
    half = side_px // 2
    for corner in range(4):
        own = render(rng, str(rng.choice(SHAPES)), float(rng.uniform(12, 40)), float(rng.uniform(0, 50)), 0.7).grey
        top, left = (int(rng.integers(0, half - own.shape[0])) + half * n for n in divmod(corner, 2))
        grey[top : top + own.shape[0], left : left + own.shape[1]] = own
    return grey
