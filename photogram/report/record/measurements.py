"""What report.json says of what was measured on the surface, and named."""

from typing import Annotated, Literal

from pydantic import Field
from typing_extensions import TypedDict

from photogram.report.record.units import LARGEST, EarthMetres

MeasuredKind = Literal["height", "distance", "profile", "area", "volume"]
Figure = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Place = Annotated[list[EarthMetres], Field(min_length=2, max_length=2)]


class MeasuredFigureRecord(TypedDict):
    """A figure of a measurement in its ``unit``; null where it is not known."""

    name: str
    value: Figure | None
    sigma: Annotated[Figure, Field(ge=0)] | None
    unit: str


class MeasurementRecord(TypedDict):
    """A measurement on the surface; without figures ``problem`` says why there are none."""

    name: str
    kind: MeasuredKind
    corners_map_m: list[Place]
    figures: list[MeasuredFigureRecord]
    note: str
    problem: str
    is_current: bool
    """Whether it was measured on the surface of these results; else on that of an earlier run."""
