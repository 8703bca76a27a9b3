"""M3C2 on simulated clouds: distances of a shift along normals, and levels of detection that hold."""

import logging
import sys
from pathlib import Path

import numpy as np
import pytest
from lib.simulated_changes import Errors, epoch, grid_at, uneven

from photogram.change.m3c2 import CloudErrors, M3C2Settings, core_points, m3c2, spacing_of
from photogram.errors import PhotogramError, SettingError
from photogram.survey import PointCloud

OWN = Errors(own_m=(0.02, 0.02), shift_m=(0.0, 0.0, 0.0), tilt_m=0.0, dome_m=0.0)


def survey(rng: np.random.Generator, errors: Errors) -> tuple[PointCloud, CloudErrors]:
    grid = grid_at(20.0, -30.0, 12.0, 0.125)
    made = epoch(uneven, grid, errors, rng)
    east, north = np.meshgrid(*grid.centres_map_m(grid.whole))
    height, whole, own = (
        raster.read(grid.whole).astype(np.float64).ravel() for raster in (made.heights, made.sigma, made.own) if raster
    )
    common = np.sqrt(np.maximum(whole**2 - own**2, 0.0))
    return PointCloud(np.column_stack([east.ravel(), north.ravel(), height])), CloudErrors(own, common, 0.625)


def plane(shift: float, seed: int) -> PointCloud:
    xy = np.random.default_rng(seed).uniform(0.0, 20.0, (20_000, 2))
    return PointCloud(np.column_stack([xy, 0.75 * xy[:, 0] + shift]))


def test_a_shift_of_a_slope_is_found_along_its_normal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("py4dgeo")
    monkeypatch.chdir(tmp_path)
    found = m3c2(plane(0.0, 1), plane(1.0, 2), M3C2Settings(radius_m=0.5, depth_m=3.0))
    inner = np.all(np.abs(found.core_map_m[:, :2] - 10.0) < 8.0, axis=1)
    np.testing.assert_allclose(found.normal[inner], np.tile([-0.6, 0.0, 0.8], (inner.sum(), 1)), atol=1e-6)
    np.testing.assert_allclose(found.distance_m[inner], 0.8, atol=1e-6)
    assert found.significant[inner & np.isfinite(found.level_m)].all()
    assert np.mean(np.isfinite(found.level_m[inner])) > 0.99
    assert list(tmp_path.iterdir()) == []  # py4dgeo leaves a log file where it runs
    assert not logging.getLogger("py4dgeo").handlers


def test_unchanged_ground_lies_within_the_level_of_predicted_sigmas() -> None:
    pytest.importorskip("py4dgeo")
    rng = np.random.default_rng(3)
    within, by_roughness = [], []
    for _ in range(25):
        (earlier, first), (later, second) = (survey(rng, OWN) for _ in range(2))
        found = m3c2(earlier, later, errors=(first, second))
        known = np.isfinite(found.level_m)
        within.append(np.mean(np.abs(found.distance_m[known]) <= found.level_m[known]))
        by_roughness.append(np.mean(np.abs(found.distance_m[known]) <= found.roughness_level_m[known]))
    assert np.mean(within) == pytest.approx(0.95, abs=0.02)
    assert np.mean(by_roughness) < 0.6  # it takes errors that neighbours share for independent ones


def test_independent_noise_lies_within_the_level_of_roughness() -> None:
    pytest.importorskip("py4dgeo")
    rng = np.random.default_rng(4)
    clouds = []
    for _ in range(2):
        xy = rng.uniform(0.0, 40.0, (60_000, 2))
        clouds.append(PointCloud(np.column_stack([xy, 0.02 * rng.standard_normal(len(xy))])))
    found = m3c2(clouds[0], clouds[1], M3C2Settings(radius_m=0.5))
    known = np.isfinite(found.level_m)
    assert np.mean(np.abs(found.distance_m[known]) <= found.level_m[known]) == pytest.approx(0.95, abs=0.02)
    aligned = m3c2(clouds[0], clouds[1], M3C2Settings(radius_m=0.5), aligned=lambda place, _: np.full(len(place), 0.01))
    np.testing.assert_allclose(aligned.level_m[known] - found.level_m[known], 1.959964 * 0.01)  # eq. 1 adds it


def test_common_errors_count_once_and_alignment_beside_them() -> None:
    pytest.importorskip("py4dgeo")
    rng = np.random.default_rng(5)
    cloud, own = survey(rng, OWN)
    shared = CloudErrors(own.own_m, np.full(len(cloud), 0.03), own.correlation_m)
    alone, with_common = (m3c2(cloud, cloud, errors=(e, e)) for e in (own, shared))
    aligned = m3c2(cloud, cloud, errors=(own, own), aligned=lambda place, _: np.full(len(place), 0.05))
    known = np.isfinite(alone.level_m)
    up = alone.normal[known, 2]
    more = np.sqrt(with_common.level_m[known] ** 2 - alone.level_m[known] ** 2) / 1.959964
    np.testing.assert_allclose(more, np.sqrt(2.0) * 0.03 * up, rtol=1e-6)
    more = np.sqrt(aligned.level_m[known] ** 2 - alone.level_m[known] ** 2) / 1.959964
    np.testing.assert_allclose(more, 0.05, rtol=1e-6)


def test_the_spacing_of_a_lattice_and_its_core_points() -> None:
    east, north = np.meshgrid(np.arange(40) * 0.25, np.arange(30) * 0.25)
    cloud = PointCloud(np.column_stack([east.ravel(), north.ravel(), np.zeros(east.size)]))
    assert spacing_of(cloud) == pytest.approx(0.25)
    core = core_points(cloud, 1.0)
    assert len(core) == 10 * 8
    assert {tuple(p) for p in core} <= {tuple(p) for p in cloud.position_map_m}


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "py4dgeo", None)
    with pytest.raises(PhotogramError, match=r"pip install 'photogram\[change\]'"):
        m3c2(plane(0.0, 1), plane(1.0, 2))
    with pytest.raises(PhotogramError, match="fewer than 4 points"):
        m3c2(PointCloud(np.zeros((3, 3))), plane(1.0, 2))
    with pytest.raises(SettingError, match=r"radius_m: must be from 0\.0001 to 10000 m, found -1"):
        M3C2Settings(radius_m=-1.0)
