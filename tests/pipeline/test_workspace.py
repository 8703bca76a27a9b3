import json
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.camera import Camera
from photogram.errors import DamagedStageError, WorkspaceError
from photogram.files.atomic import replacing
from photogram.files.npz_json import file_fingerprint, fingerprint, read_arrays, read_json, write_arrays, write_json
from photogram.files.records import read_record, write_record
from photogram.pipeline.stages.matches import MatchesSummary
from photogram.pipeline.store.stage_files import journalled
from photogram.pipeline.store.stage_summary import StageNote
from photogram.pipeline.store.workspace import Workspace
from photogram.sfm.tie_points.detector import FeatureSettings
from photogram.survey import Features

EMPTY = ["made-by-photogram.txt", "stage.json"]

values = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats(-9, 9) | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
    max_leaves=8,
)


@dataclass(frozen=True)
class Settings:
    name: str = "a"
    length_m: float = 1.5
    count: int = 3
    on: bool = True
    folder: Path = Path("work")
    pair: tuple[float, float] = (1.0, 2.0)
    limit_m: float | None = None
    weights: dict[str, float] = field(default_factory=lambda: {"x": 1.0, "y": 2.0})


# ---- fingerprints ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("name", "b"), ("length_m", 1.5000000000000002), ("count", 4), ("on", False), ("folder", Path("other")),
        ("pair", (2.0, 1.0)), ("limit_m", 0.0), ("weights", {"x": 1.0, "y": 2.1}),
    ],
)  # fmt: skip
def test_every_setting_changes_the_fingerprint(name: str, value: Any) -> None:
    assert {f.name for f in fields(Settings)} >= {name}
    assert fingerprint(replace(Settings(), **{name: value})) != fingerprint(Settings())
    assert fingerprint(replace(Settings())) == fingerprint(Settings())


def test_every_setting_of_a_real_stage_counts() -> None:
    plain = FeatureSettings()
    words: dict[str, Any] = {"doubled": "yes", "detector": "orb"}
    others: dict[str, Any] = {f.name: words.get(f.name) or getattr(plain, f.name) * 2 for f in fields(plain)}
    marks = {fingerprint(replace(plain, **{name: value})) for name, value in others.items()}
    assert len(marks | {fingerprint(plain)}) == len(fields(plain)) + 1


def test_every_parameter_of_a_camera_counts() -> None:
    plain = Camera("a", 30, 20, 25.0, np.array([14.5, 9.5]))
    others = [
        Camera("b", 30, 20, 25.0, np.array([14.5, 9.5])), Camera("a", 20, 30, 25.0, np.array([14.5, 9.5])),
        plain.with_parameters(plain.parameters + 1e-9), replace(plain, sigmas=np.full(12, np.inf)),
        replace(plain, sigmas=np.ones(12)),
    ]  # fmt: skip
    assert len({fingerprint(camera) for camera in [plain, *others]}) == 6


@given(value=st.dictionaries(st.text(max_size=4), values, max_size=5), data=st.data())
def test_the_order_of_a_mapping_does_not_count(value: dict[str, Any], data: st.DataObject) -> None:
    turned = dict(data.draw(st.permutations(list(value.items()))))
    assert fingerprint(turned) == fingerprint(value)


@given(one=values, other=values)
def test_different_values_differ_and_equal_values_agree(one: Any, other: Any) -> None:
    assert (fingerprint(one) == fingerprint(other)) == (
        json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)
    )


def test_what_is_listed_counts_with_its_place() -> None:
    assert fingerprint([1, 2], 3) != fingerprint([1], 2, 3)
    assert fingerprint(["a", "b"]) != fingerprint(["b", "a"])
    assert fingerprint("ab", "c") != fingerprint("a", "bc")
    assert fingerprint(np.array([1.0, 2.0])) == fingerprint([1.0, 2.0]) != fingerprint(np.array([[1.0], [2.0]]))
    assert len({fingerprint(x) for x in (np.inf, -np.inf, np.nan, 0.0)}) == 4


def test_a_fingerprint_is_the_same_in_every_run() -> None:
    program = "from photogram.files.npz_json import fingerprint; print(fingerprint({'b': 1.5, 'a': ('x', None)}, 'é'))"
    environment = {"PYTHONHASHSEED": "7", "PATH": ""}
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)
    assert run.stdout.strip() == fingerprint({"a": ["x", None], "b": 1.5}, "é")


def test_a_files_fingerprint_is_that_of_its_content(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    one.write_bytes(b"abc")
    other.write_bytes(b"abc")
    assert file_fingerprint(one) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert file_fingerprint(other) == file_fingerprint(one)
    other.write_bytes(b"abd")
    assert file_fingerprint(one) != file_fingerprint(other)
    with pytest.raises(WorkspaceError, match=r"missing: cannot be read: No such file"):
        file_fingerprint(tmp_path / "missing")


# ---- files ----------------------------------------------------------------------------------------------------------


def test_a_block_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "poses.json"
    write_json(path, {"round": 1})

    def stop_half_way() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half of it")
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        stop_half_way()
    with pytest.raises(TypeError):
        write_json(path, {"round": object()})
    assert read_json(path) == {"round": 1}
    assert [p.name for p in tmp_path.iterdir()] == ["poses.json"]


def test_until_a_block_ends_the_old_file_is_there(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with replacing(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
        assert temporary.parent == path.parent
    assert path.read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(WorkspaceError, match=r"missing/a\.json: cannot be written \(No such file or directory\)"):
        write_json(tmp_path / "missing" / "a.json", 1)
    with pytest.raises(WorkspaceError, match=r"a\.npz: cannot be written"):
        write_arrays(tmp_path / "missing" / "a.npz", {"x": np.zeros(3)})


def test_json_keeps_names_and_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_json(path, {"é": [1, 0.1 + 0.2, np.float64(np.pi), np.array([1.5, np.nan])], "p": Path("x/y"), "none": None})
    assert read_json(path) == {"é": [1, 0.1 + 0.2, np.pi, [1.5, None]], "p": "x/y", "none": None}
    assert path.read_text(encoding="utf-8").endswith("}\n")


def test_arrays_come_back_bit_by_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    arrays = {
        "f": rng.standard_normal((4, 3)), "i": np.arange(3), "b": np.array([True, False]),
        "u": np.zeros((0, 3), np.uint8), "t": np.array(["A", "Bö"]), "nan": np.array([np.nan, np.inf]),
    }  # fmt: skip
    for name in ("a.npz", "b.npz"):
        write_arrays(tmp_path / name, arrays)
    back = read_arrays(tmp_path / "a.npz")
    assert set(back) == set(arrays)
    for name, array in arrays.items():
        np.testing.assert_array_equal(back[name], array)
        assert back[name].dtype == array.dtype
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_records_come_back_with_their_types(tmp_path: Path) -> None:
    features = Features(
        np.ones((2, 2)), np.ones(2), np.zeros(2), np.zeros((2, 128), np.uint8), np.zeros((2, 3), np.uint8)
    )
    write_record(tmp_path / "f.npz", features)
    back = read_record(tmp_path / "f.npz", Features)
    assert back.descriptor.dtype == np.uint8
    np.testing.assert_array_equal(back.pixel, features.pixel)
    write_record(tmp_path / "s.npz", Numbers(3, 0.5, None))
    assert read_record(tmp_path / "s.npz", Numbers) == Numbers(3, 0.5, None)


@dataclass(frozen=True)
class Numbers:
    count: int
    share: float
    missing: float | None = None


def truncated(content: bytes) -> bytes:
    return content[: len(content) // 2]


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "truncated": truncated,
    "empty": lambda _: b"",
    "cut by its last bytes": lambda content: content[:-9],
    "overwritten": lambda content: bytes(len(content)),
    "other bytes": lambda content: b"\xff\xfe\x80" + content[3:],
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_json_is_a_fault_that_says_what_to_delete(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "truth.json"
    write_json(path, {"fingerprint": "abc", "seconds": [1.5] * 9})
    path.write_bytes(DAMAGE[damage](path.read_bytes()))
    with pytest.raises(WorkspaceError, match=r"truth\.json: cannot be read .*: delete it and run again"):
        read_json(path)


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_note_is_that_of_a_damaged_stage(tmp_path: Path, damage: str) -> None:
    workspace = Workspace(tmp_path)
    workspace.begin("adjustment", "abc")
    workspace.finish("adjustment", "abc", {"key_points": [1500] * 9})
    path = workspace.stage("adjustment") / "stage.json"
    path.write_bytes(DAMAGE[damage](path.read_bytes()))
    with pytest.raises(DamagedStageError, match=r"stage\.json: was modified .*runs the stage adjustment again"):
        workspace.is_complete("adjustment", "abc")


def test_json_of_a_thousand_levels_is_a_fault(tmp_path: Path) -> None:
    (tmp_path / "deep.json").write_text("[" * 100_000)
    with pytest.raises(WorkspaceError, match="cannot be read"):
        read_json(tmp_path / "deep.json")


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_arrays_are_a_fault_that_says_what_to_delete(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "00000.npz"
    write_arrays(path, {"pixel": np.arange(400.0), "size_px": np.ones(200)})
    path.write_bytes(DAMAGE[damage](path.read_bytes()))
    with pytest.raises(WorkspaceError, match=r"00000\.npz: cannot be read .*: delete it and run again"):
        read_arrays(path)


def test_a_flipped_bit_in_an_array_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    write_arrays(path, {"pixel": np.arange(400.0)})
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(bytes(content))
    with pytest.raises(WorkspaceError, match="cannot be read"):
        read_arrays(path)


def test_missing_files_are_a_fault(tmp_path: Path) -> None:
    for read in (read_json, read_arrays):
        with pytest.raises(WorkspaceError, match=r"nothing: cannot be read"):
            read(tmp_path / "nothing")


def test_arrays_never_run_code(tmp_path: Path) -> None:
    path = tmp_path / "pickled.npz"
    with path.open("wb") as stream:
        np.savez(stream, x=np.array([{"a": 1}], dtype=object))
    with pytest.raises(WorkspaceError, match="cannot be read"):
        read_arrays(path)


# ---- stages ---------------------------------------------------------------------------------------------------------


def test_a_stage_is_complete_once_finished_and_only_under_its_fingerprint(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "work")
    assert not workspace.is_complete("matches", "m1")
    partial = workspace.begin("matches", "m1")
    (partial / "0-1.npz").write_text("one")
    assert not workspace.is_complete("matches", "m1")
    workspace.finish("matches", "m1", {"seconds": 1.5, "pairs": 3})
    assert workspace.is_complete("matches", "m1")
    assert not workspace.is_complete("matches", "m2")
    assert sorted(p.name for p in workspace.stage("matches").iterdir()) == [
        "0-1.npz",
        "made-by-photogram.txt",
        "stage.json",
    ]
    assert not partial.exists()
    note = workspace.summary("matches", StageNote)
    assert (note["stage"], note["seconds"]) == ("matches", 1.5)
    assert workspace.summary("matches", MatchesSummary) == {"pairs": 3}


def test_an_interrupted_stage_goes_on_with_its_files(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    partial = workspace.begin("features", "m1")
    with journalled(partial):
        write_json(partial / "00000.json", "done")
    resumed = Workspace(tmp_path).begin("features", "m1")
    assert read_json(resumed / "00000.json") == "done"


def test_files_of_another_fingerprint_are_not_kept(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    (workspace.begin("features", "m1") / "00000.npz").write_text("of old settings")
    partial = workspace.begin("features", "m2")
    assert sorted(p.name for p in partial.iterdir()) == EMPTY
    (partial / "stage.json").unlink()
    (partial / "00001.npz").write_text("of nobody knows what")
    assert sorted(p.name for p in workspace.begin("features", "m2").iterdir()) == EMPTY


def test_a_finished_stage_stands_until_its_successor_is_complete(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    (workspace.begin("surface", "m1") / "dsm").write_text("old")
    workspace.finish("surface", "m1", {})
    (workspace.begin("surface", "m2") / "dsm").write_text("new")
    assert workspace.is_complete("surface", "m1")
    assert (workspace.stage("surface") / "dsm").read_text() == "old"
    workspace.finish("surface", "m2", {})
    assert workspace.is_complete("surface", "m2")
    assert (workspace.stage("surface") / "dsm").read_text() == "new"


def test_a_kill_between_the_renames_mixes_nothing(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    partial = workspace.begin("surface", "m1")
    (partial / "dsm").write_text("whole")
    (partial / "stage.json").write_text(json.dumps({"stage": "surface", "fingerprint": "m1", "format": 7, "files": {}}))
    assert not workspace.is_complete("surface", "m1")
    assert sorted(p.name for p in workspace.begin("surface", "m1").iterdir()) == EMPTY


def test_a_discarded_stage_is_gone(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    workspace.begin("surface", "m1")
    workspace.finish("surface", "m1", {})
    workspace.begin("surface", "m2")
    workspace.discard("surface")
    workspace.discard("surface")
    assert list(tmp_path.iterdir()) == []


HOLDER = """
import sys
from pathlib import Path
from photogram.pipeline.store.stage_summary import StageNote
from photogram.pipeline.stages.matches import MatchesSummary
from photogram.pipeline.store.workspace import Workspace
with Workspace(Path(sys.argv[1])).locked():
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_process_is_told_that_the_folder_is_in_use_until_the_first_ends(tmp_path: Path) -> None:
    work = Workspace(tmp_path / "work")
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(work.folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with (
            pytest.raises(WorkspaceError, match=r"work: another photogram is running here; wait for it"),
            work.locked(),
        ):
            pass
        holder.kill()
        holder.wait()
        with work.locked():
            pass


def test_a_lock_is_given_back_and_belongs_to_one_folder(tmp_path: Path) -> None:
    work = Workspace(tmp_path / "work")
    with work.locked():
        with pytest.raises(WorkspaceError, match="another photogram"), work.locked():
            pass
        with Workspace(tmp_path / "other").locked():
            pass
    with work.locked():
        pass


def test_a_lock_follows_no_link_and_empties_no_file(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "photogram.lock").symlink_to(tmp_path / "mine")
    with pytest.raises(WorkspaceError, match="cannot be used for intermediate"), Workspace(tmp_path).locked():
        pass
    (tmp_path / "photogram.lock").unlink()
    (tmp_path / "photogram.lock").write_text("somebody's")
    with Workspace(tmp_path).locked():
        pass
    assert (tmp_path / "photogram.lock").read_text() == "somebody's"
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(WorkspaceError, match=r"file/work: cannot be used for intermediate results \(Not a directory\)"),
        Workspace(tmp_path / "file" / "work").locked(),
    ):
        pass


def test_arrays_of_every_kind_are_read_back_as_they_were(tmp_path: Path) -> None:
    arrays = {
        "floats": np.arange(12.0).reshape(3, 4),
        "by_columns": np.asfortranarray(np.arange(6, dtype=np.int32).reshape(2, 3)),
        "none": np.zeros((0, 3), np.float32),
        "one": np.array(7.5),
        "names": np.array(["a", "Straße"]),
        "flags": np.array([True, False]),
    }
    write_arrays(tmp_path / "a.npz", arrays)
    with ThreadPoolExecutor(8) as executor:
        for found in executor.map(lambda _: read_arrays(tmp_path / "a.npz"), range(64)):
            assert found.keys() == arrays.keys()
            for name, array in found.items():
                assert array.dtype == arrays[name].dtype
                assert array.flags.writeable
                np.testing.assert_array_equal(array, arrays[name])
