"""Correlations over all windows at once against numpy, window by window."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from photogram.arrays import Float32Array, FloatArray
from photogram.surface.dense.window_sums import Window, fill_correlations, scratch_for_sums

LARGEST = 8


def correlations(samples: NDArray[Any], window: Window, per_cell: int, rows: int, columns: int) -> Float32Array:
    """Return the correlations (K, K, rows, columns) of samples (K, Y, X) of a lattice, and of nothing beyond it."""
    count, more = len(samples), 2 * window.half // per_cell
    width = columns + more
    phases = np.zeros((count, (rows + more) * per_cell, width * per_cell), np.float32)
    phases[:, : samples.shape[1], : samples.shape[2]] = samples
    phases = phases.reshape(count, rows + more, per_cell, width, per_cell).transpose(0, 2, 4, 1, 3)
    flat = np.zeros((count, per_cell**2, (rows + more) * width + more), np.float32)
    flat[..., : (rows + more) * width] = phases.reshape(count, per_cell**2, -1)
    room = scratch_for_sums(count, per_cell, flat.shape[2])
    pairs = np.zeros((count, count, rows * width), np.float32)
    fill_correlations(flat, window, per_cell, width, room, pairs)
    return pairs.reshape(count, count, rows, width)[..., :columns]


def photographs_alike(rng: np.random.Generator, count: int, shape: tuple[int, ...]) -> FloatArray:
    """Return samples (count, …) of one texture with unlike noise, gain and offset."""
    each = (count, *(1 for _ in shape))
    grey = rng.normal(size=shape) + rng.uniform(0.2, 3.0, each) * rng.normal(size=(count, *shape))
    return np.asarray(rng.uniform(5.0, 30.0, each) * grey + rng.uniform(-60.0, 60.0, each))


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(2, 6), st.integers(1, 3), st.integers(1, 4), st.data())
def test_all_windows_at_once_are_each_by_itself(
    seed: int, count: int, per_cell: int, half: int, data: st.DataObject
) -> None:
    rng = np.random.default_rng(seed)
    rows, columns = data.draw(st.integers(1, LARGEST)), data.draw(st.integers(1, LARGEST))
    shape = tuple((n - 1) * per_cell + 2 * half + 1 for n in (rows, columns))
    samples = photographs_alike(rng, count, shape)
    pairs = correlations(samples, Window(half, 1e-3, 0.5), per_cell, rows, columns)
    side = 2 * half + 1
    for row, column in ((0, 0), (rows - 1, columns - 1), (rows // 2, columns // 3)):
        r, c = row * per_cell, column * per_cell
        expected = np.corrcoef(samples[:, r : r + side, c : c + side].reshape(count, -1))
        assert np.abs(pairs[:, :, row, column] - expected).max() < 2e-4


def test_a_window_that_a_photograph_does_not_show_is_not_a_number() -> None:
    samples = photographs_alike(np.random.default_rng(4), 3, (9, 9))
    samples[1, 0, 8] = np.nan
    pairs = correlations(samples, Window(1, 1.0, 0.5), 2, 4, 4)
    assert np.isnan(pairs[1, 1]).sum() == 1
    assert np.isnan(pairs[1, 1, 0, 3])
    assert pairs[0, 1, 0, 3] == pairs[2, 1, 0, 3] == 0.0
    assert np.isfinite(pairs[0]).all()


def test_where_there_is_little_but_noise_correlations_shrink() -> None:
    """Samples of half the noise's variance correlate as if they had a third of their length."""
    texture = np.where(np.add.outer(np.arange(9), np.arange(9)) % 2, 1.0, -1.0)
    texture[4, 4] = 0.0
    noise = 2.0 * np.sqrt(2.0 * 80 / 81)
    for epsilon, expected in ((1e-4, 1.0), (noise, 1.0 / 3.0)):
        pairs = correlations(2.0 * np.stack([texture, texture]), Window(4, epsilon, 1.0), 1, 1, 1)
        assert pairs[..., 0, 0] == pytest.approx(np.full((2, 2), expected), abs=1e-4)
    nothing = correlations(np.full((3, 9, 9), 7.0), Window(4, 1.0, 1.0), 1, 1, 1)
    assert np.abs(nothing).max() < 1e-6
