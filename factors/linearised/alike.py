"""Factors in groups of alike ones: observations with the same kinds of variables, linearised together.

A factor's misfit is that of its observation in standard deviations; half the sum of their squares is the cost. The
tangent of a pose is (ω, v) in the camera frame: R Exp(ω) and C + R v.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol, Self

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.factors.variables import INDEX, kind_and_index


class Values(Protocol):
    """Values of variables, by their keys."""

    def poses(self, variables: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the rotations (n, 3, 3), world from camera, and projection centres (n, 3) of poses (n,)."""

    def vectors(self, variables: IntArray) -> FloatArray:
        """Return the values (n, d) of variables (n,) of one kind that are no poses."""

    def velocities(self, variables: IntArray) -> FloatArray | None:
        """Return the velocities (n, 3) of poses (n,), m/s, which are no variables; None where they are as given."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """Alike factors (n) in their standard deviations: ``misfit`` (n, r) and ``jacobian`` (n, r, c) by the tangents of
    their variables, one after the other."""

    misfit: FloatArray
    jacobian: FloatArray


def _arrays(value: object) -> tuple[FloatArray, ...]:
    """Return the arrays of a field of factors."""
    if isinstance(value, tuple) and all(isinstance(part, np.ndarray) for part in value):
        return value
    return (value,) if isinstance(value, np.ndarray) else ()


@dataclass(frozen=True, eq=False)
class Factors(ABC):
    """Alike factors (n) on ``variables`` (n, k), keys of the same k kinds. Every other array, by itself or in a tuple,
    is of n factors too."""

    variables: IntArray

    @property
    @abstractmethod
    def rows(self) -> int:
        """Return how many observations each factor has."""

    @abstractmethod
    def linearised(self, values: Values) -> Linearised:
        """Return the factors linearised at values."""

    def __len__(self) -> int:
        return len(self.variables)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return the kinds of the variables (k,)."""
        return tuple(kind_and_index(variable)[0] for variable in self.variables[0].tolist())

    @property
    def index(self) -> IntArray:
        """Return the numbers (n, k) of the variables among those of their kind."""
        return self.variables & INDEX

    def cost(self, values: Values) -> float:
        """Return half the sum of squared misfits."""
        return 0.5 * float(np.sum(self.linearised(values).misfit ** 2))

    def alone(self, n: int) -> Self:
        """Return factor number n alone."""
        return self._made_of([tuple(part[n : n + 1] for part in _arrays(getattr(self, f.name))) for f in fields(self)])

    def _made_of(self, arrays: Sequence[tuple[FloatArray, ...]]) -> Self:
        """Return factors of other arrays, those of each field in turn."""
        changed: dict[str, Any] = {}
        for f, parts in zip(fields(self), arrays, strict=True):
            if parts:
                changed[f.name] = parts[0] if isinstance(getattr(self, f.name), np.ndarray) else parts
        return replace(self, **changed)

    def _shape(self) -> tuple[object, ...]:
        """Return what factors have in common that can be linearised together."""
        parts = [getattr(self, f.name) for f in fields(self)]
        shapes = [tuple(a.shape[1:] for a in _arrays(part)) for part in parts]
        return type(self), self.kinds, *shapes, *(part for part in parts if not _arrays(part))


def together(factors: Iterable[Factors]) -> tuple[Factors, ...]:
    """Return factors with alike ones joined, in the order in which each kind comes first."""
    groups: dict[tuple[object, ...], list[Factors]] = {}
    for factor in factors:
        groups.setdefault(factor._shape(), []).append(factor)
    return tuple(_joined(group) for group in groups.values())


def _joined(group: list[Factors]) -> Factors:
    of_fields = [[_arrays(getattr(factors, f.name)) for factors in group] for f in fields(group[0])]
    return group[0]._made_of([tuple(map(np.concatenate, zip(*parts, strict=True))) for parts in of_fields])


@dataclass(frozen=True, eq=False)
class VectorFactors(Factors):
    """Observations that are linear in vectors x: Σ A (x − a), with ``matrices`` A (n, r, d) and ``expected`` a (n, d)
    of each of the k variables, in standard deviations."""

    matrices: tuple[FloatArray, ...]
    expected: tuple[FloatArray, ...]

    @property
    def rows(self) -> int:
        """Return how many observations each factor has."""
        return int(self.matrices[0].shape[1])

    def linearised(self, values: Values) -> Linearised:
        """Return the factors linearised at values."""
        misfit = np.zeros((len(self), self.rows))
        for A, a, variables in zip(self.matrices, self.expected, self.variables.T, strict=True):
            misfit += np.einsum("nri,ni->nr", A, values.vectors(variables) - a)
        return Linearised(misfit, np.concatenate(self.matrices, axis=2))
