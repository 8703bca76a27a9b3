"""flight.yaml: a flight that is to be predicted, as a surveyor writes it down.

Read and checked as project.yaml is: every error at once, with its line.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import create_model

from photogram.errors import ProjectError
from photogram.project.document import Document, Entry, read_entry
from photogram.project.schema import Freedom, MarkSigma, OffsetSigma, Place, PositionSigma
from photogram.projection import CAMERA_PARAMETERS
from photogram.simulation.planning.flight_plan import RANGES, Calibration, FlightPlan, Gnss, Layout

Side = Annotated[float, RANGES["width_m"]]
Size = Annotated[int, RANGES["width_px"]]
Share = Annotated[float, RANGES["forward_overlap"]]
Strips = Annotated[int, RANGES["cross_strips"]]


class SiteEntry(Entry):
    """The rectangle that is to be surveyed."""

    width_m: Side | None = None
    length_m: Side | None = None
    relief_m: Annotated[float, RANGES["relief_m"]] | None = None


_KNOWN = {p.sigma_key: (Freedom | None, None) for p in CAMERA_PARAMETERS if p.usual}
_Calibration: type[Entry] = create_model("_Calibration", __base__=Entry, **_KNOWN)  # type: ignore[call-overload]


class CalibrationEntry(_Calibration):  # type: ignore[misc, valid-type]
    """How well the camera is known before; 0 holds a parameter, free leaves it open."""


class CameraEntry(Entry):
    """The camera; width across the direction of flight."""

    width_px: Size | None = None
    height_px: Size | None = None
    focal_px: Annotated[float, RANGES["focal_px"]] | None = None
    sigmas: CalibrationEntry = CalibrationEntry()


class FlightEntry(Entry):
    """Height, overlaps and strips."""

    gsd_m: Annotated[float, RANGES["gsd_m"]] | None = None
    flying_height_m: Annotated[float, RANGES["flying_height_m"]] | None = None
    forward_overlap: Share | None = None
    side_overlap: Share | None = None
    cross_strips: Strips | None = None
    cross_height: Annotated[float, RANGES["cross_height"]] | None = None
    oblique_strips: Strips | None = None
    oblique_angle_deg: Annotated[float, RANGES["oblique_angle_deg"]] | None = None


class GnssEntry(Entry):
    """The receiver of the drone, and the offset between it and the control points."""

    kind: Gnss | None = None
    sigma_m: PositionSigma | None = None
    offset_sigma_m: OffsetSigma | None = None


class ControlEntry(Entry):
    """The control points."""

    points: Annotated[int, RANGES["control_points"]] | None = None
    layout: Layout | None = None
    positions_m: Sequence[Place] | None = None
    sigma_m: PositionSigma | None = None
    mark_sigma_px: MarkSigma | None = None


class TiePointsEntry(Entry):
    """What matching will find."""

    per_photograph: Annotated[int, RANGES["tie_points_per_photograph"]] | None = None
    sigma_px: Annotated[float, RANGES["tie_point_sigma_px"]] | None = None
    detection: Annotated[float, RANGES["tie_point_detection"]] | None = None


class FlightFile(Entry):
    """The whole file."""

    site: SiteEntry = SiteEntry()
    camera: CameraEntry = CameraEntry()
    flight: FlightEntry = FlightEntry()
    gnss: GnssEntry = GnssEntry()
    control: ControlEntry = ControlEntry()
    tie_points: TiePointsEntry = TiePointsEntry()


_NAMES = {
    "control": {
        "points": "control_points", "layout": "control_layout", "positions_m": "control_world_m",
        "sigma_m": "control_sigma_m",
    },
    "gnss": {"kind": "gnss", "sigma_m": "gnss_sigma_m", "offset_sigma_m": "gnss_offset_sigma_m"},
    "tie_points": {
        "per_photograph": "tie_points_per_photograph", "sigma_px": "tie_point_sigma_px",
        "detection": "tie_point_detection",
    },
}  # fmt: skip
"""Keys of the file whose names in FlightPlan are others."""


PlanOptions = Mapping[str, float | str]
"""Values of fields of FlightPlan by their names."""


def _given(entry: Entry, names: dict[str, str]) -> dict[str, Any]:
    values = {name: getattr(entry, name) for name in type(entry).model_fields}
    return {names.get(k, k): v for k, v in values.items() if v is not None and not isinstance(v, Entry)}


def _settings(path: Path) -> dict[str, Any]:
    """Return what a file says of a flight, those fields of FlightPlan that are not to be as usual. Raises ProjectError
    naming every error of it."""
    document = Document(path)
    file = read_entry(document, FlightFile)
    document.raise_errors()
    settings: dict[str, Any] = {}
    for section in FlightFile.model_fields:
        settings |= _given(getattr(file, section), _NAMES.get(section, {}))
    if "control_world_m" in settings:
        settings["control_world_m"] = tuple(tuple(place) for place in settings["control_world_m"])
        settings.setdefault("control_points", 0)
    calibration = _given(file.camera.sigmas, {})
    if calibration:
        settings["calibration"] = Calibration(**calibration)
    return settings


def flight_plan(path: Path | None, options: PlanOptions) -> FlightPlan:
    """Return the plan of a file, of a usual flight without one, with what options change in it. Raises ProjectError
    naming every error of the file, and when file and options contradict each other."""
    settings = {} if path is None else _settings(path)
    if "gsd_m" in options and "flying_height_m" not in options:
        settings.pop("flying_height_m", None)
    if "flying_height_m" in options and "gsd_m" not in options:
        settings.pop("gsd_m", None)
    if "gnss" in options:
        settings.pop("gnss_sigma_m", None)
        settings.pop("gnss_offset_sigma_m", None)
    if "control_points" in options:
        settings.pop("control_world_m", None)
    try:
        return FlightPlan(**settings | dict(options))
    except ValueError as error:
        raise ProjectError(f"{path or 'photogram plan'}: {error}") from error
