"""The two engines of the joint adjustment: the graph with every point a variable, and the reduced system."""

from collections.abc import Callable
from dataclasses import dataclass

import gtsam

from photogram.factors.elimination.bundle import SingularPointError, minimise_bundle
from photogram.factors.elimination.levenberg_marquardt import FIRST, Minimum, Trial, Watch, minimise
from photogram.factors.elimination.loss import LEAST_CURVATURE
from photogram.factors.elimination.reduced import SingularError
from photogram.factors.elimination.solvers import SolverName
from photogram.factors.elimination.state import State
from photogram.factors.graph import (
    IndeterminateError,
    Problem,
    cost,
    damped_step,
    ground_graph,
    kept_in_front,
    linearise_all,
    retract,
)
from photogram.factors.ground_terms import bundle_of, indeterminate_point, variable_at


@dataclass(frozen=True, eq=False)
class _Graph:
    """A problem as Levenberg–Marquardt sees it, every step solved by GTSAM."""

    problem: Problem
    ground: gtsam.NonlinearFactorGraph

    def cost(self, state: State) -> float:
        return cost(self.problem, self.ground, state)

    def linearise(self, state: State, near: bool) -> Callable[[float], Trial]:
        system = linearise_all(self.problem, self.ground, state, LEAST_CURVATURE if near else 1.0)

        def step(damping: float) -> Trial:
            solution = damped_step(system, damping)
            moved = kept_in_front(self.problem, state, retract(self.problem, state, solution, near))
            return Trial(moved, self.cost(moved), solution.predicted_decrease)

        return step


def minimise_graph(
    problem: Problem,
    state: State,
    maximum_iterations: int,
    relative_tolerance: float,
    watch: Watch,
    first_damping: float = FIRST,
) -> Minimum:
    """Minimise with every point a variable of GTSAM's graph.

    Raises IndeterminateError when the linear system has no unique solution.
    """
    system = _Graph(problem, ground_graph(problem))
    return minimise(system, state, maximum_iterations, relative_tolerance, watch, first_damping)


def minimise_problem(
    problem: Problem,
    state: State,
    maximum_iterations: int,
    relative_tolerance: float,
    watch: Watch,
    solver: SolverName,
    first_damping: float = FIRST,
) -> Minimum:
    """Minimise with all points eliminated, the reduced system solved by ``solver``.

    Raises IndeterminateError when the linear system has no unique solution.
    """
    bundle = bundle_of(problem, state)
    try:
        return minimise_bundle(bundle, state, maximum_iterations, relative_tolerance, watch, solver, first_damping)
    except SingularError as error:
        raise IndeterminateError(variable_at(bundle.layout, error.column)) from error
    except SingularPointError as error:
        raise indeterminate_point(error) from error
