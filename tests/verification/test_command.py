"""The command `photogram verify`."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photogram.verification.check import Line, VerifiedReport

Photogram = Callable[..., Any]


def test_a_survey_that_is_as_it_says(photogram: Photogram, adjusted_survey: Path) -> None:
    results = adjusted_survey / "results"
    outcome = photogram("verify", results)
    assert outcome.code == 0, outcome.err
    assert "equal: adjustment.sigma0: 1 figures" in outcome.out
    assert "equal: SHA-256 of quality/report.json" in outcome.out
    assert "cannot be told: dense: " in outcome.out
    assert outcome.out.splitlines()[-1].startswith("Nothing differs; ")
    assert photogram("verify", results / "quality" / "report.json").out == outcome.out


def test_a_figure_that_was_changed_is_named_with_both(photogram: Photogram, adjusted_survey: Path) -> None:
    path = adjusted_survey / "results" / "quality" / "report.json"
    report = json.loads(path.read_text(encoding="utf-8"))
    sigma0 = report["adjustment"]["sigma0"]
    report["adjustment"]["sigma0"] = 0.5
    path.write_text(json.dumps(report), encoding="utf-8")
    outcome = photogram("verify", path)
    assert outcome.code == 1
    assert f"differs: adjustment.sigma0: stated 0.5, derived {sigma0:.9f}"[:60] in outcome.out
    assert "differs: report_id: " in outcome.out
    assert "differs: SHA-256 of quality/report.json" in outcome.out
    assert outcome.out.splitlines()[-1].startswith("DIFFERS in 3 places; ")


def test_a_report_of_which_nothing_is_derived_does_not_pass_for_one(
    photogram: Photogram, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = Line("cannot be told", "adjustment", "its model has what the file does not hold: rigs")
    monkeypatch.setattr("photogram.verification.check.verify_report", lambda _: VerifiedReport((told,), 0, 12))
    outcome = photogram("verify", tmp_path)
    assert outcome.code == 0
    assert outcome.out.splitlines() == [
        "cannot be told: adjustment: its model has what the file does not hold: rigs",
        "Nothing differs, but checksums alone were compared; 0 of 12 figures of report.json were derived.",
    ]


def test_what_cannot_be_read_is_said_in_a_sentence(photogram: Photogram, adjusted_survey: Path, tmp_path: Path) -> None:
    missing = photogram("verify", tmp_path)
    assert missing.code == 1
    assert "report.json: no report of photogram" in missing.err
    results = adjusted_survey / "results"
    (results / "technical" / "observations.npz").unlink()
    assert "observations.npz: cannot be read" in photogram("verify", results).err
    np.savez(results / "technical" / "observations.npz", format=np.array(99))
    assert "not of format 1" in photogram("verify", results).err
    shutil.copy(results / "deliverables" / "README.txt", results / "quality" / "report.json")
    assert "no report of photogram" in photogram("verify", results).err
