"""The picture that a target of each kind makes: grey values and their derivatives.

A point p of the photograph lies at q = A (p − c) in the target, c its centre. Edges are lines q_x = o, q_y = o, or
circles |q| = ρ. A pixel at the distance d px from an edge, to first order d = s / |Aᵀn| with s the signed distance in
the target and n its direction, is covered to the share Φ(d/σ): a step under a Gaussian blur σ (Nalwa & Binford 1986),
in which the pixel's own area has its part. Where two edges cross whose directions have the cosine ρ, a pixel lies
beyond both to the share

    Φ₂(a, b; ρ) = Φ(a) Φ(b) + φ(a) φ(b) Σ_n ρⁿ/n! He_{n−1}(a) He_{n−1}(b)

with a and b their distances over σ: the tetrachoric series (Pearson 1900), here to ρ⁴.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.compilation import njit


class Pattern(IntEnum):
    """Patterns that can be drawn. Open ones have no outer edge; their unit is the half width of a bar, or arbitrary."""

    FIELDS = 0  # four fields that go on
    DISC_OF_QUADRANTS = 1  # |q| < 1
    SQUARE_OF_QUADRANTS = 2  # |q_x|, |q_y| < 1
    CIRCLE = 3  # |q| < 1
    RING = 4  # shape < |q| < 1
    CROSS = 5  # bars of half length 1 and half width shape
    OPEN_CROSS = 6  # bars of half width 1
    CORNER = 7  # bars of length 1 and width shape along +q_x and +q_y, outer corner at the origin
    OPEN_CORNER = 8  # bars of width 1
    CROSSED_SQUARE = 9  # |q_x|, |q_y| < 1, bars of half width shape across it from edge to edge


CX, CY, AXX, AXY, AYX, AYY, BLUR, SHAPE, OUTSIDE, FIRST, SECOND, RISE_U, RISE_V = range(13)
"""Places of the parameters: centre px, affine map 1/px, blur px, the pattern's own proportion, levels DN, and how the
level outside rises from the centre on, DN/px: ground is seldom even."""
COUNT = 13
MOST_PX = 100.0
"""Half of the side of what is looked at, at most."""

_ALWAYS = [CX, CY, AXX, AXY, AYX, AYY, BLUR]
FREE: dict[Pattern, IntArray] = {
    Pattern.FIELDS: np.array([*_ALWAYS, FIRST, SECOND]),
    Pattern.DISC_OF_QUADRANTS: np.array([*_ALWAYS, OUTSIDE, FIRST, SECOND, RISE_U, RISE_V]),
    Pattern.SQUARE_OF_QUADRANTS: np.array([*_ALWAYS, OUTSIDE, FIRST, SECOND, RISE_U, RISE_V]),
    Pattern.CIRCLE: np.array([*_ALWAYS, OUTSIDE, FIRST, RISE_U, RISE_V]),
    Pattern.RING: np.array([*_ALWAYS, SHAPE, OUTSIDE, FIRST, SECOND, RISE_U, RISE_V]),
    Pattern.CROSS: np.array([*_ALWAYS, SHAPE, OUTSIDE, FIRST, RISE_U, RISE_V]),
    Pattern.OPEN_CROSS: np.array([*_ALWAYS, OUTSIDE, FIRST, RISE_U, RISE_V]),
    Pattern.CORNER: np.array([*_ALWAYS, SHAPE, OUTSIDE, FIRST, RISE_U, RISE_V]),
    Pattern.OPEN_CORNER: np.array([*_ALWAYS, OUTSIDE, FIRST, RISE_U, RISE_V]),
    Pattern.CROSSED_SQUARE: np.array([*_ALWAYS, SHAPE, OUTSIDE, FIRST, SECOND, RISE_U, RISE_V]),
}
"""Parameters that are estimated. What the picture cannot show (how a circle is turned, the scale of fields that go on)
stays where it starts."""


FAR = 6.0
"""Standard deviations from which on a pixel is wholly on one side of an edge, to 1e-9."""


class Levels(NamedTuple):
    """Shares (N,) of the pixels that lie outside of the pattern and in its two levels."""

    outside: FloatArray
    first: FloatArray
    second: FloatArray


@njit(cache=True, nogil=True)
def _phi(d: float, blur: float) -> float:
    if abs(d) > FAR * blur:
        return 1.0 if d > 0.0 else 0.0
    return 0.5 * math.erfc(-d / blur * 0.7071067811865476)


@njit(cache=True, nogil=True)
def _density(d: float, blur: float) -> float:
    if abs(d) > FAR * blur:
        return 0.0
    return math.exp(-0.5 * (d / blur) ** 2) * 0.3989422804014327 / blur


@njit(cache=True, nogil=True)
def offsets(pattern: int, shape: float, offset: FloatArray, slope: FloatArray) -> int:
    """Write where the lines across an axis lie and how they move with the shape; return their number."""
    slope[:] = 0.0
    if pattern <= 1:
        offset[0] = 0.0
        return 1
    if pattern == 2:
        offset[0], offset[1] = -1.0, 0.0
        offset[2] = 1.0
        return 3
    if pattern == 5 or pattern == 9:
        offset[0], offset[1] = -shape, shape
        offset[2], offset[3] = -1.0, 1.0
        slope[0], slope[1] = -1.0, 1.0
        return 4
    if pattern == 6:
        offset[0], offset[1] = -1.0, 1.0
        return 2
    if pattern == 7:
        offset[0], offset[1] = 0.0, shape
        offset[2], offset[3] = 0.0, 1.0
        slope[1] = 1.0
        return 4
    if pattern == 8:
        offset[0], offset[1] = 0.0, 1.0
        return 2
    return 0


@njit(cache=True, nogil=True)
def shares(pattern: int, ex: FloatArray, ey: FloatArray, round_: FloatArray, g: FloatArray) -> tuple[float, float]:
    """Return the shares of the first and second level from those of the edges, and write their derivatives g (2, 10):
    by the edges across x (4), across y (4), by the outer and the inner circle."""
    g[:] = 0.0
    if pattern <= 1:
        x, y = ex[0], ey[0]
        whole = 1.0 if pattern == 0 else round_[0]
        same = x * y + (1.0 - x) * (1.0 - y)
        g[0, 0], g[0, 4] = whole * (2.0 * y - 1.0), whole * (2.0 * x - 1.0)
        g[1, 0], g[1, 4] = -g[0, 0], -g[0, 4]
        if pattern == 1:
            g[0, 8], g[1, 8] = same, 1.0 - same
        return whole * same, whole * (1.0 - same)
    if pattern == 2:
        xm, xp = ex[0] - ex[1], ex[1] - ex[2]
        ym, yp = ey[0] - ey[1], ey[1] - ey[2]
        g[0, 0], g[0, 1] = ym, yp - ym
        g[0, 2] = -yp
        g[0, 4], g[0, 5] = xm, xp - xm
        g[0, 6] = -xp
        g[1, 0], g[1, 1] = yp, ym - yp
        g[1, 2] = -ym
        g[1, 4], g[1, 5] = xp, xm - xp
        g[1, 6] = -xm
        return xp * yp + xm * ym, xp * ym + xm * yp
    if pattern == 3:
        g[0, 8] = 1.0
        return round_[0], 0.0
    if pattern == 4:
        g[0, 8], g[0, 9] = 1.0, -1.0
        g[1, 9] = 1.0
        return round_[0] - round_[1], round_[1]
    ax, ay = ex[0] - ex[1], ey[0] - ey[1]
    bx = by = 1.0
    if pattern == 5 or pattern == 7 or pattern == 9:
        bx, by = ex[2] - ex[3], ey[2] - ey[3]
    elif pattern == 8:
        bx, by = ex[0], ey[0]
    to_ax, to_ay = by - ay, bx - ax
    to_bx, to_by = ay, ax
    g[0, 0], g[0, 1] = to_ax, -to_ax
    g[0, 4], g[0, 5] = to_ay, -to_ay
    if pattern == 5 or pattern == 7 or pattern == 9:
        g[0, 2], g[0, 3] = to_bx, -to_bx
        g[0, 6], g[0, 7] = to_by, -to_by
    elif pattern == 8:
        g[0, 0] += to_bx
        g[0, 4] += to_by
    bars = bx * ay + ax * by - ax * ay
    if pattern == 9:
        g[1] = -g[0]
        g[1, 2] += by
        g[1, 3] -= by
        g[1, 6] += bx
        g[1, 7] -= bx
        return bars, bx * by - bars
    return bars, 0.0


@njit(cache=True, nogil=True)
def _crossings(pattern: int) -> FloatArray:
    """Return how often (2, 4, 4) the share beyond an edge across x and one across y counts in either level; of a disc
    of quadrants within its circle."""
    count = np.zeros((2, 4, 4))
    if pattern <= 1:
        count[0, 0, 0], count[1, 0, 0] = 2.0, -2.0
    elif pattern == 2:
        low, high = np.array([1.0, -1.0, 0.0, 0.0]), np.array([0.0, 1.0, -1.0, 0.0])
        count[0] = np.outer(high, high) + np.outer(low, low)
        count[1] = np.outer(high, low) + np.outer(low, high)
    elif pattern >= 5:
        bar, end = np.array([1.0, -1.0, 0.0, 0.0]), np.zeros(4)
        if pattern == 5 or pattern == 7 or pattern == 9:
            end[2], end[3] = 1.0, -1.0
        elif pattern == 8:
            end[0] = 1.0
        count[0] = np.outer(end, bar) + np.outer(bar, end) - np.outer(bar, bar)
        if pattern == 9:
            count[1] = np.outer(end, end) - count[0]
    return count


@njit(cache=True, nogil=True)
def _leaning(rho: float, a: float, b: float) -> tuple[float, float, float, float]:
    """Return by how much Φ₂(a, b; ρ) exceeds Φ(a) Φ(b), and its derivatives by a, b and ρ."""
    weight = math.exp(-0.5 * (a * a + b * b)) * 0.15915494309189535
    a2, b2 = a * a - 1.0, b * b - 1.0
    a3, b3 = a * (a * a - 3.0), b * (b * b - 3.0)
    r2, r3 = rho**2 / 2.0, rho**3 / 6.0
    r4 = rho**4 / 24.0
    value = weight * (rho + r2 * a * b + r3 * a2 * b2 + r4 * a3 * b3)
    by_a = weight * (r2 * b + 2.0 * r3 * a * b2 + 3.0 * r4 * a2 * b3) - a * value
    by_b = weight * (r2 * a + 2.0 * r3 * b * a2 + 3.0 * r4 * b2 * a3) - b * value
    return value, by_a, by_b, weight * (1.0 + rho * a * b + r2 * a2 * b2 + r3 * a3 * b3)


@njit(cache=True, nogil=True)
def _lean(
    count: FloatArray, lines: int, rho: float, a: FloatArray, b: FloatArray, by: FloatArray
) -> tuple[float, float]:
    """Return what the levels gain because edges lean, and write derivatives ``by`` (2, 9): by the distances over the
    blur of the edges across x (4), across y (4), by ρ."""
    by[:] = 0.0
    first = second = 0.0
    for i in range(lines):
        if abs(a[i]) > FAR:
            continue
        for j in range(lines):
            if abs(b[j]) > FAR:
                continue
            value, by_a, by_b, by_rho = _leaning(rho, a[i], b[j])
            first += count[0, i, j] * value
            second += count[1, i, j] * value
            for level in range(2):
                by[level, i] += count[level, i, j] * by_a
                by[level, 4 + j] += count[level, i, j] * by_b
                by[level, 8] += count[level, i, j] * by_rho
    return first, second


@njit(cache=True, nogil=True)
def _by_lines(
    row: FloatArray,
    theta: FloatArray,
    rx: float,
    ry: float,
    axis: int,
    lines: int,
    offset: FloatArray,
    slope: FloatArray,
    to_first: float,
    to_second: float,
    g: FloatArray,
    by: FloatArray,
) -> None:
    """Add to a row (COUNT,) of the Jacobian what the lines across an axis give, for a pixel at (rx, ry) px from the
    centre: ``g`` as of shares, ``by`` as of _lean, the differences of both levels from what lies outside."""
    ax, ay = theta[2 + 2 * axis], theta[3 + 2 * axis]
    blur = theta[6]
    size = math.hypot(ax, ay)
    hx, hy = ax / size, ay / size
    for j in range(lines):
        d = hx * rx + hy * ry - offset[j] / size
        if abs(d) > FAR * blur:
            continue
        k = 4 * axis + j
        f = (to_first * g[0, k] + to_second * g[1, k]) * _density(d, blur)
        f += (to_first * by[0, k] + to_second * by[1, k]) / blur
        row[2 + 2 * axis] += f * (rx - d * hx) / size
        row[3 + 2 * axis] += f * (ry - d * hy) / size
        row[0] -= f * hx
        row[1] -= f * hy
        row[6] -= f * d / blur
        row[7] -= f * slope[j] / size


@njit(cache=True, nogil=True)
def _by_circle(row: FloatArray, theta: FloatArray, rx: float, ry: float, rho: float, gain: float) -> float:
    """Add to a row (COUNT,) of the Jacobian what the circle |q| = rho gives, for a pixel at (rx, ry) px from the centre
    and ``gain`` the grey value by the share of the circle; return its derivative by rho."""
    axx, axy = theta[2], theta[3]
    ayx, ayy = theta[4], theta[5]
    blur = theta[6]
    x, y = axx * rx + axy * ry, ayx * rx + ayy * ry
    radius = max(math.hypot(x, y), 1e-9)
    nx, ny = -x / radius, -y / radius
    ux, uy = axx * nx + ayx * ny, axy * nx + ayy * ny
    w = max(math.hypot(ux, uy), 1e-12)
    ux, uy = ux / w, uy / w
    d = (rho - radius) / w
    f = gain * _density(d, blur)
    vx, vy = axx * ux + axy * uy, ayx * ux + ayy * uy
    along = vx * nx + vy * ny
    mx, my = nx + d * (vx - nx * along) / radius, ny + d * (vy - ny * along) / radius
    row[2] += f * (mx * rx - d * nx * ux) / w
    row[3] += f * (mx * ry - d * nx * uy) / w
    row[4] += f * (my * rx - d * ny * ux) / w
    row[5] += f * (my * ry - d * ny * uy) / w
    row[0] -= f * (mx * axx + my * ayx) / w
    row[1] -= f * (mx * axy + my * ayy) / w
    row[6] -= f * d / blur
    return float(f / w)


@njit(cache=True, nogil=True)
def draw(pattern: int, theta: FloatArray, place: FloatArray, grey: FloatArray, jacobian: FloatArray) -> None:
    """Write the grey values (N,) of pixels at ``place`` (N, 2) and, unless it is empty, the Jacobian (N, COUNT)."""
    cx, cy = theta[0], theta[1]
    blur = theta[6]
    axx, axy = theta[2], theta[3]
    ayx, ayy = theta[4], theta[5]
    wx, wy = math.hypot(axx, axy), math.hypot(ayx, ayy)
    offset, slope = np.zeros(4), np.zeros(4)
    lines = offsets(pattern, theta[7], offset, slope)
    is_round = pattern == 1 or pattern == 3 or pattern == 4
    ex, ey = np.zeros(4), np.zeros(4)
    circle, g = np.zeros(2), np.zeros((2, 10))
    a, b = np.zeros(4), np.zeros(4)
    by = np.zeros((2, 9))
    rho = (axx * ayx + axy * ayy) / (wx * wy)
    count = _crossings(pattern)
    wanted = jacobian.shape[0] > 0
    for i in range(place.shape[0]):
        rx, ry = place[i, 0] - cx, place[i, 1] - cy
        x, y = axx * rx + axy * ry, ayx * rx + ayy * ry
        for j in range(lines):
            a[j], b[j] = (x - offset[j]) / (wx * blur), (y - offset[j]) / (wy * blur)
            ex[j], ey[j] = _phi(a[j], 1.0), _phi(b[j], 1.0)
        if is_round:
            radius = max(math.sqrt(x * x + y * y), 1e-9)
            ux, uy = axx * x + ayx * y, axy * x + ayy * y
            w = max(math.sqrt(ux * ux + uy * uy) / radius, 1e-12)
            circle[0] = _phi((1.0 - radius) / w, blur)
            circle[1] = _phi((theta[7] - radius) / w, blur)
        first, second = shares(pattern, ex, ey, circle, g)
        if lines:
            more, less = _lean(count, lines, rho, a, b, by)
            if pattern == 1:
                g[0, 8] += more
                g[1, 8] += less
                by *= circle[0]
                more, less = more * circle[0], less * circle[0]
            first, second = first + more, second + less
        outside = theta[8] + theta[11] * rx + theta[12] * ry
        to_first, to_second = theta[9] - outside, theta[10] - outside
        grey[i] = outside + to_first * first + to_second * second
        if not wanted:
            continue
        row = jacobian[i]
        row[:] = 0.0
        row[8], row[9] = 1.0 - first - second, first
        row[10] = second
        row[11], row[12] = rx * row[8], ry * row[8]
        row[0] -= theta[11] * row[8]
        row[1] -= theta[12] * row[8]
        for axis in range(2):
            _by_lines(row, theta, rx, ry, axis, lines, offset, slope, to_first, to_second, g, by)
        if lines:
            f = (to_first * by[0, 8] + to_second * by[1, 8]) / (wx * wy)
            row[2] += f * (ayx - rho * axx * wy / wx)
            row[3] += f * (ayy - rho * axy * wy / wx)
            row[4] += f * (axx - rho * ayx * wx / wy)
            row[5] += f * (axy - rho * ayy * wx / wy)
        if is_round:
            along = to_first * g[0, 8] + to_second * g[1, 8]
            _by_circle(row, theta, rx, ry, 1.0, along)
            if pattern == 4:
                along = to_first * g[0, 9] + to_second * g[1, 9]
                row[7] += _by_circle(row, theta, rx, ry, theta[7], along)


def level_shares(pattern: Pattern, theta: FloatArray, place: FloatArray) -> Levels:
    """Return the shares of the levels in pixels at ``place`` (N, 2): the picture is linear in the levels."""
    return Levels(*(level_share(pattern, theta, place, level) for level in (OUTSIDE, FIRST, SECOND)))


def level_share(pattern: Pattern, theta: FloatArray, place: FloatArray, level: int) -> FloatArray:
    """Return the share (N,) of one level, OUTSIDE, FIRST or SECOND, in pixels at ``place`` (N, 2)."""
    one = theta.copy()
    one[OUTSIDE:] = 0.0
    one[level] = 1.0
    grey = np.empty(len(place))
    draw(int(pattern), one, place, grey, np.empty((0, COUNT)))
    return grey


@njit(cache=True, nogil=True)
def lies_within(pattern: int, theta: FloatArray, x: float, y: float, margin_px: float, reach: float) -> bool:
    """Return whether a place of the target lies in the pattern or at most ``margin_px`` outside it."""
    if pattern == 0:
        return x * x + y * y <= reach * reach
    if pattern == 1 or pattern == 3 or pattern == 4:
        square = x * x + y * y
        if square <= 1.0:
            return True
        radius = math.sqrt(square)  # many times faster than hypot
        ux, uy = theta[2] * x + theta[4] * y, theta[3] * x + theta[5] * y
        return (radius - 1.0) * radius <= margin_px * math.sqrt(ux * ux + uy * uy)
    wx = math.sqrt(theta[2] * theta[2] + theta[3] * theta[3])
    wy = math.sqrt(theta[4] * theta[4] + theta[5] * theta[5])
    low, high = -1.0, -1.0
    wide, end = 1.0, 1.0
    if pattern == 5:
        low, wide = -theta[7], theta[7]
    elif pattern == 6:
        high, end = -reach, reach
    elif pattern == 7 or pattern == 8:
        low = high = 0.0
        wide, end = (theta[7], 1.0) if pattern == 7 else (1.0, reach)
    mx, my = margin_px * wx, margin_px * wy
    over_x, over_y = mx, my
    if pattern == 6 or pattern == 8:  # nothing is known of what lies beyond the end
        over_x = over_y = 0.0
    bar_x, bar_y = low - mx <= x <= wide + mx, low - my <= y <= wide + my
    before_x, before_y = (over_x, over_y) if pattern == 6 else (mx, my)
    long_x, long_y = high - before_x <= x <= end + over_x, high - before_y <= y <= end + over_y
    return (bar_x and long_y) or (bar_y and long_x)


@njit(cache=True, nogil=True)
def within(pattern: int, theta: FloatArray, place: FloatArray, margin_px: float, reach: float) -> BoolArray:
    """Return which pixels (N,) at ``place`` (N, 2) lie in the pattern or at most ``margin_px`` outside it; open
    patterns end at ``reach``, in the target's unit."""
    inside = np.zeros(len(place), np.bool_)
    for i in range(len(place)):
        rx, ry = place[i, 0] - theta[0], place[i, 1] - theta[1]
        x, y = theta[2] * rx + theta[3] * ry, theta[4] * rx + theta[5] * ry
        inside[i] = lies_within(pattern, theta, x, y, margin_px, reach)
    return inside


@njit(cache=True, nogil=True)
def margin_px(theta: FloatArray) -> float:
    """Return how far around a target pixels are taken: as far as the blur of its edges reaches."""
    return float(1.0 + 1.5 * min(max(theta[6], 0.3), 3.0))


@njit(cache=True, nogil=True)
def box(pattern: int, theta: FloatArray, rows: int, columns: int, reach: float) -> tuple[int, int, int, int]:
    """Return the first and last column and row, u, v, u, v, of the pixels that may show a pattern in a patch of so many
    rows and columns; the last is before the first where it leaves the patch, or is no pattern."""
    a, b = theta[2], theta[3]
    c, d = theta[4], theta[5]
    determinant = a * d - b * c
    if not np.isfinite(theta).all() or abs(determinant) < 1e-7:
        return 0, 0, -1, -1
    extent = reach if pattern == 0 or pattern == 6 or pattern == 8 else 1.0
    if pattern <= 1 or pattern == 3 or pattern == 4:
        half_u, half_v = math.hypot(b, d), math.hypot(a, c)
    else:
        half_u, half_v = abs(b) + abs(d), abs(a) + abs(c)
    margin = margin_px(theta)
    half_u = extent * half_u / abs(determinant) + margin
    half_v = extent * half_v / abs(determinant) + margin
    if max(half_u, half_v) > MOST_PX or abs(theta[0]) > 1e6 or abs(theta[1]) > 1e6:
        return 0, 0, -1, -1
    left, top = max(math.floor(theta[0] - half_u), 0), max(math.floor(theta[1] - half_v), 0)
    right, bottom = min(math.ceil(theta[0] + half_u), columns - 1), min(math.ceil(theta[1] + half_v), rows - 1)
    if right - left < 3 or bottom - top < 3:
        return 0, 0, -1, -1
    return left, top, right, bottom
