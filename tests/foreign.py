"""Foreign solutions for the tests of photogram.exchange.formats: made, compared, projected, and their files damaged."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from seeds import seeds

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, project_points
from photogram.errors import ExchangeError
from photogram.files.solutions.solution import ForeignPhotograph, ForeignSolution
from photogram.measures.mark_covariances import isotropic_px2
from photogram.survey import ControlPoints, TiePoints

NOISE_PX = 0.4
TIMES = len(seeds(100, 40))
"""How often a file is damaged in each way."""

# ---- made ----------------------------------------------------------------------------------------------------------


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
        tilt = Rotation.from_rotvec(rng.normal(0.0, 0.15, 3)).as_matrix()
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
        at = project_points(camera, shown.pose, points)
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
        isotropic_px2(np.full(3, 0.5)),
    )
    return ForeignSolution("photogram", cameras, tuple(photographs), tie_points, ground)


def brown(name: str = "1", size_px: tuple[int, int] = (400, 301), centred: bool = False, **q: object) -> Camera:
    """Return a camera with as many distortions as are given, its principal point off the centre unless ``centred``."""
    width, height = size_px
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    return Camera(name, width, height, 380.25, centre + (0.0 if centred else np.array([1.7, -2.3])), **q)  # type: ignore[arg-type]


def made(
    cameras: Sequence[Camera], photographs: int = 4, points: int = 40, seed: int = 1, noise_px: float = 0.5
) -> ForeignSolution:
    """Return photographs around the z axis that look at points before them, observed with noise where they show."""
    rng = np.random.default_rng(seed)
    X = rng.uniform([-3, -2, 8], [3, 2, 12], (points, 3))
    shot, rows = [], []
    for i in range(photographs):
        R = Rotation.from_rotvec(rng.normal(0, 0.12, 3)).as_matrix()
        pose = Pose(R, rng.normal(0, 0.6, 3))
        file = PurePosixPath(f"flight/photo_{i:02d}.jpg")
        shot.append(ForeignPhotograph(file.name, i % len(cameras), pose, file))
        pixel = project_points(cameras[i % len(cameras)], pose, X) + rng.normal(0, noise_px, (points, 2))
        inside = cameras[i % len(cameras)].contains(pixel)
        rows += [(k, i, *pixel[k]) for k in np.flatnonzero(inside)]
    rows.sort()
    table = np.array(rows)
    point, photograph = table[:, 0].astype(np.int64), table[:, 1].astype(np.int64)
    used = np.unique(point)
    tie = TiePoints(
        photograph,
        np.searchsorted(used, point).astype(np.int64),
        np.arange(len(table)),
        table[:, 2:],
        np.ones(len(table)),
        X[used],
        rng.integers(0, 256, (len(used), 3)).astype(np.uint8),
    )
    return ForeignSolution("test", tuple(cameras), tuple(shot), tie)


def residuals(solution: ForeignSolution) -> FloatArray:
    """Return observed less projected pixels (N, 2) of all tie points."""
    tie, misfit = solution.tie_points, np.full((len(solution.tie_points.point), 2), np.nan)
    for i, photograph in enumerate(solution.photographs):
        if photograph.pose is not None:
            mine = tie.photograph == i
            X = tie.position_world_m[tie.point[mine]]
            misfit[mine] = tie.pixel[mine] - project_points(solution.cameras[photograph.camera], photograph.pose, X)
    return misfit


def rms_px(solution: ForeignSolution) -> float:
    """Return the root mean square length of tie points' residuals, by photogram.camera.project_points alone."""
    return float(np.sqrt((residuals(solution) ** 2).sum(axis=1).mean()))


# ---- compared ------------------------------------------------------------------------------------------------------


def assert_same_cameras(found: ForeignSolution, expected: ForeignSolution, tolerance: float = 1e-9) -> None:
    """Assert that names, calibrations and poses agree, photographs in the same order."""
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


def assert_same(first: ForeignSolution, second: ForeignSolution, tolerance: float = 1e-9) -> None:
    """Assert that calibrations, poses, points and pixels agree, cameras and photographs in whatever order."""
    number = {p.name: i for i, p in enumerate(second.photographs)}
    other = np.array([number[p.name] for p in first.photographs])
    assert_same_cameras(first, replace(second, photographs=tuple(second.photographs[i] for i in other)), tolerance)
    s, t = first.tie_points, second.tie_points
    assert np.allclose(s.position_world_m, t.position_world_m, rtol=0, atol=tolerance)
    assert np.array_equal(s.colour, t.colour)
    order_s, order_t = np.lexsort((other[s.photograph], s.point)), np.lexsort((t.photograph, t.point))
    assert np.array_equal(s.point[order_s], t.point[order_t])
    assert np.array_equal(other[s.photograph][order_s], t.photograph[order_t])
    assert np.allclose(s.pixel[order_s], t.pixel[order_t], rtol=0, atol=tolerance)


def disagreement(first: ForeignSolution, second: ForeignSolution) -> tuple[float, float]:
    """Return how far the poses of two solutions are apart after a similarity: the largest angle in degrees, and the
    largest distance of projection centres in parts of their extent."""
    pairs = [
        (p.pose, q.pose)
        for p in first.photographs
        for q in second.photographs
        if p.name == q.name and p.pose is not None and q.pose is not None
    ]
    assert len(pairs) > 3
    A = np.array([p.position_world_m for p, _ in pairs])
    B = np.array([q.position_world_m for _, q in pairs])
    # the rotation from the attitudes and the centres, the scale from the centres (Horn 1987, sec. 2)
    turns = [p.rotation_world_from_camera @ q.rotation_world_from_camera.T for p, q in pairs]
    R = Rotation.from_matrix(np.array(turns)).mean().as_matrix()
    a, b = A - A.mean(axis=0), (B - B.mean(axis=0)) @ R.T
    scale = (a * b).sum() / (b * b).sum()
    angles = [np.rad2deg(Rotation.from_matrix(R.T @ turn).magnitude()) for turn in turns]
    return float(max(angles)), float(np.linalg.norm(a - scale * b, axis=1).max() / np.ptp(A, axis=0).max())


# ---- damaged -------------------------------------------------------------------------------------------------------


def damaged(data: bytes, seed: int = 5) -> Iterator[bytes]:
    """Give a file cut off at many places, with bytes changed, repeated and taken out, and with other numbers in it."""
    rng = np.random.default_rng(seed)
    yield from (data[: int(n)] for n in np.linspace(0, len(data) - 1, TIMES))
    words = (
        b"nan",
        b"inf",
        b"-1",
        b"9223372036854775808",
        b"99999999",
        b"1e400",
        b"..",
        b"../..",
        b"/",
        b"\0",
        b"\xff\xfe",
        b"",
        b"{",
        b'"',
        b"<",
    )
    for _ in range(TIMES):
        at, size = int(rng.integers(len(data))), int(rng.integers(1, 9))
        yield data[:at] + rng.bytes(size) + data[at + size :]
        yield data[:at] + b"\xff" * 8 + data[at + 8 :]
        yield data[:at] + data[at + size :]
        yield data[:at] + data[at : at + 40] + data[at:]
        word = words[int(rng.integers(len(words)))]
        yield data[:at] + word + data[at + int(rng.integers(12)) :]
        parts = data.split(b" ")
        parts[int(rng.integers(len(parts)))] = word
        yield b" ".join(parts)


def refusals(write: Callable[[bytes], object], read: Callable[[], object], data: bytes, seed: int = 5) -> float:
    """Return how many of 700 kinds of damage to the data of a file are refused with an ExchangeError, or would be; the
    others must do no harm, and the data be read again at the end."""
    messages = []
    for changed in damaged(data, seed):
        write(changed)
        try:
            read()
        except ExchangeError as fault:
            messages.append(str(fault))
    write(data)
    read()
    assert max(map(len, messages)) < 1500
    return 100 / TIMES * len(messages)


def assert_refused_or_read(path: Path, read: Callable[[], object], seed: int = 5, least: int = 50) -> None:
    """Assert that damage to a file of a solution is refused or does no harm, and refused more than ``least`` times."""
    assert refusals(path.write_bytes, read, path.read_bytes(), seed) > least


def assert_refuses(read: Callable[[], object], words: str) -> None:
    """Assert an ExchangeError whose message holds these words."""
    with pytest.raises(ExchangeError, match=words):
        read()


def without_observations(solution: ForeignSolution) -> ForeignSolution:
    """Return a solution of poses and points alone, as programs export it without their key points."""
    ties, none = solution.tie_points, np.zeros(0, dtype=np.int64)
    bare = replace(ties, photograph=none, point=none, feature=none, pixel=np.zeros((0, 2)), sigma_px=np.zeros(0))
    return replace(solution, tie_points=bare)
