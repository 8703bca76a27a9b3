"""The hypothesis that a measurement is wrong."""

from dataclasses import dataclass
from typing import Literal

from scipy.stats import chi2

from photogram.constraints.between_points import CONSTRAINT_KINDS, ConstraintKind

Suspected = Literal[
    "control point",
    "mark",
    "GNSS position",
    "GNSS height",
    "attitude",
    "focal length",
    "GNSS offset",
    "exposure",
    ConstraintKind,
]


@dataclass(frozen=True)
class Hypothesis:
    """The hypothesis that one measurement is wrong, with its estimated blunder and its test statistic."""

    kind: Suspected
    """Kind of the measurement."""
    name: str
    """Name of its point, photograph, camera or flight; of a constraint its label, of an exposure the companion's
    photograph."""
    photograph: str | None
    """Name of the photograph of a mark, None for other kinds."""
    axes: tuple[int, ...]
    """Axes in error: easting, northing, height of a position; u, v of a mark; the camera's axes of an attitude;
    rotation and offset of an exposure."""
    off: tuple[float, ...]
    """Predicted minus measured along the axes, m, px or rad."""
    sigma: tuple[float, ...]
    """Standard deviations of ``off``."""
    statistic: float
    """Test statistic T, χ² with as many degrees of freedom as axes."""
    rivals: tuple[str, ...] = ()
    """Other measurements that would explain the contradiction nearly as well, in words."""
    together: tuple[str, ...] = ()
    """Names of others of its kind with which it was tested, and is rejected: each may hide behind the others."""

    @property
    def what(self) -> tuple[str, str, str | None]:
        """Return the measurement as (kind, name, photograph), whichever axes are in error."""
        return self.kind, self.name, self.photograph

    @property
    def words(self) -> str:
        """Return the measurement in words."""
        if self.kind in ("level surface", "plane"):
            point, _, surface = self.name.partition(" on ")
            return f"point {point} on {self.kind} {surface}"
        of = {"mark": f"of {self.name} in {self.photograph}", "GNSS offset": f"of flight {self.name}"}
        return f"{self.kind} {of.get(self.kind, self.name)}"

    @property
    def log_chance(self) -> float:
        """Return the logarithm of the probability of such a contradiction by chance."""
        return float(chi2.logsf(self.statistic, len(self.axes)))


def unmeasured(kind: Suspected, name: str, photograph: str | None = None) -> Hypothesis:
    """Return the hypothesis for a gross blunder of unknown size."""
    single = kind == "focal length" or kind in CONSTRAINT_KINDS
    count = 1 if single else 2 if kind == "mark" else 6 if kind == "exposure" else 3
    axes = (2,) if kind == "GNSS height" else tuple(range(count))
    unknown = (float("nan"),) * len(axes)
    return Hypothesis(kind, name, photograph, axes, unknown, unknown, float("inf"))
