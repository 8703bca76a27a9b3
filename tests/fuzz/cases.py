"""What is done with a spoilt input, and what must hold where it is not refused."""

import csv
import io
import re
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np
from mutations import spoil_bytes, spoil_json, spoil_text

from photogram.cli.main import main
from photogram.errors import PhotogramError
from photogram.files.arrays import read_npz
from photogram.files.clouds.described_points import read_described
from photogram.files.clouds.points import read_cloud
from photogram.files.maps.rasters import read_raster
from photogram.files.photographs.headers import read_headers
from photogram.files.photographs.images import check_photograph, inspect_photograph, read_grey
from photogram.files.tables.control_files import read_marks, read_points
from photogram.files.tables.position_tables import read_positions
from photogram.pipeline.input_validation import check_project
from photogram.project.draft.draft import LeftOut, TaggedPhotograph, Wishes, draft_project
from photogram.project.draft.text import project_text
from photogram.quality.asprs import ReportSettings
from photogram.report.numbers.completion import complete
from photogram.report.page import report_page
from photogram.report.reading import making_of, read_report
from photogram.report.view.viewer import view_page
from photogram.simulation.planning.flight_file import flight_plan


class SilenceError(AssertionError):
    """An input was used although a part of it was lost, and nobody said so."""


@dataclass(frozen=True)
class Bench:
    """Where cases are run: sound inputs in ``corpus``, a survey that is not adjusted, and a folder for spoilt files."""

    corpus: Path
    survey: Path
    folder: Path


@dataclass(frozen=True)
class Case:
    """One spoilt file, ``path``, made of the ``sound`` one; ``was_cut``: it was cut off, and nothing else."""

    bench: Bench
    path: Path
    sound: Path
    was_cut: bool


@dataclass(frozen=True)
class Target:
    """One way in: files of the corpus by name, how they are spoilt, and what reads them.

    ``share`` is how often it is tried beside the others.
    """

    seeds: tuple[str, ...]
    spoil: Callable[[bytes, Random], bytes]
    use: Callable[[Case], None]
    share: int = 1


def _same(sound: np.ndarray, read: np.ndarray, what: str) -> None:
    if not np.array_equal(sound, read, equal_nan=True):
        raise SilenceError(f"{what}: {len(read)} of {len(sound)} read from a file that was cut off")


# ---- texts ---------------------------------------------------------------------------------------------------------


def _rows(data: bytes) -> list[str]:
    lines = re.split(r"\r\n|\n|\r", data.decode("utf-8-sig"))
    return [line for line in lines if line.strip() and not line.lstrip().startswith("#")]


def _filled(rows: list[str]) -> int:
    separator = next((s for s in (";", "\t", ",") if s in rows[0]), ",")
    read = csv.reader(io.StringIO("\n".join(rows[1:])), delimiter=separator, skipinitialspace=True)
    return sum(any(field.strip() for field in row) for row in read)


def points(case: Case) -> None:
    """Read ground points; every row is one, or one mark."""
    file, rows = read_points(case.path), _rows(case.path.read_bytes())
    if file.holds_marks:
        number = len(rows) - (0 if re.match(r"\s*[-+]?[\d.]", rows[0]) else 1)
        if len(file.marks) != number:
            raise SilenceError(f"{len(file.marks)} marks of {number} rows")
    elif len(file.points) != _filled(rows):
        raise SilenceError(f"{len(file.points)} points of {_filled(rows)} rows")


def marks(case: Case) -> None:
    """Read image marks; every row is one."""
    number = len(read_marks(case.path))
    if number != _filled(_rows(case.path.read_bytes())):
        raise SilenceError(f"{number} marks of {_filled(_rows(case.path.read_bytes()))} rows")


def positions(case: Case) -> None:
    """Read positions of photographs."""
    read_positions(case.path)


def flight(case: Case) -> None:
    """Read a flight that is to be predicted."""
    flight_plan(case.path, {})


def project(case: Case) -> None:
    """Check a survey by its project file."""
    target = case.bench.survey / "project.yaml"
    target.write_bytes(case.path.read_bytes())
    for finding in check_project(target):
        str(finding)


def check(case: Case) -> None:
    """Check a survey with the command."""
    target = case.bench.survey / "project.yaml"
    target.write_bytes(case.path.read_bytes())
    run_command("check", str(target))


def run_command(*arguments: str) -> None:
    """Run a command, which must end with 0, 1 or 2."""
    sys.argv = ["photogram", *arguments]
    try:
        main()
    except SystemExit as end:
        if end.code not in (None, 0, 1, 2):
            raise AssertionError(f"exit code {end.code}") from end


# ---- photographs ---------------------------------------------------------------------------------------------------


def picture(case: Case) -> None:
    """Read a photograph and its tags."""
    tags = inspect_photograph(case.path)
    check_photograph(case.path, (tags.width_px or 0, tags.height_px or 0))
    grey = read_grey(case.path)
    if case.was_cut:
        _same(read_grey(case.sound), grey, "rows of pixels")


def neighbours(case: Case) -> None:
    """Draft a project of three sound photographs and the spoilt one, which must not end it."""
    paths = [case.bench.corpus / f"DJI_{number:04d}.JPG" for number in (0, 2, 3)] + [case.path]
    with ThreadPoolExecutor(1) as executor:
        headers = read_headers(paths, executor)
    tagged = [TaggedPhotograph(h.name, h.tags) for h in headers if h.tags is not None]
    unreadable = [LeftOut(h.name, h.error) for h in headers if h.tags is None]
    try:
        draft = draft_project(tagged, unreadable, Wishes())
    except PhotogramError as error:
        raise AssertionError(f"one damaged photograph ends the draft: {error}") from error
    text = project_text(draft, "photographs")
    sound_names = {p.name for p in paths[:3]}
    if not sound_names <= {p.name for p in draft.photographs}:
        raise AssertionError("a sound photograph is left out beside the damaged one")
    if any(ord(c) < 32 and c != "\n" for c in text):
        raise AssertionError("the drafted project file holds control characters")


# ---- binary files --------------------------------------------------------------------------------------------------


def cloud(case: Case) -> None:
    """Read a point cloud, both ways."""
    read = read_cloud(case.path)
    if case.path.suffix != ".txt":
        read_described(case.path)
        if case.was_cut:
            _same(read_cloud(case.sound).position_map_m, read.position_map_m, "points")
    if not np.isfinite(read.position_map_m).all():
        raise AssertionError("positions that are not finite")


def raster(case: Case) -> None:
    """Read a GeoTIFF."""
    read, _ = read_raster(case.path)
    if case.was_cut:
        _same(read_raster(case.sound)[0].values, read.values, "rows")


def arrays(case: Case) -> None:
    """Read the arrays of a stage."""
    try:
        read = read_npz(case.path)
    except OSError as error:
        raise PhotogramError(str(error)) from error
    if case.was_cut:
        raise SilenceError(f"arrays {sorted(read)} read from a file that was cut off")


# ---- the report ----------------------------------------------------------------------------------------------------


def report(case: Case) -> None:
    """Make the page of a report again."""
    numbers = read_report(case.path)
    with making_of(case.path):
        report_page(complete(numbers, ReportSettings()), [])


def view(case: Case) -> None:
    """Make the view of a report."""
    report = read_report(case.path)
    described = read_described(case.bench.corpus / "cloud.laz")
    with making_of(case.path):
        view_page(described, report, "cloud.laz", 1000)


def _spoil_picture(data: bytes, random: Random) -> bytes:
    """Spoil the bytes of a photograph, or a value of its XMP."""
    begin, end = data.find(b"<x:xmpmeta"), data.find(b"</x:xmpmeta>")
    if begin < 0 or random.random() < 0.5:
        return spoil_bytes(data, random)
    packet = data[begin:end]
    values = list(re.finditer(rb'="([^"]*)"', packet))
    value = random.choice(values)
    fresh = spoil_text(value[1], random)[: value.end(1) - value.start(1)].ljust(value.end(1) - value.start(1))
    if random.random() < 0.1:
        packet = b'<?xml version="1.0" encoding="klingon"?>'.ljust(len(packet))[: len(packet)]
        return data[:begin] + packet + data[end:]
    packet = packet[: value.start(1)] + fresh + packet[value.end(1) :]
    return data[:begin] + packet + data[end:]


JPEGS = ("DJI_0001.JPG",)
TARGETS: dict[str, Target] = {
    "points": Target(("gcp_list.txt", "points.csv"), spoil_text, points, 3),
    "marks": Target(("marks.csv",), spoil_text, marks, 2),
    "positions": Target(("flight_Timestamp.MRK", "events.pos", "positions.csv"), spoil_text, positions, 4),
    "flight": Target(("flight.yaml",), spoil_text, flight, 2),
    "project": Target(("project.yaml",), spoil_text, project, 4),
    "check": Target(("project.yaml",), spoil_text, check, 1),
    "picture": Target((*JPEGS, "picture.tif", "plain.tif", "picture.png"), _spoil_picture, picture, 4),
    "neighbours": Target((*JPEGS, *JPEGS, "plain.tif"), _spoil_picture, neighbours, 4),
    "cloud": Target(("cloud.laz", "cloud_2.las", "cloud_4.las"), spoil_bytes, cloud, 4),
    "cloud text": Target(("cloud.txt",), spoil_text, cloud, 1),
    "raster": Target(("surface.tif",), spoil_bytes, raster, 3),
    "arrays": Target(("arrays.npz",), spoil_bytes, arrays, 2),
    "report": Target(("report.json",), spoil_json, report, 3),
    "view": Target(("report.json",), spoil_json, view, 2),
}
CUT = ("picture", "cloud", "raster", "arrays", "points", "report", "project")
"""Targets whose files are cut off too."""
