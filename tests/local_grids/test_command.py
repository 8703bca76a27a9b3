"""The command `photogram calibrate-site`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

Photogram = Callable[..., Any]
ROWS = (
    (12.5668, 55.6758, 45.0, 4707.1, 608.3, 8.9),
    (12.5801, 55.6772, 38.2, 5489.6, 1003.5, 2.0),
    (12.5743, 55.6854, 52.7, 4868.0, 1752.2, 17.0),
    (12.5601, 55.6861, 33.3, 3999.8, 1567.0, -2.3),
    (12.5533, 55.6731, 41.9, 4009.2, 62.5, 6.3),
    (12.5700, 55.6800, 49.5, 4766.6, 1111.2, 13.5),
)


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Pairs whose local coordinates are those of a plane, which the ellipsoid is to some decimetres here."""
    place = np.array(ROWS)
    x = np.deg2rad(place[:, 0] - 12.57) * 6392747.0 * np.cos(np.deg2rad(55.68))
    y = np.deg2rad(place[:, 1] - 55.68) * 6379077.0
    z = 5000 + 1000j + np.exp(0.3j) * (x + 1j * y)
    rows = ["name,longitude,latitude,height,local_easting,local_northing,local_height"]
    rows += [
        f"P{i},{lon},{lat},{h},{e:.3f},{n:.3f},{h - 36:.3f}"
        for i, ((lon, lat, h, *_), e, n) in enumerate(zip(ROWS, z.real, z.imag, strict=True), 1)
    ]
    path = tmp_path / "pairs.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_a_calibration_is_shown_and_written(photogram: Photogram, table: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    outcome = photogram("calibrate-site", table, "--sigma-plan-m", "0.3", "--sigma-height-m", "0.05")
    assert outcome.code == 0, outcome.err
    said = " ".join(outcome.out.split())
    for words in ("combined scale factor", "grid factor", "height factor", "rotation", "17.1", "P6", "Each pair left"):
        assert words in said
    assert "Nothing contradicts the calibration." in said
    assert table.with_suffix(".wkt2").read_text().startswith("COMPOUNDCRS")


def test_a_wrong_pair_is_named(photogram: Photogram, table: Path) -> None:
    lines = table.read_text().splitlines()
    fields = lines[3].split(",")
    fields[6] = f"{float(fields[6]) + 1.0:.3f}"
    table.write_text("\n".join([*lines[:3], ",".join(fields), *lines[4:]]) + "\n")
    outcome = photogram("calibrate-site", table, "--sigma-plan-m", "0.3", "--sigma-height-m", "0.02")
    assert outcome.code == 0, outcome.err
    assert "Contradicts: P3: its local coordinates are 1.0" in outcome.out
    assert outcome.out.count("Contradicts") == 1


def test_what_cannot_be_read_is_one_error(photogram: Photogram, table: Path) -> None:
    table.write_bytes(b"name\xff")
    outcome = photogram("calibrate-site", table)
    assert outcome.code == 1
    assert "not UTF-8" in outcome.err
    assert not table.with_suffix(".wkt2").exists()
