"""Whether a known surface is control of the block: tested before it takes part, as any other observation.

The distances of tie points from the surface are known from the block alone first. What they have in common, an offset
in height and two slopes, has a covariance from the block and a prior from the surface; a surface that contradicts the
block is left out, and named. One that does not takes part, and the block is adjusted with it, linearised anew where the
block has moved to, until neither that nor the choice of points changes any more.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2, norm

from photogram.adjustment.oriented_subset import registered_block
from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.amendments.amendment import Decisive, Proposal, Solution
from photogram.amendments.surfaces.known_heights import KnownSurface
from photogram.amendments.surfaces.surface_points import FEWEST, OnSurface, on_surface
from photogram.arrays import FloatArray
from photogram.constraints.known_surface import IN_HEIGHT, SurfaceControl
from photogram.errors import PhotogramError
from photogram.factors.elimination.reduced import SingularError
from photogram.factors.elimination.state import State
from photogram.factors.functionals import factored, functions_of_tie_points
from photogram.factors.graph import IndeterminateError, Problem
from photogram.results import SIGNIFICANCE, Adjustment, Decision, SurfaceDecision
from photogram.survey import Block

MOST_ROUNDS = 8
"""Adjustments with the surface: each linearises it where the one before has put the block."""

SETTLED, SAME = 0.03, 0.02
"""Standard deviations by which a distance may still change, in the root mean square, and share of the points that may
come or go, for the surface to stay as it is."""

LEAST_KEPT = 0.5
"""Of the points on the surface: where fewer agree, nobody knows which of them are on stable ground."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """What a surface and a block without it differ by as a whole: the surface lies ``above_m`` (3,) the ground, in
    height and at the edge east and north, with the covariance (3, 3) of block and surface together."""

    above_m: FloatArray
    covariance_m2: FloatArray
    edge_m: float
    """Distance from the middle of the points at which slopes count."""

    @property
    def sigma_m(self) -> FloatArray:
        """Return the standard deviations (3,)."""
        return np.sqrt(np.diag(self.covariance_m2))

    @property
    def statistic(self) -> float:
        """Return the χ² of all three against zero."""
        return float(self.above_m @ np.linalg.solve(self.covariance_m2, self.above_m))

    @property
    def p(self) -> float:
        """Return the probability of as much by chance: of all three together, or of the one that stands out most."""
        single = IN_HEIGHT * 2.0 * float(norm.sf(np.abs(self.above_m / self.sigma_m).max()))
        return min(1.0, 2.0 * min(float(chi2.sf(self.statistic, IN_HEIGHT)), single))


def _solved(result: Adjustment, settings: AdjustmentSettings) -> tuple[Problem, State, Block]:
    """Return the problem of a solution, its state, and its block of registered photographs."""
    part, _ = registered_block(result.block)
    problem = make_problem(part, settings)
    control = np.array(result.block.control_points.role) == "control"
    state = replace(
        start_state(problem), control=result.estimates.ground_world_m[control], offset=result.estimates.offset_world_m
    )
    return problem, state, part


def agreement(found: OnSurface, points: tuple[Problem, State], tie: np.ndarray) -> Agreement:
    """Return what a surface and a block that has not known of it differ by; ``tie`` (K,) are the numbers of the tie
    points that take part. Raises IndeterminateError or SingularError where the block has no covariance."""
    part, kept = found.taking_part, found.kept
    in_height, in_plan = part.common[:, :IN_HEIGHT], part.common[:, IN_HEIGHT:] * part.common_sigma_m[IN_HEIGHT:]
    W = part.sigma_m**-2.0
    N = in_height.T @ (W[:, None] * in_height)
    G = np.linalg.solve(N, in_height.T * W)
    problem, state = points
    order = np.argsort(tie)
    stiff = factored(problem, state)
    a = np.einsum("ni,kn->nik", part.normal_world, G)[order]
    shared = functions_of_tie_points(problem, state, stiff.layout, tie[order], a).shared(stiff)
    xy = part.place_world_m[:, :2]
    edge_m = float(np.sqrt(np.mean(np.sum((xy - xy.mean(axis=0)) ** 2, axis=1))))
    above = -G @ found.as_it_lies_m[kept]
    of_plan = (G @ in_plan) @ (G @ in_plan).T
    return Agreement(above, np.linalg.inv(N) + shared + of_plan + np.diag(part.common_sigma_m[:IN_HEIGHT] ** 2), edge_m)


def _in_words(above_m: FloatArray, sigma_m: FloatArray, edge_m: float) -> str:
    """Return by how much a surface is off, in words."""
    side = "above" if above_m[0] >= 0.0 else "below"
    words = f"it lies {abs(above_m[0]):.2f} ± {sigma_m[0]:.2f} m {side} the ground of the block"
    slope = float(np.hypot(*above_m[1:]))
    if slope > 2.0 * float(np.hypot(*sigma_m[1:])):
        words += f", and is tilted against it by {slope:.2f} m over {edge_m:.0f} m"
    return words


class KnownSurfaces(Decisive):
    """A known surface as control of a block, or none."""

    about = "known surface"

    def __init__(self, surface: KnownSurface | None, settings: AdjustmentSettings) -> None:
        self._surface, self._settings = surface, settings
        self._found: OnSurface | None = None
        self._agreement: Agreement | None = None
        self._why = ""
        self._rounds = 0
        self._settled = surface is None

    def propose(self, solution: Solution) -> Proposal | None:
        """Return the block with the surface as control, linearised where it lies, None where it stays as it is."""
        if self._settled or self._surface is None:
            return None
        if self._why or solution.block.is_free:
            self._settled = True
            self._why = self._why or (
                "nothing says where the block is: give GNSS positions or control points, so that its photographs can "
                "be found on it"
            )
            return None
        there = solution.block.known_surface is not None
        if self._rounds == MOST_ROUNDS:
            self._settled = True
            return None
        result = solution.result
        problem, state, part = _solved(result, self._settings)
        found = on_surface(self._surface, result, part, state.cameras, adjusted=there)
        if found is None or found.kept.mean() < LEAST_KEPT:
            return self._without(solution, self._too_few(found))
        if not there:
            try:
                self._agreement = agreement(found, (problem, state), found.tie_points[found.kept])
            except (IndeterminateError, SingularError):
                return self._without(solution, "the covariance of the block without it cannot be computed")
            if self._agreement.p < SIGNIFICANCE:
                words = _in_words(self._agreement.above_m, self._agreement.sigma_m, self._agreement.edge_m)
                return self._without(solution, f"{words}, which neither their standard deviations nor chance explain")
        elif self._is_settled(found, solution.block.known_surface):
            self._found, self._settled = found, True
            return None
        self._found, self._rounds = found, self._rounds + 1
        photographs = np.flatnonzero(result.block.registered)
        whole = replace(found.taking_part, photograph=photographs[found.taking_part.photograph])
        return Proposal(replace(solution.block, known_surface=whole), solution.rejected, result)

    def _without(self, solution: Solution, why: str) -> Proposal | None:
        """Return the block without the surface, for the reason given; None where it has had none."""
        self._why, self._settled = why, True
        if solution.block.known_surface is None:
            return None
        return Proposal(replace(solution.block, known_surface=None), solution.rejected, solution.result)

    def _too_few(self, found: OnSurface | None) -> str:
        if found is None:
            return f"fewer than {FEWEST} tie points of three rays lie on smooth ground that it shows"
        return (
            f"of {len(found.kept)} points on it {int(found.kept.sum())} agree with each other, so that nobody can say "
            "which are on ground that has not changed: give the polygons of stable ground"
        )

    def _is_settled(self, found: OnSurface, before: SurfaceControl | None) -> bool:
        """Return whether a surface that takes part is as it would be linearised now, with the same points."""
        if before is None:
            return False
        now = found.taking_part
        changed = abs(len(now) - len(before))
        own = {tuple(pixel) for pixel in np.round(before.pixel, 6).tolist()}
        first = np.searchsorted(now.point, np.arange(len(now)))
        old = np.array([tuple(pixel) in own for pixel in np.round(now.pixel[first], 6).tolist()], dtype=bool)
        changed = max(changed, int(np.count_nonzero(~old)))
        nearest = np.linalg.norm(now.place_world_m[old][:, None] - before.place_world_m[None], axis=2).argmin(axis=1)
        off = (
            np.einsum("ni,ni->n", before.place_world_m[nearest] - now.place_world_m[old], now.normal_world[old])
            / now.sigma_m[old]
        )
        moved = float(np.sqrt(np.mean(off**2))) if len(off) else np.inf
        return changed <= SAME * len(now) and moved < SETTLED

    def judged(self, before: Solution, after: Solution | PhotogramError) -> Solution:
        """Return the solution with the surface, the one before with a warning where there is none."""
        if isinstance(after, PhotogramError) and not self._why:
            self._why, self._settled = f"the block cannot be adjusted with it: {after}", True
        return super().judged(before, after)

    def decision(self, solution: Solution) -> SurfaceDecision | None:
        """Return what was decided in the end, None without a surface."""
        surface, found = self._surface, self._found
        if surface is None:
            return None
        control = solution.block.known_surface
        adopted = control is not None
        offset, sigma, edge_m = np.full(3, np.nan), np.full(3, np.nan), float("nan")
        for common in solution.result.decisions.common_errors:
            if common.error.kind == "known_surface":
                offset, sigma = common.estimate[:IN_HEIGHT], np.sqrt(np.diag(common.covariance))[:IN_HEIGHT]
        known = self._agreement
        if known is not None:
            edge_m = known.edge_m
        if not adopted and known is not None:
            offset, sigma = known.above_m, known.sigma_m
        used = len(control) if control is not None else 0
        left = found.distance_m[found.kept] if adopted and found is not None else np.zeros(0)
        return SurfaceDecision(
            name=surface.name,
            adopted=adopted,
            used=used,
            set_aside=int(np.count_nonzero(~found.kept)) if adopted and found is not None else 0,
            mean_m=float(left.mean()) if len(left) else float("nan"),
            rms_m=float(np.sqrt(np.mean(left**2))) if len(left) else float("nan"),
            scatter=found.scatter if adopted and found is not None else float("nan"),
            above_m=offset,
            above_sigma_m=sigma,
            edge_m=edge_m,
            sigma_m=surface.sigma_m,
            common_sigma_m=surface.common_sigma_m,
            common_assumed=surface.common_assumed,
            statistic=known.statistic if known is not None else float("nan"),
            p=known.p if known is not None else float("nan"),
            why=self._why,
        )

    def decided(self, solution: Solution) -> Iterator[Decision]:
        """Yield the decision on the surface, if there is one."""
        made = self.decision(solution)
        if made is not None:
            rivals = () if made.adopted or np.isnan(made.p) else ("heights of GNSS positions and control points",)
            yield Decision(self.about, made.adopted, made.sentence, made.statistic, IN_HEIGHT, made.p, rivals)
