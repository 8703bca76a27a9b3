"""What point clouds are called wherever they are shown, and which standard deviations began with an assumption."""

from collections.abc import Mapping
from types import MappingProxyType

ASSUMED_SIGMAS = frozenset({"gnss_plan", "gnss_height", "control_plan", "control_height", "marks"})
"""Those kinds of which nobody has stated what the estimate began with."""

CLOUD_TITLES: Mapping[str, str] = MappingProxyType(
    {"linear_2view": "two-view", "linear_3view": "three-view", "adjusted": "adjusted"}
)
"""By the name of the cloud, as they are called in a sentence."""
