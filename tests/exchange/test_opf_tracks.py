"""Tracks of OPF: packed ranges, several nodes, what does not fit."""

import json
from pathlib import Path

import numpy as np
import pytest
from foreign import small_solution

from photogram.errors import ExchangeError
from photogram.exchange.formats.pix4d.opf_tracks import read_tracks, write_tracks

CAMERAS = {i + 1: i for i in range(5)}


def test_matches_of_unknown_cameras_are_left_out_with_a_sentence(tmp_path: Path) -> None:
    tie = small_solution().tie_points
    write_tracks(tmp_path / "t.gltf", tie, 5)
    found, left_out = read_tracks(tmp_path / "t.gltf", {1: 0, 3: 2})
    assert len(found.point) == np.isin(tie.photograph, [0, 2]).sum()
    assert left_out[0].startswith(f"{np.isin(tie.photograph, [1, 4]).sum()} matches in photographs")


def test_two_nodes_with_a_matrix_each(tmp_path: Path) -> None:
    tie = small_solution().tie_points
    path = tmp_path / "t.gltf"
    write_tracks(path, tie, 5)
    value = json.loads(path.read_text(encoding="utf-8"))
    moved = list(value["nodes"][0]["matrix"])
    moved[12:15] = [100.0, 3.0, -20.0]  # y up: 20 m to the north, 3 m up
    value["nodes"].append({"mesh": 0, "matrix": moved})
    path.write_text(json.dumps(value), encoding="utf-8")
    found, _ = read_tracks(path, CAMERAS)
    assert len(found) == 2 * len(tie)
    np.testing.assert_allclose(found.position_world_m[30:] - found.position_world_m[:30], [[100.0, 20.0, 3.0]] * 30)
    assert found.point.max() == 59


def test_a_range_beyond_the_list_allocates_nothing(tmp_path: Path) -> None:
    path = tmp_path / "t.gltf"
    write_tracks(path, small_solution().tie_points, 5)
    ranges = tmp_path / "matchPointIndexRanges.bin"
    ranges.write_bytes(b"\x00" * 5 + b"\xff" * 3 + ranges.read_bytes()[8:])
    with pytest.raises(ExchangeError, match="ranges beyond"):
        read_tracks(path, CAMERAS)


def test_nodes_that_share_everything_a_thousand_times_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("photogram.exchange.formats.pix4d.opf_tracks.MOST_VALUES", 100_000)
    path = tmp_path / "t.gltf"
    write_tracks(path, small_solution().tie_points, 5)
    value = json.loads(path.read_text(encoding="utf-8"))
    value["nodes"] *= 1000
    path.write_text(json.dumps(value), encoding="utf-8")
    with pytest.raises(ExchangeError, match="share more values"):
        read_tracks(path, CAMERAS)


def test_points_without_a_position_are_left_out(tmp_path: Path) -> None:
    tie = small_solution().tie_points
    tie.position_world_m[3] = np.nan
    _, left_out = write_tracks(tmp_path / "t.gltf", tie, 5)
    assert left_out == ("1 tie point without a position.",)
    found, _ = read_tracks(tmp_path / "t.gltf", CAMERAS)
    assert len(found) == 29
