"""report.json as a whole. Its keys are kept stable: scripts rely on them.

A key that a later version adds is `NotRequired`, so that results of earlier ones can still be read.
"""

from typing import NotRequired

from pydantic import ConfigDict, with_config
from typing_extensions import TypedDict

from photogram.report.record.block import AdjustmentRecord, BlockRecord, CameraRecord, WorldRecord
from photogram.report.record.diagnosis import DiagnosisRecord
from photogram.report.record.ground import (
    BlunderRecord,
    BlundersEffectRecord,
    CheckPointsRecord,
    EstimatedSigmaRecord,
    GroundPointRecord,
    LeaveOneOutRecord,
    MarksRecord,
    PredictionTestRecord,
    SuspectRecord,
    VarianceComponentRecord,
)
from photogram.report.record.known_surface import KnownSurfaceRecord
from photogram.report.record.local_frame import ConstraintRecord, DistanceRecord, LocalFrameRecord, MarkedPointRecord
from photogram.report.record.measurements import MeasurementRecord
from photogram.report.record.photographs import MasksRecord, OrientedPhotograph, PhotographRecord, StretchRecord
from photogram.report.record.positions import GnssRecord, HeightsRecord
from photogram.report.record.rigs import RigRecord
from photogram.report.record.surfaces import (
    CloudRecord,
    DenseRecord,
    DsmRecord,
    NoOrthophotoRecord,
    NoSurfaceRecord,
    OrthophotoRecord,
    PlaneRecord,
)
from photogram.report.record.units import Count, Seconds
from photogram.report.record.verdict import (
    AsprsRecord,
    DeliverableRecord,
    DiscardedRecord,
    LightRecord,
    StandardRecord,
    SurveyRecord,
    VerdictRecord,
    WarningRecord,
)
from photogram.report.record.volumes import NoVolumesRecord, VolumesRecord


class AdjustedNumbers(TypedDict):
    """The numbers of an adjusted block; those of surface and orthophoto where they are made."""

    photogram: str
    crs: str
    world: WorldRecord
    block: BlockRecord
    photographs: dict[str, PhotographRecord]
    cameras: dict[str, CameraRecord]
    adjustment: AdjustmentRecord
    control_points: list[GroundPointRecord]
    check_points: CheckPointsRecord
    blunders: list[BlunderRecord]
    blunders_effect: BlundersEffectRecord | None
    predicted_against_achieved: PredictionTestRecord | None
    leave_one_out: LeaveOneOutRecord | None
    variance_components: dict[str, VarianceComponentRecord]
    estimated_sigmas: NotRequired[list[EstimatedSigmaRecord]]
    suspects: list[SuspectRecord]
    diagnosis: DiagnosisRecord
    clouds: dict[str, CloudRecord]
    seconds: dict[str, Seconds]
    orthophoto: NotRequired[OrthophotoRecord | NoOrthophotoRecord]
    dense: NotRequired[DenseRecord]
    plane: NotRequired[PlaneRecord]
    local_frame: NotRequired[LocalFrameRecord]
    distances: NotRequired[list[DistanceRecord]]
    constraints: NotRequired[list[ConstraintRecord]]
    marked_points: NotRequired[list[MarkedPointRecord]]
    rigs: NotRequired[list[RigRecord]]
    known_surface: NotRequired[KnownSurfaceRecord]
    marks: NotRequired[MarksRecord]
    masks: NotRequired[MasksRecord]
    stretches: NotRequired[dict[str, StretchRecord]]
    volumes: NotRequired[VolumesRecord | NoVolumesRecord]
    measurements: NotRequired[list[MeasurementRecord]]


class SurveyNumbers(AdjustedNumbers):
    """The numbers of a whole survey, before they are judged."""

    heights: HeightsRecord
    gnss: GnssRecord
    dsm: DsmRecord | NoSurfaceRecord
    survey: SurveyRecord
    versions: dict[str, str | None]
    peak_memory_bytes: dict[str, Count | None]
    processed: str
    deliverables: list[DeliverableRecord]


@with_config(ConfigDict(strict=True, allow_inf_nan=False))
class Report(SurveyNumbers):
    """Everything that report.json holds. Lengths in metres, angles in degrees, image coordinates in pixels, as the
    names of the keys say; null where a figure does not exist."""

    asprs: AsprsRecord
    discarded: list[DiscardedRecord]
    warnings: list[WarningRecord]
    summary: list[LightRecord]
    verdict: VerdictRecord
    standard: NotRequired[StandardRecord | None]
    report_id: str


def oriented(photographs: dict[str, PhotographRecord]) -> dict[str, OrientedPhotograph]:
    """Return the photographs that are part of the adjusted block, by name."""
    return {name: photograph for name, photograph in photographs.items() if photograph["registered"]}
