"""Tie points that are known already, as the key points and matches that would have led to them."""

from __future__ import annotations

import numpy as np

from photogram.arrays import ByteArray, IntArray
from photogram.sfm.tie_points.pairs import Reason, SelectedPairs
from photogram.survey import Features, Matches, TiePoints


def numbered_in_photographs(tie_points: TiePoints) -> IntArray:
    """Return the number (N,) of each observation among those of its photograph."""
    order = np.argsort(tie_points.photograph, kind="stable")
    sorted_photographs = tie_points.photograph[order]
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order)) - np.searchsorted(sorted_photographs, sorted_photographs)
    return number


def known_features(tie_points: TiePoints, photograph: int, pixels: ByteArray) -> Features:
    """Return the observations of a photograph, whose red, green, blue are ``pixels`` (H, W, 3), as key points in their
    order: of no size, orientation and description, coloured as the photograph is there."""
    place = tie_points.pixel[tie_points.photograph == photograph]
    height, width = pixels.shape[:2]
    column, row = np.clip(np.rint(place).astype(np.int64), 0, np.array([width, height]) - 1).T
    none = np.zeros(len(place))
    return Features(place, none, none, np.zeros((len(place), 0), dtype=np.uint8), pixels[row, column].copy())


def known_pairs(tie_points: TiePoints) -> SelectedPairs:
    """Return the pairs of photographs that show the same tie points."""
    pairs = tuple((matches.first, matches.second) for matches in known_matches(tie_points))
    reason: Reason = "start"
    return SelectedPairs(pairs, (reason,) * len(pairs))


def known_matches(tie_points: TiePoints) -> tuple[Matches, ...]:
    """Return the matches of every pair of photographs that show the same tie points, sorted by pair; key points are
    numbered as ``known_features`` has them."""
    point, photograph, number = tie_points.point, tie_points.photograph, numbered_in_photographs(tie_points)
    found = []
    for apart in range(1, int(tie_points.rays.max(initial=0))):
        first = np.flatnonzero(point[apart:] == point[:-apart])
        found.append(np.column_stack([first, first + apart]))
    observation = np.concatenate(found) if found else np.zeros((0, 2), dtype=np.int64)
    pair = photograph[observation]
    turned = pair[:, 0] > pair[:, 1]
    observation[turned], pair[turned] = observation[turned, ::-1], pair[turned, ::-1]
    apart_photographs = pair[:, 0] != pair[:, 1]
    observation, pair = observation[apart_photographs], pair[apart_photographs]
    order = np.lexsort((observation[:, 0], pair[:, 1], pair[:, 0]))
    pair, index = pair[order], number[observation[order]]
    if not len(pair):
        return ()
    starts = np.flatnonzero(np.any(np.diff(pair, axis=0, prepend=-1) != 0, axis=1))
    ends = [*starts[1:].tolist(), len(pair)]
    return tuple(
        Matches(int(pair[a, 0]), int(pair[a, 1]), index[a:b]) for a, b in zip(starts.tolist(), ends, strict=True)
    )
