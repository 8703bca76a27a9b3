"""What report.json says of GNSS positions and of height systems."""

from typing import Annotated, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from photogram.geodesy.height_systems import HeightSystem
from photogram.gnss import Solution
from photogram.report.record.units import AxisFigures, AxisMetres, Count, Metres, Probability
from photogram.survey import CommonErrorKind


class FlightRecord(TypedDict):
    """The GNSS positions of a flight, and whether they are off together; lengths along easting, northing, height."""

    n: Count
    estimated: bool
    offset_m: AxisMetres | None
    sigma_m: AxisMetres | None
    chi2: float | None
    degrees_of_freedom: Count
    p: Probability | None
    p_axes: AxisFigures
    significant: bool | None
    beyond_prior: bool
    mean_residual_m: AxisMetres
    rms_residual_m: AxisMetres
    sentence: str


class LeverArmRecord(TypedDict):
    """How many positions of a flight were brought to the camera, along which axes, and how far on the average."""

    n: Count
    axes: Literal["world", "camera"]
    length_m: Metres


class LeverArmLeftRecord(TypedDict):
    """The lever arm that the positions show beside the one that was counted."""

    forward_right_down_m: AxisMetres
    sigma_m: AxisMetres
    p: Probability
    significant: bool


class DatumRecord(TypedDict):
    """What is accepted of the way of the positions into the datum of the map: one error of all, in plan."""

    sigma_m: Metres
    sentence: str


class CommonErrorRecord(TypedDict):
    """What measurements of many photographs had in common, as it was estimated and removed: attitudes about the
    camera's axes, a lever arm along them, a time offset, a drift along easting, northing, height."""

    kind: CommonErrorKind
    flight: str | None
    camera: str | None
    photographs: Count
    unit: Literal["deg", "m", "s"]
    estimate: Annotated[list[float | None], Field(min_length=1, max_length=3)]
    sigma: Annotated[list[float | None], Field(min_length=1, max_length=3)]
    chi2: float | None
    degrees_of_freedom: Count
    p: Probability | None
    significant: bool | None
    as_well: str
    sentence: str


class UnusedPositionRecord(TypedDict):
    """A photograph whose position took no part, and why."""

    photograph: str
    reason: str


class GnssRecord(TypedDict):
    """GNSS positions: how good they are, whether flights are off together, what was not used."""

    sentence: str
    positions_used: Count
    control_points_used: Count
    flights: dict[str, FlightRecord]
    solutions: dict[Solution, Count]
    sources: dict[str, Count]
    lever_arm_m: dict[str, LeverArmRecord] | None
    lever_arm_left: LeverArmLeftRecord | None
    datum: NotRequired[DatumRecord | None]
    common_errors: NotRequired[list[CommonErrorRecord]]
    not_used: list[UnusedPositionRecord]
    warnings: list[str]


def is_placed_by_prior(gnss: GnssRecord) -> bool:
    """Whether nothing but the prior of the offset of GNSS tells where a survey is: no control point, and one flight, or
    several of which none tests the offset of another."""
    flights = gnss["flights"].values()
    untested = all(flight["estimated"] and not flight["degrees_of_freedom"] for flight in flights)
    return bool(flights) and untested and not gnss["control_points_used"]


class HeightCountsRecord(TypedDict):
    """How many heights were given in each system."""

    ellipsoidal: Count
    orthometric: Count
    undeclared: Count


class HeightInputsRecord(TypedDict):
    """The systems of the heights that came in."""

    gnss: HeightCountsRecord
    control_points: HeightCountsRecord


class ProductCrsRecord(TypedDict):
    """The CRS of every product, with its vertical axis."""

    name: str
    epsg: int | None
    wkt: str


class HeightDifferenceRecord(TypedDict):
    """By how much GNSS heights lie above those of the control points, where nobody declares them, with the probability
    of as much by chance, and whether they are taken to be of one system."""

    difference_m: Metres
    sigma_m: Metres
    p: Probability
    same: bool


class HeightsRecord(TypedDict):
    """What all heights are counted from, and what came in."""

    output: HeightSystem | None
    geoid: str | None
    geoid_height_m: Metres | None
    crs: ProductCrsRecord
    inputs: HeightInputsRecord
    difference: NotRequired[HeightDifferenceRecord | None]
    sentence: str
