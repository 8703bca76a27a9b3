"""A small block over undulating ground, whose kernels are those of every survey: for compiling them early.

Its observations have noise, and its starting values are off, so that adjusting it does all that a survey asks for.
"""

from datetime import UTC, datetime, timedelta

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import Camera, Pose, project_points
from photogram.geodesy.frames import LocalFrame
from photogram.measures.mark_covariances import isotropic_px2
from photogram.survey import Block, ControlPoints, Photograph, Role, TiePoints

STRIPS, IN_STRIP = 2, 4
HEIGHT_M = 80.0
"""Flying height above the mean ground."""
BASE_M, ACROSS_M = 15.0, 20.0
"""Distances of photographs along a strip, and of the strips."""
CONTROL, CHECK = 6, 2
TIE_POINTS = 200
MARK_SIGMA_PX, TIE_POINT_SIGMA_PX = 0.3, 0.5

_CALIBRATION_SIGMAS = (50.0, 10.0, 10.0, 0.05, 0.05, 0.02, 0.0, 0.001, 0.001, 0.0, 0.0, 0.0)
_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
_START = datetime(2026, 5, 1, 10, tzinfo=UTC)


def sample_block() -> Block:
    """Return a block of eight photographs with positions, control and check points and TIE_POINTS tie points.

    Simulated, the same at every call.
    """
    rng = np.random.default_rng(1)
    camera = Camera(
        "sample",
        1200,
        900,
        1800.0,
        principal_point_px=np.array([602.5, 447.5]),
        radial=np.array([-0.08, 0.06, -0.01, 0.0]),
        tangential=np.array([0.0004, -0.0003]),
        sigmas=np.array(_CALIBRATION_SIGMAS),
    )
    place = np.array([(i * BASE_M, s * ACROSS_M) for s in range(STRIPS) for i in range(IN_STRIP)])
    centres = np.column_stack([place, np.full(len(place), HEIGHT_M)]) + 0.5 * rng.standard_normal((len(place), 3))
    poses = [Pose(_DOWN, centre) for centre in centres]
    ground = _ground(TIE_POINTS, rng)
    surveyed = _ground(CONTROL + CHECK, rng)
    photograph, point, pixel = _rays(camera, poses, ground, TIE_POINT_SIGMA_PX, rng)
    feature = np.concatenate([np.arange(n) for n in np.bincount(photograph, minlength=len(poses))])
    order = np.lexsort((photograph, point))
    mark_photograph, mark_point, mark_pixel = _rays(camera, poses, surveyed, MARK_SIGMA_PX, rng)
    roles: tuple[Role, ...] = tuple("control" if n < CONTROL else "check" for n in range(CONTROL + CHECK))
    return Block(
        LocalFrame.near("EPSG:32632", np.array([[500_000.0, 5_300_000.0, 0.0]])),
        (camera,),
        tuple(_photograph(number, centre, rng) for number, centre in enumerate(centres)),
        tuple(Pose(_DOWN, centre + rng.standard_normal(3)) for centre in centres),
        TiePoints(
            photograph[order],
            point[order],
            feature[order],
            pixel[order],
            np.full(len(point), TIE_POINT_SIGMA_PX),
            ground + rng.standard_normal(ground.shape),
            np.full((len(ground), 3), 128, np.uint8),
        ),
        ControlPoints(
            tuple(f"P{number + 1}" for number in range(len(roles))),
            roles,
            surveyed,
            np.full((len(roles), 3), 0.01),
            mark_photograph,
            mark_point,
            mark_pixel,
            isotropic_px2(np.full(len(mark_point), MARK_SIGMA_PX)),
        ),
        gnss_offset_sigma_m=np.full(3, 1.0),
    )


def _ground(count: int, rng: np.random.Generator) -> FloatArray:
    """Return points (N, 3) of undulating ground below the photographs."""
    xy = rng.uniform((-5.0, -10.0), (BASE_M * IN_STRIP - 10.0, ACROSS_M + 10.0), (count, 2))
    return np.column_stack([xy, 3.0 * np.sin(xy[:, 0] / 9.0) * np.cos(xy[:, 1] / 7.0)])


def _rays(
    camera: Camera, poses: list[Pose], ground: FloatArray, sigma_px: float, rng: np.random.Generator
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return photograph, point and noisy pixel of every ray, by photograph."""
    pixel = np.array([project_points(camera, pose, ground) for pose in poses])
    last = np.array([camera.width_px, camera.height_px]) - 1.0
    photograph, point = np.nonzero(np.all((pixel > 5.0) & (pixel < last - 5.0), axis=2))
    noise = sigma_px * rng.standard_normal((len(point), 2))
    return photograph, point, pixel[photograph, point] + noise


def _photograph(number: int, centre: FloatArray, rng: np.random.Generator) -> Photograph:
    sigma_m = np.array([2.0, 2.0, 3.0])
    return Photograph(
        f"sample_{number + 1}.JPG",
        0,
        time=_START + timedelta(seconds=3.0 * number),
        gnss_world_m=centre + sigma_m * rng.standard_normal(3),
        gnss_sigma_m=sigma_m,
        attitude_world_from_camera=_DOWN,
        attitude_sigma_rad=0.03,
        height_above_ground_m=HEIGHT_M,
    )
