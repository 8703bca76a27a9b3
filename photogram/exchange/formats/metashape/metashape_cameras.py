"""Cameras of Agisoft Metashape and PhotoScan as XML: what Export Cameras writes and Import Cameras reads.

The frames, pixels and formulas are those of `metashape_chunk`.
"""

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Camera, Similarity
from photogram.errors import ExchangeError, PhotogramError
from photogram.exchange.formats.assembly import HALF_PIXEL, no_tie_points
from photogram.exchange.formats.metashape.metashape_chunk import MODELS, MOST_XML_BYTES, read_chunk
from photogram.exchange.formats.writing import check_writable
from photogram.files.atomic import write_whole
from photogram.files.solutions.parsing import bytes_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.files.xml_elements import elements_of
from photogram.geodesy.crs import written_crs
from photogram.geodesy.frames import geocentric_from_topocentric
from photogram.wording import shortened, things

_WGS_84 = (
    'GEOGCS["WGS 84",DATUM["World Geodetic System 1984",SPHEROID["WGS 84",6378137,298.257223563,'
    'AUTHORITY["EPSG","7030"]],TOWGS84[0,0,0,0,0,0,0],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,'
    'AUTHORITY["EPSG","8901"]],UNIT["degree",0.01745329251994328,AUTHORITY["EPSG","9102"]],AUTHORITY["EPSG","4326"]]'
)
_LOCAL = 'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1]]'
_REMEDY = "export the cameras from Metashape again"
_ARM_M = 1e6  # long beside the rounding of geocentric coordinates


def read_metashape_cameras(path: Path) -> ForeignSolution:
    """Return the cameras and photographs of an export of cameras; markers too where the file has them.

    Coordinates are geocentric where the chunk has a CRS and a transform, else local. Raises ExchangeError with the line
    where the file is none of Metashape, is damaged, or has a camera model that photogram has not.
    """
    root = elements_of(bytes_of(path, MOST_XML_BYTES), path, ExchangeError, _REMEDY)
    chunks = [*root.all("document", "chunk"), *root.all("document", "chunks", "chunk")]
    with_cameras = [chunk for chunk in chunks if any(chunk.all("cameras"))]
    if len(with_cameras) != 1:
        raise ExchangeError(
            f"{root.place}: holds cameras of {things(len(with_cameras), 'chunk')}: export those of one chunk"
        )
    chunk = with_cameras[0]
    return read_chunk(chunk, chunk.first("frames", "frame")).solution("Agisoft Metashape", no_tie_points())


# ---- writing -------------------------------------------------------------------------------------------------------


def write_metashape_cameras(path: Path, solution: ForeignSolution) -> tuple[str, ...]:
    """Write cameras, poses and measured positions for Metashape's File, Import, Import Cameras; returns sentences about
    what the file cannot hold.

    Photographs are named by their labels, the names of their files. Raises ExchangeError where a value is not finite or
    the CRS of measured positions has no WKT, WorkspaceError where the file cannot be written.
    """
    check_writable(path, solution)
    document = ElementTree.Element("document", version="2.0.0")
    chunk = ElementTree.SubElement(document, "chunk", label="photogram", enabled="true")
    sensors = ElementTree.SubElement(chunk, "sensors", next_id=str(len(solution.cameras)))
    for i, camera in enumerate(solution.cameras):
        _write_sensor(sensors, i, camera)
    listed = ElementTree.SubElement(chunk, "cameras", next_id=str(len(solution.photographs)), next_group_id="0")
    for i, photograph in enumerate(solution.photographs):
        _write_camera(listed, i, photograph)
    reference, similarity, left_out = _written_frame(path, solution)
    ElementTree.SubElement(chunk, "reference").text = reference
    transform = ElementTree.SubElement(chunk, "transform")
    ElementTree.SubElement(transform, "rotation").text = _numbers(similarity.rotation)
    ElementTree.SubElement(transform, "translation").text = _numbers(similarity.translation)
    ElementTree.SubElement(transform, "scale").text = repr(similarity.scale)
    ElementTree.indent(document)
    text = ElementTree.tostring(document, encoding="unicode")
    write_whole(path, f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n')
    return tuple(left_out)


def _numbers(values: FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values.ravel())


def _write_sensor(sensors: ElementTree.Element, number: int, camera: Camera) -> None:
    kind = next(name for name, model in MODELS.items() if model == camera.model)
    size = {"width": str(camera.width_px), "height": str(camera.height_px)}
    sensor = ElementTree.SubElement(sensors, "sensor", id=str(number), label=camera.name, type=kind)
    ElementTree.SubElement(sensor, "resolution", size)
    calibration = ElementTree.SubElement(sensor, "calibration", {"type": kind, "class": "adjusted"})
    ElementTree.SubElement(calibration, "resolution", size)
    cx, cy = camera.principal_point_px + HALF_PIXEL
    values = {
        "f": camera.focal_px,
        "cx": cx - camera.width_px / 2,
        "cy": cy - camera.height_px / 2,
        **dict(zip(("b1", "b2"), camera.affinity, strict=True)),
        **dict(zip(("k1", "k2", "k3", "k4"), camera.radial, strict=True)),
        "p1": camera.tangential[1],
        "p2": camera.tangential[0],
    }
    for name, value in values.items():
        ElementTree.SubElement(calibration, name).text = repr(float(value))


def _write_camera(cameras: ElementTree.Element, number: int, photograph: ForeignPhotograph) -> None:
    element = ElementTree.SubElement(
        cameras, "camera", id=str(number), sensor_id=str(photograph.camera), label=photograph.name, enabled="true"
    )
    if photograph.pose is not None:
        M = np.eye(4)
        M[:3, :3], M[:3, 3] = photograph.pose.rotation_world_from_camera, photograph.pose.position_world_m
        ElementTree.SubElement(element, "transform").text = _numbers(M)
    if photograph.measured is not None:
        values = dict(zip("xyz", photograph.measured, strict=True))
        if photograph.measured_sigma_m is not None and np.isfinite(photograph.measured_sigma_m).all():
            values |= dict(zip(("sx", "sy", "sz"), photograph.measured_sigma_m, strict=True))
        text = {name: repr(float(value)) for name, value in values.items()}
        ElementTree.SubElement(element, "reference", {**text, "enabled": "true"})


def _written_frame(path: Path, solution: ForeignSolution) -> tuple[str, Similarity, list[str]]:
    """Return the CRS of the chunk, its transform, and what they leave out."""
    same = Similarity(1.0, np.eye(3), np.zeros(3))
    left_out = list(_not_written(solution))
    has_measured = any(photograph.measured is not None for photograph in solution.photographs)
    if solution.frame in ("geocentric", "topocentric"):
        wkt = _WGS_84 if solution.crs is None else _wkt(path, solution.crs)
        if solution.origin_lla is not None:
            return wkt, _geocentric_from(solution.origin_lla), left_out
        return wkt, same, left_out
    if solution.crs is not None and (has_measured or solution.frame == "map"):
        if solution.frame == "local":
            raise ExchangeError(
                f"{path}: measured positions are in {shortened(solution.crs)} and poses are not: Metashape has one "
                "frame for both, so transform the solution first, or leave the positions out"
            )
        left_out.append("The CRS: Metashape would take coordinates of a map for geocentric ones.")
    return _LOCAL, same, left_out


def _wkt(path: Path, name: str) -> str:
    if "[" in name:
        return name
    if name in ("EPSG:4326", "EPSG:4979"):
        return _WGS_84
    try:
        crs = written_crs(name)
        return _WGS_84 if crs is None else str(crs.to_wkt("WKT1_GDAL"))
    except (PhotogramError, ValueError, RuntimeError) as error:
        raise ExchangeError(f"{path}: the CRS {shortened(name)} has no WKT ({shortened(str(error))})") from error


def _geocentric_from(origin_lla: tuple[float, float, float]) -> Similarity:
    """Return the transform from east, north, up at an origin to geocentric coordinates of WGS 84."""
    origin, *ends = geocentric_from_topocentric(origin_lla, _ARM_M * np.vstack([np.zeros(3), np.eye(3)]))
    return Similarity(1.0, (np.array(ends) - origin).T / _ARM_M, origin)


def _not_written(solution: ForeignSolution) -> Iterator[str]:
    if len(solution.tie_points):
        yield f"{things(len(solution.tie_points), 'tie point')}: an export of cameras has none."
    if solution.ground_points is not None and len(solution.ground_points):
        yield (
            f"{things(len(solution.ground_points), 'ground point')}: Metashape imports markers from a file of "
            "their own."
        )
    moved = sum(str(photograph.file) != photograph.name for photograph in solution.photographs)
    if moved:
        yield f"The folders of {things(moved, 'photograph')}: Metashape knows them by their names."
