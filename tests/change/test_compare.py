"""The command `photogram compare` with two epochs; with clouds and a reference it is in test_commands.py."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from changed_surveys import OUTLINES, STABLE, write_epochs, write_polygons
from PIL import Image

Photogram = Callable[..., Any]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    write_epochs(folder)
    write_polygons(folder / "heaps.gpkg", OUTLINES, ["heap", "pit"])
    write_polygons(folder / "stable.gpkg", [STABLE], ["road"])
    return folder


def words(text: str) -> str:
    return " ".join(text.split())


def test_two_epochs_with_volumes(site: Path, tmp_path: Path, photogram: Photogram) -> None:
    outcome = photogram(
        "compare", site / "later", "--reference", site / "earlier", "--polygons", site / "heaps.gpkg",
        "--stable", site / "stable.gpkg", "--polygon-sigma", "0.05", "--output", tmp_path / "out",
    )  # fmt: skip
    assert outcome.code == 0, outcome.err
    found = json.loads((tmp_path / "out/comparison.json").read_text())["dsm"]
    assert found["registration_applied"] is False
    assert found["volumes"][0]["outline_sigma_m3"] > 0.0
    shown = words(outcome.out)
    for text in (
        "later/dsm.tif minus earlier/dsm.tif", "Volumes, m³, with 1 sigma", "pit", "not taken off (--coregister does)",
        "no volume is counted there: heap.", "volumes.csv",
    ):  # fmt: skip
        assert text in shown, text
    assert f"offset {found['registration']['value'][0]:+.4f}" in shown
    with Image.open(tmp_path / "out/comparison.png") as picture:
        assert min(picture.size) > 400


def test_one_epoch_over_the_ground_around_its_polygons(site: Path, tmp_path: Path, photogram: Photogram) -> None:
    options = ("--reference", "rim", "--polygons", site / "heaps.gpkg", "--output", tmp_path)
    outcome = photogram("compare", site / "later", *options)
    assert outcome.code == 0, outcome.err
    assert "The base of each polygon is the plane through the ground around it." in words(outcome.out)
    found = json.loads((tmp_path / "comparison.json").read_text())["dsm"]
    assert found["reference_sigma_from"] == "the ground around each polygon"
    assert [v["name"] for v in found["volumes"]] == ["heap", "pit"]


def test_the_word_volume_measures_what_compare_does(site: Path, tmp_path: Path, photogram: Photogram) -> None:
    options = ("--reference", "rim", "--polygons", site / "heaps.gpkg", "--output", tmp_path / "compare")
    assert photogram("compare", site / "later", *options).code == 0
    outcome = photogram("volume", site / "later", site / "heaps.gpkg", "--output", tmp_path / "volume")
    assert outcome.code == 0, outcome.err
    tables = [(tmp_path / name / "volumes.csv").read_bytes() for name in ("compare", "volume")]
    assert tables[0] == tables[1]
    level = photogram("volume", site / "later", site / "heaps.gpkg", "--base", "39.5", "--output", tmp_path / "level")
    assert level.code == 0, level.err
    assert "minus the height 39.5 m" in words(level.out)
    found = json.loads((tmp_path / "level/comparison.json").read_text())["dsm"]
    for volume in found["volumes"]:
        rim = next(v for v in json.loads((tmp_path / "volume/comparison.json").read_text())["dsm"]["volumes"]
                   if v["name"] == volume["name"])  # fmt: skip
        assert volume["net_m3"] > rim["net_m3"]
        assert volume["common_sigma_m3"] > rim["common_sigma_m3"]


def test_m3c2_of_two_clouds(site: Path, tmp_path: Path, photogram: Photogram) -> None:
    pytest.importorskip("py4dgeo")
    outcome = photogram(
        "compare", site / "later/results", "--reference", site / "earlier/results", "--method", "m3c2",
        "--stable", site / "stable.gpkg", "--coregister", "offset", "--radius", "0.6", "--output", tmp_path,
    )  # fmt: skip
    assert outcome.code == 0, outcome.err
    shown = words(outcome.out)
    assert "Level of detection: standard deviations of both epochs, alignment on stable ground." in shown
    assert "taken off. Residuals" in shown
    found = json.loads((tmp_path / "comparison.json").read_text())["dense"]
    assert found["scales"]["radius_m"] == 0.6
    assert (tmp_path / "distances.laz").is_file()


def test_without_py4dgeo_the_command_says_what_to_install(
    site: Path, tmp_path: Path, photogram: Photogram, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "py4dgeo", None)
    clouds = (
        site / "later/results/deliverables/dense.laz",
        "--reference",
        site / "earlier/results/deliverables/dense.laz",
    )
    outcome = photogram("compare", *clouds, "--method", "m3c2", "--output", tmp_path / "out")
    assert outcome.code == 1
    assert "pip install 'photogram[change]'" in outcome.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        (("later", "later", "--reference", "earlier"), "two epochs are compared, 2 files and a reference were given"),
        (("later", "--reference", "earlier", "--radius", "1"), "scales are those of M3C2"),
        (("later", "--reference", "earlier", "--method", "mesh", "--polygons", "heaps.gpkg"), "volumes are those of"),
        (("later", "--reference", "earlier", "--coregister", "tilt"), "name the ground that has not moved"),
        (("later", "--reference", "earlier", "--sigma", "-1", "0"), "two lengths in m are expected"),
        (("later", "--reference", "nowhere"), "file not found"),
        (
            (
                "later/results/deliverables/dense.laz",
                "--reference",
                "earlier/results/deliverables/dense.laz",
                "--polygons",
                "heaps.gpkg",
            ),
            "take none of the options of two epochs",
        ),
    ],
)
def test_what_does_not_go_together_is_one_error(
    site: Path, tmp_path: Path, photogram: Photogram, options: tuple[str, ...], fault: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(site)
    outcome = photogram("compare", *options, "--output", tmp_path / "out")
    assert outcome.code == 1
    assert fault in words(outcome.err)
    assert outcome.err.count("photogram:") == 1
    assert not (tmp_path / "out").exists()
