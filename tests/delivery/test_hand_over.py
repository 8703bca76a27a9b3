"""A finished survey handed over: what is written, and what is never replaced."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from photogram.delivery.hand_over import deliver
from photogram.delivery.names import FILES, Product
from photogram.delivery.survey_contents import survey_contents
from photogram.errors import ExchangeError
from photogram.files.atomic import write_whole
from photogram.pipeline.pipeline import load_project, open_run
from photogram.pipeline.store.results_record import read_record, recorded

Photogram = Callable[..., Any]


def test_products_are_recorded_and_changed_ones_kept(adjusted_survey: Path) -> None:
    results = adjusted_survey / "results"
    first = deliver(adjusted_survey, tuple(Product))
    folder = results / "deliverables"
    assert [delivered.path for delivered in first] == [folder / FILES[product][0] for product in Product]
    record = read_record(results)
    for delivered in first:
        checksum = hashlib.sha256(delivered.path.read_bytes()).hexdigest()
        assert record[delivered.path.relative_to(results).as_posix()] == checksum
    assert "deliverables/dsm.tif" in record, "what a run has recorded stays recorded"
    usual = deliver(adjusted_survey)
    assert read_record(results) == record, "the same survey gives the same bytes"
    assert usual == tuple(d for d in first if d.path.name != FILES[Product.TILES][0].rpartition("/")[2])
    own = folder / FILES[Product.DXF][0]
    own.write_text("edited\n")
    with pytest.raises(ExchangeError, match="was changed since photogram wrote it"):
        deliver(adjusted_survey)
    assert own.read_text() == "edited\n"
    with pytest.raises(ExchangeError, match="'dwg': is no product that is handed over: choose of dxf, qgis, landxml, "):
        deliver(adjusted_survey, ["dwg"])
    (adjusted_survey / "elsewhere").mkdir()
    (adjusted_survey / "elsewhere" / own.name).write_text("mine\n")
    with pytest.raises(ExchangeError, match="was not written by photogram"):
        deliver(adjusted_survey, ["dxf"], adjusted_survey / "elsewhere")


def test_tiles_of_before_are_removed_and_changed_ones_kept(adjusted_survey: Path) -> None:
    results = adjusted_survey / "results"
    tiles, root = results / "deliverables/tiles3d", "deliverables/tiles3d/0_0_0.glb"
    deliver(adjusted_survey, ["3dtiles"])
    assert root in read_record(results)
    assert "  tiles3d/" in (results / "deliverables/README.txt").read_text(encoding="utf-8")
    with recorded(results / "deliverables"):
        write_whole(tiles / "7_0_0.glb", b"of another surface")
    assert "deliverables/tiles3d/7_0_0.glb" in read_record(results)
    deliver(adjusted_survey, ["3dtiles"])
    assert not (tiles / "7_0_0.glb").exists()
    assert "deliverables/tiles3d/7_0_0.glb" not in read_record(results)
    (tiles / "0_0_0.glb").write_bytes(b"edited")
    with pytest.raises(ExchangeError, match=r"0_0_0\.glb: was changed since photogram wrote it"):
        deliver(adjusted_survey, ["3dtiles"])
    assert (tiles / "0_0_0.glb").read_bytes() == b"edited"
    (tiles / "0_0_0.glb").unlink()
    (tiles / "mine.glb").write_bytes(b"mine")
    with pytest.raises(ExchangeError, match=r"mine\.glb: was not written by photogram"):
        deliver(adjusted_survey, ["3dtiles"])


def test_the_contents_are_those_of_the_survey(finished_survey: Path) -> None:
    project = load_project(finished_survey / "project.yaml")
    with open_run(project) as run:
        contents = survey_contents(run)
    given = {point.name: point for point in project.control_points}
    assert set(contents.points.name) == set(given)
    for name, is_control, place in zip(
        contents.points.name, contents.points.is_control, contents.points.position_map_m, strict=True
    ):
        assert is_control == (given[name].role == "control")
        assert place == pytest.approx(given[name].position_map_m, abs=1e-6)
    assert contents.contours is not None
    assert len(contents.footprints) == len(project.photographs)


def test_the_command_says_what_it_wrote_and_what_is_missing(
    adjusted_survey: Path, tmp_path: Path, photogram: Photogram
) -> None:
    folder = tmp_path / "handed over"
    outcome = photogram("deliver", adjusted_survey, "--to", "dxf", "--output", folder)
    assert outcome.code == 0, outcome.err
    assert f"Written: {folder / 'survey.dxf'}: " in outcome.out.replace("\n", "")
    assert sorted(path.name for path in folder.iterdir()) == ["checksums.sha256", "survey.dxf"]
    assert photogram("deliver", adjusted_survey, "--to", "dwg").code == 2
    for option, name in (("--tolerance-m", "tolerance_m -1"), ("--surface-error-m", "surface_error_m -1")):
        wrong = photogram("deliver", adjusted_survey, option, "-1")
        assert (wrong.code, f"{name}: is no length" in wrong.err) == (1, True)


def test_an_unfinished_survey_is_not_handed_over(survey: Path) -> None:
    with pytest.raises(ExchangeError, match="is not finished as it now stands: run photogram adjust first"):
        deliver(survey)
