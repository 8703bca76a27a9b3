"""Exposure balance: one gain per channel for every photograph, and the fall of light towards its corners.

The colour of a place in a photograph is taken as gain · falloff · colour, with falloff exp(v r²), r the ideal radius
and v of the camera. In logarithms this is linear; the colour of each place is eliminated, and what remains is solved by
least squares with Cauchy weights (Holland & Welsch 1977), because shadows move and surfaces shine.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from photogram.arrays import ByteArray, FloatArray, IntArray
from photogram.compilation import njit
from photogram.frames import LocalFrame
from photogram.grid import MapGrid
from photogram.projection import FOCAL, OrientedCameras, seen_at
from photogram.surface.ortho.seamlines import Seams
from photogram.surface.views import Views

PixelsOf = Callable[[int], ByteArray]
"""Gives the pixels (H, W, 3), red, green, blue, of a view by its number."""

MAXIMUM_PLACES = 20_000
"""About so many places are compared, at most."""

LARGEST_HALF_PX = 16
"""A place's colour is the mean of a square that reaches so many pixels to each side at most."""

DARKEST, BRIGHTEST = 8, 247
"""Digital numbers outside of which a pixel says nothing of the exposure."""

CAUCHY = 0.05
"""Scale of the Cauchy weights, in logarithms of colours: a difference of 5 % has half the weight."""

ROUNDS = 10
"""So often the equations are solved with new weights."""

PRIOR_GAIN, PRIOR_FALLOFF = 1.0, 0.5
"""Standard deviations of the logarithm of a gain, and of v, before anything is measured."""


@dataclass(frozen=True, eq=False)
class Balance:
    """By what colours are divided: exp(``log_gain`` (V, 3) + ``falloff`` (V, 3) r²), with r the ideal radius."""

    log_gain: FloatArray
    falloff: FloatArray

    @staticmethod
    def none(views: int) -> Balance:
        """Return the balance that changes nothing."""
        return Balance(np.zeros((views, 3)), np.zeros((views, 3)))


@dataclass(frozen=True, eq=False)
class Samples:
    """Colours of places in photographs: ``place`` (N,), ``view`` (N,), squared ideal radius ``radius2`` (N,), and the
    logarithm of the mean ``colour`` (N, 3)."""

    place: IntArray
    view: IntArray
    radius2: FloatArray
    colour: FloatArray


@njit(cache=True, nogil=True)  # type: ignore[misc, unused-ignore]
def _mean_colours(
    picture: ByteArray,
    cameras: OrientedCameras,
    view: int,
    X: FloatArray,
    side_m: float,
    out: FloatArray,
) -> None:
    """Fill the squared ideal radius and the mean colour (N, 4) of squares around places (N, 3); NaN where they reach
    out of the picture, or hold a pixel too dark or too bright."""
    focal, C = cameras.parameters[cameras.camera[view], FOCAL], cameras.position
    out[:] = np.nan
    for n in range(len(X)):
        u, v, depth = seen_at(cameras, view, X[n])
        if not np.isfinite(u):
            continue
        half = min(max(int(0.5 * side_m * focal / depth), 1), LARGEST_HALF_PX)
        c, r = int(np.rint(u)), int(np.rint(v))
        if c < half or r < half or c + half >= picture.shape[1] or r + half >= picture.shape[0]:
            continue
        total = np.zeros(3)
        good = True
        for i in range(r - half, r + half + 1):
            for j in range(c - half, c + half + 1):
                for k in range(3):
                    value = picture[i, j, k]
                    good = good and DARKEST <= value <= BRIGHTEST
                    total[k] += value
        if good:
            distance2 = (X[n, 0] - C[view, 0]) ** 2 + (X[n, 1] - C[view, 1]) ** 2 + (X[n, 2] - C[view, 2]) ** 2
            out[n, 0] = distance2 / (depth * depth) - 1.0
            for k in range(3):
                out[n, 1 + k] = total[k] / (2 * half + 1) ** 2


def sample_overlaps(
    views: Views, frame: LocalFrame, grid: MapGrid, seams: Seams, pixels_of: PixelsOf, executor: Executor
) -> Samples:
    """Return the colours of common places in the photographs that see them wholly: blocks of the lattice of seams, at
    most some MAXIMUM_PLACES of them."""
    shared = seams.clear.sum(axis=2) >= 2
    stride = max(1, int(np.ceil(np.sqrt(np.count_nonzero(shared) / MAXIMUM_PLACES))))
    lattice = np.zeros_like(shared)
    lattice[stride // 2 :: stride, stride // 2 :: stride] = True
    row, column = np.nonzero(shared & lattice)
    side_m = seams.block_cells * grid.cell_m
    east = grid.west_map_m + (column + 0.5) * side_m
    north = grid.north_map_m - (row + 0.5) * side_m
    X = frame.world_from_map(np.column_stack([east, north, seams.height_map_m[row, column]]))
    listed, clear = seams.candidate[row, column], seams.clear[row, column]

    def read(view: int) -> tuple[IntArray, FloatArray]:
        place = np.flatnonzero(((listed == view) & clear).any(axis=1))
        out = np.empty((len(place), 4))
        if len(place):
            _mean_colours(pixels_of(view), views.cameras, view, X[place], side_m, out)
        good = np.isfinite(out[:, 0])
        return place[good].astype(np.int64), out[good]

    parts = list(executor.map(read, range(len(views))))
    view = np.repeat(np.arange(len(views)), [len(place) for place, _ in parts])
    found = np.concatenate([out for _, out in parts]) if parts else np.zeros((0, 4))
    place = np.concatenate([place for place, _ in parts]) if parts else np.zeros(0, np.int64)
    return Samples(place, view, found[:, 0], np.log(found[:, 1:]))


def balance_exposure(samples: Samples, camera: IntArray) -> Balance:
    """Return gains and falloffs that make the colours of common places agree; ``camera`` (V,) is that of each view.

    The product of all gains is 1 in every channel. A photograph that shares no place with others keeps gain 1.
    """
    log_gain, falloff = np.zeros((len(camera), 3)), np.zeros((len(camera), 3))
    for channel in range(3):
        log_gain[:, channel], falloff[:, channel] = _solve(samples, channel, camera)
    return Balance(log_gain, falloff)


def _solve(samples: Samples, channel: int, camera: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the logarithms of the gains and the falloffs (V,) of one channel."""
    views, cameras = len(camera), int(camera.max(initial=-1)) + 1
    n = len(samples.place)
    row = np.tile(np.arange(n), 2)
    column = np.concatenate([samples.view, views + camera[samples.view]])
    value = np.concatenate([np.ones(n), samples.radius2])
    A = sparse.csr_array((value, (row, column)), shape=(n, views + cameras))
    places = int(samples.place.max(initial=-1)) + 1
    S = sparse.csr_array((np.ones(n), (samples.place, np.arange(n))), shape=(places, n))
    prior = np.concatenate([np.full(views, PRIOR_GAIN**-2.0), np.full(cameras, PRIOR_FALLOFF**-2.0)])
    y, x, weight = samples.colour[:, channel], np.zeros(views + cameras), np.ones(n)
    for _ in range(ROUNDS):
        W = sparse.diags_array(weight)
        share = sparse.diags_array(1.0 / np.maximum(np.asarray(S @ weight), 1e-12))
        SWA, SWy = S @ (W @ A), S @ (weight * y)
        N = A.T @ (W @ A) - SWA.T @ (share @ SWA)
        N = sparse.csc_array(N + sparse.diags_array(prior))
        x = np.atleast_1d(spsolve(N, A.T @ (weight * y) - SWA.T @ (share @ SWy)))
        residual = y - A @ x
        residual -= (share @ (S @ (weight * residual)))[samples.place]
        weight = 1.0 / (1.0 + (residual / CAUCHY) ** 2)
    gain = x[:views]
    met = np.bincount(samples.view, minlength=views) > 0
    gain[met] -= gain[met].mean() if met.any() else 0.0
    return gain, x[views:][camera]
