"""What stages and point clouds are called wherever they are shown."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

STAGE_TITLES: Mapping[str, str] = MappingProxyType(
    {
        "photographs": "Photographs",
        "features": "Features",
        "pairs": "Pairs",
        "matches": "Matching",
        "tie_points": "Tie points",
        "orientation": "Orientation",
        "transfer": "Tie point transfer",
        "intersection": "Linear intersection",
        "adjustment": "Joint adjustment",
        "dense": "Dense matching",
        "surface": "Surface model",
        "relief": "Terrain and contours",
        "orthophoto": "Orthophoto",
        "comparison": "Comparison",
        "results": "Report",
    }
)
"""By the name of the stage."""

SIGMA_TITLES: Mapping[str, str] = MappingProxyType(
    {
        "key_points": "Key points",
        "transferred": "Tie points by correlation",
        "photograph": "Tie points of a photograph",
        "gnss_plan": "GNSS positions in plan",
        "gnss_height": "GNSS positions in height",
    }
)
"""By the kind of an estimated standard deviation."""

CLOUD_TITLES: Mapping[str, str] = MappingProxyType(
    {"linear_2view": "two-view", "linear_3view": "three-view", "adjusted": "adjusted"}
)
"""By the name of the cloud, as they are called in a sentence."""
