"""Key points and descriptors of one photograph: SIFT (Lowe 2004) on tiles, RootSIFT descriptors (Arandjelović &
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
from itertools import pairwise
from typing import Annotated, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from photogram.arrays import BoolArray, ByteArray, Float32Array, Int32Array
from photogram.errors import ImageError, check_range
from photogram.machine import memory_bytes
from photogram.settings.settings import Settings, Within
from photogram.sfm.tie_points.gradient_histograms import descriptors, orientations
from photogram.sfm.tie_points.masked import are_clear, clear_px
from photogram.sfm.tie_points.scale_space import extrema, octaves
from photogram.survey import Features


@dataclass(frozen=True)
class FeatureSettings(Settings):
    """How key points are found."""

    maximum: Annotated[int, Within(8, 200_000), "Key points kept per photograph."] = 10000
    contrast_threshold: Annotated[
        float, Within(0, 1), "SIFT's own, on grey values of 0 to 1; lower finds more and weaker key points."
    ] = 0.02
    tile_px: Annotated[int, Within(256, 65_536, "px"), "Side of the tiles, which bound the memory."] = 1536
    overlap_px: Annotated[int, Within(16, 32_768, "px"), "Overlap of the tiles, half a tile at most."] = 96
    cells_per_side: Annotated[int, Within(1, 1000), "Grid over which key points are spread."] = 24
    doubled: Annotated[
        Literal["auto", "yes", "no"], "Look for key points in the doubled picture; `auto`: below 5 Mpx."
    ] = "auto"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("overlap_px", self.overlap_px, 16, self.tile_px / 2)


LARGE_PX = 5_000_000
"""Number of pixels from which a photograph is not doubled, unless wanted."""

SMALLEST_PX = 1.8
"""Size of the smallest key points in the picture that SIFT is given: of its first octave's, in the doubled picture."""

LASTING_PX = 3.0
"""Size, in the picture that SIFT is given, up to which larger key points are found again more often."""


def _tile_edges(length_px: int, tile_px: int) -> NDArray[np.int64]:
    count = max(1, -(-length_px // tile_px))
    return np.linspace(0, length_px, count + 1).round().astype(np.int64)


@dataclass(frozen=True)
class _Tile:
    """A part of a photograph: the rows and columns it answers for, and the pixels it sees, a margin more on every
    side."""

    top: int
    bottom: int
    left: int
    right: int
    v0: int
    u0: int
    grey: ByteArray

    def answers_for(self, table: NDArray[np.float64]) -> NDArray[np.bool_]:
        u, v = table[:, 0], table[:, 1]
        return (u >= self.left - 0.5) & (u < self.right - 0.5) & (v >= self.top - 0.5) & (v < self.bottom - 0.5)


def _tiles(grey: ByteArray, settings: FeatureSettings) -> list[_Tile]:
    rows, columns = _tile_edges(grey.shape[0], settings.tile_px), _tile_edges(grey.shape[1], settings.tile_px)
    margin = settings.overlap_px
    tiles = []
    for top, bottom in pairwise(rows.tolist()):
        for left, right in pairwise(columns.tolist()):
            v0, u0 = max(0, top - margin), max(0, left - margin)
            part = np.ascontiguousarray(grey[v0 : bottom + margin, u0 : right + margin])
            tiles.append(_Tile(top, bottom, left, right, v0, u0, part))
    return tiles


_ORIENTATIONS = 18  # of a key point, at most: every other one of 36 directions


@dataclass(frozen=True, eq=False)
class _Points:
    """Extrema of the scale space, or key points: ``table`` (N, 5) of u, v, size, angle in degrees and response, in
    pixels of the picture; ``origin`` (N, 5) number of the tile and the octave, level, row and column there."""

    table: NDArray[np.float64]
    origin: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.table)

    def only(self, which: NDArray[np.int64] | NDArray[np.bool_]) -> _Points:
        return _Points(self.table[which], self.origin[which])


def _joined(parts: list[_Points]) -> _Points:
    return _Points(np.concatenate([p.table for p in parts]), np.concatenate([p.origin for p in parts]))


def _detected(number: int, tile: _Tile, settings: FeatureSettings, levels: list[Float32Array] | None) -> _Points:
    """Return the extrema that a tile answers for, their angles zero; append what they lie on to ``levels``."""
    parts = [_Points(np.zeros((0, 5)), np.zeros((0, 5), dtype=np.int32))]
    for index, octave in enumerate(octaves(tile.grey, settings.overlap_px)):
        found = extrema(octave, settings.contrast_threshold)
        u, v, size, response = found.place.T
        table = np.column_stack([u + tile.u0, v + tile.v0, size, np.zeros_like(u), response])
        where = np.broadcast_to(np.array([number, index], dtype=np.int32), (len(u), 2))
        points = _Points(table, np.column_stack([where, found.level, found.pixel]))
        parts.append(points.only(tile.answers_for(table) & (size < settings.overlap_px)))
        if levels is not None:
            levels.append(octave.level)
    return _joined(parts)


def _octave(points: _Points, index: int) -> tuple[NDArray[np.int64], Int32Array, Int32Array, Float32Array]:
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


def _roots(descriptor: ByteArray) -> ByteArray:
    """Return RootSIFT descriptors (N, 128) as bytes."""
    total = descriptor.sum(axis=1, keepdims=True, dtype=np.float32)
    share = descriptor / np.maximum(total, np.float32(1e-9))
    return np.asarray(np.clip(np.round(512.0 * np.sqrt(share)), 0, 255), dtype=np.uint8)


def _spread(
    table: NDArray[np.float64], strength: NDArray[np.float64], width_px: int, height_px: int, settings: FeatureSettings
) -> NDArray[np.int64]:
    """Return the indices of at most ``maximum`` key points, the strongest of every cell first."""
    cells = settings.cells_per_side
    column = np.clip((table[:, 0] / width_px * cells).astype(np.int64), 0, cells - 1)
    row = np.clip((table[:, 1] / height_px * cells).astype(np.int64), 0, cells - 1)
    cell = row * cells + column
    order = np.lexsort((table[:, 3], table[:, 0], table[:, 1], -strength, cell))
    starts = np.searchsorted(cell[order], np.arange(cells * cells))
    rank = np.arange(len(order)) - starts[cell[order]]
    chosen = order[np.lexsort((order, -strength[order], rank))[: settings.maximum]]
    return np.asarray(chosen[np.lexsort((table[chosen, 3], table[chosen, 0], table[chosen, 1]))])


HELD_PX = 3_000_000
"""Pixels of a picture, at most, whose scale space is held until its key points are described."""

BYTES_PER_PIXEL = 260
"""Memory that SIFT takes for each pixel of a tile, of the photograph at full size where it is not doubled."""


def photographs_at_once(pixels: int) -> int:
    """Return in how many photographs of so many pixels key points may be found at once, within half of the memory."""
    tile = min(pixels, (FeatureSettings.tile_px + 2 * FeatureSettings.overlap_px) ** 2)
    need = BYTES_PER_PIXEL * tile + 16 * pixels
    return max(1, int(0.5 * memory_bytes() // need))


def _reduced(grey: ByteArray, factor: int) -> ByteArray:
    """Return the picture at 1/``factor`` of its size, every pixel the mean of those it stands for."""
    if factor == 1:
        return grey
    height, width = grey.shape[0] // factor, grey.shape[1] // factor
    whole = grey[: height * factor, : width * factor]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def picture_scale(pixels: int, settings: FeatureSettings, reduction: int = 1) -> int:
    """Return by what a photograph of so many ``pixels`` is divided to make the picture that SIFT is given (and
    doubles): ``reduction``, and twice that where the doubled picture would hold too much."""
    large = settings.doubled == "auto" and pixels >= LARGE_PX * reduction**2
    return 2 * reduction if large or settings.doubled == "no" else reduction


def coarseness(pixels: int, settings: FeatureSettings, reduction: int) -> float:
    """Return how many times coarser than without ``reduction`` the picture is in which key points are found."""
    return picture_scale(pixels, settings, reduction) / picture_scale(pixels, settings)


def find_features(
    name: str, pixels: ByteArray, settings: FeatureSettings, reduction: int = 1, used: BoolArray | None = None
) -> Features:
    """Find key points in the photograph ``name`` with red, green, blue ``pixels`` (H, W, 3) uint8, sorted by row, then
    column; places in px, the centre of the top-left pixel at (0, 0).

    ``reduction`` 2 or 4 looks for them in the picture at half or quarter size; places and sizes are always in pixels of
    the whole photograph. ``used`` (H, W) are the pixels that its mask leaves: a key point lies in them, and what is
    left out begins farther away than its size. Raises ImageError when it shows too little texture to be matched; with
    a mask it may have few key points, or none.
    """
    grey = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    factor = picture_scale(grey.size, settings, reduction)
    clear = None if used is None else clear_px(used)
    table, descriptor = _found(name, _reduced(grey, factor), settings, factor, reduction, clear)
    place = _in_photograph(table[:, :2], factor)
    height, width = grey.shape
    column = np.clip(np.round(place[:, 0]).astype(np.int64), 0, width - 1)
    row = np.clip(np.round(place[:, 1]).astype(np.int64), 0, height - 1)
    return Features(place, factor * table[:, 2], np.deg2rad(table[:, 3]), descriptor, pixels[row, column].copy())


def _in_photograph(place: NDArray[np.float64], factor: int) -> NDArray[np.float64]:
    """Return places (N, 2) of a picture at 1/``factor`` of the size in pixels of the whole photograph."""
    return factor * (place + 0.5) - 0.5


def _found(
    name: str, grey: ByteArray, settings: FeatureSettings, factor: int, reduction: int, clear: Float32Array | None
) -> tuple[NDArray[np.float64], ByteArray]:
    """Return key points (N, 5), as _Points, and descriptors (N, 128) of a picture at 1/``factor`` of the size, in its
    own pixels; ``clear`` are those of `clear_px` of the whole photograph, None without a mask."""
    height, width = grey.shape
    halved = factor > reduction
    tiles = _tiles(grey, settings)
    # those of a picture too large to hold are made again for what is wanted of them
    held: list[list[Float32Array]] | None = [[] for _ in tiles] if grey.size <= HELD_PX else None
    every = _joined([_detected(n, t, settings, None if held is None else held[n]) for n, t in enumerate(tiles)])

    def levels(number: int) -> Iterable[Float32Array]:
        if held is not None:
            return held[number]
        return (o.level for o in octaves(tiles[number].grey, settings.overlap_px, inner_only=True))

    def wanted(points: _Points) -> _Points:
        size, response = points.table[:, 2], points.table[:, 4]
        strength = response * np.minimum(size, LASTING_PX) ** 2 if halved else response
        return points.only(_spread(points.table, strength, width, height, settings))

    if clear is not None:
        every = every.only(are_clear(clear, _in_photograph(every.table[:, :2], factor), factor * every.table[:, 2]))
    # several orientations of one point only take the places of weaker ones: no other point can come to be wanted
    every = wanted(every)
    every = _joined([_oriented(every.only(every.origin[:, 0] == n), levels(n)) for n in range(len(tiles))])
    if len(every) < 8 and clear is None:
        raise ImageError(
            f"{name}: only {len(every)} key points found in {width} x {height} px: the photograph is blank, "
            "blurred or black; remove it, or lower features.contrast_threshold"
        )
    every = wanted(every)
    descriptor = np.zeros((len(every), 128), dtype=np.uint8)
    for n in range(len(tiles)):
        own = every.origin[:, 0] == n
        descriptor[own] = _described(every.only(own), levels(n))
    return every.table, _roots(descriptor)
