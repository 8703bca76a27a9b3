"""SIFT (Lowe 2004) on tiles, RootSIFT descriptors (Arandjelović &
Zisserman 2012).

Tiles bound the memory (SIFT doubles the picture before it starts), and the strongest key points are taken cell by
cell, so that they spread over the whole photograph.

The doubled picture of a large photograph holds many times more key points than are wanted, and its smallest ones are
hardly ever found again in another photograph. There SIFT is given the picture at half its size, whose doubling is the
first octave at full size: a quarter of the work.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array, IntArray
from photogram.sfm.tie_points.detector import FeatureSettings, KeyPoints, Picture, Traits
from photogram.sfm.tie_points.gradient_histograms import descriptors, orientations
from photogram.sfm.tie_points.picture_tiles import Tile, picture_tiles, spread
from photogram.sfm.tie_points.scale_space import extrema, octaves

LARGE_PX = 5_000_000
"""Number of pixels from which a photograph is not doubled, unless wanted."""

LASTING_PX = 3.0
"""Size, in the picture that SIFT is given, up to which larger key points are found again more often."""

SIFT_TRAITS = Traits(
    metric="euclidean",
    descriptor_bytes=128,
    smallest_px=1.8,  # of the first octave, in the doubled picture
    size_exponent=1 / 3,
    seconds_per_mpx=0.45,
    bytes_per_px=240.0,  # the scale space is twice as wide and high; measured on tiles of 800 and of 1728 px
    key_points_per_mpx=6000.0,
)

_ORIENTATIONS = 18  # of a key point, at most: every other one of 36 directions


@dataclass(frozen=True, eq=False)
class _Points:
    """Extrema of the scale space, or key points: ``table`` (N, 5) of u, v, size, angle in degrees and response, in
    pixels of the picture; ``origin`` (N, 5) number of the tile and the octave, level, row and column there."""

    table: FloatArray
    origin: Int32Array

    def __len__(self) -> int:
        return len(self.table)

    def only(self, which: IntArray | BoolArray) -> _Points:
        return _Points(self.table[which], self.origin[which])


def _joined(parts: list[_Points]) -> _Points:
    return _Points(np.concatenate([p.table for p in parts]), np.concatenate([p.origin for p in parts]))


def _detected(number: int, tile: Tile, settings: FeatureSettings, levels: list[Float32Array] | None) -> _Points:
    """Return the extrema that a tile answers for, their angles zero; append what they lie on to ``levels``."""
    parts = [_Points(np.zeros((0, 5)), np.zeros((0, 5), dtype=np.int32))]
    for index, octave in enumerate(octaves(tile.grey, settings.overlap_px)):
        peaks = extrema(octave, settings.contrast_threshold)
        u, v, size, response = peaks.place.T
        table = np.column_stack([u + tile.u0, v + tile.v0, size, np.zeros_like(u), response])
        where = np.broadcast_to(np.array([number, index], dtype=np.int32), (len(u), 2))
        points = _Points(table, np.column_stack([where, peaks.level, peaks.pixel]))
        parts.append(points.only(tile.answers_for(table[:, :2]) & (size < settings.overlap_px)))
        if levels is not None:
            levels.append(octave.level)
    return _joined(parts)


def _octave(points: _Points, index: int) -> tuple[IntArray, Int32Array, Int32Array, Float32Array]:
    """Return which points (K,) lie in an octave, and the level (K,), pixel (K, 2) and scale (K,) of each there."""
    own = np.flatnonzero(points.origin[:, 1] == index)
    layer, pixel = (np.ascontiguousarray(points.origin[own, columns]) for columns in (2, slice(3, 5)))
    return own, layer, pixel, (points.table[own, 2] / 2**index).astype(np.float32)


def _oriented(points: _Points, levels: Iterable[Float32Array]) -> _Points:
    """Return the key points that become of extrema of one tile, one for every orientation."""
    parts = [points.only(np.zeros(0, dtype=np.int64))]
    for index, level in enumerate(levels):
        own, layer, pixel, sigma = _octave(points, index)
        angle = np.empty((len(own), _ORIENTATIONS), dtype=np.float32)
        orientations(level, layer, pixel, sigma, float(sigma.max(initial=0.0)), angle)
        row, column = np.nonzero(np.isfinite(angle))
        key_points = points.only(own[row])
        key_points.table[:, 3] = angle[row, column]
        parts.append(key_points)
    return _joined(parts)


def _described(points: _Points, levels: Iterable[Float32Array]) -> ByteArray:
    """Return the SIFT descriptors (N, 128) of key points of one tile."""
    descriptor = np.zeros((len(points), 128), dtype=np.uint8)
    for index, level in enumerate(levels):
        own, layer, pixel, sigma = _octave(points, index)
        described = np.empty((len(own), 128), dtype=np.uint8)
        angle = points.table[own, 3].astype(np.float32)
        descriptors(level, layer, pixel, sigma, float(sigma.max(initial=0.0)), angle, described)
        descriptor[own] = described
    return descriptor


def root_sift(descriptor: ByteArray) -> ByteArray:
    """Return RootSIFT descriptors (N, 128) as bytes."""
    total = descriptor.sum(axis=1, keepdims=True, dtype=np.float32)
    share = descriptor / np.maximum(total, np.float32(1e-9))
    return np.asarray(np.clip(np.round(512.0 * np.sqrt(share)), 0, 255), dtype=np.uint8)


def lasting_strength(picture: Picture, size_px: FloatArray, response: FloatArray) -> FloatArray:
    """Return the strength (N,) by which key points are chosen: in a photograph that is not doubled, larger ones first,
    up to LASTING_PX."""
    return response * np.minimum(size_px, LASTING_PX) ** 2 if picture.scale > picture.reduction else response


KEPT_PX = 3_000_000
"""Pixels of a picture, at most, whose scale space is kept until its key points are described."""


class Sift:
    """SIFT in one scale space."""

    traits = SIFT_TRAITS

    def scale(self, pixels: int, settings: FeatureSettings, reduction: int = 1) -> int:
        """Return by what a photograph of so many ``pixels`` is divided to make the picture that is doubled:
        ``reduction``, and twice that where the doubled picture would hold too much."""
        large = settings.doubled == "auto" and pixels >= LARGE_PX * reduction**2
        return 2 * reduction if large or settings.doubled == "no" else reduction

    def detect(self, picture: Picture, settings: FeatureSettings) -> KeyPoints:
        """Return key points with RootSIFT descriptors, as `Detector` says."""
        tiles = picture_tiles(picture.grey, settings)
        # those of a picture too large to keep are made again for what is wanted of them
        kept: list[list[Float32Array]] | None = [[] for _ in tiles] if picture.grey.size <= KEPT_PX else None
        every = _joined([_detected(n, t, settings, None if kept is None else kept[n]) for n, t in enumerate(tiles)])

        def levels(number: int) -> Iterable[Float32Array]:
            if kept is not None:
                return kept[number]
            return (o.level for o in octaves(tiles[number].grey, settings.overlap_px, inner_only=True))

        def wanted(points: _Points) -> _Points:
            place, angle_deg = points.table[:, :2], points.table[:, 3]
            strength = lasting_strength(picture, points.table[:, 2], points.table[:, 4])
            return points.only(spread(place, angle_deg, strength, picture.grey.shape, settings))

        # several orientations of one point only take the places of weaker ones: no other point can come to be wanted
        every = wanted(every.only(picture.leaves(every.table[:, :2], every.table[:, 2])))
        every = wanted(_joined([_oriented(every.only(every.origin[:, 0] == n), levels(n)) for n in range(len(tiles))]))
        descriptor = np.zeros((len(every), 128), dtype=np.uint8)
        for n in range(len(tiles)):
            own = every.origin[:, 0] == n
            descriptor[own] = _described(every.only(own), levels(n))
        return KeyPoints(every.table[:, :2], every.table[:, 2], every.table[:, 3], root_sift(descriptor))


DETECTOR = Sift()
