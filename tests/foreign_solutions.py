"""Foreign solutions for the tests of photogram.files.exchange: made, compared, projected, and their files damaged."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePosixPath

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, project
from photogram.errors import ExchangeError
from photogram.files.exchange.solution import ForeignPhotograph, ForeignSolution
from photogram.survey import TiePoints


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
        pixel = project(cameras[i % len(cameras)], pose, X) + rng.normal(0, noise_px, (points, 2))
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
            misfit[mine] = tie.pixel[mine] - project(solution.cameras[photograph.camera], photograph.pose, X)
    return misfit


def rms_px(solution: ForeignSolution) -> float:
    """Return the root mean square of the lengths of all residuals."""
    return float(np.sqrt((residuals(solution) ** 2).sum(axis=1).mean()))


def assert_same(first: ForeignSolution, second: ForeignSolution, tolerance: float = 1e-9) -> None:
    """Assert that calibrations, poses, points and pixels agree, cameras and photographs in whatever order."""
    assert {p.name for p in first.photographs} == {p.name for p in second.photographs}
    number = {p.name: i for i, p in enumerate(second.photographs)}
    other = np.array([number[p.name] for p in first.photographs])
    for photograph, i in zip(first.photographs, other, strict=True):
        twin = second.photographs[i]
        a, b = first.cameras[photograph.camera], second.cameras[twin.camera]
        assert (a.width_px, a.height_px, a.model) == (b.width_px, b.height_px, b.model)
        assert np.allclose(a.parameters, b.parameters, rtol=0, atol=tolerance)
        assert (photograph.pose is None) == (twin.pose is None)
        if photograph.pose is not None and twin.pose is not None:
            R, S = photograph.pose.rotation_world_from_camera, twin.pose.rotation_world_from_camera
            assert np.allclose(R, S, rtol=0, atol=tolerance)
            assert np.allclose(photograph.pose.position_world_m, twin.pose.position_world_m, rtol=0, atol=tolerance)
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


def damaged(data: bytes, seed: int = 5, times: int = 150) -> Iterator[bytes]:
    """Give a file cut off at many places, with bytes changed, repeated and taken out, and with other numbers in it."""
    rng = np.random.default_rng(seed)
    yield from (data[: int(n)] for n in np.linspace(0, len(data) - 1, times))
    numbers = [
        b"nan",
        b"inf",
        b"-1",
        b"9223372036854775808",
        b"1e400",
        b"..",
        b"/",
        b"\0",
        b"\xff\xfe",
        b"",
        b"{",
        b'"',
    ]
    for _ in range(times):
        at, size = int(rng.integers(len(data))), int(rng.integers(1, 9))
        yield data[:at] + rng.bytes(size) + data[at + size :]
        yield data[:at] + b"\xff" * 8 + data[at + 8 :]
        yield data[:at] + data[at + size :]
        yield data[:at] + data[at : at + 40] + data[at:]
        words = data.split(b" ")
        words[int(rng.integers(len(words)))] = numbers[int(rng.integers(len(numbers)))]
        yield b" ".join(words)


def assert_refused_or_read(path: Path, read: Callable[[], object]) -> None:
    """Assert that every damage to one file of a solution is refused with an ExchangeError, or does no harm."""
    whole, messages = path.read_bytes(), []
    for data in damaged(whole):
        path.write_bytes(data)
        try:
            read()
        except ExchangeError as fault:
            messages.append(str(fault))
    path.write_bytes(whole)
    read()
    assert len(messages) > 50
    assert max(map(len, messages)) < 1500


def assert_refuses(read: Callable[[], object], words: str) -> None:
    """Assert an ExchangeError whose message holds these words."""
    with pytest.raises(ExchangeError, match=words):
        read()
