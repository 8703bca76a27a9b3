"""How fast this machine is, now: a short test of what costs most, as many at once as will work at once.

What is timed is the code of the stages itself on small pictures made for it, so that a faster machine, a busy one and a
faster program all show: the search for key points, the comparison of two photographs' descriptors, and the matching of
a piece of flat ground in six photographs. Beside them, for everything else, a plain piece of array work. Each runs once
before it is timed, on every worker, and the fastest of some rounds counts, for a moment's other work is no property of
the machine. What was not compiled before is not tested, for that would take longer than the test: it is taken to be as
fast as the plain piece.
"""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from photogram.arrays import ByteArray
from photogram.camera import Camera, Pose, oriented_by, rotation_from_gimbal
from photogram.compilation import kernels
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid, Window
from photogram.machine import cores
from photogram.sfm.tie_points.detector import FeatureSettings
from photogram.sfm.tie_points.features import find_features
from photogram.sfm.tie_points.matching import MatchingSettings, candidate_matches
from photogram.surface.dense.pyramid import STEP_PX, Level, Prior
from photogram.surface.dense.tile_matching import MARGIN_CELLS, DenseSettings, Scene, match_block
from photogram.surface.views import Views
from photogram.survey import Features

DENSE_ROOMS = ("photogram.surface.dense", "photogram.projection")

PICTURE_PX, PLAIN_PX = 512, 2048
DESCRIPTORS, CELLS = 2500, 128
GSD_M, FLYING_M = 0.1, 60.0
BASE_PX = 96
LEAST_ROUNDS, LEAST_SECONDS = 2, 0.5
LIMITS = (0.1, 10.0)
"""What a machine may differ from the reference by; beyond it something else than the machine was measured."""

REFERENCE_S = {"plain": 0.038, "features": 0.2, "matches": 0.025, "dense": 0.08}
"""Seconds of each test on the machine where the rates were measured: two cores, both at work."""


@dataclass(frozen=True)
class Speed:
    """How much longer than the reference this machine takes: for key points, for a comparison of descriptors, for
    matched heights, and for everything else."""

    features: float = 1.0
    matches: float = 1.0
    dense: float = 1.0
    plain: float = 1.0


def texture(side_px: int, seed: int) -> ByteArray:
    """Return a picture (side, side) of ground: noise at all scales, of 40 grey values."""
    rng = np.random.default_rng(seed)
    picture = np.zeros((side_px, side_px), np.float32)
    for octave in range(1, 7):
        part = rng.standard_normal((side_px // 2**octave + 2,) * 2).astype(np.float32)
        picture += octave**0.5 * cv2.resize(part, (side_px, side_px), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(128.0 + 20.0 * picture / picture.std(), 0, 255), dtype=np.uint8)


# ---- the tests -------------------------------------------------------------------------------------------------------


def _plain() -> Callable[[], object]:
    picture = texture(PLAIN_PX, 1).astype(np.float32)

    def work() -> object:
        smooth = cv2.GaussianBlur(picture, (0, 0), 3.0)
        return np.sort(np.sqrt(np.abs(smooth - picture)).ravel()[::4])

    return work


def _features() -> Callable[[], object]:
    pixels = np.repeat(texture(PICTURE_PX, 2)[..., None], 3, axis=2)
    settings = FeatureSettings(maximum=3000, doubled="yes")
    return lambda: find_features("self-test", pixels, settings)


def _matches() -> Callable[[], object]:
    rng = np.random.default_rng(3)
    n = DESCRIPTORS

    def features() -> Features:
        descriptor = rng.integers(0, 120, (n, 128)).astype(np.uint8)
        return Features(rng.random((n, 2)), np.full(n, 2.0), np.zeros(n), descriptor, np.zeros((n, 3), np.uint8))

    first, second = features(), features()
    second.descriptor[: n // 4] = first.descriptor[: n // 4]
    return lambda: candidate_matches(first, second, MatchingSettings())


def flat_ground() -> tuple[Scene, Level, Window, Prior]:
    """Return flat ground seen straight down by six photographs, and what matching it starts from: two steps of height
    on either side."""
    size = 2 * (CELLS + 2 * MARGIN_CELLS) + 2 * BASE_PX
    ground = texture(size + 4 * BASE_PX, 4)
    middle = (size - 1) / 2
    camera = Camera("self-test", size, size, FLYING_M / GSD_M, np.array([middle, middle]))
    down = rotation_from_gimbal(0.0, -90.0, 0.0)
    poses, pictures = list[Pose](), list[ByteArray]()
    for row in range(2):
        for column in range(3):
            u, v = (column + 0.5) * BASE_PX, (row + 1.0) * BASE_PX
            place = np.array([GSD_M * (u - 1.5 * BASE_PX), GSD_M * (1.5 * BASE_PX - v), FLYING_M])
            poses.append(Pose(down, place))
            pictures.append(np.ascontiguousarray(ground[int(v) : int(v) + size, int(u) : int(u) + size]))
    views = Views(np.arange(len(poses)), oriented_by((camera,), np.zeros(len(poses), np.int64), poses))
    step_m = STEP_PX * GSD_M / (BASE_PX * GSD_M / FLYING_M)
    outer = CELLS + 2 * MARGIN_CELLS
    grid = MapGrid(-GSD_M * outer, GSD_M * outer, 2 * GSD_M, outer, outer)
    level = Level(grid, 1, 0.5, step_m)
    flat = np.zeros((outer, outer), np.float32)
    prior = Prior(flat - np.float32(2 * step_m), flat + np.float32(2 * step_m), flat)
    window = Window(MARGIN_CELLS, MARGIN_CELLS, outer - MARGIN_CELLS, outer - MARGIN_CELLS)
    return Scene(LocalFrame.local(), views, lambda view, _: pictures[view]), level, window, prior


def _dense() -> Callable[[], object]:
    scene, level, window, prior = flat_ground()
    settings = DenseSettings()
    return lambda: match_block(scene, level, window, prior, settings)


# ---- how long they take ----------------------------------------------------------------------------------------------


def seconds_at_once(work: Callable[[], object], workers: int, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the seconds that ``work`` takes while as many workers do the same: the fastest round, after one that does
    not count, of at least LEAST_ROUNDS within LEAST_SECONDS."""
    took = list[float]()
    with ThreadPoolExecutor(workers) as pool, threadpool_limits(1, "blas"):
        while len(took) <= LEAST_ROUNDS or sum(took) < LEAST_SECONDS:
            began = clock()
            for done in [pool.submit(work) for _ in range(workers)]:
                done.result()
            took.append(clock() - began)
    return min(took[1:])


def measured_speed(workers: int | None = None) -> Speed:
    """Return how fast this machine is with so many workers at once, all its cores where none are given; takes two or
    three seconds."""
    count = workers or cores()
    ratio = {"plain": seconds_at_once(_plain(), count) / REFERENCE_S["plain"]}
    tests = {"features": _features, "matches": _matches}
    compiled, there = kernels(DENSE_ROOMS)
    if compiled == there:
        tests["dense"] = _dense
    for name, test in tests.items():
        ratio[name] = seconds_at_once(test(), count) / REFERENCE_S[name]
    low, high = LIMITS
    return Speed(**{name: min(max(r, low), high) for name, r in {"dense": ratio["plain"], **ratio}.items()})
