"""The damped reduced system solved: by LAPACK's Cholesky factor of a band, or by GTSAM where it is installed."""

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from typing import Literal

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import AdjustmentError
from photogram.factors.elimination.reduced import NormalEquations

SolverName = Literal["banded", "gtsam"]
Solver = Callable[[NormalEquations, float], tuple[FloatArray, FloatArray]]


@dataclass(eq=False)
class Banded:
    """The solver by a Cholesky factor, in memory that is kept from one solution to the next: a band of thousands of
    photographs takes half a gigabyte, which the system would give and take back at every step."""

    memory: FloatArray = field(default_factory=lambda: np.empty(0), repr=False)

    def __call__(self, normal: NormalEquations, damping: float) -> tuple[FloatArray, FloatArray]:
        """Return the steps of poses (6 free,) and border, the diagonal raised by ``damping`` times that before
        elimination. Raises SingularError where the system is not positive definite."""
        if len(self.memory) != normal.layout.size:
            self.memory = np.empty(normal.layout.size)
        return normal.factor(damping, memory=self.memory).solve(normal.g, normal.h)


def need_gtsam(setting: str) -> None:
    """Raise AdjustmentError where GTSAM, which a ``setting`` needs, is not installed."""
    try:
        import_module("gtsam")
    except ImportError as error:
        raise AdjustmentError(
            f"{setting} needs GTSAM, which is not installed: leave it out, for the same result, or pip install gtsam "
            "(Windows: conda install -c conda-forge gtsam)"
        ) from error


def _gtsam() -> Solver:
    need_gtsam("solver: gtsam")
    from photogram.factors.elimination.gtsam_solver import solve_with_gtsam

    return solve_with_gtsam


SOLVERS: dict[SolverName, Callable[[], Solver]] = {"banded": Banded, "gtsam": _gtsam}
