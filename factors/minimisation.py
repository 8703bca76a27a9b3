"""The two engines of the joint adjustment: the graph with every point a variable, and the reduced system."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from photogram.factors.bundle import Minimum, SingularPointError, minimise_bundle
from photogram.factors.damping import Damping
from photogram.factors.graph import (
    IndeterminateError,
    Problem,
    State,
    cost,
    damped_step,
    ground_graph,
    linearise_all,
    retract,
)
from photogram.factors.ground_terms import bundle_of, indeterminate_point, variable_at
from photogram.factors.reduced import SingularError

Progress = Callable[[str], None]


def minimise_graph(
    problem: Problem, state: State, maximum_iterations: int, relative_tolerance: float, progress: Progress
) -> Minimum:
    """Minimise by Levenberg–Marquardt (Marquardt 1963) with the damping update of Nielsen (1999), every step solved by
    GTSAM.

    Raises IndeterminateError when the linear system has no unique solution.
    """
    graph = ground_graph(problem)
    current = cost(problem, graph, state)
    if not np.isfinite(current):
        return Minimum(state, current, 0, False)
    damping = Damping()
    for iteration in range(1, maximum_iterations + 1):
        system = linearise_all(problem, graph, state)
        while True:
            step = damped_step(system, damping.value)
            candidate = retract(problem, state, step)
            value = cost(problem, graph, candidate)
            gain = (current - value) / step.predicted_decrease if step.predicted_decrease > 0 else 0.0
            small = step.predicted_decrease <= relative_tolerance * max(current, 1e-12)
            if gain > 0 and np.isfinite(value):
                break
            if small:
                return Minimum(state, current, iteration, True)
            if not damping.refuse():
                return Minimum(state, current, iteration, False)
        saved = current - value
        state, current = candidate, value
        damping.accept(gain)
        progress(f"iteration {iteration}: cost {current:.6g}")
        if small or saved <= relative_tolerance * max(current, 1e-12):
            return Minimum(state, current, iteration, True)
    return Minimum(state, current, maximum_iterations, False)


def minimise_problem(
    problem: Problem, state: State, maximum_iterations: int, relative_tolerance: float, progress: Progress
) -> Minimum:
    """Minimise with all points eliminated.

    Raises IndeterminateError when the linear system has no unique solution.
    """
    bundle = bundle_of(problem, state)
    try:
        return minimise_bundle(bundle, state, maximum_iterations, relative_tolerance, progress)
    except SingularError as fault:
        raise IndeterminateError(variable_at(bundle.layout, fault.column)) from fault
    except SingularPointError as fault:
        raise indeterminate_point(fault) from fault
