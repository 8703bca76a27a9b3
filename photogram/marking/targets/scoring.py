"""How well rough parameters of a pattern explain a patch, quickly: its levels are fitted, nothing else.

The picture is that of `picture` but for what leaning edges share, from a table, on a lattice of pixels.
"""

import math

import numpy as np
from scipy.special import erfc

from photogram.arrays import FloatArray, IntArray
from photogram.compilation import njit
from photogram.marking.targets.picture import box, lies_within, margin_px, offsets, shares

_ROUGH_END, _ROUGH_STEPS = 4.0, 64.0
_ROUGH = 0.5 * erfc(-np.arange(-4.0, 4.0 + 0.5 / 64.0, 1.0 / 64.0) / np.sqrt(2.0))


@njit(cache=True, nogil=True)
def _rough_phi(d: float, blur: float) -> float:
    """Return _phi to 1e-4: enough to score what is then fitted."""
    x = (d / blur + _ROUGH_END) * _ROUGH_STEPS
    if x <= 0.0:
        return 0.0
    i = int(x)
    if i >= len(_ROUGH) - 1:
        return 1.0
    return float(_ROUGH[i] + (x - i) * (_ROUGH[i + 1] - _ROUGH[i]))


@njit(cache=True, nogil=True)
def score(
    pattern: int,
    theta: FloatArray,
    levels: IntArray,
    grey: FloatArray,
    where: IntArray,
    thinning: int,
    margin: float,
    reach: float,
) -> tuple[int, float, float]:
    """Write the levels that fit a patch (H, W) best into ``theta``; return the number of pixels, the squares that
    remain, and those about the mean.

    ``levels`` are the places of those that are free, ``where`` the first and last column and row that are looked at.
    """
    wx, wy = math.hypot(theta[2], theta[3]), math.hypot(theta[4], theta[5])
    offset, slope = np.zeros(4), np.zeros(4)
    lines = offsets(pattern, theta[7], offset, slope)
    is_round = pattern == 1 or pattern == 3 or pattern == 4
    ex, ey = np.zeros(4), np.zeros(4)
    circle, g = np.zeros(2), np.zeros((2, 10))
    p = len(levels)
    normal, right = np.zeros((p, p)), np.zeros(p)
    share = np.zeros(3)
    n, total = 0, 0.0
    squares = 0.0
    for v in range(where[1], where[3] + 1, thinning):
        for u in range(where[0], where[2] + 1, thinning):
            rx, ry = u - theta[0], v - theta[1]
            x, y = theta[2] * rx + theta[3] * ry, theta[4] * rx + theta[5] * ry
            if not lies_within(pattern, theta, x, y, margin, reach):
                continue
            for j in range(lines):
                ex[j], ey[j] = _rough_phi((x - offset[j]) / wx, theta[6]), _rough_phi((y - offset[j]) / wy, theta[6])
            if is_round:
                radius = max(math.sqrt(x * x + y * y), 1e-9)
                ux = (theta[2] * x + theta[4] * y) / radius
                uy = (theta[3] * x + theta[5] * y) / radius
                w = max(math.sqrt(ux * ux + uy * uy), 1e-12)
                circle[0] = _rough_phi((1.0 - radius) / w, theta[6])
                circle[1] = _rough_phi((theta[7] - radius) / w, theta[6])
            first, second = shares(pattern, ex, ey, circle, g)
            share[0], share[1] = 1.0 - first - second, first
            share[2] = second
            value = grey[v, u]
            n += 1
            total += value
            squares += value * value
            for i in range(p):
                right[i] += share[levels[i] - 8] * value
                for j in range(p):
                    normal[i, j] += share[levels[i] - 8] * share[levels[j] - 8]
    if n < 15:
        return n, 0.0, 0.0
    damped = normal.copy()
    for i in range(p):
        damped[i, i] += 1e-6
    solution = np.linalg.solve(damped, right)
    for i in range(p):
        theta[levels[i]] = solution[i]
    left = squares - 2.0 * (solution * right).sum() + (solution * (normal @ solution)).sum()
    return n, max(left, 0.0), squares - total * total / n


@njit(cache=True, nogil=True)
def score_all(
    pattern: int, thetas: FloatArray, levels: IntArray, grey: FloatArray, reach: float, verdict: FloatArray
) -> None:
    """Write the levels that fit a patch (H, W) best into ``thetas`` (M, COUNT), and to ``verdict`` (M, 3) the thinning
    of the pixels that were looked at, the squares that remain, and those about the mean: 0 where nothing is shown."""
    for m in range(len(thetas)):
        verdict[m] = 0.0
        left, top, right, bottom = box(pattern, thetas[m], grey.shape[0], grey.shape[1], reach)
        if right < left:
            continue
        side = math.sqrt(float((right - left) * (bottom - top)))
        thinning = 1 if side < 18.0 else 2 if side < 36.0 else 3 if side < 54.0 else 4
        where = np.array([left, top, right, bottom])
        n, rest, total = score(pattern, thetas[m], levels, grey, where, thinning, margin_px(thetas[m]), reach)
        if n >= 15:
            verdict[m, 0], verdict[m, 1] = thinning, rest
            verdict[m, 2] = total
