"""What standard deviations and point clouds are called wherever they are shown."""

from collections.abc import Mapping
from types import MappingProxyType

SIGMA_TITLES: Mapping[str, str] = MappingProxyType(
    {
        "key_points": "Key points",
        "transferred": "Tie points by correlation",
        "photograph": "Tie points of a photograph",
        "gnss_plan": "GNSS positions in plan",
        "gnss_height": "GNSS positions in height",
        "control_plan": "Control points in plan",
        "control_height": "Control points in height",
        "marks": "Marks",
    }
)
"""By the kind of an estimated standard deviation."""

ASSUMED_SIGMAS = frozenset({"gnss_plan", "gnss_height", "control_plan", "control_height", "marks"})
"""Those kinds of which nobody has stated what the estimate began with."""

CLOUD_TITLES: Mapping[str, str] = MappingProxyType(
    {"linear_2view": "two-view", "linear_3view": "three-view", "adjusted": "adjusted"}
)
"""By the name of the cloud, as they are called in a sentence."""
