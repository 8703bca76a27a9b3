"""An adjustment of DBAT as a solution: its result file, with the script and tables that lie beside it.

DBAT's images have x to the right and y down, in pixels from the outer corner of the top-left one, whose centre is
(0.5, 0.5); principal points count from there in the camera unit. Its exterior orientations are photogrammetric angles,
R = Rx(omega) Ry(phi) Rz(kappa) from the image frame (x right, y up, z backward), and projection centres in the
coordinates of the control points, taken as Cartesian. DBAT adjusts by least squares without rejecting anything, and
takes the marks of check points for those of points without a survey (Börlin and Grussenmeyer 2013).
"""

from pathlib import Path

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.camera import Camera, rotation_from_omega_phi_kappa
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import HALF_PIXEL, camera_of, check_names, index_in, pose_of, sentences
from photogram.exchange.formats.dbat.dbat_report import REMEDY, Report, read_report
from photogram.exchange.formats.dbat.dbat_script import Points, Script, ScriptCamera, name_of, read_script
from photogram.files.solutions.parsing import check_distinct, file_of, part_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution, StatedAdjustment
from photogram.measures.mark_covariances import isotropic_px2
from photogram.projection import CAMERA_PARAMETERS
from photogram.survey import TRANSFERRED, ControlPoints, Role, TiePoints
from photogram.wording import printable, shortened, things

_ESTIMATED = {"cc": "focal_px", "px": "cx_px", "py": "cy_px"}
"""What photogram calls DBAT's parameters."""


def read_dbat(path: Path) -> ForeignSolution:
    """Return the solution of a result file of DBAT with the script that it names and the tables that this names, all
    looked for beside it by their file names.

    Raises ExchangeError where a file is missing or damaged, they do not belong together, or the camera has a lens
    distortion, which acts in the inverse direction of photogram's.
    """
    report = read_report(path)
    if report.script is None:
        raise ExchangeError(f"{path}: names no script (Input file name): run the adjustment from a script of DBAT")
    script = read_script(part_of(str(path), path.parent, name_of(report.script)))
    camera, fixed = _camera(script.camera, report)
    photographs, numbers, angle_sigma, position_sigma = _photographs(path, script, report)
    control, check = script.control, script.check
    ids = np.concatenate([control.id, check.id])
    check_distinct(str(path), "ground point", ids)
    of_ground = index_in(np.argsort(ids), ids, script.marks.point)
    image = np.array(list(numbers), dtype=np.int64)
    seen_in = index_in(np.argsort(image), image, script.marks.image)
    if (seen_in < 0).any():
        unknown = int(script.marks.image[seen_in < 0][0])
        raise ExchangeError(f"{path}: a mark is in the photograph {unknown}, which is not among the images: {REMEDY}")
    seen_in = np.array(list(numbers.values()), dtype=np.int64)[seen_in]
    marks, is_mark = script.marks, of_ground >= 0
    ground = _ground_points(script, marks.pixel - HALF_PIXEL, of_ground, seen_in)
    ties = _tie_points(marks.point[~is_mark], seen_in[~is_mark], marks.pixel[~is_mark], marks.sigma_px[~is_mark])
    stated = np.unique(ties.sigma_px)
    adjusted, ground_sigma = _adjusted_ground(ids, report)
    return ForeignSolution(
        program=report.program,
        cameras=(camera,),
        photographs=photographs,
        tie_points=ties,
        ground_points=ground,
        frame="map",
        stated_tie_sigma_px=float(stated[0]) if len(stated) == 1 else None,
        left_out=_left_out(fixed),
        stated=StatedAdjustment(
            held=fixed[None],
            is_least_squares=True,
            uses_check_marks=True,
            sigma0=report.sigma0,
            redundancy=report.redundancy,
            sigmas_are_scaled=True,
            angle_sigma_deg=angle_sigma,
            position_sigma_m=position_sigma,
            ground_m=adjusted,
            ground_sigma_m=ground_sigma,
        ),
    )


def _camera(given: ScriptCamera, report: Report) -> tuple[Camera, BoolArray]:
    """Return the camera, and which of its parameters (12,) were held: estimated values are those of the result file,
    which has six digits, the others those of the script."""
    if len(report.cameras) != 1:
        raise ExchangeError(
            f"{given.place}: the result file has {things(len(report.cameras), 'camera')}, only projects of one are read"
        )
    values, estimated = dict(given.values), set[str]()
    for name, stated in report.cameras[0].items():
        if np.isfinite(stated.sigma):
            values[name] = stated.value
            estimated.add(name)
    bent = sorted(name for name, value in values.items() if name[0] in "KP" and (value != 0.0 or name in estimated))
    if bent or {"as", "sk"} & estimated or values["as"] != 0.0 or values["sk"] != 0.0:
        what = bent[0] if bent else "aspect or skew"
        raise ExchangeError(
            f"{given.place}: the camera has {what}: DBAT's distortion leads from the photograph to the ray, the "
            "inverse of photogram's: adjust without it"
        )
    width, height = given.pixel
    focal_px = values["cc"] / height
    camera = camera_of(
        given.place,
        given.name,
        (float(given.size_px[0]), float(given.size_px[1])),
        focal_px,
        (values["px"] / width - HALF_PIXEL, values["py"] / height - HALF_PIXEL),
        affinity=(values["cc"] / width - focal_px, 0.0) if abs(width / height - 1.0) > 1e-9 else (0.0, 0.0),
    )
    free = {_ESTIMATED[name] for name in estimated if name in _ESTIMATED}
    return camera, np.array([parameter.name not in free for parameter in CAMERA_PARAMETERS])


def _photographs(
    path: Path, script: Script, report: Report
) -> tuple[tuple[ForeignPhotograph, ...], dict[int, int], FloatArray, FloatArray]:
    """Return the photographs of the script with their poses, their places in the list by their numbers, and the stated
    sigmas of angles and positions (F, 3)."""
    reported = {}
    for each in report.photographs:
        name = file_of(each.place, each.name).name
        if name in reported:
            raise ExchangeError(f"{each.place}: the photograph {printable(shortened(name))} comes twice: {REMEDY}")
        reported[name] = each
    files = {number: file_of(str(path), text) for number, text in script.images.items()}
    check_names(str(path), files.values())
    strange = sorted(reported.keys() - {file.name for file in files.values()})
    if strange:
        raise ExchangeError(
            f"{path}: the photograph {printable(shortened(strange[0]))} is not among the images of the script: put the "
            "script of this adjustment beside the result file"
        )
    photographs, sigmas = [], np.full((len(files), 6), np.nan)
    for i, file in enumerate(files.values()):
        orientation = reported.get(file.name)
        pose = None
        if orientation is not None:
            rotation = rotation_from_omega_phi_kappa(orientation.values[:3])
            pose = pose_of(orientation.place, rotation, orientation.values[3:])
            sigmas[i] = orientation.sigmas
        photographs.append(ForeignPhotograph(file.name, 0, pose, file))
    return tuple(photographs), {number: i for i, number in enumerate(files)}, sigmas[:, :3], sigmas[:, 3:]


def _named(points: Points) -> list[str]:
    """Return names of ground points: the id, with the label where it is another."""
    return [
        f"{key} ({printable(label)})" if label and label != str(key) else str(key)
        for key, label in zip(points.id.tolist(), points.label, strict=True)
    ]


def _ground_points(script: Script, pixel: FloatArray, of_ground: IntArray, seen_in: IntArray) -> ControlPoints:
    control, check = script.control, script.check
    mine = of_ground >= 0
    roles: list[Role] = ["control" if i < len(control.id) else "check" for i in range(len(control.id) + len(check.id))]
    return ControlPoints(
        (*_named(control), *_named(check)),
        tuple(roles),
        np.concatenate([control.position_m, check.position_m]),
        np.concatenate([control.sigma_m, check.sigma_m]),
        seen_in[mine],
        of_ground[mine],
        pixel[mine],
        isotropic_px2(script.marks.sigma_px[mine]),
    )


def _tie_points(ids: IntArray, photograph: IntArray, pixel: FloatArray, sigma_px: FloatArray) -> TiePoints:
    """Return the points without a survey, in the order of their ids; the files do not hold their positions."""
    order = np.lexsort((photograph, ids))
    known, number = np.unique(ids[order], return_inverse=True)
    return TiePoints(
        photograph[order],
        number.astype(np.int64),
        np.full(len(order), TRANSFERRED, dtype=np.int64),
        pixel[order] - HALF_PIXEL,
        sigma_px[order],
        np.full((len(known), 3), np.nan),
        np.zeros((len(known), 3), dtype=np.uint8),
    )


def _adjusted_ground(ids: IntArray, report: Report) -> tuple[FloatArray, FloatArray]:
    """Return ground points (G, 3) and their sigmas (G, 3) as the result file has them, NaN where it has none."""
    nothing = np.full(3, np.nan), np.full(3, np.nan)
    rows = np.array([report.ground.get(key, nothing) for key in ids.tolist()]).reshape(-1, 2, 3)
    return rows[:, 0], rows[:, 1]


def _left_out(fixed: BoolArray) -> tuple[str, ...]:
    digits = "Further digits of the estimated calibration: the result file has six."
    return (
        "The positions of tie points: the result file does not list them.",
        "Correlations above 95 %, ray counts and angles of intersection: what follows from the measurements.",
        *sentences((not fixed.all(), digits)),
    )
