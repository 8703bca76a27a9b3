"""Key points and descriptors of one photograph: SIFT (Lowe 2004) on tiles, RootSIFT descriptors (Arandjelović &
Zisserman 2012).

Tiles bound the memory (SIFT doubles the picture before it starts), and the strongest key points are taken cell by
cell, so that they spread over the whole photograph.

The doubled picture of a large photograph holds many times more key points than are wanted, and its smallest ones are
hardly ever found again in another photograph. There SIFT is given the picture at half its size, whose doubling is the
first octave at full size: a quarter of the work.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray
from photogram.errors import ImageError, check_range
from photogram.machine import memory_bytes
from photogram.survey import Features


@dataclass(frozen=True)
class FeatureSettings:
    """How key points are found."""

    maximum: int = 10000  # key points kept per photograph
    contrast_threshold: float = 0.02  # SIFT's own, on grey values of 0 to 1
    tile_px: int = 1536
    overlap_px: int = 96
    cells_per_side: int = 24  # the grid over which key points are spread
    doubled: Literal["auto", "yes", "no"] = "auto"  # look for key points in the doubled picture; auto: if it is small

    def __post_init__(self) -> None:
        check_range("maximum", self.maximum, 8)
        check_range("contrast_threshold", self.contrast_threshold, 0.0, 1.0)
        check_range("tile_px", self.tile_px, 256)
        check_range("overlap_px", self.overlap_px, 16, self.tile_px / 2)
        check_range("cells_per_side", self.cells_per_side, 1, 1000)


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


_COLUMNS = 6  # u, v, size, angle in degrees, response, octave


def _detect(sift: cv2.SIFT, tile: _Tile, settings: FeatureSettings) -> NDArray[np.float64]:
    """Return the key points (N, 6) that a tile answers for, in pixels of the photograph."""
    found = [
        (k.pt[0] + tile.u0, k.pt[1] + tile.v0, k.size, k.angle, k.response, k.octave)
        for k in sift.detect(tile.grey, None)
    ]
    table = np.array(found, dtype=np.float64).reshape(-1, _COLUMNS)
    return table[tile.answers_for(table) & (table[:, 2] < settings.overlap_px)]


def _describe(sift: cv2.SIFT, tile: _Tile, table: NDArray[np.float64]) -> ByteArray:
    """Return RootSIFT descriptors (N, 128) as bytes of key points (N, 6) in a tile."""
    if not len(table):
        return np.zeros((0, 128), dtype=np.uint8)
    points = [
        cv2.KeyPoint(u - tile.u0, v - tile.v0, size, angle, response, int(octave))
        for u, v, size, angle, response, octave in table.tolist()
    ]
    kept, descriptor = sift.compute(tile.grey, points)
    if len(kept) != len(points):
        raise AssertionError("SIFT dropped key points of its own detection")
    share = descriptor / np.maximum(descriptor.sum(axis=1, keepdims=True), 1e-9)
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


def find_features(name: str, pixels: ByteArray, settings: FeatureSettings, reduction: int = 1) -> Features:
    """Find key points in the photograph ``name`` with red, green, blue ``pixels`` (H, W, 3) uint8, sorted by row, then
    column; places in px, the centre of the top-left pixel at (0, 0).

    ``reduction`` 2 or 4 looks for them in the picture at half or quarter size; places and sizes are always in pixels of
    the whole photograph. Raises ImageError when it shows too little texture to be matched.
    """
    grey = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    factor = picture_scale(grey.size, settings, reduction)
    table, descriptor = _found(name, _reduced(grey, factor), settings, factor > reduction)
    place = factor * (table[:, :2] + 0.5) - 0.5
    height, width = grey.shape
    column = np.clip(np.round(place[:, 0]).astype(np.int64), 0, width - 1)
    row = np.clip(np.round(place[:, 1]).astype(np.int64), 0, height - 1)
    return Features(place, factor * table[:, 2], np.deg2rad(table[:, 3]), descriptor, pixels[row, column].copy())


def _found(
    name: str, grey: ByteArray, settings: FeatureSettings, halved: bool
) -> tuple[NDArray[np.float64], ByteArray]:
    """Return key points (N, 6) and descriptors (N, 128) of a picture, in its own pixels."""
    height, width = grey.shape
    sift = cv2.SIFT.create(contrastThreshold=settings.contrast_threshold, enable_precise_upscale=True)
    tiles = _tiles(grey, settings)
    table = np.concatenate([_detect(sift, tile, settings) for tile in tiles])
    if len(table) < 8:
        raise ImageError(
            f"{name}: only {len(table)} key points found in {width} x {height} px: the photograph is blank, "
            "blurred or black; remove it, or lower features.contrast_threshold"
        )
    strength = table[:, 4] * np.minimum(table[:, 2], LASTING_PX) ** 2 if halved else table[:, 4]
    table = table[_spread(table, strength, width, height, settings)]
    descriptor = np.zeros((len(table), 128), dtype=np.uint8)
    for tile in tiles:
        own = tile.answers_for(table)
        descriptor[own] = _describe(sift, tile, table[own])
    return table, descriptor
