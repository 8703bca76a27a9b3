"""MAT files that are damaged: refused before SciPy's reader, which some of them end as a process."""

import io
import struct
from random import Random

import numpy as np
import pytest
from scipy.io import savemat

from photogram.files.matlab_elements import check_elements, is_level_5


def saved(*, compressed: bool = False) -> bytes:
    stream = io.BytesIO()
    inner = np.array([[1.5, 2.0], [3.0, 4.0]])
    struct_of = {"K": inner, "text": "a camera", "cells": np.array([[1, 2], ["a", inner]], dtype=object)}
    variables = {
        "K": inner,
        "Z": inner + 1j,
        "n": np.array([[7]], np.uint16),
        "cameraParams": struct_of,
        "empty": np.zeros((0, 3)),
    }
    savemat(stream, variables, do_compression=compressed)  # type: ignore[arg-type]  # a stream is taken too
    return stream.getvalue()


@pytest.mark.parametrize("compressed", [False, True])
def test_what_scipy_writes_holds(compressed: bool) -> None:
    check_elements(saved(compressed=compressed))


def test_the_words_of_the_header_do_not_matter() -> None:
    data = saved()
    assert is_level_5(data)
    assert is_level_5(b"XXXX" + data[4:])
    assert not is_level_5(b"\0" + data[1:])
    assert not is_level_5(data[:120])
    assert not is_level_5(data[:124] + b"\0\2IM" + data[128:])


@pytest.mark.parametrize("kind", [0, 8, 14, 19, 200])
def test_numbers_of_a_type_that_there_is_not_are_refused(kind: int) -> None:
    data = bytearray(saved())
    place = data.index(struct.pack("<II", 9, 32))  # the four doubles of K
    data[place : place + 4] = struct.pack("<I", kind)
    with pytest.raises(ValueError, match="of no type"):
        check_elements(bytes(data))


def test_every_cut_is_noticed() -> None:
    data = saved(compressed=True)
    for count in range(129, len(data)):
        try:
            check_elements(data[:count])
        except ValueError:
            continue
        assert struct.unpack_from("<I", data, count)[0] == 15, "cut between two variables, which nothing tells"


def test_no_change_of_a_bit_raises_anything_else() -> None:
    sound, random = saved(), Random(1)
    refused = 0
    for _ in range(2000):
        data = bytearray(sound)
        data[random.randrange(len(data))] ^= 1 << random.randrange(8)
        try:
            check_elements(bytes(data))
        except ValueError:
            refused += 1
    assert refused > 200


def test_what_unpacks_to_too_much_is_refused() -> None:
    stream = io.BytesIO()
    savemat(stream, {"K": np.zeros((3000, 3000))}, do_compression=True)  # type: ignore[arg-type]  # as above
    assert len(stream.getvalue()) < 100_000
    with pytest.raises(ValueError, match="unpacks to more than"):
        check_elements(stream.getvalue())
