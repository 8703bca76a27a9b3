"""What a survey costs in time by the rates that its stages state, on the machine where these were measured or another.

Seconds are those of one worker: work in pieces (photographs, pairs, blocks, tiles) is shared among the workers, the
rest is not. Each rate is scaled by the part of the self-test that resembles it. `benchmarks/predicted_costs.py` prints
what they predict beside what surveys of several sizes take.

The rates of the stages were measured on simulated surveys of 6 to 32 photographs of 0.5 to 2.4 megapixels and on a real
one of 18 of 9. A million cells of the surface take 11 s of one worker on simulated ground, which has texture
everywhere, and 65 s over a beach with trees and water, where every level searches widely: the rate is between the two.
Where there are two cores another process compiles most kernels of adjustment and orthophoto while the first stages
work; on one these take 15 and 20 s more than is stated.
"""

from collections.abc import Mapping, Sequence
from typing import get_args

from photogram.pipeline.costs.self_test import Speed
from photogram.pipeline.stage import Stage
from photogram.pipeline.stage_costs import Part, Workload


def amounts(work: Workload) -> dict[Part, float]:
    """Return how much there is of each part of the work; of search and comparisons the seconds that detector and
    matcher state."""
    products = work.pairs * (work.key_points / max(work.photographs, 1)) ** 2 / 1e8
    found: dict[Part, float] = {
        "photographs": work.photographs,
        "megapixels": work.megapixels,
        "search": work.search_s_per_mpx * work.searched_megapixels,
        "comparisons": work.match_s_per_product * products,
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


def predicted_seconds(stages: Sequence[Stage], work: Workload, speed: Speed, workers: int) -> dict[str, float]:
    """Return how long each stage takes with so many workers once its kernels are compiled."""
    amount, seconds = amounts(work), dict[str, float]()
    for stage in stages:
        took = stage.costs.constant_s * speed.plain
        for rate in stage.costs.rates:
            took += rate.seconds * amount[rate.part] * getattr(speed, rate.kind) / (workers if rate.pieces else 1)
        seconds[stage.name] = took
    return seconds


def compilation_seconds(stages: Sequence[Stage], compiled: Mapping[str, float], speed: Speed) -> dict[str, float]:
    """Return how long each stage compiles kernels; ``compiled`` is the share of each stage's that are compiled."""
    return {s.name: s.costs.compilation_s * (1.0 - compiled[s.name]) * speed.plain for s in stages}
