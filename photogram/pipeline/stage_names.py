"""The names of the stages in their order, for whatever must know them without what they compute."""

from typing import Literal, get_args

StageName = Literal[
    "photographs",
    "features",
    "pairs",
    "matches",
    "tie_points",
    "orientation",
    "transfer",
    "intersection",
    "adjustment",
    "dense",
    "surface",
    "volumes",
    "relief",
    "orthophoto",
    "comparison",
    "results",
]
STAGE_NAMES: tuple[str, ...] = get_args(StageName)
