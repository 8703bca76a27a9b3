"""What the client's part says of each file that is handed over."""

from makers import Json

from photogram.pipeline.stages.order import BEFORE_RESULTS
from photogram.report.client.files import CONTENTS, contents_of, handed_over


def test_every_file_of_a_survey_is_described(full_report: Json) -> None:
    files = handed_over(full_report["deliverables"])
    assert [file.name for file in files if not file.contents] == []
    listed = {entry["file"] for entry in full_report["deliverables"]}
    assert {file.name for file in files[:-1]} == {n for n in listed if not n.startswith("pictures/")} | {"pictures/"}


def test_products_of_every_stage_are_described() -> None:
    products = {product for stage in BEFORE_RESULTS for product in stage.products}
    assert len(products) > 10
    assert [name for name in products if not contents_of(name)] == []


def test_what_a_reader_looks_for_comes_first_and_what_is_unknown_last() -> None:
    names = ["zeta.bin", "pictures/a.png", "dtm.tif", "photographs.csvt", "orthophoto.tif", "pictures/b.png"]
    found = handed_over([{"file": name, "bytes": 1, "sha256": ""} for name in names])
    assert [file.name for file in found] == [
        "orthophoto.tif", "dtm.tif", "photographs.csvt", "zeta.bin", "pictures/", "report.html, report.json",
    ]  # fmt: skip
    assert found[3].contents == ""
    assert found[4].contents.startswith("2 pictures")
    assert found[0].contents == CONTENTS["orthophoto.tif"]
