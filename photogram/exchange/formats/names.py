"""The names of the forms in which solutions are written, for commands, which import nothing that computes."""

from typing import Literal, get_args

SolutionFormat = Literal[
    "colmap",
    "colmap-text",
    "opensfm",
    "bundler",
    "metashape",
    "opf",
    "omega-phi-kappa",
    "yaw-pitch-roll",
    "undistorted",
]
SOLUTION_FORMATS: tuple[SolutionFormat, ...] = get_args(SolutionFormat)
