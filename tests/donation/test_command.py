"""The command `photogram donate`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from photogram.donation.donation import REMOVED, read_donation

Photogram = Callable[..., Any]


def test_the_command_shows_what_it_would_save(photogram: Photogram, adjusted_survey: Path) -> None:
    project, path = adjusted_survey / "project.yaml", adjusted_survey / "project_donation.npz.gz"
    refused = photogram("donate", project)
    assert refused.code == 1
    assert "In the file:" in refused.out
    assert REMOVED in refused.out
    assert "nothing is saved unless a person has seen this: add --yes" in refused.err
    assert not path.exists()
    saved = photogram("donate", project, "--yes")
    assert saved.code == 0, saved.err
    assert saved.out.splitlines()[-1].endswith("It was sent nowhere.")
    assert read_donation(path).result.sigma0 > 0.0
    wrong = photogram("donate", project, "--yes", "--output", project)
    assert wrong.code == 1
    assert "give a name that ends in .npz.gz" in wrong.err
    assert project.read_text(encoding="utf-8").startswith("#") or "photogram: 1" in project.read_text(encoding="utf-8")
