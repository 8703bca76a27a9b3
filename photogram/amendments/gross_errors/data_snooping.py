"""Data snooping: which measurements are wrong, by alternative hypotheses that are tested one after the other.

Every control point, in one axis, in plan or as a whole, every mark, GNSS position, measured attitude, constraint
between points, exposure of cameras on one body, given focal length and the zero offset of the GNSS positions is tested
on equal terms. All other observations predict it, and without it the weighted square sum of the adjustment falls by
T = lᵀ C⁻¹ l, with l predicted minus measured and C its covariance; without a blunder T is χ² with as many degrees of
freedom as there are coordinates (Förstner & Wrobel 2016, sec. 4.6.4). The hypothesis least likely by chance is accepted
and its measurement rejected; the rest is adjusted and tested again until no observation contradicts it. Neighbours are
not rejected for a blunder's leverage, and what passes the final test is reinstated.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2, norm

from photogram.adjustment.gnss_offsets import implied_offset_test
from photogram.adjustment.stochastic_model.assumed_sigmas import PRIOR
from photogram.adjustment.stochastic_model.estimated_sigmas import with_assumed_sigmas
from photogram.amendments.focal_length import WRONG_BY
from photogram.amendments.gross_errors.assumed_control import ALARMS, outlying_points, scatter_of_assumed
from photogram.amendments.gross_errors.hypothesis import Hypothesis, Suspected, unmeasured
from photogram.arrays import FloatArray
from photogram.constraints.between_points import CONSTRAINT_KINDS, observations, rejecting
from photogram.constraints.rigs import exposure_names, rejecting_exposures
from photogram.errors import PhotogramError
from photogram.gnss import UNKNOWN_M
from photogram.measures.mark_covariances import rejecting_marks
from photogram.quality.accuracy import FALSE_ALARMS
from photogram.results import Adjustment
from photogram.survey import Block, ControlPoints, Photograph, Role

Adjuster = Callable[[Block], Adjustment]
_LOG = logging.getLogger(__name__)

MOST_BLUNDERS = 12
REINSTATED = 0.001
"""Probability by chance above which a rejected measurement is reinstated."""

RIVAL = np.log(0.05)
"""Logarithm of the least likelihood ratio at which another hypothesis explains a contradiction nearly as well."""

PRICE = 25.0
"""Least decrease of the weighted square sum that justifies one more rejection: five sigma."""

LOST_RAY = 9.0
"""Weighted square sum counted for each rejected ray of a tie point."""

LOST_PHOTOGRAPH = 1000.0
"""Weighted square sum counted for each photograph that is not adjusted."""

MARK_PREDICTED = 2.0
"""Standard deviation of a mark minus its prediction by the other marks, over its own."""

FEWEST_ALIKE, FEWEST_POINTS_ALIKE = 6, 10
"""Least number of measurements of one kind whose scatter tests their stated sigma; more of control points, since a
blunder in one of few moves them all."""

SOURCE_REJECTED = 3.0
"""Standard deviations from which the source of a focal length is rejected: tags are wrong more often than chance."""

_POINT_PARTS = ((0,), (1,), (2,), (0, 1), (0, 1, 2))
_POSITION_PARTS = ((2,), (0, 1), (0, 1, 2))
_EXPOSURE_PARTS = ((3, 4, 5), (0, 1, 2, 3, 4, 5))


def _hypothesis(
    what: tuple[Suspected, str, str | None], axes: Sequence[int], left_out: FloatArray, covariance: FloatArray
) -> Hypothesis:
    """Return the hypothesis that some of the coordinates predicted together are wrong, the others right.

    The information matrix C⁻¹ of all coordinates contains those of every part: no further factorisation is needed.
    """
    information = np.linalg.inv(covariance)
    spread = np.linalg.inv(information[np.ix_(axes, axes)])
    right = (information @ left_out)[list(axes)]
    off = spread @ right
    sigma = tuple(np.sqrt(np.diag(spread)).tolist())
    return Hypothesis(*what, tuple(axes), tuple(off.tolist()), sigma, float(right @ off))


def _of_points(result: Adjustment) -> Iterator[Hypothesis]:
    r, points = result.tests.reliability, result.block.control_points
    for g, name in enumerate(points.name):
        known = np.flatnonzero(np.isfinite(r.ground_left_out_m[g]))
        place = {axis: n for n, axis in enumerate(known.tolist())}
        left_out, covariance = r.ground_left_out_m[g, known], r.ground_left_out_covariance_m2[g][np.ix_(known, known)]
        for axes in _POINT_PARTS:
            if set(axes) <= set(place):
                own = _hypothesis(("control point", name, None), [place[a] for a in axes], left_out, covariance)
                yield replace(own, axes=axes)


def hypotheses(result: Adjustment) -> Iterator[Hypothesis]:
    """Yield every alternative that something else determines, one for each part of a measurement."""
    r = result.tests.reliability
    points = result.block.control_points
    photographs = result.block.photographs
    yield from _of_points(result)
    for m in np.flatnonzero(np.isfinite(r.mark_left_out_px).all(axis=1)).tolist():
        name, photograph = points.name[points.mark_point[m]], photographs[points.mark_photograph[m]].name
        yield _hypothesis(("mark", name, photograph), (0, 1), r.mark_left_out_px[m], r.mark_left_out_covariance_px2[m])
    for i in np.flatnonzero(np.isfinite(r.gnss_left_out_m).all(axis=1)).tolist():
        for axes in _POSITION_PARTS:
            what: tuple[Suspected, str, None] = ("GNSS position", photographs[i].name, None)
            yield _hypothesis(what, axes, r.gnss_left_out_m[i], r.gnss_left_out_covariance_m2[i])
    for i in np.flatnonzero(np.isfinite(r.attitude_left_out_rad).all(axis=1)).tolist():
        yield _hypothesis(
            ("attitude", photographs[i].name, None), (0, 1, 2),
            r.attitude_left_out_rad[i], r.attitude_left_out_covariance_rad2[i],
        )  # fmt: skip
    for c in np.flatnonzero(np.isfinite(r.focal_left_out_px)).tolist():
        off, sigma = r.focal_left_out_px[c : c + 1], r.focal_left_out_sigma_px[c : c + 1]
        yield _hypothesis(("focal length", result.block.cameras[c].name, None), (0,), off, np.diag(sigma**2))
    tested = result.tests.constraints
    for o, off_m, sigma_m in zip(
        observations(result.block.constraints), tested.left_out_m, tested.left_out_sigma_m, strict=True
    ):
        if np.isfinite(off_m):
            yield _hypothesis((o.kind, o.label, None), (0,), np.array([off_m]), np.array([[sigma_m**2]]))
    tests = result.tests.exposures
    for e, (photograph, _) in enumerate(exposure_names(result.block.rigs)):
        if np.isfinite(tests.left_out[e]).all():
            pair: tuple[Suspected, str, None] = ("exposure", photograph, None)
            for part in _EXPOSURE_PARTS:
                yield _hypothesis(pair, part, tests.left_out[e], tests.left_out_covariance[e])
    for f, flight in enumerate(result.decisions.flights_without_offset):
        offset, covariance = result.tests.implied_offset_world_m[f], result.tests.implied_offset_covariance_m2[f]
        if (
            len(result.block.control_points.with_role("control"))
            and implied_offset_test(offset, covariance).significant
        ):
            yield _hypothesis(("GNSS offset", flight, None), (0, 1, 2), offset, covariance)


def simplified(rejected: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return the hypotheses with one of the whole point in place of those of a part of it and of marks of it: a point
    on a wrong place seems to contradict some of its marks too."""
    points = {a.name for a in rejected if a.kind == "control point"} & {a.name for a in rejected if a.kind == "mark"}
    rest = [a for a in rejected if a.name not in points or a.kind not in ("control point", "mark")]
    return [*rest, *(unmeasured("control point", name) for name in sorted(points))]


def whole_points(rejected: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return the hypotheses with two and more control points rejected as a whole, not along some axes: of two that were
    exchanged the heights may differ by too little to be rejected, and are wrong all the same."""
    points = {a.name for a in rejected if a.kind == "control point"}
    if len(points) < 2:
        return list(rejected)
    rest = [a for a in rejected if a.kind != "control point"]
    return [*(unmeasured("control point", name) for name in sorted(points)), *rest]


def _without_position(photograph: Photograph) -> Photograph:
    return replace(photograph, gnss_world_m=None, gnss_sigma_m=None, lever_arm_camera_m=None)


def _without_height(photograph: Photograph) -> Photograph:
    sigma_m = photograph.gnss_sigma_m
    return photograph if sigma_m is None else replace(photograph, gnss_sigma_m=np.array([*sigma_m[:2], UNKNOWN_M]))


def without(block: Block, rejected: Sequence[Hypothesis]) -> Block:
    """Return the block without the rejected measurements: sigmas of coordinates and marks infinite, positions and
    attitudes removed, heights of positions unknown, a focal length as uncertain as a wrong tag, GNSS offsets free,
    sigmas of constraints and of exposures infinite.

    A point without any coordinate left becomes a tie point, if it has at least two marks.
    """
    names = block.photograph_names
    photographs = list(block.photographs)
    cameras = list(block.cameras)
    offset_m = block.gnss_offset_sigma_m
    for a in rejected:
        if a.kind == "GNSS position":
            i = names.index(a.name)
            photographs[i] = _without_position(photographs[i])
        elif a.kind == "GNSS height":
            i = names.index(a.name)
            photographs[i] = _without_height(photographs[i])
        elif a.kind == "attitude":
            i = names.index(a.name)
            photographs[i] = replace(photographs[i], attitude_world_from_camera=None, attitude_sigma_rad=None)
        elif a.kind == "GNSS offset":
            offset_m = np.full(3, UNKNOWN_M)
        elif a.kind == "focal length":
            c = [camera.name for camera in cameras].index(a.name)
            sigmas = np.concatenate([[WRONG_BY * cameras[c].focal_px], cameras[c].sigmas[1:]])
            cameras[c] = replace(cameras[c], sigmas=sigmas)
    return replace(
        block,
        cameras=tuple(cameras),
        photographs=tuple(photographs),
        control_points=_ground_without(block, rejected),
        gnss_offset_sigma_m=offset_m,
        constraints=rejecting(block.constraints, {(a.kind, a.name) for a in rejected}),
        rigs=rejecting_exposures(block.rigs, {a.name for a in rejected if a.kind == "exposure"}),
    )


def _ground_without(block: Block, rejected: Sequence[Hypothesis]) -> ControlPoints:
    points, names = block.control_points, block.photograph_names
    sigma_m, controlled = points.sigma_m.copy(), points.controlled.copy()
    rejected_marks = np.zeros(len(points.mark_point), dtype=bool)
    for a in rejected:
        if a.kind == "control point":
            sigma_m[points.name.index(a.name), list(a.axes)] = np.inf
        elif a.kind == "mark":
            of_point = points.mark_point == points.name.index(a.name)
            rejected_marks |= of_point & (points.mark_photograph == names.index(str(a.photograph)))
    usable = np.isfinite(points.mark_sigma_px) & ~rejected_marks & block.registered[points.mark_photograph]
    marks = np.bincount(points.mark_point[usable], minlength=len(points))
    open_points = np.isinf(np.where(controlled, sigma_m, np.inf)).all(axis=1) & controlled.any(axis=1) & (marks < 2)
    controlled[open_points] = False
    rejected_marks |= open_points[points.mark_point]
    role: tuple[Role, ...] = tuple("control" if row.any() else "check" for row in controlled)
    covariance = rejecting_marks(points.mark_covariance_px2, rejected_marks)
    return replace(points, role=role, controlled=controlled, sigma_m=sigma_m, mark_covariance_px2=covariance)


@dataclass(frozen=True, eq=False)
class Search:
    """One explanation of the contradictions."""

    rejected: tuple[Hypothesis, ...]
    """Rejected measurements."""
    result: Adjustment
    """Adjustment without them."""

    def cost(self) -> float:
        """Return the cost of this explanation: the remaining weighted square sum, minus the expectation of all
        observations but tie points, plus the price of everything rejected."""
        r, lost = self.result.tests.reliability, LOST_RAY * self.result.decisions.rejected_observations
        of_constraints = self.result.tests.constraints.redundancy
        of_exposures = self.result.tests.exposures.redundancy
        tested = (r.ground_redundancy, r.mark_redundancy, r.gnss_redundancy, of_constraints, of_exposures)
        expected = sum(float(np.nansum(n)) for n in tested)
        lost += LOST_PHOTOGRAPH * sum(bool(why) for why in self.result.decisions.reason)
        return 2.0 * self.result.cost - expected + lost + PRICE * len(self.rejected)


def scatter(result: Adjustment) -> dict[str, float]:
    """Return the factors by which control points, marks, GNSS positions, attitudes, exposures and constraints scatter
    more than stated.

    From the median of their tests, which a single blunder does not change; 1 where they do not, or are too few.
    """
    r = result.tests.reliability
    attitude = r.attitude_left_out_rad / np.sqrt(np.einsum("nii->ni", r.attitude_left_out_covariance_rad2))
    more, kinds = {}, np.array([o.kind for o in observations(result.block.constraints)], dtype=np.str_)
    for kind, w, fewest in (
        ("control point", r.ground_w, FEWEST_POINTS_ALIKE),
        ("mark", r.mark_w, FEWEST_ALIKE),
        ("GNSS position", r.gnss_w, FEWEST_ALIKE),
        ("attitude", attitude, FEWEST_ALIKE),
        ("exposure", result.tests.exposures.w, FEWEST_ALIKE),
        *((kind, result.tests.constraints.w[kinds == kind, None], FEWEST_ALIKE) for kind in CONSTRAINT_KINDS),
    ):
        own = np.abs(w[np.isfinite(w).all(axis=1)])
        more[kind] = max(1.0, float(np.median(own) / norm.ppf(0.75))) if len(own) >= fewest else 1.0
    return more


def _degrees_of_estimated(result: Adjustment) -> dict[tuple[str, str], float]:
    """Return with how many degrees of freedom the sigmas of marks are estimated, by kind and name of the point, of
    those whose sigmas are only assumed."""
    sigmas, points = result.decisions.sigmas, result.block.control_points
    of_kind = dict(zip(sigmas.kind.tolist(), sigmas.redundancy.tolist(), strict=True))
    if "marks" not in of_kind:
        return {}
    degrees = PRIOR + of_kind["marks"]
    names = zip(points.name, points.mark_sigma_assumed, strict=True)
    return {("mark", name): degrees for name, alone in names if alone}


def _of_estimated(a: Hypothesis, degrees: float | None) -> Hypothesis:
    """Return a hypothesis whose statistic is compared with χ² as it would be with F where the sigma of its measurement
    is estimated with so many degrees of freedom n: (n + d) ln(1 + T/n), the logarithm of the likelihood ratio of a
    multivariate t distribution (Koch 2007, sec. 2.5.1), instead of T."""
    if degrees is None or not np.isfinite(a.statistic):
        return a
    return replace(a, statistic=(degrees + len(a.axes)) * float(np.log1p(a.statistic / degrees)))


def contradictions(result: Adjustment, but: Sequence[Hypothesis] = (), rejected: int = 0) -> list[Hypothesis]:
    """Return the significant hypotheses but those in ``but``, the least likely by chance first.

    FALSE_ALARMS is the probability of a false alarm in all tests together; control points whose sigmas are assumed are
    tested separately, and a focal length, at SOURCE_REJECTED. Kinds that scatter more than stated are tested by their
    own scatter. Where so many were ``rejected`` before, all tests are made once more: the k-th time the probability is
    FALSE_ALARMS / k², so that it stays below twice FALSE_ALARMS in all.
    """
    more, excused, known = scatter(result), {(a.what, a.axes) for a in but}, _degrees_of_estimated(result)
    points, every = result.block.control_points, [a for a in hypotheses(result) if (a.what, a.axes) not in excused]
    assumed = {name for name, alone in zip(points.name, points.sigma_assumed, strict=True) if alone}
    of_control = [a for a in every if a.kind == "control point" and a.name in assumed]
    others = [
        _of_estimated(replace(a, statistic=a.statistic / more.get(a.kind, 1.0) ** 2), known.get((a.kind, a.name)))
        for a in every
        if a not in of_control
    ]
    of_source = float(np.log(2.0 * norm.sf(SOURCE_REJECTED)))
    wrong = list[Hypothesis]()
    for tests, alarms in ((others, FALSE_ALARMS), (list(outlying_points(result, of_control)), ALARMS)):
        again = (rejected + 1) ** 2 if alarms == FALSE_ALARMS else 1
        limit = float(np.log(alarms / again / max(len(tests), 1)))
        wrong += [a for a in tests if a.log_chance < (of_source if a.kind == "focal length" else limit)]
    return sorted(wrong, key=lambda a: a.log_chance)


def _with_rivals(significant: Sequence[Hypothesis]) -> Hypothesis:
    """Return the first hypothesis, with the others that explain the contradiction nearly as well."""
    first = significant[0]
    rivals = [a.words for a in significant[1:] if a.what != first.what and a.log_chance < first.log_chance - RIVAL]
    return replace(first, rivals=tuple(dict.fromkeys(rivals)))


def chance_of_coordinates(a: Hypothesis, surveyed: ControlPoints, result: Adjustment, scale: float) -> float:
    """Return the log probability that rejected coordinates are this far from their prediction by chance, if control
    points scatter ``scale`` times as much as stated."""
    points, frame = surveyed, result.block.frame
    g, axes = points.name.index(a.name), frame.rotation_world_from_map(np.zeros(3))
    own = axes[:, list(a.axes)]
    covariance = own.T @ (result.covariances.ground_m2[g] + axes @ np.diag(points.sigma_m[g] ** 2) @ axes.T) @ own
    off = own.T @ (result.estimates.ground_world_m[g] - points.position_world_m[g])
    if not np.isfinite(off).all():
        return -np.inf
    return float(chi2.logsf(off @ np.linalg.solve(covariance, off) / scale**2, len(off)))


def _chance_of_mark(a: Hypothesis, result: Adjustment) -> float:
    """Return the log probability that a mark is this far from its prediction by the other marks of its point, -inf for
    other kinds."""
    if a.kind != "mark":
        return -np.inf
    points = result.block.control_points
    photograph = result.block.photograph_names.index(str(a.photograph))
    m = (points.mark_point == points.name.index(a.name)) & (points.mark_photograph == photograph)
    off_px = result.estimates.mark_residual_px[m][0]
    others = points.mark_sigma_px[(points.mark_point == points.name.index(a.name)) & ~m]
    if not (np.isfinite(off_px).all() and np.isfinite(others).any()):
        return -np.inf
    sigma_px = MARK_PREDICTED * float(np.median(others[np.isfinite(others)]))
    pose, g = result.block.poses[photograph], points.name.index(a.name)
    if pose is not None:
        camera = result.block.cameras[result.block.photographs[photograph].camera]
        distance_m = np.linalg.norm(result.estimates.ground_world_m[g] - pose.position_world_m)
        spread_m = np.sqrt(np.linalg.eigvalsh(result.covariances.ground_m2[g])[-1])
        sigma_px = float(np.hypot(sigma_px, camera.focal_px * spread_m / distance_m))
    return float(chi2.logsf(float(off_px @ off_px) / sigma_px**2, 2))


def _reinstated(rejected: Sequence[Hypothesis], block: Block, result: Adjustment, adjust: Adjuster) -> list[Hypothesis]:
    """Return the rejected measurements to reinstate, since no other observation contradicts them. All but coordinates
    are tested by an adjustment with each of them."""
    reinstated, price = [], Search(tuple(rejected), result).cost()
    surveyed = with_assumed_sigmas(block, result.decisions.sigmas).control_points
    for a in rejected:
        if a.kind == "control point":
            alone = surveyed.sigma_assumed[surveyed.name.index(a.name)]
            own = scatter_of_assumed(result) if alone else scatter(result)["control point"]
            chance = chance_of_coordinates(a, surveyed, result, own)
        else:
            rest = tuple(b for b in rejected if b is not a)
            try:
                with_it = adjust(without(block, rest))
            except PhotogramError:
                continue  # not adjustable with it: it stays rejected
            if Search(rest, with_it).cost() > price:
                continue  # it bends the block, so that it fits by itself
            more = scatter(with_it).get(a.kind, 1.0)
            same = [replace(b, statistic=b.statistic / more**2) for b in hypotheses(with_it) if b.what == a.what]
            chance = min((b.log_chance for b in same), default=_chance_of_mark(a, result))
        if chance > np.log(REINSTATED):
            reinstated.append(a)
    return reinstated


def search(block: Block, result: Adjustment, adjust: Adjuster, suspects: Sequence[Hypothesis] = ()) -> Search:
    """Reject measurements one by one until no observation contradicts the rest, then reinstate those that pass.

    ``result`` is that of ``block`` without the ``suspects``, which are rejected from the start; ``adjust`` adjusts a
    block.
    """
    rejected, current = list(suspects), result
    immune: list[Hypothesis] = []
    while len(rejected) < max(MOST_BLUNDERS, len(suspects) + 3):
        contradicted = contradictions(current, [*rejected, *immune], len(rejected))
        if not contradicted:
            break
        first = _with_rivals(contradicted)
        new = [first, *(a for a in contradicted if a.kind == first.kind and a.name in first.together)]
        try:
            current = adjust(without(block, [*rejected, *new]))
        except PhotogramError:
            immune += new  # too few observations are left to test them
            _LOG.debug("kept, since nothing is determined without it: %s", first.words)
        else:
            rejected += new
            _LOG.debug("rejected: %s, T = %.1f", ", ".join(a.words for a in new), first.statistic)
    if suspects or len(rejected) > 1:
        reinstated = _reinstated(rejected, block, current, adjust)
        if reinstated:
            _LOG.debug("reinstated: %s", ", ".join(a.words for a in reinstated))
            remaining = [a for a in rejected if a not in reinstated]
            with suppress(PhotogramError):  # where the block cannot be adjusted with them, they stay rejected
                return min(
                    Search(tuple(remaining), adjust(without(block, remaining))),
                    Search(tuple(rejected), current),
                    key=Search.cost,
                )
    return Search(tuple(rejected), current)
