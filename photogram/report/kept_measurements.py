"""Measurements that were made on the page of a survey, and are kept with it, for its report.

Nothing is measured here: the figures are those that the page has kept, with the surface that they hold for.
"""

import json
from collections.abc import Sequence
from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from typing_extensions import TypedDict

from photogram.errors import ProjectError
from photogram.files.maps.measurement_files import StoredMeasurement, read_measurements
from photogram.report.record.measurements import MeasuredFigureRecord, MeasuredKind, MeasurementRecord
from photogram.report.record.verdict import DeliverableRecord
from photogram.wording import shortened

FILE = "measurements.gpkg"
"""Beside the project file."""
SURFACE = "dsm.tif"


class _Measured(TypedDict):
    figures: list[MeasuredFigureRecord]
    note: str


class _Kept(TypedDict):
    surface: str
    measurement: _Measured | None
    problem: str


_KEPT, _KIND = TypeAdapter(_Kept), TypeAdapter[MeasuredKind](MeasuredKind)


def surface_mark(version: str, sha256: str) -> str:
    """Return what tells one surface, and the version that measured on it, from another."""
    return f"{version} {sha256}"


def measurement_records(path: Path, crs: str, deliverables: Sequence[DeliverableRecord]) -> list[MeasurementRecord]:
    """Return the measurements in a file of a survey in ``crs``, whose ``deliverables`` say which surface it has; none
    without the file. Raises ProjectError where it is damaged."""
    if not path.is_file():
        return []
    surface = next((one["sha256"] for one in deliverables if one["file"].rpartition("/")[2] == SURFACE), None)
    return [_record(path, stored, surface) for stored in read_measurements(path, crs)]


def _record(path: Path, stored: StoredMeasurement, surface: str | None) -> MeasurementRecord:
    try:
        kept, kind = _KEPT.validate_python(json.loads(stored.record)), _KIND.validate_python(stored.kind)
    except (ValueError, ValidationError) as error:
        raise ProjectError(
            f"measurements {path}: what is kept of {shortened(stored.name)!r} is damaged: open the survey with "
            "photogram desk, which measures it again"
        ) from error
    measured = kept["measurement"]
    return {
        "name": stored.name,
        "kind": kind,
        "corners_map_m": stored.corners_map_m.tolist(),
        "figures": [] if measured is None else measured["figures"],
        "note": "" if measured is None else measured["note"],
        "problem": kept["problem"],
        "is_current": surface is not None and kept["surface"].rpartition(" ")[2] == surface,
    }
