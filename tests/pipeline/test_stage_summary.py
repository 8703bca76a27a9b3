"""What stages say of themselves, as it is stored and read back."""

import json
from pathlib import Path

import pytest

from photogram.errors import DamagedStageError
from photogram.pipeline.pipeline import STAGES, load_project, open_run
from photogram.pipeline.stages.adjustment import AdjustmentSummary
from photogram.pipeline.stages.matches import PairsSummary
from photogram.pipeline.stages.publishing.results import ResultsSummary
from photogram.pipeline.store.stage_summary import StageNote, summary_from
from photogram.pipeline.store.workspace import Workspace, _seal


def test_what_every_stage_says_is_read_as_it_lies_on_disk(finished_survey: Path) -> None:
    with open_run(load_project(finished_survey / "project.yaml")) as run:
        for name in (stage.name for stage in STAGES):
            stored = json.loads((run.workspace.stage(name) / "stage.json").read_text(encoding="utf-8"))
            del stored["files"], stored["sha256"]
            assert run.workspace.stored(name) == stored
            note = run.workspace.summary(name, StageNote)
            assert (note["stage"], note["seconds"]) == (name, stored["seconds"])


def test_an_unknown_key_is_left_out_and_a_wrong_value_refused() -> None:
    assert summary_from({"pairs": 3, "triples": 1}, PairsSummary) == {"pairs": 3}
    refused: list[tuple[object, type[object]]] = [
        ({"pairs": "3"}, PairsSummary),
        ({"products": "report.json"}, ResultsSummary),
        ({"sigma0": "1.0"}, AdjustmentSummary),
        ([], PairsSummary),
        (None, StageNote),
    ]
    for wrong, kind in refused:
        with pytest.raises(ValueError, match="1 validation error"):
            summary_from(wrong, kind)


def test_a_stage_that_says_something_else_is_a_damaged_one(tmp_path: Path) -> None:
    workspace, said = Workspace(tmp_path), PairsSummary(pairs=3)
    workspace.begin("pairs", "m")
    workspace.finish("pairs", "m", said)
    path = workspace.stage("pairs") / "stage.json"
    note = json.loads(path.read_text(encoding="utf-8")) | {"pairs": "three"}
    del note["sha256"]
    path.write_text(json.dumps({**note, "sha256": _seal(note)}), encoding="utf-8")
    with pytest.raises(DamagedStageError, match=r"stage\.json: was modified since it was written"):
        workspace.summary("pairs", PairsSummary)
