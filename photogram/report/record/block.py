"""What report.json says of the block, its cameras and its adjustment."""

from typing import Annotated, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from photogram.projection import Model
from photogram.report.record.units import (
    Count,
    Iterations,
    Metres,
    ParameterFigures,
    Pixel,
    Pixels,
    Position,
    Probability,
    Seconds,
    Share,
    SquareMetres,
)

Scale = Annotated[float, Field(gt=0, lt=10)]
_Correlation = Annotated[float, Field(ge=-1, le=1)]
_Format = Annotated[int, Field(ge=1, le=1_000_000)]


class UnitsRecord(TypedDict):
    """The units of the map, in which files give coordinates; report.json is in metres whatever they are."""

    plan: str
    """Unit of easting and northing."""
    plan_m: Scale
    """That unit in metres."""
    height: str
    """Unit of heights."""
    height_m: Scale
    """That unit in metres."""


class ScaleFactorsRecord(TypedDict):
    """A short length on the map over that on the ground, at the middle of the tie points."""

    grid: Scale
    """On the map over that on the ellipsoid."""
    height: Scale
    """On the ellipsoid over that on the ground."""
    combined: Scale
    """The product of both."""


class WorldRecord(TypedDict):
    """The Cartesian frame of the adjustment, and its origin in the map."""

    kind: Literal["tangent", "grid"]
    origin_map_m: Position
    units: NotRequired[UnitsRecord]
    scale_factors: NotRequired[ScaleFactorsRecord]


class OverlapRecord(TypedDict):
    """Of the ground that two photographs or more see, how many see a cell, its area, and the share that three or more
    see; ``share_2_or_more`` is of the ground amid the tie points."""

    median: float
    mean: float
    share_2_or_more: Share
    share_3_or_more: Share
    area_m2: SquareMetres
    cell_m: Metres


class GnssRmsRecord(TypedDict):
    """Root mean squares of the GNSS residuals; null without GNSS."""

    plan: Metres | None
    height: Metres | None
    three_d: Metres | None


class ComponentSigmaRecord(TypedDict):
    """How well a component is placed beside the first: standard deviations of the vector between their mean points."""

    plan: Metres
    height: Metres


class ComponentRecord(TypedDict):
    """What ties a component, which shares no matched tie points with the others, to the block: the names of its control
    points, the number of its GNSS positions, the names of marked points and cameras and the number of tie points that
    it has in common with other components."""

    photographs: Count
    adjusted: bool
    placed_by: str
    control_points: list[str]
    gnss_positions: Count
    shared_marks: list[str]
    shared_cameras: list[str]
    shared_tie_points: Count
    sigma_to_first_m: ComponentSigmaRecord | None


class BlockRecord(TypedDict):
    """How much of the survey was registered, and how it hangs together."""

    registered: Count
    photographs: Annotated[int, Field(ge=1, le=10**15)]
    components: list[list[str]]
    component_sizes: list[Count]
    component_ties: list[ComponentRecord]
    method: str
    gsd_m: Metres | None
    overlap: OverlapRecord | None
    mean_track_length: float | None
    tie_points: Count
    observations: Count
    gnss_residual_rms_m: GnssRmsRecord


class LensFieldRecord(TypedDict):
    """Whether a camera has a lens field, and what says so; null for what was not looked at."""

    estimated: bool
    why: str | None
    photographs: Count
    pattern_px: Pixels | None
    left_px: Pixels | None
    covered: Share | None
    gain: float | None
    gain_errors: float | None
    rms_px: Pixels | None
    sigma_px: Pixels | None
    largest_px: Pixels | None


class RollingShutterRecord(TypedDict):
    """The read-out time of a camera as it was estimated, what it correlates with, and what velocities from neighbours
    scatter by; null for what was not estimated or is not told."""

    estimate_s: float | None
    sigma_s: Seconds | None
    focal_correlation: _Correlation | None
    time_offset_correlation: _Correlation | None
    neighbours_scatter_m_s: Annotated[float, Field(ge=0)] | None


class CameraRecord(TypedDict):
    """Adjusted interior orientation of a camera, its sigmas, and what was known before."""

    model: Model
    focal_px: Annotated[Pixels, Field(gt=0, le=1e7)]
    principal_point_px: Pixel
    radial: Annotated[list[float], Field(min_length=3, max_length=4)]
    tangential: Annotated[list[float], Field(min_length=2, max_length=2)]
    affinity: Annotated[list[float], Field(min_length=2, max_length=2)]
    readout_s: NotRequired[float]
    sigma: ParameterFigures
    prior_sigma: ParameterFigures
    held: dict[str, str]
    focal_length: str | None
    source: str | None
    width_px: _Format
    height_px: _Format
    lens_field: NotRequired[LensFieldRecord | None]
    rolling_shutter: NotRequired[RollingShutterRecord | None]


class GnssOffsetRecord(TypedDict):
    """The offset of a flight, projection centre minus GNSS position, along easting, northing, up."""

    offset_m: Position
    sigma_m: Position


class EffortRecord(TypedDict):
    """The work for one decision of the adjustment."""

    decision: str
    """What was decided."""
    solutions: Count
    """How often Levenberg–Marquardt ran."""
    iterations: Count
    """Its iterations."""
    iterations_over_all_rays: Iterations
    """The same, each counted by the share of the observations of tie points that took part."""
    seconds: Seconds
    """Time without that of other decisions on the way."""


class DecisionRecord(TypedDict):
    """One thing that was decided about the model, or about what takes part, with the statistic, χ², by which, and what
    would explain the same nearly as well."""

    about: str
    adopted: bool
    sentence: str
    statistic: float | None
    degrees: Count
    p: Probability | None
    rivals: list[str]


class AdjustmentRecord(TypedDict):
    """What the joint adjustment says of itself."""

    sigma0: float | None
    redundancy: int
    reprojection_rms_px: Pixels | None
    tie_points: Count
    tie_points_by_rays: dict[str, Count]
    observations: Count
    discarded_observations: Count
    discarded_tie_points: Count
    iterations: Count
    rounds: Count
    converged: bool
    gnss_offsets: dict[str, GnssOffsetRecord]
    seconds: Seconds
    disbelieved_attitudes: Count
    rejected_headings: Count
    effort: NotRequired[list[EffortRecord]]
    decisions: NotRequired[list[DecisionRecord]]
