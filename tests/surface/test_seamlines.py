"""Parts of the orthophoto by themselves: seams, interpolation, decoded photographs, the file that the stage writes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path
from threading import Barrier
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import rasterio
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from photogram.pipeline.pipeline import load_project, open_run
from photogram.pipeline.stages.orthophoto import HeldPhotographs, make_orthophoto
from photogram.pipeline.store.run import Run
from photogram.surface.ortho.orthophoto import OrthophotoSettings
from photogram.surface.ortho.resampling import add_cubic, catmull_rom
from photogram.surface.ortho.seamlines import chosen_labels


def lists(rng: np.random.Generator, rows: int, columns: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Draw lists of three out of five photographs, some shorter, sorted by cost."""
    candidate = np.array([rng.permutation(5)[:3] for _ in range(rows * columns)], np.int32).reshape(rows, columns, 3)
    cost = np.sort(rng.uniform(0.0, 1.0, candidate.shape), axis=2).astype(np.float32)
    short = rng.random((rows, columns)) < 0.3
    candidate[short, 2], cost[short, 2] = -1, np.inf
    return candidate, cost


def energy(label: NDArray[Any], candidate: NDArray[Any], cost: NDArray[Any], right: Any, below: Any) -> float:
    own = np.where(candidate == label[..., None], cost, 0.0).sum()
    across = (right[:, :-1] * (label[:, 1:] != label[:, :-1])).sum()
    return float(own + across + (below[:-1] * (label[1:] != label[:-1])).sum())


def least_energy(candidate: NDArray[Any], cost: NDArray[Any], right: Any, below: Any) -> float:
    shape = candidate.shape[:2]
    choices = product(*[[int(n) for n in c if n >= 0] for c in candidate.reshape(-1, 3)])
    return min(energy(np.array(c).reshape(shape), candidate, cost, right, below) for c in choices)


@pytest.mark.parametrize("shape", [(1, 7), (7, 1)])
def test_labels_along_a_line_are_the_best_there_are(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        candidate, cost = lists(rng, *shape)
        right, below = (rng.uniform(0.0, 0.6, shape).astype(np.float32) for _ in range(2))
        label = chosen_labels(candidate, cost, right, below, 15)
        best = least_energy(candidate, cost, right, below)
        assert energy(label, candidate, cost, right, below) == pytest.approx(best, abs=1e-5)


def test_labels_of_a_grid_are_nearly_the_best_there_are() -> None:
    rng, found, best = np.random.default_rng(6), 0.0, 0.0
    for _ in range(15):
        candidate, cost = lists(rng, 2, 4)
        right, below = (rng.uniform(0.0, 0.6, (2, 4)).astype(np.float32) for _ in range(2))
        label = chosen_labels(candidate, cost, right, below, 15)
        assert np.all((candidate == label[..., None]).any(axis=2))
        found += energy(label, candidate, cost, right, below)
        best += least_energy(candidate, cost, right, below)
    assert best <= found < 1.02 * best


def test_a_block_that_nothing_sees_has_no_label() -> None:
    candidate, cost = lists(np.random.default_rng(1), 3, 4)
    candidate[1, 2], cost[1, 2] = -1, np.inf
    price = np.full((3, 4), 0.1, np.float32)
    label = chosen_labels(candidate, cost, price, price, 5)
    assert np.array_equal(label < 0, (candidate < 0).all(axis=2))


@given(st.floats(0.0, 1.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_interpolation_keeps_parabolas(t: float, a: float, b: float, c: float) -> None:
    weight, x = np.empty(4), np.arange(-1.0, 3.0)
    catmull_rom(t, weight)
    assert weight.sum() == pytest.approx(1.0)
    assert weight @ (a + b * x + c * x * x) == pytest.approx(a + b * t + c * t * t, abs=1e-9)


def test_interpolation_runs_along_columns_and_rows() -> None:
    v, u = np.mgrid[0:12, 0:17]
    picture = np.stack([10 * u, 20 * v, 3 * u + 5 * v], axis=2).astype(np.uint8)
    out = np.zeros(3)
    add_cubic(picture, 7.3, 4.6, 2.0, np.empty(4), np.empty(4), out)
    np.testing.assert_allclose(out, 2.0 * np.array([73.0, 92.0, 44.9]))


def test_photographs_are_decoded_once_and_few_are_kept() -> None:
    read: list[int] = []
    start = Barrier(4)

    def decode(number: int) -> NDArray[np.uint8]:
        read.append(number)
        return np.full((2, 2, 3), number, np.uint8)

    held = HeldPhotographs(decode, 2)

    def ask(number: int) -> int:
        start.wait()
        return int(held(number)[0, 0, 0])

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(ask, [7, 7, 7, 7])) == [7, 7, 7, 7]
    assert read == [7]
    assert [int(held(n)[0, 0, 0]) for n in (8, 7, 9, 7, 8)] == [8, 7, 9, 7, 8]
    assert read == [7, 8, 9, 8]


def test_a_photograph_that_cannot_be_read_stops_whoever_asks() -> None:
    def fail(number: int) -> NDArray[np.uint8]:
        raise OSError(f"photograph {number}")

    with pytest.raises(OSError, match="photograph 3"):
        HeldPhotographs(fail, 2)(3)


@pytest.mark.survey
def test_the_stage_writes_an_orthophoto_over_the_surface(adjusted_survey: Path, tmp_path: Path) -> None:
    project = load_project(adjusted_survey / "project.yaml")
    settings = SimpleNamespace(
        photographs=project.photographs, crs=project.crs, orthophoto=OrthophotoSettings(cell_m=0.06)
    )
    texts: list[str] = []
    with open_run(project) as run:
        part = SimpleNamespace(
            project=settings,
            executor=run.executor,
            adjusted_block=run.adjusted_block,
            has_surface=run.has_surface,
            filled_surface=run.filled_surface,
            pixels=run.pixels,
        )
        summary = make_orthophoto(cast(Run, part), tmp_path, lambda _done, _total, text: texts.append(text))
        surface = run.filled_surface()
    assert texts[0] == "seams and exposure"
    with rasterio.open(tmp_path / "orthophoto.tif") as dataset:
        assert dataset.count == 4
        alpha, box = dataset.read(4), dataset.bounds
    assert (
        summary["cells"]
        == np.count_nonzero(alpha == 255)
        > 0.5 * np.count_nonzero(np.isfinite(surface.values)) * (surface.cell_m / 0.06) ** 2
    )
    assert box.left <= surface.west_map_m + surface.values.shape[1] * surface.cell_m
