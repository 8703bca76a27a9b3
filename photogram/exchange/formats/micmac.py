"""MicMac's orientations: a folder Ori-* with Orientation-<photograph>.xml and the calibrations that they name.

A ray (x, y) = (X/Z, Y/Z) falls on q = PP + F (x, y); the distortion moves it, in pixels about the centre CDist, by

    radial:       (q − CDist) (c1 R² + c2 R⁴ + …),  R = |q − CDist|                       (ModRad)
    Fraser's:     the same, and P1 (R² + 2 dx²) + 2 P2 dx dy + b1 dx + b2 dy,
                  2 P1 dx dy + P2 (R² + 2 dy²)                                             (ModPhgrStd)

from the ray to the photograph, which MicMac calls eConvApero_DistM2C (MicMac, cDistModStdPhpgr::Direct). The rows L1,
L2, L3 are the rotation, world from camera, with x right, y down, z forward; pixels have the centre of the top-left one
at (0, 0). Photogram's distortion is about the principal point: where CDist is another place, or b1 or b2 meet a
distortion, the calibration is fitted, and what remains is said.
"""

from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from scipy.optimize import least_squares

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, project_points
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import camera_of, check_names, no_tie_points, pose_of
from photogram.files.solutions.parsing import bytes_of, file_of, number_of, numbers_of
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.files.xml_elements import Element, elements_of
from photogram.projection import PARAMETERS
from photogram.wording import printable, shortened

_MOST_BYTES = 20_000_000
_START, _END = "Orientation-", ".xml"
_FORWARD = "eConvApero_DistM2C"
_PINHOLE = "eProjStenope"
_REMEDY = "run Tapas again, or convert the orientation with MicMac"
_EXACT_PX = 1e-6
_WORST_PX = 1.0
_GRID = 25
_MOST_COEFFICIENTS = 20


@dataclass(frozen=True)
class _Calibration:
    """What MicMac's file says."""

    size_px: FloatArray
    focal_px: float
    principal_point_px: FloatArray
    centre_px: FloatArray
    radial: FloatArray
    tangential: FloatArray
    affinity: FloatArray

    def project(self, ideal: FloatArray) -> FloatArray:
        """Return the pixels (N, 2) of ideal coordinates (N, 2), by the formulas above."""
        q = self.principal_point_px + self.focal_px * ideal
        d = q - self.centre_px
        dx, dy = d.T
        r2 = dx**2 + dy**2
        p1, p2 = self.tangential
        b1, b2 = self.affinity
        factor = r2 * np.polyval(self.radial[::-1], r2) if len(self.radial) else np.zeros(len(r2))
        u = factor * dx + p1 * (r2 + 2 * dx**2) + 2 * p2 * dx * dy + b1 * dx + b2 * dy
        v = factor * dy + 2 * p1 * dx * dy + p2 * (r2 + 2 * dy**2)
        return np.asarray(q + np.column_stack([u, v]))


def read_micmac(folder: Path) -> ForeignSolution:
    """Return the cameras and photographs of a folder Ori-*.

    Coordinates are local: MicMac's files do not say in which system they are. Raises ExchangeError where a file is
    damaged or missing, or a calibration has another model, such as a fisheye or general polynomials.
    """
    try:
        files = sorted(file for file in folder.iterdir() if file.name.startswith(_START) and file.name.endswith(_END))
    except (OSError, ValueError) as error:
        raise ExchangeError(f"{folder}: cannot be read ({error}): give a folder Ori-… of MicMac") from error
    if not files:
        raise ExchangeError(f"{folder}: has no file {_START}…{_END}: give a folder Ori-… of MicMac")
    cameras: list[Camera] = []
    left_out: list[str] = []
    known: dict[str, int] = {}
    photographs = []
    for file in files:
        orientation = _content(file, "OrientationConique")
        name = file_of(str(file), file.name[len(_START) : -len(_END)])
        key, place, calibration = _calibration_of(orientation)
        if key not in known:
            known[key] = len(cameras)
            camera, sentence = _camera(place, PurePosixPath(key).stem, calibration)
            cameras.append(camera)
            left_out += [sentence] if sentence else []
        photographs.append(ForeignPhotograph(name.name, known[key], _pose(orientation), name))
    check_names(str(folder), (photograph.file for photograph in photographs))
    return ForeignSolution(
        program="MicMac",
        cameras=tuple(cameras),
        photographs=tuple(photographs),
        tie_points=no_tie_points(),
        left_out=(*left_out, "Tie points: MicMac's homologous points have no positions."),
    )


def _content(file: Path, tag: str) -> Element:
    """Return the element of a file that has this tag, by itself or in MicMac's envelope."""
    root = elements_of(bytes_of(file, _MOST_BYTES), file, ExchangeError, _REMEDY)
    return root.first("ExportAPERO", tag) or _child(root, tag)


def _child(element: Element, *tags: str) -> Element:
    """Return the element at the end of a path of tags. Raises ExchangeError where there is none."""
    child = element.first(*tags)
    if child is None:
        raise ExchangeError(f"{element.place}: has no {' / '.join(tags)}: {_REMEDY}")
    return child


def _numbers(element: Element, *tags: str, count: int) -> FloatArray:
    """Return the numbers (count,) of the element at the end of a path of tags."""
    child = _child(element, *tags)
    return numbers_of(child.place, child.tag, child.text, count)


def _pose(orientation: Element) -> Pose:
    for convention in (("Externe", "KnownConv"), ("ConvOri", "KnownConv")):
        for element in orientation.all(*convention):
            if element.text != _FORWARD:
                raise ExchangeError(
                    f"{element.place}: has the convention {printable(shortened(element.text))}, only "
                    f"{_FORWARD} is read: {_REMEDY}"
                )
    matrix = ("Externe", "ParamRotation", "CodageMatr")
    rows = [_numbers(orientation, *matrix, row, count=3) for row in ("L1", "L2", "L3")]
    return pose_of(orientation.place, np.array(rows), _numbers(orientation, "Externe", "Centre", count=3))


def _calibration_of(orientation: Element) -> tuple[str, str, _Calibration]:
    """Return what the calibration of a photograph is known by, where it stands, and itself.

    MicMac names its file from where it was run: the file of that name in the folder is read, and no other.
    """
    kind = orientation.first("TypeProj")
    if kind is not None and kind.text != _PINHOLE:
        raise ExchangeError(f"{kind.place}: has the projection {printable(shortened(kind.text))}: {_REMEDY}")
    inside = orientation.first("Interne")
    if inside is not None:
        return orientation.file.name, inside.place, _calibration(inside)
    named = _child(orientation, "FileInterne")
    name = file_of(named.place, named.text).name
    path = orientation.file.parent / name
    if path.is_symlink():
        raise ExchangeError(f"{path}: is a link in a folder of another program: put the file in its place")
    element = _content(path, "CalibrationInternConique")
    return name, element.place, _calibration(element)


def _calibration(element: Element) -> _Calibration:
    convention = element.first("KnownConv")
    if convention is not None and convention.text != _FORWARD:
        raise ExchangeError(
            f"{convention.place}: its distortion leads from the photograph to the ray "
            f"({printable(shortened(convention.text))}), the inverse of photogram's: {_REMEDY}"
        )
    pp, f, size = (_numbers(element, tag, count=count) for tag, count in (("PP", 2), ("F", 1), ("SzIm", 2)))
    models = [model for distortion in element.all("CalibDistortion") for model in distortion.children]
    models = [model for model in models if model.tag != "ModNoDist"]
    if len(models) > 1:
        raise ExchangeError(f"{models[1].place}: has {len(models)} distortions in a row: {_REMEDY}")
    nothing = np.zeros(2)
    if not models:
        return _Calibration(size, float(f[0]), pp, pp, np.zeros(0), nothing, nothing)
    model = models[0]
    if model.tag not in ("ModRad", "ModPhgrStd"):
        kind = next((child.text for child in model.children if child.tag == "TypeModele"), model.tag)
        raise ExchangeError(
            f"{model.place}: has MicMac's distortion {printable(shortened(kind))}, which photogram has not: "
            "run Tapas with RadialBasic, RadialStd or Fraser"
        )
    radial = model if model.tag == "ModRad" else model.first("RadialePart")
    if radial is None:
        raise ExchangeError(f"{model.place}: has no RadialePart: {_REMEDY}")
    coefficients = [number_of(c.place, "CoeffDist", c.text) for c in radial.all("CoeffDist")]
    if len(coefficients) > _MOST_COEFFICIENTS:
        raise ExchangeError(f"{radial.place}: has {len(coefficients)} radial coefficients: {_REMEDY}")
    terms = [model.first(tag) for tag in ("P1", "P2", "b1", "b2")]
    more = [0.0 if term is None else number_of(term.place, term.tag, term.text) for term in terms]
    centre = _numbers(radial, "CDist", count=2)
    return _Calibration(size, float(f[0]), pp, centre, np.array(coefficients), np.array(more[:2]), np.array(more[2:]))


def _camera(place: str, name: str, calibration: _Calibration) -> tuple[Camera, str]:
    """Return the camera, and a sentence where it is a fit. Raises ExchangeError where it does not fit to 1 px."""
    size, f = calibration.size_px, calibration.focal_px
    powers = f ** (2.0 * np.arange(1, len(calibration.radial) + 1)) if 0 < f < 1e6 else np.zeros(0)
    if not len(powers) and len(calibration.radial):
        raise ExchangeError(f"{place}: the focal length is {f:g} px: it must be positive, correct the calibration")
    k = np.zeros(max(4, len(powers)))
    with np.errstate(over="ignore"):
        k[: len(powers)] = calibration.radial * powers
        p1, p2 = calibration.tangential * f
        b1, b2 = calibration.affinity * f
    start = camera_of(
        place,
        name,
        (float(size[0]), float(size[1])),
        f,
        calibration.principal_point_px.tolist(),
        k[:4].tolist(),
        (p2, p1),
        (b1, b2),
    )
    ideal = _rays(calibration)
    with np.errstate(over="ignore", invalid="ignore"):
        true = calibration.project(ideal)
        exact = _pixels(start, ideal)
    if not np.isfinite(true).all():
        raise ExchangeError(f"{place}: its distortion is not finite within the photograph: correct the calibration")
    if np.isfinite(exact).all() and np.abs(exact - true).max() <= _EXACT_PX:
        return start, ""
    camera = _fitted(start, ideal, true)
    worst = float(np.linalg.norm(_pixels(camera, ideal) - true, axis=1).max())
    if not worst <= _WORST_PX:
        raise ExchangeError(
            f"{place}: its distortion about ({calibration.centre_px[0]:.1f}, {calibration.centre_px[1]:.1f}) fits none "
            f"of photogram's cameras to {_WORST_PX:g} px: run Tapas with RadialBasic or Fraser"
        )
    return camera, (
        f"What a fit does not hold of the calibration {printable(name)}, whose distortion has another centre or order "
        f"in MicMac: at most {worst:.2g} px."
    )


def _rays(calibration: _Calibration) -> FloatArray:
    """Return ideal coordinates (N, 2) of a grid over the photograph, before its distortion."""
    axes = (np.linspace(0.0, side - 1.0, _GRID) for side in calibration.size_px)
    pixel = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    return np.asarray((pixel - calibration.principal_point_px) / calibration.focal_px)


def _pixels(camera: Camera, ideal: FloatArray) -> FloatArray:
    return project_points(camera, Pose(np.eye(3), np.zeros(3)), np.column_stack([ideal, np.ones(len(ideal))]))


def _fitted(start: Camera, ideal: FloatArray, true: FloatArray) -> Camera:
    """Return the camera that shows the rays nearest to their pixels (N, 2)."""
    units = _units(start)

    def misfit(step: FloatArray) -> FloatArray:
        residual = _pixels(start.with_parameters(start.parameters + step * units), ideal) - true
        return np.asarray(np.where(np.isfinite(residual), residual, 1e3).ravel())

    fit = least_squares(misfit, np.zeros(PARAMETERS), method="lm", xtol=1e-14, ftol=1e-14, max_nfev=3000)
    fitted = start.parameters + fit.x * units
    return start.with_parameters(fitted) if fitted[0] > 0 else start


def _units(camera: Camera) -> FloatArray:
    """Return steps (12,) of the parameters that move the corners by about a pixel; 0 for the read-out time, which moves
    none."""
    f = camera.focal_px
    r = np.hypot(camera.width_px, camera.height_px) / 2 / f
    radial = [1 / (f * r ** (2 * i + 1)) for i in range(1, 5)]
    tangential = 1 / (f * r**2)
    return np.array([1 / r, 1.0, 1.0, *radial, tangential, tangential, 1 / r, 1 / r, 0.0])
