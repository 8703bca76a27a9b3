"""Standard deviations of interpolated terrain: ground held out and interpolated again.

Disks of ground, of several sizes, are taken away; what the interpolation is off there tells how far it may be off as
far from ground, beside ground as rough, elsewhere. sigma² = a + b·roughness·distance^c, as the site's own ground has
it.
"""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import binary_erosion, convolve, distance_transform_edt, gaussian_filter
from scipy.optimize import nnls

from photogram.arrays import BoolArray, FloatArray, nmad
from photogram.surface.ground_filter import nearest_known

Between = Callable[[FloatArray, BoolArray], FloatArray]
"""What interpolates heights (rows, columns) that are known in some cells."""

_RADII_M = (0.75, 1.5, 3.0, 6.0, 12.0)
_APART = 4.0  # radii, between the middles of disks
_DISKS, _SEED = 300, 1
_ROUGH_M = 0.75
_EXPONENTS = np.arange(0.5, 4.01, 0.25)
_FEWEST, _CLASSES = 30, 8
_ROUNDS = 12
_LEAST_SHARE = 0.1  # of a class's variance is the interpolation's
_NEIGHBOURS = np.array([[0.0, 0.25, 0.0], [0.25, 0.0, 0.25], [0.0, 0.25, 0.0]])


def interpolated_sigma(heights_m: FloatArray, ground: BoolArray, side_m: float, between: Between) -> FloatArray:
    """Return the standard deviations (rows, columns) of interpolated heights in cells of such a side.

    ``heights_m`` are known on ``ground``; ``between`` interpolates them.
    """
    rough = roughness(heights_m, ground, side_m, between)
    distance, held_rough, error = held_out(heights_m, ground, rough, side_m, between)
    if len(error) < _FEWEST:
        return np.full(heights_m.shape, max(float(np.std(heights_m[ground])), side_m))
    a, b, c = fitted(distance, held_rough, error, own_variance(heights_m, ground))
    gap = np.maximum(distance_transform_edt(~ground) * side_m, side_m)
    return np.asarray(np.sqrt(a + b * rough * gap**c))


def roughness(heights_m: FloatArray, ground: BoolArray, side_m: float, between: Between) -> FloatArray:
    """Return the roughness (rows, columns): the square of what the ground around departs from its mean over _ROUGH_M,
    that of the whole ground being 1; where it is smoother than that, half way to 1."""
    reach = _ROUGH_M / side_m
    whole = between(heights_m, ground)
    bend = whole - gaussian_filter(whole, reach, mode="nearest")
    share = gaussian_filter(ground.astype(np.float64), 2.0 * reach, mode="nearest")
    square = gaussian_filter(np.where(ground, bend**2, 0.0), 2.0 * reach, mode="nearest")
    seen = share > 0.01
    around = nearest_known(np.where(seen, square / np.maximum(share, 0.01), 0.0), seen | ground)
    relative = around / max(float(np.mean(bend[ground] ** 2)), 1e-12)
    return np.asarray(np.maximum(relative, 0.5 + 0.5 * relative))


def held_out(
    heights_m: FloatArray, ground: BoolArray, rough: FloatArray, side_m: float, between: Between
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return of ground that was held out the distances from the ground left, the roughness and the errors (N,)."""
    rng = np.random.default_rng(_SEED)
    places = np.argwhere(ground)
    found = [np.zeros((3, 0))]
    for radius_m in _RADII_M:
        radius = radius_m / side_m
        middle = np.ones(ground.shape, dtype=bool)
        cells = places[rng.permutation(len(places))[: 4 * _DISKS]]
        taken: set[tuple[int, int]] = set()
        for row, column in cells:  # one disk in a square of a lattice keeps them apart
            square = int(row // (_APART * radius)), int(column // (_APART * radius))
            if square not in taken and len(taken) < _DISKS:
                taken.add(square)
                middle[row, column] = False
        hidden = ground & (distance_transform_edt(middle) <= radius)
        left = ground & ~hidden
        if not left.any():
            continue
        distance = distance_transform_edt(~left) * side_m
        found.append(np.stack([distance, rough, between(heights_m, left) - heights_m])[:, hidden])
    distance, held_rough, error = np.concatenate(found, axis=1)
    return distance, held_rough, error


def own_variance(heights_m: FloatArray, ground: BoolArray) -> float:
    """Return the variance of the noise that each height has for itself, by how it departs from its neighbours; 0 where
    none has ground all around, so that what is stated of interpolated heights holds that noise too."""
    off = heights_m - convolve(heights_m, _NEIGHBOURS, mode="nearest")
    known = off[binary_erosion(ground, np.ones((3, 3), dtype=bool)) & np.isfinite(off)]
    return float(0.8 * nmad(known) ** 2) if len(known) else 0.0


def fitted(distance_m: FloatArray, rough: FloatArray, error_m: FloatArray, own: float) -> tuple[float, float, float]:
    """Return a, b and c of the variance a + b·rough·distance^c of errors (N,), a and b not negative, over the ``own``
    variance of the heights that were held out.

    Classes of distance, and of roughness in each, weigh alike, each by its own variance.
    """
    count = max(1, min(_CLASSES, int(np.sqrt(len(error_m) / _FEWEST))))
    classes = [
        part
        for near in np.array_split(np.argsort(distance_m, kind="stable"), count)
        for part in np.array_split(near[np.argsort(rough[near], kind="stable")], count)
    ]
    variance = np.array([max(float(np.mean(error_m[k] ** 2)), 1e-12) for k in classes])
    wanted = np.maximum(variance - own, _LEAST_SHARE * variance)
    best, found = np.inf, (float(np.mean(variance)), 0.0, 1.0)
    for c in _EXPONENTS:
        terms = np.array([(1.0, np.mean(rough[k] * distance_m[k] ** c)) for k in classes])
        stated = wanted
        for _ in range(_ROUNDS):  # as a gamma distribution has it: errors over sigma come to 1
            (a, b), _ = nnls(terms / stated[:, None], wanted / stated)
            stated = np.maximum(terms @ (a, b), 1e-12)
        misfit = float(np.sum(np.log(stated) + wanted / stated))
        if misfit < best:
            best, found = misfit, (float(a), float(b), float(c))
    return found
