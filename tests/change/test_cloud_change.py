"""Clouds on disk compared by M3C2 and with a mesh."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
from changed_surveys import HEAP, STABLE, write_epochs, write_polygons
from lib.simulated_changes import CORNER

from photogram.change.cloud_change import CloudRequest, Method, compare_clouds
from photogram.errors import FrameError, PhotogramError
from photogram.files.clouds.points import write_laz, write_xyz
from photogram.survey import PointCloud
from photogram.volumes.surfaces import StatedSigma
from photogram.wording import silent


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    write_epochs(folder)
    write_polygons(folder / "stable.gpkg", [STABLE], ["road"])
    return folder


def request(site: Path, method: Method) -> CloudRequest:
    return CloudRequest(
        site / "later/results/deliverables/dense.laz", site / "earlier/results/deliverables/dense.laz", method
    )


def at_top(points: laspy.LasData) -> np.ndarray:
    off = np.asarray(points.xyz)[:, :2] - [CORNER[0] + HEAP.east_m + 1.5, CORNER[1] + HEAP.north_m]
    return np.asarray(np.hypot(*off.T) < 0.5)


def test_m3c2_is_written_as_a_cloud_with_distance_level_and_significance(site: Path, tmp_path: Path) -> None:
    pytest.importorskip("py4dgeo")
    change = compare_clouds(request(site, "m3c2"), tmp_path, silent)
    points = laspy.read(tmp_path / "distances.laz")
    assert set(points.point_format.extra_dimension_names) == {
        "distance", "lod", "significant", "lod roughness", "normal x", "normal y", "normal z", "points earlier",
        "points later",
    }  # fmt: skip
    assert points.header.parse_crs().to_epsg() == 25832
    assert len(points) == change.compared
    told = np.isfinite(points["lod"])
    np.testing.assert_array_equal(
        points["significant"][told] == 1, np.abs(points["distance"])[told] > points["lod"][told]
    )
    top = at_top(points)
    assert np.all(points["significant"][top] == 1)
    # along the normal of the earlier ground, which is nearly level
    expected = HEAP.height(np.array(HEAP.east_m + 1.5), np.array(HEAP.north_m))
    assert np.median(points["distance"][top]) == pytest.approx(float(expected), rel=0.1)
    assert change.level_of_detection == "standard deviations of both epochs"
    found = json.loads((tmp_path / "comparison.json").read_text())["dense"]
    assert found["method"] == "m3c2"
    assert found["scales"]["radius_m"] == pytest.approx(0.8, rel=0.01)
    assert 0.8 < found["within_level"] / found["with_level"] < 1.0
    assert (tmp_path / "comparison.png").is_file()


def test_without_sigmas_the_level_is_by_roughness_and_says_so(site: Path, tmp_path: Path) -> None:
    pytest.importorskip("py4dgeo")
    rough = {}
    for name in ("earlier", "later"):
        points = np.asarray(laspy.read(site / name / "results/deliverables/dense.laz").xyz)
        write_xyz(tmp_path / f"{name}.txt", PointCloud(points))
        rough[name] = tmp_path / f"{name}.txt"
    asked = CloudRequest(rough["later"], rough["earlier"], "m3c2")
    change = compare_clouds(asked, tmp_path / "out", silent)
    assert change.level_of_detection.startswith("roughness; the alignment taken as free of errors")
    assert change.level_median_m == change.roughness_level_median_m
    aligned = compare_clouds(
        replace(asked, stable=site / "stable.gpkg", coregister="offset"), tmp_path / "aligned", silent
    )
    assert aligned.level_of_detection == "roughness, alignment on stable ground"
    assert aligned.registration is not None
    assert aligned.level_median_m > change.level_median_m
    stated = StatedSigma(0.02, 0.03)
    told = compare_clouds(replace(asked, sigma=stated, earlier_sigma=stated), tmp_path / "told", silent)
    assert told.level_median_m > 1.959964 * np.sqrt(2) * 0.03 * 0.95


def test_distances_to_a_mesh_of_a_surface(site: Path, tmp_path: Path) -> None:
    asked = replace(request(site, "mesh"), earlier=site / "earlier/results/deliverables/dsm.tif")
    change = compare_clouds(asked, tmp_path)  # as docs/comparison.md has it
    points = laspy.read(tmp_path / "distances.laz")
    assert set(points.point_format.extra_dimension_names) == {"distance", "lod", "significant"}
    top = at_top(points)
    expected = HEAP.height(np.array(HEAP.east_m + 1.5), np.array(HEAP.north_m))
    assert np.median(points["distance"][top]) == pytest.approx(float(expected), rel=0.1)
    assert change.scales is None
    assert 0.75 < change.within_level / change.with_level < 1.0
    assert change.compared < change.points  # what lies beside the earlier surface has none


def test_an_alignment_is_reported_and_taken_off_only_when_asked_for(site: Path, tmp_path: Path) -> None:
    asked = replace(request(site, "mesh"), stable=site / "stable.gpkg")
    reported = compare_clouds(asked, tmp_path / "a", silent)
    applied = compare_clouds(replace(asked, coregister="offset"), tmp_path / "b", silent)
    assert reported.registration is not None
    assert not reported.registration_applied
    assert applied.registration_applied
    offset = reported.registration.value[0]
    assert reported.distance.median_m - applied.distance.median_m == pytest.approx(offset, abs=1e-3)


def test_what_cannot_be_compared_is_refused_and_nothing_is_written(site: Path, tmp_path: Path) -> None:
    asked = request(site, "mesh")
    points = np.asarray(laspy.read(asked.later).xyz)
    write_laz(tmp_path / "zone.laz", PointCloud(points), "EPSG:25833")
    write_laz(tmp_path / "away.laz", PointCloud(points + np.array([5000.0, 0.0, 0.0])), "EPSG:25832")
    shutil.copyfile(asked.later, tmp_path / "cut.laz")
    (tmp_path / "cut.laz").write_bytes(asked.later.read_bytes()[:60_000])
    before = sorted(tmp_path.rglob("*"))
    for wrong, kind, words in (
        (replace(asked, later=tmp_path / "zone.laz"), FrameError, "their CRS differ"),
        (replace(asked, later=tmp_path / "away.laz"), PhotogramError, "no distance is found anywhere"),
        (replace(asked, later=tmp_path / "cut.laz"), PhotogramError, "cut.laz"),
        (replace(asked, coregister="rigid"), PhotogramError, "name the ground that has not moved"),
        (
            replace(request(site, "m3c2"), earlier=site / "earlier/results/deliverables/dsm.tif"),
            PhotogramError,
            "M3C2 compares clouds",
        ),
    ):
        with pytest.raises(kind, match=words):
            compare_clouds(wrong, tmp_path / "out", silent)
    assert sorted(tmp_path.rglob("*")) == before
