"""MATLAB's .mat files: a calibrated camera in, which the extra ``matlab`` reads; tie points out."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera
from photogram.errors import ProjectError
from photogram.files.atomic import replacing
from photogram.files.matlab_elements import LARGEST_BYTES, check_elements, is_level_5
from photogram.files.reading import read_whole
from photogram.projection import RADIAL_TERMS
from photogram.survey import TiePoints

PixelOrigin = Literal["photogram", "matlab"]
"""The coordinates of the centre of the top-left pixel: photogram (0, 0), matlab (1, 1)."""

_ORIGIN_PX: Mapping[str, float] = {"photogram": 0.0, "matlab": 1.0}
SQUARE = 1e-6
"""Difference of focal lengths, and skew, in the focal length, below which pixels are square."""
_HEADER = b"MATLAB 5.0 MAT-file, written by photogram".ljust(116)
_RADIAL, _TANGENTIAL, _INTRINSIC = "RadialDistortion", "TangentialDistortion", "IntrinsicMatrix"


def _load(path: Path) -> dict[str, object]:
    if not path.is_file():
        raise ProjectError(f"camera file {path}: file not found: check its path")
    # matio brings pandas, half a second that only a survey with such a camera pays.
    try:
        from matio import load_from_mat
    except ImportError as error:
        raise ProjectError(
            f"camera file {path}: a MATLAB file, which this installation does not read: pip install "
            '"photogram[matlab]", or give focal_px, principal_point_px, radial and tangential in the project file'
        ) from error
    try:
        data = read_whole(path, LARGEST_BYTES)
        if is_level_5(data):
            check_elements(data)
        variables = load_from_mat(str(path))
    # Of a damaged file the reader raises whatever it trips over: zlib.error, TypeError, OSError and more.
    except Exception as error:
        raise ProjectError(
            f"camera file {path}: cannot be read as a MATLAB file ({type(error).__name__}: {error}): "
            "save it again in MATLAB with save(FILE, 'K', 'cameraParams')"
        ) from error
    return {str(name): value for name, value in variables.items() if not str(name).startswith("__")}


def _fields(value: object) -> dict[str, object]:
    """Return the fields of a MATLAB object or struct, none for anything else."""
    properties = getattr(value, "properties", None)
    if isinstance(properties, Mapping):
        fields = dict(properties)
        # MATLAB saves cameraParameters through its own struct, which the reader files under this name.
        return {**fields, **_fields(fields.pop("any", None))}
    if isinstance(value, np.ndarray) and value.dtype.names is not None and value.size == 1:
        record = value.reshape(-1)[0]
        return {name: record[name] for name in value.dtype.names}
    if isinstance(value, Mapping):
        return {str(name): entry for name, entry in value.items()}
    return {}


def _numbers(path: Path, fields: Mapping[str, object], name: str, sizes: tuple[int, ...]) -> FloatArray:
    """Return the field as numbers; none or another count than ``sizes`` allow raises ProjectError."""
    if name not in fields:
        raise ProjectError(
            f"camera file {path}: {name} is missing, found {', '.join(sorted(fields)) or 'nothing'}: "
            "save K and the cameraParameters object, or K, RadialDistortion and TangentialDistortion"
        )
    try:
        numbers = np.asarray(fields[name], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ProjectError(f"camera file {path}: {name} contains no numbers: save the calibration again") from error
    if numbers.size not in sizes or not np.all(np.isfinite(numbers)):
        expected = " or ".join(str(size) for size in sizes)
        raise ProjectError(
            f"camera file {path}: {name} is {numbers.tolist()}, expected {expected} numbers: save the calibration again"
        )
    return numbers


def _calibration(path: Path, variables: Mapping[str, object]) -> dict[str, object]:
    """Return the fields of the one calibration in the file, and the file's K."""
    calibrations = {name: fields for name, value in variables.items() if _RADIAL in (fields := _fields(value))}
    if _RADIAL in variables:
        calibrations[_RADIAL] = dict(variables)
    if len(calibrations) != 1:
        content = ", ".join(sorted(variables)) or "nothing"
        raise ProjectError(
            f"camera file {path}: {len(calibrations)} calibrations, found {content}, one is expected: save K and one "
            "cameraParameters object, or K, RadialDistortion and TangentialDistortion"
        )
    fields = next(iter(calibrations.values()))
    if "K" in variables:
        fields["K"] = variables["K"]
    return fields


def _matrix(path: Path, fields: Mapping[str, object]) -> FloatArray:
    """Return K (3, 3), checked against MATLAB's transposed IntrinsicMatrix where the file holds both."""
    if "K" not in fields and _INTRINSIC in fields:
        K = _numbers(path, fields, _INTRINSIC, (9,)).reshape(3, 3).T
    else:
        K = _numbers(path, fields, "K", (9,)).reshape(3, 3)
        if _INTRINSIC in fields:
            intrinsic = _numbers(path, fields, _INTRINSIC, (9,)).reshape(3, 3)
            if not np.allclose(K, intrinsic.T, rtol=1e-9, atol=1e-6):
                raise ProjectError(
                    f"camera file {path}: K {K.tolist()} contradicts the transposed IntrinsicMatrix "
                    f"{intrinsic.T.tolist()}: keep the one that belongs to the calibration"
                )
    if not np.array_equal(K[2], [0.0, 0.0, 1.0]) or K[1, 0] != 0.0:
        raise ProjectError(
            f"camera file {path}: K is {K.tolist()}, expected [[f 0 cx], [0 f cy], [0 0 1]]: "
            "transpose it if it is MATLAB's IntrinsicMatrix"
        )
    for focal_px in (K[0, 0], K[1, 1]):
        if not focal_px > 0:
            raise ProjectError(f"camera file {path}: the focal length is {focal_px:g} px: save the calibration again")
    return K


def read_camera(path: Path, name: str, width_px: int, height_px: int, pixel_origin: PixelOrigin) -> Camera:
    """Return the camera ``name`` from K and a cameraParameters object, a struct of its fields, or the plain variables.

    MATLAB's distortion is Brown–Conrady with k1 k2 [k3] and p1 p2 as photogram's; of K's focal lengths the second is f,
    and b1 = fx − fy, b2 its skew. ``pixel_origin`` says in whose pixel frame the principal point is; from "matlab" 1 px
    is subtracted. Raises ProjectError where the file is missing or damaged, something is missing or contradicts itself,
    or the extra is not installed.
    """
    fields = _calibration(path, _load(path))
    K = _matrix(path, fields)
    radial = _numbers(path, fields, _RADIAL, (2, 3)).reshape(-1)
    tangential = _numbers(path, fields, _TANGENTIAL, (2,)).reshape(-1)
    size = np.asarray(fields.get("ImageSize", []))
    if size.size == 2 and tuple(size.reshape(-1).tolist()) != (height_px, width_px):
        rows, columns = size.reshape(-1).tolist()
        raise ProjectError(
            f"camera file {path}: calibrated on {columns:g} × {rows:g} px, but camera {name} has "
            f"{width_px} × {height_px} px: use the calibration of the full photographs"
        )
    affinity = np.array([K[0, 0] - K[1, 1], K[0, 1]])
    square = bool(np.all(np.abs(affinity) <= SQUARE * K[0, 0]))
    return Camera(
        name,
        width_px,
        height_px,
        float((K[0, 0] + K[1, 1]) / 2 if square else K[1, 1]),
        K[:2, 2] - _ORIGIN_PX[pixel_origin],
        np.pad(radial, (0, RADIAL_TERMS - len(radial))),
        tangential,
        affinity=np.zeros(2) if square else affinity,
    )


def _cells(items: Sequence[object]) -> NDArray[np.object_]:
    cells = np.empty((len(items), 1), dtype=object)
    for row, item in enumerate(items):
        cells[row, 0] = item
    return cells


def _seen_by_all(photographs: int, tie_points: TiePoints) -> tuple[IntArray, IntArray]:
    """Return the points (C,) observed in every photograph, and their observations (C, F), ordered by photograph."""
    common = np.flatnonzero(tie_points.rays == photographs)
    first = tie_points.first_observation[common]
    observations = first[:, None] + np.arange(photographs)
    order = np.argsort(tie_points.photograph[observations], axis=1, kind="stable")
    observations = np.take_along_axis(observations, order, axis=1)
    complete = (tie_points.photograph[observations] == np.arange(photographs)).all(axis=1)
    return common[complete].astype(np.int64), observations[complete].astype(np.int64)


def write_tie_points(path: Path, photographs: Sequence[str], tie_points: TiePoints) -> None:
    """Write the tie points for MATLAB; whole or not at all, the same points give the same bytes.

    All indices start at 1. Variables, for F photographs, N observations, P points and C points seen in all photographs:

    - ``photographs`` {F×1}: their names; ``pixel_origin``: "photogram", the frame of all pixels here: the centre of the
      top-left pixel is (0, 0);
    - ``pixel`` {F×1}: u, v (C×2) in each photograph, row by row the same points; ``common_point`` (C×1): which;
    - ``observation_photograph``, ``observation_point``, ``observation_feature``, ``observation_sigma_px`` (N×1),
      ``observation_pixel`` (N×2), sorted by point;
    - ``position_world_m`` (P×3), NaN while unknown; ``colour`` (P×3) red, green, blue.

    Raises WorkspaceError where the file cannot be written.
    """
    common, observations = _seen_by_all(len(photographs), tie_points)
    variables = {
        "photographs": _cells(photographs),
        "pixel_origin": "photogram",
        "pixel": _cells([tie_points.pixel[column] for column in observations.T]),
        "common_point": common[:, None] + 1,
        "observation_photograph": tie_points.photograph[:, None] + 1,
        "observation_point": tie_points.point[:, None] + 1,
        "observation_feature": tie_points.feature[:, None] + 1,
        "observation_pixel": tie_points.pixel,
        "observation_sigma_px": tie_points.sigma_px[:, None],
        "position_world_m": tie_points.position_world_m,
        "colour": tie_points.colour,
    }
    with replacing(path) as partial:
        savemat(partial, variables, appendmat=False, do_compression=True)
        with partial.open("r+b") as stream:
            # The writer's own header text carries the time of day.
            stream.write(_HEADER)
