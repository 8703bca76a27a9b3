"""What a matcher must have, and what it returns."""

from dataclasses import dataclass
from typing import Protocol

from photogram.arrays import ByteArray, Float32Array, IntArray


@dataclass(frozen=True, eq=False)
class NearestDescriptors:
    """Of the descriptors of two photographs: for each of the first the ``nearest`` (N,) of the second, with the squared
    ``distance`` (N, 2) to its two nearest; for each of the second the nearest ``back`` (M,) of the first. Of those
    equally near the first one."""

    nearest: IntArray
    distance: Float32Array
    back: IntArray


class Matcher(Protocol):
    """Compares descriptors in one metric."""

    seconds: float
    """Of one worker of the reference machine, for the distances of 10⁸ pairs of descriptors both ways."""
    bytes_per_key_point: float
    """In memory, of the larger of two photographs that are compared."""

    def nearest(self, first: ByteArray, second: ByteArray) -> NearestDescriptors:
        """Return the nearest descriptors, rows of ``first`` (N, D) and ``second`` (M, D), both ways. Raises ValueError
        where their lengths differ, or there are fewer than two in one of the photographs."""

    def coordinates(self, descriptor: ByteArray) -> ByteArray:
        """Return points (N, C) whose Euclidean distances rank as the distances of the descriptors (N, D) do: for
        means of descriptors."""
