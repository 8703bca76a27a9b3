"""What a unit of work costs, stage by stage, on the machine where the rates were measured, and what a survey costs by
them.

Seconds are those of one worker: work in pieces (photographs, pairs, blocks, tiles) is shared among the workers, the
rest is not. Each rate is scaled by the part of the self-test that resembles it. `benchmarks/predicted_costs.py` prints
what they predict beside what surveys of several sizes take.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from photogram.pipeline.costs.self_test import Speed
from photogram.pipeline.costs.workload import Workload
from photogram.pipeline.stage_names import STAGE_NAMES

Part = Literal[
    "photographs", "megapixels", "searched_megapixels", "products", "pairs", "key_points", "observations",
    "dense_mcells", "raster_mcells", "contoured_mcells", "terrain_mcells", "orthophoto_mpx", "comparison",
]  # fmt: skip
Kind = Literal["features", "matches", "dense", "plain"]


@dataclass(frozen=True)
class Rate:
    """Seconds of one worker for a unit of a part of the work; ``pieces`` says whether workers share it."""

    stage: str
    part: Part
    seconds: float
    kind: Kind = "plain"
    pieces: bool = True


RATES = (
    Rate("photographs", "megapixels", 0.012),
    Rate("features", "searched_megapixels", 0.45, "features"),
    Rate("features", "megapixels", 0.02),
    Rate("pairs", "products", 0.04, "matches"),
    Rate("pairs", "photographs", 0.002, pieces=False),
    Rate("matches", "products", 0.22, "matches"),
    Rate("matches", "pairs", 0.02),
    Rate("tie_points", "key_points", 5e-7, pieces=False),
    Rate("orientation", "photographs", 0.01, pieces=False),
    Rate("orientation", "observations", 3e-5, pieces=False),
    Rate("transfer", "megapixels", 0.025),
    Rate("transfer", "observations", 5e-5),
    Rate("intersection", "observations", 2e-6, pieces=False),
    Rate("adjustment", "observations", 1.3e-4, pieces=False),
    Rate("adjustment", "photographs", 0.03, pieces=False),
    Rate("dense", "megapixels", 0.03),
    Rate("dense", "dense_mcells", 22.0, "dense"),
    Rate("surface", "raster_mcells", 1.4),
    Rate("relief", "contoured_mcells", 0.15, pieces=False),
    Rate("relief", "terrain_mcells", 1.5, pieces=False),
    Rate("orthophoto", "orthophoto_mpx", 1.5),
    Rate("orthophoto", "megapixels", 0.02),
    Rate("comparison", "comparison", 0.5, pieces=False),
    Rate("comparison", "observations", 1e-5, pieces=False),
    Rate("results", "photographs", 0.13, pieces=False),
    Rate("results", "raster_mcells", 0.9, pieces=False),
    Rate("results", "observations", 5e-5, pieces=False),
)
"""Seconds on the reference machine, measured on simulated surveys of 6 to 32 photographs of 0.5 to 2.4 megapixels and
on a real one of 18 of 9. `products`: of two descriptors, 10⁸ of them.

A million cells of the surface take 11 s of one worker on simulated ground, which has texture everywhere, and 65 s over
a beach with trees and water, where every level searches widely: what stands here is between the two.
"""

CONSTANT_S: Mapping[str, float] = {
    "photographs": 0.05, "features": 0.05, "pairs": 0.02, "matches": 0.02, "tie_points": 0.02, "orientation": 0.1,
    "transfer": 0.02, "intersection": 0.03, "adjustment": 0.3, "dense": 0.1, "surface": 0.15, "relief": 0.05,
    "orthophoto": 0.2, "comparison": 0.0, "results": 7.0,
}  # fmt: skip
"""Seconds of a stage whatever the survey: the report draws its figures, kernels are loaded."""

COMPILATION_S: Mapping[str, tuple[float, tuple[str, ...]]] = {
    "pairs": (0.6, ("photogram.sfm.tie_points.pairs", "photogram.sfm.tie_points.matching")),
    "orientation": (12.0, ("photogram.triangulation", "photogram.projection")),
    "transfer": (2.6, ("photogram.sfm.tie_points.guided_matching",)),
    "adjustment": (1.0, ("photogram.factors",)),
    "dense": (23.0, ("photogram.surface.dense",)),
    "surface": (3.5, ("photogram.surface.dsm", "photogram.surface.islands", "photogram.surface.levels")),
    "orthophoto": (1.5, ("photogram.surface.ortho",)),
}
"""Seconds that a first run on a machine spends compiling kernels in a stage, and the modules of these kernels. Where
there are two cores another process compiles most of adjustment and orthophoto meanwhile; on one they take 15 and 20 s
more."""


def amounts(work: Workload) -> dict[Part, float]:
    """Return how much there is of each part of the work."""
    products = work.pairs * (work.key_points / max(work.photographs, 1)) ** 2 / 1e8
    found: dict[Part, float] = {
        "photographs": work.photographs,
        "megapixels": work.megapixels,
        "searched_megapixels": work.searched_megapixels,
        "products": products,
        "pairs": work.pairs,
        "key_points": work.key_points,
        "observations": work.observations,
        "dense_mcells": work.dense_mcells,
        "raster_mcells": work.raster_mcells,
        "contoured_mcells": work.raster_mcells if work.contours else 0.0,
        "terrain_mcells": work.raster_mcells if work.terrain else 0.0,
        "orthophoto_mpx": work.orthophoto_mpx,
        "comparison": float(work.comparison),
    }
    if set(found) != set(get_args(Part)):
        raise AssertionError("an amount for each part")
    return found


def _asked_for(stage: str, work: Workload) -> bool:
    """Return whether a stage has anything to do."""
    asked = {
        "dense": work.dense_mcells > 0,
        "relief": work.contours or work.terrain,
        "orthophoto": work.orthophoto_mpx > 0,
        "comparison": work.comparison,
    }
    return asked.get(stage, True)


def predicted_seconds(work: Workload, speed: Speed, workers: int) -> dict[str, float]:
    """Return how long each stage takes with so many workers once its kernels are compiled, 0 for what is not asked
    for."""
    amount = amounts(work)
    seconds = {stage: CONSTANT_S[stage] * speed.plain for stage in STAGE_NAMES}
    for rate in RATES:
        share = workers if rate.pieces else 1
        seconds[rate.stage] += rate.seconds * amount[rate.part] * getattr(speed, rate.kind) / share
    return {stage: took if _asked_for(stage, work) else 0.0 for stage, took in seconds.items()}


def compilation_seconds(work: Workload, compiled: Mapping[str, float], speed: Speed) -> dict[str, float]:
    """Return how long each stage compiles kernels; ``compiled`` is the share of each stage's that are compiled."""
    return {
        stage: whole * (1.0 - compiled[stage]) * speed.plain
        for stage, (whole, _) in COMPILATION_S.items()
        if _asked_for(stage, work)
    }
