"""What report.json says of constraints between points, and of a survey without georeference."""

from typing import Annotated, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from photogram.report.record.units import Count, Degrees, Metres

_Three = Annotated[list[float], Field(min_length=3, max_length=3)]


class DistanceRecord(TypedDict):
    """A measured distance: adjusted minus measured, null where an end takes no part; the standard deviation of the
    adjusted one, and the test of the measured one, null where nothing else tests it."""

    ends: list[str]
    length_m: Metres
    sigma_m: Metres
    residual_m: Metres | None
    adjusted_sigma_m: Metres | None
    w: float | None
    name: NotRequired[str]
    role: NotRequired[Literal["control", "check"]]
    redundancy: NotRequired[float | None]
    mdb_m: NotRequired[Metres | None]
    z: NotRequired[float | None]
    rejected: NotRequired[bool]


class ConstraintRecord(TypedDict):
    """A height difference, or a point of a level surface or of a plane, which lies ``residual_m`` above or in front of
    it; figures as of a distance."""

    kind: Literal["height difference", "level surface", "plane", "distance"]
    points: list[str]
    difference_m: Metres | None
    sigma_m: Metres
    residual_m: Metres | None
    adjusted_sigma_m: Metres | None
    w: float | None
    name: str
    role: Literal["control", "check"]
    redundancy: float | None
    mdb_m: Metres | None
    z: float | None
    rejected: bool


class MarkedPointRecord(TypedDict):
    """A point that is marked and not surveyed, in the frame and the unit of the survey; null without a position."""

    name: str
    marks: Count
    position: _Three | None
    sigma: _Three | None


class RelativePrecisionRecord(TypedDict):
    """Standard deviations in the datum of the tie points, the median of the mean along the axes, in the unit of the
    frame; ``tie_points_one_in`` is how often that of the tie points goes into the extent of the object, 90 % of it
    along its longest direction."""

    photographs: float
    attitudes_deg: Degrees
    tie_points: float
    tie_points_one_in: float


class LocalFrameRecord(TypedDict):
    """The frame of a free network. Where its scale is not known, every length of the report, also of keys that end in
    ``_m``, is in ``unit`` and not in metres."""

    scale_known: bool
    unit: str
    vertical_by: Literal["attitudes", "down", "level"]
    vertical_sure: bool
    relative: RelativePrecisionRecord
    sentence: str
