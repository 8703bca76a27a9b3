"""The two engines of the joint adjustment: the graph with every point a variable, and the reduced system."""

from photogram.factors.elimination.bundle import SingularPointError, minimise_bundle
from photogram.factors.elimination.levenberg_marquardt import FIRST, Minimum, Watch, minimise
from photogram.factors.elimination.reduced import SingularError
from photogram.factors.elimination.solvers import SolverName, need_gtsam
from photogram.factors.elimination.state import State
from photogram.factors.graph import IndeterminateError, Problem, ground_factors
from photogram.factors.ground_terms import bundle_of, indeterminate_point, variable_at


def minimise_graph(
    problem: Problem,
    state: State,
    maximum_iterations: int,
    relative_tolerance: float,
    watch: Watch,
    first_damping: float = FIRST,
) -> Minimum:
    """Minimise with every point a variable of GTSAM's graph.

    Raises IndeterminateError when the linear system has no unique solution, AdjustmentError without GTSAM.
    """
    need_gtsam("engine: reference")
    from photogram.factors.reference.graph import ReferenceSystem, ground_graph

    system = ReferenceSystem(problem, ground_graph(problem), ground_factors(problem))
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
