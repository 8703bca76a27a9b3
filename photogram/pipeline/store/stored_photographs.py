"""Photographs as the stage `photographs` has stored them: measured, before there are tie points."""

from dataclasses import dataclass, replace
from pathlib import Path

from typing_extensions import TypedDict

from photogram.arrays import IntArray
from photogram.files.records import read_record, write_record
from photogram.geodesy.frames import LocalFrame
from photogram.project.measured.measured_block import MeasuredPhotographs
from photogram.project.project import Project
from photogram.survey import Photograph


class StoredFrame(TypedDict):
    """The frame that they lie in, as ``frame.json`` holds it."""

    origin_map_m: tuple[float, float, float]
    """Its origin."""
    placed_by: str
    """Fingerprint of the control coordinates that helped to choose it."""


@dataclass(frozen=True, eq=False)
class StoredPhotographs:
    """Photographs as measured, without their files, and of which each is a copy: see MeasuredPhotographs."""

    photographs: tuple[Photograph, ...]
    original: IntArray


def write_measured(path: Path, measured: MeasuredPhotographs) -> None:
    """Write measured photographs, whose frame and files are stored elsewhere."""
    photographs = tuple(replace(photograph, path=None) for photograph in measured.photographs)
    write_record(path, StoredPhotographs(photographs, measured.original))


def read_measured(path: Path, project: Project, origin_map_m: tuple[float, float, float]) -> MeasuredPhotographs:
    """Return the photographs that ``write_measured`` wrote, in the frame of the project that has this origin."""
    frame = LocalFrame(project.crs, origin_map_m, project.world_kind, project.heights.map_geoid)
    stored = read_record(path, StoredPhotographs)
    photographs = tuple(
        replace(photograph, name=source.name, camera=source.camera, path=source.path, flight=source.flight)
        for photograph, source in zip(stored.photographs, project.photographs, strict=True)
    )
    return MeasuredPhotographs(frame, photographs, stored.original)
