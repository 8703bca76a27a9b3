"""Targets looked for where points may be: proposals of marks, which count for nothing until a person confirms them."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import combinations
from threading import Lock, Thread

import cv2
import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import ControlPointError, PhotogramError
from photogram.files.tables.surveyed_points import Mark, MarkKey, Proposal
from photogram.languages.said import Figures, Said, said_of
from photogram.marking.assignment import DetectedCentres, assigned_targets
from photogram.marking.files.journal import utc_now
from photogram.marking.page.patches import LARGEST_SIDE, PatchReader, Window
from photogram.marking.page.snapping import LENS_PX
from photogram.marking.predictions import PredictedPlaces, predicted_places
from photogram.marking.targets.acceptance import Judgement
from photogram.marking.targets.kinds import MeasuredCentre
from photogram.marking.targets.measurement import targets_and_candidates
from photogram.survey import Block
from photogram.wording import Progress, silent

AROUND_PX = 40
"""How far beyond the ellipse of a place a patch reaches: half of a large target."""
MOST_PX = 160
"""Half of the side of a patch at most; of wider ellipses the middle is looked at."""
SAME_PX = 2.0
"""How near to each other targets are one."""

Box = tuple[int, int, int, int]
"""First column and row of a part of a photograph, and those after the last."""


@dataclass(frozen=True, eq=False)
class _Detection:
    photograph: int
    centre: MeasuredCentre
    pixel: FloatArray


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What a search for targets came to."""

    proposals: tuple[Proposal, ...]
    """Targets that are taken for points."""
    photographs: int
    """Photographs in which points without a mark may lie, and which were looked at."""
    targets: int = 0
    """Targets that were found there."""
    candidates: tuple[Judgement, ...] = ()
    """What resembles a target there and is none that is sure, the nearest to its limit first."""
    radius_px: float = 0.0
    """Median of the radius within which the places of the points are known, px."""

    def __str__(self) -> str:
        if self.proposals:
            return Said.plural("{n} target found", "{n} targets found", len(self.proposals))
        if not self.photographs:
            return Said("no search was needed: no point without a mark may be seen in any photograph")
        where = Said.plural(
            "in the {n} photograph where points may be", "in the {n} photographs where points may be", self.photographs
        )
        radius, most = f"{self.radius_px:.0f}", MOST_PX
        known = (
            Said(
                "their places are known to ± {radius} px, and {most} px around each were looked at",
                radius=radius, most=most,
            )
            if self.radius_px + AROUND_PX > MOST_PX
            else Said("their places are known to ± {radius} px", radius=radius)
        )  # fmt: skip
        if self.targets:
            return Said.plural(
                "{n} target found {where}, but it cannot be assigned to a point ({known}): mark two points in two "
                "photographs each, and search again",
                "{n} targets found {where}, but none can be assigned to a point ({known}): mark two points in two "
                "photographs each, and search again",
                self.targets, where=where, known=known,
            )  # fmt: skip
        if self.candidates:
            return self._of_candidates(where, known)
        return Said("nothing resembles a target {where} ({known}): mark by hand", where=where, known=known)

    def _of_candidates(self, where: Said, known: Said) -> Said:
        best = self.candidates[0]
        score, limit = Figures(f"{best.score:.1f}"), Figures(f"{best.limit:.1f}")
        short = (
            Said(
                "scores {score}, and {limit} is the limit, but its size, contrast or sharpness is not that of a target",
                score=score, limit=limit,
            )
            if best.score >= best.limit
            else Said("scores {score}, and {limit} is the limit", score=score, limit=limit)
        )  # fmt: skip
        return Said.plural(
            "no certain target {where} ({known}): the only candidate {scores}: mark by hand",
            "no certain target {where} ({known}): the best of {n} candidates {scores}: mark by hand",
            len(self.candidates), where=where, known=known, scores=short,
        )  # fmt: skip


def proposed_marks(
    block: Block,
    patches: PatchReader,
    hidden: frozenset[MarkKey] = frozenset(),
    progress: Progress = silent,
) -> SearchResult:
    """Return a proposal for every target that is taken for a point, where the point has no mark and nobody said that it
    cannot be seen (``hidden``), and what else was found.

    ``block`` is a ``tagged_block`` or an adjusted one, with the marks that there are. Raises AdjustmentError where it
    is not determined, ImageError where a photograph cannot be read.
    """
    names = block.photograph_names
    at_point, at_photograph = ({n: k for k, n in enumerate(every)} for every in (block.control_points.name, names))
    unseen = frozenset((at_point[g], at_photograph[i]) for g, i in hidden if g in at_point and i in at_photograph)
    places = predicted_places(block)
    boxes = _boxes(block, places, unseen)
    detections, candidates = _detected_targets(block, boxes, patches, progress)
    radius_px = float(np.median(places.radius_px)) if len(places.point) else 0.0
    found = SearchResult((), len(boxes), len(detections), candidates, radius_px)
    if not detections:
        return found
    targets = DetectedCentres(
        np.array([one.photograph for one in detections], dtype=np.int64),
        np.array([one.pixel for one in detections]),
        np.array([np.sqrt(0.5 * np.trace(one.centre.covariance_px2) + LENS_PX**2) for one in detections]),
    )
    assignment = assigned_targets(block, targets, unseen)
    now = utc_now()
    proposals = tuple(
        _proposal(block.control_points.name[g], names[i], detections[k], now)
        for (g, i), k in sorted(assignment.target.items())
    )
    return replace(found, proposals=proposals)


@dataclass(frozen=True)
class SearchState:
    """Where a search for targets stands."""

    is_running: bool
    words: str
    """How far it is, or how the last one ended; empty before the first."""


class TargetSearch:
    """A search for targets in a thread of its own, one at a time; ``notify`` is called when its state has changed."""

    def __init__(self, notify: Callable[[], None] = lambda: None) -> None:
        self._lock, self._notify = Lock(), notify
        self._state = SearchState(False, "")

    @property
    def state(self) -> SearchState:
        """Where it stands."""
        with self._lock:
            return self._state

    def begin(self, search: Callable[[Progress], str]) -> bool:
        """Run a search, which says how it ended, in the background; returns whether it was begun, which it is not while
        another one runs. What a PhotogramError says is how it ended."""
        with self._lock:
            if self._state.is_running:
                return False
            self._state = SearchState(True, Said("looking for targets"))

        def run() -> None:
            words: str = Said("the search for targets failed")
            try:
                words = search(self._progressed)
            except PhotogramError as error:
                words = said_of(error) or str(error)
            finally:
                self._set(SearchState(False, words))

        Thread(target=run, name="targets", daemon=True).start()
        self._notify()
        return True

    def _set(self, state: SearchState) -> None:
        with self._lock:
            self._state = state
        self._notify()

    def _progressed(self, done: int, total: int, _text: str) -> None:
        self._set(
            SearchState(
                True,
                Said.plural(
                    "looking for targets: {done} of {n} part",
                    "looking for targets: {done} of {n} parts",
                    total,
                    done=done,
                ),
            )
        )


def _proposal(point: str, photograph: str, detection: _Detection, now: str) -> Proposal:
    covariance = detection.centre.covariance_px2 + LENS_PX**2 * np.eye(2)
    sigma = np.sqrt(np.diag(covariance))
    u, v = (float(value) for value in detection.pixel)
    mark = Mark(
        point,
        photograph,
        (u, v),
        (float(sigma[0]), float(sigma[1])),
        float(covariance[0, 1] / (sigma[0] * sigma[1])),
        detection.centre.kind.value,
        now,
    )
    return Proposal(mark, round(float(detection.centre.quality), 4))


def _boxes(block: Block, places: PredictedPlaces, unseen: frozenset[tuple[int, int]]) -> dict[int, list[Box]]:
    """Return by photograph the parts around all places that have no mark."""
    points = block.control_points
    marked = set(zip(points.mark_point.tolist(), points.mark_photograph.tolist(), strict=True)) | unseen
    radius = np.minimum(places.radius_px + AROUND_PX, MOST_PX)
    boxes: dict[int, list[Box]] = {}
    for p in range(len(places.point)):
        i = int(places.photograph[p])
        if (int(places.point[p]), i) not in marked:
            (u, v), half = (round(float(value)) for value in places.pixel[p]), round(float(radius[p]))
            boxes.setdefault(i, []).append((u - half, v - half, u + half + 1, v + half + 1))
    return boxes


def _detected_targets(
    block: Block, boxes: Mapping[int, list[Box]], patches: PatchReader, progress: Progress
) -> tuple[list[_Detection], tuple[Judgement, ...]]:
    """Return the targets in parts of photographs, each once, and what resembles one there."""
    # one photograph is decoded after the other
    wanted = [(i, Window(x, y, r - x, b - y)) for i in sorted(boxes) for x, y, r, b in merged(boxes[i])]

    def look(one: tuple[int, Window]) -> tuple[list[_Detection], list[Judgement]]:
        i, window = one
        try:
            cut = patches.window(i, window)
        except ControlPointError:
            return [], []  # outside the picture
        grey = np.asarray(cv2.cvtColor(np.ascontiguousarray(patches.pixels(i, window)), cv2.COLOR_RGB2GRAY), np.uint8)
        focal = block.cameras[block.photographs[i].camera].focal_px
        corner = np.array([cut.left, cut.upper], dtype=np.float64)
        targets, candidates = targets_and_candidates(grey, focal)
        made = [_Detection(i, centre, centre.centre_px + corner) for centre in targets]
        return made, [candidate.judgement for candidate in candidates]

    kept: list[_Detection] = []
    resembling: list[Judgement] = []
    with ThreadPoolExecutor(2) as pool:
        for done, ((i, _), (several, candidates)) in enumerate(zip(wanted, pool.map(look, wanted), strict=True), 1):
            own = [other for other in kept if other.photograph == i]
            kept += [one for one in several if all(np.hypot(*(one.pixel - o.pixel)) >= SAME_PX for o in own)]
            resembling += candidates
            progress(done, len(wanted), block.photographs[i].name)
    return kept, tuple(sorted(resembling, key=lambda one: one.limit - one.score))


def merged(boxes: Sequence[Box]) -> list[Box]:
    """Return boxes in place of these, where two that overlap are one if that is no larger than both, nor than a patch
    may be."""
    left = sorted(set(boxes))
    while True:
        pair = next(((a, b) for a, b in combinations(left, 2) if _are_one(a, b)), None)
        if pair is None:
            return left
        left = sorted({*(box for box in left if box not in pair), _hull(*pair)})


def _are_one(one: Box, other: Box) -> bool:
    whole = _hull(one, other)
    is_patch = max(whole[2] - whole[0], whole[3] - whole[1]) <= LARGEST_SIDE
    return is_patch and _area(whole) <= _area(one) + _area(other)


def _hull(one: Box, other: Box) -> Box:
    return min(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), max(one[3], other[3])


def _area(box: Box) -> int:
    return (box[2] - box[0]) * (box[3] - box[1])
