"""Growth of a block from tie points alone: a seed pair, then photograph by photograph.

A pair with many points and wide ray angles starts the structure; the photographs that see most of it, best spread,
are resected by P3P and RANSAC on its tie points; new tie points are intersected; the neighbourhood is adjusted after
every step and the whole whenever the block has grown by a quarter (Snavely et al. 2008; Schönberger & Frahm 2016).
What cannot be joined starts a component of its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.sparse import csr_matrix, triu

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera, Pose
from photogram.sfm.reconstruction import Structure, StructureSettings
from photogram.sfm.relative_orientation import RelativeOrientation, relative_orientations
from photogram.survey import TiePoints
from photogram.wording import Progress, silent

GLOBAL_EVERY = 1.25
WAVE_SHARE = 0.25  # of the block, that may be added at once
WAVE_SCORE = 0.6  # of the best score, from which a photograph is added in the same step
SEED_PAIRS = 16
SEED_TRIALS = 4
SEED_POINTS = 1500
GOOD_ANGLE_RAD = float(np.deg2rad(8.0))
RETRY_GAIN = 1.3


def shared_points(tie_points: TiePoints, photographs: int) -> csr_matrix:
    """Return how many tie points each pair of photographs shares (N, N), above the diagonal."""
    ones = np.ones(len(tie_points.point), dtype=np.int32)
    incidence = csr_matrix((ones, (tie_points.photograph, tie_points.point)), shape=(photographs, len(tie_points)))
    return csr_matrix(triu(incidence @ incidence.T, 1))


@dataclass(frozen=True, eq=False)
class SeedPair:
    """Two photographs a block may start from, with the relative orientations that their points allow."""

    first: int
    second: int
    orientations: list[RelativeOrientation]

    @property
    def quality(self) -> float:
        """Return how good a start this is: points, less where their rays are nearly parallel."""
        best = self.orientations[0]
        return float(best.inliers.sum()) * min(1.0, best.ray_angle_rad / GOOD_ANGLE_RAD)


def _common(structure: Structure, first: int, second: int) -> tuple[IntArray, IntArray]:
    """Return the observations of two photographs that show the same tie points."""
    tie = structure.tie_points
    a, b = structure.observations_of(first), structure.observations_of(second)
    _, i, j = np.intersect1d(tie.point[a], tie.point[b], assume_unique=True, return_indices=True)
    return a[i], b[j]


def seed_pairs(structure: Structure, shared: csr_matrix, candidates: BoolArray) -> list[SeedPair]:
    """Return pairs of the photographs ``candidates`` (N,) that a component may start from, best first."""
    pairs = shared.tocoo()
    usable = candidates[pairs.row] & candidates[pairs.col] & (pairs.data >= structure.settings.minimum_points)
    order = np.argsort(-pairs.data[usable], kind="stable")
    rows, columns = pairs.row[usable][order], pairs.col[usable][order]
    # the pairs with most points are those with the shortest base: take some from further down too
    step = max(1, len(order) // (4 * SEED_PAIRS))
    chosen = np.unique(np.concatenate([np.arange(len(order))[: SEED_PAIRS // 2], np.arange(0, len(order), step)]))
    seeds = []
    for k in chosen[:SEED_PAIRS].tolist():
        a, b = _common(structure, int(rows[k]), int(columns[k]))
        thin = max(1, len(a) // SEED_POINTS)
        focal = structure.parameters[structure.camera_of[[rows[k], columns[k]]], 0].min()
        orientations = relative_orientations(
            structure.ideal(a[::thin]), structure.ideal(b[::thin]), structure.settings.threshold_px / float(focal)
        )
        if orientations and orientations[0].inliers.sum() * thin >= structure.settings.minimum_points:
            seeds.append(SeedPair(int(rows[k]), int(columns[k]), orientations))
    return sorted(seeds, key=lambda pair: (-pair.quality, pair.first, pair.second))


def _started(empty: Callable[[], Structure], pair: SeedPair) -> list[Structure]:
    """Return the structures that a pair may start, the best fitting first."""
    started = []
    for orientation in pair.orientations:
        structure = empty()
        structure.register(pair.first, Pose(np.eye(3), np.zeros(3)))
        R = orientation.rotation
        structure.register(pair.second, Pose(np.ascontiguousarray(R.T), -R.T @ orientation.translation))
        structure.intersect()
        if structure.known.sum() < structure.settings.minimum_points:
            continue
        structure.adjust()
        structure.judge()
        points = int(structure.known.sum())
        if points >= structure.settings.minimum_points:
            error = structure.residual_px(structure.good)
            started.append((-points, float(np.median(error)), structure))
    most = min((s[0] for s in started), default=0)
    alike = [s for s in started if s[0] <= 0.8 * most]
    return [s[2] for s in sorted(alike, key=lambda s: (s[1], s[0]))]


def _spread(structure: Structure, photographs: IntArray) -> FloatArray:
    """Return for each of ``photographs`` (K,) how well its visible points cover it: occupied cells of grids of 4, 8 and
    16 cells a side, a cell counting as many times as its grid has cells a side."""
    tie = structure.tie_points
    rank = np.full(len(structure.camera_of), -1, dtype=np.int64)
    rank[photographs] = np.arange(len(photographs))
    seen = np.flatnonzero(structure.known[tie.point] & (rank[tie.photograph] >= 0))
    size = np.array([[c.width_px, c.height_px] for c in structure.cameras])[structure.camera_of[tie.photograph[seen]]]
    score = np.zeros(len(photographs))
    for cells in (4, 8, 16):
        cell = np.clip((tie.pixel[seen] / size * cells).astype(np.int64), 0, cells - 1)
        occupied = np.unique((rank[tie.photograph[seen]] * cells + cell[:, 0]) * cells + cell[:, 1])
        score += cells * np.bincount(occupied // (cells * cells), minlength=len(photographs))
    return score


def _next_wave(structure: Structure, failed_at: IntArray, candidates: BoolArray) -> list[int]:
    """Return the photographs to resect next, those that see most of the structure, best spread, first."""
    visible = structure.visible
    open_ = candidates & ~structure.registered & (visible >= structure.settings.minimum_points)
    open_ &= visible > RETRY_GAIN * failed_at
    photographs = np.flatnonzero(open_)
    if not len(photographs):
        return []
    best = photographs[np.argsort(-visible[photographs], kind="stable")]
    limit = max(1, int(WAVE_SHARE * structure.registered.sum()))
    best = best[: max(12, 2 * limit)]
    score = _spread(structure, best)
    order = np.argsort(-score, kind="stable")
    return [int(p) for p in best[order][score[order] >= WAVE_SCORE * score.max()][:limit]]


def settle(structure: Structure, rounds: int = 2) -> None:
    """Adjust everything, judge every observation anew and intersect again what was lost."""
    for _ in range(rounds):
        structure.adjust()
        structure.judge()
        structure.intersect()


def _drop_weak(structure: Structure) -> BoolArray:
    """Withdraw photographs that fewer points than needed agree with; returns which."""
    weak = structure.registered & (structure.agreeing < structure.settings.minimum_points)
    if weak.any():
        structure.withdraw(weak)
    return weak


def extend(structure: Structure, candidates: BoolArray, progress: Progress) -> None:
    """Join to a structure whatever of the photographs ``candidates`` (N,) sees enough of it."""
    failed_at = np.zeros(len(structure.camera_of), dtype=np.int64)
    adjusted_at = int(structure.registered.sum())
    total = int(candidates.sum() + np.count_nonzero(structure.registered & ~candidates))
    while True:
        wave = _next_wave(structure, failed_at, candidates)
        if not wave:
            settle(structure)
            dropped = _drop_weak(structure)
            failed_at[dropped] = structure.visible[dropped]
            wave = _next_wave(structure, failed_at, candidates)
            if not wave:
                return
        visible = structure.visible
        added = np.zeros(len(structure.camera_of), dtype=bool)
        for photograph in wave:
            added[photograph] = structure.resect(photograph)
            if not added[photograph]:
                failed_at[photograph] = visible[photograph]
        if not added.any():
            continue
        structure.intersect(added)
        count = int(structure.registered.sum())
        if count >= GLOBAL_EVERY * adjusted_at:
            settle(structure, 1)
            adjusted_at = count
        else:
            active = structure.neighbours(added)
            structure.adjust(active, iterations=6)
            structure.judge(photographs=active)
        progress(count, total, "oriented")


def grow_component(
    empty: Callable[[], Structure], candidates: BoolArray, shared: csr_matrix, progress: Progress
) -> Structure | None:
    """Grow the largest block that a seed pair of the photographs ``candidates`` (N,) leads to, in a structure that
    ``empty`` makes; None without a seed.

    A seed is accepted when a third photograph agrees with it, or there is none that could.
    """
    fallback: Structure | None = None
    for pair in seed_pairs(empty(), shared, candidates)[:SEED_TRIALS]:
        for structure in _started(empty, pair):
            extend(structure, candidates, progress)
            if structure.registered.sum() > 2:
                return structure
            if fallback is None and structure.registered.any():
                fallback = structure
    return fallback


def grow(
    tie_points: TiePoints,
    cameras: Sequence[Camera],
    camera_of: IntArray,
    settings: StructureSettings,
    progress: Progress = silent,
    *,
    candidates: BoolArray | None = None,
) -> list[Structure]:
    """Orient photographs from their tie points alone; each component in a frame and scale of its own, largest first.

    ``camera_of`` (N,) is the camera of each photograph. Photographs that nothing can be joined to are in no component.
    Only those of ``candidates`` (N,) are oriented, where they are given.
    """
    empty = partial(Structure.empty, tie_points, cameras, camera_of, settings)
    shared = shared_points(tie_points, len(camera_of))
    left = np.ones(len(camera_of), dtype=bool) if candidates is None else candidates.copy()
    components: list[Structure] = []
    while left.sum() >= 2:
        structure = grow_component(empty, left, shared, progress)
        if structure is None or structure.registered.sum() < 2:
            break
        components.append(structure)
        left &= ~structure.registered
    return sorted(components, key=lambda s: -int(s.registered.sum()))
