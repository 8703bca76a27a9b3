"""Levenberg–Marquardt for both engines: how the damping changes, and when to stop.

The diagonal of the normal equations is raised by the damping (Marquardt 1963), which follows the ratio of the decrease
of the cost to what the linear model had predicted (Nielsen 1999, eq. 2.4). Iterations end when what is still to be
saved is below a fraction of the cost. With successive decreases s', s of ratio c = s / s' it is about s c / (1 − c): a
minimum approached quadratically is known one step earlier than by s alone, and one approached slowly, as under a robust
loss, is not taken for reached because steps are short. Nor is one where it was the damping that kept them short: a
last step is tried without.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from photogram.factors.elimination.state import State

FIRST, LEAST, GREATEST = 1e-5, 1e-12, 1e12
FIRST_NEAR = 1e-10  # from another minimum: what is hardly told moves at once
HOLDING = 1e-7  # what the photographs hardly tell, such as focal length against height, moves little above it
NEAR = 0.1  # of the cost: what the last step saved where the minimum is near
ROUNDING = 1e-12  # of the cost
Watch = Callable[[int, float], None]
_LOG = logging.getLogger(__name__)


def nobody(_iteration: int, _cost: float) -> None:
    """Watch nothing."""


class Singular(ArithmeticError):  # noqa: N818 - the matrix is, the error says of what
    """A linear system has no unique solution at the damping given."""


@dataclass
class Damping:
    """How much the diagonal of the normal equations is raised, and by how much more after the next refusal."""

    value: float = FIRST
    growth: float = 2.0

    @property
    def exhausted(self) -> bool:
        """Return whether another refusal would raise it beyond what moves anything."""
        return self.value * self.growth > GREATEST

    def refuse(self) -> bool:
        """Raise the damping after a step that saved nothing; returns whether another attempt is worth while."""
        self.value *= self.growth
        self.growth *= 2.0
        return self.value <= GREATEST

    def accept(self, gain: float) -> None:
        """Lower the damping after a step that saved ``gain`` times what the linear model had predicted."""
        self.value = max(LEAST, self.value * max(0.1, 1.0 - (2.0 * gain - 1.0) ** 3))
        self.growth = 2.0

    def release(self) -> bool:
        """Lower the damping to the least; returns whether it was so high that steps may have been short for it."""
        was_high, self.value = self.value > HOLDING, LEAST
        return was_high


@dataclass(frozen=True, eq=False)
class Trial:
    """The end of a damped step, its cost, and the decrease that the linear model predicts."""

    state: State
    cost: float
    predicted: float


class System(Protocol):
    """What is minimised."""

    def cost(self, state: State) -> float:
        """Return the cost at ``state``."""

    def linearise(self, state: State, near: bool) -> Callable[[float], Trial]:
        """Return the function from a damping to the step from ``state``, which raises Singular when there is none;
        ``near`` the minimum or not."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where Levenberg–Marquardt stopped, after how many linearisations; ``converged`` is False when no step makes the
    cost smaller, or iterations ran out."""

    state: State
    cost: float
    iterations: int
    converged: bool


def remaining(saved: float, before: float) -> float:
    """Return what steps to come will save, from what the last one saved and the one ``before`` it, 0 for none."""
    ratio = saved / before if before > 0 else 0.5
    return float("inf") if ratio >= 1.0 else saved * ratio / (1.0 - ratio)


def minimise(
    system: System,
    state: State,
    maximum_iterations: int,
    relative_tolerance: float,
    watch: Watch = nobody,
    first_damping: float = FIRST,
) -> Minimum:
    """Minimise from ``state``; ``watch`` hears of every step taken.

    Stops when the cost has less than ``relative_tolerance`` of itself to lose. Raises Singular when no damping makes
    the system solvable.
    """
    damping = Damping(first_damping)
    current = system.cost(state)
    before = 0.0
    released = False
    for iteration in range(1, maximum_iterations + 1):
        step, settled = system.linearise(state, 0.0 < before < NEAR * current), relative_tolerance * max(current, 1e-12)
        while True:
            trial, saved = None, 0.0
            try:
                trial = step(damping.value)
            except Singular:
                if damping.exhausted:
                    raise
            if trial is not None:
                saved = _saved(current, trial)
                if saved > 0:
                    break
                if trial.predicted <= settled:
                    return Minimum(state, current, iteration, True)
            if not damping.refuse():
                return Minimum(state, current, iteration, False)
        damping.accept(saved / trial.predicted if trial.predicted > 0 else 0.0)
        state, current = trial.state, trial.cost
        watch(iteration, current)
        _LOG.debug("iteration %d: cost %.6g, damping %.1g", iteration, current, damping.value)
        if min(trial.predicted, remaining(saved, before)) <= settled:
            if released or not damping.release():
                return Minimum(state, current, iteration, True)
            released = True
        before = saved
    return Minimum(state, current, maximum_iterations, False)


def _saved(current: float, trial: Trial) -> float:
    """Return what a step saves; where rounding hides it, on the word of the linear model. Nothing is saved by a step
    that no camera can take: to a focal length that is not positive, or out of the numbers."""
    if not (np.all(trial.state.parameters[:, 0] > 0.0) and np.isfinite(trial.cost)):
        return -np.inf
    saved, hidden = current - trial.cost, ROUNDING * current
    return trial.predicted if abs(saved) <= hidden and 0.0 < trial.predicted <= hidden else saved
