"""Dense heights as a careful user makes them with OpenCV: StereoSGBM on rectified pairs, fused on a grid of the map.

Pairs: every photograph is joined with its best neighbours, those whose overlap² × base/height is largest among pairs
that overlap by half or more, of base/height 0.1 to 0.45 and axes within 20°. Both photographs of a pair are
undistorted and turned in one step (cv2.initUndistortRectifyMap) so that the base runs along the rows (Fusiello, Trucco
& Verri 2000), whichever way it ran before: cv2.stereoRectify would need a base near the rows or columns. The range of
disparities is that of the tie points of the overlap with a margin.
Heights of a pair's pixels meet in the cells of the grid by median; heights of several pairs by the mean of the largest
group of them that agrees. Nothing of photogram's own matching is used.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import uniform_filter

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IntArray
from photogram.camera import Camera, Pose, image_plane
from photogram.compilation import njit
from photogram.files.photographs.images import read_grey
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid
from photogram.projection import AFFINITY
from photogram.survey import Block, Raster

OVERLAP, BASE_TO_HEIGHT, AXES_DEG = 0.5, (0.1, 0.45), 20.0
OUTLINE_PX = 200  # spacing of the places of a photograph's border that are projected


@dataclass(frozen=True)
class Settings:
    """Of pairs, StereoSGBM and fusion; the defaults are those that did best of the ones tried.

    ``neighbours`` of each photograph; ``block_px``, ``p1`` and ``p2`` (times block²), ``prefilter``, ``uniqueness``,
    ``speckle_px`` and ``speckle_range`` as in OpenCV; ``range_margin`` widens the range of disparities, as a share of
    it; ``agree_gsd`` is how far apart heights of pairs may lie that agree, 0 for their median; ``least_pairs`` that
    must agree; ``fill`` closes cells among enough neighbours by their median.
    """

    neighbours: int = 4
    mode: int = cv2.STEREO_SGBM_MODE_SGBM_3WAY
    block_px: int = 3
    p1: int = 8
    p2: int = 32
    prefilter: int = 63
    uniqueness: int = 10
    left_right_px: int = 1
    speckle_px: int = 100
    speckle_range: int = 1
    range_margin: float = 0.15
    agree_gsd: float = 2.0
    least_pairs: int = 2
    fill: bool = True


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """Two photographs as a camera of focal length ``focal_px`` turned by ``rotation_world_from_rectified`` (3, 3) would
    have taken them from both places, of (width, height) ``size_px``.

    ``centre_px`` (2, 2) are the principal points, those of left and right; the right one is moved so that disparities
    run from 0 to ``disparities``. ``base_m`` is the distance of the places.
    """

    photographs: tuple[int, int]
    rotation_world_from_rectified: FloatArray
    focal_px: float
    centre_px: FloatArray
    size_px: tuple[int, int]
    disparities: int
    base_m: float
    left_world_m: FloatArray

    def matrix(self, side: int) -> FloatArray:
        """Return the calibration matrix (3, 3) of the left (0) or right (1) picture."""
        f, (cx, cy) = self.focal_px, self.centre_px[side]
        return np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])

    def world_m(self, pixel: FloatArray, disparity: FloatArray) -> FloatArray:
        """Return the places (N, 3) that pixels (N, 2) of the left picture with their disparities (N,) show."""
        depth = self.focal_px * self.base_m / (disparity - (self.centre_px[0, 0] - self.centre_px[1, 0]))
        ray = np.column_stack([(pixel - self.centre_px[0]) / self.focal_px, np.ones(len(pixel))])
        return np.asarray((ray * depth[:, None]) @ self.rotation_world_from_rectified.T + self.left_world_m)


def _pose(block: Block, photograph: int) -> Pose:
    pose = block.poses[photograph]
    if pose is None:
        raise ValueError(f"{block.photographs[photograph].name} has no pose")
    return pose


def _camera(block: Block, photograph: int) -> Camera:
    camera = block.cameras[block.photographs[photograph].camera]
    if camera.model != "brown" or camera.radial[3] or camera.parameters[AFFINITY].any():
        raise ValueError(f"camera {camera.name}: initUndistortRectifyMap here takes k1 k2 p1 p2 k3 alone")
    return camera


def _outline(camera: Camera) -> FloatArray:
    """Return ideal coordinates (N, 2) along the border of a photograph."""
    u = np.linspace(0, camera.width_px - 1, camera.width_px // OUTLINE_PX + 2)
    v = np.linspace(0, camera.height_px - 1, camera.height_px // OUTLINE_PX + 2)
    sides = [np.column_stack([u, np.full(len(u), w)]) for w in (0.0, camera.height_px - 1)]
    sides += [np.column_stack([np.full(len(v), w), v]) for w in (0.0, camera.width_px - 1)]
    return image_plane(camera, np.concatenate(sides))


def choose_pairs(block: Block, neighbours: int) -> list[tuple[int, int]]:
    """Return the pairs to match; overlap is the area that the two photographs share on the level of the tie points."""
    oriented = [i for i, pose in enumerate(block.poses) if pose is not None]
    level = float(np.median(block.tie_points.position_world_m[:, 2]))
    ground = {}
    for i in oriented:
        pose, camera = _pose(block, i), _camera(block, i)
        ray = np.column_stack([_outline(camera), np.ones(len(_outline(camera)))]) @ pose.rotation_world_from_camera.T
        place = pose.position_world_m + ray * ((level - pose.position_world_m[2]) / ray[:, 2])[:, None]
        ground[i] = cv2.convexHull(place[:, :2].astype(np.float32))
    gain: dict[tuple[int, int], float] = {}
    for n, i in enumerate(oriented):
        for j in oriented[n + 1 :]:
            a, b = _pose(block, i), _pose(block, j)
            height = (a.position_world_m[2] + b.position_world_m[2]) / 2 - level
            ratio = float(np.linalg.norm(a.position_world_m - b.position_world_m) / height)
            cosine = a.rotation_world_from_camera[:, 2] @ b.rotation_world_from_camera[:, 2]
            if not BASE_TO_HEIGHT[0] <= ratio <= BASE_TO_HEIGHT[1] or cosine < np.cos(np.radians(AXES_DEG)):
                continue
            shared, _ = cv2.intersectConvexConvex(ground[i], ground[j])
            overlap = shared / min(cv2.contourArea(ground[i]), cv2.contourArea(ground[j]))
            if overlap >= OVERLAP:
                gain[i, j] = overlap**2 * ratio
    chosen = set()
    for i in oriented:
        mine = sorted((pair for pair in gain if i in pair), key=lambda pair: -gain[pair])
        chosen.update(mine[:neighbours])
    return sorted(chosen)


def rectify(block: Block, pair: tuple[int, int], range_margin: float) -> RectifiedPair:
    """Return the geometry of a rectified pair; its rows are epipolar lines of the full camera model.

    Raises ValueError where the photographs share no tie points.
    """
    poses, cameras = [_pose(block, i) for i in pair], [_camera(block, i) for i in pair]
    base = poses[1].position_world_m - poses[0].position_world_m
    base_m = float(np.linalg.norm(base))
    x = base / base_m
    axis = poses[0].rotation_world_from_camera[:, 2] + poses[1].rotation_world_from_camera[:, 2]
    y = np.cross(axis, x)
    y /= np.linalg.norm(y)
    rotation = np.column_stack([x, y, np.cross(x, y)])
    focal = float(np.mean([camera.focal_px for camera in cameras]))
    border = []
    for pose, camera in zip(poses, cameras, strict=True):
        ideal = _outline(camera)
        ray = np.column_stack([ideal, np.ones(len(ideal))]) @ (rotation.T @ pose.rotation_world_from_camera).T
        border.append(focal * ray[:, :2] / ray[:, 2:])
    tie = block.tie_points
    seen = np.zeros((2, len(tie)), dtype=bool)
    for side in (0, 1):
        seen[side, tie.point[tie.photograph == pair[side]]] = True
    depth = ((tie.position_world_m[seen.all(axis=0)] - poses[0].position_world_m) @ rotation)[:, 2]
    if len(depth) == 0:
        raise ValueError(f"photographs {pair} share no tie points")
    disparity = focal * base_m / depth
    low, high = disparity.min(), disparity.max()
    margin = range_margin * (high - low) + 4.0
    first = int(np.floor(low - margin))
    count = int(np.ceil((high + margin - first) / 16)) * 16
    left, right = (np.floor([b.min(axis=0), b.max(axis=0)]) for b in border)
    top, bottom = max(left[0, 1], right[0, 1]), min(left[1, 1], right[1, 1])
    # the left picture as far as the right one can hold it, after the columns that StereoSGBM leaves out
    west, east = max(left[0, 0], right[0, 0] + first), min(left[1, 0], right[1, 0] + first + count)
    west -= count
    centre = np.array([[-west, -top], [first - west, -top]])
    size = (int(east - west) + 1, int(bottom - top) + 1)
    return RectifiedPair(pair, rotation, focal, centre, size, count, base_m, poses[0].position_world_m)


def rectified(block: Block, pair: RectifiedPair, side: int, grey: ByteArray) -> tuple[ByteArray, BoolArray]:
    """Return one photograph of a pair rectified, and which of its pixels the photograph holds."""
    photograph = pair.photographs[side]
    camera, pose = _camera(block, photograph), _pose(block, photograph)
    k1, k2, k3 = camera.radial[:3]
    p1, p2 = camera.tangential
    turn = pair.rotation_world_from_rectified.T @ pose.rotation_world_from_camera
    u, v = cv2.initUndistortRectifyMap(
        camera.matrix, np.array([k1, k2, p1, p2, k3]), turn, pair.matrix(side), pair.size_px, cv2.CV_32FC1
    )
    held = (u >= 0) & (v >= 0) & (u <= camera.width_px - 1) & (v <= camera.height_px - 1)
    return cv2.remap(grey, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), held


def _disparity(pair: RectifiedPair, pictures: Sequence[ByteArray], s: Settings) -> FloatArray:
    matcher = cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=pair.disparities, blockSize=s.block_px, P1=s.p1 * s.block_px**2,
        P2=s.p2 * s.block_px**2, disp12MaxDiff=s.left_right_px, preFilterCap=s.prefilter, uniquenessRatio=s.uniqueness,
        speckleWindowSize=s.speckle_px, speckleRange=s.speckle_range, mode=s.mode,
    )  # fmt: skip
    return np.asarray(matcher.compute(*pictures))


MapFromWorld = Callable[[FloatArray], FloatArray]


def map_polynomial(frame: LocalFrame, points_world_m: FloatArray) -> MapFromWorld:
    """Return the map's coordinates of world ones as quadratics, over the extent of points (N, 3): exact to 0.1 mm.

    Projecting every pixel of every pair exactly would take longer than matching. Raises ValueError where it is not.
    """
    low, high = points_world_m.min(axis=0), points_world_m.max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1.0)
    node = np.stack(np.meshgrid(*[np.linspace(-1, 1, 7)] * 3), axis=-1).reshape(-1, 3)

    def terms(p: FloatArray) -> FloatArray:
        x, y, z = p.T
        return np.column_stack([np.ones(len(p)), x, y, z, x * x, x * y, y * y, x * z, y * z])

    exact = frame.map_from_world(middle + node * half)
    offset = exact.mean(axis=0)
    coefficients, *_ = np.linalg.lstsq(terms(node), exact - offset, rcond=None)
    worst = np.abs(terms(node) @ coefficients + offset - exact).max()
    if worst > 1e-4:
        raise ValueError(f"the map is no quadratic of the world over this survey: off by {worst:.4f} m")
    return lambda p: np.asarray(terms((p - middle) / half) @ coefficients + offset)


@njit(cache=True, nogil=True)
def _grouped(cell: IntArray, z: Float32Array, cells: int) -> tuple[IntArray, Float32Array]:
    """Return where the values of each cell begin, of length cells + 1, and the values, sorted within their cell."""
    begin = np.zeros(cells + 1, np.int64)
    for n in range(len(cell)):
        begin[cell[n] + 1] += 1
    for n in range(cells):
        begin[n + 1] += begin[n]
    end, value = begin[:-1].copy(), np.empty(len(cell), np.float32)
    for n in range(len(cell)):
        place = end[cell[n]]
        while place > begin[cell[n]] and value[place - 1] > z[n]:
            value[place] = value[place - 1]
            place -= 1
        value[place] = z[n]
        end[cell[n]] += 1
    return begin, value


@njit(cache=True, nogil=True)
def _medians(begin: IntArray, value: Float32Array, least: int) -> Float32Array:
    """Return the median of each cell's values, NaN where there are fewer than ``least``."""
    result = np.full(len(begin) - 1, np.nan, np.float32)
    for n in range(len(result)):
        count = begin[n + 1] - begin[n]
        if count >= max(least, 1):
            result[n] = (value[begin[n] + (count - 1) // 2] + value[begin[n] + count // 2]) / 2
    return result


@njit(cache=True, nogil=True)
def _modes(begin: IntArray, value: Float32Array, least: int, reach: float) -> Float32Array:
    """Return the mean of the most values of each cell within ``reach`` of each other, NaN for fewer than ``least``; of
    two such groups the tighter."""
    result = np.full(len(begin) - 1, np.nan, np.float32)
    for n in range(len(result)):
        best, width, last = max(least, 1) - 1, np.inf, begin[n]
        for first in range(begin[n], begin[n + 1]):
            while last < begin[n + 1] and value[last] - value[first] <= reach:
                last += 1
            count, spread = last - first, value[last - 1] - value[first]
            if count > best or (count == best >= max(least, 1) and spread < width):
                best, width, total = count, spread, 0.0
                for k in range(first, last):
                    total += value[k] - value[first]
                result[n] = value[first] + total / count
    return result


def _pair_heights(
    block: Block, number: tuple[int, int], read: Callable[[int], ByteArray], grid: MapGrid, to_map: MapFromWorld,
    s: Settings,
) -> tuple[IntArray, Float32Array]:  # fmt: skip
    """Return the cells that a pair gives a height, as row × columns + column, and the heights."""
    pair = rectify(block, number, s.range_margin)
    (left, held), (right, right_held) = (rectified(block, pair, side, read(number[side])) for side in (0, 1))
    raw = _disparity(pair, (left, right), s)
    row, column = np.nonzero(held & (raw >= 0))
    disparity = raw[row, column] / 16.0
    other = np.rint(column - disparity).astype(np.int64)
    keep = (other >= 0) & right_held[row, np.maximum(other, 0)]
    row, column, disparity = row[keep], column[keep], disparity[keep]
    place = to_map(pair.world_m(np.column_stack([column, row]).astype(np.float64), disparity))
    c = np.floor((place[:, 0] - grid.west_map_m) / grid.cell_m).astype(np.int64)
    r = np.floor((grid.north_map_m - place[:, 1]) / grid.cell_m).astype(np.int64)
    inside = (r >= 0) & (c >= 0) & (r < grid.rows) & (c < grid.columns)
    if not inside.any():
        return np.zeros(0, np.int64), np.zeros(0, np.float32)
    r, c, z = r[inside], c[inside], place[inside, 2].astype(np.float32)
    r0, c0, wide = int(r.min()), int(c.min()), int(np.ptp(c)) + 1
    height = _medians(*_grouped((r - r0) * wide + c - c0, z, (int(np.ptp(r)) + 1) * wide), 1)
    found = np.flatnonzero(np.isfinite(height))
    return (found // wide + r0) * grid.columns + found % wide + c0, height[found]


def fill_tiny_holes(height: Float32Array) -> Float32Array:
    """Return heights (rows, columns) whose cells without one have the median of their neighbours, where five do."""
    there = np.isfinite(height)
    enough = ~there & (uniform_filter(there.astype(np.float32), 3) * 9 > 4.5)
    row, column = np.nonzero(enough)
    padded = np.pad(height, 1, constant_values=np.nan)
    around = np.stack([padded[row + i, column + j] for i in range(3) for j in range(3)])
    result = height.copy()
    result[row, column] = np.nanmedian(around, axis=0) if len(row) else []
    return result


def warm_up() -> None:
    """Load what is compiled."""
    begin, value = _grouped(np.zeros(3, np.int64), np.zeros(3, np.float32), 1)
    _medians(begin, value, 1)
    _modes(begin, value, 1, 1.0)


def heights_of_pairs(
    block: Block, grid: MapGrid, gsd_m: float, settings: Settings | None = None, threads: int = 2
) -> Raster:
    """Return heights on a grid from StereoSGBM on rectified pairs of the photographs of an adjusted block."""
    s = settings or Settings()
    cv2.setNumThreads(1)
    pictures: dict[int, ByteArray] = {}

    def read(photograph: int) -> ByteArray:
        if photograph not in pictures:
            path = block.photographs[photograph].path
            if path is None:
                raise ValueError(f"{block.photographs[photograph].name}: the file is not known")
            pictures[photograph] = read_grey(Path(path))
        return pictures[photograph]

    poses = [pose.position_world_m for pose in block.poses if pose is not None]
    to_map = map_polynomial(block.frame, np.concatenate([poses, block.tie_points.position_world_m]))
    pairs = choose_pairs(block, s.neighbours)
    with ThreadPoolExecutor(threads) as pool:
        parts = list(pool.map(lambda pair: _pair_heights(block, pair, read, grid, to_map, s), pairs))
    pictures.clear()
    cell, z = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    begin, value = _grouped(cell, z, grid.rows * grid.columns)
    if s.agree_gsd > 0:
        height = _modes(begin, value, s.least_pairs, s.agree_gsd * gsd_m)
    else:
        height = _medians(begin, value, s.least_pairs)
    height = height.reshape(grid.rows, grid.columns)
    return grid.raster(fill_tiny_holes(height) if s.fill else height)
