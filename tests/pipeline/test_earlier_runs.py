"""What stages took in an earlier run: read where they are whole, believed where a machine explains it."""

from pathlib import Path

import pytest

from photogram.pipeline.costs.earlier_runs import StageMeasured, corrected, measured_stages
from photogram.pipeline.store.workspace import Workspace


def stored(folder: Path, name: str, seconds: float, compiling: float = 0.0) -> None:
    """Write a complete stage that took so long."""
    workspace = Workspace(folder)
    workspace.begin(name, "mark")
    summary = {"seconds": seconds, "compilation_seconds": compiling, "peak_memory_bytes": 7}
    workspace.finish(name, "mark", summary)


def test_whole_stages_tell_what_they_took_without_compilation(tmp_path: Path) -> None:
    stored(tmp_path, "features", 12.5)
    stored(tmp_path, "dense", 40.0, 27.0)
    stored(tmp_path, "matches", 3.0)
    note = tmp_path / "matches.stage/stage.json"
    note.write_text(note.read_text(encoding="utf-8").replace("3.0", "4.0"), encoding="utf-8")
    assert measured_stages(Workspace(tmp_path)) == {
        "features": StageMeasured(12.5, 7),
        "dense": StageMeasured(13.0, 7),
    }
    assert measured_stages(Workspace(tmp_path / "nowhere")) == {}


@pytest.mark.parametrize(
    ("predicted", "measured", "expected"),
    [
        (10.0, 16.0, 16.0),
        (10.0, 4.0, 4.0),
        (10.0, 100.0, 10.0),  # another cell, or a machine that was busy
        (10.0, 1.0, 10.0),
        (0.2, 0.4, 0.2),  # too short to tell
        (0.0, 30.0, 0.0),  # not asked for any more
    ],
)
def test_what_was_measured_goes_before_what_is_predicted(predicted: float, measured: float, expected: float) -> None:
    found = corrected({"dense": predicted, "features": 1.0}, {"dense": StageMeasured(measured, None)})
    assert found == {"dense": expected, "features": 1.0}
