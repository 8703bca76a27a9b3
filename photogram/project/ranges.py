"""What a number in a project file may be, from what is physically possible: beyond it is a slip of the pen or a unit.

The ranges are wide: they refuse what cannot be, not what is unusual.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from photogram.files import text_lines
from photogram.project.document import found


@dataclass(frozen=True)
class Within:
    """The range of a number, ends included, as metadata of a type; where ``or_zero``, 0 is allowed beside it."""

    low: float
    high: float
    unit: str = ""
    or_zero: bool = False

    def holds(self, value: float) -> bool:
        """Whether the number lies in the range."""
        return self.low <= value <= self.high or (self.or_zero and value == 0)

    def __str__(self) -> str:
        zero = "0, or " if self.or_zero else ""
        return f"{zero}from {self.low:.15g} to {self.high:.15g}{f' {self.unit}' if self.unit else ''}"

    def check(self, value: float | None) -> float | None:
        """Return the number, or None where none is given. Raises ValueError where it is out of range."""
        if value is not None and not self.holds(value):
            raise ValueError(f"must be {self}, found {found(value)}")
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:  # noqa: ANN401
        """Let pydantic check the number once its type is right."""
        return core_schema.no_info_after_validator_function(self.check, handler(source))


PIXELS = Within(1, 200_000, "px")
FOCAL_PX = Within(1, 1_000_000, "px")
POSITION_M = Within(-1e8, 1e8, "m")
POSITION = Within(-1e9, 1e9)
"""In the unit of any map."""

SIGMA_M = Within(*text_lines.SIGMA_M, "m")
OFFSET_SIGMA_M = Within(*text_lines.SIGMA_M, "m", or_zero=True)
SIGMA_PX = Within(*text_lines.SIGMA_PX, "px")
PLACE_PX = Within(-1e6, 1e6, "px")
LEVER_ARM_M = Within(-10_000, 10_000, "m")
"""Of a slip of millimetres, which is named where the arm is looked at, not here."""

ANGLE_DEG = Within(-360, 360, "°")
ANGLE_SIGMA_DEG = Within(1e-4, 180, "°")
FLYING_HEIGHT_M = Within(0.1, 50_000, "m")
DISTORTION = Within(-1e9, 1e9)
"""Of any lens at all; project_checks has the range that a camera's own picture leaves."""

LENGTH_M = Within(1e-4, 1e5, "m")
"""Of a measured distance."""

TOLERANCE_S = Within(1e-6, 3600, "s")
"""Between photographs of one exposure."""

RISE_M = Within(-10_000, 10_000, "m")
"""Of a levelled height difference."""

FREEDOM = Within(1e-12, 1e6)
"""Prior standard deviations of camera parameters, in px or without unit."""

READOUT_S = Within(-2, 2, "s")
"""Time in which a camera reads a picture, negative upwards; no shutter that flies takes a second."""

_CELL_M = Within(0.001, 1000, "m")
_COUNT = Within(1, 1000)

SETTINGS: Mapping[str, Mapping[str, Within]] = {
    "features": {
        "maximum": Within(8, 200_000),
        "contrast_threshold": Within(0, 1),
        "tile_px": Within(256, 65_536, "px"),
        "overlap_px": Within(16, 32_768, "px"),
        "cells_per_side": _COUNT,
    },
    "pairs": {
        "neighbours": _COUNT,
        "retrieved": _COUNT,
        "maximum": _COUNT,
        "footprint_overlap": Within(0.01, 1),
    },
    "matching": {
        "ratio": Within(0.01, 1),
        "threshold_px": Within(0.01, 100, "px"),
        "minimum_inliers": Within(8, 10_000),
    },
    "orientation": {
        "threshold_px": Within(0.1, 1000, "px"),
        "minimum_ray_angle_deg": Within(0.1, 90, "°"),
        "minimum_points": Within(6, 10_000),
        "minimum_share": Within(0.01, 1),
    },
    "transfer": {
        "correlation": Within(0.1, 1),
        "half_window_px": Within(2, 100, "px"),
        "search_px": Within(1, 30, "px"),
        "least_contrast": Within(0, 255),
    },
    "adjustment": {
        "tie_point_sigma_px": Within(0.001, 100, "px"),
        "robust_threshold": Within(0.001, 1e6),
        "outlier_threshold": Within(0.001, 1e6),
        "first_outlier_threshold_px": Within(0.001, 1e6, "px"),
        "minimum_ray_angle_deg": Within(0, 90, "°"),
        "maximum_rounds": Within(1, 1000),
        "maximum_iterations": Within(1, 100_000),
        "relative_tolerance": Within(1e-16, 0.1, or_zero=True),
    },
    "dense": {
        "photographs": Within(2, 16),
        "agreeing_share": Within(0.01, 1),
        "small_step": Within(0, 10_000),
        "large_step": Within(0, 10_000),
        "contrast_dn": Within(0.01, 255),
        "noise_dn": Within(0.01, 255),
    },
    "surface": {
        "cell_m": _CELL_M,
        "maximum_gap_m": Within(0.001, 100_000, "m"),
        "spike_nmad": Within(0, 1e6),
        "spike_minimum_m": Within(0, 10_000, "m"),
        "spike_neighbours": Within(4, 1000),
    },
    "terrain": {
        "cell_m": _CELL_M,
        "cloth_m": Within(0.01, 1000, "m"),
        "rigidness": Within(1, 3),
        "reach_m": Within(0.001, 1000, "m"),
        "step_m": Within(0.001, 1000, "m"),
        "margin_m": Within(0.001, 1000, "m"),
        "maximum_gap_m": Within(0.001, 100_000, "m"),
    },
    "contours": {
        "interval_m": Within(0.01, 1000, "m"),
        "cell_m": _CELL_M,
        "minimum_length_m": Within(0, 100_000, "m"),
    },
    "orthophoto": {
        "cell_m": Within(0.0005, 1000, "m"),
        "feather_cells": Within(0, 10_000),
    },
    "report": {
        "target_rmse_h_m": Within(0.0001, 1000, "m"),
        "target_rmse_v_m": Within(0.0001, 1000, "m"),
    },
}
"""The ranges of the settings, by section and key; where the settings themselves are stricter, these say so."""
