"""What tests of other programs' files share: a small solution, its reprojection, and files that are damaged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, project
from photogram.errors import ExchangeError
from photogram.files.exchange.solution import ForeignPhotograph, ForeignSolution
from photogram.survey import ControlPoints, TiePoints

NOISE_PX = 0.4
CUTS = 60
CHANGES = 200


def rotation_of(rotation_vector: FloatArray) -> FloatArray:
    """Return a rotation (3, 3) by its axis times its angle, rad (Rodrigues 1840)."""
    angle = float(np.linalg.norm(rotation_vector))
    x, y, z = rotation_vector / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K)


def small_solution(seed: int = 4, k4: float = 0.003, b: tuple[float, float] = (0.4, -0.3)) -> ForeignSolution:
    """Return five photographs, one not oriented, by two cameras, 30 tie points with noise of 0.4 px, three ground
    points; nothing of it is round or symmetric."""
    rng = np.random.default_rng(seed)
    cameras = (
        Camera("wide", 640, 482, 511.25, np.array([317.3, 244.9]), np.array([-0.11, 0.03, -0.007, k4]),
               np.array([-0.0011, 0.0007]), affinity=np.array(b)),
        Camera("long", 800, 600, 903.5, np.array([401.7, 296.2]), np.array([0.02, -0.01, 0.001, 0.0])),
    )  # fmt: skip
    points = rng.uniform([-6.0, -5.0, -1.0], [6.0, 5.0, 1.0], (30, 3))
    photographs = []
    for i in range(5):
        tilt = rotation_of(rng.normal(0.0, 0.15, 3))
        pose = Pose(tilt @ np.diag([1.0, -1.0, -1.0]), np.array([2.1 * i - 4.0, 0.3 * i - 0.5, 14.0 + 0.2 * i]))
        photographs.append(
            ForeignPhotograph(
                f"IMG_{i:03d}.JPG", i % 2, pose if i != 3 else None, PurePosixPath(f"flight 1/IMG_{i:03d}.JPG")
            )
        )
    photograph, point, pixel = [], [], []
    for i, shown in enumerate(photographs):
        if shown.pose is None:
            continue
        camera = cameras[shown.camera]
        at = project(camera, shown.pose, points)
        for j in np.flatnonzero(camera.contains(at)):
            photograph.append(i)
            point.append(int(j))
            pixel.append(at[j] + rng.normal(0.0, NOISE_PX / np.sqrt(2), 2))
    order = np.lexsort((photograph, point))
    n = len(order)
    tie_points = TiePoints(
        np.array(photograph)[order], np.array(point)[order], np.arange(n), np.array(pixel)[order], np.full(n, 1.0),
        points, rng.integers(0, 256, (30, 3)).astype(np.uint8),
    )  # fmt: skip
    ground = ControlPoints(
        ("A", "B", "C"),
        ("control", "check", "check"),
        np.array([[1.25, 2.5, 0.125], [-3.0, 1.0, 0.5], [np.nan, np.nan, np.nan]]),
        np.array([[0.01, 0.02, 0.03], [0.01, 0.01, 0.02], [np.nan, np.nan, np.nan]]),
        np.array([0, 1, 1]),
        np.array([0, 0, 2]),
        np.array([[100.25, 200.5], [300.125, 20.75], [11.5, 17.25]]),
        np.full(3, 0.5),
    )
    return ForeignSolution("photogram", cameras, tuple(photographs), tie_points, ground)


def reprojection_rms_px(solution: ForeignSolution) -> float:
    """Return the root mean square of the length of a tie point's residual, by photogram.camera.project alone."""
    tie = solution.tie_points
    residual = np.full((len(tie.point), 2), np.nan)
    for i, photograph in enumerate(solution.photographs):
        mine = tie.photograph == i
        if mine.any() and photograph.pose is not None:
            at = project(solution.cameras[photograph.camera], photograph.pose, tie.position_world_m[tie.point[mine]])
            residual[mine] = at - tie.pixel[mine]
    return float(np.sqrt((residual**2).sum(axis=1).mean()))


def assert_same_cameras(found: ForeignSolution, expected: ForeignSolution, tolerance: float = 1e-9) -> None:
    """Assert that names, calibrations and poses agree."""
    assert [p.name for p in found.photographs] == [p.name for p in expected.photographs]
    for one, other in zip(found.photographs, expected.photographs, strict=True):
        mine, theirs = found.cameras[one.camera], expected.cameras[other.camera]
        assert (mine.width_px, mine.height_px, mine.model) == (theirs.width_px, theirs.height_px, theirs.model)
        np.testing.assert_allclose(mine.parameters, theirs.parameters, rtol=0, atol=tolerance)
        assert (one.pose is None) == (other.pose is None)
        if one.pose is not None and other.pose is not None:
            np.testing.assert_allclose(
                one.pose.rotation_world_from_camera, other.pose.rotation_world_from_camera, rtol=0, atol=tolerance
            )
            np.testing.assert_allclose(one.pose.position_world_m, other.pose.position_world_m, rtol=0, atol=tolerance)


def damaged(data: bytes, seed: int) -> Iterator[bytes]:
    """Give what is left of a file that was cut off, or in which bytes, words and numbers were changed."""
    rng = np.random.default_rng(seed)
    for end in np.unique(np.linspace(0, max(len(data) - 1, 0), CUTS).astype(int)):
        yield data[:end]
    words = (b"nan", b"-1", b"9223372036854775808", b"1e400", b"", b"\x00", b"\xff\xfe", b"../..", b"<", b"99999999")
    for _ in range(CHANGES):
        at, kind = int(rng.integers(len(data))), int(rng.integers(3))
        if kind == 0:
            yield data[:at] + bytes([int(rng.integers(256))]) + data[at + 1 :]
        elif kind == 1:
            yield data[:at] + words[int(rng.integers(len(words)))] + data[at + int(rng.integers(12)) :]
        else:
            end = at + int(rng.integers(1, 40))
            yield data[:at] + data[at:end] * 2 + data[end:]


def assert_refused_or_read(read: Callable[[Path], ForeignSolution], path: Path, data: bytes, seed: int) -> int:
    """Assert that whatever is left of a file is read, or refused by ExchangeError; returns how many were refused."""
    refused = 0
    for changed in damaged(data, seed):
        path.write_bytes(changed)
        try:
            read(path)
        except ExchangeError:
            refused += 1
    return refused


def without_ground_points(solution: ForeignSolution) -> ForeignSolution:
    """Return a solution without ground points."""
    return replace(solution, ground_points=None)
