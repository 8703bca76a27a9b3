"""Inputs that are broken or made to do harm: refused in one sentence, soon and in little memory, or used as they stand.

tests/fuzz tries them by the thousand; these are the ones with a name.
"""

import csv
import io
import json
import os
import re
import struct
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import laspy
import numpy as np
import pytest
import rasterio
from PIL import Image, TiffImagePlugin
from pydantic import BaseModel, PlainValidator
from rasterio.transform import from_origin
from seeds import seeds

from photogram.errors import ControlPointError, ImageError, PhotogramError, ProjectError, ReportError
from photogram.files.arrays import read_npz
from photogram.files.clouds.points import read_cloud, write_laz
from photogram.files.maps.rasters import read_raster
from photogram.files.photographs import identification
from photogram.files.photographs.images import inspect_photograph, read_grey, read_tags, write_photograph
from photogram.files.photographs.tags import PhotographTags
from photogram.files.poses import write_pose_table
from photogram.files.tables.control_files import read_marks, read_points
from photogram.files.tables.position_tables import read_positions
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.stages.stored_adjustment import stored_adjustment
from photogram.pipeline.store.run import Run as Survey
from photogram.pipeline.store.workspace import Workspace
from photogram.project.document import Document, read_entry, read_settings
from photogram.project.project import SECTIONS
from photogram.project.schema import ProjectFile
from photogram.report import page
from photogram.report.figures.style import new_figure
from photogram.report.reading import making_of, read_report
from photogram.settings.settings import Within
from photogram.simulation.planning.flight_file import FlightFile, flight_plan
from photogram.survey import PointCloud
from photogram.wording import file_stem, printable, table_cell

Run = Callable[..., Any]
CRS = "EPSG:25832"


@pytest.fixture
def soon_and_small() -> Iterator[None]:
    """The test's own work takes less than five seconds of processor time, and 200 MB."""
    tracemalloc.start()
    start = time.process_time()
    yield
    seconds, peak = time.process_time() - start, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert seconds < 5.0  # a slow machine takes one
    assert peak < 200e6


# ---- pictures ------------------------------------------------------------------------------------------------------

EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 10 10\n%%EndComments\nshowpage\n"


def pixels() -> np.ndarray[Any, Any]:
    return np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)


def test_a_postscript_file_called_jpg_starts_no_ghostscript(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a program was started")

    monkeypatch.setattr(subprocess, "check_call", refuse)
    monkeypatch.setattr(subprocess, "Popen", refuse)
    (tmp_path / "x.JPG").write_bytes(EPS)
    for read in (read_grey, inspect_photograph, read_tags):
        with pytest.raises(ImageError, match="in no known image format"):
            read(tmp_path / "x.JPG")


@pytest.mark.parametrize("kind", ["BMP", "GIF", "PPM", "WEBP", "ICO"])
def test_only_the_formats_of_photographs_are_opened(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "x.JPG"
    Image.fromarray(pixels()).save(path, kind)
    with pytest.raises(ImageError, match="in no known image format"):
        inspect_photograph(path)


def test_pillow_is_told_the_formats() -> None:
    assert set(identification.FORMATS) == {"JPEG", "TIFF", "PNG"}
    jpeg_with_more = io.BytesIO()
    first, second = Image.fromarray(pixels()), Image.fromarray(pixels()[::-1])
    first.save(jpeg_with_more, "MPO", save_all=True, append_images=[second])
    assert Image.open(jpeg_with_more, formats=identification.FORMATS).format == "MPO"


def one_bit_of_exif(content: bytes) -> bytes:
    place = content.index(b"Exif\0\0") + 6
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


def xmp_of_no_encoding(content: bytes) -> bytes:
    begin, end = content.index(b"<x:xmpmeta"), content.index(b"</x:xmpmeta>")
    return content[:begin] + b'<?xml version="1.0" encoding="klingon"?>'.ljust(end - begin) + content[end:]


def altitude(content: bytes) -> bytes:
    return content.replace(b'AbsoluteAltitude="+150.000"', b'AbsoluteAltitude="+1.0e308"')


def take_off(content: bytes) -> bytes:
    return content.replace(b'RelativeAltitude="+60.000"', b'RelativeAltitude="+1e3088"')


DAMAGE = {
    "one bit of EXIF": (one_bit_of_exif, "the EXIF tags are damaged"),
    "XMP in no encoding": (xmp_of_no_encoding, "the XMP tags are not valid XML"),
    "altitude of 1e308": (altitude, "the tags give a height of 1e+308 m"),
    "height of 1e3088": (take_off, "the tags give an impossible height above take off (inf)"),
}


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """A folder of five photographs with tags."""
    folder = tmp_path / "photographs"
    folder.mkdir()
    for n in range(5):
        tags = PhotographTags(
            make="DJI", model="X", focal_35mm_mm=24.0, longitude_deg=9.0 + 2e-4 * n, latitude_deg=52.0, height_m=150.0,
            height_above_take_off_m=60.0, gnss_sigma_m=(0.01, 0.01, 0.02), rtk_flag=50,
        )  # fmt: skip
        write_photograph(folder / f"{n}.JPG", np.roll(pixels(), n, axis=1), tags)
    return folder


@pytest.mark.parametrize("kind", DAMAGE)
def test_one_damaged_photograph_does_not_end_the_folder(flight: Path, photogram: Run, kind: str) -> None:
    change, words = DAMAGE[kind]
    content = (flight / "2.JPG").read_bytes()
    spoilt = change(content)
    assert spoilt != content
    (flight / "2.JPG").write_bytes(spoilt)
    assert words in " ".join(read_tags(flight / "2.JPG").damage)
    project = flight.parent / "project.yaml"
    outcome = photogram("init", flight, "--project", project)
    assert outcome.code == 0, outcome.err
    assert "2.JPG" in outcome.out
    assert "Warning" not in outcome.err
    text = project.read_text(encoding="utf-8")
    assert all(f"{n}.JPG" in text for n in (0, 1, 3, 4))
    checked = photogram("check", project)
    assert checked.err == ""


def test_a_photograph_of_other_bytes_is_left_out_by_name(flight: Path, photogram: Run) -> None:
    (flight / "2.JPG").write_bytes(EPS)
    outcome = photogram("init", flight, "--project", flight.parent / "project.yaml")
    assert outcome.code == 0
    assert "left out" in outcome.out
    assert "2.JPG: cannot be decoded" in " ".join(outcome.out.split())


# ---- files that are none -------------------------------------------------------------------------------------------

READERS: dict[str, tuple[Callable[[Path], object], type[PhotogramError]]] = {
    "project": (Document, ProjectError),
    "flight": (lambda path: flight_plan(path, {}), ProjectError),
    "points": (read_points, ControlPointError),
    "marks": (read_marks, ControlPointError),
    "positions": (read_positions, ProjectError),
    "photograph": (inspect_photograph, ImageError),
    "cloud": (lambda path: read_cloud(path.rename(path.with_suffix(".las"))), ProjectError),
    "report": (read_report, ReportError),
}


@pytest.mark.usefixtures("soon_and_small")
@pytest.mark.parametrize("what", READERS)
def test_pipes_are_not_waited_for(tmp_path: Path, what: str) -> None:
    os.mkfifo(tmp_path / "file.csv")
    read, error = READERS[what]
    with pytest.raises(error, match=r"a named pipe, not a file|file not found"):
        read(tmp_path / "file.csv")


@pytest.mark.usefixtures("soon_and_small")
@pytest.mark.parametrize("what", [what for what in READERS if what != "cloud"])
@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null"])
def test_devices_are_not_read(tmp_path: Path, what: str, device: str) -> None:
    (tmp_path / "file.csv").symlink_to(device)
    read, error = READERS[what]
    with pytest.raises(error, match="a device, not a file"):
        read(tmp_path / "file.csv")


@pytest.mark.usefixtures("soon_and_small")
@pytest.mark.parametrize("what", ["project", "flight", "points", "marks", "positions", "report", "photograph"])
def test_files_that_are_far_too_large(tmp_path: Path, what: str) -> None:
    path = tmp_path / "file.csv"
    with path.open("wb") as stream:
        stream.truncate(5_000_000_000)  # takes no room on the disk
    read, error = READERS[what]
    with pytest.raises(error, match=r"5000 MB, at most [\d]+ MB are read here"):
        read(path)


@pytest.mark.usefixtures("soon_and_small")
@pytest.mark.parametrize(("begin", "end"), [("[", "]"), ("{a: ", "}"), ("- ", ""), ("? ", "")])
def test_yaml_of_a_thousand_levels(tmp_path: Path, begin: str, end: str) -> None:
    path = tmp_path / "project.yaml"
    path.write_text("photogram: 1\na:\n  " + begin * 1000 + end * 1000)
    with pytest.raises(ProjectError, match="nested deeper than 20 deep"):
        Document(path)


@pytest.mark.usefixtures("soon_and_small")
@pytest.mark.parametrize("digits", [400, 5000])
def test_whole_numbers_of_hundreds_of_digits(tmp_path: Path, digits: int) -> None:
    path = tmp_path / "project.yaml"
    path.write_text(f"photogram: 1\ngnss: {{lever_arm_m: [0, 0, {'9' * digits}]}}\n")
    document = Document(path)
    read_entry(document, ProjectFile)
    with pytest.raises(ProjectError, match=f"a number of {digits} characters is not a number photogram reads"):
        document.raise_errors()


# ---- clouds, rasters, arrays ---------------------------------------------------------------------------------------


def las(path: Path, number: int = 100, version: str = "1.4") -> Path:
    header = laspy.LasHeader(version=version, point_format=6 if version == "1.4" else 3)
    header.scales = np.full(3, 0.001)
    points = laspy.LasData(header)
    points.xyz = np.random.default_rng(0).uniform(0, 100, (number, 3))
    points.write(path)
    return path


@pytest.mark.usefixtures("soon_and_small")
@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_a_header_that_claims_two_thousand_million_points(tmp_path: Path, suffix: str) -> None:
    path = las(tmp_path / f"cloud{suffix}")
    content = bytearray(path.read_bytes())
    struct.pack_into("<Q", content, 247, 2**31)
    path.write_bytes(content)
    with pytest.raises(ProjectError, match=r"damaged or truncated \(2147483648 points"):
        read_cloud(path)


@pytest.mark.parametrize("version", ["1.2", "1.4"])
@pytest.mark.parametrize("lost", [1, 37])
def test_a_las_file_cut_between_two_points(tmp_path: Path, version: str, lost: int) -> None:
    path = las(tmp_path / "cloud.las", version=version)
    assert len(read_cloud(path)) == 100
    point_bytes = 30 if version == "1.4" else 34
    path.write_bytes(path.read_bytes()[: -lost * point_bytes])
    with pytest.raises(ProjectError, match=f"100 points, but the file has room for {100 - lost}"):
        read_cloud(path)


def test_a_header_that_names_fewer_points_than_there_are(tmp_path: Path) -> None:
    path = las(tmp_path / "cloud.las")
    content = bytearray(path.read_bytes())
    struct.pack_into("<Q", content, 247, 60)
    path.write_bytes(content)
    with pytest.raises(ProjectError, match="60 points, but the file has room for 100"):
        read_cloud(path)


def test_every_laz_that_was_cut_off_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cloud.laz"
    write_laz(path, PointCloud(np.random.default_rng(0).uniform(0, 100, (120_000, 3)), None, None), CRS)
    assert len(read_cloud(path)) == 120_000
    content = path.read_bytes()
    for kept in np.linspace(0, len(content) - 1, len(seeds(40, 20))).astype(int):
        path.write_bytes(content[:kept])
        with pytest.raises(ProjectError):
            read_cloud(path)


def test_a_laz_larger_than_a_chunk_of_reading_comes_back_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("photogram.files.clouds.points._CHUNK_POINTS", 1000)
    position = np.random.default_rng(0).uniform(0, 100, (3500, 3))
    write_laz(tmp_path / "cloud.laz", PointCloud(position, None, None), CRS)
    assert np.abs(read_cloud(tmp_path / "cloud.laz").position_map_m - position).max() < 0.00051


@pytest.mark.usefixtures("soon_and_small")
def test_a_geotiff_that_claims_more_cells_than_its_file_holds(tmp_path: Path) -> None:
    path = tmp_path / "surface.tif"
    place = {"crs": CRS, "transform": from_origin(5e5, 5.8e6, 1, 1), "dtype": "float32", "count": 1}
    with rasterio.open(
        path, "w", driver="GTiff", width=30_000, height=30_000, sparse_ok=True, tiled=True, **place
    ) as dataset:
        dataset.write(np.ones((16, 16), np.float32), 1, window=rasterio.windows.Window(0, 0, 16, 16))
    with pytest.raises(ProjectError, match="30000 × 30000 cells do not fit into a file of"):
        read_raster(path)


def test_a_raster_of_another_kind_is_not_opened(tmp_path: Path) -> None:
    path = tmp_path / "surface.tif"
    path.write_text('<VRTDataset rasterXSize="10" rasterYSize="10"><SRS>EPSG:25832</SRS></VRTDataset>')
    with pytest.raises(ProjectError, match=r"surface\.tif: cannot be read"):
        read_raster(path)


def spoil_npz(path: Path, old: bytes, new: bytes) -> None:
    content = path.read_bytes()
    assert content.count(old) == 1
    assert len(old) == len(new)
    path.write_bytes(content.replace(old, new))


@pytest.mark.usefixtures("soon_and_small")
@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"'shape': (100, 3), }   ", b"'shape': (10000000, 3),"),
        (b"'shape': (100, 3), }      ", b"'shape': (100, 30000000),}"),
        (b"'descr': '<f8'", b"'descr': '|O8'"),
        (b"'fortran_order': False", b"'fortran_order': (((("),
        (b"'shape': (100, 3)", b"'shape': (\xff\xfe0, 3)"),
    ],
)
def test_npz_with_a_damaged_header(tmp_path: Path, old: bytes, new: bytes) -> None:
    path = tmp_path / "arrays.npz"
    np.savez(path, a=np.zeros((100, 3)))
    new = new.ljust(len(old))
    spoil_npz(path, old, new)
    with pytest.raises(OSError, match="damaged"):
        read_npz(path)


def test_npz_comes_back_as_written(tmp_path: Path) -> None:
    arrays: dict[str, Any] = {
        "a": np.arange(12.0).reshape(3, 4),
        "b": np.array(7),
        "c": np.zeros((0, 3)),
        "d": np.array(["x", "yz"]),
    }
    np.savez(tmp_path / "a.npz", **arrays)
    read = read_npz(tmp_path / "a.npz")
    assert read.keys() == arrays.keys()
    assert all(np.array_equal(read[k], arrays[k]) and read[k].dtype == arrays[k].dtype for k in arrays)


# ---- tables --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("week", ["12345678", "9" * 400])
def test_gps_weeks_of_many_digits(tmp_path: Path, week: str) -> None:
    path = tmp_path / "a_Timestamp.MRK"
    path.write_text(f"1\t256434.1\t[{week}]\t12,N\t-3,E\t85,V\t55.1,Lat\t12.1,Lon\t98.1,Ellh\t0.01, 0.01, 0.02\t50,Q\n")
    with pytest.raises(ProjectError, match=r"is not a GPS time|is not a line of a DJI MRK file"):
        read_positions(path)
    (tmp_path / "b.pos").write_text(
        "% GPST latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m)\n"
        f"{week} 256436.1 55.1 12.1 98.1 1 12 0.01 0.01 0.02\n"
    )
    with pytest.raises(ProjectError, match="is not a time"):
        read_positions(tmp_path / "b.pos")


@pytest.mark.parametrize("sigma", ["1e200", "1e-320", "1e400", "-1"])
def test_sigmas_that_nothing_has(tmp_path: Path, sigma: str) -> None:
    (tmp_path / "p.csv").write_text(f"name,x,y,z,sigma\nA,1,2,3,{sigma}\n")
    with pytest.raises(ControlPointError, match=r"p\.csv:2: sigma must be"):
        read_points(tmp_path / "p.csv")
    (tmp_path / "q.csv").write_text(f"photo,lon,lat,height,sigma\na.jpg,9,52,3,{sigma}\n")
    with pytest.raises(ProjectError, match=r"q\.csv:2: .*(standard deviation|must be a number|must not be below)"):
        read_positions(tmp_path / "q.csv")


@pytest.mark.usefixtures("soon_and_small")
def test_a_line_that_would_keep_a_pattern_busy(tmp_path: Path) -> None:
    (tmp_path / "a.MRK").write_text("1" + " " * 9000 + "x\n")
    with pytest.raises(ProjectError, match="is not a line of a DJI MRK file"):
        read_positions(tmp_path / "a.MRK")
    (tmp_path / "b.MRK").write_text("1" + " " * 900_000 + "x\n")
    with pytest.raises(ProjectError, match="characters long"):
        read_positions(tmp_path / "b.MRK")


def test_an_escape_in_a_table_is_named_and_neutral(tmp_path: Path, photogram: Run, flight: Path) -> None:
    (tmp_path / "p.csv").write_text("name,x,y,z,sigma\n\x1b[31mA,1,2,3,0.1\n")
    outcome = photogram("init", flight, "--control", tmp_path / "p.csv", "--project", tmp_path / "project.yaml")
    assert outcome.code == 1
    assert r"the character \x1b, which cannot be printed" in outcome.err
    assert "\x1b" not in outcome.err


# ---- the report ----------------------------------------------------------------------------------------------------

OTHERS: dict[str, bytes] = {
    "empty": b"",
    "no JSON": b"{",
    "a list": b"[1, 2]",
    "another program's": b'{"version": 3, "cameras": []}',
    "cameras is a list": b'{"photogram": "1", "crs": "x", "cameras": [], "photographs": {}, "control_points": []}',
    "nested": b'{"photogram": ' + b"[" * 100_000,
    "NaN": b'{"photogram": NaN}',
    "a number of 5000 digits": b'{"photogram": ' + b"9" * 5000 + b"}",
    "latin-1": '{"photogram": "Größe"}'.encode("latin-1"),
}


@pytest.mark.parametrize("kind", OTHERS)
def test_another_programs_report(tmp_path: Path, photogram: Run, kind: str) -> None:
    (tmp_path / "report.json").write_bytes(OTHERS[kind])
    outcome = photogram("view", tmp_path)
    assert outcome.code == 1
    assert outcome.err.startswith(f"photogram: {tmp_path}/report.json: ")
    assert outcome.err.count("\n") == 1
    assert "run photogram adjust again" in outcome.err


def test_a_figure_of_the_report_that_is_none(tmp_path: Path, full_report: dict[str, Any]) -> None:
    path = tmp_path / "report.json"
    path.write_text(json.dumps(full_report), encoding="utf-8")
    assert read_report(path) == full_report
    full = json.loads(path.read_text(encoding="utf-8"))
    full["control_points"][1]["residual_m"] = [0.1, "abc", 0.2]
    path.write_text(json.dumps(full), encoding="utf-8")
    with pytest.raises(ReportError, match=r"control_points\[1\]\.residual_m\[1\]: .*found 'abc'"):
        read_report(path)


@pytest.mark.parametrize(
    ("key", "value"), [("residual_m", 7), ("sigma_m", [1, 2]), ("name", 7), ("surveyed_map_m", None)]
)
def test_a_point_of_the_report_that_is_none(
    tmp_path: Path, full_report: dict[str, Any], key: str, value: object
) -> None:
    report = json.loads(json.dumps(full_report))
    report["control_points"][0][key] = value
    (tmp_path / "report.json").write_text(json.dumps(report))
    with pytest.raises(ReportError, match=rf"damaged, control_points\[0\]\.{key}: .*found "):
        read_report(tmp_path / "report.json")


def test_what_a_page_trips_over_names_the_report(tmp_path: Path) -> None:
    words = r"report\.json: damaged, or not of this version of photogram \(KeyError"
    with pytest.raises(ReportError, match=words), making_of(tmp_path / "report.json"):
        raise KeyError("surveyed_map_m")


# ---- ranges --------------------------------------------------------------------------------------------------------

SLIPS = {
    "contours: {interval_m: 1e-320}": r"contours\.interval_m: must be from 0\.01 to 1000 m, found 9\.99\d+e-321",
    "gnss: {lever_arm_m: [0, 0, 1e18]}": r"gnss\.lever_arm_m: down must be from -10000 to 10000 m, found 1e\+18",
    "cameras: {a: {focal_px: 1e9}}": r"cameras\.a\.focal_px: must be from 1 to 1000000 px, found 1000000000",
    "photographs: {attitude_sigma_deg: 1e200}": r"attitude_sigma_deg: must be from 0\.0001 to 180 °, found 1e\+200",
}


@pytest.mark.parametrize("text", SLIPS)
def test_nonsense_is_named_with_its_key_and_range(tmp_path: Path, photogram: Run, text: str) -> None:
    (tmp_path / "project.yaml").write_text(f"photogram: 1\n{text}\n")
    outcome = photogram("check", tmp_path / "project.yaml")
    assert outcome.code == 1
    document = Document(tmp_path / "project.yaml")
    read_entry(document, ProjectFile)
    for name, kind in SECTIONS.items():
        read_settings(document, name, kind)
    with pytest.raises(ProjectError, match=SLIPS[text]):
        document.raise_errors()


def test_distortion_that_no_lens_has(survey: Path, photogram: Run, edit: Callable[..., None]) -> None:
    edit(survey / "project.yaml", lambda v: v["cameras"]["simulated"].update(radial=[1e6, 0.0]))
    outcome = photogram("adjust", survey / "project.yaml")
    assert outcome.code == 1
    assert "cameras.simulated.radial: k1 must be from -" in outcome.err
    assert "found 1000000: check the order of the terms" in outcome.err


def unbounded(kind: object, bounded: bool = False) -> bool:
    """Whether an annotation has a number somewhere that may be any."""
    if get_origin(kind) is Annotated:
        inner, *marks = get_args(kind)
        return unbounded(inner, bounded or any(isinstance(m, Within | PlainValidator) for m in marks))
    if kind in (int, float):
        return not bounded
    return any(unbounded(part, bounded) for part in get_args(kind))


def blocks_of(model: type[BaseModel]) -> set[type[BaseModel]]:
    """Return a block and all within it."""

    def inside(kind: object) -> Iterator[type[BaseModel]]:
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from blocks_of(kind)
        for part in get_args(kind):
            yield from inside(part)

    return {model, *(b for kind in get_type_hints(model, include_extras=True).values() for b in inside(kind))}


@pytest.mark.parametrize("schema", [ProjectFile, FlightFile])
def test_every_number_of_the_files_has_a_range(schema: type[BaseModel]) -> None:
    assert len(blocks_of(schema)) > 6
    without = {
        name
        for block in blocks_of(schema)
        for name, kind in get_type_hints(block, include_extras=True).items()
        if name in block.model_fields and unbounded(kind)
    }
    assert without == ({"photogram"} if schema is ProjectFile else set())  # the format, which must be 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("plan", "--gsd", "0"),
        ("plan", "--control", "100000"),
        ("plan", "--height", "1e9"),
        ("plan", "--cross", "-1"),
        ("init", ".", "--focal-px", "1e12"),
        ("init", ".", "--control-sigma", "1e9"),
        ("init", ".", "--picture-size", "9999999999x3"),
    ],
)
def test_options_out_of_range_are_wrong_usage(photogram: Run, arguments: tuple[str, ...]) -> None:
    outcome = photogram(*arguments)
    assert outcome.code == 2
    assert "Traceback" not in outcome.err


@pytest.mark.usefixtures("soon_and_small")
def test_a_plan_of_millions_of_strips_is_refused_before_they_are_laid_out(tmp_path: Path, photogram: Run) -> None:
    (tmp_path / "flight.yaml").write_text("site: {width_m: 100000, length_m: 100000}\nflight: {gsd_m: 0.0001}\n")
    outcome = photogram("plan", tmp_path / "flight.yaml")
    assert outcome.code == 1
    assert "photographs are more than the 2000" in outcome.err or "too low for a relief" in outcome.err


# ---- names ---------------------------------------------------------------------------------------------------------


def test_formulas_are_text_in_tables() -> None:
    for formula in ("=cmd|' /C calc'!A0", "@SUM(A1)", "+1+1", "-2+3", "\t=1"):
        assert table_cell(formula) == f"'{formula}"
    for plain in ("DJI_0001.JPG", "-5", "+1.5", "", "P=1"):
        assert table_cell(plain) == plain


def test_a_formula_as_a_photographs_name(tmp_path: Path, finished_survey: Path) -> None:
    with ThreadPoolExecutor(1) as executor:
        project = load_project(finished_survey / "project.yaml")
        result = stored_adjustment(Survey(project, Workspace(project.work), executor))
    named = tuple(replace(p, name="=cmd|' /C calc'!A0") for p in result.block.photographs)
    write_pose_table(tmp_path / "t.csv", replace(result, block=replace(result.block, photographs=named)))
    rows = list(csv.reader(line for line in (tmp_path / "t.csv").open() if not line.startswith("#")))
    assert {row[0] for row in rows[1:]} == {"'=cmd|' /C calc'!A0"}


def test_names_of_files_are_short_plain_and_unlike_each_other() -> None:
    names = ["DJI_0001.JPG", "a/DJI_0001.JPG", "x" * 200, "größe \u202e/..", "CON", "$(rm -rf)", "\x1b[2J"]
    stems = [file_stem(i, name) for i, name in enumerate(names)]
    assert len(set(stems)) == len(names)
    assert all(len(stem) <= 45 and stem.isascii() and "/" not in stem and stem.isprintable() for stem in stems)
    assert stems[0] == "0000_DJI_0001"


def test_what_a_terminal_would_obey_is_written_out() -> None:
    assert printable("a\x1b[31mb\nc\udcff\u202e") == "a\\x1b[31mb\nc\\udcff\\u202e"
    assert printable("Größe 5 °") == "Größe 5 °"


def test_escapes_in_tags_are_written_out(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[271], exif[272] = "\x1b[31mDJI", "X\x07" + "y" * 500
    Image.fromarray(pixels()).save(tmp_path / "a.jpg", exif=exif)
    tags = read_tags(tmp_path / "a.jpg")
    assert tags.make == "\\x1b[31mDJI"
    assert tags.model is not None
    assert tags.model.isprintable()
    assert len(tags.model) < 110


@pytest.mark.parametrize("name", ["$x$", "$", "a$b$c", r"\$x$", "$\\frac{$", "100 % $ & _^{}"])
def test_a_dollar_in_a_name_is_no_formula(tmp_path: Path, name: str) -> None:
    figure = new_figure(3, 2)
    axes = figure.subplots()
    texts = [axes.set_title(name), axes.annotate(name, (0.5, 0.5)), axes.text(0, 0, name)]
    axes.plot([0, 1], label=name)
    texts += axes.legend().get_texts()
    figure.savefig(tmp_path / "a.svg", format="svg")
    figure.savefig(tmp_path / "a.png", format="png")
    assert all(text.get_text() == name and not text.get_parse_math() for text in texts)


def test_every_figure_is_made_by_new_figure() -> None:
    folder = Path(page.__file__).parent
    made = [p.name for p in folder.rglob("*.py") if re.search(r"[ (=.](?:Figure|subplots)\(figsize", p.read_text())]
    assert made == []
    assert re.search(r" _PlainFigure\(figsize", (folder / "figures/style.py").read_text())


def test_a_dollar_in_every_name_of_a_survey(survey: Path, photogram: Run, edit: Callable[..., None]) -> None:
    def rename(values: dict[str, Any]) -> None:
        values["cameras"] = {"$cam$" + "x" * 120: values["cameras"]["simulated"]}
        values["photographs"].pop("camera", None)
        for entry in values["photographs"]["list"]:
            entry.pop("camera", None)
        for point in values["control_points"]["list"]:
            point["name"] = f"${point['name']}$" + "y" * 100
        values["report"] = {"name": "$a$ _{b"}
        values["dense"] = {"enabled": False}

    edit(survey / "project.yaml", rename)
    outcome = photogram("adjust", survey / "project.yaml", "--no-check")
    assert outcome.code == 0, outcome.err
    assert all(len(p.name) < 100 for p in (survey / "results/technical/pictures").iterdir())


def test_a_photograph_whose_name_is_no_utf8(survey: Path, photogram: Run, edit: Callable[..., None]) -> None:
    edit(survey / "project.yaml", lambda v: v["photographs"].pop("list"))
    (survey / "photographs/sim_0001.JPG").rename(os.fsdecode(os.fsencode(survey / "photographs") + b"/\xff\x1b.JPG"))
    outcome = photogram("check", survey / "project.yaml")
    assert outcome.code == 1
    assert "Traceback" not in outcome.err
    assert "unprintable" in " ".join((outcome.out + outcome.err).split())
    assert "\x1b" not in outcome.out + outcome.err


def test_a_folder_whose_name_is_no_utf8(survey: Path, photogram: Run) -> None:
    folder = Path(os.fsdecode(os.fsencode(survey.parent) + b"/\xff"))
    survey.rename(folder)
    outcome = photogram("check", folder / "project.yaml")
    assert outcome.code == 1
    assert "is not UTF-8" in " ".join((outcome.out + outcome.err).split())


def test_names_that_no_file_system_has(survey: Path, photogram: Run, edit: Callable[..., None]) -> None:
    edit(survey / "project.yaml", lambda v: v.update(results="r" * 300))
    outcome = photogram("adjust", survey / "project.yaml")
    assert outcome.code == 1
    assert "results: has a name of 300 bytes" in outcome.err
    assert photogram("view", "x" * 5000).code == 1
    assert photogram("check", "x" * 5000).code == 1


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252"])
def test_a_terminal_that_is_not_utf8(encoding: str) -> None:
    outcome = subprocess.run(
        [sys.executable, "-m", "photogram.cli.main", "plan", "--area", "60x60", "--no-changes", "--gsd", "0.05"],
        env=os.environ | {"PYTHONIOENCODING": encoding},
        capture_output=True,
        timeout=120,
    )
    assert outcome.returncode == 0, outcome.stderr
    assert b"Predicted accuracy" in outcome.stdout
    assert b"Traceback" not in outcome.stderr


def test_libraries_do_not_write_to_the_terminal(tmp_path: Path) -> None:
    # a TIFF whose compressed pixels are damaged: libtiff says so on the standard error, past Python
    path = tmp_path / "photographs/a.tif"
    path.parent.mkdir()
    Image.fromarray(pixels()).save(path, compression="tiff_adobe_deflate")
    with Image.open(path) as picture:
        assert isinstance(picture, TiffImagePlugin.TiffImageFile)
        place = picture.tag_v2[273][0] + 20
    content = bytearray(path.read_bytes())
    content[place : place + 8] = b"\xff" * 8
    path.write_bytes(content)
    code = (
        "from photogram.cli.streams import prepare_streams; prepare_streams()\n"
        "import warnings, sys, logging; from pathlib import Path\n"
        "from photogram.files.photographs.images import read_grey\n"
        "warnings.warn('raw'); logging.getLogger('PIL').warning('raw')\n"
        f"try: read_grey(Path({str(path)!r}))\n"
        "except ValueError as fault: sys.stderr.write(f'photogram: {fault}\\n')\n"
    )
    outcome = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert outcome.stderr.startswith("photogram: ")
    assert outcome.stderr.count("\n") == 1


# ---- all of them ---------------------------------------------------------------------------------------------------


def test_spoilt_inputs(finished_survey: Path, tmp_path: Path) -> None:
    program = Path(__file__).parents[1] / "fuzz/fuzz.py"
    cases = str(len(seeds(200, 100)))
    command: list[str | Path] = [sys.executable, program, "--cases", cases, "--seed", "7", "--survey", finished_survey]
    tests = program.parents[1]
    paths = [str(tests), str(tests / "exchange"), *filter(None, [os.environ.get("PYTHONPATH")])]
    outcome = subprocess.run(
        [*command, "--keep", tmp_path / "failed"], capture_output=True, text=True, timeout=300,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
    )  # fmt: skip
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr
    assert f"{cases} cases, 0 failed" in outcome.stdout
