"""What report.json says of control and check points, and of what contradicts everything else."""

from typing import Annotated, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from photogram.report.record.units import (
    AxisFigures,
    AxisMetres,
    Count,
    Metres,
    PartlyKnown,
    Pixel,
    Pixels,
    Position,
    Probability,
    Share,
)
from photogram.results import SigmaKind

Role = Literal["control", "check"]
AxisRole = Literal["control", "check", "left out"]
AxisCounts = Annotated[list[Count], Field(min_length=3, max_length=3)]
_PixelFigures = Annotated[list[float | None], Field(min_length=2, max_length=2)]


class ChiSquareRecord(TypedDict):
    """A χ² test: its value, degrees of freedom, and the probability of more by chance."""

    value: float
    dof: Count
    p: Probability


class MarkRecord(TypedDict):
    """A mark of a ground point in a photograph, its residual projected minus measured, and its tests."""

    photograph: str
    left_out: bool
    pixel: Pixel
    residual_px: Pixel | None
    redundancy: _PixelFigures | None
    w: _PixelFigures | None
    mdb_px: Annotated[list[Pixels | None], Field(min_length=2, max_length=2)] | None
    suspect: bool | None
    kind: NotRequired[str]
    sigma_px: NotRequired[Pixels]
    semi_axes_px: NotRequired[Annotated[list[Pixels], Field(min_length=2, max_length=2)]]
    direction_deg: NotRequired[Annotated[float, Field(ge=-90, le=90)]]


class SpreadRecord(TypedDict):
    """Median, least and largest of standard deviations."""

    median: Pixels
    least: Pixels
    largest: Pixels


class MarkKindRecord(TypedDict):
    """Marks of ground points that were measured in one way: how many, of control points among them, rejected; their
    stated sigmas, and how those that were not rejected fit: root mean squares over u and v of the residuals, and of
    residuals over sigmas. `sigma_factor` is the latter over the root of the mean redundancy number, of control points
    alone."""

    kind: str
    marks: Count
    of_control_points: Count
    rejected: Count
    sigma_px: SpreadRecord
    residual_rms_px: Pixels | None
    residual_over_sigma: float | None
    sigma_factor: float | None


class NotShownRecord(TypedDict):
    """A photograph of which no patches could be shown, and why."""

    photograph: str
    reason: str


class MarksRecord(TypedDict):
    """Marks of ground points by the way they were measured, and photographs that could not be read for pictures."""

    kinds: list[MarkKindRecord]
    not_shown: list[NotShownRecord]


class GroundPointRecord(TypedDict):
    """A control or check point: surveyed, adjusted, and tested; lengths along easting, northing, height."""

    name: str
    role: Role
    axis_roles: Annotated[list[AxisRole], Field(min_length=3, max_length=3)]
    surveyed_map_m: Position
    surveyed_sigma_m: PartlyKnown
    surveyed_sigma_assumed: NotRequired[bool]
    adjusted_map_m: Position | None
    residual_m: Position | None
    sigma_m: PartlyKnown | None
    redundancy: AxisFigures | None
    w: AxisFigures | None
    mdb_m: AxisMetres | None
    suspect: bool | None
    effect_m: AxisMetres | None
    left_out_m: AxisMetres | None
    left_out_sigma_m: AxisMetres | None
    chi2: ChiSquareRecord | None
    verdict: str | None
    marks: list[MarkRecord]
    z: AxisFigures | None
    mahalanobis: float | None


class CheckPointsRecord(TypedDict):
    """Differences adjusted minus surveyed of the check points; null where there are none."""

    n: Count
    n_axis: AxisCounts
    rmse_m: AxisMetres
    mean_m: AxisMetres
    rmse_h_m: Metres | None
    rmse_v_m: Metres | None


class BlunderRecord(TypedDict):
    """A blunder by its name: the points, the photograph or the camera that it concerns, and a sentence."""

    kind: str
    points: list[str]
    photograph: str | None
    sentence: str
    camera: str | None


class BlundersEffectRecord(TypedDict):
    """Check points with the blunders in the adjustment and without them."""

    check_points: CheckPointsRecord
    check_points_without: CheckPointsRecord
    sentence: str | None


class SuspectRecord(TypedDict):
    """A measurement in the result that everything else contradicts: `off` by so much, in m, of a mark in px."""

    kind: str
    name: str
    axis: str
    w: float
    off: float
    sentence: str


class ZScoresRecord(TypedDict):
    """z-scores of check points along an axis, and the shares of them within 1, 2 and 3 sigma."""

    n: Count
    mean_z: float | None
    rms_z: float | None
    within_1: Share | None
    within_2: Share | None
    within_3: Share | None


class ZScoresByAxis(TypedDict):
    """The same along each axis of the map."""

    easting: ZScoresRecord
    northing: ZScoresRecord
    height: ZScoresRecord


class PredictionTestRecord(TypedDict):
    """Whether the check points are off by as much as predicted."""

    n: Count
    axes: ZScoresByAxis
    chi2: ChiSquareRecord
    consistent: bool
    sentence: str


class FarthestPointRecord(TypedDict):
    """The control point that everything else predicts worst."""

    name: str
    left_out_m: AxisMetres
    z: AxisFigures


class LeaveOneOutRecord(TypedDict):
    """Control points, each predicted from everything but its own survey: predicted minus surveyed."""

    n: Count
    rmse_m: AxisMetres
    mean_m: AxisMetres
    rmse_h_m: Metres | None
    rmse_v_m: Metres | None
    rms_z: AxisFigures
    max: FarthestPointRecord


class EstimatedSigmaRecord(TypedDict):
    """A standard deviation that was estimated from residuals, in `unit`: of tie points by camera and kind, of those in
    a photograph that scatters more, of GNSS positions of assumed sigmas by flight, of control points and marks of
    assumed sigmas. `of` names camera, photograph or
    flight; `factor` is what stated sigmas were multiplied by, of a photograph beside that of its camera."""

    kind: SigmaKind
    of: str
    observations: Count
    redundancy: float
    stated_sigma: float
    estimated_sigma: float | None
    used_sigma: float
    unit: Literal["px", "m"]
    factor: float


class VarianceComponentRecord(TypedDict):
    """Whether a group of observations scatters as its sigmas say; sigmas in `unit`. `sigma_factor` belongs to
    `used_sigma`, which is `stated_sigma` where none was estimated."""

    observations: Count
    redundancy: float
    stated_sigma: float | None
    used_sigma: NotRequired[float | None]
    unit: str | None
    sigma_factor: float | None
    sigma_factor_sd: float | None
    significant: bool
    sentence: str | None
