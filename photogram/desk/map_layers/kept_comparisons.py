"""Comparisons of a survey that are kept with it: a folder each in `comparisons/` beside the project file.

A folder holds what `photogram compare` writes, the outlines that were chosen, and what was asked (`asked.json`).
"""

import re
from collections.abc import Sequence
from pathlib import Path
from threading import Lock, Thread

import numpy as np
from typing_extensions import TypedDict

from photogram import __version__
from photogram.change.surface_change import SurfaceRequest, compare_surfaces
from photogram.desk.kept_measurements import KeptMeasurement, KeptMeasurements
from photogram.desk.map_layers.asked import Asked, checked, request_of
from photogram.desk.map_layers.layers import Layer
from photogram.desk.map_layers.told import Told, command_of, in_words, other_layers, told_of
from photogram.desk.measurements import OUTLINES
from photogram.errors import PhotogramError, SettingError, WorkspaceError
from photogram.files.atomic import make_folder
from photogram.files.maps.measurement_files import StoredMeasurement, write_measurements
from photogram.files.npz_json import read_json_as, write_json
from photogram.languages.said import Said
from photogram.volumes.surfaces import surface_path
from photogram.wording import printable

FOLDER, ASKED, POLYGONS, STABLE = "comparisons", "asked.json", "outlines.gpkg", "stable.gpkg"
DIFFERENCE, SIGMA, CHANGES = "difference.tif", "difference_sigma.tif", "change.tif"
WRITTEN = (
    DIFFERENCE, SIGMA, CHANGES, "change.tif.aux.xml", "volumes.csv", "comparison.json", "comparison.png", POLYGONS,
    STABLE, ASKED,
)  # fmt: skip
"""All that a folder holds: nothing else is ever removed."""

SHOWN = (DIFFERENCE, SIGMA, CHANGES)
MOST = 200
OTHER = "other"
"""Folder within the address of a comparison for the rasters of the other survey."""


class _Record(TypedDict):
    asked: Asked
    surfaces: list[str]
    mark: str
    command: str
    told: Told | None
    problem: str


class ComparisonView(TypedDict):
    """A comparison that is kept."""

    name: str
    """Of its folder."""
    asked: Asked
    told: Told | None
    """None where it was not finished."""
    problem: str
    """Why it could not be made; empty where it could."""
    is_outdated: bool
    """Whether one of the surfaces has changed since."""
    command: str
    """What does the same in a terminal."""
    other_layers: list[Layer]
    """Rasters of the other survey that can be laid beside, by their addresses below that of the comparison."""


class Progressed(TypedDict):
    """What is being compared."""

    name: str | None
    """None where nothing is."""
    text: str
    done: int
    total: int


class ComparisonsView(TypedDict):
    """All comparisons, and the one that is being made."""

    comparisons: list[ComparisonView]
    under_way: Progressed


class KeptComparisons:
    """The comparisons of a survey in a folder. May be asked from several threads at once; one is made at a time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / FOLDER
        self._lock = Lock()
        self._under_way: Progressed = _nothing()

    def view(self) -> ComparisonsView:
        """Return all of them, the last one first. Raises WorkspaceError where one is damaged."""
        under_way = self._under_way  # before the records: what ends meanwhile is asked for once more
        kept = [self._view(name, name == under_way["name"]) for name in reversed(self._names())]
        return {"comparisons": kept, "under_way": under_way}

    def start(self, asked: Asked, results: Path, measured: KeptMeasurements) -> None:
        """Begin to compare, in a thread. Raises SettingError or ProjectError for what cannot be compared,
        WorkspaceError where another one is being made or the folder cannot be written."""
        other, kept = checked(asked), measured.all()
        files = {POLYGONS: _outlines(kept, asked["outlines"]), STABLE: _outlines(kept, asked["stable"])}
        with self._lock:
            if self._under_way["name"] is not None:
                raise WorkspaceError(Said("another comparison is being made: wait for its end"))
            name = self._new_name(other)
            folder = self._folder / name
            paths = {file: folder / file if outlines else None for file, outlines in files.items()}
            request = request_of(asked, results, paths[POLYGONS], paths[STABLE])
            surfaces = [str(surface_path(path)) for path in (request.later, request.earlier) if path is not None]
            make_folder(folder)
            for file, outlines in files.items():
                if outlines:
                    write_measurements(folder / file, outlines, measured.crs)
            record: _Record = {
                "asked": asked,
                "surfaces": surfaces,
                "mark": _mark(surfaces),
                "command": command_of(request, folder),
                "told": None,
                "problem": "",
            }
            write_json(folder / ASKED, record)
            self._under_way = {"name": name, "text": "reading", "done": 0, "total": 0}
        Thread(target=self._make, args=(name, request, record), name="comparison", daemon=True).start()

    def remove(self, name: str) -> None:
        """Remove one, with what it wrote alone. Raises WorkspaceError where there is none, or it is being made."""
        folder = self._folder / self._known(name)
        if self._under_way["name"] == name:
            raise WorkspaceError(Said("it is being made: wait for its end"))
        try:
            for file in WRITTEN:
                (folder / file).unlink(missing_ok=True)
            folder.rmdir()
        except OSError as error:
            said = Said(
                "{folder}: cannot be removed ({reason}): see what else lies in it", folder=folder, reason=error.strerror
            )
            raise WorkspaceError(said) from error

    def file(self, name: str, file: str) -> Path:
        """Return a raster that the map draws: ``file`` is one of SHOWN, or ``other/`` and the name of a layer of the
        other survey. Raises WorkspaceError for all else."""
        record = self._record(self._known(name))
        known = {shown: self._folder / name / shown for shown in SHOWN}
        known |= {f"{OTHER}/{layer['name']}": path for layer, path in other_layers(record["asked"])}
        path = known.get(file)
        if path is None or not path.is_file():
            raise WorkspaceError(Said("{file}: no raster of this comparison: compare again", file=printable(file)))
        return path

    def _names(self) -> list[str]:
        if not self._folder.is_dir():
            return []
        return sorted(path.parent.name for path in self._folder.glob(f"*/{ASKED}"))

    def _known(self, name: str) -> str:
        if name not in self._names():
            raise WorkspaceError(
                Said("{name}: no comparison is called so: another page has removed it", name=repr(printable(name)))
            )
        return name

    def _new_name(self, other: Path) -> str:
        if len(self._names()) >= MOST:
            raise SettingError("comparisons", Said("{most} are kept at most: remove some first", most=MOST))
        used = [path.name for path in self._folder.iterdir()] if self._folder.is_dir() else []
        number = 1 + max((int(n[:3]) for n in used if re.match(r"\d{3}_", n)), default=0)
        return f"{number:03d}_{re.sub(r'[^A-Za-z0-9_-]+', '_', other.stem)[:40]}"

    def _record(self, name: str) -> _Record:
        return read_json_as(self._folder / name / ASKED, _Record)

    def _view(self, name: str, is_under_way: bool) -> ComparisonView:
        record = self._record(name)
        told, problem = record["told"], record["problem"]
        if told is None and not problem and not is_under_way:
            problem = "It was interrupted: compare again."
        return {
            "name": name,
            "asked": record["asked"],
            "told": None if told is None else in_words(told),
            "problem": problem,
            "is_outdated": told is not None and record["mark"] != _mark(record["surfaces"]),
            "command": record["command"],
            "other_layers": [layer for layer, _ in other_layers(record["asked"])],
        }

    def _make(self, name: str, request: SurfaceRequest, record: _Record) -> None:
        def progress(done: int, total: int, text: str) -> None:
            self._under_way = {"name": name, "text": text, "done": done, "total": total}

        folder = self._folder / name
        try:
            change = compare_surfaces(request, folder, progress)
            record["told"] = told_of(change, record["asked"], folder / DIFFERENCE)
        except PhotogramError as error:
            record["problem"] = printable(str(error))
        finally:
            write_json(folder / ASKED, record)
            self._under_way = _nothing()


def _nothing() -> Progressed:
    return {"name": None, "text": "", "done": 0, "total": 0}


def _outlines(kept: Sequence[KeptMeasurement], numbers: Sequence[int]) -> list[StoredMeasurement]:
    """Return kept outlines by their numbers, under names that are all different."""
    chosen = list[StoredMeasurement]()
    for number in dict.fromkeys(numbers):
        if not 0 <= number < len(kept) or kept[number]["kind"] not in OUTLINES:
            raise SettingError(
                "outlines", Said("there is no outline {number}: another page has removed it", number=number + 1)
            )
        item = kept[number]
        name = item["name"]
        if name in [other.name for other in chosen]:
            name = f"{name} ({number + 1})"
        corners = np.array(item["corners_map_m"], dtype=np.float64)
        chosen.append(StoredMeasurement(name, item["kind"], corners, True, "", ""))
    return chosen


def _mark(surfaces: Sequence[str]) -> str:
    """Return what tells the files of two surfaces from others of their names."""
    marks = [__version__]
    for path in map(Path, surfaces):
        status = path.stat() if path.is_file() else None
        marks.append("none" if status is None else f"{status.st_size} {status.st_mtime_ns}")
    return "; ".join(marks)
