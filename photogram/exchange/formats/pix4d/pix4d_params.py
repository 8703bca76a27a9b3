"""PIX4Dmapper's folder `1_initial/params`: calibrated_camera_parameters.txt with what lies beside it.

The text gives for each photograph its name and size, K, the radial (R1 R2 R3) and tangential (T1 T2) distortion, the
projection centre t and the rotation R, camera from world, with x right, y down, z forward: m = K [R | −R t] X. The
formulas are photogram's; the principal point counts from the corner of the top-left pixel. offset.xyz is to be added to
positions, wkt.prj is their CRS, and the `.cam` names the sizes of sensors (Pix4D, Outputs of the params folder).
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Camera
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import HALF_PIXEL, camera_of, check_names, no_tie_points, pose_of
from photogram.files.solutions.parsing import file_of, number_of, numbers_of, text_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.geodesy.crs import crs_of_wkt
from photogram.wording import printable, shortened

PARAMETERS = "_calibrated_camera_parameters.txt"
_MOST_BYTES = 500_000_000
_HEADER = "fileName imageWidth imageHeight"
_LINES = 10
_SENSOR = re.compile(r"sensor width of\s*([\d.eE+-]+)\s*x\s*([\d.eE+-]+)\s*mm")
_CALIBRATION = ("F", "Px", "Py", "K1", "K2", "K3", "T1", "T2")
_REMEDY = "run step 1 in PIX4Dmapper again, with the camera internals and externals switched on"


def read_pix4d_params(path: Path) -> ForeignSolution:
    """Return the cameras and photographs of a file ``…_calibrated_camera_parameters.txt``, or of the folder with it.

    Without an offset.xyz and a wkt.prj beside it the coordinates are local. Photographs with one calibration share a
    camera. Raises ExchangeError with the line where a file is damaged.
    """
    file, stem = _parameters_file(path)
    lines = [(n, line.strip()) for n, line in enumerate(text_of(file, _MOST_BYTES).splitlines(), 1) if line.strip()]
    starts = [i for i, (_, line) in enumerate(lines) if line.startswith("camera model m = K")]
    if not lines or not lines[0][1].startswith(_HEADER) or not starts:
        raise ExchangeError(f"{file}:1: has not the header of PIX4Dmapper's camera parameters: {_REMEDY}")
    body = lines[starts[0] + 1 :]
    if not body or len(body) % _LINES:
        raise ExchangeError(f"{file}:{lines[-1][0]}: ends within a photograph: {_REMEDY}")
    offset, crs = _offset(stem), _crs(stem)
    cameras: list[Camera] = []
    known: dict[tuple[object, ...], int] = {}
    photographs = []
    for i in range(0, len(body), _LINES):
        photograph, camera, key = _photograph(file, body[i : i + _LINES], offset, len(cameras))
        if key not in known:
            known[key] = len(cameras)
            cameras.append(camera)
        photographs.append(ForeignPhotograph(photograph.name, known[key], photograph.pose, photograph.file))
    check_names(str(file), (photograph.file for photograph in photographs))
    return ForeignSolution(
        program="PIX4Dmapper",
        cameras=tuple(cameras),
        photographs=tuple(photographs),
        tie_points=no_tie_points(),
        frame="local" if crs is None else "map",
        crs=crs,
        left_out=tuple(_left_out(stem, cameras)),
    )


def read_pix4d_cam(path: Path, size_px: tuple[int, int]) -> Camera:
    """Return the camera of a file ``…_pix4d_calibrated_internal_camera_parameters.cam``, of photographs of this width
    and height. Raises ExchangeError where the file is damaged, or has several cameras."""
    text = text_of(path, _MOST_BYTES)
    sensor = _SENSOR.findall(text)
    if len(sensor) != 1:
        raise ExchangeError(
            f"{path}: has the sensors of {len(sensor)} perspective cameras, one is read: split the file"
        )
    values: dict[str, float] = {}
    for n, line in enumerate(text.splitlines(), 1):
        words = line.split()
        if len(words) == 2 and words[0] in _CALIBRATION:
            values[words[0]] = number_of(f"{path}:{n}", words[0], words[1])
    missing = [name for name in _CALIBRATION if name not in values]
    if missing:
        raise ExchangeError(f"{path}: has no {missing[0]}: {_REMEDY}")
    width_mm = number_of(str(path), "the width of the sensor", sensor[0][0])
    if not width_mm > 0:
        raise ExchangeError(f"{path}: the width of the sensor is {width_mm:g} mm: it must be positive")
    px = size_px[0] / width_mm
    return camera_of(
        str(path),
        path.stem,
        size_px,
        values["F"] * px,
        (values["Px"] * px - HALF_PIXEL, values["Py"] * px - HALF_PIXEL),
        (values["K1"], values["K2"], values["K3"]),
        (values["T1"], values["T2"]),
    )


def _parameters_file(path: Path) -> tuple[Path, str]:
    """Return the file of parameters, and the path of its neighbours without their ending."""
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.name.endswith(PARAMETERS))
        if len(files) != 1:
            raise ExchangeError(f"{path}: has {len(files)} files …{PARAMETERS}, expected one: name the file")
        return files[0], str(files[0])[: -len(PARAMETERS)]
    return path, str(path)[: -len(PARAMETERS)] if path.name.endswith(PARAMETERS) else ""


def _offset(stem: str) -> FloatArray:
    path = Path(f"{stem}_offset.xyz")
    if not stem or not path.exists():
        return np.zeros(3)
    return numbers_of(f"{path}:1", "the offset", text_of(path, _MOST_BYTES), 3)


def _crs(stem: str) -> str | None:
    path = Path(f"{stem}_wkt.prj")
    return crs_of_wkt(text_of(path, _MOST_BYTES)) if stem and path.exists() else None


def _photograph(
    file: Path, lines: Sequence[tuple[int, str]], offset: FloatArray, number: int
) -> tuple[ForeignPhotograph, Camera, tuple[object, ...]]:
    """Return a photograph, its camera, and what its camera is known by."""
    place = f"{file}:{lines[0][0]}"
    name, *size = lines[0][1].rsplit(maxsplit=2)
    if len(size) != 2:
        raise ExchangeError(
            f"{place}: expected a name, a width and a height, found {printable(shortened(lines[0][1]))}"
        )
    photograph = file_of(place, name)
    width, height = (number_of(place, what, text) for text, what in zip(size, ("width", "height"), strict=True))

    def rows(first: int, last: int, columns: int, what: str) -> FloatArray:
        return np.array([numbers_of(f"{file}:{n}", what, text, columns) for n, text in lines[first:last]])

    K = rows(1, 4, 3, "a row of K")
    if K[1, 0] or K[2].tolist() != [0, 0, 1]:
        raise ExchangeError(f"{place}: K is no calibration matrix: {_REMEDY}")
    radial, tangential = rows(4, 5, 3, "the radial distortion")[0], rows(5, 6, 2, "the tangential distortion")[0]
    centre, R = rows(6, 7, 3, "the position")[0], rows(7, 10, 3, "a row of the rotation")
    camera = camera_of(
        place,
        f"camera {number + 1}",
        (width, height),
        float(K[1, 1]),
        (float(K[0, 2] - HALF_PIXEL), float(K[1, 2] - HALF_PIXEL)),
        tuple(radial.tolist()),
        tuple(tangential.tolist()),
        (float(K[0, 0] - K[1, 1]), float(K[0, 1])),
    )
    key = (width, height, *K.ravel().tolist(), *radial.tolist(), *tangential.tolist())
    return ForeignPhotograph(photograph.name, 0, pose_of(place, R.T, centre + offset), photograph), camera, key


def _left_out(stem: str, cameras: Sequence[Camera]) -> list[str]:
    """Return sentences about what the folder holds beside the parameters of photographs."""
    left_out = ["Tie points: the folder of parameters gives no positions for them."]
    cam = Path(f"{stem}_pix4d_calibrated_internal_camera_parameters.cam")
    if stem and cam.exists() and len(cameras) == 1:
        other = read_pix4d_cam(cam, (cameras[0].width_px, cameras[0].height_px))
        difference = float(np.abs(other.parameters[:3] - cameras[0].parameters[:3]).max())
        if difference > 0.5:
            left_out.append(
                f"The calibration of the .cam beside it, which differs by {difference:.1f} px: photographs have that "
                "of their own text."
            )
    return left_out
