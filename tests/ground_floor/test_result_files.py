"""Where each file of the results lies, and what is said of it."""

from pathlib import Path

import pytest

from photogram.delivery.names import FILES
from photogram.pipeline.stages.order import BEFORE_RESULTS
from photogram.result_files import (
    RESULT_FILES,
    WRITTEN_IN_RESULTS,
    contents_of,
    is_picture,
    is_written_by_a_run,
    rank_of,
    result_path,
    within_results,
)


def test_products_of_every_stage_and_command_are_described() -> None:
    products = {product for stage in BEFORE_RESULTS for product in stage.products}
    products |= {name for names in FILES.values() for name in names}
    assert len(products) > 20
    assert [name for name in products if not contents_of(name)] == []
    assert {within_results(name).split("/")[0] for name in products} == {"deliverables", "quality"}


def test_every_file_lies_where_photogram_writes() -> None:
    assert {file.folder for file in RESULT_FILES} < set(WRITTEN_IN_RESULTS)
    assert within_results("dsm_filled.tif") == "deliverables/dsm_filled.tif"
    assert within_results("dsm_sigma_own.tif") == "quality/dsm_sigma_own.tif"
    assert within_results("dtm_source.tif.aux.xml") == "quality/dtm_source.tif.aux.xml"
    with pytest.raises(ValueError, match="no file of the results"):
        within_results("mine.tif")
    with pytest.raises(ValueError, match="no file of the results"):
        within_results("deliverables/dsm.tif")


def test_files_of_a_run_are_told_from_others() -> None:
    names = ("deliverables/dsm.tif", "technical/pictures/matches_a_b.png", "technical/masks/a.png")
    assert all(map(is_written_by_a_run, names))
    others = ("dsm.tif", "deliverables/survey.dxf", "technical/pictures/site.png", "quality/dsm.tif", "a/b/dsm.tif")
    assert not any(map(is_written_by_a_run, others))


def test_where_earlier_versions_wrote_is_read_where_nothing_else_is_there(tmp_path: Path) -> None:
    assert result_path(tmp_path, "dsm.tif") == tmp_path / "deliverables/dsm.tif"
    (tmp_path / "dsm.tif").touch()
    assert result_path(tmp_path, "dsm.tif") == tmp_path / "dsm.tif"
    (tmp_path / "deliverables").mkdir()
    (tmp_path / "deliverables/dsm.tif").touch()
    assert result_path(tmp_path, "dsm.tif") == tmp_path / "deliverables/dsm.tif"


def test_pictures_and_order() -> None:
    assert is_picture("technical/pictures/a.png")
    assert is_picture("pictures/a.png")
    assert not is_picture("technical/masks/a.png")
    assert not is_picture("pictures")
    assert rank_of("deliverables/orthophoto.tif") < rank_of("dsm.tif") < rank_of("technical/tie_points.mat")
    assert rank_of("survey.dxf") < rank_of("deliverables/zeta.bin")
