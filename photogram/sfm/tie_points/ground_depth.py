"""Pairs of photographs for ground that lies deeper, or less deep, than the flying heights say.

Tags give heights above the place of take-off, not above the ground. From a hill they are too small: footprints are then
predicted too small, and whole strips are not matched with those beside them. From a valley they are too great, and a
photograph wastes its partners on others that show nothing of its ground. Nothing but the pictures can say so. Of the
pairs that share ground at one depth and not at the other a few are matched: where enough of them are verified it does
lie deeper, where too few of those selected are it lies less deep, and the pairs of that depth are taken too. Where the
heights are right, the pairs stay what they were.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Camera
from photogram.sfm.tie_points.pairs import PairSettings, Reason, SelectedPairs, footprint_pairs, predicted_overlap
from photogram.survey import Photograph

Pairs = Sequence[tuple[int, int]]
Verify = Callable[[Pairs], Sequence[bool]]

DEEPER, SHALLOWER = (1.5, 2.3, 3.5), (0.7, 0.5)
"""Times the stated flying height, tried one after the other; the last ones cover heights of 0.3 and 2 times the
truth."""

UNSEEN = 0.02
"""Predicted overlap below which two photographs have nothing in common at a depth."""

PROBED_SHARE = 0.05
FEWEST_PROBES, MOST_PROBES = 4, 12
"""Pairs that are matched for each depth: this share of those selected, within these limits."""

VERIFIED_SHARE = 0.25
"""Of the probes, from which the ground is believed to lie so deep: a part of a block may have right heights, and some
pairs show water or woods."""


def _at_depth(photographs: Sequence[Photograph], factor: float) -> list[Photograph]:
    """Return the photographs with the ground ``factor`` times as far below."""
    return [
        p if p.height_above_ground_m is None else replace(p, height_above_ground_m=factor * p.height_above_ground_m)
        for p in photographs
    ]


class _Choice:
    """The pairs that are chosen for some photographs, with their reasons, while the depth of the ground is tried."""

    def __init__(
        self, photographs: Sequence[Photograph], cameras: Sequence[Camera], settings: PairSettings, count: int
    ) -> None:
        self._photographs = photographs
        self._cameras = cameras
        self._settings = settings
        self._count = count

    def pairs(self, factor: float) -> list[tuple[int, int]]:
        """Return the pairs by footprint with the ground ``factor`` times as deep as stated."""
        deep = _at_depth(self._photographs, factor)
        return [(i, j) for i, j in footprint_pairs(deep, self._cameras, self._settings).tolist()]

    def overlap(self, factor: float, pairs: Pairs) -> FloatArray:
        """Return the overlap (P,) of pairs that is predicted at a depth."""
        return predicted_overlap(_at_depth(self._photographs, factor), self._cameras, pairs)

    def probes(self, pairs: Pairs, seen: float, unseen: float, limit: float = UNSEEN) -> list[tuple[int, int]]:
        """Return some of the pairs that share ground at the depth ``seen`` and less than ``limit`` at ``unseen``,
        spread over the block; of those in question the half that overlaps most. None where there are too few."""
        only = [pair for pair, share in zip(pairs, self.overlap(unseen, pairs), strict=True) if share < limit]
        if len(only) < FEWEST_PROBES:
            return []
        count = min(self._count, len(only))
        order = np.argsort(-self.overlap(seen, only), kind="stable")
        best = np.sort(order[: max(count, (len(only) + 1) // 2)])
        return [only[i] for i in best[np.unique(np.linspace(0, len(best) - 1, count).round().astype(np.int64))]]


def with_ground_depth(
    photographs: Sequence[Photograph],
    cameras: Sequence[Camera],
    settings: PairSettings,
    selected: SelectedPairs,
    verify: Verify,
) -> SelectedPairs:
    """Return the selected pairs, and those that share ground at the depth where some pairs show it to lie.

    ``verify`` matches pairs and says which of them show the same; it is asked for at most MOST_PROBES pairs at each of
    the depths, and no more once the depth is known. Raises ImageError as select_pairs.
    """
    count = int(np.clip(round(PROBED_SHARE * len(selected)), FEWEST_PROBES, MOST_PROBES))
    choice = _Choice(photographs, cameras, settings, count)
    reasons: dict[tuple[int, int], Reason] = dict(zip(selected.pairs, selected.reasons, strict=True))
    before = 1.0
    for factor in DEEPER:
        further = [pair for pair in choice.pairs(factor) if pair not in reasons]
        probes = choice.probes(further, factor, before)
        if not probes and before > 1.0:  # it does lie deeper: by still more?
            probes = choice.probes(further, factor, before, settings.footprint_overlap)
        if not probes:
            continue
        if np.mean(verify(probes)) < VERIFIED_SHARE:
            break
        reasons |= dict.fromkeys(further, "depth")
        before = factor
    if before == 1.0:
        _add_shallower(choice, reasons, verify)
    pairs = sorted(reasons)
    return SelectedPairs(tuple(pairs), tuple(reasons[p] for p in pairs))


def _add_shallower(choice: _Choice, reasons: dict[tuple[int, int], Reason], verify: Verify) -> None:
    """Add the pairs of less deep ground, as long as those that share only deeper ground are not verified."""
    before = 1.0
    for factor in SHALLOWER:
        probes = choice.probes(choice.pairs(before), before, factor)
        if not probes:
            continue
        if np.mean(verify(probes)) >= VERIFIED_SHARE:
            break
        reasons |= dict.fromkeys((pair for pair in choice.pairs(factor) if pair not in reasons), "depth")
        before = factor
