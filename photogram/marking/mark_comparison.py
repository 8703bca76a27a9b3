"""What marks say of each other while they are made: which of them contradict the rest, and which point they would fit.

The tests are those of the adjustment (Baarda 1968), on a block of tags and marks or on the adjusted one: every ground
point takes part with its survey, check points too, for nothing of this enters a result.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.gross_errors.blunder_naming import Blunder, exchanged_points, name_blunders
from photogram.amendments.gross_errors.data_snooping import (
    PRICE,
    REINSTATED,
    Adjuster,
    Search,
    chance_of_coordinates,
    search,
    simplified,
    whole_points,
    without,
)
from photogram.amendments.gross_errors.hypothesis import Hypothesis
from photogram.amendments.gross_errors.robust_start import gross_suspects
from photogram.arrays import FloatArray
from photogram.errors import AdjustmentError
from photogram.marking.gross_marks import gross_marks
from photogram.marking.predictions import PredictedPlaces, predicted_places
from photogram.marking.tagged_block import with_all_points
from photogram.results import Adjustment
from photogram.survey import Block, ControlPoints

FITS = 0.001
"""Probability by chance above which a mark fits another point."""

LEAST_MARKS = 3
"""Marks of a point from which on each of them is compared with the others."""


MARKED = ("mark", "control point")
"""What is suspected while marks are made: a mark, or the coordinates of its point."""


@dataclass(frozen=True, eq=False)
class ComparedMark:
    """A mark (its number among the block's) and where all others put it."""

    mark: int
    off_px: FloatArray
    """Mark minus where the others put it (2,), px."""
    covariance_px2: FloatArray
    """Covariance (2, 2) of that."""
    fits: tuple[str, ...]
    """Names of other points that it would fit; only of a rejected mark."""
    rejected: bool
    """Whether it contradicts the others."""

    @property
    def distance_px(self) -> float:
        """Return how far it is from where the others put it."""
        return float(np.hypot(*self.off_px))

    @property
    def expected_px(self) -> float:
        """Return how far it is to be expected, the root of the mean square, by what is known of marks, poses and
        cameras."""
        return float(np.sqrt(np.trace(self.covariance_px2)))

    @property
    def w(self) -> float:
        """Return the root of its test statistic, χ² with two degrees of freedom."""
        return float(np.sqrt(self.off_px @ np.linalg.solve(self.covariance_px2, self.off_px)))


@dataclass(frozen=True, eq=False)
class MarkComparison:
    """The marks of a block, each with what the others say, what is wrong in words, and where points are to be looked
    for without what is wrong."""

    marks: tuple[ComparedMark, ...]
    blunders: tuple[Blunder, ...]
    places: PredictedPlaces
    sigma_m: FloatArray
    """Standard deviations (G, 3) of the ground points along the map's axes as the marks have them, NaN of unmarked."""


def compared_marks(block: Block, settings: AdjustmentSettings | None = None) -> MarkComparison:
    """Test the marks of a block, a ``tagged_block`` or an adjusted one, against each other and what else is measured.

    Raises AdjustmentError where the block is not determined.
    """
    settings = settings or AdjustmentSettings(estimate_sigmas=False)
    known = with_all_points(block)
    outcome = _snooped(known, settings)
    clean = without(known, outcome.rejected)
    places = _numbered(predicted_places(clean, settings), known, block)
    sigma = np.full((len(block.control_points), 3), np.nan)
    axes = block.frame.rotation_world_from_map(np.zeros(3))
    marked = set(known.control_points.mark_point.tolist())
    for g, covariance in enumerate(outcome.result.covariances.ground_m2):
        if g in marked:
            own = block.control_points.name.index(known.control_points.name[g])
            sigma[own] = np.sqrt(np.diag(axes.T @ covariance @ axes))
    marks, blunders = tuple(_compared(block, known, outcome, places)), tuple(name_blunders(known, outcome))
    return MarkComparison(marks, blunders, places, sigma)


def _snooped(block: Block, settings: AdjustmentSettings) -> Search:
    """Return the marks and coordinates that contradict the rest, and the adjustment without them.

    What does so grossly is rejected first: it would bend all adjustments. Where the block is not determined without
    its marks, the cheapest of the explanations is taken from all measurements, and from those that a robust adjustment
    does not find grossly off.
    """

    def believing_tags(block: Block) -> Adjustment:
        """Adjust without a test of the tags: what they have in common is estimated, and a photograph of few marks
        could not distinguish a wrong mark from a wrong tag."""
        result = adjust(block, settings)
        r = result.tests.reliability
        untested = replace(
            r,
            gnss_left_out_m=np.full_like(r.gnss_left_out_m, np.nan),
            gnss_w=np.full_like(r.gnss_w, np.nan),
            attitude_left_out_rad=np.full_like(r.attitude_left_out_rad, np.nan),
            focal_left_out_px=np.full_like(r.focal_left_out_px, np.nan),
        )
        return replace(
            result,
            tests=replace(result.tests, reliability=untested),
            decisions=replace(result.decisions, flights_without_offset=()),
        )

    gross = gross_marks(block, settings)
    if gross is not None:
        outcome = _without_gross(block, simplified(gross), believing_tags)
        suspected = len(outcome.rejected)
        while len(wrong := _still_wrong(block, outcome, settings)) < suspected:
            suspected, outcome = len(wrong), _without_gross(block, wrong, believing_tags)
        return outcome
    return _cheapest(block, settings, believing_tags)


def _without_gross(block: Block, gross: Sequence[Hypothesis], adjuster: Adjuster) -> Search:
    """Return what contradicts the rest besides what does so grossly, and that."""
    rest = without(block, gross)
    outcome = search(rest, adjuster(rest), adjuster)
    grossly = {a.what for a in gross}
    return Search((*gross, *(a for a in outcome.rejected if a.what not in grossly)), outcome.result)


def _still_wrong(block: Block, outcome: Search, settings: AdjustmentSettings) -> list[Hypothesis]:
    """Return what was rejected without the marks and the coordinates that the adjustment without all of it predicts:
    far from its place a point that was exchanged bends the linearisation, and others with it."""
    if not outcome.rejected:
        return []
    places = predicted_places(without(block, outcome.rejected), settings)
    return [a for a in outcome.rejected if not _is_predicted(a, block, outcome, places)]


def _is_predicted(a: Hypothesis, block: Block, outcome: Search, places: PredictedPlaces) -> bool:
    """Return whether a rejected mark or point lies where the rest puts it."""
    points = block.control_points
    if a.kind == "control point":
        return bool(chance_of_coordinates(a, points, outcome.result, 1.0) > np.log(REINSTATED))
    if a.kind != "mark":
        return False
    g, i = points.name.index(a.name), block.photograph_names.index(str(a.photograph))
    there = np.flatnonzero((places.point == g) & (places.photograph == i)).tolist()
    if not there:
        return False
    (m,) = np.flatnonzero((points.mark_point == g) & (points.mark_photograph == i)).tolist()
    off, spread = _off(points, places, m, there[0])
    return bool(chi2.sf(off @ np.linalg.solve(spread, off), 2) > REINSTATED)


def _off(points: ControlPoints, places: PredictedPlaces, mark: int, place: int) -> tuple[FloatArray, FloatArray]:
    """Return mark minus place (2,), px, and the covariance (2, 2) of that."""
    covariance = places.covariance_px2[place] + points.mark_covariance_px2[mark]
    return points.mark_pixel[mark] - places.pixel[place], covariance


def _cheapest(block: Block, settings: AdjustmentSettings, adjuster: Adjuster) -> Search:
    gross = [a for a in gross_suspects(block, settings).suspects if a.kind in MARKED]
    ways = [way for way in (simplified(gross), whole_points(gross)) if way]
    searches, errors = [], []
    for suspects in [*ways, []]:
        try:
            searches.append(search(block, adjuster(without(block, suspects)), adjuster, suspects))
            if suspects and len(searches[-1].rejected) <= len(suspects):
                break  # what is grossly off explains everything
        except AdjustmentError as error:
            errors.append(error)
    if not searches:
        raise errors[-1]
    # two points that were exchanged are one mistake, not two
    return min(searches, key=lambda one: one.cost() - PRICE * len(exchanged_points(block, one)))


def _numbered(places: PredictedPlaces, known: Block, block: Block) -> PredictedPlaces:
    """Return the places with the numbers that their points have in the whole block."""
    number = np.array([block.control_points.name.index(n) for n in known.control_points.name], dtype=np.int64)
    return replace(places, point=number[places.point])


def _compared(block: Block, known: Block, outcome: Search, places: PredictedPlaces) -> Iterator[ComparedMark]:
    points, names = block.control_points, block.photograph_names
    rejected = {a.what for a in outcome.rejected}
    count = np.bincount(points.mark_point, minlength=len(points))
    at = {pair: k for k, pair in enumerate(zip(places.point.tolist(), places.photograph.tolist(), strict=True))}
    r, left = outcome.result.tests.reliability, known.control_points
    of = {
        (left.name[g], int(i)): m
        for m, (g, i) in enumerate(zip(left.mark_point.tolist(), left.mark_photograph.tolist(), strict=True))
    }
    for m, (g, i) in enumerate(zip(points.mark_point.tolist(), points.mark_photograph.tolist(), strict=True)):
        k = at.get((g, i))
        wrong = ("mark", points.name[g], names[i]) in rejected
        if wrong and k is not None:
            off, covariance = _off(points, places, m, k)
            yield ComparedMark(m, off, covariance, tuple(_fitted(block, places, m, g)), True)
        elif not wrong and count[g] >= LEAST_MARKS and (points.name[g], i) in of:
            n = of[points.name[g], i]
            if np.isfinite(r.mark_left_out_px[n]).all():
                yield ComparedMark(m, -r.mark_left_out_px[n], r.mark_left_out_covariance_px2[n], (), False)


def _fitted(block: Block, places: PredictedPlaces, mark: int, point: int) -> Iterator[str]:
    """Yield the names of other points that a mark fits, the nearest first."""
    points = block.control_points
    there = np.flatnonzero((places.photograph == points.mark_photograph[mark]) & (places.point != point))
    off = points.mark_pixel[mark] - places.pixel[there]
    spread = places.covariance_px2[there] + points.mark_covariance_px2[mark]
    T = np.einsum("ki,ki->k", off, np.linalg.solve(spread, off[..., None])[..., 0])
    for k in np.argsort(T, kind="stable").tolist():
        if chi2.sf(T[k], 2) > FITS:
            yield points.name[places.point[there[k]]]
