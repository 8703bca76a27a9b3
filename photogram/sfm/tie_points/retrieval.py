"""Photographs that look alike, found by their own key points: VLAD vectors compared by dot product.

A photograph's vector gathers, for each visual word of a vocabulary made from the survey itself, how its descriptors
differ from that word (Jégou et al. 2010, sec. 3.1; here on RootSIFT descriptors, or on bits), each word's sum scaled
to unit length (Arandjelović & Zisserman 2013, sec. 4), every component by its square root (Jégou & Chum 2012). Large
key points are taken first: on overlapping photographs they are found again far more often than small ones.

Descriptors, words and vectors are whole numbers so small that every product and sum is exact in float32: the result
does not depend on the order in which a machine adds.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import Float32Array, FloatArray, IntArray
from photogram.sfm.tie_points.matching import MATCHERS
from photogram.survey import Features

_WORDS = 128  # at most; each needs _SUPPORT descriptors of the sample
_SUPPORT = 16
_DESCRIPTORS = 2000  # per photograph
_CELLS = 16  # per side of the grid over which these are spread
_TRAINING_PHOTOGRAPHS, _TRAINING_DESCRIPTORS = 200, 30_000
_ROUNDS = 10  # of Lloyd's algorithm
_LENGTH = 4000.0  # of a photograph's vector; rounded, it stays below 2**12, and dot products below 2**24
_BLOCK = 512  # photographs compared at once


def _selected(features: Features) -> Float32Array:
    """Return the descriptors (M, D) of the largest key points, spread over the photograph, as points whose means are
    descriptors, too."""
    n, coordinates = len(features), MATCHERS[features.metric].coordinates
    if n <= _DESCRIPTORS:
        return coordinates(features.descriptor).astype(np.float32)
    low, high = features.pixel.min(axis=0), features.pixel.max(axis=0)
    place = (features.pixel - low) / np.maximum(high - low, 1.0) * _CELLS
    cell = np.minimum(place.astype(np.int64), _CELLS - 1) @ np.array([1, _CELLS])
    order = np.lexsort((np.arange(n), -features.size_px, cell))
    rank = np.empty(n, dtype=np.int64)
    rank[order] = np.arange(n) - np.searchsorted(cell[order], cell[order])
    chosen = np.lexsort((np.arange(n), -features.size_px, rank))[:_DESCRIPTORS]
    return coordinates(features.descriptor[chosen]).astype(np.float32)


def _nearest_word(descriptor: Float32Array, word: Float32Array) -> IntArray:
    """Return the nearest word (M,) of each descriptor."""
    score = descriptor @ (-2.0 * word.T)
    score += np.einsum("ij,ij->i", word, word)
    return np.asarray(score.argmin(axis=1), dtype=np.int64)


def _sums(descriptor: Float32Array, label: IntArray, words: int) -> tuple[IntArray, IntArray]:
    """Return the sum (W, D) of the descriptors of each word, and their number (W,)."""
    order = np.argsort(label, kind="stable")
    number = np.bincount(label, minlength=words).astype(np.int64)
    present = np.flatnonzero(number)
    total = np.zeros((words, descriptor.shape[1]), dtype=np.int64)
    starts = (np.cumsum(number) - number)[present]
    total[present] = np.add.reduceat(descriptor[order].astype(np.int64), starts, axis=0)
    return total, number


def _vocabulary(load: Callable[[int], Features], count: int, seed: int) -> Float32Array:
    """Return the visual words (W, D): k-means (Lloyd 1982) of descriptors of the survey, to whole numbers."""
    rng = np.random.default_rng(seed)
    some = np.sort(rng.permutation(count)[:_TRAINING_PHOTOGRAPHS])
    each = -(-_TRAINING_DESCRIPTORS // len(some))
    parts = []
    for i in some.tolist():
        descriptor = _selected(load(i))
        parts.append(descriptor[np.sort(rng.permutation(len(descriptor))[:each])])
    sample = np.concatenate(parts)
    words = min(_WORDS, -(-len(sample) // _SUPPORT))
    word = np.unique(sample[rng.permutation(len(sample))[:words]], axis=0)
    for _ in range(_ROUNDS if len(word) else 0):
        label = np.concatenate([_nearest_word(s, word) for s in np.array_split(sample, -(-len(sample) // 8192))])
        total, number = _sums(sample, label, len(word))
        mean = np.rint(total / np.maximum(number, 1)[:, None]).astype(np.float32)
        moved = np.where(number[:, None] > 0, mean, word)
        if np.array_equal(moved, word):
            break
        word = moved
    return word


def _vector(descriptor: Float32Array, word: Float32Array) -> NDArray[np.int16]:
    """Return the VLAD vector (W · D,) of a photograph in whole numbers, of length _LENGTH; zero without descriptors."""
    if not len(descriptor):
        return np.zeros(word.size, dtype=np.int16)
    total, number = _sums(descriptor, _nearest_word(descriptor, word), len(word))
    difference: FloatArray = total.astype(np.float64) - number[:, None].astype(np.float64) * word
    difference /= np.maximum(np.linalg.norm(difference, axis=1, keepdims=True), 1e-9)
    vector = (np.sign(difference) * np.sqrt(np.abs(difference))).ravel()
    return np.asarray(np.rint(_LENGTH * vector / max(float(np.linalg.norm(vector)), 1e-9)), dtype=np.int16)


def most_similar(load: Callable[[int], Features], count: int, partners: int, seed: int = 0) -> IntArray:
    """Return for each of ``count`` photographs the indices (count, partners) of those that look most like it.

    Best first, ties by index; −1 where there are no more, or where a photograph has no key points. ``load`` gives the
    features of a photograph, at most twice each; one photograph's are held at a time. The result depends on the
    features, their order and ``seed`` alone.
    """
    result = np.full((count, partners), -1, dtype=np.int64)
    if count < 2:
        return result
    word = _vocabulary(load, count, seed)
    vector = np.array([_vector(_selected(load(i)), word) for i in range(count)])
    empty = np.asarray(~vector.any(axis=1))
    taken = min(partners, count - 1)
    for start in range(0, count, _BLOCK):
        rows = vector[start : start + _BLOCK].astype(np.float32)
        parts = [rows @ vector[s : s + _BLOCK].astype(np.float32).T for s in range(0, count, _BLOCK)]
        similarity = np.concatenate(parts, axis=1)
        similarity[:, empty] = -np.inf
        similarity[np.arange(len(rows)), start + np.arange(len(rows))] = -np.inf
        best = np.argsort(-similarity, axis=1, kind="stable")[:, :taken]
        exists = np.isfinite(np.take_along_axis(similarity, best, axis=1))
        result[start : start + _BLOCK, :taken] = np.where(exists & ~empty[start : start + _BLOCK, None], best, -1)
    return result
