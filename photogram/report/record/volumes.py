"""What report.json says of volumes."""

from typing import Annotated, Literal, final

from pydantic import Field
from typing_extensions import TypedDict

from photogram.report.record.units import LARGEST, Metres, SquareMetres

CubicMetres = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


class VolumeRecord(TypedDict):
    """Volumes within a polygon, as a line of volumes.csv: fill lies above the base, cut below, net is fill less cut."""

    name: str
    area_m2: SquareMetres
    measured_m2: SquareMetres
    interpolated_m2: SquareMetres
    unmeasured_m2: SquareMetres
    net_m3: CubicMetres
    net_sigma_m3: CubicMetres
    fill_m3: CubicMetres
    fill_sigma_m3: CubicMetres
    cut_m3: CubicMetres
    cut_sigma_m3: CubicMetres
    own_sigma_m3: CubicMetres
    common_sigma_m3: CubicMetres
    outline_sigma_m3: CubicMetres
    noise_m3: CubicMetres
    interpolated_m3: CubicMetres
    detected_fill_m3: CubicMetres
    detected_cut_m3: CubicMetres


class UnmeasuredPolygonRecord(TypedDict):
    """A polygon without a volume, and why."""

    name: str
    reason: str


@final
class VolumesRecord(TypedDict):
    """Volumes of the survey's surface in polygons; ``total`` is null where they overlap or none was measured."""

    base: Literal["rim", "level", "reference"]
    level_m: Metres | None
    reference: str | None
    base_words: str
    sigma_from: str
    correlation_m: Metres
    cell_m: Metres
    polygons: list[VolumeRecord]
    total: VolumeRecord | None
    not_measured: list[UnmeasuredPolygonRecord]


@final
class NoVolumesRecord(TypedDict):
    """Why volumes that were asked for were not measured."""

    left_out: str
