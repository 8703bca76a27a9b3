"""The command `photogram export`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from photogram.exchange.formats.names import SOLUTION_FORMATS
from photogram.exchange.formats.table import WRITERS

Photogram = Callable[..., Any]


def test_the_command_knows_the_formats() -> None:
    assert set(SOLUTION_FORMATS) == set(WRITERS)


def test_a_survey_is_written_for_another_program(adjusted_survey: Path, tmp_path: Path, photogram: Photogram) -> None:
    target = tmp_path / "angles.txt"
    outcome = photogram("export", adjusted_survey / "project.yaml", "--to", "omega-phi-kappa", "--output", target)
    assert outcome.code == 0, outcome.err
    assert "Not in it: Cameras, tie points and ground points" in outcome.out
    assert f"Exported: {target}" in outcome.out.replace("\n", "")
    assert target.read_text(encoding="utf-8").startswith("# name x y z omega phi kappa")
    again = photogram("export", adjusted_survey / "project.yaml", "--to", "omega-phi-kappa", "--output", target)
    assert again.code == 1
    assert "is there already" in again.err
