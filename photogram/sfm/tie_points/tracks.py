"""Pairwise matches joined to tie points over all photographs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from photogram.arrays import FloatArray
from photogram.survey import Features, Matches, TiePoints

SIZE_EXPONENT = 1 / 3
"""Power of a key point's size with which the standard deviation of its place grows, as measured (see the page
Mathematics)."""


def key_point_sigmas_px(size_px: FloatArray, smallest_px: float, sigma_px: float) -> FloatArray:
    """Return the standard deviations (N,) of key points of a size (N,): ``sigma_px`` for those of ``smallest_px``."""
    return np.asarray(sigma_px * (np.maximum(size_px, smallest_px) / smallest_px) ** SIZE_EXPONENT)


@dataclass(frozen=True, eq=False)
class Joined:
    """Tie points, and the number of connected sets that were dropped because they hold two key points of one
    photograph."""

    tie_points: TiePoints
    conflicts: int


def join_matches(features: Sequence[Features], matches: Sequence[Matches], sigma_px: Sequence[FloatArray]) -> Joined:
    """Join verified matches to tie points: connected components of the graph of matched key points (union–find).

    ``features`` are those of every photograph in the order of the block, ``matches`` hold verified index pairs (M, 2),
    ``sigma_px`` the standard deviations (N,) in px of the key points of each photograph.
    A component with two key points in one photograph contradicts itself and is dropped. Observations are sorted by
    point, then photograph; points by their first key point. Positions are NaN: nothing is known of them yet.
    """
    offset = np.concatenate([[0], np.cumsum([len(f) for f in features])]).astype(np.int64)
    total = int(offset[-1])
    edges = [
        np.column_stack([offset[m.first] + m.index[:, 0], offset[m.second] + m.index[:, 1]]) for m in matches if len(m)
    ]
    edge = np.concatenate(edges) if edges else np.zeros((0, 2), dtype=np.int64)
    graph = coo_matrix((np.ones(len(edge), dtype=np.int8), (edge[:, 0], edge[:, 1])), shape=(total, total))
    label = connected_components(graph, directed=False)[1]
    node = np.unique(edge)
    photograph = np.searchsorted(offset, node, side="right") - 1
    _, component = np.unique(label[node], return_inverse=True)
    pair = component * np.int64(len(features)) + photograph
    _, first, count = np.unique(pair, return_index=True, return_counts=True)
    conflicting = np.unique(component[first[count > 1]])
    good = ~np.isin(component, conflicting)
    node, photograph, component = node[good], photograph[good], component[good]
    _, start = np.unique(component, return_index=True)
    rank = np.empty(int(component.max(initial=-1)) + 1, dtype=np.int64)
    rank[component[np.sort(start)]] = np.arange(len(start))
    point = rank[component]
    order = np.lexsort((photograph, point))
    node, photograph, point = node[order], photograph[order], point[order]
    pixel = np.concatenate([f.pixel for f in features]) if total else np.zeros((0, 2))
    sigma = np.concatenate(sigma_px) if total else np.zeros(0)
    colour = np.concatenate([f.colour for f in features]) if total else np.zeros((0, 3), dtype=np.uint8)
    leaders = np.searchsorted(point, np.arange(len(start)))
    tie_points = TiePoints(
        photograph.astype(np.int64),
        point.astype(np.int64),
        (node - offset[photograph]).astype(np.int64),
        pixel[node],
        sigma[node],
        np.full((len(start), 3), np.nan),
        colour[node[leaders]],
    )
    return Joined(tie_points, len(conflicting))


def seen_in_all(tie_points: TiePoints, photographs: Sequence[int]) -> TiePoints:
    """Return the tie points that are seen in every one of ``photographs``, with their observations there."""
    within = np.isin(tie_points.photograph, photographs)
    seen = np.bincount(tie_points.point[within], minlength=len(tie_points)) == len(set(photographs))
    return tie_points.select(seen, within)
