"""Files around a survey that are spoilt: triangulations, polygons, measurements, masks, marks, their journal, grids of
geoids and local CRS, cameras of MATLAB, uploads of a node, what `photogram verify` reads."""

import asyncio
import shutil
from pathlib import Path
from random import Random

import numpy as np
from cases import Case, Target
from mutations import spoil_any, spoil_bytes, spoil_text
from starlette.requests import Request

from photogram.errors import PhotogramError
from photogram.files.maps.measurement_files import read_measurements
from photogram.files.maps.polygon_files import read_polygons
from photogram.files.maps.seam_files import read_seams
from photogram.files.marks import formats, mark_table
from photogram.files.matlab import read_camera
from photogram.files.photographs.masks import find_masks, read_mask
from photogram.files.triangulations.reading import read_triangulation, reader_of
from photogram.local_grids.site_pairs import read_pairs
from photogram.marking.files.actions import state_of
from photogram.marking.files.journal import read_journal
from photogram.node.forms import received_form
from photogram.node.options import checked_options
from photogram.node.received import Room
from photogram.node.refusals import RequestError
from photogram.pipeline.input_validation import check_project
from photogram.verification.check import verify_report

CRS = "EPSG:25832"
BOUNDARY = "boundary0123"


def triangulation(case: Case) -> None:
    """Read a LandXML or a drawing, whole and by its parts."""
    parts = reader_of(case.path).parts(case.path)
    surface = read_triangulation(case.path, tuple(parts)[:1])
    if not np.isfinite(surface.corner).all():
        raise AssertionError("corners that are not finite")


def polygons(case: Case) -> None:
    """Read polygons."""
    for each in read_polygons(case.path, CRS):
        if not np.isfinite(each.polygon.area):
            raise AssertionError("an area that is not finite")


def measurements(case: Case) -> None:
    """Read what was measured on the page."""
    read_measurements(case.path, CRS)


def seams(case: Case) -> None:
    """Read the seams of an orthophoto that somebody has moved."""
    read_seams(case.path, ["DJI_0001.JPG", "DJI_0002.JPG"], CRS)


def mask(case: Case) -> None:
    """Read a mask."""
    find_masks(case.path.parent, ["spoilt.JPG"])
    read_mask(case.path, (120, 90))


def journal(case: Case) -> None:
    """Read a journal of marks."""
    path = case.path if case.path.suffix == ".sqlite" else case.path.with_suffix(".sqlite")
    state_of(read_journal(path))


def table(case: Case) -> None:
    """Read the table of marks."""
    mark_table.read_marks(case.path)


def foreign_marks(case: Case) -> None:
    """Read marks and points of any format."""
    formats.read_marks(case.path)
    if case.path.suffix == ".xml":
        formats.read_points(case.path)


def pairs(case: Case) -> None:
    """Read pairs of local and geodetic coordinates."""
    read_pairs(case.path)


def camera(case: Case) -> None:
    """Read a camera that MATLAB has calibrated."""
    read_camera(case.path, "P4", 5472, 3648, "photogram")


def _checked(case: Case, name: str, lines: str) -> None:
    """Check the survey with lines in its project file that name the spoilt file ``name``."""
    survey = case.bench.survey
    text = (case.bench.corpus / "project.yaml").read_text(encoding="utf-8")
    keys = tuple(line.split(":")[0] + ":" for line in lines.splitlines() if line and line[0] != " ")
    kept, skipping = [], False
    for line in text.splitlines():
        skipping = line.startswith(keys) or (skipping and line[:1] in (" ", "#", "-", ""))
        if not skipping:
            kept.append(line)
    (survey / "project.yaml").write_text("\n".join([*kept, lines]), encoding="utf-8")
    shutil.copy(case.path, survey / name)
    try:
        for finding in check_project(survey / "project.yaml"):
            str(finding)
    finally:
        (survey / name).unlink()


def geoid(case: Case) -> None:
    """Check a survey whose heights are above a geoid of a spoilt grid."""
    name = f"geoid{case.path.suffix}"
    _checked(case, name, f"heights: {{output: ellipsoidal, control_points: orthometric, geoid: {name}}}\n")


def local_grid(case: Case) -> None:
    """Check a survey in the CRS of a spoilt file."""
    _checked(case, "site.wkt2", "crs: site.wkt2\n")


def known_surface(case: Case) -> None:
    """Check a survey on a spoilt height model."""
    _checked(case, "ground.tif", "known_surface: {path: ground.tif, sigma_m: 0.1}\n")


def verify(case: Case) -> None:
    """Derive a report again, a file of the results being spoilt."""
    root = case.bench.corpus / "results"
    folder = case.bench.folder.with_name("verified")
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(root, folder)
    (folder / case.sound.relative_to(root)).write_bytes(case.path.read_bytes())
    try:
        verify_report(folder)
    except ValueError as error:  # which the command takes for a file that is damaged
        raise PhotogramError(str(error)) from error


def options(case: Case) -> None:
    """Read the options of a task of a node."""
    try:
        checked_options(case.path.read_text(encoding="utf-8", errors="replace"))
    except RequestError as error:
        raise PhotogramError(str(error)) from error


def form(case: Case) -> None:
    """Receive a form with files."""
    folder = case.bench.folder.with_name("received")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    try:
        asyncio.run(_received(case.path.read_bytes(), folder))
    except RequestError as error:
        raise PhotogramError(str(error)) from error
    outside = [path for path in folder.rglob("*") if not path.resolve().is_relative_to(folder.resolve())]
    if outside:
        raise AssertionError(f"files outside of the folder: {outside}")


async def _received(data: bytes, folder: Path) -> None:
    pieces = [data[begin : begin + 1000] for begin in range(0, len(data), 1000)]
    sent = [{"type": "http.request", "body": piece, "more_body": True} for piece in pieces]
    sent += [{"type": "http.request", "body": b"", "more_body": False}, {"type": "http.disconnect"}]

    async def receive() -> dict[str, object]:
        return sent.pop(0)

    headers = [(b"content-type", f"multipart/form-data; boundary={BOUNDARY}".encode())]
    await received_form(Request({"type": "http", "method": "POST", "headers": headers}, receive), folder, Room(10**9))


def _spoil_journal(data: bytes, random: Random) -> bytes:
    return spoil_bytes(data, random) if data.startswith(b"SQLite") else spoil_text(data, random)


TARGETS = {
    "triangulation": Target(("surface.xml", "surface.dxf"), spoil_text, triangulation, 2),
    "polygons": Target(("heaps.gpkg", "heaps.geojson"), spoil_any, polygons, 2),
    "measurements": Target(("measurements.gpkg",), spoil_bytes, measurements),
    "seams": Target(("seams.gpkg", "seams.geojson"), spoil_any, seams),
    "mask": Target(("mask.png", "mask.tif", "mask.jpg"), spoil_bytes, mask),
    "journal": Target(("journal.sqlite", "journal.jsonl"), _spoil_journal, journal, 2),
    "table of marks": Target(("table/marks.csv",), spoil_text, table),
    "foreign marks": Target(("markers.xml", "pix4d_marks.csv"), spoil_text, foreign_marks, 2),
    "pairs": Target(("pairs.csv",), spoil_text, pairs),
    "camera": Target(("camera.mat",), spoil_bytes, camera),
    "geoid": Target(("geoid.gtx",), spoil_bytes, geoid),
    "local grid": Target(("site.wkt2",), spoil_text, local_grid),
    "known surface": Target(("ground.tif",), spoil_bytes, known_surface),
    "verify": Target(
        ("results/quality/report.json", "results/technical/observations.npz", "results/quality/checksums.sha256"),
        spoil_any, verify, 3,
    ),
    "options": Target(("options.json",), spoil_any, options),
    "form": Target(("form.bin",), spoil_bytes, form, 2),
}  # fmt: skip
