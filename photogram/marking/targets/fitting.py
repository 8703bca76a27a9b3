"""Least squares of a target's picture against grey values (Levenberg 1944, Marquardt 1963), and the covariance of its
centre.

Pixels around a target show whatever lies there, so they have a variance of their own and weigh less. Residuals of
photographs are correlated between neighbours (demosaicing, JPEG, texture), which σ² (JᵀJ)⁻¹ ignores. With the influence
k_i (2,) of pixel i on the centre, σ_i the noise around it and ρ(l) the correlation of residuals at the lag l,

    C = Σ_l ρ(l) Σ_i k_i σ_i σ_{i+l} k_{i+l}ᵀ

is the covariance (Conley 1999; noise by place as White 1980, one correlogram for all pixels, with the flat-topped taper
of Politis & Romano 1995).
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import gaussian_filter

from photogram.arrays import FloatArray, IntArray
from photogram.compilation import njit
from photogram.marking.targets.picture import (
    COUNT,
    FREE,
    OUTSIDE,
    SECOND,
    Pattern,
    box,
    draw,
    level_share,
    margin_px,
    within,
)

LAGS = 10
"""Up to which lag, in px, residuals are taken as correlated."""
LEAST_NOISE_DN = 0.5
"""Noise below which grey values are not believed: they are rounded, and the blur of a lens is not quite Gaussian."""
WORTHWHILE = (0.55, 0.75, 0.9)
"""Share of the variance, weighted or not, that a picture must explain each time to be fitted further."""
MODEL_ERROR = {
    Pattern.CORNER: 1.4,
    Pattern.OPEN_CORNER: 1.4,
    Pattern.CIRCLE: 1.05,
    Pattern.RING: 0.65,
    Pattern.FIELDS: 0.83,
    Pattern.DISC_OF_QUADRANTS: 0.82,
    Pattern.SQUARE_OF_QUADRANTS: 0.82,
    Pattern.CROSS: 1.05,
    Pattern.OPEN_CROSS: 1.05,
    Pattern.CROSSED_SQUARE: 1.05,
}
"""Factors of standard deviations for what the picture of a pattern lacks, from rendered targets: what it lacks on one
side of an L moves the corner; what it lacks all around a ring or a crossing counts as noise but moves nothing.
`benchmarks/targets.py` shows whether they are true."""
LOCAL_PX = 2.0
"""Over how far the noise of a place is taken from the residuals around it."""
SHRINKINGS = 5
"""How often fields that go on are looked at more closely, at most."""
WELL_EXPLAINED = 0.985
"""Share of the squares that is enough for them."""
SMALLEST_FIELD_PX = 3.0
"""Radius below which they are not looked at more closely."""
ENDS = (1e-2, 1e-3, 1e-6)
"""Share of the squares below which a step is the last: one for each time that pixels and weights are chosen anew."""
ITERATIONS = (8, 10, 15)
"""How many steps each time at most: what has not come near by then is no target."""
ENOUGH_PIXELS = 300
"""How many pixels are enough for all but the last fit."""
ZONES = 30.0
"""Ratio of the variances around and in a target, at most."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A pattern fitted to the grey values around it."""

    pattern: Pattern
    theta: FloatArray
    """Parameters (COUNT,) as of picture."""
    jacobian: FloatArray
    """Derivatives (N, F) of the picture by its free parameters, the centre first."""
    place: IntArray
    """Column and row (N, 2) of the pixels."""
    grey: FloatArray
    """Grey values (N,) there."""
    residual: FloatArray
    """Grey values (N,) less those of the picture."""
    weight: FloatArray
    """Weights (N,), 1/DN²."""
    reach: float
    """Where an open pattern ends."""

    @cached_property
    def covariance_px2(self) -> FloatArray:
        """Covariance (2, 2) of the centre."""
        outside = outside_share(self.pattern, self.theta, self.place.astype(np.float64))
        covariance = centre_covariance(self.place, self.jacobian, self.residual, self.weight, outside)
        return MODEL_ERROR.get(self.pattern, 1.0) ** 2 * 0.5 * (covariance + covariance.T)

    @property
    def explained(self) -> float:
        """Share of the variance of the grey values that the picture explains."""
        return _explained(self.grey, self.residual, np.ones(len(self.grey)))

    @cached_property
    def explained_at_best(self) -> float:
        """The same, or of the weighted squares where that is more: rough ground around a target, which no picture
        explains, counts less in them, but so does the difference of the target from the ground."""
        return _explained_at_best(self.grey, self.residual, self.weight)

    @property
    def variation(self) -> float:
        """Sum of the squared grey values about their mean."""
        return float(((self.grey - self.grey.mean()) ** 2).sum())


@njit(cache=True, nogil=True)
def _minimise(
    pattern: int,
    start: FloatArray,
    free: IntArray,
    place: FloatArray,
    grey: FloatArray,
    root_weight: FloatArray,
    iterations: int,
    tolerance: float,
) -> tuple[FloatArray, float]:
    """Return the parameters at the minimum of the weighted squares, and its value."""
    n, p = len(grey), len(free)
    theta, trial = start.copy(), start.copy()
    drawn, jacobian = np.empty(n), np.empty((n, 13))
    other_jacobian = np.empty((n, 13))
    draw(pattern, theta, place, drawn, jacobian)
    r = (grey - drawn) * root_weight
    cost = (r**2).sum()
    damping = 1e-3
    for _ in range(iterations):
        J = np.empty((n, p))
        for i in range(n):
            for j in range(p):
                J[i, j] = jacobian[i, free[j]] * root_weight[i]
        normal, right = J.T @ J, J.T @ r
        improved, last = False, False
        for _ in range(8):
            damped = normal.copy()
            for j in range(p):
                damped[j, j] += damping * normal[j, j] + 1e-12 * np.trace(normal) + 1e-9
            step = np.linalg.solve(damped, right)
            trial[:] = theta
            for j in range(p):
                trial[free[j]] += step[j]
            trial[6] = min(max(trial[6], 0.25), 8.0)
            trial[7] = min(max(trial[7], 0.03), 0.95)
            for j in range(8, 11):  # what is narrower than its blur shall not become brighter than white
                trial[j] = min(max(trial[j], -20.0), 275.0)
            # most steps are taken, so that drawing once with derivatives costs less than twice
            draw(pattern, trial, place, drawn, other_jacobian)
            other = (grey - drawn) * root_weight
            lower = (other**2).sum()
            if lower < cost:
                last = cost - lower < tolerance * cost
                improved, cost = True, lower
                damping, r = max(0.2 * damping, 1e-9), other
                theta[:] = trial
                jacobian, other_jacobian = other_jacobian, jacobian
                break
            damping *= 6.0
        if not improved or last or not np.isfinite(cost):
            break
    return theta, cost


def pixels(pattern: Pattern, theta: FloatArray, shape: tuple[int, int], reach: float) -> IntArray | None:
    """Return column and row (N, 2) of the pixels of a patch of height and width ``shape`` that show a pattern, None
    where it leaves the patch or is hardly any."""
    left, top, right, bottom = box(int(pattern), theta, *shape, reach)
    if right < left:
        return None
    columns, rows = np.meshgrid(np.arange(left, right + 1), np.arange(top, bottom + 1))
    place = np.column_stack([columns.ravel(), rows.ravel()])
    place = place[within(int(pattern), theta, place.astype(np.float64), margin_px(theta), reach)]
    return place if len(place) >= 15 else None


def fit(grey: FloatArray, pattern: Pattern, start: FloatArray, reach: float = 1.0) -> Fit | None:
    """Return a pattern fitted to a patch (H, W) of grey values, None where it hardly shows one.

    ``start`` (COUNT,) are its rough parameters, levels included; ``reach`` is where an open pattern ends. Fields that
    go on are fitted as far around their corner as the patch shows them.
    """
    result = _fitted(grey, pattern, start, reach)
    closer = start.copy()
    for _ in range(SHRINKINGS if pattern == Pattern.FIELDS else 0):
        if result is not None:
            if result.explained > WELL_EXPLAINED:
                break
            closer[:] = result.theta
        closer[2:6] *= 1.3
        if np.linalg.svd(closer[2:6].reshape(2, 2), compute_uv=False)[0] > 1.0 / SMALLEST_FIELD_PX:
            break
        result = _fitted(grey, pattern, closer, reach) or result
    return result


def _fitted(grey: FloatArray, pattern: Pattern, start: FloatArray, reach: float = 1.0) -> Fit | None:
    theta = start
    weight_at: tuple[float, float] | None = None
    for n in range(len(ENDS)):
        at = pixels(pattern, theta, (grey.shape[0], grey.shape[1]), reach)
        if at is None:
            return None
        place = at if n == len(ENDS) - 1 else _thinned(at)
        own = grey[place[:, 1], place[:, 0]]
        exact = place.astype(np.float64)
        weight = np.ones(len(own)) if weight_at is None else _weight(pattern, theta, exact, weight_at)
        theta, cost = _minimise(int(pattern), theta, FREE[pattern], exact, own, np.sqrt(weight), ITERATIONS[n], ENDS[n])
        if pattern == Pattern.FIELDS:
            theta = _as_large(theta, start)
        if not np.isfinite(cost) or not _is_sane(theta, start):
            return None
        drawn, jacobian = np.empty(len(own)), np.empty((len(own), COUNT))
        draw(int(pattern), theta, exact, drawn, jacobian)
        residual = own - drawn
        if _explained_at_best(own, residual, weight) < WORTHWHILE[n]:
            return None
        weight_at = _zones(pattern, theta, exact, residual)
    return Fit(pattern, theta, jacobian[:, FREE[pattern]], place, own, residual, weight, reach)


def _explained(grey: FloatArray, residual: FloatArray, weight: FloatArray) -> float:
    """Return the share of the weighted squares of grey values (N,) about their mean that is no residual (N,)."""
    total = float((weight * (grey - np.average(grey, weights=weight)) ** 2).sum())
    return 1.0 - float((weight * residual**2).sum()) / max(total, 1e-9)


def _explained_at_best(grey: FloatArray, residual: FloatArray, weight: FloatArray) -> float:
    return max(_explained(grey, residual, weight), _explained(grey, residual, np.ones(len(grey))))


def _thinned(place: IntArray) -> IntArray:
    """Return enough of many pixels (N, 2), on a lattice."""
    step = math.isqrt(max(len(place) // ENOUGH_PIXELS, 1))
    return place[(place % step == 0).all(axis=1)] if step > 1 else place


def _as_large(theta: FloatArray, start: FloatArray) -> FloatArray:
    """Return the parameters of fields that go on, with normals as long as those they start with: no picture shows how
    long they are, and they say which pixels are taken."""
    own = theta.copy()
    for row in (slice(2, 4), slice(4, 6)):
        own[row] *= float(np.linalg.norm(start[row])) / max(float(np.linalg.norm(theta[row])), 1e-12)
    return own


def _is_sane(theta: FloatArray, start: FloatArray) -> bool:
    size = np.linalg.det(theta[2:6].reshape(2, 2)) / np.linalg.det(start[2:6].reshape(2, 2))
    return bool(np.isfinite(theta).all() and 0.1 < size < 10.0 and np.ptp(theta[OUTSIDE : SECOND + 1]) < 600.0)


def outside_share(pattern: Pattern, theta: FloatArray, place: FloatArray) -> FloatArray:
    """Return the share (N,) of each pixel that lies outside the pattern."""
    return level_share(pattern, theta, place, OUTSIDE) if OUTSIDE in FREE[pattern] else np.zeros(len(place))


def _zones(pattern: Pattern, theta: FloatArray, place: FloatArray, residual: FloatArray) -> tuple[float, float]:
    """Return the variance of residuals in a target and around it."""
    outside = outside_share(pattern, theta, place)
    inner, outer = residual[outside <= 0.1], residual[outside > 0.9]
    if len(inner) < 12:  # bars so thin that nothing lies quite within them
        inner = residual[outside <= 0.9]
    least = LEAST_NOISE_DN**2
    inside = max(float((inner**2).mean()) if len(inner) else least, least)
    around = max(float((outer**2).mean()) if len(outer) >= 8 else inside, least)
    return max(inside, around / ZONES), max(around, inside / ZONES)


def _weight(pattern: Pattern, theta: FloatArray, place: FloatArray, zones: tuple[float, float]) -> FloatArray:
    outside = outside_share(pattern, theta, place)
    return np.asarray(1.0 / ((1.0 - outside) * zones[0] + outside * zones[1]))


def centre_covariance(
    place: IntArray, jacobian: FloatArray, residual: FloatArray, weight: FloatArray, outside: FloatArray
) -> FloatArray:
    """Return the covariance (2, 2) of the first two of P parameters: ``jacobian`` (N, P) of the grey values at the
    pixels ``place`` (N, 2), their ``residual`` (N,), ``weight`` (N,) and share ``outside`` (N,) of the target, where
    noise is another than in it."""
    root = np.sqrt(weight)
    J = jacobian * root[:, None]
    scale = np.sqrt((J**2).sum(axis=0)) + 1e-12
    inverse = np.linalg.pinv(J / scale, rcond=1e-6)
    influence = (inverse / scale[:, None])[:2] * root
    leverage = np.einsum("ij,ji->i", J / scale, inverse)
    low = place.min(axis=0)
    width, height = (int(n) for n in place.max(axis=0) - low + 1)
    at = (place[:, 1] - low[1], place[:, 0] - low[0])
    there, field = np.zeros((height, width)), np.zeros((height, width))
    square = np.zeros((height, width))
    there[at], field[at] = 1.0, residual
    # what the fit has taken away from a residual (MacKinnon & White 1985)
    square[at] = residual**2 / np.maximum(1.0 - leverage, 0.2)
    surroundings = np.zeros((height, width))
    surroundings[at] = outside > 0.5
    local = np.full((height, width), LEAST_NOISE_DN**2)
    for part in (there * (1.0 - surroundings), surroundings):
        if part.any():
            noise = _smoothed(square * part) / np.maximum(_smoothed(part), 1e-9)
            local = np.where(part > 0.0, np.maximum(noise, local), local)
    sigma = np.sqrt(local)
    rho = _correlogram(field / sigma, there, float(leverage.sum()))
    k = np.zeros((2, height, width))
    k[:, at[0], at[1]] = influence * sigma[at]
    # correlations of the influences at all lags, by the Fourier transform
    shape = (2 * height, 2 * width)
    spectrum = np.fft.rfft2(k, s=shape)
    weights = np.zeros(shape)
    for (dy, dx), value in rho.items():
        weights[dy % shape[0], dx % shape[1]] = value
    smooth = np.fft.irfft2(spectrum * np.fft.rfft2(weights)[None], s=shape)[:, :height, :width]
    total = np.einsum("iab,jab->ij", k, smooth)
    white = np.einsum("iab,jab->ij", k, k)
    return np.asarray(_at_least(_at_least(0.5 * (total + total.T), white), LEAST_NOISE_DN**2 * influence @ influence.T))


def _smoothed(field: FloatArray) -> FloatArray:
    return np.asarray(gaussian_filter(field, LOCAL_PX, mode="constant"), np.float64)


def _correlogram(field: FloatArray, there: FloatArray, lost: float) -> dict[tuple[int, int], float]:
    """Return the correlation of standardised residuals by lag, rows and columns: of a ``field`` (H, W) that is 0 where
    none is ``there`` (H, W), and has ``lost`` so many degrees of freedom to the fit.

    A fit takes from residuals what is as smooth as its own parameters: every correlation has lost lost / N.
    """
    shape = (2 * there.shape[0], 2 * there.shape[1])
    count = float(there.sum())
    products, pairs = (np.fft.irfft2(np.abs(np.fft.rfft2(a, s=shape)) ** 2, s=shape) for a in (field * there, there))
    square = max(products[0, 0] / count, 1e-12)
    rho = {(0, 0): 1.0}
    for dy in range(-min(LAGS, there.shape[0] - 1), min(LAGS, there.shape[0] - 1) + 1):
        for dx in range(-min(LAGS, there.shape[1] - 1), min(LAGS, there.shape[1] - 1) + 1):
            lag, own = math.hypot(dx, dy), float(pairs[dy, dx])
            if (dy, dx) == (0, 0) or lag > LAGS or own < 8.0:
                continue
            value = float(products[dy, dx]) / own / square + lost / count
            if lag > 1.5 and value < 2.0 / math.sqrt(own):  # not distinct from none (Bartlett 1946)
                continue
            rho[dy, dx] = min(value, 1.0) * min(1.0, 2.0 - 2.0 * lag / (LAGS + 1.0))
    return rho


def _at_least(covariance: FloatArray, least: FloatArray) -> FloatArray:
    """Return a covariance that is nowhere below another."""
    L = np.linalg.cholesky(least + 1e-14 * np.eye(2))
    inverse = np.linalg.inv(L)
    value, vector = np.linalg.eigh(inverse @ covariance @ inverse.T)
    return np.asarray(L @ (vector * np.maximum(value, 1.0)) @ vector.T @ L.T)
