"""A solution as one file of photogram's own, from which a project starts: an npz of arrays, its names as JSON.

What the files of the other program have become stands in it once and for all: they may move or change.
"""

from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from typing_extensions import TypedDict

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose
from photogram.errors import ExchangeError
from photogram.files.arrays import read_npz
from photogram.files.npz_json import write_arrays
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution, Frame, StatedAdjustment
from photogram.measures.mark_covariances import isotropic_px2
from photogram.projection import PARAMETERS, READOUT, Model
from photogram.survey import ControlPoints, Role, TiePoints

FORMAT = 2
_REMEDY = "make it again with photogram import"
_WORDS = "words"
_TIES = ("photograph", "point", "feature", "pixel", "sigma_px", "position_world_m", "colour")
_STATED = ("held", "fitted", "angle_sigma_deg", "position_sigma_m", "ground_m", "ground_sigma_m")
_GROUND = (
    "position_world_m", "sigma_m", "mark_photograph", "mark_point", "mark_pixel", "mark_covariance_px2", "controlled"
)  # fmt: skip
_MARK_SIGMA = "ground_mark_sigma_px"  # of files of earlier versions


class _CameraWords(TypedDict):
    name: str
    width_px: int
    height_px: int
    model: Model


class _PhotographWords(TypedDict):
    name: str
    file: str
    camera: int


class _PointWords(TypedDict):
    name: str
    role: Role


class _StatedWords(TypedDict):
    is_least_squares: bool
    uses_check_marks: bool
    sigma0: float | None
    redundancy: int | None
    sigmas_are_scaled: bool


class _Words(TypedDict):
    format: int
    program: str
    frame: Frame
    origin_lla: tuple[float, float, float] | None
    crs: str | None
    stated_tie_sigma_px: float | None
    reprojection_rms_px: float | None
    left_out: list[str]
    cameras: list[_CameraWords]
    photographs: list[_PhotographWords]
    ground_points: list[_PointWords] | None
    stated: _StatedWords


@cache
def _words() -> TypeAdapter[_Words]:
    return TypeAdapter(_Words)


def is_stored(head: bytes) -> bool:
    """Return whether the first bytes of a file are those of a stored solution."""
    return head.startswith(b"PK") and f"{_WORDS}.npy".encode() in head[:64]


def write_stored(path: Path, solution: ForeignSolution) -> None:
    """Write a solution, whole or not at all; the same bytes for the same solution."""
    ground, photographs, stated = solution.ground_points, solution.photographs, solution.stated
    words: _Words = {
        "format": FORMAT,
        "program": solution.program,
        "frame": solution.frame,
        "origin_lla": solution.origin_lla,
        "crs": solution.crs,
        "stated_tie_sigma_px": solution.stated_tie_sigma_px,
        "reprojection_rms_px": solution.reprojection_rms_px,
        "left_out": list(solution.left_out),
        "cameras": [
            {"name": c.name, "width_px": c.width_px, "height_px": c.height_px, "model": c.model}
            for c in solution.cameras
        ],
        "photographs": [{"name": p.name, "file": str(p.file), "camera": p.camera} for p in photographs],
        "ground_points": None if ground is None else [
            {"name": name, "role": role} for name, role in zip(ground.name, ground.role, strict=True)
        ],
        "stated": {
            "is_least_squares": stated.is_least_squares,
            "uses_check_marks": stated.uses_check_marks,
            "sigma0": stated.sigma0,
            "redundancy": stated.redundancy,
            "sigmas_are_scaled": stated.sigmas_are_scaled,
        },
    }  # fmt: skip
    arrays: dict[str, NDArray[Any]] = {
        _WORDS: np.frombuffer(_words().dump_json(words), dtype=np.uint8),
        "camera_parameters": np.array([c.parameters for c in solution.cameras]).reshape(-1, PARAMETERS),
        "pose_rotation": np.array(
            [np.full((3, 3), np.nan) if p.pose is None else p.pose.rotation_world_from_camera for p in photographs]
        ).reshape(-1, 3, 3),
        "pose_position": _rows([None if p.pose is None else p.pose.position_world_m for p in photographs]),
        "measured": _rows([p.measured for p in photographs]),
        "measured_sigma_m": _rows([p.measured_sigma_m for p in photographs]),
        **{f"tie_{name}": getattr(solution.tie_points, name) for name in _TIES},
    }
    if ground is not None:
        arrays |= {f"ground_{name}": getattr(ground, name) for name in _GROUND}
    arrays |= {f"stated_{name}": array for name in _STATED if (array := getattr(stated, name)) is not None}
    write_arrays(path, arrays)


def _rows(values: list[FloatArray | None]) -> FloatArray:
    """Return vectors (N, 3), NaN for those that are not there."""
    return np.array([np.full(3, np.nan) if value is None else value for value in values]).reshape(-1, 3)


def read_stored(path: Path) -> ForeignSolution:
    """Return the solution that ``write_stored`` wrote. Raises ExchangeError where the file is damaged, of a later
    version, or something else."""
    try:
        arrays = read_npz(path)
    except OSError as error:
        raise ExchangeError(f"{path}: cannot be read ({error}): {_REMEDY}") from error
    try:
        words = _words().validate_json(arrays[_WORDS].tobytes())
        if words["format"] != FORMAT:
            raise ExchangeError(f"{path}: is of the version {words['format']}, expected {FORMAT}: {_REMEDY}")
        return _solution(words, arrays)
    except (ValidationError, ValueError, LookupError, TypeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ExchangeError(f"{path}: is no solution that photogram has stored ({reason}): {_REMEDY}") from error


def _solution(words: _Words, arrays: dict[str, NDArray[Any]]) -> ForeignSolution:
    cameras = tuple(
        Camera(c["name"], c["width_px"], c["height_px"], 1.0, np.zeros(2), model=c["model"]).with_parameters(
            np.append(q, 0.0) if len(q) == READOUT else q  # files of earlier versions have no read-out time
        )
        for c, q in zip(words["cameras"], arrays["camera_parameters"], strict=True)
    )
    photographs = tuple(
        ForeignPhotograph(
            p["name"],
            p["camera"],
            Pose(R, C) if np.isfinite(R).all() and np.isfinite(C).all() else None,
            PurePosixPath(p["file"]),
            measured if np.isfinite(measured).all() else None,
            sigma if np.isfinite(sigma).any() else None,
        )
        for p, R, C, measured, sigma in zip(
            words["photographs"], arrays["pose_rotation"], arrays["pose_position"], arrays["measured"],
            arrays["measured_sigma_m"], strict=True,
        )
    )  # fmt: skip
    ties = TiePoints(*(arrays[f"tie_{name}"] for name in _TIES))
    ground = None
    if words["ground_points"] is not None:
        names = tuple(p["name"] for p in words["ground_points"])
        roles = tuple(p["role"] for p in words["ground_points"])
        if _MARK_SIGMA in arrays:
            arrays = {**arrays, "ground_mark_covariance_px2": isotropic_px2(arrays[_MARK_SIGMA])}
        ground = ControlPoints(names, roles, *(arrays[f"ground_{name}"] for name in _GROUND))
        _check_index("mark_photograph", ground.mark_photograph, len(photographs))
        _check_index("mark_point", ground.mark_point, len(ground))
    _check_index("photograph", ties.photograph, len(photographs))
    if not np.isfinite(ties.pixel).all():
        raise ValueError("an observation of a tie point has no place")
    return ForeignSolution(
        words["program"],
        cameras,
        photographs,
        ties,
        ground,
        words["frame"],
        words["origin_lla"],
        words["crs"],
        words["stated_tie_sigma_px"],
        words["reprojection_rms_px"],
        tuple(words["left_out"]),
        StatedAdjustment(**words["stated"], **{name: arrays.get(f"stated_{name}") for name in _STATED}),
    )


def _check_index(name: str, index: NDArray[Any], count: int) -> None:
    if not np.issubdtype(index.dtype, np.integer) or (len(index) and not 0 <= index.min() <= index.max() < count):
        raise ValueError(f"{name} names what is not there")
