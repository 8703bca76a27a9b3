"""README.txt names every file of the results, and nothing else."""

import re
import shutil
from pathlib import Path

import pytest

from photogram.files.atomic import replacing
from photogram.languages.codes import CODES, LanguageCode
from photogram.languages.language import ENGLISH, Language
from photogram.pipeline.store.readme import README, write_readme
from photogram.pipeline.store.results_record import CHECKSUMS, read_record, recorded, remove_made
from photogram.result_files import within_results


def listed(results: Path) -> list[str]:
    """Return the names that the file lists, in their order, with their folders."""
    names, folder = list[str](), ""
    for line in (results / within_results(README)).read_text(encoding="utf-8").splitlines():
        if re.fullmatch(r"\w+/", line):
            folder = line
        elif line.startswith("  "):
            names.append(folder + line.split()[0])
    return names


def test_every_file_of_a_survey_is_listed_with_what_it_holds(finished_survey: Path) -> None:
    results = finished_survey / "results"
    names, record = listed(results), set(read_record(results))
    pictures = {name for name in record if name.startswith("technical/pictures/")}
    assert set(names) == (record - pictures) | {"technical/pictures/"}
    assert len(names) == len(set(names))
    text = (results / within_results(README)).read_text(encoding="utf-8")
    assert not [line for line in text.splitlines() if line.startswith("  ") and len(line.split()) < 3]
    assert f"{len(pictures)} pictures" in text
    assert text.index("report.html") < text.index("orthophoto.tif") < text.index("dsm_sigma.tif")
    assert max(map(len, text.splitlines())) < 130


def test_what_is_added_and_removed_is_followed_and_the_same_files_give_the_same_bytes(tmp_path: Path) -> None:
    (tmp_path / "deliverables").mkdir()
    with recorded(tmp_path), replacing(tmp_path / "deliverables/survey.dxf") as partial:
        partial.write_text("of a command")
    write_readme(tmp_path, ENGLISH)
    first = (tmp_path / within_results(README)).read_bytes()
    assert listed(tmp_path) == [within_results(README), "deliverables/survey.dxf"]
    assert "quality" not in first.decode()
    write_readme(tmp_path, ENGLISH)
    assert (tmp_path / within_results(README)).read_bytes() == first
    remove_made(tmp_path, ["deliverables/survey.dxf"])
    write_readme(tmp_path, ENGLISH)
    assert listed(tmp_path) == [within_results(README)]
    assert f"{within_results(README).split('/')[1]}\n" in (tmp_path / "deliverables" / CHECKSUMS).read_text()


def test_results_of_earlier_versions_are_left_as_they_are(tmp_path: Path) -> None:
    (tmp_path / "dsm.tif").touch()
    write_readme(tmp_path, ENGLISH)
    assert [path.name for path in tmp_path.iterdir()] == ["dsm.tif"]


@pytest.mark.parametrize("code", [code for code in CODES if code != "en"])
def test_in_another_language_the_same_files_are_listed_and_no_word_stays_english(
    finished_survey: Path, tmp_path: Path, code: LanguageCode
) -> None:
    results = tmp_path / "results"
    shutil.copytree(finished_survey / "results", results)
    english = (results / within_results(README)).read_text(encoding="utf-8")
    write_readme(results, Language(code))
    text = (results / within_results(README)).read_text(encoding="utf-8")
    assert listed(results) == listed(finished_survey / "results")
    assert not [line for line in text.splitlines() if line in english.splitlines() and " " in line]
    assert max(map(len, text.splitlines())) < 150
