"""Which measurement is wrong: alternatives tested against each other, one after the other left out.

Every control point, in one axis, in plan or as a whole, every mark, GNSS position, measured attitude, given focal
length and the zero offset of the GNSS positions is tested on equal terms: left out, everything else predicts it, and
the weighted square sum of the adjustment falls by T = lᵀ C⁻¹ l, with l predicted minus measured and C its covariance;
without a blunder T is χ² with as many degrees of freedom as there are coordinates (Förstner & Wrobel 2016, sec. 4.6.4).
The alternative that is least likely by chance is accused. It is left out, the rest is adjusted again and tested again,
until nothing contradicts it: what a blunder spreads to its neighbours is not laid to them, and what agrees with the
rest in the end is taken back.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.stats import chi2, norm

from photogram.adjustment.gnss_offsets import implied_offset_test
from photogram.arrays import FloatArray
from photogram.errors import PhotogramError
from photogram.quality.accuracy import FALSE_ALARMS
from photogram.quality.gross_errors.focal_length import WRONG_BY
from photogram.results import Adjustment
from photogram.sfm.marked_points import intersected_marks
from photogram.survey import Block, ControlPoints, Photograph, Role

Suspected = Literal["control point", "mark", "GNSS position", "attitude", "focal length", "GNSS offset"]
Adjuster = Callable[[Block], Adjustment]
_LOG = logging.getLogger(__name__)

MOST_BLUNDERS = 12
INNOCENT = 0.001
"""Probability by chance above which what was left out is taken back."""

RIVAL = np.log(0.05)
"""Logarithm of the least likelihood ratio at which another alternative explains a contradiction nearly as well."""

PRICE = 25.0
"""What one more measurement left out must take from the weighted square sum to be the better explanation: five
sigma."""

LOST_RAY = 9.0
"""What a ray of a tie point that was left out counts in the weighted square sum."""

LOST_PHOTOGRAPH = 1000.0
"""What a photograph counts that the adjustment leaves out."""

MARK_PREDICTED = 2.0
"""Standard deviation of a mark against where others put it, over its own."""

FEWEST_ALIKE, FEWEST_POINTS_ALIKE = 6, 10
"""Measurements of one kind from which their own scatter shows whether their stated sigma is too small; more of control
points, which a blunder in one of few moves all."""

SOURCE_REJECTED = 3.0
"""Standard deviations from which the source of a focal length is rejected: tags are wrong more often than chance."""

OPEN_OFFSET_M = 1000.0
"""Standard deviation of a GNSS offset that is left open."""

_POINT_PARTS = ((0,), (1,), (2,), (0, 1), (0, 1, 2))
_POSITION_PARTS = ((2,), (0, 1), (0, 1, 2))


@dataclass(frozen=True)
class Accusation:
    """A measurement that the rest contradicts.

    ``kind`` and ``name`` of the point, photograph, camera or flight, and the ``photograph`` of a mark; ``axes``:
    easting, northing, height of a position, u, v of a mark, the camera's axes of an attitude. ``off`` predicted minus
    measured along them, m, px or rad, with its ``sigma``; ``statistic`` T. ``rivals`` are other measurements that would
    explain the contradiction nearly as well.
    """

    kind: Suspected
    name: str
    photograph: str | None
    axes: tuple[int, ...]
    off: tuple[float, ...]
    sigma: tuple[float, ...]
    statistic: float
    rivals: tuple[str, ...] = ()

    @property
    def what(self) -> tuple[str, str, str | None]:
        """Return the measurement, whatever part of it is accused."""
        return self.kind, self.name, self.photograph

    @property
    def words(self) -> str:
        """Return the measurement in words."""
        of = {"mark": f"of {self.name} in {self.photograph}", "GNSS offset": f"of flight {self.name}"}
        return f"{self.kind} {of.get(self.kind, self.name)}"

    @property
    def log_chance(self) -> float:
        """Return the logarithm of the probability of such a contradiction by chance."""
        return float(chi2.logsf(self.statistic, len(self.axes)))


def unmeasured(kind: Suspected, name: str, photograph: str | None = None) -> Accusation:
    """Return the accusation of a measurement of which no more is known than that it is far off."""
    axes = {"mark": (0, 1), "focal length": (0,)}.get(kind, (0, 1, 2))
    unknown = (float("nan"),) * len(axes)
    return Accusation(kind, name, photograph, axes, unknown, unknown, float("inf"))


def _accusation(
    what: tuple[Suspected, str, str | None], axes: Sequence[int], left_out: FloatArray, covariance: FloatArray
) -> Accusation:
    """Accuse some of the coordinates that were left out together: the others are given back.

    The normal matrix C⁻¹ of what was left out holds those of every part, so that no other factorisation is needed.
    """
    information = np.linalg.inv(covariance)
    spread = np.linalg.inv(information[np.ix_(axes, axes)])
    right = (information @ left_out)[list(axes)]
    off = spread @ right
    sigma = tuple(np.sqrt(np.diag(spread)).tolist())
    return Accusation(*what, tuple(axes), tuple(off.tolist()), sigma, float(right @ off))


def _of_points(result: Adjustment) -> Iterator[Accusation]:
    r, points = result.reliability, result.block.control_points
    for g, name in enumerate(points.name):
        known = np.flatnonzero(np.isfinite(r.ground_left_out_m[g]))
        place = {axis: n for n, axis in enumerate(known.tolist())}
        left_out, covariance = r.ground_left_out_m[g, known], r.ground_left_out_covariance_m2[g][np.ix_(known, known)]
        for axes in _POINT_PARTS:
            if set(axes) <= set(place):
                own = _accusation(("control point", name, None), [place[a] for a in axes], left_out, covariance)
                yield replace(own, axes=axes)


def accusations(result: Adjustment) -> Iterator[Accusation]:
    """Yield every alternative that something else determines, one for each part of a measurement."""
    r, points, photographs = result.reliability, result.block.control_points, result.block.photographs
    yield from _of_points(result)
    for m in np.flatnonzero(np.isfinite(r.mark_left_out_px).all(axis=1)).tolist():
        name, photograph = points.name[points.mark_point[m]], photographs[points.mark_photograph[m]].name
        yield _accusation(("mark", name, photograph), (0, 1), r.mark_left_out_px[m], r.mark_left_out_covariance_px2[m])
    for i in np.flatnonzero(np.isfinite(r.gnss_left_out_m).all(axis=1)).tolist():
        for axes in _POSITION_PARTS:
            what: tuple[Suspected, str, None] = ("GNSS position", photographs[i].name, None)
            yield _accusation(what, axes, r.gnss_left_out_m[i], r.gnss_left_out_covariance_m2[i])
    for i in np.flatnonzero(np.isfinite(r.attitude_left_out_rad).all(axis=1)).tolist():
        yield _accusation(
            ("attitude", photographs[i].name, None), (0, 1, 2),
            r.attitude_left_out_rad[i], r.attitude_left_out_covariance_rad2[i],
        )  # fmt: skip
    for c in np.flatnonzero(np.isfinite(r.focal_left_out_px)).tolist():
        off, sigma = r.focal_left_out_px[c : c + 1], r.focal_left_out_sigma_px[c : c + 1]
        yield _accusation(("focal length", result.block.cameras[c].name, None), (0,), off, np.diag(sigma**2))
    for f, flight in enumerate(result.held_flights):
        offset, covariance = result.implied_offset_world_m[f], result.implied_offset_covariance_m2[f]
        if (
            len(result.block.control_points.with_role("control"))
            and implied_offset_test(offset, covariance).significant
        ):
            yield _accusation(("GNSS offset", flight, None), (0, 1, 2), offset, covariance)


def simplified(accused: Sequence[Accusation]) -> list[Accusation]:
    """Return the accusations with one of the whole point in place of those of a part of it and of marks of it: a point
    on a wrong place seems to contradict some of its marks too."""
    points = {a.name for a in accused if a.kind == "control point"} & {a.name for a in accused if a.kind == "mark"}
    rest = [a for a in accused if a.name not in points or a.kind not in ("control point", "mark")]
    return [*rest, *(unmeasured("control point", name) for name in sorted(points))]


def whole_points(accused: Sequence[Accusation]) -> list[Accusation]:
    """Return the accusations with two and more control points accused as a whole, not along some axes: of two that were
    exchanged the heights may differ by too little to be accused, and are wrong all the same."""
    points = {a.name for a in accused if a.kind == "control point"}
    if len(points) < 2:
        return list(accused)
    rest = [a for a in accused if a.kind != "control point"]
    return [*(unmeasured("control point", name) for name in sorted(points)), *rest]


def _without_position(photograph: Photograph) -> Photograph:
    return replace(photograph, gnss_world_m=None, gnss_sigma_m=None, lever_arm_camera_m=None)


def without(block: Block, accused: Sequence[Accusation]) -> Block:
    """Return the block with what is accused left out: sigmas of coordinates and marks infinite, positions and attitudes
    gone, a focal length as uncertain as that of a wrong tag, GNSS offsets open.

    A point of which no coordinate is left goes on as a tie point with its marks, and goes with them where they are
    fewer than two.
    """
    names = [photograph.name for photograph in block.photographs]
    photographs, cameras, offset_m = list(block.photographs), list(block.cameras), block.gnss_offset_sigma_m
    for a in accused:
        if a.kind == "GNSS position":
            i = names.index(a.name)
            photographs[i] = _without_position(photographs[i])
        elif a.kind == "attitude":
            i = names.index(a.name)
            photographs[i] = replace(photographs[i], attitude_world_from_camera=None, attitude_sigma_rad=None)
        elif a.kind == "GNSS offset":
            offset_m = np.full(3, OPEN_OFFSET_M)
        elif a.kind == "focal length":
            c = [camera.name for camera in cameras].index(a.name)
            sigmas = np.concatenate([[WRONG_BY * cameras[c].focal_px], cameras[c].sigmas[1:]])
            cameras[c] = replace(cameras[c], sigmas=sigmas)
    return replace(
        block,
        cameras=tuple(cameras),
        photographs=tuple(photographs),
        control_points=_ground_without(block, accused),
        gnss_offset_sigma_m=offset_m,
    )


def _ground_without(block: Block, accused: Sequence[Accusation]) -> ControlPoints:
    points, names = block.control_points, [photograph.name for photograph in block.photographs]
    sigma_m, mark_sigma_px, controlled = points.sigma_m.copy(), points.mark_sigma_px.copy(), points.controlled.copy()
    for a in accused:
        if a.kind == "control point":
            sigma_m[points.name.index(a.name), list(a.axes)] = np.inf
        elif a.kind == "mark":
            of_point = points.mark_point == points.name.index(a.name)
            mark_sigma_px[of_point & (points.mark_photograph == names.index(str(a.photograph)))] = np.inf
    oriented = np.array([pose is not None for pose in block.poses], dtype=bool)
    usable = np.isfinite(mark_sigma_px) & oriented[points.mark_photograph]
    marks = np.bincount(points.mark_point[usable], minlength=len(points))
    open_points = np.isinf(np.where(controlled, sigma_m, np.inf)).all(axis=1) & controlled.any(axis=1) & (marks < 2)
    controlled[open_points] = False
    mark_sigma_px[open_points[points.mark_point]] = np.inf
    role: tuple[Role, ...] = tuple("control" if row.any() else "check" for row in controlled)
    return replace(points, role=role, controlled=controlled, sigma_m=sigma_m, mark_sigma_px=mark_sigma_px)


def marks_off_checks(result: Adjustment) -> list[Accusation]:
    """Return the marks of check points that are grossly off where most marks of their point meet: no coordinate
    is asked, so that the point still tests the result."""
    block, points = result.block, result.block.control_points
    agreed, usable = intersected_marks(block)[1], np.isfinite(points.mark_sigma_px)
    oriented = np.array([pose is not None for pose in block.poses], dtype=bool)
    usable &= oriented[points.mark_photograph]
    right, marks = (np.bincount(points.mark_point[m], minlength=len(points)) for m in (agreed, usable))
    sure = (np.array(points.role) == "check") & (right > marks - right)
    return [
        unmeasured("mark", points.name[points.mark_point[m]], block.photographs[points.mark_photograph[m]].name)
        for m in np.flatnonzero(usable & ~agreed & sure[points.mark_point]).tolist()
    ]


@dataclass(frozen=True, eq=False)
class Search:
    """What was accused, and the survey adjusted without it."""

    accused: tuple[Accusation, ...]
    result: Adjustment

    def cost(self) -> float:
        """Return what this explanation costs: the weighted square sum that it leaves, beyond what is expected of what
        was measured beside the tie points, and what it leaves out."""
        r, lost = self.result.reliability, LOST_RAY * self.result.discarded_observations
        expected = sum(float(np.nansum(n)) for n in (r.ground_redundancy, r.mark_redundancy, r.gnss_redundancy))
        lost += LOST_PHOTOGRAPH * sum(bool(why) for why in self.result.reason)
        return 2.0 * self.result.cost - expected + lost + PRICE * len(self.accused)


def scatter(result: Adjustment) -> dict[str, float]:
    """Return by how much control points, marks, GNSS positions and attitudes scatter more than stated, 1 where they do
    not or are too few to say: the median of their tests (a single blunder does not change it)."""
    r = result.reliability
    attitude = r.attitude_left_out_rad / np.sqrt(np.einsum("nii->ni", r.attitude_left_out_covariance_rad2))
    more = {}
    for kind, w, fewest in (
        ("control point", r.ground_w, FEWEST_POINTS_ALIKE),
        ("mark", r.mark_w, FEWEST_ALIKE),
        ("GNSS position", r.gnss_w, FEWEST_ALIKE),
        ("attitude", attitude, FEWEST_ALIKE),
    ):
        own = np.abs(w[np.isfinite(w).all(axis=1)])
        more[kind] = max(1.0, float(np.median(own) / norm.ppf(0.75))) if len(own) >= fewest else 1.0
    return more


def contradictions(result: Adjustment, but: Sequence[Accusation] = ()) -> list[Accusation]:
    """Return what the rest contradicts, the least likely by chance first; without measurements that ``but`` holds.

    Of all tests together FALSE_ALARMS are false; a focal length is tested by itself, at SOURCE_REJECTED. Measurements
    of a kind that scatters more than stated are tested by their own scatter.
    """
    more, excused = scatter(result), {(a.what, a.axes) for a in but}
    tests = [
        replace(a, statistic=a.statistic / more.get(a.kind, 1.0) ** 2)
        for a in accusations(result)
        if (a.what, a.axes) not in excused
    ]
    limit = float(np.log(FALSE_ALARMS / max(len(tests), 1)))
    of_source = float(np.log(2.0 * norm.sf(SOURCE_REJECTED)))
    wrong = (a for a in tests if a.log_chance < (of_source if a.kind == "focal length" else limit))
    return sorted(wrong, key=lambda a: a.log_chance)


def _with_rivals(found: Sequence[Accusation]) -> Accusation:
    """Return the first of the contradictions with the others that would explain it nearly as well."""
    first = found[0]
    rivals = [a.words for a in found[1:] if a.what != first.what and a.log_chance < first.log_chance - RIVAL]
    return replace(first, rivals=tuple(dict.fromkeys(rivals)))


def _chance_of_coordinates(a: Accusation, surveyed: ControlPoints, result: Adjustment, scale: float) -> float:
    """Return the logarithm of the probability that coordinates which took no part lie so far from their prediction,
    where control points scatter ``scale`` times as much as stated."""
    points, frame = surveyed, result.block.frame
    g, axes = points.name.index(a.name), frame.rotation_world_from_map(np.zeros(3))
    own = axes[:, list(a.axes)]
    covariance = own.T @ (result.ground_covariance_m2[g] + axes @ np.diag(points.sigma_m[g] ** 2) @ axes.T) @ own
    off = own.T @ (result.ground_world_m[g] - points.position_world_m[g])
    if not np.isfinite(off).all():
        return -np.inf
    return float(chi2.logsf(off @ np.linalg.solve(covariance, off) / scale**2, len(off)))


def _chance_of_mark(a: Accusation, result: Adjustment) -> float:
    """Return the logarithm of the probability that a mark lies so far from where the other marks of its point put it,
    impossible for anything else: the marks of a point without control take no part."""
    if a.kind != "mark":
        return -np.inf
    points = result.block.control_points
    photograph = [p.name for p in result.block.photographs].index(str(a.photograph))
    m = (points.mark_point == points.name.index(a.name)) & (points.mark_photograph == photograph)
    off_px = result.mark_residual_px[m][0]
    others = points.mark_sigma_px[(points.mark_point == points.name.index(a.name)) & ~m]
    if not (np.isfinite(off_px).all() and np.isfinite(others).any()):
        return -np.inf
    sigma_px = MARK_PREDICTED * float(np.median(others[np.isfinite(others)]))
    pose, g = result.block.poses[photograph], points.name.index(a.name)
    if pose is not None:
        camera = result.block.cameras[result.block.photographs[photograph].camera]
        distance_m = np.linalg.norm(result.ground_world_m[g] - pose.position_world_m)
        spread_m = np.sqrt(np.linalg.eigvalsh(result.ground_covariance_m2[g])[-1])
        sigma_px = float(np.hypot(sigma_px, camera.focal_px * spread_m / distance_m))
    return float(chi2.logsf(float(off_px @ off_px) / sigma_px**2, 2))


def _innocent(accused: Sequence[Accusation], block: Block, result: Adjustment, adjust: Adjuster) -> list[Accusation]:
    """Return those accused that the rest does not contradict; all but coordinates are tested by taking them back
    alone."""
    innocent, price = [], Search(tuple(accused), result).cost()
    for a in accused:
        if a.kind == "control point":
            own = scatter(result)["control point"]
            chance = _chance_of_coordinates(a, block.control_points, result, own)
        else:
            rest = tuple(b for b in accused if b is not a)
            try:
                taken_back = adjust(without(block, rest))
            except PhotogramError:
                continue  # what cannot even be adjusted is not innocent
            if Search(rest, taken_back).cost() > price:
                continue  # it bends the block, so that it fits by itself
            more = scatter(taken_back).get(a.kind, 1.0)
            same = [replace(b, statistic=b.statistic / more**2) for b in accusations(taken_back) if b.what == a.what]
            chance = min((b.log_chance for b in same), default=_chance_of_mark(a, result))
        if chance > np.log(INNOCENT):
            innocent.append(a)
    return innocent


def search(block: Block, result: Adjustment, adjust: Adjuster, accused: Sequence[Accusation] = ()) -> Search:
    """Accuse and leave out, until nothing that was measured contradicts the rest.

    ``result`` is that of ``block`` without what is ``accused`` beforehand; ``adjust`` adjusts a block.
    """
    blamed, current = list(accused), result
    immune: list[Accusation] = []
    while len(blamed) < max(MOST_BLUNDERS, len(accused) + 3):
        found = contradictions(current, [*blamed, *immune])
        if not found:
            break
        blamed.append(_with_rivals(found))
        try:
            current = adjust(without(block, blamed))
        except PhotogramError:
            immune.append(blamed.pop())  # nothing is left that could say it is wrong
            _LOG.debug("kept, since nothing is determined without it: %s", immune[-1].words)
        else:
            _LOG.debug("rejected: %s, T = %.1f", blamed[-1].words, blamed[-1].statistic)
    if accused or len(blamed) > 1:
        innocent = _innocent(blamed, block, current, adjust)
        if innocent:
            _LOG.debug("reinstated: %s", ", ".join(a.words for a in innocent))
            rest = [a for a in blamed if a not in innocent]
            with suppress(PhotogramError):  # where the rest cannot be adjusted with them, they stay out
                return min(
                    Search(tuple(rest), adjust(without(block, rest))), Search(tuple(blamed), current), key=Search.cost
                )
    return Search(tuple(blamed), current)
