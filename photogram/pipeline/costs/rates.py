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

from photogram.pipeline.costs.self_test import Speed
from photogram.pipeline.stage import Stage
from photogram.pipeline.stage_costs import Workload


def predicted_seconds(stages: Sequence[Stage], work: Workload, speed: Speed, workers: int) -> dict[str, float]:
    """Return how long each stage takes with so many workers once its kernels are compiled."""
    seconds = dict[str, float]()
    for stage in stages:
        took = stage.costs.constant_s * speed.plain
        for rate in stage.costs.rates:
            amount, slower = getattr(work, rate.part), getattr(speed, rate.kind)
            took += rate.seconds * amount * slower / (workers if rate.pieces else 1)
        seconds[stage.name] = took
    return seconds


def compilation_seconds(stages: Sequence[Stage], compiled: Mapping[str, float], speed: Speed) -> dict[str, float]:
    """Return how long each stage compiles kernels; ``compiled`` is the share of each stage's that are compiled."""
    return {s.name: s.costs.compilation_s * (1.0 - compiled[s.name]) * speed.plain for s in stages}
