"""What view.html takes from report.json, read and checked: nothing else of the file needs to be right."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from photogram.errors import ReportError
from photogram.projection import Model

NEEDED = ("photogram", "crs", "cameras", "photographs", "control_points")

_FARTHEST_M = 1e9  # of a coordinate or sigma that is none of this planet
_SHOWN = 60  # characters of what is wrong


def _earthly(value: float) -> float:
    if abs(value) > _FARTHEST_M:
        raise ValueError("no place or length on this planet")
    return value


_two, _three = Field(min_length=2, max_length=2), Field(min_length=3, max_length=3)

Metres = Annotated[float, AfterValidator(_earthly)]
Vector = Annotated[list[Metres], _three]
Partly = Annotated[list[Metres | None], _three]
Pair = Annotated[list[float], _two]
Row = Annotated[list[Annotated[float, Field(ge=-1.001, le=1.001)]], _three]
Pixels = Annotated[int, Field(ge=1, le=1_000_000)]
Role = Literal["control", "check"]
AxisRole = Literal["control", "check", "left out"]


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class CameraRecord(_Part):
    """Interior orientation, px."""

    model: Model = "brown"
    width_px: Pixels
    height_px: Pixels
    focal_px: Annotated[float, Field(gt=0, le=1e7)]
    principal_point_px: Pair
    radial: Annotated[list[float], Field(min_length=3, max_length=4)]
    tangential: Pair
    affinity: Pair


class PhotographRecord(_Part):
    """A photograph; without a position where it is not registered. Metres in the map, degrees."""

    camera: str
    registered: bool = True
    position_map_m: Vector | None = None
    rotation_camera_from_map: Annotated[list[Row], _three] | None = None
    sigma_m: Partly | None = None
    omega_phi_kappa_deg: Annotated[list[float], _three] | None = None
    tie_points: Annotated[int, Field(ge=0)] = 0


class PointRecord(_Part):
    """A control or check point; metres in the map."""

    name: str
    role: Role
    axis_roles: Annotated[list[AxisRole], _three] | None = None
    surveyed_map_m: Vector
    surveyed_sigma_m: Partly | None = None
    residual_m: Partly | None = None
    sigma_m: Partly | None = None


class GroundErrorsRecord(_Part):
    """What photographs and calibration do to the ground at places: see docs/report.md."""

    position_map_m: list[Vector]
    sigma_m: list[Vector]
    factor_m: list[Annotated[list[list[Metres]], _three]]


class DiagnosisRecord(_Part):
    """Of the diagnosis, what distances need."""

    intersection_sigma_m: Partly | None = None
    ground_errors: GroundErrorsRecord | None = None


class DenseRecord(_Part):
    """Of the dense surface, what its heights scatter by themselves."""

    matching_sigma_m: Metres | None = None


class SurveyRecord(_Part):
    """Of the survey's facts, its names."""

    name: str | None = None
    crs_name: str | None = None


class HeightsRecord(_Part):
    """What heights are above."""

    output: str | None = None


class ViewRecord(_Part):
    """What the page shows of report.json."""

    photogram: str
    crs: str
    cameras: dict[str, CameraRecord]
    photographs: dict[str, PhotographRecord]
    control_points: list[PointRecord]
    survey: SurveyRecord | None = None
    heights: HeightsRecord | None = None
    diagnosis: DiagnosisRecord | None = None
    dense: DenseRecord | None = None
    report_id: str | None = None
    processed: str | None = None

    @property
    def registered(self) -> dict[str, PhotographRecord]:
        """Return the photographs that were oriented, by name."""
        return {name: photograph for name, photograph in self.photographs.items() if photograph.registered}


def view_record(text: bytes | str) -> ViewRecord:
    """Return what the page shows of the text of report.json.

    Raises ReportError, in a sentence without the file's name, where it is no JSON, no report of photogram, or damaged.
    """
    try:
        found = ViewRecord.model_validate_json(text)
    except ValidationError as fault:
        raise ReportError(_sentence(text, fault)) from fault
    _whole(found)
    return found


def _sentence(text: bytes | str, fault: ValidationError) -> str:
    """Return the first fault in words."""
    first = fault.errors(include_url=False)[0]
    if first["type"] == "json_invalid":
        return f"damaged ({first['ctx']['error'] if 'ctx' in first else first['msg']})"
    absent = next((key for key in NEEDED if key not in _keys(text)), None)
    if absent is not None:
        return f"no report of photogram, {absent} is not in it"
    place = ".".join(str(part) for part in first["loc"])
    value = repr(first["input"])
    short = value if len(value) <= _SHOWN else f"{value[: _SHOWN - 1]}…"
    reason = first["msg"].removeprefix("Value error, ")
    return f"damaged, {place}: {reason[:1].lower()}{reason[1:]}, found {short}"


def _keys(text: bytes | str) -> list[str]:
    """Return the keys of the outermost object, none where there is no such object."""
    value: Any = json.loads(text)
    return list(value) if isinstance(value, dict) else []


def _whole(record: ViewRecord) -> None:
    """Raise ReportError where parts of a report contradict each other."""
    for name, photograph in record.registered.items():
        if photograph.camera not in record.cameras:
            raise ReportError(f"damaged, photographs.{name}: its camera {photograph.camera!r} is none of the cameras")
        for key in ("position_map_m", "rotation_camera_from_map", "omega_phi_kappa_deg"):
            if getattr(photograph, key) is None:
                raise ReportError(f"damaged, photographs.{name}: it is registered, but {key} is not in it")
    errors = record.diagnosis and record.diagnosis.ground_errors
    if errors:
        count = {len(errors.position_map_m), len(errors.sigma_m), len(errors.factor_m)}
        ranks = {len(row) for factor in errors.factor_m for row in factor}
        if len(count) > 1 or len(ranks) > 1:
            raise ReportError("damaged, diagnosis.ground_errors: its lists are not of one length")
