"""Measurements as a GeoPackage: what comes back, in metres and feet."""

from pathlib import Path

import numpy as np
import pyogrio
import pytest

from photogram.errors import ProjectError
from photogram.files.maps.measurement_files import LAYER, StoredMeasurement, read_measurements, write_measurements

CORNERS = np.array([[500000.0, 5000000.0], [500010.25, 5000000.0], [500010.25, 5000020.0]])
MEASURED = [
    StoredMeasurement("Heap", "volume", CORNERS, True, "volume 12.0 m³", "{}"),
    StoredMeasurement("Ditch", "profile", CORNERS, False, "", ""),
    StoredMeasurement("Corner", "height", CORNERS[:1], False, "", '{"a": 1}'),
]


@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:2225", "none"])
def test_what_is_written_comes_back(crs: str, tmp_path: Path) -> None:
    path = tmp_path / "measurements.gpkg"
    write_measurements(path, MEASURED, crs)
    for given, read in zip(MEASURED, read_measurements(path, crs), strict=True):
        for field in ("name", "kind", "is_outline", "record"):
            assert getattr(given, field) == getattr(read, field)
        np.testing.assert_allclose(read.corners_map_m, given.corners_map_m, atol=1e-8)
    first = path.read_bytes()
    write_measurements(path, MEASURED, crs)
    assert path.read_bytes() == first


def test_a_gis_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "measurements.gpkg"
    write_measurements(path, MEASURED, "EPSG:25832")
    info = pyogrio.read_info(path, layer=LAYER)
    assert (info["features"], info["crs"]) == (3, "EPSG:25832")
    write_measurements(path, [], "EPSG:25832")
    assert read_measurements(path, "EPSG:25832") == []


def test_something_else_is_named(tmp_path: Path) -> None:
    path = tmp_path / "measurements.gpkg"
    path.write_bytes(b"nothing")
    with pytest.raises(ProjectError, match=r"measurements .*cannot be read .*: move it away to begin without any"):
        read_measurements(path, "EPSG:25832")


def test_a_measurement_without_a_place_is_named(tmp_path: Path) -> None:
    path = tmp_path / "measurements.gpkg"
    pyogrio.raw.write(
        path, geometry=np.array([None], dtype=object), field_data=[np.array(["x"], dtype=object)] * 4,
        fields=["name", "kind", "figures", "record"], layer="measurements", driver="GPKG", geometry_type="Unknown",
        crs="EPSG:25832",
    )  # fmt: skip
    with pytest.raises(ProjectError, match=r"cannot be read \(one has no place\): move it away"):
        read_measurements(path, "EPSG:25832")
