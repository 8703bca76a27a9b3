"""What several tests are made of: simulated blocks and their problems."""

import io
import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
import pytest
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from PIL import Image
from seeds import ALL

from photogram.adjustment.problem import AdjustmentSettings, make_problem, start_state
from photogram.arrays import FloatArray
from photogram.camera import Camera
from photogram.factors.covariance import Covariances
from photogram.factors.elimination.loss import RobustLoss
from photogram.factors.elimination.state import State
from photogram.factors.graph import Problem
from photogram.factors.joint_covariance import joint_ground_covariance
from photogram.marking.page.session import MarkingSession
from photogram.projection import PARAMETERS
from photogram.report.record.ground import GroundPointRecord
from photogram.results import (
    Adjustment,
    AdjustmentCovariances,
    Estimates,
    Reliability,
    StatisticalTests,
    VarianceComponents,
)
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block
from photogram.survey import Block, Role

SharedData = Callable[[str], Path]
"""The fixture ``shared_data``: the path of a file or folder outside of the repository, by its name there."""

Json = Any
"""What a file of JSON holds, as a script of a user reads it: nothing is known of its keys, and a test may change it."""

PHANTOM = Camera(
    "p",
    5472,
    3648,
    3670.0,
    np.array([2741.0, 1837.0]),
    np.array([-0.26, 0.11, -0.035, 0.0]),
    np.array([-0.001, 0.0008]),
)
"""A camera like that of a Phantom 4."""

WIDE = Camera(
    "wide",
    4000,
    3000,
    2900.0,
    np.array([2010.0, 1490.0]),
    radial=np.array([-0.05, 0.02, -0.004, 0.0]),
    tangential=np.array([4e-4, -3e-4]),
    affinity=np.array([1.5, -0.8]),
)
"""A camera of which every term is there."""

LEAST_SQUARES = AdjustmentSettings(robust_loss="none", outlier_threshold=100.0, estimate_sigmas=False)
"""Of everything, with the sigmas as stated: no loss, nothing rejected."""

SMALL = SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=2, flights=2)
FREE = (5.0, 3.0, 3.0, 0.004, 0.0, 0.0, 0.0, 0.0002, np.inf, 0.0, 0.0)
"""Sigmas of a calibration of which some parameters are held, some known and one is free."""


def _grey_picture(kind: str) -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", (8, 8), (128, 128, 128)).save(stream, kind)
    return stream.getvalue()


EMPTY_PICTURES = {
    "svg": b'<svg xmlns="http://www.w3.org/2000/svg"/>',
    "png": _grey_picture("PNG"),
    "jpeg": _grey_picture("JPEG"),
}


@contextmanager
def undrawing() -> Iterator[None]:
    """Make figures but do not draw them, which takes most of the time of a small survey's last stage: an empty picture
    stands for each, and texts are measured where they stand before the layout. For whole surveys of which a test looks
    at no picture, and others draw the same figures."""

    def stand_in(canvas: type[FigureCanvasBase], method: str, content: bytes) -> Callable[..., None]:
        drawn = getattr(canvas, method)

        def save(self: FigureCanvasBase, target: str | Path | BinaryIO, **options: object) -> None:
            if "draw" in vars(self.figure):  # matplotlib asks for what measures texts, and ends before it draws
                drawn(self, target, **options)
            elif isinstance(target, str | Path):
                Path(target).write_bytes(content)
            else:
                target.write(content)

        return save

    with pytest.MonkeyPatch.context() as patch:
        for canvas, method, kind in (
            (FigureCanvasAgg, "print_png", "png"),
            (FigureCanvasAgg, "print_jpg", "jpeg"),
            (FigureCanvasSVG, "print_svg", "svg"),
        ):
            patch.setattr(canvas, method, stand_in(canvas, method, EMPTY_PICTURES[kind]))
        patch.setattr(Figure, "draw_without_rendering", lambda _: None)
        patch.setattr(ConstrainedLayoutEngine, "execute", lambda *_: None)
        yield


def undrawing_unless_all() -> AbstractContextManager[None]:
    """Return ``undrawing``, or in the run of all seeds a context that draws as usual."""
    return nullcontext() if ALL else undrawing()


def textured(width: int, height: int, seed: int) -> np.ndarray:
    """Return a picture (height, width, 3) of noise with detail from one pixel up to 32, in colour."""
    rng = np.random.default_rng(seed)
    layers = []
    for wavelength in (1, 2, 4, 8, 16, 32):
        layer = cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), wavelength)
        layers.append(layer / layer.std())
    total = np.sum(layers, axis=0)
    grey = np.clip(128 + 35 * total / total.std(), 0, 255).astype(np.uint8)
    return np.dstack([grey, np.roll(grey, 1, axis=1), 255 - grey])


def read_json(path: Path) -> Json:
    """Return what a file of JSON holds."""
    return json.loads(path.read_text(encoding="utf-8"))


def no_matlab(path: Path, *_: object) -> Camera:
    """Read the camera of a project that names no MATLAB file."""
    raise AssertionError(f"nothing to read from {path}")


def simulated(
    plan: SurveyPlan, seed: int = 1, *, off: float = 0.05, tie_points: int = 150, mismatches: float = 0.0
) -> SimulatedBlock:
    """Simulate the observations of a plan; positions, attitudes and points start ``off`` (m, °) from the truth."""
    return simulate_block(
        plan, seed, tie_points=tie_points, mismatches=mismatches, start_position_sigma_m=off,
        start_attitude_sigma_deg=off, start_point_sigma_m=off,
    )  # fmt: skip


def problem_of(block: Block, loss: RobustLoss = "none") -> tuple[Problem, State]:
    """Return the problem of a block and the state to start from."""
    problem = make_problem(block, AdjustmentSettings(robust_loss=loss))
    return problem, start_state(problem)


def small_problem(seed: int = 1, sigmas: tuple[float, ...] = FREE, *, mismatches: float = 0.0) -> tuple[Problem, State]:
    """Return a block of six photographs, 40 tie points, and everything that can hold it, close to its solution."""
    made = simulate_block(
        replace(SMALL, calibration_sigmas=sigmas), seed, tie_points=40, sigma_px=0.5, start_position_sigma_m=0.02,
        start_attitude_sigma_deg=0.05, start_point_sigma_m=0.02, mismatches=mismatches,
    )  # fmt: skip
    problem, state = problem_of(made.block)
    return problem, replace(state, offset=np.random.default_rng(seed).normal(0, 0.2, state.offset.shape))


def joint_control_points(problem: Problem, state: State, estimated: Covariances) -> FloatArray:
    """Return the joint covariance (3 G, 3 G) of all adjusted control points in the world, m²."""
    points = problem.block.control_points
    ground_world_m, controls = points.position_world_m.copy(), np.array(points.role) == "control"
    ground_world_m[controls], ground_world_m[~controls] = state.control, np.nan
    rows = (3 * np.flatnonzero(controls)[:, None] + np.arange(3)).ravel()
    joint = joint_ground_covariance(problem, state, estimated, ground_world_m)
    return np.asarray(joint[np.ix_(rows, rows)])


def ground_point(name: str, role: Role = "control", residual_m: Sequence[float] | None = None) -> GroundPointRecord:
    """Return what a report says of a ground point that nothing is known of but its residuals (3,), m: the same role
    along each axis, surveyed to 10 mm in plan and 20 mm in height."""
    return {
        "name": name,
        "role": role,
        "axis_roles": [role] * 3,
        "surveyed_map_m": [0.0, 0.0, 0.0],
        "surveyed_sigma_m": [0.01, 0.01, 0.02],
        "adjusted_map_m": None,
        "residual_m": None if residual_m is None else list(residual_m),
        "sigma_m": None,
        "redundancy": None,
        "w": None,
        "mdb_m": None,
        "suspect": None,
        "effect_m": None,
        "left_out_m": None,
        "left_out_sigma_m": None,
        "chi2": None,
        "verdict": None,
        "marks": [],
        "z": None,
        "mahalanobis": None,
    }


def true_centres(made: SimulatedBlock) -> FloatArray:
    """Return the true projection centres (N, 3) of a simulated block in the world, m."""
    return np.array([pose.position_world_m for pose in made.truth.poses])


def without_marks(block: Block) -> Block:
    """Return a block whose ground points nobody has marked."""
    nothing = np.zeros(0, dtype=np.int64)
    bare = replace(
        block.control_points, mark_photograph=nothing, mark_point=nothing, mark_pixel=np.zeros((0, 2)),
        mark_covariance_px2=np.zeros((0, 2, 2)),
    )  # fmt: skip
    return replace(block, control_points=bare)


def marks_of(block: Block, point: int) -> list[tuple[str, str, tuple[float, float]]]:
    """Return the marks of a ground point: its name, that of the photograph, u and v."""
    p = block.control_points
    return [
        (p.name[point], block.photographs[p.mark_photograph[m]].name, (float(u), float(v)))
        for m in np.flatnonzero(p.mark_point == point).tolist() for u, v in [p.mark_pixel[m]]
    ]  # fmt: skip


def in_best_photograph(block: Block) -> tuple[str, str, tuple[float, float]]:
    """Return a mark of the photograph that has most of them."""
    best = int(np.bincount(block.control_points.mark_photograph).argmax())
    every = [mark for g in range(len(block.control_points)) for mark in marks_of(block, g)]
    return next(mark for mark in every if mark[1] == block.photographs[best].name)


def wait_until_assessed(session: MarkingSession) -> None:
    """Wait until what follows from the marks of a session is known."""
    limit = time.monotonic() + 120
    while session.snapshot().is_computing:
        assert time.monotonic() < limit
        time.sleep(0.02)


def bare_adjustment(block: Block, position_m2: FloatArray, rotation_rad2: FloatArray) -> Adjustment:
    """An adjustment of a block without ground points, zero but for the covariances (N, 3, 3) of its poses."""
    photographs, cameras, points = len(block.photographs), len(block.cameras), len(block.tie_points)
    estimates = Estimates(
        residual_px=np.zeros((len(block.tie_points.point), 2)),
        mark_residual_px=np.zeros((0, 2)),
        ground_world_m=np.zeros((0, 3)),
        flights=(),
        offset_world_m=np.zeros((0, 3)),
    )
    covariances = AdjustmentCovariances(
        position_m2=position_m2,
        rotation_rad2=rotation_rad2,
        calibration=np.zeros((cameras, PARAMETERS, PARAMETERS)),
        tie_point_m2=np.zeros((points, 3, 3)),
        tie_point_ray_m2=np.zeros((points, 3, 3)),
        ground_m2=np.zeros((0, 3, 3)),
        ground_joint_m2=np.zeros((0, 0)),
        offset_m2=np.zeros((0, 3, 3)),
    )
    tests = StatisticalTests(Reliability.unknown(0, 0, photographs), VarianceComponents.unknown())
    return Adjustment(block, 1.0, 1, 1, 1, True, 0.0, estimates, covariances, tests)


def assert_same(one: Any, other: Any) -> None:
    """Assert that two values are of the same types and bits."""
    assert type(one) is type(other)
    if is_dataclass(one):
        for f in fields(one):
            assert_same(getattr(one, f.name), getattr(other, f.name))
    elif isinstance(one, np.ndarray):
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
        np.testing.assert_array_equal(one.view(f"V{one.itemsize}"), other.view(f"V{other.itemsize}"))
    elif isinstance(one, tuple):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_same(a, b)
    elif isinstance(one, dict):
        assert_same(tuple(one.items()), tuple(other.items()))
    elif isinstance(one, float):
        assert np.float64(one).tobytes() == np.float64(other).tobytes() or (np.isnan(one) and np.isnan(other))
    else:
        assert one == other


def write_platform(path: Path, corners_map_m: FloatArray, height_m: float) -> Path:
    """Write a level platform with corners (4, 2) as LandXML, and return the file."""
    rows = (f'<P id="{n}">{y:.4f} {x:.4f} {height_m:.4f}</P>' for n, (x, y) in enumerate(corners_map_m.tolist(), 1))
    path.write_text(
        '<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2"><Surfaces><Surface name="platform"><Definition '
        f'surfType="TIN"><Pnts>{"".join(rows)}</Pnts><Faces><F>1 2 3</F><F>1 3 4</F></Faces></Definition></Surface>'
        "</Surfaces></LandXML>"
    )
    return path
