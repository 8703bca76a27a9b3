"""Bundle adjustment with the points eliminated: Levenberg–Marquardt on the reduced system.

``minimise_bundle`` is the engine of the joint adjustment; ``adjust_bundle`` is the adjustment of a growing block in a
free gauge, with nothing known of the ground.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped, unused-ignore]

from photogram.arrays import BoolArray, FloatArray
from photogram.factors.elimination.levenberg_marquardt import FIRST, Minimum, Singular, Trial, Watch, minimise, nobody
from photogram.factors.elimination.loss import NO_LOSS, Loss, RobustLoss, steering
from photogram.factors.elimination.points import (
    CHUNKS,
    MANY_OBSERVATIONS,
    Points,
    Rays,
    eliminate,
    first_observations,
    lay_out,
    observation_cost,
    substitute,
)
from photogram.factors.elimination.reduced import Layout, NormalEquations, SingularError, Terms, make_layout
from photogram.factors.elimination.reprojection import Observations, calibration_scale
from photogram.factors.elimination.similarity_steps import bend_of, bent
from photogram.factors.elimination.solvers import SOLVERS, Solver, SolverName
from photogram.factors.elimination.state import OfCameras, State
from photogram.machine import cores
from photogram.projection import FOCAL, OrientedCameras, recalibrated


class SingularPointError(Singular):
    """A point's own normal equations are singular; ``kind`` is "tie" or "control"."""

    def __init__(self, kind: str, point: int) -> None:
        super().__init__(f"{kind} point {point} cannot be intersected")
        self.kind, self.point = kind, point


class Ground(Protocol):
    """What is known of the cameras and the ground besides image points."""

    def cost(self, state: State) -> float:
        """Return half the sum of squared whitened residuals."""

    def linearise(self, state: State) -> Terms:
        """Return the information at ``state``."""


@dataclass(frozen=True, eq=False)
class Bundle:
    """What is minimised: rays of tie points under a loss, marks of control points without one, and the ground."""

    layout: Layout
    tie: Rays
    marks: Rays
    ground: Ground
    loss: Loss

    def eliminated(
        self, state: State, terms: Terms, damping: float, pool: ThreadPoolExecutor | None
    ) -> NormalEquations:
        """Return the reduced normal equations. Raises SingularPointError where the rays of a point are parallel."""
        normal = NormalEquations.zero(self.layout)
        lost = eliminate(self.tie, state.cameras, Points.unknown(state.tie_point), normal, self.loss, damping, pool)
        if lost >= 0:
            raise SingularPointError("tie", lost)
        control = Points(state.control, terms.control_prior)
        lost = eliminate(self.marks, state.cameras, control, normal, NO_LOSS, damping)
        if lost >= 0:
            raise SingularPointError("control", lost)
        terms.add_to(normal)
        return normal

    def cost(self, state: State, pool: ThreadPoolExecutor | None = None) -> float:
        """Return half the sum of squared whitened residuals, those of tie points under the loss."""
        tie = observation_cost(self.tie, state.cameras, state.tie_point, self.loss, pool)
        marks = observation_cost(self.marks, state.cameras, state.control, NO_LOSS)
        return tie + marks + self.ground.cost(state)


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def limited_threads(observations: int) -> Iterator[ThreadPoolExecutor | None]:
    """Give a pool for the work on so many observations, None when one thread does it sooner.

    Within, BLAS keeps to one thread: more of them slow down the compiled kernels beside it, and sum in an order that
    depends on the number of cores.
    """
    threads = min(CHUNKS, cores())
    with _blas().limit(limits=1, user_api="blas"):
        if observations < MANY_OBSERVATIONS or threads == 1:
            yield None
            return
        with ThreadPoolExecutor(threads) as pool:
            yield pool


def _moved(
    bundle: Bundle, state: State, poses: FloatArray, border: FloatArray, whole: bool
) -> tuple[State, FloatArray]:
    """Move cameras, offsets and the border's control points by a step: R Exp(ω), C + R v, and sums for the rest; where
    it moves the ``whole`` block, its rotation and scale exactly. Returns also what ``bend_of`` adds for these."""
    layout = bundle.layout
    tangent = np.zeros((len(state.rotation), 6))
    tangent[layout.photograph_at] = poses.reshape(-1, 6)
    parameters, free = state.parameters.copy(), layout.free_parameters
    parameters[free] += border[: layout.offset_column] * layout.unit[free]
    turned, moved = np.einsum("nij,nkj->kni", state.cameras.rotation, tangent.reshape(-1, 2, 3))
    at = layout.photograph_at
    bend = bend_of(state.position[at], moved[at], turned[at]) if whole else np.zeros((4, 3))
    moved[at] += bent(bend, state.position[at])
    control, coupled = state.control.copy(), layout.coupled
    control[coupled] += border[layout.ground_column :].reshape(-1, 3) + bent(bend, state.control[coupled])
    result = replace(
        state,
        cameras=recalibrated(state.cameras, parameters)._replace(
            rotation=state.cameras.rotation @ Rotation.from_rotvec(tangent[:, :3]).as_matrix(),
            position=state.position + moved,
        ),
        control=control,
        offset=state.offset + border[layout.offset_column : layout.common_column].reshape(-1, 3),
        common=state.common + border[layout.common_column : layout.ground_column],
    )
    return result, bend


@dataclass(frozen=True, eq=False)
class _System:
    """A bundle as Levenberg–Marquardt sees it, its work shared by the threads of ``pool``; ``whole`` where none of the
    photographs with observations is fixed."""

    bundle: Bundle
    solve: Solver
    pool: ThreadPoolExecutor | None
    whole: bool

    def cost(self, state: State) -> float:
        return self.bundle.cost(state, self.pool)

    def linearise(self, state: State, near: bool) -> Callable[[float], Trial]:
        terms = self.bundle.ground.linearise(state)
        loss = self.bundle.loss if near else self.bundle.loss.weights_alone()
        bundle = replace(self.bundle, loss=loss)
        return lambda damping: self._step(bundle, state, terms, damping, near)

    def _step(self, bundle: Bundle, state: State, terms: Terms, damping: float, near: bool) -> Trial:
        pool = self.pool
        normal = bundle.eliminated(state, terms, damping, pool)
        poses, border = self.solve(normal, damping)
        moved, bend = _moved(bundle, state, poses, border, self.whole and near)
        old, new = state.cameras, moved.cameras
        step, layout = (poses, border), bundle.layout
        ties, control = Points.unknown(state.tie_point), Points(state.control, terms.control_prior)
        moved_ties, saved, tie = substitute(bundle.tie, old, ties, layout, bundle.loss, damping, step, new, bend, pool)
        moved_control, more, marks = substitute(bundle.marks, old, control, layout, NO_LOSS, damping, step, new, bend)
        damped = damping * (float(normal.D @ poses**2) + float(normal.F @ border**2))
        known = float(terms.pose_gradient @ poses) + float(terms.border_gradient @ border)
        moved_control[layout.coupled] = moved.control[layout.coupled]
        moved = replace(moved, tie_point=moved_ties, control=moved_control)
        return Trial(moved, tie + marks + bundle.ground.cost(moved), saved + more + 0.5 * (damped + known))


def minimise_bundle(
    bundle: Bundle,
    state: State,
    maximum_iterations: int,
    relative_tolerance: float,
    watch: Watch = nobody,
    solver: SolverName = "banded",
    first_damping: float = FIRST,
) -> Minimum:
    """Minimise by Levenberg–Marquardt, the reduced system solved by ``solver``.

    The same steps as those of the graph with every point a variable, but that points with mismatches are moved down
    their own cost after each. Raises SingularError or SingularPointError when no
    damping makes the system solvable.
    """
    with limited_threads(len(bundle.tie)) as pool:
        seen = np.concatenate([bundle.tie.photograph, bundle.marks.photograph])
        whole = bool((bundle.layout.place[seen] >= 0).all())
        system = _System(bundle, SOLVERS[solver](), pool, whole)
        return minimise(system, state, maximum_iterations, relative_tolerance, watch, first_damping)


# ---- blocks in a free gauge ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class BundleState(OfCameras):
    """A block in its own frame: ``cameras`` interior and exterior orientation, ``point`` (P, 3).

    ``cost`` is half the sum of squared whitened residuals under the loss, infinite before an adjustment; ``converged``
    is False when no step makes it smaller, or iterations ran out.
    """

    cameras: OrientedCameras
    point: FloatArray
    cost: float = float("inf")
    iterations: int = 0
    converged: bool = False


class _Priors:
    """Priors of calibrations and, with ``expected_position`` (N, 3), of all projection centres with one sigma."""

    def __init__(
        self,
        layout: Layout,
        expected: FloatArray,
        sigma: FloatArray,
        expected_position: FloatArray | None,
        sigma_position: float,
    ) -> None:
        self._layout = layout
        free = (layout.unit > 0) & np.isfinite(sigma)
        self._weight = np.where(free, 1.0 / np.where(free, sigma, 1.0) ** 2, 0.0)
        self._expected = expected
        self._position, self._position_weight = expected_position, sigma_position**-2.0

    def _off(self, state: State) -> FloatArray:
        """Return how far the free photographs (free, 3) are from where they are expected, in the order of the band."""
        index = self._layout.photograph_at
        return np.zeros((len(index), 3)) if self._position is None else (self._position - state.position)[index]

    def cost(self, state: State) -> float:
        calibration = np.sum(self._weight * (state.parameters - self._expected) ** 2)
        return 0.5 * float(calibration + self._position_weight * np.sum(self._off(state) ** 2))

    def linearise(self, state: State) -> Terms:
        layout, terms = self._layout, Terms.zero(self._layout, 0)
        free, columns = layout.free_parameters, np.arange(layout.offset_column)
        unit, weight = layout.unit[free], self._weight[free]
        terms.border[columns, columns] = weight * unit**2
        terms.border_gradient[columns] = weight * unit * (self._expected - state.parameters)[free]
        terms.pose[:, [3, 4, 5], [3, 4, 5]] = self._position_weight
        in_camera = np.einsum("nji,nj->ni", state.rotation[layout.photograph_at], self._off(state))
        terms.pose_gradient.reshape(-1, 6)[:, 3:] = self._position_weight * in_camera
        return replace(terms, cost=self.cost(state))


def adjust_bundle(
    observations: Observations,
    state: BundleState,
    *,
    fixed_poses: BoolArray,
    free: BoolArray,
    prior_sigma: FloatArray,
    prior_parameters: FloatArray,
    prior_position: FloatArray | None = None,
    prior_position_sigma: float = np.inf,
    loss: RobustLoss = "huber",
    threshold: float = 3.0,
    maximum_iterations: int = 20,
    relative_tolerance: float = 1e-6,
    watch: Watch = nobody,
    solver: SolverName = "banded",
) -> BundleState:
    """Adjust poses, points and free calibration parameters of a block from image observations and priors alone.

    Poses of the mask ``fixed_poses`` (N,) stay as they are; ``free`` (cameras, 12) are the parameters that move, with
    priors ``prior_parameters`` of ``prior_sigma`` (cameras, 12), infinite for none; ``prior_position`` (N, 3) of one
    ``prior_position_sigma`` hold the free projection centres. Observations sorted by point, of points with a finite
    position and two rays at least; points without observations stay. Nothing need fix the gauge: the damping does. A
    result that could not move has ``converged`` False.
    """
    index = np.flatnonzero(np.bincount(observations.point, minlength=len(state.point)))
    first = first_observations(np.searchsorted(index, observations.point), len(index))
    cameras = state.cameras
    seen = np.bincount(cameras.camera[observations.photograph], minlength=len(cameras.model)) > 0
    unit = np.array([calibration_scale(q[FOCAL]) for q in cameras.parameters]) * (free & seen[:, None])
    used = np.zeros(len(fixed_poses), dtype=bool)
    used[observations.photograph] = True
    layout = make_layout([(first, observations.photograph)], fixed_poses | ~used, cameras.position, unit)
    none = observations.select(np.zeros(len(observations), dtype=bool))
    bundle = Bundle(
        layout,
        lay_out(observations, index, layout),
        lay_out(none, np.zeros(0, np.int64), layout),
        _Priors(layout, prior_parameters, prior_sigma, prior_position, prior_position_sigma),
        steering(loss, threshold),
    )
    start = State(cameras, state.point, np.zeros((0, 3)), np.zeros((0, 3)))
    try:
        minimum = minimise_bundle(bundle, start, maximum_iterations, relative_tolerance, watch, solver)
    except (SingularError, SingularPointError):
        return replace(state, converged=False)
    s = minimum.state
    return BundleState(s.cameras, s.tie_point, minimum.cost, minimum.iterations, minimum.converged)
