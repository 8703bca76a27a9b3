"""Which common errors are unknowns of an adjustment: what the measured attitudes of a flight share always, what the
positions share where they show it.

A lever arm, a time offset between exposure and position, and a slow drift of the receiver are tested by their score at
a solution without them: with the weights W of the positions, their misfits v, and the effect J of the error on them,
the score s = Σ Jᵀ W v has the covariance K = Σ Jᵀ W J − Lᵀ Σ L, L = Σ Aᵀ W J, Σ the covariance of all unknowns and A
the Jacobian of v on them (Rao's score test; Förstner & Wrobel 2016, sec. 4.6.4). K⁻¹ s is what one step would give to
the error, everything else free to follow: residuals alone show it only in part, because the block bends and the
principal point moves by f a / H instead. Beside it stands an offset of each flight. Directions that something else can
take over carry little of the information that the positions have on them, and are no unknowns.

T = sᵀ K⁻¹ s is χ² with as many degrees of freedom as there are directions, if the stated sigmas are right; where the
positions scatter more than stated, T is divided by their variance factor after the error (as an F-test does), so that
neither sigmas that are too small nor a few gross errors pass for something common.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from photogram.adjustment.gnss_offsets import estimated_offset_test, measured_positions
from photogram.arrays import BoolArray, FloatArray
from photogram.factors.common_errors import attitude_errors, designs, members, parts
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.linearised.rotations import UP
from photogram.results import SIGNIFICANCE, CommonErrorEstimate, Reliability
from photogram.survey import Block, CommonError

LEAST_ATTITUDES = 3
"""Measured attitudes of a flight from which on their common error is an unknown."""
BORESIGHT_SIGMA_RAD, HEADING_SIGMA_RAD = float(np.deg2rad(1.0)), float(np.deg2rad(5.0))
"""Least prior sigmas of a boresight about each axis of the camera, and of a compass."""
BORESIGHT_SHARE, HEADING_SHARE = 0.5, 2.5
"""The same in sigmas of the measured attitudes."""

PRIOR_SIGMA = {"lever_arm": 1.0, "time_offset": 1.0, "drift": 10.0}
"""Prior sigmas, m, s, m over a flight, of an error that the positions have shown: they decide nothing."""
LEAST_POSITIONS = 6
"""Positions from which on errors of positions are looked for."""
LEAST_SHARE = 1e-3
"""Of the information that the positions have on an error, the least share left by everything else that is unknown for a
direction of it to be told at all."""
ADOPTED_SHARE = 0.01
"""The same for a direction to become an unknown: below it the error would pass for others, and they for it."""
LEAST_ARM_M = 0.05
"""A shorter arm that is left is within what antennas' phase centres and the moment of exposure leave: no word is lost
about it."""
LONGEST_ARM_M = 0.5
"""A longer arm fits no drone: where a time offset explains it as well, it is one."""
AS_WELL, NEARLY_AS_WELL = 4.0, 0.95
"""Difference of two statistics below which one error explains the positions as well as the other, and the share of the
larger beyond which it is worth a word."""
BY_CHANCE = 0.05
"""Probability from which the only error of positions is none: one that came in elsewhere, before a lens field or a
blunder was found that looked like it."""
MOST_CHANGES = 8
OF_NO_POSITIONS = ("attitude", "known_surface")


What = tuple[str, str | None, int | None]
"""Kind, flight and camera of a common error."""


@dataclass(frozen=True, eq=False)
class ResidualLeverArm:
    """An arm (3,) along the camera's axes that would be estimated, with its sigmas (3,), and the p of there being
    none; NaN for components that are not told, and p where none is."""

    arm_camera_m: FloatArray
    sigma_m: FloatArray
    p: float

    @property
    def significant(self) -> bool:
        """Return whether the positions show an arm that is worth a warning."""
        known = self.arm_camera_m[np.isfinite(self.arm_camera_m)]
        return bool(self.p < SIGNIFICANCE and len(known) and np.linalg.norm(known) > LEAST_ARM_M)


@dataclass(frozen=True, eq=False)
class Score:
    """What one step would give to an error: ``value`` (k,) along its directions ``basis`` (d, k) that are told, with
    the ``variance`` (k,) and the ``statistic`` T; nothing where k is 0."""

    basis: FloatArray
    value: FloatArray
    variance: FloatArray
    statistic: float

    @property
    def log_chance(self) -> float:
        """Return the logarithm of the probability of such a statistic by chance."""
        return float(chi2.logsf(self.statistic, len(self.value))) if len(self.value) else 0.0


def with_attitude_errors(block: Block) -> Block:
    """Return the block with an unknown common error of the measured attitudes of each flight and camera, where there
    are LEAST_ATTITUDES of them and none is given; the compass counts where a heading is known."""
    more, taken = [], attitude_errors(block)
    for flight, camera in sorted({(p.flight, p.camera) for p in block.photographs}):
        own = [
            p
            for p, error in zip(block.photographs, taken, strict=True)
            if (p.flight, p.camera) == (flight, camera) and p.attitude_sigma_rad is not None and error < 0
            and p.attitude_world_from_camera is not None
        ]  # fmt: skip
        if len(own) < LEAST_ATTITUDES:
            continue
        stated = float(np.median([p.attitude_sigma_rad for p in own]))
        sigma = [max(BORESIGHT_SIGMA_RAD, BORESIGHT_SHARE * stated)] * 3
        if any(p.heading_known for p in own):
            sigma.append(max(HEADING_SIGMA_RAD, HEADING_SHARE * stated))
        more.append(CommonError("attitude", flight, camera, np.array(sigma), np.zeros(len(sigma))))
    return replace(block, common_errors=(*block.common_errors, *more)) if more else block


def with_surface_error(block: Block) -> Block:
    """Return the block with an unknown error of its known surface as a whole, and without one where it has none."""
    surface, errors = block.known_surface, block.common_errors
    there = [error for error in errors if error.kind == "known_surface"]
    if surface is None:
        return replace(block, common_errors=tuple(e for e in errors if e not in there)) if there else block
    sigma = surface.common_sigma_m
    if there and np.array_equal(there[0].sigma, sigma):
        return block
    new = CommonError("known_surface", None, None, sigma, np.zeros(len(sigma)))
    return replace(block, common_errors=(*(e for e in errors if e not in there), new))


def score(
    problem: Problem, state: State, covariances: Covariances, design: FloatArray, least_share: float = LEAST_SHARE
) -> Score:
    """Return what one step would give to an error that moves positions by ``design`` (N, 3, d) in the world, NaN for
    those that do not have it, at the solution ``state`` with its ``covariances``."""
    layout = covariances.layout
    photographs = problem.block.photographs
    d = design.shape[2]
    positions = list(measured_positions(problem, state, layout))
    flights = [] if problem.flights else sorted({photographs[p.photograph].flight for p in positions})
    own = 3 * len(flights)
    N, s = np.zeros((own + d, own + d)), np.zeros(own + d)
    L = np.zeros((layout.columns + layout.border, own + d))
    for position in positions:
        rows = np.zeros((3, own + d))
        if np.isfinite(design[position.photograph]).all():
            rows[:, own:] = design[position.photograph]
        if flights:
            f = 3 * flights.index(photographs[position.photograph].flight)
            rows[:, f : f + 3] = np.eye(3)
        weighted = position.weight @ rows
        N += rows.T @ weighted
        s += weighted.T @ position.misfit
        L[position.columns] += position.jacobian.T @ weighted
    return _solved(N, N - covariances.between(L, L), s, own, least_share)


def _solved(N: FloatArray, K: FloatArray, s: FloatArray, own: int, least_share: float) -> Score:
    """Return the last unknowns of K x = s, those before, ``own`` in number, eliminated; ``N`` is K before the rest of
    the block took its share."""
    follow = K[own:, :own] @ _pseudo_inverse(K[:own, :own], np.trace(N[:own, :own]) / max(own, 1))
    M, t = K[own:, own:] - follow @ K[:own, own:], s[own:] - follow @ s[:own]
    value, U = np.linalg.eigh(M)
    d = len(value)
    determined = value > max(least_share * float(np.trace(N[own:, own:])) / d, 0.0)
    U, value = U[:, determined], value[determined]
    along = U.T @ t
    return Score(U, along / value, 1.0 / value, float(np.sum(along**2 / value)))


def _pseudo_inverse(K: FloatArray, scale: float) -> FloatArray:
    """Return the inverse of K on the directions that carry more than LEAST_SHARE of ``scale``."""
    if not len(K):
        return K
    value, U = np.linalg.eigh(K)
    kept = value > LEAST_SHARE * scale
    return np.asarray((U[:, kept] / value[kept]) @ U[:, kept].T)


def _known_components(basis: FloatArray) -> FloatArray:
    """Return 1 for components that directions (d, k) span, NaN for the others."""
    return np.where(np.sum(basis**2, axis=1) > 0.99, 1.0, np.nan)


def residual_lever_arm(problem: Problem, state: State, covariances: Covariances) -> ResidualLeverArm:
    """Return the lever arm that is left at the solution ``state`` with its ``covariances``."""
    step = score(problem, state, covariances, state.rotation)
    if not len(step.value):
        return ResidualLeverArm(np.full(3, np.nan), np.full(3, np.nan), float("nan"))
    known = _known_components(step.basis)
    sigma = np.sqrt(step.basis**2 @ step.variance)
    return ResidualLeverArm(known * (step.basis @ step.value), known * sigma, float(np.exp(step.log_chance)))


# ---- which errors become unknowns ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Candidate:
    """An error that is no unknown yet, what one step would give to it, and T over the variance factor of the positions
    that have it."""

    error: CommonError
    score: Score
    statistic: float

    @property
    def log_chance(self) -> float:
        return float(chi2.logsf(self.statistic, len(self.score.value)))

    @property
    def size(self) -> float:
        return float(np.linalg.norm(self.score.value))

    @property
    def words(self) -> str:
        if self.error.kind == "lever_arm":
            return f"an arm of {self.size:.3f} m from the antenna to the camera"
        return f"a time offset of {1000.0 * self.score.value[0] * self.score.basis[0, 0]:+.0f} ms"


@dataclass(frozen=True, eq=False)
class Change:
    """The next change: the common errors that are unknowns from now on, and, where another explains the positions as
    well as the one that is new, that other in words, by the kind and camera of the new one."""

    errors: tuple[CommonError, ...]
    as_well: dict[tuple[str, int | None], str]
    dropped: What | None = None


def _possible(block: Block) -> Iterator[CommonError]:
    """Yield the errors of positions that a block may have: an arm and a time offset by camera, for all flights, and a
    drift by flight."""
    photographs = [p for p in block.photographs if p.gnss_world_m is not None]
    one = np.zeros(1)
    for camera in sorted({p.camera for p in photographs}):
        yield CommonError("lever_arm", None, camera, np.zeros(3), np.zeros(3), np.eye(3))
        yield CommonError("time_offset", None, camera, one, one)
    for flight in sorted({p.flight for p in photographs}):
        yield CommonError("drift", flight, None, np.zeros(3), np.zeros(3))


def _what(error: CommonError) -> What:
    return error.kind, error.flight, error.camera


def _variance_factor(r: Reliability, own: BoolArray, statistic: float, degrees: int) -> float:
    """Return by what the positions of the mask (N,) scatter more than stated once an error of the ``statistic`` is
    removed, 1 at least."""
    known = np.isfinite(r.gnss_w[own]) & np.isfinite(r.gnss_redundancy[own])
    redundancy = float(r.gnss_redundancy[own][known].sum()) - degrees
    squares = float(np.sum(r.gnss_w[own][known] ** 2 * r.gnss_redundancy[own][known])) - statistic
    return max(1.0, squares / redundancy) if redundancy > 1.0 else float("inf")


def _candidates(
    problem: Problem, state: State, covariances: Covariances, tested: Reliability, barred: Sequence[What]
) -> Iterator[_Candidate]:
    photographs = problem.block.photographs
    taken = {_what(error) for error in problem.block.common_errors}
    has = np.array([p.gnss_world_m is not None for p in photographs], dtype=bool)
    for error in _possible(problem.block):
        own = has & members(photographs, error)
        if _what(error) in taken or _what(error) in barred or own.sum() < LEAST_POSITIONS:
            continue
        design = designs(photographs, error)
        if not np.isfinite(design[own]).all():
            continue  # the velocity or the time of some is not known: they would be in error by what others are rid of
        if error.kind == "lever_arm":
            design = np.where(own[:, None, None], state.rotation, np.nan)
        step = score(problem, state, covariances, design, ADOPTED_SHARE)
        if len(step.value):
            factor = _variance_factor(tested, own, step.statistic, len(step.value))
            yield _Candidate(error, step, step.statistic / factor)


def _adopted(candidate: _Candidate) -> CommonError:
    """Return the error of a candidate as an unknown."""
    error, k = candidate.error, len(candidate.score.value)
    prior = PRIOR_SIGMA[error.kind]
    if error.kind == "lever_arm":
        return replace(error, sigma=np.full(k, prior), value=np.zeros(k), basis=candidate.score.basis)
    return replace(error, sigma=np.full(len(error.value), prior), value=np.zeros(len(error.value)))


def _chosen(significant: list[_Candidate]) -> tuple[_Candidate, _Candidate | None]:
    """Return the candidate least likely by chance, and another that explains the positions as well.

    Of an arm and a time offset of one camera that explain them alike, the arm is taken unless no drone has such a one,
    and that which explains them better where they differ.
    """
    first, *rest = sorted(significant, key=lambda c: c.log_chance)
    pair = {"lever_arm", "time_offset"}
    rivals = [
        c
        for c in rest
        if {c.error.kind, first.error.kind} == pair
        and c.error.camera == first.error.camera
        and (first.statistic - c.statistic < AS_WELL or c.statistic > NEARLY_AS_WELL * first.statistic)
    ]
    if not rivals or first.statistic - rivals[0].statistic >= AS_WELL:
        return first, rivals[0] if rivals else None
    arm, time = (first, rivals[0]) if first.error.kind == "lever_arm" else (rivals[0], first)
    return (arm, time) if arm.size <= LONGEST_ARM_M else (time, arm)


def _test(problem: Problem, state: State, covariances: Covariances, k: int) -> tuple[float, int, float]:
    """Return statistic, degrees of freedom and p of a common error against zero; NaN where only its prior is known."""
    error, part = problem.block.common_errors[k], parts(problem.block.common_errors)[k]
    test = estimated_offset_test(state.common[part], covariances.common(k), error.sigma)
    return test.chi2, test.degrees, test.p


def next_change(
    problem: Problem, state: State, covariances: Covariances, tested: Reliability, barred: Sequence[What]
) -> Change | None:
    """Return which common error of positions to add or to drop at a solution, None where the unknowns are right.

    An unknown is dropped when it is no longer significant beside one that came later, or may well be chance, and
    ``barred`` from then on; one is added at a time, the least likely by chance; of several flights or cameras that may
    have one of a kind, each is held to its share of the level (Bonferroni), so that a survey of many flights invents no
    more than one of few.
    """
    errors = problem.block.common_errors
    of_positions = [k for k, error in enumerate(errors) if error.kind not in OF_NO_POSITIONS]
    if of_positions:
        p = np.nan_to_num([_test(problem, state, covariances, k)[2] for k in of_positions], nan=1.0)
        worst = of_positions[int(np.argmax(p))]
        if p.max() >= (SIGNIFICANCE if len(of_positions) > 1 else BY_CHANCE):
            return Change(tuple(e for k, e in enumerate(errors) if k != worst), {}, _what(errors[worst]))
    candidates = list(_candidates(problem, state, covariances, tested, barred))
    of_kind = Counter(c.error.kind for c in candidates)
    significant = [c for c in candidates if c.log_chance < np.log(SIGNIFICANCE / of_kind[c.error.kind])]
    if not significant:
        return None
    new, rival = _chosen(significant)
    rivals = [] if rival is None else [rival.words]
    return Change((*errors, _adopted(new)), {(str(new.error.kind), new.error.camera): words for words in rivals})


def values_after(problem: Problem, state: State, errors: Sequence[CommonError]) -> FloatArray:
    """Return the values to start from with other common errors: those that stay keep theirs, new ones are zero."""
    old = problem.block.common_errors
    known = {_what(e): state.common[part] for e, part in zip(old, parts(old), strict=True)}
    own = sum(len(error.sigma) for error in old)  # relative poses of rigs come behind them, and stay
    values = [known.get(_what(e), np.zeros(len(e.sigma))) for e in errors]
    return np.concatenate([np.zeros(0), *values, state.common[own:]])


def estimates(
    problem: Problem,
    state: State,
    fixed: Covariances,
    counted: Covariances,
    as_well: dict[tuple[str, int | None], str],
) -> tuple[CommonErrorEstimate, ...]:
    """Return the common errors as they were estimated, with the covariances ``counted``, and tested with those of the
    adjustment as it stands, ``fixed``."""
    block, estimated = problem.block, []
    for k, (error, part) in enumerate(zip(block.common_errors, parts(block.common_errors), strict=True)):
        statistic, degrees, p = _test(problem, state, fixed, k)
        value, G = state.common[part], np.eye(len(error.sigma))
        own = members(block.photographs, error)
        if error.kind == "attitude":
            G = np.eye(3)
            if len(error.sigma) == 4:
                measured = own & np.array([p.attitude_sigma_rad is not None for p in block.photographs])
                G = np.column_stack([G, (state.rotation[measured].transpose(0, 2, 1) @ UP).mean(axis=0)])
        elif error.kind == "lever_arm":
            G = _known_components(error.basis)[:, None] * error.basis
        elif error.kind == "drift":
            G = block.frame.rotation_world_from_map(np.zeros(3)).T
        photographs = (
            0
            if error.kind == "known_surface"
            else sum(
                m and (p.attitude_sigma_rad if error.kind == "attitude" else p.gnss_world_m) is not None
                for m, p in zip(own.tolist(), block.photographs, strict=True)
            )
        )
        estimated.append(
            CommonErrorEstimate(
                replace(error, value=value.copy()),
                G @ value,
                G @ counted.common(k) @ G.T,
                photographs,
                statistic,
                degrees,
                p,
                as_well.get((error.kind, error.camera), ""),
            )
        )
    return tuple(estimated)
