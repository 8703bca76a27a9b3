"""Kinds of GNSS solutions, and the best standard deviation each can have."""

from collections.abc import Mapping
from typing import Literal

Sigma3 = tuple[float, float, float]
"""Standard deviations along easting, northing and height, m."""

UNKNOWN_M = 1000.0
"""Standard deviation of a height, or of an offset, that nothing tells."""

Solution = Literal["fix", "float", "single", "unknown"]
"""Carrier phases with their ambiguities fixed, or not fixed; one receiver by itself; a source that does not say."""

FIX_FLAG, FLOAT_FLAG = 50, 32
"""The least RtkFlag of DJI for each; below are 16, a single receiver, and 0, no solution."""

FLOOR_M: Mapping[Solution, Sigma3] = {
    # what the antenna's phase centre, the moment of exposure and the lever arm leave of any fixed solution
    "fix": (0.01, 0.01, 0.015),
    # ambiguities that are not whole numbers are wrong by cycles of 0.19 m, and for minutes alike
    "float": (0.2, 0.2, 0.4),
    # one receiver: clocks, orbits and the atmosphere remain
    "single": (1.5, 1.5, 3.0),
    # nothing is known of the solution: the stated standard deviation is accepted
    "unknown": (0.0, 0.0, 0.0),
}
"""Least standard deviations accepted, whatever a receiver or a project states. They are of receivers, antennas and
exposures, so they depend neither on the flying height nor on the picture."""


RTK_OFFSET_SIGMA_M: Sigma3 = (0.02, 0.02, 0.03)
"""Standard deviations of what all positions of a flight with fixed ambiguities have in common: the coordinates of the
base station, the network's corrections, the phase centres of the antennas."""


def solution_of_rtk_flag(flag: int | None) -> Solution:
    """Return the solution of DJI's RtkFlag: 50 and above fixed, 32 to 49 float, 16 single, and 0 no better than it."""
    if flag is None:
        return "unknown"
    return "fix" if flag >= FIX_FLAG else "float" if flag >= FLOAT_FLAG else "single"


def at_least(sigma_m: Sigma3, floor_m: Sigma3) -> Sigma3:
    """Return the larger of two standard deviations along each axis."""
    east, north, up = (max(s, f) for s, f in zip(sigma_m, floor_m, strict=True))
    return east, north, up
