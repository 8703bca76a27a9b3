"""What the marks of a snapshot say: where the points are to be looked for, and which marks contradict the others."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from photogram.adjustment.oriented_subset import without_marks
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.errors import PhotogramError
from photogram.files.tables.surveyed_points import Mark, MarkKey, PointRole, Proposal
from photogram.marking.files.actions import MarkState
from photogram.marking.mark_comparison import LEAST_MARKS, ComparedMark, MarkComparison, compared_marks
from photogram.marking.page.snapping import Snapped
from photogram.marking.predictions import PredictedPlaces, predicted_places
from photogram.marking.tagged_block import with_all_points
from photogram.measures.mark_covariances import covariances_px2, isotropic_px2
from photogram.survey import Block, ControlPoints, Role

RAW_SIGMA_PX = 1.0
"""Standard deviation of a click as it is, along each axis: what hands do on a clear target at the scale it is shown."""


OFF_TARGET_SIGMAS = 3.5
"""Standard deviations of a click from which on it is said to be off a target."""


@dataclass(frozen=True, eq=False)
class Assessment:
    """What the marks of a snapshot say."""

    marks: Mapping[MarkKey, Mark]
    """Those marks."""
    names: tuple[str, ...]
    """Names of the points, by which places number them."""
    places: PredictedPlaces | None
    """Where the points are to be looked for, None where nothing says it."""
    comparison: MarkComparison | None
    """The marks compared with each other, None before any comparison can be made."""
    compared: Mapping[MarkKey, ComparedMark]
    """The marks that were compared, by point and photograph."""
    problem: str
    """Why places or comparison are missing, empty where they are not."""
    position_world_m: FloatArray
    """Positions (G, 3) of the points, surveyed or where their marks meet; NaN where nothing places them."""
    agreeing: frozenset[MarkKey] = frozenset()
    """Proposals that agree with the marks, and with each other where a point has three or more of both."""
    off_target: Mapping[MarkKey, Snapped] = field(default_factory=dict)
    """What the click of a mark that was taken as it is would have been taken for, where it missed that."""

    def position_of(self, point: str) -> FloatArray:
        """Return the position (3,) of a point in the world, NaN where nothing places it."""
        return self.position_world_m[self.names.index(point)] if point in self.names else np.full(3, np.nan)

    def sigma_m(self, point: str) -> FloatArray | None:
        """Return the standard deviations (3,) of a marked point along the map's axes."""
        if self.comparison is None or point not in self.names:
            return None
        sigma: FloatArray = self.comparison.sigma_m[self.names.index(point)]
        return sigma if np.isfinite(sigma).all() else None


def isotropic_px(mark: Mark) -> float:
    """Return the standard deviation of a mark along each axis, as the adjustment takes it."""
    return RAW_SIGMA_PX if mark.sigma_px is None else float(np.sqrt(np.mean(np.square(mark.sigma_px))))


def is_off_target(mark: Mark, target: Snapped) -> bool:
    """Return whether a mark is well off what its click would have been taken for."""
    return float(np.hypot(*np.subtract(mark.pixel, target.pixel))) > OFF_TARGET_SIGMAS * isotropic_px(mark)


def doubted_px2(mark: Mark, meant: Snapped | None) -> FloatArray:
    """Return the covariance (2, 2) of a mark among the others: a click that is well off a target is as uncertain as
    that, so that it has no other mark accused in its place."""
    if meant is None and mark.sigma_px is not None:
        return np.asarray(covariances_px2(np.array([mark.sigma_px]), np.array([mark.rho]))[0])
    off_px = 0.0 if meant is None else np.hypot(*np.subtract(mark.pixel, meant.pixel))
    return np.asarray(isotropic_px2(np.hypot([isotropic_px(mark)], off_px))[0])


def marked_block(
    block: Block,
    state: MarkState,
    roles: Mapping[str, PointRole],
    numbers: Mapping[str, int],
    off_target: Mapping[MarkKey, Snapped] = MappingProxyType({}),
) -> Block:
    """Return a block with the points and marks of a state, in the order of ``roles``; ``numbers`` are those of the
    photographs, ``off_target`` what clicks are well off (``is_off_target``)."""
    given, names = block.control_points, tuple(roles)
    at = {name: g for g, name in enumerate(given.name)}
    position, sigma = np.full((len(names), 3), np.nan), np.full((len(names), 3), np.inf)
    for g, name in enumerate(names):
        added = state.points.get(name)
        if roles[name] == "tie":
            continue
        if added is not None and added.position is not None and None not in added.sigma_m:
            position[g] = block.frame.world_from_map(block.frame.map_from_unit(np.array([added.position])))[0]
            sigma[g] = added.sigma_m
        elif name in at:
            position[g], sigma[g] = given.position_world_m[at[name]], given.sigma_m[at[name]]
    own = {name: g for g, name in enumerate(names)}
    marks = sorted(
        (m for m in state.marks.values() if m.point in own and m.photograph in numbers),
        key=lambda m: (own[m.point], numbers[m.photograph]),
    )
    covariance = [doubted_px2(m, off_target.get(m.key)) for m in marks]
    of_block: tuple[Role, ...] = tuple("control" if roles[name] == "control" else "check" for name in names)
    points = ControlPoints(
        names,
        of_block,
        position,
        sigma,
        np.array([numbers[m.photograph] for m in marks], dtype=np.int64),
        np.array([own[m.point] for m in marks], dtype=np.int64),
        np.array([m.pixel for m in marks], dtype=np.float64).reshape(-1, 2),
        np.array(covariance, dtype=np.float64).reshape(-1, 2, 2),
    )
    return replace(block, control_points=points)


def assessed(
    block: Block,
    state: MarkState,
    roles: Mapping[str, PointRole],
    numbers: Mapping[str, int],
    off_target: Mapping[MarkKey, Snapped] = MappingProxyType({}),
) -> Assessment:
    """Return what the marks of a state say, on a tagged or an adjusted block; ``off_target`` as in ``marked_block``."""
    block = marked_block(block, state, roles, numbers, off_target)
    points, names = block.control_points, block.photograph_names
    settings = AdjustmentSettings(estimate_sigmas=False)
    places: PredictedPlaces | None = None
    comparison: MarkComparison | None = None
    problem = ""
    try:
        if len(points.mark_point):
            comparison = compared_marks(block, settings)
            places = comparison.places
        else:
            places = predicted_places(block, settings)
    except PhotogramError as error:
        problem = str(error)
        if comparison is None and len(points.mark_point):
            places = _places_without_marks(block, settings)
    compared = {
        (points.name[points.mark_point[one.mark]], names[points.mark_photograph[one.mark]]): one
        for one in (comparison.marks if comparison else ())
    }
    return Assessment(
        state.marks, points.name, places, comparison, compared, problem, _positions(block), off_target=off_target
    )


def agreeing_proposals(
    block: Block,
    state: MarkState,
    roles: Mapping[str, PointRole],
    numbers: Mapping[str, int],
    proposals: Mapping[MarkKey, Proposal],
    off_target: Mapping[MarkKey, Snapped] = MappingProxyType({}),
) -> frozenset[MarkKey]:
    """Return the proposals that agree with the marks and with each other, of points with LEAST_MARKS of both; the rest
    as in ``marked_block``."""
    marks = {place: proposal.mark for place, proposal in proposals.items() if place[0] in roles}
    whole = assessed(block, replace(state, marks={**marks, **state.marks}), roles, numbers, off_target)
    counts = Counter(point for point, _ in whole.marks)
    return frozenset(
        place
        for place in marks
        if place in whole.compared and not whole.compared[place].rejected and counts[place[0]] >= LEAST_MARKS
    )


def _positions(block: Block) -> FloatArray:
    """Return the positions (G, 3) of the points of a block, NaN where nothing places them."""
    known = with_all_points(block).control_points
    position = np.full((len(block.control_points), 3), np.nan)
    position[[block.control_points.name.index(name) for name in known.name]] = known.position_world_m
    return position


def _places_without_marks(block: Block, settings: AdjustmentSettings) -> PredictedPlaces | None:
    """Return the places that a block predicts whose marks cannot be compared, None where it is not determined."""
    no_marks = np.zeros(len(block.control_points.mark_point), dtype=bool)
    try:
        return predicted_places(without_marks(block, no_marks), settings)
    except PhotogramError:
        return None
