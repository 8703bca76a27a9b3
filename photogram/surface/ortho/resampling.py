"""Photographs read between their pixels, and where a pixel stands for less than a cell, averaged over the cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photogram.arrays import ByteArray, Float32Array, FloatArray, Int32Array
from photogram.compilation import njit
from photogram.projection import FOCAL, OrientedCameras, seen_at, seen_called


@njit(cache=True, nogil=True, error_model="numpy")
def catmull_rom(t: float, weight: FloatArray) -> None:
    """Fill the weights (4,) of four equidistant values for the place t, 0 to 1, between the middle two (Keys 1981,
    eq. 8, a = −1/2)."""
    weight[0] = t * (-0.5 + t * (1.0 - 0.5 * t))
    weight[1] = 1.0 + t * t * (1.5 * t - 2.5)
    weight[2] = t * (0.5 + t * (2.0 - 1.5 * t))
    weight[3] = t * t * (0.5 * t - 0.5)


@njit(cache=True, nogil=True, error_model="numpy")
def add_cubic(
    picture: ByteArray, u: float, v: float, scale: float, across: FloatArray, down: FloatArray, out: FloatArray
) -> None:
    """Add ``scale`` times the colour at the pixel (u, v) to ``out`` (3,); ``across`` and ``down`` (4,) are for use in
    here. Beyond its border a photograph goes on with the border."""
    height, width = picture.shape[0], picture.shape[1]
    c, r = int(np.floor(u)), int(np.floor(v))
    catmull_rom(u - c, across)
    catmull_rom(v - r, down)
    red, green, blue = out[0], out[1], out[2]
    for i in range(4):
        row = min(max(r - 1 + i, 0), height - 1)
        for j in range(4):
            column = min(max(c - 1 + j, 0), width - 1)
            w = scale * down[i] * across[j]
            red += w * picture[row, column, 0]
            green += w * picture[row, column, 1]
            blue += w * picture[row, column, 2]
    out[0], out[1], out[2] = red, green, blue


@njit(cache=True, nogil=True, error_model="numpy")
def add_linear(picture: ByteArray, u: float, v: float, scale: float, out: FloatArray) -> None:
    """Add ``scale`` times the colour at the pixel (u, v), bilinear, to ``out`` (3,)."""
    height, width = picture.shape[0], picture.shape[1]
    c, r = int(np.floor(u)), int(np.floor(v))
    for i in range(2):
        row = min(max(r + i, 0), height - 1)
        down = v - r if i else 1.0 - (v - r)
        for j in range(2):
            column = min(max(c + j, 0), width - 1)
            w = scale * down * (u - c if j else 1.0 - (u - c))
            for k in range(3):
                out[k] += w * picture[row, column, k]


TONE_STEPS = 1024
"""Parts of the squared ideal radii of a photograph between which the tone is linear."""


@dataclass(frozen=True, eq=False)
class Tone:
    """By what the colours of a photograph are multiplied: ``factor`` (TONE_STEPS + 1, 3) at squared ideal radii that
    are ``1 / per_radius2`` apart."""

    factor: FloatArray
    per_radius2: float

    @staticmethod
    def of(log_gain: FloatArray, falloff: FloatArray, largest_radius2: float) -> Tone:
        """Return exp(−g − v r²) for the logarithms of gains g (3,) and falls of light v (3,)."""
        per_radius2 = TONE_STEPS / max(largest_radius2, 1e-6)
        radius2 = np.arange(TONE_STEPS + 1)[:, None] / per_radius2
        return Tone(np.exp(-log_gain - falloff * radius2), per_radius2)


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def add_photograph(
    number: int,
    picture: ByteArray,
    cameras: OrientedCameras,
    tone: tuple[FloatArray, float],
    place: FloatArray,
    sides: tuple[FloatArray, FloatArray],
    label: Int32Array,
    weight: Float32Array,
    out: Float32Array,
    room: FloatArray,
) -> None:
    """Add to ``out`` (R, C, 3) what the photograph ``number`` contributes to each cell.

    Colours are multiplied by its ``tone``: factors, and how many there are per squared ideal radius. ``place`` (R, C,
    3) are the centres of the cells on the surface, ``sides`` the steps (3,) to the next cell in the east and the south;
    ``label`` and ``weight`` (R, C, 4) say which photographs a cell is made of, −1 for none. Cells that are larger than
    a pixel are sampled at as many places as they have pixels, at the height of their centre. ``room`` is (4, 4).
    """
    focal, C = cameras.parameters[cameras.camera[number], FOCAL], cameras.position
    factor, per_radius2 = tone
    X, colour, across, down = room[0, :3], room[1, :3], room[2], room[3]
    side = np.sqrt(sides[0][0] ** 2 + sides[0][1] ** 2 + sides[0][2] ** 2)
    for i in range(label.shape[0]):
        for j in range(label.shape[1]):
            w = 0.0
            for k in range(4):
                if label[i, j, k] < 0:
                    break
                if label[i, j, k] == number:
                    w += weight[i, j, k]
            if w == 0.0:
                continue
            for k in range(3):
                X[k] = place[i, j, k]
                colour[k] = 0.0
            u, v, depth = seen_at(cameras, number, X)
            n = int(np.ceil(side * focal / depth - 0.5))
            if n <= 1:
                add_cubic(picture, u, v, 1.0, across, down, colour)
            else:
                _add_cell(picture, cameras, number, X, sides, n, colour)
            distance2 = (X[0] - C[number, 0]) ** 2 + (X[1] - C[number, 1]) ** 2 + (X[2] - C[number, 2]) ** 2
            step = min(max(distance2 / (depth * depth) - 1.0, 0.0) * per_radius2, TONE_STEPS - 1e-6)
            m = int(step)
            share = step - m
            for k in range(3):
                out[i, j, k] += w * colour[k] * (factor[m, k] + share * (factor[m + 1, k] - factor[m, k]))


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _add_cell(
    picture: ByteArray,
    cameras: OrientedCameras,
    number: int,
    X: FloatArray,
    sides: tuple[FloatArray, FloatArray],
    n: int,
    colour: FloatArray,
) -> None:
    """Add the mean over n × n places of a cell centred at X (3,); its image is taken as a parallelogram."""
    u, v, _ = seen_called(cameras, number, X[0], X[1], X[2])
    east, south = sides
    for k in range(3):
        X[k] += east[k]
    du, dv, _ = seen_called(cameras, number, X[0], X[1], X[2])
    for k in range(3):
        X[k] += south[k] - east[k]
    eu, ev, _ = seen_called(cameras, number, X[0], X[1], X[2])
    for k in range(3):
        X[k] -= south[k]
    if not np.isfinite(du + dv + eu + ev):
        du, dv, eu, ev = u, v, u, v
    for a in range(n):
        s = (a + 0.5) / n - 0.5
        for b in range(n):
            t = (b + 0.5) / n - 0.5
            add_linear(picture, u + s * (du - u) + t * (eu - u), v + s * (dv - v) + t * (ev - v), 1.0 / (n * n), colour)
