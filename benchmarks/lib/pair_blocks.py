"""Blocks of photographs whose flying heights in the tags are wrong, and which of their pairs share ground in truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from photogram.arrays import BoolArray
from photogram.camera import Camera, rotation_from_gimbal
from photogram.sfm.tie_points.ground_depth import with_ground_depth
from photogram.sfm.tie_points.pairs import PairSettings, SelectedPairs, select_pairs
from photogram.survey import Photograph

WIDE = Camera("wide", 5472, 3648, 3670.0, np.array([2735.5, 1823.5]))
NARROW = Camera("narrow", 5472, 3648, 7000.0, np.array([2735.5, 1823.5]))
SETTINGS = PairSettings()
HEIGHT_M = 100.0

SHARED, MOST_TURNED_DEG = 0.07, 45.0
"""Two photographs are verified where they share this part of their pictures, seen under directions less different."""

GROUND_POINTS = 1500


@dataclass(frozen=True)
class Flown:
    """Photographs by one camera with right flying heights, and the strip (N,) of each."""

    camera: Camera
    photographs: tuple[Photograph, ...]
    strip: tuple[int, ...]

    def __add__(self, other: Flown) -> Flown:
        first = max(self.strip) + 1
        return Flown(
            self.camera, self.photographs + other.photographs, self.strip + tuple(first + s for s in other.strip)
        )


def strips(
    count: int, each: int, forward: float, side: float, *, camera: Camera = WIDE, height_m: float = HEIGHT_M,
    pitch_deg: float = -90.0, turned_deg: float = 0.0, seed: int = 1,
) -> Flown:  # fmt: skip
    """Fly strips to and fro around the origin, with consumer GNSS and attitudes good to 2°."""
    width, length = (n * height_m / camera.focal_px for n in (camera.width_px, camera.height_px))
    rng, turn = np.random.default_rng(seed), np.radians(turned_deg)
    place = np.stack(np.meshgrid(np.arange(each), np.arange(count)), axis=-1)[..., ::-1].reshape(-1, 2)
    plan = (place - [(count - 1) / 2, (each - 1) / 2]) * [(1 - side) * width, (1 - forward) * length]
    plan = (plan + rng.normal(0, 0.01 * height_m, plan.shape)) @ np.array(
        [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    )
    photographs = tuple(
        Photograph(
            f"{turned_deg:.0f} {height_m:.0f} {pitch_deg:.0f} {s:02d} {k:03d}", 0,
            gnss_world_m=np.array([*plan[n], height_m]), gnss_sigma_m=np.array([2.0, 2.0, 3.0]),
            attitude_world_from_camera=rotation_from_gimbal(180.0 * (s % 2) - turned_deg, pitch_deg, 0.0),
            attitude_sigma_rad=np.radians(2.0), height_above_ground_m=height_m,
        )
        for n, (s, k) in enumerate(place.tolist())
    )  # fmt: skip
    return Flown(camera, photographs, tuple(place[:, 0].tolist()))


BLOCKS: dict[str, Callable[[], Flown]] = {
    "75/60": lambda: strips(6, 12, 0.75, 0.6),
    "wide, 80/70": lambda: strips(12, 12, 0.8, 0.7),
    "dense, 85/80": lambda: strips(12, 16, 0.85, 0.8),
    "long, 80/60": lambda: strips(3, 40, 0.8, 0.6),
    "low overlap, 60/25": lambda: strips(6, 10, 0.6, 0.25, camera=NARROW),
    "oblique 30°, 75/60": lambda: strips(6, 10, 0.75, 0.6, pitch_deg=-60.0),
    "oblique 45°, 75/60": lambda: strips(6, 10, 0.75, 0.6, pitch_deg=-45.0),
    "nadir and oblique": lambda: (
        strips(6, 10, 0.75, 0.6) + strips(6, 10, 0.75, 0.6, pitch_deg=-55.0, turned_deg=90.0, seed=2)
    ),
    "two heights": lambda: strips(5, 10, 0.75, 0.6) + strips(4, 8, 0.75, 0.6, height_m=160.0, turned_deg=90.0, seed=2),
    "crosshatch": lambda: strips(6, 10, 0.75, 0.6) + strips(6, 10, 0.75, 0.6, turned_deg=90.0, seed=2),
}


def sharing(flown: Flown) -> BoolArray:
    """Return which photographs (N, N) are verified with which: those that truly show the same ground, with relief, seen
    from directions not too different."""
    rng, camera = np.random.default_rng(0), flown.camera
    centre = np.array([p.gnss_world_m for p in flown.photographs])
    low, high = centre[:, :2].min(axis=0) - 2 * HEIGHT_M, centre[:, :2].max(axis=0) + 2 * HEIGHT_M
    ground = np.column_stack([rng.uniform(low, high, (GROUND_POINTS, 2)), rng.normal(0, 3, GROUND_POINTS)])
    rotation = np.array([p.attitude_world_from_camera for p in flown.photographs])
    ray = ground - centre[:, None]
    local = np.einsum("ngi,nij->ngj", ray, rotation)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = (np.abs(camera.focal_px * local[..., k] / local[..., 2]) for k in (0, 1))
    seen = (local[..., 2] > 0) & (u < camera.width_px / 2) & (v < camera.height_px / 2)
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    limit, count = np.cos(np.radians(MOST_TURNED_DEG)), seen.sum(axis=1)
    found = np.zeros((len(centre), len(centre)), dtype=bool)
    for i in range(len(centre)):
        own = np.flatnonzero(seen[i])
        alike = np.einsum("gk,jgk->jg", ray[i, own], ray[:, own]) > limit
        found[i] = (seen[:, own] & alike).sum(axis=1) >= SHARED * np.sqrt(count[i] * count)
    return found & found.T


@dataclass(frozen=True)
class Selected:
    """What is selected with wrong flying heights: pairs, those of them between strips that are verified, and the pairs
    that were matched to find the depth of the ground."""

    pairs: SelectedPairs
    verified_across: int
    probed: int


def selected(flown: Flown, truth: BoolArray, factor: float, *, probing: bool = True) -> Selected:
    """Select pairs with flying heights of ``factor`` times the truth."""
    tagged = [replace(p, height_above_ground_m=factor * (p.height_above_ground_m or 0.0)) for p in flown.photographs]
    found = select_pairs(tagged, [flown.camera], SETTINGS, similar=None)
    probed: list[tuple[int, int]] = []

    def verify(pairs: Sequence[tuple[int, int]]) -> list[bool]:
        probed.extend(pairs)
        return [bool(truth[i, j]) for i, j in pairs]

    if probing:
        found = with_ground_depth(tagged, [flown.camera], SETTINGS, found, verify)
    first, second = np.array(found.pairs).T
    strip = np.array(flown.strip)
    across = truth[first, second] & (strip[first] != strip[second])
    return Selected(found, int(across.sum()), len(probed))
