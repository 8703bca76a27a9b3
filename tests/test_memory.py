"""Peak memory of a block of work."""

from __future__ import annotations

import numpy as np
import pytest

from photogram.memory import peak_memory

MIB = 2**20


def test_peak_grows_with_what_is_held_and_is_that_of_its_own_block() -> None:
    with peak_memory() as small:
        np.ones(MIB // 8).sum()
    with peak_memory() as large:
        np.ones(300 * MIB // 8).sum()
    if small.bytes is None or large.bytes is None:
        pytest.skip("this system tells peaks of the process alone")
    assert 280 * MIB < large.bytes - small.bytes < 400 * MIB
    with peak_memory() as after:
        np.ones(MIB // 8).sum()
    if after.bytes is None:
        pytest.skip("this system cannot bring the high-water mark down")
    assert after.bytes < large.bytes - 250 * MIB


def test_peak_holds_what_is_let_go_again() -> None:
    def fail() -> None:
        block = np.ones(400 * MIB // 8)
        raise RuntimeError(len(block))

    with peak_memory() as peak, pytest.raises(RuntimeError):
        fail()
    assert peak.bytes is None or peak.bytes > 400 * MIB
