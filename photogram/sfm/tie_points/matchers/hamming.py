"""Nearest descriptors of bits by their Hamming distance, the number of bits in which two differ.

OpenCV's `batchDistance` and `BFMatcher` give the same, but take a pass for each way: 0.92 s for 10 000 descriptors of
256 bits on either side, against 0.14 s here, on one core.
"""

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, Float32Array, IntArray
from photogram.compilation import njit
from photogram.sfm.tie_points.matchers.nearest import NearestDescriptors

Word = np.uint64
WordArray = NDArray[np.uint64]

_FAR = 1 << 30


@njit(cache=True, nogil=True, inline="always")
def _ones(word: Word) -> Word:
    """Return the number of ones among 64 bits: by halves, which LLVM knows as one instruction (Warren 2013, ch. 5)."""
    pairs = word - ((word >> Word(1)) & Word(0x5555555555555555))
    fours = (pairs & Word(0x3333333333333333)) + ((pairs >> Word(2)) & Word(0x3333333333333333))
    eights = (fours + (fours >> Word(4))) & Word(0x0F0F0F0F0F0F0F0F)
    return (eights * Word(0x0101010101010101)) >> Word(56)


@njit(cache=True, nogil=True)
def _compare(first: WordArray, second: WordArray, nearest: IntArray, distance: Float32Array, back: IntArray) -> None:
    """Fill ``nearest`` (N,), the squared ``distance`` (N, 2) and ``back`` (M,) for words (N, W) and (M, W)."""
    least = np.full(len(second), _FAR, dtype=np.int64)
    for i in range(len(first)):
        smallest, next_smallest = np.int64(_FAR), np.int64(_FAR)
        for j in range(len(second)):
            bits = np.int64(0)
            for k in range(first.shape[1]):
                bits += np.int64(_ones(first[i, k] ^ second[j, k]))
            if bits < smallest:
                smallest, next_smallest = bits, smallest
                nearest[i] = j
            elif bits < next_smallest:
                next_smallest = bits
            if bits < least[j]:
                least[j] = bits
                back[j] = i
        distance[i, 0], distance[i, 1] = smallest * smallest, next_smallest * next_smallest


def _words(descriptor: ByteArray) -> WordArray:
    """Return descriptors (N, D) as words (N, W), filled up with zeros."""
    n, size = descriptor.shape
    whole = np.zeros((n, -(-size // 8) * 8), dtype=np.uint8)
    whole[:, :size] = descriptor
    return whole.view(np.uint64)


class Hamming:
    """The matcher of descriptors of bits, eight in a byte."""

    seconds = 0.17
    bytes_per_key_point = 200.0

    def nearest(self, first: ByteArray, second: ByteArray) -> NearestDescriptors:
        """Return the nearest descriptors both ways, as `Matcher` says; distances are squared."""
        if first.shape[1] != second.shape[1] or min(len(first), len(second)) < 2:
            raise ValueError(f"descriptors of {first.shape} and {second.shape}")
        n, m = len(first), len(second)
        near = NearestDescriptors(np.zeros(n, np.int64), np.zeros((n, 2), np.float32), np.zeros(m, np.int64))
        _compare(_words(first), _words(second), near.nearest, near.distance, near.back)
        return near

    def coordinates(self, descriptor: ByteArray) -> ByteArray:
        """Return the bits (N, 8 D), 0 or 1: their squared Euclidean distance is the number in which two differ."""
        return np.unpackbits(descriptor, axis=1)
