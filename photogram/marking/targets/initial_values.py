"""Rough places and shapes of what may be targets, from which they are fitted.

Crossings of edges are saddles of the blurred grey values: the determinant of the Hessian is negative, and the
directions in which the second derivative vanishes are those of the edges (Lucchese & Mitra 2002). Other targets are
regions brighter or darker than their surroundings; second moments give their affine shape but for a rotation (Hu 1962;
affine normalisation, Rothe, Süsse & Voss 1996), which is tried out.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations, product

import cv2
import numpy as np

from photogram.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray, nmad
from photogram.marking.targets.picture import (
    BLUR,
    COUNT,
    CX,
    CY,
    FREE,
    OUTSIDE,
    SECOND,
    SHAPE,
    Pattern,
    level_shares,
)
from photogram.marking.targets.scoring import score_all

FINE_COARSE_PX = (1.0, 5.0)
"""Between which blurs a texture is taken."""
SCALES_PX = (1.0, 1.7, 3.0, 5.0)
"""Blurs under which saddles are looked for."""
CIRCLE_PX = 3.0
"""Radius of the circle around a saddle that must look the same after half a turn."""
MOST_ASYMMETRY = 0.4
"""How much it may differ."""
LEAST_LEAN = 0.25
"""Sine of the angle between the edges of a saddle, at least."""
RADII_PX = (3.2, 4.5, 6.5, 9.5, 14.0, 20.0, 29.0, 42.0)
"""Half widths that are tried for saddles."""
OVER_TEXTURE = 3.0
"""How many times the scatter of the texture of its patch a region differs from what lies around it."""
CLEARER = 1.7
"""How many times that is where no rough place is known."""
BAR_SHAPES = (0.08, 0.12, 0.17, 0.24, 0.33, 0.45)
"""Proportions of bars that are tried."""
OPEN_PART = 0.85
"""How much of the length of its bars is fitted of a cross that may end with its board."""
SMALLEST_PX = 4.0
LARGEST_PX = 130.0
_AROUND = np.ones((5, 5), np.uint8)
LEAST_CONTRAST_DN = 12.0


_LEVELS = {pattern: free[(free >= OUTSIDE) & (free <= SECOND)] for pattern, free in FREE.items()}


EXPLAINING = {pattern: 10.0 if pattern == Pattern.FIELDS else 4.0 for pattern in Pattern}
"""Power of the explained share that promises: fields that go on must not reach beyond their neighbours."""


@dataclass(frozen=True, eq=False)
class InitialValues:
    """A pattern and its rough parameters."""

    pattern: Pattern
    theta: FloatArray
    """Parameters (COUNT,) as of picture."""
    reach: float
    """Where an open pattern ends."""
    promise: float
    """How promising it is: the more, the more it explains, and the larger it is."""
    explained: float
    """Share of the squares that it explains."""


def parameters(centre: FloatArray, A: FloatArray, blur: float, shape: float = 0.5) -> FloatArray:
    """Return parameters (COUNT,) without levels."""
    theta = np.zeros(COUNT)
    theta[CX], theta[CY] = centre
    theta[2:6] = A.ravel()
    theta[BLUR], theta[SHAPE] = blur, shape
    return theta


@dataclass(frozen=True, eq=False)
class Scored:
    """Parameters (M, COUNT) with the levels that fit a patch, and how well each does."""

    pattern: Pattern
    thetas: FloatArray
    reach: float
    promise: FloatArray
    """How promising each is (M,); 0 where it is no picture of the patch at all."""
    explained: FloatArray
    """Share of the squares (M,) that it explains."""

    def best(self, least: float, most: int = 1) -> list[int]:
        """Return the numbers of the most promising, of those that explain more than ``least``."""
        order = np.argsort(-self.promise, kind="stable")
        return [int(i) for i in order[(self.explained[order] > least) & (self.promise[order] > 0.0)][:most]]

    def one(self, number: int) -> InitialValues:
        """Return one of them as a start."""
        return InitialValues(
            self.pattern,
            self.thetas[number].copy(),
            self.reach,
            float(self.promise[number]),
            float(self.explained[number]),
        )

    def most_promising(self, least: float, most: int = 1) -> list[InitialValues]:
        """Return the most promising."""
        return [self.one(number) for number in self.best(least, most)]


def scored(grey: FloatArray, pattern: Pattern, thetas: Sequence[FloatArray] | FloatArray, reach: float = 1.0) -> Scored:
    """Return parameters (COUNT,) with the levels that fit a patch (H, W)."""
    filled = np.array(thetas, dtype=np.float64).reshape(-1, COUNT)
    verdict = np.zeros((len(filled), 3))
    score_all(int(pattern), filled, _LEVELS[pattern], grey, reach, verdict)
    thinning, left, total = verdict.T
    explained = np.where(thinning > 0.0, np.maximum(1.0 - left / np.maximum(total, 1e-9), 0.0), 0.0)
    promise = thinning * np.sqrt(np.maximum(total, 0.0)) * explained ** EXPLAINING[pattern]
    return Scored(pattern, filled, reach, promise, explained)


def texture(grey: FloatArray) -> FloatArray:
    """Return a patch (H, W) of grey values without what is finer or coarser than what could pass for a target."""
    fine, coarse = (cv2.GaussianBlur(grey, (0, 0), sigma) for sigma in FINE_COARSE_PX)
    return np.asarray(fine - coarse, np.float64)


def second_derivatives(smooth: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the second derivatives of smooth grey values (H, W): twice by column, twice by row, and by both."""
    twice = np.array([[1.0, -2.0, 1.0]])
    mixed = 0.25 * np.array([[1.0, 0.0, -1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 1.0]])
    lxx, lyy, lxy = (cv2.filter2D(smooth, cv2.CV_64F, kernel) for kernel in (twice, twice.T, mixed))
    return lxx, lyy, lxy


def saddles(
    grey: FloatArray, most: int, near: FloatArray | None = None, reach_px: float = np.inf
) -> list[tuple[FloatArray, FloatArray]]:
    """Return centre (2,) px and the unit normals (2, 2) of both edges of the strongest saddles of a patch (H, W), of
    those that lie at most ``reach_px`` from ``near`` (2,) where it is given."""
    rows: list[tuple[float, FloatArray, FloatArray]] = []
    least = 0.12 * max(LEAST_CONTRAST_DN, OVER_TEXTURE * nmad(texture(grey)))
    smooth = cv2.GaussianBlur(grey, (0, 0), 0.7).astype(np.float32)
    for scale in SCALES_PX:
        L = cv2.GaussianBlur(grey, (0, 0), scale)
        lxx, lyy, lxy = second_derivatives(L)
        strength = np.sqrt(np.maximum(lxy**2 - lxx * lyy, 0.0)) * scale**2
        size = 2 * round(1.2 * scale) + 1
        top = (strength >= cv2.dilate(strength, np.ones((size, size)))) & (strength > least)
        top[:2] = False
        top[-2:] = False
        top[:, :2] = False
        top[:, -2:] = False
        v, u = np.nonzero(top)
        if near is not None:
            v, u = (index[np.hypot(u - near[0], v - near[1]) <= reach_px] for index in (v, u))
        hessian = np.stack([lxx[v, u], lxy[v, u], lxy[v, u], lyy[v, u]], axis=1).reshape(-1, 2, 2)
        centre = np.column_stack([u, v]) + _level_place(L, u, v, hessian)
        normals = _edge_normals(hessian)
        good = (np.abs(np.linalg.det(normals)) > LEAST_LEAN) & (_asymmetry(smooth, centre) < MOST_ASYMMETRY)
        rows += [(float(strength[v[i], u[i]]), centre[i], normals[i]) for i in np.flatnonzero(good)]
    if near is not None:  # the nearest of many, where it is as clear as they are
        rows = [(s * math.exp(-5.0 * float(((c - near) ** 2).sum()) / reach_px**2), c, n) for s, c, n in rows]
    rows.sort(key=lambda row: -row[0])
    kept: list[tuple[FloatArray, FloatArray]] = []
    for _, centre, normals in rows:
        if not any(_is_same_saddle(centre, normals, *other) for other in kept):
            kept.append((centre, normals))
        if len(kept) == most:
            break
    return kept


def _level_place(smooth: FloatArray, u: IntArray, v: IntArray, hessian: FloatArray) -> FloatArray:
    """Return where (K, 2), from the pixels at columns and rows (K,), the gradient of smooth grey values (H, W) vanishes
    by their Hessians (K, 2, 2), at most a pixel off: of small fields a start that is half a pixel off shows little."""
    slope = 0.5 * np.stack([smooth[v, u + 1] - smooth[v, u - 1], smooth[v + 1, u] - smooth[v - 1, u]], axis=1)
    determinant = np.minimum(np.linalg.det(hessian), -1e-12)
    across = np.stack(
        [
            hessian[:, 1, 1] * slope[:, 0] - hessian[:, 0, 1] * slope[:, 1],
            hessian[:, 0, 0] * slope[:, 1] - hessian[:, 0, 1] * slope[:, 0],
        ],
        axis=1,
    )
    return np.asarray(np.clip(-across / determinant[:, None], -1.0, 1.0), np.float64)


def _edge_normals(hessian: FloatArray) -> FloatArray:
    """Return the unit normals (K, 2, 2) of both edges of saddles from their Hessians (K, 2, 2): along an edge the
    second derivative vanishes, where cos² of the angle to the larger eigenvector is −λ₁ / (λ₂ − λ₁)."""
    value, vector = np.linalg.eigh(hessian)
    share = np.clip(-value[:, 0] / np.maximum(value[:, 1] - value[:, 0], 1e-12), 0.0, 1.0)
    large, small = np.sqrt(share)[:, None] * vector[:, :, 1], np.sqrt(1.0 - share)[:, None] * vector[:, :, 0]
    edges = np.stack([large + small, large - small], axis=1)
    return np.stack([-edges[:, :, 1], edges[:, :, 0]], axis=2)


def _asymmetry(smooth: Float32Array, centre: FloatArray) -> FloatArray:
    """Return how much a circle around each centre (K, 2) differs from itself turned by half a turn, over its scatter
    (K,): 0 for the crossing of two straight edges, 1 for ground."""
    angle = np.arange(16) * np.pi / 8
    u, v = centre[:, :1] + CIRCLE_PX * np.cos(angle), centre[:, 1:] + CIRCLE_PX * np.sin(angle)
    if not len(centre):
        return np.zeros(0)
    ring = np.concatenate(
        [
            cv2.remap(
                smooth,
                u[i : i + 30_000].astype(np.float32),
                v[i : i + 30_000].astype(np.float32),
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )
            for i in range(0, len(centre), 30_000)
        ]
    )
    off = ((ring - np.roll(ring, 8, axis=1)) ** 2).mean(axis=1)
    return np.asarray(off / np.maximum(2.0 * ring.var(axis=1), 1e-9), np.float64)


def _is_same_saddle(centre: FloatArray, normals: FloatArray, other: FloatArray, others: FloatArray) -> bool:
    if abs(centre[0] - other[0]) + abs(centre[1] - other[1]) > 2.0:
        return False
    return bool(np.abs(normals @ others.T).max(axis=1).min() > 0.95)


def saddle_initial_values(
    grey: FloatArray, centre: FloatArray, normals: FloatArray, blurs: tuple[float, ...]
) -> list[InitialValues]:
    """Return the best start of each pattern that has a saddle at its centre."""
    lean = abs(float(np.linalg.det(normals)))

    def tried(ratios: tuple[float, ...]) -> list[FloatArray]:
        thetas = []
        for blur, radius, ratio in product(blurs, RADII_PX, ratios):
            # half widths along the edges are 1 / (A u): where edges lean, normals see less of them
            one, two = radius * math.sqrt(ratio), radius / math.sqrt(ratio)
            if min(one, two) * lean >= 2.0:
                thetas.append(parameters(centre, normals / (lean * np.array([[one], [two]])), blur))
        return thetas

    closed, going_on = tried((1.0, 0.7, 1.4, 0.5, 2.0)), tried((1.0, 0.5, 2.0))
    candidates = scored(grey, Pattern.DISC_OF_QUADRANTS, closed).most_promising(0.35, 2)
    candidates += scored(grey, Pattern.SQUARE_OF_QUADRANTS, closed).most_promising(0.35, 2)
    return candidates + scored(grey, Pattern.FIELDS, going_on).most_promising(0.35, 3)


@dataclass(frozen=True, eq=False)
class Region:
    """A connected region: its mean (2,) px and second moments (2, 2) px², and those with its holes filled."""

    mean: FloatArray
    moments: FloatArray
    filled_mean: FloatArray
    filled_moments: FloatArray
    area: float
    filled_area: float


def regions(grey: FloatArray, near: FloatArray | None = None, reach_px: float = np.inf) -> list[Region]:
    """Return regions brighter or darker than their surroundings in a patch (H, W), of those whose box comes as near as
    ``reach_px`` to ``near`` (2,) where it is given."""
    accepted: list[Region] = []
    taken: set[tuple[int, ...]] = set()
    smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), 0.7), np.float64)
    least = max(LEAST_CONTRAST_DN, OVER_TEXTURE * nmad(texture(grey)))
    if near is None:  # where nobody has said that there is a target it must be a clear one
        least *= CLEARER
    for mask in _masks(smooth):
        for region in _components(mask, smooth, least, near, reach_px):
            own = tuple(np.round([*region.mean, 8 * np.log(region.area), 8 * np.log(region.filled_area)]).astype(int))
            if own not in taken:
                taken.add(own)
                accepted.append(region)
    return accepted


def _masks(smooth: FloatArray) -> Iterator[BoolArray]:
    for side in (9, 17, 33, 65, 129):
        if side > 2 * min(smooth.shape):
            break
        low, high = _extremes(smooth, side)
        # halfway between the darkest and the brightest: where a blurred edge lies
        middle, contrast = 0.5 * (low + high), high - low > 1.5 * LEAST_CONTRAST_DN
        yield (smooth > middle) & contrast
        yield (smooth < middle) & contrast
        mean = cv2.blur(smooth, (side, side))
        spread = np.sqrt(np.maximum(cv2.blur(smooth**2, (side, side)) - mean**2, 0.0))
        yield (smooth > mean + 0.7 * spread) & contrast
        yield (smooth < mean - 0.7 * spread) & contrast


def _extremes(grey: FloatArray, side: int) -> tuple[FloatArray, FloatArray]:
    element = np.ones((side, side), np.uint8)
    low, high = cv2.erode(grey, element), cv2.dilate(grey, element)
    return cv2.blur(low, (side, side)), cv2.blur(high, (side, side))


def _stands_out(
    smooth: FloatArray, label: Int32Array, index: int, box: tuple[int, int, int, int], least_dn: float
) -> bool:
    """Return whether a region differs from what lies around it."""
    left, top, wide, high = box
    rows, columns = slice(max(top - 2, 0), top + high + 2), slice(max(left - 2, 0), left + wide + 2)
    own, grey = (label[rows, columns] == index).astype(np.uint8), smooth[rows, columns]
    around = cv2.dilate(own, _AROUND) - own
    mean, scatter = cv2.meanStdDev(grey, mask=own)  # of few pixels many times faster than numpy
    contrast = abs(float(mean[0, 0]) - cv2.mean(grey, around)[0])
    return contrast > least_dn and contrast > float(scatter[0, 0])


def _components(
    mask: BoolArray, smooth: FloatArray, least_dn: float, near: FloatArray | None, reach_px: float
) -> Iterator[Region]:
    count, label, table, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    height, width = mask.shape
    for index in range(1, count):
        left, top, wide, high, area = (int(n) for n in table[index])
        if area < 8 or max(wide, high) < SMALLEST_PX or max(wide, high) > LARGEST_PX or min(wide, high) < 3:
            continue
        if left == 0 or top == 0 or left + wide == width or top + high == height:
            continue
        if near is not None and not (
            left - reach_px <= near[0] <= left + wide + reach_px and top - reach_px <= near[1] <= top + high + reach_px
        ):
            continue
        if not _stands_out(smooth, label, index, (left, top, wide, high), least_dn):
            continue
        part = np.pad(label[top : top + high, left : left + wide] == index, 1)
        hollow = part.astype(np.uint8)
        outer = np.zeros((high + 4, wide + 4), np.uint8)
        cv2.floodFill(hollow, outer, (0, 0), 2)
        filled = hollow != 2
        mean, moments = _moments(part)
        filled_mean, filled_moments = _moments(filled)
        shift = np.array([left - 1.0, top - 1.0])
        value = np.linalg.eigvalsh(filled_moments)
        if value[0] < 0.6 or value[1] > 25.0 * value[0]:
            continue
        yield Region(mean + shift, moments, filled_mean + shift, filled_moments, float(area), float(filled.sum()))


def _moments(mask: BoolArray) -> tuple[FloatArray, FloatArray]:
    v, u = np.nonzero(mask)
    place = np.column_stack([u, v]).astype(np.float64)
    mean = place.mean(axis=0)
    return mean, (place - mean).T @ (place - mean) / len(place) + np.eye(2) / 12.0


@cache
def _unit_moments(pattern: Pattern, shape: float) -> tuple[FloatArray, FloatArray]:
    """Return mean (2,) and second moments (2, 2) of a pattern in its own unit."""
    step = (np.arange(240) + 0.5) / 120.0 - 1.0
    place = np.stack(np.meshgrid(step, step), -1).reshape(-1, 2)
    theta = parameters(np.zeros(2), np.eye(2), 0.01, shape)
    inside = place[level_shares(pattern, theta, place).first > 0.5]
    mean = inside.mean(axis=0)
    return mean, (inside - mean).T @ (inside - mean) / len(inside)


def _power(matrix: FloatArray, exponent: float) -> FloatArray:
    value, vector = np.linalg.eigh(matrix)
    return np.asarray((vector * np.maximum(value, 1e-9) ** exponent) @ vector.T)


def region_initial_values(grey: FloatArray, region: Region) -> list[InitialValues]:
    """Return the best start of each pattern that a region may be."""
    candidates: list[InitialValues] = []
    solid = region.area / region.filled_area
    # an ellipse holds 4 π √det M of its own moments
    round_ = region.filled_area / (4.0 * np.pi * np.sqrt(np.linalg.det(region.filled_moments)))
    if round_ > 0.85:
        A = 0.5 * _power(region.filled_moments, -0.5)
        shapes = (0.35, 0.5, 0.65) if solid > 0.97 else (float(np.sqrt(1.0 - solid)),)
        tries = (
            [(Pattern.CIRCLE, 0.5)] + [(Pattern.RING, s) for s in shapes]
            if solid > 0.7
            else [(Pattern.RING, s) for s in shapes]
        )
        for scale in (1.0, 1.6, 2.2):  # a region may be the inside of a ring
            for pattern, shape in tries if scale == 1.0 else [(Pattern.RING, 1.0 / scale)]:
                thetas = [parameters(region.filled_mean, A / scale, blur, shape) for blur in (0.6, 1.2, 2.2)]
                candidates += scored(grey, pattern, thetas).most_promising(0.4)
    for pattern in (Pattern.CROSS, Pattern.CORNER):
        candidates += _bar_initial_values(grey, region, pattern)
    return candidates


def _bar_initial_values(grey: FloatArray, region: Region, pattern: Pattern) -> list[InitialValues]:
    """Return the best starts of two bars that a region may be: its moments give all but how they are turned."""
    size = region.area / math.sqrt(float(np.linalg.det(region.moments)))
    misfit = [abs(math.log(size / _unit_size(pattern, shape))) for shape in BAR_SHAPES]
    shapes = [BAR_SHAPES[i] for i in np.argsort(misfit)[:2] if misfit[i] < 0.4]
    turns, whole = (12, 0.5 * np.pi) if pattern == Pattern.CROSS else (28, 2.0 * np.pi)
    whiten = _power(region.moments, -0.5)

    def turned(angles: FloatArray, shape: float, blur: float) -> FloatArray:
        mean, root = _unit_mean_and_root(pattern, shape)
        c, s = np.cos(angles), np.sin(angles)
        A = root @ np.stack([c, -s, s, c], axis=-1).reshape(-1, 2, 2) @ whiten
        thetas = np.zeros((len(angles), COUNT))
        thetas[:, :2] = region.mean - np.linalg.inv(A) @ mean
        thetas[:, 2:6] = A.reshape(-1, 4)
        thetas[:, BLUR] = blur
        thetas[:, SHAPE] = shape
        return thetas

    if not shapes:
        return []
    angle = np.arange(turns) * whole / turns
    tried = [(k, shape) for shape in shapes for k in angle]
    first = scored(grey, pattern, np.concatenate([turned(angle, shape, 1.1) for shape in shapes]))
    best = first.best(0.0, 2)
    near = 0.3 * np.array([-1.0, 0.0, 1.0]) * whole / turns
    steps = [turned(tried[i][0] + near, tried[i][1], blur) for i in best for blur in (0.7, 2.0)]
    if not steps:
        return []
    closer = scored(grey, pattern, np.concatenate(steps))
    candidates = _best([first.one(i) for i in best] + closer.most_promising(0.3, 2), 0.3, 2)
    if pattern == Pattern.CROSS:  # bars may end where their board does
        candidates += _best([opened for start in candidates for opened in _opened(grey, start)], 0.3, 1)
    return candidates


def _opened(grey: FloatArray, cross: InitialValues) -> list[InitialValues]:
    theta = cross.theta.copy()
    theta[2:6] /= theta[SHAPE]
    return scored(grey, Pattern.OPEN_CROSS, [theta], OPEN_PART / float(theta[SHAPE])).most_promising(0.3)


@cache
def _unit_mean_and_root(pattern: Pattern, shape: float) -> tuple[FloatArray, FloatArray]:
    """Return mean (2,) and the root (2, 2) of the second moments of a pattern in its own unit."""
    mean, moments = _unit_moments(pattern, shape)
    return mean, _power(moments, 0.5)


@cache
def _unit_size(pattern: Pattern, shape: float) -> float:
    """Return the area of a pattern over the root of the determinant of its second moments."""
    bars = 4.0 * (2.0 * shape - shape**2) if pattern == Pattern.CROSS else 2.0 * shape - shape**2
    return bars / math.sqrt(float(np.linalg.det(_unit_moments(pattern, shape)[1])))


def _best(starts: list[InitialValues], least: float, most: int) -> list[InitialValues]:
    good = [s for s in starts if s.explained > least]
    return sorted(good, key=lambda s: -s.promise)[:most]


def corner_initial_values(grey: FloatArray, near: FloatArray, reach_px: float) -> list[InitialValues]:
    """Return starts of bars that meet near a place (2,) and go on: painted lines."""
    low = np.maximum(np.floor(near - reach_px).astype(int), 0)
    high = np.minimum(np.ceil(near + reach_px).astype(int) + 1, np.array(grey.shape)[::-1])
    mask = np.zeros(grey.shape, np.uint8)
    mask[low[1] : high[1], low[0] : high[0]] = 255
    smooth = cv2.GaussianBlur(grey, (0, 0), 0.7).astype(np.float32)
    corners = cv2.goodFeaturesToTrack(smooth, 12, 0.05, 2.0, mask=mask)
    angle = np.arange(36) * np.pi / 18
    going_on: list[FloatArray] = []
    ended: list[FloatArray] = []
    for corner in [] if corners is None else corners.reshape(-1, 2).astype(np.float64):
        for *arms, sine in line_pairs(smooth, corner, angle, np.arange(3.0, 8.5, 1.0), 0.4 * LEAST_CONTRAST_DN, 4):
            if sine <= 0.35:
                continue
            for wide in (1.6, 3.0, 5.5):
                # bars lie between the arms' outer edges: normals of x look along the second arm
                normal = np.array([[arms[1][1], -arms[1][0]], [-arms[0][1], arms[0][0]]])
                if normal[0] @ arms[0] < 0:
                    normal = -normal
                inside = normal[1] @ arms[1] > 0
                if not inside:
                    normal[1] = -normal[1]
                lean = abs(float(np.linalg.det(np.array(arms))))
                for shift in (0.0, 0.5):
                    centre = corner - shift * wide * (arms[0] + arms[1]) / max(lean, 0.4)
                    going_on.append(parameters(centre, normal / wide, 0.8))
                    lengths = (2.5, 4.0, 7.0)
                    ended += [parameters(centre, normal / (wide * n), 0.8, 1.0 / n) for n in lengths]
    open_ones = scored(grey, Pattern.OPEN_CORNER, going_on, 4.0).most_promising(0.4, 4)
    return open_ones + scored(grey, Pattern.CORNER, ended).most_promising(0.4, 6)


def line_pairs(
    smooth: Float32Array, centre: FloatArray, angle: FloatArray, radius: FloatArray, least_dn: float, most: int
) -> Iterator[tuple[FloatArray, FloatArray, float]]:
    """Yield pairs of directions in which lines leave a place (2,), and the sine of the angle between them: of the rays
    at ``angle`` (K,), sampled at ``radius`` (R,), so many at most that are brighter, or darker, than the rest."""
    u, v = (centre[i] + f(angle)[:, None] * radius for i, f in enumerate((np.cos, np.sin)))
    ray = cv2.remap(smooth, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR).mean(axis=1)
    for signed in (ray - np.median(ray), np.median(ray) - ray):
        peak = (signed >= np.roll(signed, 1)) & (signed > np.roll(signed, -1)) & (signed > least_dn)
        top = np.flatnonzero(peak)[np.argsort(-signed[peak])][:most]
        directions = [np.array([np.cos(angle[i]), np.sin(angle[i])]) for i in top]
        for one, other in combinations(directions, 2):
            yield one, other, abs(float(one[0] * other[1] - one[1] * other[0]))
