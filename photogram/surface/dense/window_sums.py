"""Correlations of photographs over all windows of a patch at once.

Windows of neighbouring cells share most of their samples. So nothing is done window by window: of each pair of
photographs the products of all samples are summed over all windows at once, first along columns, then along rows. With
the sums of the samples, of their squares and of their products over a window of n samples, the correlation is

    (Σ p q − Σ p Σ q / n) / √((Σ p² − (Σ p)² / n + n ε²) (Σ q² − (Σ q)² / n + n ε²))

where the noise ε makes samples with little texture correlate with nothing, rather than by chance.
"""

from typing import NamedTuple

import numpy as np

from photogram.arrays import Float32Array, FloatArray, IntArray
from photogram.compilation import njit


class Window(NamedTuple):
    """``half``: places of the lattice from the middle to the edge; ``noise``: grey values that count as noise;
    ``kept``: share of the photographs that must agree."""

    half: int
    noise: float
    kept: float


class PatchWindows(NamedTuple):
    """The windows of the patches (rows, columns) of a block: ``half`` and ``kept`` of each, and the ``noise`` of all,
    as of `Window`."""

    half: IntArray
    kept: FloatArray
    noise: float


class Sums(NamedTuple):
    """Room for sums: ``columns`` (per_cell × lattice) along the columns of windows, ``mean`` and ``scale`` (K, cells)
    of the samples of each view."""

    columns: Float32Array
    mean: Float32Array
    scale: Float32Array


@njit(cache=True, nogil=True)
def scratch_for_sums(most: int, per_cell: int, cells: int) -> Sums:
    """Return room for patches of ``cells`` places in a phase, in ``most`` views."""
    return Sums(
        np.zeros(per_cell * cells, np.float32), np.zeros((most, cells), np.float32), np.zeros((most, cells), np.float32)
    )


@njit(cache=True, nogil=True)
def _set_products(
    a: Float32Array, b: Float32Array, one: np.uint64, two: np.uint64, three: np.uint64, out: Float32Array,
    start: np.uint64, n: int,
) -> None:  # fmt: skip
    for i in range(n):
        k = np.uint64(i)
        out[k + start] = a[k + one] * b[k + one] + a[k + two] * b[k + two] + a[k + three] * b[k + three]


@njit(cache=True, nogil=True)
def _add_products(
    a: Float32Array, b: Float32Array, one: np.uint64, two: np.uint64, out: Float32Array, start: np.uint64, n: int
) -> None:
    for i in range(n):
        k = np.uint64(i)
        out[k + start] += a[k + one] * b[k + one] + a[k + two] * b[k + two]


@njit(cache=True, nogil=True)
def _set_sum(
    a: Float32Array, one: np.uint64, two: np.uint64, three: np.uint64, out: Float32Array, start: np.uint64, n: int
) -> None:
    for i in range(n):
        k = np.uint64(i)
        out[k + start] = a[k + one] + a[k + two] + a[k + three]


@njit(cache=True, nogil=True)
def _add_sum(a: Float32Array, one: np.uint64, two: np.uint64, out: Float32Array, start: np.uint64, n: int) -> None:
    for i in range(n):
        k = np.uint64(i)
        out[k + start] += a[k + one] + a[k + two]


@njit(cache=True, nogil=True)
def _south(d: int, phase: int, per_cell: int, width: int, size: int) -> np.uint64:
    """Return where the samples of a phase column begin that are ``d`` places to the south of the first of a window."""
    return np.uint64((d % per_cell * per_cell + phase) * size + d // per_cell * width)


@njit(cache=True, nogil=True)
def _along_rows(columns: Float32Array, half: int, per_cell: int, out: Float32Array) -> None:
    """Fill ``out`` (n,) with the sums over 2 ``half`` + 1 places along the rows of sums along columns."""
    n, m, nothing = len(out), per_cell, np.uint64(0)
    size = n + 2 * half // m
    one, two = np.uint64(1 % m * size + 1 // m), np.uint64(2 % m * size + 2 // m)
    _set_sum(columns, nothing, one, two, out, nothing, n)
    for d in range(3, 2 * half + 1, 2):
        e = d + 1
        _add_sum(columns, np.uint64(d % m * size + d // m), np.uint64(e % m * size + e // m), out, nothing, n)


@njit(cache=True, nogil=True)
def _sum_of_windows(
    a: Float32Array, half: int, per_cell: int, width: int, size: int, columns: Float32Array, out: Float32Array
) -> None:
    """Fill ``out`` (n,) with the sums over all windows of samples ``a`` (per_cell² × size) in rows of ``width``."""
    m, n = per_cell, len(out) + 2 * half // per_cell
    for j in range(m):
        start = np.uint64(j * n)
        one, two, three = _south(0, j, m, width, size), _south(1, j, m, width, size), _south(2, j, m, width, size)
        _set_sum(a, one, two, three, columns, start, n)
        for d in range(3, 2 * half + 1, 2):
            _add_sum(a, _south(d, j, m, width, size), _south(d + 1, j, m, width, size), columns, start, n)
    _along_rows(columns, half, per_cell, out)


@njit(cache=True, nogil=True)
def _product_of_windows(
    a: Float32Array, b: Float32Array, half: int, per_cell: int, width: int, size: int, columns: Float32Array,
    out: Float32Array,
) -> None:  # fmt: skip
    """As `_sum_of_windows`, of the products of ``a`` and ``b``."""
    m, n = per_cell, len(out) + 2 * half // per_cell
    for j in range(m):
        start = np.uint64(j * n)
        one, two, three = _south(0, j, m, width, size), _south(1, j, m, width, size), _south(2, j, m, width, size)
        _set_products(a, b, one, two, three, columns, start, n)
        for d in range(3, 2 * half + 1, 2):
            _add_products(a, b, _south(d, j, m, width, size), _south(d + 1, j, m, width, size), columns, start, n)
    _along_rows(columns, half, per_cell, out)


@njit(cache=True, nogil=True, error_model="numpy")
def _to_scale(square: Float32Array, mean: Float32Array, n: float, noise: float, scale: Float32Array) -> None:
    """Turn sums of squares of windows of n samples into squared lengths of the normalised samples, given the sums
    ``mean``."""
    count, least = np.float32(n), np.float32(n * noise * noise)
    for k in range(len(square)):
        length = max(square[k] - mean[k] * mean[k] / count, np.float32(0.0))
        shown = square[k] == square[k]
        scale[k] = np.float32(1.0) / np.sqrt(length + least) if shown else np.float32(0.0)
        square[k] = length / (length + least) if shown else np.float32(np.nan)


@njit(cache=True, nogil=True, error_model="numpy")
def _to_correlation(
    product: Float32Array, one: Float32Array, other: Float32Array, n: float, of_one: Float32Array,
    of_other: Float32Array, mirrored: Float32Array,
) -> None:  # fmt: skip
    """Turn sums of products of windows of n samples into correlations, 0 where one of the two is not shown."""
    share = np.float32(1.0 / n)
    for k in range(len(product)):
        value = (product[k] - one[k] * other[k] * share) * of_one[k] * of_other[k]
        product[k] = value if value == value else np.float32(0.0)
        mirrored[k] = product[k]


@njit(cache=True, nogil=True)
def fill_correlations(
    samples: Float32Array, window: Window, per_cell: int, width: int, room: Sums, pairs: Float32Array
) -> None:
    """Fill ``pairs`` (K, K, n) with the correlations of K views over the windows of n cells in rows of ``width``.

    (i, i, n) is the squared length of the normalised samples, NaN where a view does not show a window. ``samples`` (K,
    per_cell², …) are those of the lattice, which reaches ``window.half`` places beyond the cells.
    """
    count, _, n = pairs.shape
    half, length, size = window.half, float((2 * window.half + 1) ** 2), samples.shape[2]
    for i in range(count):
        mean, scale, own, a = room.mean[i, :n], room.scale[i, :n], pairs[i, i], samples[i].ravel()
        _sum_of_windows(a, half, per_cell, width, size, room.columns, mean)
        _product_of_windows(a, a, half, per_cell, width, size, room.columns, own)
        _to_scale(own, mean, length, window.noise, scale)
        for j in range(i):
            pair, b = pairs[i, j], samples[j].ravel()
            _product_of_windows(a, b, half, per_cell, width, size, room.columns, pair)
            _to_correlation(pair, mean, room.mean[j, :n], length, scale, room.scale[j, :n], pairs[j, i])
