"""The 3-D page of a folder of results, by the function and by the command: the same page."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from photogram.errors import ReportError
from photogram.pipeline.view import read_pictures, read_results, write_view

Run = Callable[..., Any]


def test_the_function_writes_what_the_command_writes(adjusted_survey: Path, photogram: Run) -> None:
    results = adjusted_survey / "results"
    outcome = photogram("view", results, "--points", 1000)
    assert outcome.code == 0, outcome.err
    page = results / "deliverables/view.html"
    by_command = page.read_bytes()
    page.unlink()
    assert write_view(str(results), points=1000) == page
    assert page.read_bytes() == by_command


def test_what_is_missing_is_said(adjusted_survey: Path) -> None:
    results = adjusted_survey / "results"
    record = read_results(results)
    assert len(read_pictures(results, record, None).jpeg) == 4
    (adjusted_survey / "photographs/sim_0001.JPG").unlink()
    assert read_pictures(results, record, adjusted_survey / "photographs").notes == (
        "Pictures of 3 of 4 photographs; of the others none: their files are not there",
    )
    assert [note.split(",")[0] for note in read_pictures(results, record, None).notes] == [
        "No pictures of photographs",
        "No pictures of photographs: --photographs names their folder",
    ]
    with pytest.raises(ReportError, match=r"report.json is missing: run photogram adjust first"):
        write_view(adjusted_survey / "photographs")
    elsewhere = Path(shutil.copytree(results, adjusted_survey / "copy"))
    for cloud in elsewhere.rglob("*.laz"):
        cloud.unlink()
    with pytest.raises(ReportError, match="no point cloud found"):
        write_view(elsewhere)
