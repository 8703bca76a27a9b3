"""Marks and coordinates that contradict the rest grossly, from one linearisation of a block that is stiff without them.

The block is adjusted without any mark, and predicts all marks together, with their joint covariance C. With
P = (C + Σ)⁻¹, Σ the covariance of the marks themselves, the hypothesis that some columns H are added to them, a single
mark's own or those of its point's coordinates, has the statistic T = yᵀPH (HᵀPH)⁻¹ HᵀPy, χ² with as many degrees of
freedom as H has columns (Förstner & Wrobel 2016, sec. 4.6.4). The least likely one by chance is accepted, and the rest
tested again: nothing is adjusted in between, so that a mark on the far side of a photograph bends nothing.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.linalg import block_diag
from scipy.special import gammaln
from scipy.stats import chi2

from photogram.adjustment.oriented_subset import registered_block, without_marks
from photogram.adjustment.problem import AdjustmentSettings, make_problem, minimise, start_state
from photogram.amendments.gross_errors.hypothesis import Hypothesis, unmeasured
from photogram.arrays import FloatArray, IntArray
from photogram.factors.covariance import covariances, joint_marks
from photogram.factors.graph import IndeterminateError
from photogram.survey import Block

GROSS = float(np.log(1e-7))
"""Logarithm of the probability by chance below which a mark or a point is grossly off."""

BENT = 0.01
"""Of how far a mark is from its place: what the linearisation may be wrong by, as a standard deviation."""

LARGE = 400.0
"""Statistic from which on the first term is right to a hundredth."""

LEFT_OPEN = 1e4
"""Standard deviation of what an accepted hypothesis adds, px of a mark and m of a point."""


def gross_marks(block: Block, settings: AdjustmentSettings) -> list[Hypothesis] | None:
    """Return what contradicts the rest grossly among the marks of control points and their coordinates; None where the
    block is not determined without them.

    ``block`` has poses, and tie points that hold them together; all its points are control. Up to half of the marks may
    be wrong.
    """
    points = block.control_points
    part, kept = registered_block(without_marks(block, np.zeros(len(points.mark_point), dtype=bool)))
    place = np.full(len(block.photographs), -1)
    place[kept] = np.arange(len(kept))
    used = np.flatnonzero((place[points.mark_photograph] >= 0) & np.isfinite(points.mark_sigma_px))
    if not len(used):
        return []
    problem = make_problem(part, settings)
    try:
        state = minimise(problem, start_state(problem), settings).state
        covariance = covariances(problem, state)
    except IndeterminateError:
        return None
    predicted = joint_marks(problem, state, covariance, place[points.mark_photograph[used]], points.mark_point[used])
    off = points.mark_pixel[used] - predicted.pixel
    hidden = ~np.isfinite(off).all(axis=1)
    bent = BENT**2 * np.sum(np.nan_to_num(off) ** 2, axis=1)
    spread = points.mark_covariance_px2[used] + bent[:, None, None] * np.eye(2)
    kind = [*_hypotheses(block, used[~hidden], predicted.by_point[~hidden])]
    axis = np.repeat(~hidden, 2)
    C = predicted.covariance[np.ix_(axis, axis)] + block_diag(*spread[~hidden])
    accepted = _accepted([columns for _, columns in kind], off[~hidden].ravel(), C)
    behind = [_of_mark(block, m) for m in used[hidden].tolist()]
    marks = Counter(points.name[g] for g in points.mark_point[used].tolist())
    return _whole_where_most([*behind, *(kind[k][0] for k in accepted)], marks)


def _whole_where_most(accepted: Sequence[Hypothesis], marks: Mapping[str, int]) -> list[Hypothesis]:
    """Return the hypotheses with the whole point in place of more than half of its ``marks``: of few marks two are
    rejected as easily as the coordinates that all of them contradict."""
    wrong = Counter(a.name for a in accepted if a.kind == "mark")
    whole = [name for name, count in wrong.items() if 2 * count > marks[name] > 1]
    known = {a.name for a in accepted if a.kind == "control point"}
    rest = [a for a in accepted if a.kind != "mark" or a.name not in whole]
    return [*rest, *(unmeasured("control point", name) for name in whole if name not in known)]


def _of_mark(block: Block, mark: int) -> Hypothesis:
    points = block.control_points
    photograph = block.photographs[points.mark_photograph[mark]].name
    return unmeasured("mark", points.name[points.mark_point[mark]], photograph)


def _hypotheses(block: Block, used: IntArray, by_point: FloatArray) -> Iterator[tuple[Hypothesis, FloatArray]]:
    """Yield each hypothesis and its columns (2 M, 2 or 3)."""
    points = block.control_points
    for n, m in enumerate(used.tolist()):
        columns = np.zeros((2 * len(used), 2))
        columns[2 * n : 2 * n + 2] = np.eye(2)
        yield _of_mark(block, m), columns
    for g in np.unique(points.mark_point[used]).tolist():
        own = points.mark_point[used] == g
        if own.sum() > 1:
            yield (
                unmeasured("control point", points.name[g]),
                np.where(own[:, None, None], by_point, 0.0).reshape(-1, 3),
            )


def _accepted(columns: list[FloatArray], off: FloatArray, covariance: FloatArray) -> list[int]:
    """Return the numbers of the hypotheses that are accepted, in turn."""
    accepted: list[int] = []
    while len(accepted) < len(off) // 4 + 1:
        P = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        right = P @ off
        chances = [0.0 if k in accepted else _log_chance(H, P, right) for k, H in enumerate(columns)]
        best = int(np.argmin(chances)) if chances else -1
        if best < 0 or not chances[best] < GROSS:
            break
        accepted.append(best)
        covariance = covariance + LEFT_OPEN**2 * columns[best] @ columns[best].T
    return accepted


def _log_chance(columns: FloatArray, information: FloatArray, right: FloatArray) -> float:
    own = np.flatnonzero(columns.any(axis=1))
    H = columns[own]
    y = H.T @ right[own]
    statistic = float(y @ np.linalg.lstsq(H.T @ information[np.ix_(own, own)] @ H, y, rcond=None)[0])
    return log_chance(statistic, columns.shape[1])


def log_chance(statistic: float, degrees: int) -> float:
    """Return the logarithm of the probability by chance of a χ² ``statistic``, also where that is too small a number:
    by the first term of its asymptotic series (Abramowitz & Stegun 1964, 6.5.32)."""
    if statistic < LARGE:
        return float(chi2.logsf(statistic, degrees))
    half = 0.5 * statistic
    return float((0.5 * degrees - 1.0) * np.log(half) - half - gammaln(0.5 * degrees))
