"""The datum of a block: how far what is weak is the block moved, turned or scaled as a whole.

Image points alone leave seven directions open: three shifts, three turns and the scale. As tangents of the poses,
photograph i moves by v = Rᵀ (t + θ × (C − C₀) + s (C − C₀)) and turns by ω = Rᵀ θ, about the centroid C₀ of the
projection centres. Their least-squares fit to any change of the poses, a turn weighted by the distance to the ground,
takes the datum out of it (an S-transformation, Baarda 1973); what is left belongs to single photographs.
"""

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray
from photogram.factors.elimination.reduced import Layout
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem

SHIFT, TURN, SCALE = range(3)
PARTS = (slice(0, 3), slice(3, 6), slice(6, 7))  # of the seven directions
SAMPLE = 100_000  # rays, from which the distance to the ground is taken


@dataclass(frozen=True, eq=False)
class Datum:
    """``directions`` (6 free + border, 7): shifts east, north, up in m, turns about these axes in rad, the scale;
    ``fit`` (6 free + border, 7), the functions that fit them to a change of all variables; ``metric`` (6 free +
    border,), the squared weights of that change, zero for the border; the ``state`` and the ``distance_m`` to the
    ground that it was made of."""

    directions: FloatArray
    fit: FloatArray
    metric: FloatArray
    state: State
    distance_m: float

    def share(self, change: FloatArray) -> float:
        """Return the share of a change (6 free + border,) of all poses that is one of the block as a whole."""
        whole = self.directions @ (self.fit.T @ change)
        return float(self.metric @ whole**2 / max(float(self.metric @ change**2), 1e-300))

    def main_part(self, change: FloatArray) -> int:
        """Return whether the block is above all shifted, turned or scaled by a change: SHIFT, TURN or SCALE."""
        amount = self.fit.T @ change
        moved = [self.directions[:, part] @ amount[part] for part in PARTS]
        return int(np.argmax([self.metric @ m**2 for m in moved]))

    def own(self, rows: slice) -> FloatArray:
        """Return the functions (6 free + border, 6) of a photograph's ``rows`` without the part that is the block's."""
        columns = -self.fit @ self.directions[rows].T
        columns[rows] += np.eye(rows.stop - rows.start)
        return columns


def reach_m(problem: Problem, state: State) -> float:
    """Return the median distance, m, of the tie points from the photographs that show them, or of control points where
    there are none."""
    if problem.summary is not None:
        return problem.summary.reach_m
    tie = problem.tie if len(problem.tie) else problem.marks
    points = state.tie_point if len(problem.tie) else state.control
    chosen = np.linspace(0, max(len(tie) - 1, 0), min(len(tie), SAMPLE)).astype(np.int64)
    ray = points[tie.point[chosen]] - state.position[tie.photograph[chosen]]
    return float(np.median(np.linalg.norm(ray, axis=1))) if len(chosen) else 1.0


def datum_of(layout: Layout, state: State, distance_m: float, weight: FloatArray | None = None) -> Datum:
    """Return the datum of the block at ``state``.

    ``distance_m`` to the ground makes a turn comparable to a shift; ``weight`` (N,) of the photographs, alike where it
    is not given.
    """
    count = len(state.position)
    weight = np.ones(count) if weight is None else weight
    R, C = state.rotation, state.position - weight @ state.position / weight.sum()
    directions = np.zeros((layout.columns + layout.border, 7))
    metric = np.zeros(layout.columns + layout.border)
    into = R.transpose(0, 2, 1)
    turns = np.cross(np.eye(3)[None], C[:, None, :]).transpose(0, 2, 1)  # columns: east, north, up × (C − C₀)
    rows = 6 * layout.place[:, None] + np.arange(6)
    directions[rows[:, :3], 3:6] = into
    directions[rows[:, 3:], :3] = into
    directions[rows[:, 3:], 3:6] = into @ turns
    directions[rows[:, 3:], 6] = np.einsum("nij,nj->ni", into, C)
    metric[rows[:, :3]] = (weight * distance_m**2)[:, None]
    metric[rows[:, 3:]] = weight[:, None]
    weighted = metric[:, None] * directions
    unit = np.sqrt(np.maximum(np.einsum("ij,ij->j", weighted, directions), 1e-300))
    normal = directions.T @ weighted / np.outer(unit, unit)
    fit = weighted / unit @ np.linalg.pinv(normal, rcond=1e-10, hermitian=True) / unit
    return Datum(directions, fit, metric, state, distance_m)


def weights_of(pose_covariance: FloatArray, distance_m: float) -> FloatArray:
    """Return weights (N,) of photographs by the covariances (N, 6, 6) of their poses: less where one is known worse
    than most, so that it does not pass for the block."""
    variance = np.einsum("naa->na", pose_covariance) @ np.repeat([distance_m**2, 1.0], 3)
    return np.asarray(np.minimum(1.0, np.median(variance) / np.maximum(variance, 1e-300)))
