"""Exposure balance: one gain per channel for every photograph, and the fall of light towards its corners.

The colour of a place in a photograph is taken as gain · falloff · colour, with falloff exp(v r²), r the ideal radius
and v of the camera. In logarithms this is linear; the colour of each place is eliminated, and what remains is solved by
least squares with Cauchy weights (Holland & Welsch 1977), because shadows move and surfaces shine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from photogram.arrays import ByteArray, FloatArray, Int32Array, IntArray
from photogram.compilation import njit
from photogram.projection import FOCAL, OrientedCameras, seen_called
from photogram.surface.ortho.seamlines import Lattice
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

WHITE_DN, KNEE_DN = 255.0, 200.0
"""The brightest digital number, and that from which on brighter ones are drawn together where balancing would make them
brighter than that."""

BRIGHTEST_SHARE = 0.999
"""Share of the places that shall not be made white."""

ROUNDS, STEADY = 10, 1e-4
"""So often the equations are solved with new weights, at most; until no logarithm changes by more, a fortieth of a
grey level."""

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


@njit(cache=True, nogil=True, _nrt=False)
def _mean_colours(
    picture: ByteArray,
    cameras: OrientedCameras,
    view: int,
    X: FloatArray,
    side_m: float,
    out: FloatArray,
    total: FloatArray,
) -> None:
    """Fill the squared ideal radius and the mean colour (N, 4) of squares around places (N, 3); the radius NaN where
    they reach out of the picture, or hold a pixel too dark or too bright. ``total`` (3,) is room."""
    focal, C = cameras.parameters[cameras.camera[view], FOCAL], cameras.position
    for n in range(len(X)):
        out[n, 0] = np.nan
        u, v, depth = seen_called(cameras, view, X[n, 0], X[n, 1], X[n, 2])
        if not np.isfinite(u):
            continue
        half = min(max(int(0.5 * side_m * focal / depth), 1), LARGEST_HALF_PX)
        c, r = int(np.rint(u)), int(np.rint(v))
        if c < half or r < half or c + half >= picture.shape[1] or r + half >= picture.shape[0]:
            continue
        good = True
        for k in range(3):
            total[k] = 0.0
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


@dataclass(frozen=True, eq=False)
class Places:
    """Blocks of a lattice at which photographs are compared: their ``row`` and ``column``, and the side of a block."""

    row: IntArray
    column: IntArray
    side_m: float

    @staticmethod
    def of(lattice: Lattice, cell_m: float) -> Places:
        """Return at most some MAXIMUM_PLACES blocks that at least two photographs show, regularly spread."""
        shared = (lattice.candidate >= 0).sum(axis=2) >= 2
        stride = max(1, int(np.ceil(np.sqrt(np.count_nonzero(shared) / MAXIMUM_PLACES))))
        chosen = np.zeros_like(shared)
        chosen[stride // 2 :: stride, stride // 2 :: stride] = True
        row, column = np.nonzero(shared & chosen)
        return Places(row, column, lattice.block_cells * cell_m)


def colours_in(
    views: Views, lattice: Lattice, places: Places, view: int, picture: ByteArray
) -> tuple[IntArray, FloatArray]:
    """Return which places (N,) a photograph sees wholly, and its squared ideal radius and its mean colour (N, 4)
    there. The photograph must have been looked at."""
    listed = (lattice.candidate[places.row, places.column] == view) & lattice.clear[places.row, places.column]
    place = np.flatnonzero(listed.any(axis=1))
    X = lattice.centre_world_m[places.row[place], places.column[place]]
    out = np.empty((len(place), 4))
    _mean_colours(picture, views.cameras, view, X, places.side_m, out, np.empty(3))
    good = np.isfinite(out[:, 0])
    return place[good].astype(np.int64), out[good]


def joined(parts: Sequence[tuple[IntArray, FloatArray]]) -> Samples:
    """Return the samples of what ``colours_in`` gives for every view in turn."""
    view = np.repeat(np.arange(len(parts)), [len(place) for place, _ in parts])
    colour = np.concatenate([out for _, out in parts]) if parts else np.zeros((0, 4))
    place = np.concatenate([place for place, _ in parts]) if parts else np.zeros(0, np.int64)
    return Samples(place, view, colour[:, 0], np.log(colour[:, 1:]))


def highlight_curve(lattice: Lattice, label: Int32Array, log_gain: FloatArray) -> float:
    """Return the c of x / (1 + c x), by which what is brighter than KNEE_DN by x becomes brighter, so that no more than
    the brightest places of the blocks, with their labels (R, C), are white; 0 where balancing makes none so bright."""
    at = np.argmax(lattice.candidate == label[..., None], axis=2)
    grey = np.take_along_axis(lattice.grey, at[..., None, None], axis=2)[..., 0, :]
    balanced = grey[label >= 0] * np.exp(-log_gain[label[label >= 0]])[:, None]
    brightest = float(np.quantile(balanced, BRIGHTEST_SHARE)) if balanced.size else WHITE_DN
    beyond, room = brightest - KNEE_DN, WHITE_DN - KNEE_DN
    return max(beyond - room, 0.0) / (beyond * room) if beyond > 0.0 else 0.0


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
    y = samples.colour[:, channel]
    x = np.zeros(views + cameras)
    weight = np.ones(n)
    for _ in range(ROUNDS):
        W = sparse.diags_array(weight)
        share = sparse.diags_array(1.0 / np.maximum(np.asarray(S @ weight), 1e-12))
        SWA, SWy = S @ (W @ A), S @ (weight * y)
        N = A.T @ (W @ A) - SWA.T @ (share @ SWA)
        N = sparse.csc_array(N + sparse.diags_array(prior))
        before, x = x, np.atleast_1d(spsolve(N, A.T @ (weight * y) - SWA.T @ (share @ SWy)))
        if np.abs(x - before).max(initial=0.0) < STEADY:
            break
        residual = y - A @ x
        residual -= (share @ (S @ (weight * residual)))[samples.place]
        weight = 1.0 / (1.0 + (residual / CAUCHY) ** 2)
    gain = x[:views]
    met = np.bincount(samples.view, minlength=views) > 0
    gain[met] -= gain[met].mean() if met.any() else 0.0
    return gain, x[views:][camera]
