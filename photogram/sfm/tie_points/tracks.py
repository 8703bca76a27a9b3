"""Pairwise matches joined to tie points over all photographs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from photogram.arrays import ByteArray, FloatArray
from photogram.survey import Features, Matches, TiePoints


def key_point_sigmas_px(size_px: FloatArray, smallest_px: float, exponent: float, sigma_px: float) -> FloatArray:
    """Return the standard deviations (N,) of key points of a size (N,): ``sigma_px`` for those of ``smallest_px``,
    growing with a power of the size (see the page Mathematics)."""
    return np.asarray(sigma_px * (np.maximum(size_px, smallest_px) / smallest_px) ** exponent)


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
    node, photograph = node[good], photograph[good]
    component = component[good]
    _, start = np.unique(component, return_index=True)
    rank = np.empty(int(component.max(initial=-1)) + 1, dtype=np.int64)
    rank[component[np.sort(start)]] = np.arange(len(start))
    point = rank[component]
    order = np.lexsort((photograph, point))
    node, photograph = node[order], photograph[order]
    point = point[order]
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


def without_conflicts(tie_points: TiePoints) -> Joined:
    """Return tie points that are joined already, without those that have two observations in one photograph, ordered as
    ``join_matches`` does: points by their first observation."""
    again = (np.diff(tie_points.point) == 0) & (np.diff(tie_points.photograph) == 0)
    consistent = np.ones(len(tie_points), dtype=bool)
    consistent[tie_points.point[1:][again]] = False
    kept = tie_points.select(consistent)
    first = kept.first_observation[:-1]
    sequence = np.lexsort((kept.feature[first], kept.photograph[first]))
    rank = np.argsort(sequence)
    order = np.argsort(rank[kept.point], kind="stable")
    ordered = TiePoints(
        kept.photograph[order],
        rank[kept.point[order]],
        kept.feature[order],
        kept.pixel[order],
        kept.sigma_px[order],
        kept.position_world_m[sequence],
        kept.colour[sequence],
    )
    return Joined(ordered, int(np.count_nonzero(~consistent)))


def coloured(tie_points: TiePoints, photograph: int, pixels: ByteArray) -> TiePoints:
    """Return tie points, those whose first observation is in a photograph in the colour that its red, green, blue
    ``pixels`` (H, W, 3) have there."""
    first = tie_points.first_observation[:-1]
    here = tie_points.photograph[first] == photograph
    height, width = pixels.shape[:2]
    place = np.rint(tie_points.pixel[first[here]]).astype(np.int64)
    column, row = np.clip(place, 0, np.array([width, height]) - 1).T
    colour = tie_points.colour.copy()
    colour[here] = pixels[row, column]
    return replace(tie_points, colour=colour)


def seen_in_all(tie_points: TiePoints, photographs: Sequence[int]) -> TiePoints:
    """Return the tie points that are seen in every one of ``photographs``, with their observations there."""
    within = np.isin(tie_points.photograph, photographs)
    seen = np.bincount(tie_points.point[within], minlength=len(tie_points)) == len(set(photographs))
    return tie_points.select(seen, within)
