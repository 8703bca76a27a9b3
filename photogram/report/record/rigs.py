"""What report.json says of cameras on one body."""

from typing import Annotated, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from photogram.report.record.units import Count, Degrees, Metres, Pixels

_Offset = Annotated[list[Metres], Field(min_length=3, max_length=3)]
_Turn = Annotated[list[Degrees], Field(min_length=3, max_length=3)]


class BandRecord(TypedDict):
    """How a band lies on the master's colours in `orthophoto_bands.tif`: the mean shift, east and north, and the root
    mean square per axis of its patches, in pixels of the orthophoto; null without patches that tell."""

    patches: Count
    mean_px: Annotated[list[Pixels], Field(min_length=2, max_length=2)] | None
    rms_px: Pixels | None


class RigRecord(TypedDict):
    """A companion camera: where it sits beside its master as adjusted, null where no exposure takes part, and how well
    its exposures are tested. Offsets are right, down and forward of the master; rotations about x, y, z in this order,
    their standard deviations about the companion's axes. Redundancy numbers are averages, what is detectable is a
    median over the exposures, along the worst axis."""

    camera: str
    master: str
    exposures: Count
    rejected: list[str]
    offset_m: _Offset | None
    offset_sigma_m: _Offset | None
    rotation_deg: _Turn | None
    rotation_sigma_deg: _Turn | None
    offset_given: bool
    rotation_given: bool
    offset_redundancy: float | None
    rotation_redundancy: float | None
    offset_mdb_m: Metres | None
    rotation_mdb_deg: Degrees | None
    largest_w: float | None
    registration: NotRequired[BandRecord]
