"""What surveyors measure between points: distances, height differences, points of one level surface or of one plane.

Each is an observation of the adjustment, or a check of its result; points and photographs are named as in the block.
"""

from collections import Counter
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

ConstraintRole = Literal["control", "check"]
ConstraintKind = Literal["distance", "height difference", "level surface", "plane"]
SurfaceKind = Literal["level surface", "plane"]
CONSTRAINT_KINDS: tuple[ConstraintKind, ...] = ("distance", "height difference", "level surface", "plane")

FEWEST_ON = {"level surface": 3, "plane": 4}
"""Points of a surface: two of one level are a height difference, three always lie on a plane."""


@dataclass(frozen=True, kw_only=True)
class _BetweenTwo:
    """One observation between two points."""

    ends: tuple[str, str]
    """Names of its ends, from and to."""
    sigma_m: float
    """Its standard deviation; infinite where it is rejected."""
    role: ConstraintRole = "control"
    """Whether it takes part in the adjustment, or tests it."""
    name: str = ""
    """Its own name, empty for that of its ends."""

    @property
    def points(self) -> tuple[str, ...]:
        """Names of its points."""
        return self.ends

    @property
    def sigmas_m(self) -> tuple[float, ...]:
        """Standard deviations of its observations."""
        return (self.sigma_m,)


@dataclass(frozen=True, kw_only=True)
class Distance(_BetweenTwo):
    """A measured distance between two ground points or two photographs."""

    of_photographs: bool = False
    """Whether its ends are photographs, their projection centres; else ground points."""
    length_m: float
    """Measured length."""

    @property
    def kind(self) -> ConstraintKind:
        """What is measured."""
        return "distance"


@dataclass(frozen=True, kw_only=True)
class HeightDifference(_BetweenTwo):
    """A levelled difference of the heights of two ground points, in the height system of the map."""

    difference_m: float
    """Height of the second minus height of the first."""

    @property
    def kind(self) -> ConstraintKind:
        """What is measured."""
        return "height difference"

    @property
    def of_photographs(self) -> bool:
        """Whether its points are photographs."""
        return False


@dataclass(frozen=True)
class CommonSurface:
    """Ground points on one level surface of unknown height, or on one plane of unknown place and direction."""

    name: str
    """Its name."""
    kind: SurfaceKind
    """What the points have in common."""
    points: tuple[str, ...]
    """Names of the points (n)."""
    sigmas_m: tuple[float, ...]
    """Standard deviations of each from the surface (n): in height, or across the plane; infinite for a rejected one."""
    role: ConstraintRole = "control"
    """Whether it takes part in the adjustment, or tests it."""

    @property
    def of_photographs(self) -> bool:
        """Whether its points are photographs."""
        return False

    def __post_init__(self) -> None:
        if len(self.points) != len(self.sigmas_m):
            raise ValueError("every point of a surface needs a standard deviation")


Constraint = Distance | HeightDifference | CommonSurface


@dataclass(frozen=True)
class Observed:
    """One observation of a constraint: all of a distance or a height difference, one point of a surface."""

    constraint: int
    """Number of the constraint."""
    row: int
    """Number of the observation in it."""
    kind: ConstraintKind
    """What is measured."""
    label: str
    """What it is called, unlike any other of the block."""
    points: tuple[str, ...]
    """Names of its points."""


def labels(constraints: Sequence[Constraint]) -> list[str]:
    """Return what constraints are called: by their names, else by their ends, numbered where these come again."""
    own = [c.name or " – ".join(c.points) for c in constraints]
    seen: Counter[tuple[str, str]] = Counter()
    numbered = []
    for constraint, name in zip(constraints, own, strict=True):
        seen[constraint.kind, name] += 1
        count = seen[constraint.kind, name]
        numbered.append(name if count == 1 else f"{name} ({count})")
    return numbered


def observations(constraints: Sequence[Constraint]) -> Iterator[Observed]:
    """Yield the observations of constraints, in their order."""
    for number, (constraint, label) in enumerate(zip(constraints, labels(constraints), strict=True)):
        if isinstance(constraint, CommonSurface):
            for row, point in enumerate(constraint.points):
                yield Observed(number, row, constraint.kind, f"{point} on {label}", (point,))
        else:
            yield Observed(number, 0, constraint.kind, label, constraint.points)


def with_sigmas(constraints: Sequence[Constraint], sigma_m: Sequence[float]) -> tuple[Constraint, ...]:
    """Return constraints with other standard deviations, one for each observation in their order."""
    changed, start = list[Constraint](), 0
    for constraint in constraints:
        end = start + len(constraint.sigmas_m)
        own = tuple(float(sigma) for sigma in sigma_m[start:end])
        if isinstance(constraint, CommonSurface):
            changed.append(replace(constraint, sigmas_m=own))
        else:
            changed.append(replace(constraint, sigma_m=own[0]))
        start = end
    return tuple(changed)


def rejecting(constraints: Sequence[Constraint], rejected: Container[tuple[str, str]]) -> tuple[Constraint, ...]:
    """Return constraints whose observations of these kinds and labels are rejected: their sigmas are infinite."""
    stated = [sigma for constraint in constraints for sigma in constraint.sigmas_m]
    return with_sigmas(
        constraints,
        [
            np.inf if (o.kind, o.label) in rejected else sigma
            for o, sigma in zip(observations(constraints), stated, strict=True)
        ],
    )


def gives_scale(constraints: Sequence[Constraint]) -> bool:
    """Return whether a distance takes part, so that lengths are in metres."""
    return any(isinstance(c, Distance) and c.role == "control" and np.isfinite(c.sigma_m) for c in constraints)
