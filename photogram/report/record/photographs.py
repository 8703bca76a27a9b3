"""What report.json says of each photograph."""

from typing import Annotated, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from photogram.report.record.units import (
    Angles,
    AxisFigures,
    AxisMetres,
    Count,
    Metres,
    Pixel,
    Pixels,
    Position,
    Share,
)

_Row = Annotated[list[Annotated[float, Field(ge=-1.001, le=1.001)]], Field(min_length=3, max_length=3)]


class ResectedPoseRecord(TypedDict):
    """The pose of one photograph from its control points, and how far from its GNSS position it lies."""

    position_map_m: Position
    gnss_difference_m: NotRequired[Metres]
    gnss_difference_map_m: NotRequired[Position]
    omega_phi_kappa_deg: Angles


class RefinedPoseRecord(ResectedPoseRecord):
    """The least-squares pose from all agreeing marks, with the residual of each, projected minus measured."""

    marks: Count
    residual_px: list[Pixel]


class ResectionRecord(ResectedPoseRecord):
    """P3P from three control points: how many poses these allow, and by what misfit one was chosen."""

    method: str
    solutions: Count
    check_px: Pixels | None
    refined: RefinedPoseRecord


class OrientedPhotograph(TypedDict):
    """A photograph with its adjusted exterior orientation, in the map, and the tests of its GNSS position."""

    camera: str
    registered: Literal[True]
    reason: None
    position_map_m: Position
    sigma_m: Position
    omega_phi_kappa_deg: Angles
    sigma_attitude_deg: Angles
    rotation_camera_from_map: Annotated[list[_Row], Field(min_length=3, max_length=3)]
    tie_points: Count
    gsd_m: Metres | None
    gnss_residual_m: Position | None
    gnss_redundancy: AxisFigures | None
    gnss_w: AxisFigures | None
    gnss_mdb_m: AxisMetres | None
    gnss_suspect: bool | None
    resection: NotRequired[ResectionRecord]


class LeftOutPhotograph(TypedDict):
    """A photograph that is not part of the adjusted block, and why."""

    camera: str
    registered: Literal[False]
    reason: str
    tie_points: Count
    gnss_residual_m: None


class PhotographMaskRecord(TypedDict):
    """Which share of one photograph is masked: by masks that were given, and by what was found automatically."""

    given: Share | None
    automatic: Share | None


class MasksRecord(TypedDict):
    """The masks of photographs: how many have one that was given, or found automatically, the mean share that these
    leave out of them, the same by photograph, and the marks of ground points in masked pixels."""

    given: Count
    given_share: Share | None
    automatic: Count
    automatic_share: Share | None
    photographs: dict[str, PhotographMaskRecord]
    marks: list[str]


class StretchRecord(TypedDict):
    """How the pixel values of a camera's photographs, which have more than 8 bits, became 8: from 0 to 255 linearly
    between these two."""

    low_dn: Count
    high_dn: Count


PhotographRecord = Annotated[OrientedPhotograph | LeftOutPhotograph, Field(discriminator="registered")]
