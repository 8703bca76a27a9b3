"""Measurements of a survey that are kept with it, in `measurements.gpkg` beside the project file.

Each holds for the surface that it was measured on: where that has changed since it is measured again.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from photogram import __version__
from photogram.desk.measurements import KINDS, OUTLINES, Figure, Kind, Measurement, measure, note_of
from photogram.errors import PhotogramError, ProjectError, SettingError
from photogram.files.maps.measurement_files import StoredMeasurement, read_measurements, write_measurements
from photogram.files.npz_json import file_fingerprint
from photogram.languages.said import Said
from photogram.report.kept_measurements import FILE, surface_mark
from photogram.result_files import result_path
from photogram.volumes.surfaces import SURFACE

MOST = 500
LONGEST_NAME = 100


class KeptMeasurement(TypedDict):
    """A measurement with its name; what was measured is None where it no longer can be, and the problem says why."""

    name: str
    kind: Kind
    corners_map_m: list[list[float]]
    measurement: Measurement | None
    problem: str


class _Record(TypedDict):
    surface: str
    measurement: Measurement | None
    problem: str


@dataclass(frozen=True)
class KeptMeasurements:
    """The measurements of a survey in a map grid ``crs``."""

    path: Path
    results: Path
    crs: str

    def all(self) -> list[KeptMeasurement]:
        """Return them, measured anew where the surface has changed. Raises ProjectError where their file is damaged."""
        stored = read_measurements(self.path, self.crs) if self.path.is_file() else []
        if not stored:
            return []
        mark, kept, fresh = self._mark(), list[KeptMeasurement](), True
        for item in stored:
            record = _record_of(item.record)
            if record is None or record["surface"] != mark:
                fresh, kept = False, [*kept, self._measured(item.name, _kind(item.kind), item.corners_map_m.tolist())]
            else:
                corners = item.corners_map_m.tolist()
                kept.append(
                    _kept(item.name, _kind(item.kind), corners, _in_words(record["measurement"]), record["problem"])
                )
        if not fresh:
            self._write(kept, mark)
        return kept

    def add(
        self, kind: Kind, corners_map_m: Sequence[Sequence[float]], title: str | None = None
    ) -> list[KeptMeasurement]:
        """Measure, keep it under ``title`` (its kind) and a number, and return all. Raises as ``measure``, and
        SettingError where there are too many."""
        kept = self.all()
        if len(kept) >= MOST:
            raise SettingError("measurements", Said("{most} are kept at most: remove some first", most=MOST))
        result = measure(self.results, kind, corners_map_m)
        number = 1 + sum(item["kind"] == kind for item in kept)
        names = {item["name"] for item in kept}
        title = title if title and title.isprintable() else kind.capitalize()
        name = next(name for name in (f"{title} {number + k}" for k in range(MOST + 1)) if name not in names)
        kept.append(_kept(name, kind, result["corners_map_m"], result, ""))
        self._write(kept, self._mark())
        return kept

    def rename(self, number: int, name: str) -> list[KeptMeasurement]:
        """Give one another name, and return all. Raises SettingError for a name that cannot be, or where there is no
        such measurement."""
        kept = self.all()
        name = name.strip()
        if not 0 < len(name) <= LONGEST_NAME or not name.isprintable():
            raise SettingError("name", Said("a name has up to {most} characters on one line", most=LONGEST_NAME))
        self._check(number, kept)
        kept[number]["name"] = name
        self._write(kept, self._mark())
        return kept

    def remove(self, number: int) -> list[KeptMeasurement]:
        """Remove one, and return the others. Raises SettingError where there is no such measurement."""
        kept = self.all()
        self._check(number, kept)
        del kept[number]
        self._write(kept, self._mark())
        return kept

    def _check(self, number: int, kept: Sequence[KeptMeasurement]) -> None:
        if not 0 <= number < len(kept):
            raise SettingError(
                "number", Said("there is no measurement {number}: another page has removed it", number=number + 1)
            )

    def _mark(self) -> str:
        """Return what tells one surface, and how it is measured on, from another."""
        path = result_path(self.results, SURFACE)
        if not path.is_file():
            raise ProjectError(Said("there is no surface to measure on: run the survey first"))
        status = path.stat()
        return surface_mark(__version__, _content(path, status.st_size, status.st_mtime_ns))

    def _measured(self, name: str, kind: Kind, corners: list[list[float]]) -> KeptMeasurement:
        try:
            return _kept(name, kind, corners, measure(self.results, kind, corners), "")
        except PhotogramError as error:
            return _kept(name, kind, corners, None, str(error))

    def _write(self, kept: Sequence[KeptMeasurement], mark: str) -> None:
        stored = [
            StoredMeasurement(
                item["name"],
                item["kind"],
                np.array(item["corners_map_m"], dtype=np.float64).reshape(-1, 2),
                item["kind"] in OUTLINES,
                _words(item["measurement"]),
                json.dumps({"surface": mark, "measurement": item["measurement"], "problem": item["problem"]}),
            )
            for item in kept
        ]
        write_measurements(self.path, stored, self.crs)


@lru_cache(maxsize=16)
def _content(path: Path, _bytes: int, _changed_unix_ns: int) -> str:
    """Return the SHA-256 of a file, read once for each version of it."""
    return file_fingerprint(path)


def _kept(
    name: str, kind: Kind, corners: list[list[float]], measurement: Measurement | None, problem: str
) -> KeptMeasurement:
    return {"name": name, "kind": kind, "corners_map_m": corners, "measurement": measurement, "problem": problem}


def _in_words(measurement: Measurement | None) -> Measurement | None:
    """Return a measurement as it is read from its file, with what it says as messages."""
    if measurement is None:
        return None
    figures: list[Figure] = [{**figure, "name": Said(figure["name"])} for figure in measurement["figures"]]
    note = note_of(measurement["kind"], figures, measurement["profile"])
    return {**measurement, "figures": figures, "note": note}


def _kind(text: str) -> Kind:
    for kind in KINDS:
        if kind == text:
            return kind
    raise ProjectError(
        f"measurements: {text!r} is nothing that is measured here: move {FILE} away to begin without any"
    )


def _record_of(text: str) -> _Record | None:
    try:
        record: _Record = json.loads(text)
    except ValueError:
        return None
    return record if isinstance(record, dict) and set(record) == set(_Record.__annotations__) else None


def _words(measurement: Measurement | None) -> str:
    if measurement is None:
        return ""
    parts = []
    for figure in measurement["figures"]:
        if figure["value"] is not None:
            sigma = "" if figure["sigma"] is None else f" ± {figure['sigma']:.4g}"
            parts.append(f"{figure['name']} {figure['value']:.3f}{sigma} {figure['unit']}")
    return "; ".join(parts)
