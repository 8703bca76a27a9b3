"""Whatever becomes of a file of a stage is found, named, and made good: nothing damaged is used."""

import hashlib
import json
import os
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from makers import undrawing

from photogram.errors import DamagedStageError, ImageError, WorkspaceError
from photogram.files.npz_json import FORMAT, write_json
from photogram.pipeline.pipeline import STAGES, load_project, run_pipeline
from photogram.pipeline.stage import Stage, Watcher
from photogram.pipeline.store.stage_files import Checksum, checksum, journalled
from photogram.pipeline.store.stage_summary import Summary
from photogram.pipeline.store.workspace import Workspace

Run = Callable[..., Any]
NAMES: list[str] = [stage.name for stage in STAGES]
RUNS_DIFFER = {"stage.json", "report.json", "report.html", "checksums.sha256", "photogram.lock"}


class Witness(Watcher):
    """A watcher that notes which stages ran, and the warnings."""

    def __init__(self) -> None:
        self.ran: list[str] = []
        self.warnings: list[str] = []

    def end(self, stage: Stage, seconds: float | None, summary: Summary) -> None:  # noqa: ARG002
        if seconds is not None:
            self.ran.append(stage.name)

    def warn(self, text: str) -> None:
        self.warnings.append(text)


def run(survey: Path, **options: Any) -> Witness:
    witness = Witness()
    run_pipeline(load_project(survey / "project.yaml"), watcher=witness, **options)
    return witness


def contents(survey: Path) -> dict[str, str]:
    """Return the checksums of all files but those that hold times."""
    files = [p for p in sorted(survey.rglob("*")) if p.is_file() and p.name not in RUNS_DIFFER]
    return {p.relative_to(survey).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def flip_a_bit(content: bytes, rng: random.Random) -> bytes:
    place = rng.randrange(len(content))
    return content[:place] + bytes([content[place] ^ 1 << rng.randrange(8)]) + content[place + 1 :]


def change_a_digit(content: bytes, rng: random.Random) -> bytes:
    digits = [i for i, byte in enumerate(content) if 48 <= byte < 58]
    if not digits:
        return flip_a_bit(content, rng)
    place = rng.choice(digits)
    other = 48 + (content[place] - 48 + rng.randrange(1, 10)) % 10
    return content[:place] + bytes([other]) + content[place + 1 :]


DAMAGE: dict[str, Callable[[bytes, random.Random], bytes | None]] = {
    "bit": flip_a_bit,
    "digit": change_a_digit,
    "deleted": lambda *_: None,
    "cut": lambda content, rng: content[: rng.randrange(len(content))],
    "longer": lambda content, _: content + b"\0",
    "zeros": lambda content, _: bytes(len(content)),
}


@pytest.fixture(scope="module")
def damaged_survey(finished_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A copy of the adjusted survey which every case of this module damages and finds mended."""
    survey = tmp_path_factory.mktemp("damaged") / "survey"
    shutil.copytree(finished_survey, survey)
    with undrawing():
        run(survey, start="results")
        yield survey


def files_to_damage(stage: str, count: int) -> list[tuple[str, str]]:
    """Return for a stage ``count`` kinds of damage, its note among what they are done to."""
    kinds = list(DAMAGE)
    start = NAMES.index(stage)
    return [(stage, kinds[(start + i) % len(kinds)]) for i in range(count)]


# 15 stages, three kinds of damage each but for those that take seconds to be made again
CASES = [c for stage in NAMES for c in files_to_damage(stage, 1 if stage in ("adjustment", "results") else 3)]


@pytest.mark.parametrize(("stage", "damage"), CASES)
def test_damage_is_found_named_and_only_its_stage_made_again(damaged_survey: Path, stage: str, damage: str) -> None:
    before = contents(damaged_survey)
    folder = damaged_survey / "work" / f"{stage}.stage"
    files = [p for p in sorted(folder.rglob("*")) if p.is_file()]
    rng = random.Random(f"{stage} {damage}")
    path = rng.choice(files)
    content = DAMAGE[damage](path.read_bytes(), rng)
    if content is None:
        path.unlink()
    else:
        path.write_bytes(content)
    witness = run(damaged_survey)
    assert witness.ran == [stage]
    what = "is missing" if content is None else "was modified since it was written"
    assert witness.warnings == [f"{path}: {what}: the stage {stage} is run again"]
    assert contents(damaged_survey) == before
    assert run(damaged_survey).ran == []


def test_damage_that_keeps_length_and_time_is_found_where_it_is_read(adjusted_survey: Path) -> None:
    """As a disk does it: the file system knows of nothing."""
    path = adjusted_survey / "work/photographs.stage/tags.json"
    status, text = path.stat(), path.read_text()
    place = text.index("gnss_map_m") + 30
    path.write_text(text[:place] + ("3" if text[place] != "3" else "4") + text[place + 1 :])
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    witness = run(adjusted_survey, start="orientation", until="orientation")
    assert witness.ran == ["photographs", "orientation"]
    assert witness.warnings == [f"{path}: was modified since it was written: the stage photographs is run again"]
    assert path.read_text() == text


def test_damage_that_comes_back_ends_the_run(adjusted_survey: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = adjusted_survey / "work/tie_points.stage/tie_points.npz"
    finish = Workspace.finish

    def damaging(self: Workspace, name: str, mark: str, summary: Summary) -> None:
        finish(self, name, mark, summary)
        if name == "tie_points":
            path.write_bytes(b"nothing")

    monkeypatch.setattr(Workspace, "finish", damaging)
    with pytest.raises(
        WorkspaceError, match=r"tie_points\.npz: was modified .*again after it was recomputed: check the"
    ):
        run(adjusted_survey, start="tie_points", until="orientation")


def test_the_terminal_names_the_file(adjusted_survey: Path, photogram: Run) -> None:
    path = adjusted_survey / "work/dense.stage/grid.json"
    path.unlink()
    outcome = photogram("adjust", adjusted_survey / "project.yaml", "--until", "dense")
    assert outcome.code == 0
    assert f"Warning: {path}: is missing: the stage dense is run again" in " ".join(outcome.out.split())
    assert path.is_file()


def test_other_commands_use_nothing_damaged(adjusted_survey: Path, photogram: Run) -> None:
    path = adjusted_survey / "work/results.stage/figures.json"
    page = (adjusted_survey / "results/deliverables/report.html").read_bytes()
    path.write_text(path.read_text().replace("1", "2", 1))
    outcome = photogram("report", adjusted_survey / "project.yaml")
    assert outcome.code == 1
    assert outcome.err == (
        f"photogram: {path}: was modified since it was written: run photogram adjust, which runs the stage results "
        "again\n"
    )
    assert (adjusted_survey / "results/deliverables/report.html").read_bytes() == page


def test_a_photograph_that_changes_while_the_run_goes_on(survey: Path, photogram: Run) -> None:
    """It is swapped for another when its key points have been found."""
    first, second = (survey / "photographs" / f"sim_000{n}.JPG" for n in (1, 2))
    witness, project = Witness(), load_project(survey / "project.yaml")

    def swap(stage: Stage) -> None:
        if stage.name == "transfer":
            shutil.copyfile(second, first)

    witness.begin = swap  # type: ignore[method-assign]
    with pytest.raises(ImageError, match=r"sim_0001\.JPG: was modified since the run began: do not change"):
        run_pipeline(project, watcher=witness)
    outcome = photogram("adjust", survey / "project.yaml", "--until", "features")
    assert outcome.code == 0
    assert outcome.out.count("done before") == 0


# ---- the checksums themselves ----------------------------------------------------------------------------------------


def make(workspace: Workspace, name: str = "features", mark: str = "m") -> Path:
    partial = workspace.begin(name, mark)
    with journalled(partial):
        for number in range(3):
            write_json(partial / f"{number}.json", [number] * 9)
        (partial / "inner").mkdir(exist_ok=True)
        write_json(partial / "inner" / "deep.json", "deep")
    return partial


def test_every_file_stands_in_the_note_with_its_checksum(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    make(workspace)
    workspace.finish("features", "m", {"pairs": 3})
    folder = workspace.stage("features")
    note = json.loads((folder / "stage.json").read_text())
    files = {p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file() and p.name != "stage.json"}
    assert set(note["files"]) == set(files)
    assert len(files) == 5
    for name, path in files.items():
        assert note["files"][name]["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
        assert note["files"][name]["bytes"] == path.stat().st_size
    assert workspace.stored("features") == {"stage": "features", "fingerprint": "m", "format": FORMAT, "pairs": 3}
    assert workspace.file("features", "inner", "deep.json") == files["inner/deep.json"]
    with pytest.raises(DamagedStageError, match=r"other\.json: was not written by the stage"):
        workspace.file("features", "other.json")


def test_what_is_read_twice_is_compared_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace = Workspace(tmp_path)
    make(workspace)
    workspace.finish("features", "m", {})
    compared: list[Path] = []

    def noted(path: Path) -> Checksum:
        compared.append(path)
        return checksum(path)

    monkeypatch.setattr("photogram.pipeline.store.stage_files.checksum", noted)
    assert workspace.is_complete("features", "m")
    assert compared == []
    for _ in range(3):
        workspace.file("features", "1.json")
    assert compared == [workspace.stage("features") / "1.json"]


def test_an_interrupted_stage_keeps_what_is_whole_and_names_what_is_damaged(tmp_path: Path) -> None:
    workspace, said = Workspace(tmp_path), list[str]()
    partial = make(workspace)
    (partial / "1.json").write_text("damaged")
    (partial / "foreign.json").symlink_to(tmp_path / "elsewhere")
    (partial / ".photogram-0123456789abcdef.partial").write_text("half")
    (partial / "inner" / ".photogram-0123456789abcdef.partial").write_text("half")
    with (partial / "files.sha256").open("a") as journal:
        journal.write("0123 half a li")
    times = {name: (partial / name).stat().st_mtime_ns for name in ("0.json", "2.json", "inner/deep.json")}
    assert workspace.begin("features", "m", said.append) == partial
    assert said == [
        f"{partial / name}: was modified since it was written: it will be computed again"
        for name in ("1.json", "foreign.json")
    ]
    assert {p.relative_to(partial).as_posix() for p in partial.rglob("*") if p.is_file()} == {
        *times, "stage.json", "files.sha256", "made-by-photogram.txt",
    }  # fmt: skip
    assert {name: (partial / name).stat().st_mtime_ns for name in times} == times


@pytest.mark.parametrize("suffix", [".stage", ".stage.partial", ".stage.removed"])
@pytest.mark.parametrize("what", ["link", "file", "folder"])
def test_what_photogram_did_not_make_is_refused_and_left(tmp_path: Path, suffix: str, what: str) -> None:
    workspace, mine = Workspace(tmp_path / "work"), tmp_path / "mine"
    mine.mkdir()
    (mine / "a.JPG").write_text("mine")
    place = tmp_path / "work" / f"features{suffix}"
    place.parent.mkdir()
    if what == "link":
        place.symlink_to(mine)
    elif what == "file":
        place.write_text("mine")
    else:
        shutil.copytree(mine, place)
    before = sorted(tmp_path.rglob("*"))

    def whole(mark: str) -> None:
        workspace.begin("features", mark)
        workspace.finish("features", mark, {})

    with pytest.raises(WorkspaceError, match=rf"features{suffix}: .*(link|is not a folder|did not make)") as fault:
        whole("m1")
    assert "move it away" in str(fault.value)
    with pytest.raises(WorkspaceError):
        workspace.discard("features")
    assert (mine / "a.JPG").read_text() == "mine"
    assert set(before) <= set(tmp_path.rglob("*"))


def test_a_removal_that_was_stopped_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace = Workspace(tmp_path)
    make(workspace)
    workspace.finish("features", "m", {})
    with monkeypatch.context() as patch:
        patch.setattr("os.unlink", lambda _: (_ for _ in ()).throw(OSError(5, "Input/output error")))
        with pytest.raises(WorkspaceError, match=r"cannot be removed \(Input/output error\)"):
            workspace.discard("features")
    assert not workspace.is_complete("features", "m")
    workspace.discard("features")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("call", ["mkdir", "rename", "iterdir"])
def test_what_the_file_system_refuses_is_one_sentence(
    survey: Path, photogram: Run, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    real = getattr(Path, call)

    def refuse(self: Path, *values: Any, **options: Any) -> Any:
        if ".stage" in self.name:
            raise OSError(5, "Input/output error", str(self))
        return real(self, *values, **options)

    if call != "mkdir":
        assert photogram("adjust", survey / "project.yaml", "--until", "photographs").code == 0
    monkeypatch.setattr(Path, call, refuse)
    again = ["--from", "photographs"] if call == "rename" else []
    outcome = photogram("adjust", survey / "project.yaml", *again, "--until", "photographs")
    assert outcome.code == 1
    assert outcome.err.count("\n") == 1
    assert outcome.err.startswith(f"photogram: {survey / 'work'}")
    assert "Input/output error" in outcome.err
