"""What report.json says of a known surface."""

from typing import Annotated

from pydantic import Field
from typing_extensions import TypedDict

from photogram.report.record.units import Count, Metres, Probability


class KnownSurfaceRecord(TypedDict):
    """Whether a known surface is control, and what it differs from the ground by: in height in the middle of its
    points, and by its slopes east and north at `edge_m`, as adjusted, or as found where it is left out."""

    name: str
    used: bool
    points: Count
    set_aside: Count
    mean_m: Metres | None
    rms_m: Metres | None
    scatter: float | None
    above_m: Annotated[list[Metres | None], Field(min_length=3, max_length=3)]
    above_sigma_m: Annotated[list[Metres | None], Field(min_length=3, max_length=3)]
    edge_m: Metres | None
    sigma_m: Metres
    common_sigma_m: Metres
    common_sigma_assumed: bool
    chi2: float | None
    p: Probability | None
    gives_heights: bool
    sentence: str
