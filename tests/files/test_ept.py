"""Entwine Point Tiles, read as a viewer reads them: by bounds, hierarchy and the names of the nodes."""

import json
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from pyproj import CRS

from photogram.files.clouds.copc import write_copc
from photogram.files.clouds.ept import write_ept

COUNT = 30_000


@pytest.fixture(scope="module")
def cloud(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Points over a wavy surface with colours, in EPSG:25832."""
    rng = np.random.default_rng(5)
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array([602_000.0, 5_794_000.0, 0.0])
    header.add_crs(CRS.from_epsg(25832))
    points = laspy.LasData(header)
    x, y = rng.uniform(0.0, (40.0, 25.0), (COUNT, 2)).T
    points.x, points.y, points.z = 602_300.0 + x, 5_794_100.0 + y, 120.0 + np.sin(x) + np.cos(y)
    points.red, points.green, points.blue = rng.integers(0, 65_535, (3, COUNT)).astype(np.uint16)
    points.classification = rng.integers(0, 7, COUNT).astype(np.uint8)
    points.intensity = rng.integers(0, 65_535, COUNT).astype(np.uint16)
    points.return_number = points.number_of_returns = np.ones(COUNT, np.uint8)
    path = tmp_path_factory.mktemp("cloud") / "dense.laz"
    points.write(str(path))
    return path


def rows(points: Any) -> Any:
    names = ("x", "y", "z", "intensity", "classification", "red", "green", "blue")
    table = np.column_stack([np.asarray(points[name], dtype=np.float64) for name in names])
    return table[np.lexsort(table[:, :3].T)]


def test_all_points_come_back_each_in_the_cube_of_its_node(cloud: Path, tmp_path: Path) -> None:
    write_copc(tmp_path / "a.copc.laz", cloud, branch_points=4000, leaf_points=500)
    nodes = write_ept(tmp_path / "ept", tmp_path / "a.copc.laz")
    entry = json.loads((tmp_path / "ept/ept.json").read_text(encoding="utf-8"))
    hierarchy = json.loads((tmp_path / "ept/ept-hierarchy/0-0-0-0.json").read_text(encoding="utf-8"))
    low, high = np.array(entry["bounds"][:3]), np.array(entry["bounds"][3:])
    assert np.ptp(high - low) == pytest.approx(0.0, abs=1e-6), "a cube"
    assert len(hierarchy) == nodes > 10
    assert {f"{name}.laz" for name in hierarchy} == {path.name for path in (tmp_path / "ept/ept-data").iterdir()}
    tables = []
    for name, count in hierarchy.items():
        level, *place = map(int, name.split("-"))
        if level:
            parent = "-".join(map(str, (level - 1, *(one // 2 for one in place))))
            assert parent in hierarchy, "a viewer reaches it"
        points = laspy.read(tmp_path / f"ept/ept-data/{name}.laz")
        assert (len(points), str(points.header.version), points.header.point_format.id) == (count, "1.2", 2)
        side = (high - low) / 2**level
        at = np.column_stack([points.x, points.y, points.z])
        assert (at >= low + np.array(place) * side - 0.002).all()
        assert (at <= low + (np.array(place) + 1) * side + 0.002).all()
        tables.append(points)
    found = np.concatenate([rows(points) for points in tables])
    assert np.array_equal(found[np.lexsort(found[:, :3].T)], rows(laspy.read(cloud)))


def test_the_entry_says_what_a_viewer_asks_for(cloud: Path, tmp_path: Path) -> None:
    write_copc(tmp_path / "a.copc.laz", cloud)
    write_ept(tmp_path / "ept", tmp_path / "a.copc.laz")
    entry = json.loads((tmp_path / "ept/ept.json").read_text(encoding="utf-8"))
    assert (entry["dataType"], entry["hierarchyType"], entry["points"]) == ("laszip", "json", COUNT)
    assert (entry["srs"]["authority"], entry["srs"]["horizontal"]) == ("EPSG", "25832")
    names = [dimension["name"] for dimension in entry["schema"]]
    assert names[:3] == ["X", "Y", "Z"]
    assert {"Red", "Green", "Blue", "Classification"} <= set(names)
    x = entry["schema"][0]
    assert (x["scale"], x["offset"], x["type"], x["size"]) == (0.001, 602_000.0, "signed", 4)
    assert entry["boundsConforming"][:3] == pytest.approx(laspy.open(cloud).header.mins)
