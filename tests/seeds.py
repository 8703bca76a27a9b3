"""Of how many seeds a statistic is made: few in `make test`, all with PHOTOGRAM_SEEDS=all (`make test SEEDS=all`), and
whether whole surveys are made in full."""

import math
import os

ALL = os.environ.get("PHOTOGRAM_SEEDS") == "all"
"""Whether statistics have all their seeds, and surveys all their cells, key points, control points and figures."""


def seeds(count: int, few: int = 10) -> range:
    """Return the seeds of a statistic that has ``count`` of them, and ``few`` in every run."""
    return range(count if ALL else min(count, few))


def limit(of_all: float, count: int, few: int = 10) -> float:
    """Return the limit of a mean's or a standard deviation's deviation, given that for all ``count`` seeds: it falls
    with the root of their number."""
    return of_all * math.sqrt(count / len(seeds(count, few)))
