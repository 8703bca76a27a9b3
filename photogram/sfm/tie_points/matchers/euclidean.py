"""The nearest descriptors of two photographs, both ways, from one table of their dot products.

The table is made tile by tile and read while it is in the cache; nothing of it is kept but the two smallest distances
of every row and the smallest of every column. Distances are whole numbers of 24 bits, so that distance and place fit
into one 32-bit number, whose minimum is the nearest, the first of those equally near.

Where the processor multiplies whole numbers (byte_distances), it does; elsewhere the products come from BLAS in single
precision, which holds these numbers exactly. The result is the same on any machine.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, Float32Array, Int32Array, IntArray
from photogram.compilation import njit
from photogram.sfm.tie_points.matchers.byte_distances import WIDE, distances_of_tile, usable_tiles
from photogram.sfm.tie_points.matchers.nearest import NearestDescriptors

Uint32Array = NDArray[np.uint32]
WholeArray = NDArray[np.integer[Any]]

LONGEST = 128
"""Bytes of a descriptor, at most: squared distances stay below FAR."""

FAR = 1 << 23
"""Added to the squared distances of descriptors that fill up the last tile."""

_PLACES = 256  # panels of columns whose number goes with a distance
_NONE = (1 << 32) - 1
_BLOCK = 80 * 12  # rows of the table that BLAS makes at once

_TILES = usable_tiles()
_TILE = (*_TILES, WIDE)[0]
_HEIGHT, _WIDTH, _TOGETHER = _TILE.rows, _TILE.columns, _TILE.together
_read_tile_of_numbers = distances_of_tile(_TILE)


@njit(cache=True, nogil=True)
def _read_tile(
    product: Float32Array, corner: tuple[int, int], start: int, place: int, norm: Uint32Array, norms: Uint32Array,
    best: Uint32Array, second: Uint32Array, back: Int32Array, least: Uint32Array,
) -> None:  # fmt: skip
    """Take a tile of a table of products into account, as distances_of_tile does; row 0 of the table is ``start``."""
    top, left = corner
    column = np.empty(_WIDTH, dtype=np.uint32)
    column[:] = _NONE
    for r in range(len(best)):
        products, own_norm, smallest, next_smallest = product[top + r], norm[top + r], best[r], second[r]
        for c in range(_WIDTH):
            doubled = np.uint32(np.int32(products[left + c]) << 9)
            distance = np.uint32(own_norm + norms[left + c] - doubled)
            here = np.uint32(distance + place)
            larger = max(here, smallest[c])
            next_smallest[c] = min(larger, next_smallest[c])
            smallest[c] = min(here, smallest[c])
            column[c] = min(np.uint32(distance + r), column[c])
    for c in range(_WIDTH):
        distance = column[c] >> 8
        if distance < least[left + c]:
            back[left + c] = start + top + (column[c] & 255)
            least[left + c] = distance


@njit(cache=True, nogil=True)
def _close_row(start: int, best: Uint32Array, second: Uint32Array, nearest: Int32Array, distance: Int32Array) -> None:
    """Compare the two smallest distances of a row, ``start`` columns from the left, with those found before."""
    at, smallest, next_smallest = 0, _NONE, _NONE
    for c in range(_WIDTH):
        if best[c] < smallest:
            at, smallest, next_smallest = c, best[c], smallest
        elif best[c] < next_smallest:
            next_smallest = best[c]
        if second[c] < next_smallest:
            next_smallest = second[c]
    near, next_near = smallest >> 8, next_smallest >> 8
    if near < distance[0]:
        nearest[0] = start + (smallest & 255) * _WIDTH + at
        distance[1] = min(distance[0], next_near)
        distance[0] = near
    elif near < distance[1]:
        distance[1] = near


@njit(cache=True, nogil=True)
def _nearest_by_numbers(
    first: WholeArray, second: WholeArray, norm: Uint32Array, norms: Uint32Array,
    nearest: Int32Array, distance: Int32Array, back: Int32Array, least: Uint32Array,
) -> None:  # fmt: skip
    """Fill ``nearest`` (N,), ``distance`` (N, 2), ``back`` and ``least`` (M,) from numbers (N, G · together) and
    (M / columns, G · columns · together) in the tile's order, N and M whole tiles."""
    height, width, groups = _HEIGHT, _WIDTH, first.shape[1] // _TOGETHER
    best, lower = np.empty((height, width), dtype=np.uint32), np.empty((height, width), dtype=np.uint32)
    for left in range(0, len(second), _PLACES):
        for top in range(0, len(first), height):
            best[:] = _NONE
            lower[:] = _NONE
            for panel in range(left, min(left + _PLACES, len(second))):
                own = 4 * width * panel  # bytes of the arrays of columns to the left
                _read_tile_of_numbers(
                    first.ctypes.data + top * 4 * groups, second.ctypes.data + own * groups, groups,
                    norm.ctypes.data + 4 * top, norms.ctypes.data + own, panel - left, top,
                    best.ctypes.data, lower.ctypes.data, back.ctypes.data + own, least.ctypes.data + own,
                )  # fmt: skip
            for r in range(height):
                _close_row(left * width, best[r], lower[r], nearest[top + r : top + r + 1], distance[top + r])


@njit(cache=True, nogil=True)
def _nearest_in_rows(
    product: Float32Array, start: int, norm: Uint32Array, norms: Uint32Array,
    nearest: Int32Array, distance: Int32Array, back: Int32Array, least: Uint32Array,
) -> None:  # fmt: skip
    """Fill as _nearest_by_numbers for the rows from ``start`` on, whose products with all columns are there."""
    height, width = _HEIGHT, _WIDTH
    best, lower = np.empty((height, width), dtype=np.uint32), np.empty((height, width), dtype=np.uint32)
    for left in range(0, product.shape[1], _PLACES * width):
        right = min(left + _PLACES * width, product.shape[1])
        for top in range(0, len(product), height):
            best[:] = _NONE
            lower[:] = _NONE
            for place in range((right - left) // width):
                corner = top, left + place * width
                _read_tile(product, corner, start, place, norm, norms, best, lower, back, least)
            for r in range(height):
                _close_row(left, best[r], lower[r], nearest[top + r : top + r + 1], distance[top + r])


def _padded(descriptor: ByteArray, tile: int) -> tuple[ByteArray, IntArray]:
    """Return descriptors of whole tiles and groups of four bytes, and their squared norms, those that fill up FAR."""
    n, size = descriptor.shape
    whole = np.zeros((-(-n // tile) * tile, -(-size // 4) * 4), dtype=np.uint8)
    whole[:n, :size] = descriptor
    norm = np.full(len(whole), FAR, dtype=np.int64)
    norm[:n] = np.einsum("ij,ij->i", descriptor, descriptor, dtype=np.int64)
    return whole, norm


def _in_tiles(first: ByteArray, second: ByteArray, norms: IntArray) -> tuple[WholeArray, WholeArray, IntArray]:
    """Return padded descriptors (N, D) and (M, D) as _nearest_by_numbers takes them, and what stands for the squared
    norms (M,) of the second."""
    rows: WholeArray = first.astype(np.int16)
    columns: WholeArray = second.astype(np.int16)
    if _TOGETHER == 4:
        # a signed byte is an unsigned one less 128, so that a · b is 128 times the sum of b more than their product
        rows, columns = (first ^ 128).view(np.int8), second
        norms = norms - 256 * second.sum(axis=1, dtype=np.int64)
    panels = columns.reshape(-1, _TILE.lanes, second.shape[1] // _TOGETHER, _TOGETHER).transpose(0, 2, 1, 3)
    return rows, np.ascontiguousarray(panels).reshape(len(second) // _WIDTH, -1), norms


def nearest_descriptors(first: ByteArray, second: ByteArray, *, by_blas: bool = not _TILES) -> NearestDescriptors:
    """Return the nearest descriptors of two photographs, rows of ``first`` (N, D) and ``second`` (M, D), both ways.

    ``by_blas``: with BLAS, even where the processor multiplies whole numbers. Raises ValueError where the descriptors
    are longer than LONGEST, or there are fewer than two in one of the photographs.
    """
    if first.shape[1] != second.shape[1] or first.shape[1] > LONGEST or min(len(first), len(second)) < 2:
        raise ValueError(f"descriptors of {first.shape} and {second.shape}")
    (a, norm), (b, norms) = _padded(first, _HEIGHT), _padded(second, _WIDTH)
    shifted = (norm << 8).astype(np.uint32)
    nearest, distance = np.zeros(len(a), dtype=np.int32), np.full((len(a), 2), _NONE >> 8, dtype=np.int32)
    back, least = np.zeros(len(b), dtype=np.int32), np.full(len(b), _NONE >> 8, dtype=np.uint32)
    if not by_blas:
        rows, columns, norms = _in_tiles(a, b, norms)
        _nearest_by_numbers(rows, columns, shifted, (norms << 8).astype(np.uint32), nearest, distance, back, least)
    else:
        single, transposed = a.astype(np.float32), np.ascontiguousarray(b.T, dtype=np.float32)
        for start in range(0, len(single), _BLOCK):
            own = slice(start, start + _BLOCK)
            _nearest_in_rows(
                single[own] @ transposed, start, shifted[own], (norms << 8).astype(np.uint32),
                nearest[own], distance[own], back, least,
            )  # fmt: skip
    n, m = len(first), len(second)
    return NearestDescriptors(nearest[:n].astype(np.int64), distance[:n].astype(np.float32), back[:m].astype(np.int64))


class Euclidean:
    """The matcher of descriptors of bytes, each a coordinate; distances are squared."""

    seconds = 0.22
    bytes_per_key_point = 4800.0  # descriptors as floats, and 1024 rows of products

    def nearest(self, first: ByteArray, second: ByteArray) -> NearestDescriptors:
        """Return the nearest descriptors both ways, as `nearest_descriptors`."""
        return nearest_descriptors(first, second)

    def coordinates(self, descriptor: ByteArray) -> ByteArray:
        """Return the descriptors (N, D) themselves."""
        return descriptor
