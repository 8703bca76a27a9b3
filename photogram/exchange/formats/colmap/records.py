"""What COLMAP's files hold, as they hold it; its camera models to and from photogram's.

In COLMAP the centre of the top-left pixel is (0.5, 0.5), and poses are camera from world with x to the right, y down
and z forward (COLMAP documentation, Output Format); the models are those of src/colmap/sensor/models.h. Of its models
thin prism, FOV, division, EUCM and the rational part of FULL_OPENCV are not photogram's, and a panorama is none.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from photogram.arrays import ByteArray, FloatArray, IntArray
from photogram.camera import Camera
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import HALF_PIXEL, camera_of
from photogram.projection import Model


class CameraModel(NamedTuple):
    """A camera model of COLMAP: its name, the names of its parameters, and the model of photogram that it is where the
    parameters that photogram has no place for are zero; None where it never is."""

    name: str
    parameters: tuple[str, ...]
    kind: Model | None


def _model(name: str, parameters: str, kind: Model | None) -> CameraModel:
    return CameraModel(name, tuple(parameters.split()), kind)


MODELS = {
    0: _model("SIMPLE_PINHOLE", "f cx cy", "brown"),
    1: _model("PINHOLE", "fx fy cx cy", "brown"),
    2: _model("SIMPLE_RADIAL", "f cx cy k1", "brown"),
    3: _model("RADIAL", "f cx cy k1 k2", "brown"),
    4: _model("OPENCV", "fx fy cx cy k1 k2 p1 p2", "brown"),
    5: _model("OPENCV_FISHEYE", "fx fy cx cy k1 k2 k3 k4", "fisheye"),
    6: _model("FULL_OPENCV", "fx fy cx cy k1 k2 p1 p2 k3 r4 r5 r6", "brown"),
    7: _model("FOV", "fx fy cx cy omega", None),
    8: _model("SIMPLE_RADIAL_FISHEYE", "f cx cy k1", "fisheye"),
    9: _model("RADIAL_FISHEYE", "f cx cy k1 k2", "fisheye"),
    10: _model("THIN_PRISM_FISHEYE", "fx fy cx cy k1 k2 p1 p2 k3 k4 s1 s2", "fisheye"),
    11: _model("RAD_TAN_THIN_PRISM_FISHEYE", "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3", None),
    12: _model("SIMPLE_DIVISION", "f cx cy k", None),
    13: _model("DIVISION", "fx fy cx cy k", None),
    14: _model("SIMPLE_FISHEYE", "f cx cy", "fisheye"),
    15: _model("FISHEYE", "fx fy cx cy", "fisheye"),
    16: _model("EUCM", "fx fy cx cy alpha beta", None),
    17: _model("EQUIRECTANGULAR", "w h", None),
}
"""The models by their numbers in binary files; r4 to r6 are the denominator of FULL_OPENCV, its k4 to k6."""

NUMBERS = {model.name: number for number, model in MODELS.items()}

_SIMPLEST = {"brown": (1, 2, 3, 4, 6), "fisheye": (14, 15, 8, 9, 5, 10)}
"""The models of a kind that are written, the one with the fewest parameters first; without distortion PINHOLE, as
COLMAP's own undistorter writes it: dense programs take no SIMPLE_PINHOLE."""


@dataclass(frozen=True, eq=False)
class ColmapCamera:
    """A camera as it stands in cameras.bin or cameras.txt."""

    number: int
    model: int
    """Number of its model."""
    size_px: tuple[int, int]
    parameters: FloatArray
    """Parameters of the model, in its order."""


@dataclass(frozen=True, eq=False)
class ColmapImage:
    """A photograph as it stands in images.bin or images.txt."""

    number: int
    quaternion: FloatArray
    """Rotation (4,) camera from world, w first."""
    translation: FloatArray
    """Translation (3,) camera from world."""
    camera: int
    """Number of its camera."""
    name: str
    pixel: FloatArray
    """Its key points (N, 2), in COLMAP's pixels."""
    point: IntArray
    """Number (N,) of the tie point of each, −1 where it has none."""


@dataclass(frozen=True, eq=False)
class ColmapPoints:
    """The tie points (P) of points3D.bin or points3D.txt with their observations (T)."""

    number: IntArray
    """Numbers (P,)."""
    position: FloatArray
    """Positions (P, 3)."""
    colour: ByteArray
    """Red, green, blue (P, 3)."""
    error_px: FloatArray
    """Mean length (P,) of the reprojection residuals, negative where it was not computed."""
    track_point: IntArray
    """Index (T,), from 0 in the order of the file, of the point of each observation."""
    track_image: IntArray
    """Number (T,) of the photograph of each observation."""
    track_feature: IntArray
    """Index (T,) of its key point there."""


@dataclass(frozen=True, eq=False)
class SparseModel:
    """A sparse model as its three files hold it."""

    cameras: tuple[ColmapCamera, ...]
    images: tuple[ColmapImage, ...]
    points: ColmapPoints


def model_of(where: str, number: int) -> CameraModel:
    """Return a model by its number. Raises ExchangeError where COLMAP has none of it."""
    if number not in MODELS:
        raise ExchangeError(
            f"{where}: COLMAP has no camera model {number}: the file is damaged, or newer than COLMAP 4"
        )
    return MODELS[number]


def from_colmap(where: str, camera: ColmapCamera) -> Camera:
    """Return a camera in photogram's terms. Raises ExchangeError where its model is not one of photogram's."""
    model = model_of(where, camera.model)
    name = f"camera {camera.number}"
    if model.kind is None:
        raise ExchangeError(
            f"{where}: {name}: photogram has no camera model {model.name}: run COLMAP's bundle adjustment with OPENCV "
            "or OPENCV_FISHEYE"
        )
    q = dict(zip(model.parameters, camera.parameters.tolist(), strict=True))
    lost = [p for p in ("r4", "r5", "r6", "s1", "s2") if q.get(p, 0.0) != 0.0]
    if lost:
        part = "its rational distortion (k4, k5, k6)" if lost[0][0] == "r" else "its thin prism (sx1, sy1)"
        raise ExchangeError(
            f"{where}: {name}: photogram's cameras cannot hold {part} of {model.name}: run COLMAP's bundle adjustment "
            "with OPENCV or OPENCV_FISHEYE"
        )
    fx, fy = q.get("fx", q.get("f", 0.0)), q.get("fy", q.get("f", 0.0))
    return camera_of(
        where,
        str(camera.number),
        camera.size_px,
        fy,
        (q["cx"] - HALF_PIXEL, q["cy"] - HALF_PIXEL),
        [q.get(k, 0.0) for k in ("k1", "k2", "k3", "k4")],
        (q.get("p1", 0.0), q.get("p2", 0.0)),
        (fx - fy, 0.0),
        model.kind,
    )


def to_colmap(where: str, number: int, camera: Camera) -> ColmapCamera:
    """Return a camera as COLMAP holds it, of the model with the fewest parameters. Raises ExchangeError where none
    holds it."""
    fx = camera.focal_px + camera.affinity[0]
    cx, cy = camera.principal_point_px + HALF_PIXEL
    k1, k2, k3, k4 = camera.radial
    p1, p2 = camera.tangential
    q = {"f": camera.focal_px, "fx": fx, "fy": camera.focal_px, "cx": cx, "cy": cy, "k1": k1, "k2": k2, "k3": k3}
    q |= {"k4": k4, "p1": p1, "p2": p2, **dict.fromkeys(("r4", "r5", "r6", "s1", "s2"), 0.0)}
    needed = {name for name in ("k1", "k2", "k3", "k4", "p1", "p2") if q[name] != 0.0}
    if camera.affinity[1] == 0.0:
        for candidate in _SIMPLEST[camera.model]:
            names = MODELS[candidate].parameters
            if needed <= set(names) and ("fx" in names or camera.affinity[0] == 0.0):
                size = (camera.width_px, camera.height_px)
                return ColmapCamera(number, candidate, size, np.array([q[name] for name in names]))
    beyond = "the skew b2" if camera.affinity[1] != 0.0 else "k4"
    raise ExchangeError(
        f"{where}: camera {camera.name}: no camera model of COLMAP holds {beyond}: calibrate without it"
    )
