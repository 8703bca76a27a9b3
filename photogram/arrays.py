"""Array types, checks of shapes, groups and the scatter of numbers."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

NMAD_FACTOR = 1.4826
"""Ratio of the standard deviation of a normal distribution to its median absolute deviation (Höhle & Höhle 2009, eq.
1)."""

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
ByteArray = NDArray[np.uint8]
Float32Array = NDArray[np.float32]
Int32Array = NDArray[np.int32]

Index = int | np.int64 | np.uint64
"""A place in an array: compiled code does not test whether an unsigned one counts from the end."""


def grouped(number: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Return the indices (N,) of numbers below ``count`` in the order of the numbers, those of one ascending, and where
    each number begins among them (count + 1,)."""
    n = len(number)
    by_number = csr_array((np.arange(n), number, np.arange(n + 1)), shape=(n, count)).tocsc()
    return by_number.indices.astype(np.int64), by_number.indptr.astype(np.int64)


def nmad(values: FloatArray) -> float:
    """Return 1.4826 median|v − median v|, the standard deviation of what most of the values are a sample of (Höhle &
    Höhle 2009, eq. 1); NaN of nothing."""
    return NMAD_FACTOR * float(np.median(np.abs(values - np.median(values)))) if values.size else float("nan")


def check_shape(name: str, array: NDArray[np.generic], shape: tuple[int | None, ...]) -> None:
    """Raise ValueError unless ``array`` has ``shape``, where None stands for any length."""
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{name}: shape {array.shape}, expected {shape}")


def check_shapes(record: object, **shapes: tuple[int | None, ...]) -> None:
    """Raise ValueError unless the arrays of a record, by the names of their fields, have these shapes; a field that is
    None is passed over."""
    for name, shape in shapes.items():
        array = getattr(record, name)
        if array is not None:
            check_shape(name, array, shape)
