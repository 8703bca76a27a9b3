"""Which pairs of photographs are worth matching: by predicted footprints, by neighbours, by similarity.

Where position, flying height and attitude are known, the ground that two photographs share is predicted; where only
positions are, near photographs are taken; where nothing is, those that look alike. Every photograph chooses a fixed
number of partners, so that the pairs grow linearly, and chooses them all around: a block that holds together along
its strips only is weak.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import cos, inf, radians
from typing import Annotated, Literal

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from photogram.arrays import BoolArray, FloatArray, IntArray, check_shape
from photogram.camera import Camera, image_plane, image_plane_or_nan
from photogram.compilation import njit
from photogram.errors import OrientationError
from photogram.projection import SIDEWAYS
from photogram.settings.settings import Settings, Within
from photogram.survey import Photograph

Reason = Literal["footprint", "neighbour", "retrieval", "exhaustive", "depth"]

_GRID = 7  # rays per side of a photograph that stand for its footprint
_REACH = 5.0  # ground farther away than this many flying heights is too oblique to count
_GROUND_SHARE = 0.5  # a photograph that shows less ground than this has no footprint
_SIMILAR_VIEW = cos(radians(30.0))  # between the rays of two photographs: SIFT does not mind up to this angle,
_FOREIGN_VIEW = cos(radians(60.0))  # and sees nothing in common from this one on
_ATTITUDE_SIGMA_RAD = radians(5.0)  # where an attitude states no sigma
_SURROUNDINGS = 8  # photographs looked at, per partner chosen
_FEW = 3  # a photograph with fewer predicted partners also takes its neighbours
_SECTORS = 10  # eight of azimuth, above, below
_SECTOR_REACH = 4.0  # a neighbour in an empty direction may be this many times as far as the last of the nearest
_NEAR_SPACINGS, _NEAR_HEIGHTS = 30.0, 10.0  # photographs farther apart show different sites
_NEAR_M = (100.0, 10_000.0)  # the least and the most that these may come to
_LINKS = 3  # pairs that join two pieces of the block
_EXHAUSTIVE = 30  # so few photographs are matched all with all


@dataclass(frozen=True)
class PairSettings(Settings):
    """Which photographs are matched with each other."""

    neighbours: Annotated[
        int, Within(1, 1000), "Partners of a photograph whose attitude or flying height is not known, the nearest."
    ] = 12
    retrieved: Annotated[
        int, Within(1, 1000), "Partners of a photograph without a position, the most similar ones."
    ] = 10
    maximum: Annotated[int, Within(1, 1000), "Partners of a photograph by predicted footprints."] = 16
    footprint_overlap: Annotated[
        float, Within(0.01, 1), "Predicted share of the pictures that shows the same ground, at least."
    ] = 0.1


@dataclass(frozen=True)
class SelectedPairs:
    """Pairs (i, j) of photographs with i < j, sorted, and why each was taken."""

    pairs: tuple[tuple[int, int], ...]
    reasons: tuple[Reason, ...]

    def __post_init__(self) -> None:
        if len(self.pairs) != len(self.reasons):
            raise ValueError("one reason per pair")

    def __len__(self) -> int:
        return len(self.pairs)


# ---- predicted footprints --------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Aim:
    """Photographs of known position, flying height and attitude over level ground below each of them.

    ``ground_m`` (N, G, 2) east and north of where the rays of a photograph meet the ground, NaN where they do not;
    ``frame`` (N, 4) least and greatest x and y in the ideal image plane; ``sigma_rad`` (N,) of the direction of a ray,
    ``sigma_m`` (N,) of the position in plan.
    """

    photograph: IntArray
    position_m: FloatArray
    height_m: FloatArray
    rotation: FloatArray
    ground_m: FloatArray
    frame: FloatArray
    sigma_rad: FloatArray
    sigma_m: FloatArray

    @property
    def centre_m(self) -> FloatArray:
        """Return the middle (N, 2) of the footprints."""
        return np.asarray(np.nanmedian(self.ground_m, axis=1))

    def only(self, keep: BoolArray) -> _Aim:
        """Return the photographs of the mask (N,)."""
        return _Aim(**{f.name: np.ascontiguousarray(getattr(self, f.name)[keep]) for f in fields(self)})


def _rays(camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Return directions (G, 3) in the camera frame that stand for equal parts of a photograph, and its frame (4,)."""
    part = (np.arange(_GRID) + 0.5) / _GRID
    size = np.array([camera.width_px, camera.height_px], dtype=np.float64)
    grid = np.stack(np.meshgrid(part, part), axis=-1).reshape(-1, 2) * size - 0.5
    edges = np.array([[0.0, 0.5], [1.0, 0.5], [0.5, 0.0], [0.5, 1.0]]) * size - 0.5
    pixel = np.vstack([grid, edges])
    ideal = image_plane_or_nan(camera, pixel) if camera.model == "fisheye" else image_plane(camera, pixel)
    away = np.sign(pixel - camera.principal_point_px)
    ideal[grid.shape[0] :] = np.where(np.isfinite(ideal), ideal, SIDEWAYS * away)[grid.shape[0] :]
    left, right, top, bottom = ideal[-4:]
    frame = np.array([left[0], right[0], top[1], bottom[1]])
    return np.column_stack([ideal[:-4], np.ones(len(grid))]), frame


def _aim(photographs: Sequence[Photograph], cameras: Sequence[Camera]) -> _Aim:
    """Return the photographs of known position, flying height and attitude that look at the ground."""
    index = [i for i, p in enumerate(photographs) if p.gnss_world_m is not None and (p.height_above_ground_m or 0) > 0]
    index = [i for i in index if photographs[i].attitude_world_from_camera is not None]
    aimed = [photographs[i] for i in index]
    n = len(aimed)
    C = np.array([p.gnss_world_m for p in aimed], dtype=np.float64).reshape(n, 3)
    R = np.array([p.attitude_world_from_camera for p in aimed], dtype=np.float64).reshape(n, 3, 3)
    h = np.array([p.height_above_ground_m for p in aimed], dtype=np.float64)
    sigma_m = np.array([p.gnss_sigma_m for p in aimed], dtype=np.float64).reshape(n, 3)
    sigma_rad = [_ATTITUDE_SIGMA_RAD if p.attitude_sigma_rad is None else p.attitude_sigma_rad for p in aimed]
    used, slot = np.unique([p.camera for p in aimed], return_inverse=True)
    views = [_rays(cameras[int(c)]) for c in used]
    direction = np.array([rays for rays, _ in views]).reshape(-1, _GRID**2, 3)[slot] @ np.swapaxes(R, 1, 2)
    down = np.maximum(-direction[..., 2], 1e-9)
    hits = np.linalg.norm(direction[..., :2], axis=2) <= _REACH * down
    depth = np.where(hits, h[:, None] / down, np.nan)
    aim = _Aim(
        photograph=np.array(index, dtype=np.int64),
        position_m=C,
        height_m=h,
        rotation=R,
        ground_m=C[:, None, :2] + depth[..., None] * direction[..., :2],
        frame=np.array([frame for _, frame in views]).reshape(-1, 4)[slot],
        sigma_rad=np.array(sigma_rad, dtype=np.float64),
        sigma_m=np.hypot(sigma_m[:, 0], sigma_m[:, 1]) / np.sqrt(2.0),
    )
    return aim.only(hits.mean(axis=1) >= _GROUND_SHARE)


@njit(cache=True, nogil=True)
def _inside(value: float, low: float, high: float, margin: float) -> float:
    """How likely a value that may be off by the margin lies between two limits: a ramp from outside to inside."""
    return min(1.0, max(0.0, (min(value - low, high - value) + margin) / (2.0 * margin)))


@njit(cache=True, nogil=True)
def _share(
    i: int,
    j: int,
    C: FloatArray,
    h: FloatArray,
    R: FloatArray,
    ground: FloatArray,
    frame: FloatArray,
    margin: float,
) -> float:
    """The share of photograph i that photograph j is expected to show, from a direction that is not too different.

    Each photograph keeps its own height above the ground they share, so that heights of two flights need not agree.
    """
    total, seen = 0, 0.0
    for g in range(ground.shape[1]):
        x, y = ground[i, g, 0], ground[i, g, 1]
        if np.isnan(x):
            continue
        total += 1
        a, b = x - C[j, 0], y - C[j, 1]
        depth = R[j, 0, 2] * a + R[j, 1, 2] * b - R[j, 2, 2] * h[j]
        if depth <= 0.0:
            continue
        u = (R[j, 0, 0] * a + R[j, 1, 0] * b - R[j, 2, 0] * h[j]) / depth
        v = (R[j, 0, 1] * a + R[j, 1, 1] * b - R[j, 2, 1] * h[j]) / depth
        p, q = x - C[i, 0], y - C[i, 1]
        length = np.sqrt((p * p + q * q + h[i] * h[i]) * (a * a + b * b + h[j] * h[j]))
        view = ((p * a + q * b + h[i] * h[j]) / length - _FOREIGN_VIEW) / (_SIMILAR_VIEW - _FOREIGN_VIEW)
        seen += (
            _inside(u, frame[j, 0], frame[j, 1], margin)
            * _inside(v, frame[j, 2], frame[j, 3], margin)
            * min(1.0, max(0.0, view))
        )
    return seen / total


@njit(cache=True, nogil=True)
def _overlaps(
    pair: IntArray,
    C: FloatArray,
    h: FloatArray,
    R: FloatArray,
    ground: FloatArray,
    frame: FloatArray,
    sigma_rad: FloatArray,
    sigma_m: FloatArray,
) -> FloatArray:
    """The geometric mean of the shares of two photographs, for each pair of indices (P, 2)."""
    overlap = np.empty(len(pair))
    for k in range(len(pair)):
        i, j = pair[k]
        turn = sigma_rad[i] ** 2 + sigma_rad[j] ** 2
        shift = sigma_m[i] ** 2 + sigma_m[j] ** 2
        there = _share(i, j, C, h, R, ground, frame, 1e-6 + 2.0 * np.sqrt(turn + shift / h[j] ** 2))
        back = _share(j, i, C, h, R, ground, frame, 1e-6 + 2.0 * np.sqrt(turn + shift / h[i] ** 2))
        overlap[k] = np.sqrt(there * back)
    return overlap


def _aimed_overlap(aim: _Aim, pair: IntArray) -> FloatArray:
    pair = np.ascontiguousarray(pair, dtype=np.int64)
    ground, frame = aim.ground_m, aim.frame
    return _overlaps(pair, aim.position_m, aim.height_m, aim.rotation, ground, frame, aim.sigma_rad, aim.sigma_m)


def predicted_overlap(
    photographs: Sequence[Photograph], cameras: Sequence[Camera], pairs: Sequence[tuple[int, int]]
) -> FloatArray:
    """Return the share (P,) of the pictures of each pair that is expected to show the same ground.

    The geometric mean of the share of the first that the second shows and the reverse, counted over a grid of rays that
    meet level ground below each photograph's flying height. Near the edge of a picture, within 2 sigmas of position and
    attitude, ground counts as likely as it is to be seen; under directions that differ by 30° to 60° it counts less and
    less, beyond not at all. NaN where position, flying height or attitude is not known, or where less than half of a
    photograph shows ground within five flying heights. Raises ImageError where a distortion cannot be undone.
    """
    aim = _aim(photographs, cameras)
    slot = np.full(len(photographs), -1, dtype=np.int64)
    slot[aim.photograph] = np.arange(len(aim.photograph))
    pair = slot[np.array(pairs, dtype=np.int64).reshape(-1, 2)]
    known = (pair >= 0).all(axis=1)
    overlap = np.full(len(pair), np.nan)
    overlap[known] = _aimed_overlap(aim, pair[known])
    return overlap


# ---- choice of partners ----------------------------------------------------------------------------------------------


def _unique(pair: IntArray) -> IntArray:
    """Return pairs (P, 2), each once, smaller index first, sorted."""
    base = int(pair.max(initial=0)) + 1
    code = np.unique(pair.min(axis=1, initial=base) * base + pair.max(axis=1, initial=0))
    return np.column_stack([code // base, code % base]).astype(np.int64)


def _nearest(place_m: FloatArray, rows: IntArray, count: int) -> tuple[IntArray, FloatArray]:
    """Return edges (E, 2) from each place of ``rows`` to its nearest ``count`` others, and their lengths (E,)."""
    if len(place_m) < 2:
        return np.zeros((0, 2), dtype=np.int64), np.zeros(0)
    k = min(count + 1, len(place_m))
    distance, other = cKDTree(place_m).query(place_m[rows], k=range(1, k + 1))
    edge = np.column_stack([np.repeat(rows, k), np.asarray(other).ravel()]).astype(np.int64)
    real = edge[:, 0] != edge[:, 1]
    return edge[real], np.asarray(distance, dtype=np.float64).ravel()[real]


def _sector(step_m: FloatArray) -> IntArray:
    """Return the direction of steps (E, 3): 0 to 7 by azimuth, 8 above, 9 below."""
    plan = np.hypot(step_m[:, 0], step_m[:, 1])
    octant = np.floor((np.arctan2(step_m[:, 1], step_m[:, 0]) / np.pi + 1.0) * 4.0).astype(np.int64) % 8
    return np.where(np.abs(step_m[:, 2]) <= plan, octant, np.where(step_m[:, 2] > 0, 8, 9))


def _rank(group: IntArray, cost: FloatArray, other: IntArray) -> IntArray:
    """Return the place (E,) of each edge within its group, least cost first."""
    order = np.lexsort((other, cost, group))
    starts = np.searchsorted(group[order], group[order])
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order)) - starts
    return rank


def _all_around(edge: IntArray, cost: FloatArray, sector: IntArray, wide: BoolArray, count: int) -> BoolArray:
    """Return which edges (E, 2) a photograph takes: ``count`` at most, the best of every sector first, then the best.

    Only edges of the mask ``wide`` may represent a sector.
    """
    far = np.where(wide, cost, inf)
    head = wide & (_rank(edge[:, 0] * _SECTORS + sector, far, edge[:, 1]) == 0)
    heads = np.bincount(edge[head, 0], minlength=int(edge.max(initial=-1)) + 1)[edge[:, 0]]
    rank = _rank(edge[:, 0] * 2 + ~head, cost, edge[:, 1])
    return np.asarray(np.where(head, rank, heads + rank) < count)


def _by_footprint(aim: _Aim, settings: PairSettings) -> IntArray:
    """Return pairs (P, 2) of photographs whose predicted footprints overlap."""
    centre = aim.centre_m
    pair = _unique(_nearest(centre, np.arange(len(centre)), _SURROUNDINGS * settings.maximum)[0])
    overlap = _aimed_overlap(aim, pair)
    enough = overlap >= settings.footprint_overlap
    pair, overlap = pair[enough], overlap[enough]
    edge, cost = np.vstack([pair, pair[:, ::-1]]), -np.concatenate([overlap, overlap])
    step = np.column_stack([centre[edge[:, 1]] - centre[edge[:, 0]], np.zeros(len(edge))])
    taken = _all_around(edge, cost, _sector(step), np.ones(len(edge), dtype=bool), settings.maximum)
    return aim.photograph[edge[taken]]


def footprint_pairs(photographs: Sequence[Photograph], cameras: Sequence[Camera], settings: PairSettings) -> IntArray:
    """Return the pairs (P, 2) that select_pairs takes by footprint, smaller number first, sorted. Raises ImageError
    where a distortion cannot be undone."""
    return _unique(_by_footprint(_aim(photographs, cameras), settings))


def _near_limit_m(photographs: Sequence[Photograph], located: IntArray, position_m: FloatArray) -> FloatArray:
    """Return how far (L,) from each located photograph another one of the same site may be."""
    _, distance = _nearest(position_m, np.arange(len(located)), 1)
    spacing = float(np.median(distance)) if len(distance) else 0.0
    limit = float(np.clip(_NEAR_SPACINGS * spacing, *_NEAR_M))
    height = np.array([photographs[i].height_above_ground_m or inf for i in located], dtype=np.float64)
    return np.minimum(limit, np.where(height > 0, np.maximum(_NEAR_HEIGHTS * height, 5.0 * spacing), inf))


def _by_neighbourhood(position_m: FloatArray, limit_m: FloatArray, rows: IntArray, count: int) -> IntArray:
    """Return pairs (P, 2) of places: each of ``rows`` with its nearest, some in every direction."""
    edge, distance = _nearest(position_m, rows, _SURROUNDINGS * count)
    near = distance <= limit_m[edge[:, 0]]
    edge, distance = edge[near], distance[near]
    rank = _rank(edge[:, 0], distance, edge[:, 1])
    reach = np.zeros(len(position_m))
    np.maximum.at(reach, edge[rank < count, 0], distance[rank < count])
    wide = distance <= _SECTOR_REACH * reach[edge[:, 0]]
    step = position_m[edge[:, 1]] - position_m[edge[:, 0]]
    return edge[_all_around(edge, distance, _sector(step), wide, count)]


# ---- pieces joined ---------------------------------------------------------------------------------------------------


def _pieces(count: int, pair: IntArray) -> IntArray:
    """Return the connected piece (N,) of the graph of pairs (P, 2) to which each photograph belongs."""
    graph = coo_matrix((np.ones(len(pair), dtype=np.int8), (pair[:, 0], pair[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _links(position_m: FloatArray, limit_m: FloatArray, pair: IntArray) -> IntArray:
    """Return the pairs (P, 2) that join pieces near each other: round by round, each piece with its nearest one
    (Borůvka 1926)."""
    links = [np.zeros((0, 2), dtype=np.int64)]
    while True:
        piece = _pieces(len(position_m), np.vstack([pair, *links]))
        new = []
        for p in range(int(piece.max(initial=-1)) + 1 if piece.any() else 0):
            own, others = np.flatnonzero(piece == p), np.flatnonzero(piece != p)
            distance, at = map(np.asarray, cKDTree(position_m[own]).query(position_m[others]))
            best = np.argsort(distance, kind="stable")[:_LINKS]
            link = np.column_stack([own[at[best]], others[best]])
            new.append(link[distance[best] <= limit_m[link].max(axis=1)])
        if not any(len(link) for link in new):
            return np.vstack(links)
        links += new


def _similar_links(count: int, pair: IntArray, similar: IntArray, rows: IntArray, columns: range) -> IntArray:
    """Return pairs (P, 2) from further columns of ``similar`` that join pieces of the graph, column by column."""
    links = [np.zeros((0, 2), dtype=np.int64)]
    for column in columns:
        piece = _pieces(count, np.vstack([pair, *links]))
        edge = np.column_stack([rows, similar[rows, column]])
        edge = edge[edge[:, 1] >= 0]
        edge = edge[piece[edge[:, 0]] != piece[edge[:, 1]]]
        first = _rank(piece[edge[:, 0]], np.zeros(len(edge)), edge[:, 0]) < _LINKS
        links.append(edge[first])
    return np.vstack(links)


# ---- all together ----------------------------------------------------------------------------------------------------


def _by_similarity(
    photographs: Sequence[Photograph], lost: IntArray, pair: IntArray, settings: PairSettings, similar: IntArray | None
) -> tuple[IntArray, Reason]:
    """Return pairs (P, 2) for the photographs of unknown position ``lost``, and their reason."""
    n = len(photographs)
    if similar is None:
        if n > _EXHAUSTIVE:
            names = ", ".join(photographs[i].name for i in lost[:3]) + (", …" if len(lost) > 3 else "")
            raise OrientationError(
                f"{len(lost)} of {n} photographs have no position ({names}), so their neighbours are unknown: "
                "give their positions (photographs.list, gnss_m), or use image retrieval"
            )
        every = np.column_stack([np.repeat(lost, n), np.tile(np.arange(n), len(lost))])
        return every[every[:, 0] != every[:, 1]], "exhaustive"
    check_shape("similar", similar, (n, None))
    if similar.max(initial=-1) >= n:
        raise ValueError(f"similar: photograph {similar.max()} of {n}")
    k = min(settings.retrieved, similar.shape[1])
    edge = np.column_stack([np.repeat(lost, k), similar[lost, :k].ravel()]).astype(np.int64)
    edge = edge[(edge[:, 1] >= 0) & (edge[:, 0] != edge[:, 1])]
    further = _similar_links(n, np.vstack([pair, edge]), similar, lost, range(k, similar.shape[1]))
    return np.vstack([edge, further]), "retrieval"


def select_pairs(
    photographs: Sequence[Photograph], cameras: Sequence[Camera], settings: PairSettings, *, similar: IntArray | None
) -> SelectedPairs:
    """Select the pairs of photographs to match; their number grows linearly with the number of photographs.

    - position, flying height and attitude known ("footprint"): up to ``maximum`` partners per photograph whose
      predicted_overlap is at least ``footprint_overlap``, the best of each octant of azimuth first;
    - position alone ("neighbour"): the nearest ``neighbours``, the nearest of each octant, above and below first;
      so too photographs with fewer than three predicted partners. Pieces of one site that are left apart are joined
      by their nearest photographs; sites far apart (30 times the usual spacing, 10 flying heights) are not;
    - no position ("retrieval"): the first ``retrieved`` of ``similar`` (N, K), indices of the most similar photographs,
      best first, −1 where there are fewer; columns beyond join pieces of the block. Without ``similar``, up to 30
      photographs are matched all with all ("exhaustive").

    A pair that has several reasons is given the first of them. Raises OrientationError where positions are missing and
    nothing stands in for them, ImageError where a camera's distortion cannot be undone.
    """
    n = len(photographs)
    by_reason: list[tuple[Reason, IntArray]] = []
    aim = _aim(photographs, cameras)
    by_reason.append(("footprint", _unique(_by_footprint(aim, settings))))
    located = np.array([i for i, p in enumerate(photographs) if p.gnss_world_m is not None], dtype=np.int64)
    position = np.array([photographs[i].gnss_world_m for i in located], dtype=np.float64).reshape(-1, 3)
    limit = _near_limit_m(photographs, located, position)
    partners = np.bincount(by_reason[0][1].ravel(), minlength=n)[located]
    predicted = np.isin(located, aim.photograph) & (partners >= _FEW)
    near = _by_neighbourhood(position, limit, np.flatnonzero(~predicted), settings.neighbours)
    inner = np.searchsorted(located, by_reason[0][1])
    near = np.vstack([near, _links(position, limit, np.vstack([inner, near]))])
    by_reason.append(("neighbour", located[near]))
    lost = np.setdiff1d(np.arange(n), located)
    if len(lost):
        known = np.vstack([pair for _, pair in by_reason])
        pair, reason = _by_similarity(photographs, lost, known, settings, similar)
        by_reason.append((reason, pair))
    reasons: dict[tuple[int, int], Reason] = {}
    for reason, pair in reversed(by_reason):
        reasons.update(dict.fromkeys(map(tuple, np.sort(pair, axis=1).tolist()), reason))
    pairs = sorted(reasons)
    return SelectedPairs(tuple(pairs), tuple(reasons[p] for p in pairs))
