"""What report.json says of the block as a whole: what it is weak in, and what would help."""

from typing import Annotated

from pydantic import Field
from typing_extensions import TypedDict

from photogram.report.record.units import AxisMetres, Count, EarthMetres, Metres, PartlyKnown, Pixels, Position


class CalibrationRecord(TypedDict):
    """The free parameters of a camera, their values, sigmas and correlations."""

    parameters: list[str]
    value: list[float]
    sigma: list[float]
    correlation: list[list[float | None]]


class FocalHeightRecord(TypedDict):
    """Correlations of a focal length with heights, and the part of the heights' sigma that goes with it."""

    projection_centres: float | None
    ground: float | None
    gnss_offset: dict[str, float | None]
    sigma_height_m: Metres | None


class ResidualPatternRecord(TypedDict):
    """What the residuals of a camera have in common at the same place of all photographs."""

    pattern_px: Pixels
    residual_px: Pixels
    chance_px: Pixels
    squares: Count
    significant: bool


class PatternEffectRecord(TypedDict):
    """What patterns hidden in the block would do to the heights: slopes east and north, and the dome."""

    slopes_m: list[Metres | None]
    dome_m: Metres | None
    radius_m: Metres | None


class DomeRecord(TypedDict):
    """The bending of the heights at `radius_m` from the centre: measured, and predicted."""

    radius_m: Metres | None
    measured_m: Metres | None
    sigma_m: Metres | None
    significant: bool
    predicted_sigma_m: Metres | None
    points: Count
    control_points: Count


class PlacingRecord(TypedDict):
    """How well the block is placed and shaped, 1 sigma."""

    absolute_plan_m: Metres | None
    absolute_height_m: Metres | None
    relative_plan_m: Metres | None
    relative_height_m: Metres | None
    shift_plan_m: Metres | None
    shift_height_m: Metres | None
    tilt_m: Metres | None
    radius_m: Metres | None


class GroundErrorsRecord(TypedDict):
    """What photographs, calibration and datum do to the ground at some places, and a factor (3, R) of each for the
    differences between them."""

    position_map_m: list[Position]
    sigma_m: list[Position]
    factor_m: list[Annotated[list[list[EarthMetres]], Field(min_length=3, max_length=3)]]


class RemedyRecord(TypedDict):
    """A change that was tried by covariance: sigmas of heights and of the dome before and after."""

    what: str
    sigma_height_before_m: Metres
    sigma_height_after_m: Metres
    sigma_dome_before_m: Metres
    sigma_dome_after_m: Metres
    title: str
    helps: bool
    sentence: str


class ResectionsRecord(TypedDict):
    """Why the resections of a camera in a flight miss GNSS, along easting, northing, height."""

    camera: str
    flight: str
    photographs: Count
    mean_m: AxisMetres
    focal_m: Metres
    offset_m: AxisMetres
    rest_m: AxisMetres
    scatter_m: Metres
    sentence: str


class DiagnosisRecord(TypedDict):
    """What the block as a whole is weak in, and what would help."""

    cameras: dict[str, CalibrationRecord]
    focal_height_correlation: dict[str, FocalHeightRecord]
    residual_pattern: dict[str, ResidualPatternRecord]
    pattern_effect: PatternEffectRecord
    dome: DomeRecord
    placing: PlacingRecord | None
    intersection_sigma_m: PartlyKnown
    ground_errors: GroundErrorsRecord | None
    warnings: list[str]
    remedies: list[RemedyRecord]
    undetermined: list[str]
    resections: list[ResectionsRecord]
