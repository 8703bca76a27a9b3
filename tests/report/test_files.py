"""What the client's part says of each file that is handed over."""

from makers import Json

from photogram.report.client.files import PAGE, handed_over


def test_every_deliverable_of_a_survey_is_described(full_report: Json) -> None:
    files = handed_over(full_report["deliverables"])
    assert [file.name for file in files if not file.contents] == []
    listed = [entry["file"].split("/") for entry in full_report["deliverables"]]
    assert {file.name for file in files} == {n[1] for n in listed if n[0] == "deliverables"} | {
        PAGE, "quality/", "technical/",
    }  # fmt: skip


def test_what_a_reader_looks_for_comes_first_and_what_is_unknown_last() -> None:
    names = ["zeta.bin", "dtm.tif", "README.txt", "orthophoto.tif"]
    others = ["quality/dsm_sigma.tif", "technical/pictures/a.png", "technical/photographs.csvt"]
    listed = [*(f"deliverables/{name}" for name in names), *others]
    files = handed_over([{"file": name, "bytes": 1, "sha256": ""} for name in listed])
    assert [file.name for file in files] == [
        "report.html", "README.txt", "orthophoto.tif", "dtm.tif", "zeta.bin", "quality/", "technical/",
    ]  # fmt: skip
    assert files[4].contents == ""
    assert files[5].contents.endswith("(1 file)")
    assert files[6].contents.endswith("(2 files)")


def test_results_of_earlier_versions_are_all_shown() -> None:
    names = ["pictures/a.png", "dsm_sigma.tif", "photographs.csvt", "dsm.tif"]
    files = handed_over([{"file": name, "bytes": 1, "sha256": ""} for name in names])
    assert [file.name for file in files] == ["report.html", "dsm.tif", "dsm_sigma.tif", "photographs.csvt"]
    assert all(file.contents for file in files)
