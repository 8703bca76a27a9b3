"""A core without its wings: what a survey needs is there, and the commands of the wings are not."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from test_house import ROOT, WINGS

CALL = """
import sys
# an editable installation would find the wings where they are
sys.meta_path = [finder for finder in sys.meta_path if "Editable" not in getattr(finder, "__name__", "")]
from photogram.cli.main import main
main()
"""


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package without its wings."""
    folder = tmp_path_factory.mktemp("core")
    shutil.copytree(ROOT / "photogram", folder / "photogram")  # follows the links to factors and cli
    for wing in WINGS:
        shutil.rmtree(folder / "photogram" / wing)
    return folder


def call(core: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = (sys.executable, "-c", CALL, *map(str, arguments))
    environment = {**os.environ, "PYTHONPATH": str(core)}
    return subprocess.run(command, cwd=core, env=environment, capture_output=True, text=True, check=False)


def test_the_commands_of_the_wings_are_not_there(core: Path) -> None:
    shown = call(core, "--help").stdout
    commands = {line.split()[1] for line in shown.splitlines() if line.startswith("│ ") and line[2] not in " -"}
    assert commands == {"init", "check", "adjust", "report", "view", "schema"}
    outcome = call(core, "compare", "a.tif", "--reference", "b.tif")
    assert (outcome.returncode, "No such command 'compare'" in outcome.stderr) == (2, True)


@pytest.mark.survey
def test_a_survey_is_adjusted_without_wings(core: Path, survey: Path) -> None:
    """The built-in survey from its photographs to its report, by a copy that has no wing."""
    outcome = call(core, "adjust", survey / "project.yaml", "--quiet")
    assert outcome.returncode == 0, outcome.stderr
    report = json.loads((survey / "results" / "quality/report.json").read_text(encoding="utf-8"))
    assert report["check_points"]["n"] > 0
