"""The JSON Schema of project.yaml against photogram's own reading: what the one accepts the other does, too."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from makers import no_matlab
from pages import ROOT, blocks
from pydantic import ValidationError

from photogram.errors import ProjectError
from photogram.project.document import Document, settings_model
from photogram.project.json_schema import project_schema
from photogram.project.project import SECTIONS, read_project
from photogram.settings.settings import Setting, settings_of

SCHEMA = project_schema()
VALIDATOR = Draft202012Validator(SCHEMA)
OTHER_FILES = ("distributed:", "# photogram plan")
"""How blocks of YAML begin that are no project file: settings of Dask, a flight to plan."""


def completed(shown: dict[str, Any]) -> dict[str, Any]:
    """Return what a page shows of a project file with what any project must say."""
    whole: dict[str, Any] = yaml.safe_load(SHORTEST) | shown
    whole["photographs"] = {"folder": "photographs"} | whole["photographs"]
    whole["cameras"] = {
        name: {"width_px": 1, "height_px": 1} | ({} if "matlab" in camera else {"focal_px": 1}) | camera
        for name, camera in whole["cameras"].items()
    }
    return whole


def alternatives(text: str) -> list[str]:
    """Return a block, or each of its lines where all of them say the same key."""
    lines = text.splitlines()
    return lines if len(lines) > 1 and len({line.partition(":")[0] for line in lines}) == 1 else [text]


BLOCKS = [
    pytest.param(text, id=str(block))
    for block in blocks("yaml")
    if not block.code.startswith(OTHER_FILES)
    for text in alternatives(block.code)
]

SHORTEST = """
photogram: 1
crs: EPSG:25832
cameras: {a: {width_px: 400, height_px: 300, focal_px: 500}}
photographs: {folder: photographs}
"""


def errors(text: str, folder: Path) -> list[str]:
    """Return where and what the schema refuses in a project file."""
    (folder / "project.yaml").write_text(text, encoding="utf-8")
    value = Document(folder / "project.yaml").value
    return [f"{'.'.join(map(str, e.absolute_path))}: {e.message}" for e in VALIDATOR.iter_errors(value)]


def test_the_schema_is_one() -> None:
    Draft202012Validator.check_schema(SCHEMA)
    assert SCHEMA["$schema"] == "https://json-schema.org/draft/2020-12/schema"


def test_every_key_is_explained() -> None:
    """An editor shows a description beside each key, and no title that repeats it."""
    definitions: Any = SCHEMA["$defs"]
    blocks = {"ProjectFile": SCHEMA, **definitions}
    assert len(blocks) > 30
    for name, block in blocks.items():
        assert block["additionalProperties"] is False, name
        for key, of_key in block["properties"].items():
            assert of_key["description"].endswith("."), f"{name}.{key}"
            assert "title" not in of_key


@pytest.mark.parametrize("path", sorted((ROOT / "examples").rglob("project.yaml")), ids=lambda p: p.parent.name)
def test_the_examples_pass(path: Path, tmp_path: Path) -> None:
    assert errors(path.read_text(encoding="utf-8"), tmp_path) == []


def test_the_full_example_of_the_documentation_passes(tmp_path: Path) -> None:
    full = blocks("yaml", "docs/project-file.md")[0].code
    assert full.startswith("photogram: 1")
    assert errors(full, tmp_path) == []


@pytest.mark.parametrize("text", BLOCKS)
def test_the_blocks_of_the_documentation_pass(text: str, tmp_path: Path) -> None:
    if text.startswith(" "):  # keys of a camera
        text = "cameras:\n  a:\n" + text
    assert errors(yaml.safe_dump(completed(yaml.safe_load(text))), tmp_path) == []


WRONG = {
    "unknown key": "dnse: {}",
    "unknown setting": "dense: {enabeled: true}",
    "unknown key of a camera": "cameras: {a: {width_px: 400, height_px: 300, focal: 500}}",
    "no width": "cameras: {a: {height_px: 300, focal_px: 500}}",
    "no camera": "cameras: {}",
    "another format": "photogram: 2",
    "no folder": "photographs: {camera: a}",
    "no photographs": "photographs:",
    "a word for a number": "dense: {photographs: many}",
    "a fraction for a whole number": "dense: {photographs: 2.5}",
    "a number for true": "dense: {enabled: 1}",
    "above the range": "orthophoto: {feather_cells: 9}",
    "below the range": "contours: {interval_m: 0.001}",
    "none of the words": "adjustment: {robust_loss: hubber}",
    "two numbers for three": "gnss: {offset_sigma_m: [0.2, 0.2]}",
    "one out of range": "gnss: {lever_arm_m: [0, 0, 100000]}",
    "a sigma of 0": "control_points: {sigma_m: [0, 0.1, 0.1]}",
    "role": "control_points: {list: [{name: A, role: chek}]}",
    "half a role": "control_points: {list: [{name: A, role: {plan: check}}]}",
    "freedom": "cameras: {a: {width_px: 400, height_px: 300, focal_px: 500, sigmas: {k1: fre}}}",
    "heights": "heights: orthometric",
    "an empty name": "photographs: {folder: '  '}",
    "one end": "distances: [{between: [A], length_m: 1, sigma_m: 0.1}]",
    "a distance without its sigma": "distances: [{between: [A, B], length_m: 1}]",
    "a mask that is none": "photographs: {folder: p, masks: {auto: [clouds]}}",
    "a fraction of a pixel": "control_points: {files: [{path: a.txt, picture_size_px: [4000.5, 3000]}]}",
    "null for a list": "rigs:",
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_refused_by_both(name: str, tmp_path: Path) -> None:
    assert errors(SHORTEST, tmp_path) == []
    key = WRONG[name].partition(":")[0]
    kept = [line for line in SHORTEST.splitlines() if line.partition(":")[0] != key]
    assert errors("\n".join([*kept, WRONG[name]]), tmp_path)
    with pytest.raises(ProjectError, match=rf"project\.yaml:\d+: (?:{key}|photogram)"):
        read_project(tmp_path / "project.yaml", read_matlab_camera=no_matlab)


def test_an_empty_block_and_a_default_written_out_pass(tmp_path: Path) -> None:
    more = "dense:\ngnss:\nsurface: {cell_m: null}\nadjustment: {relative_tolerance: 0}\nfeatures: {}\n"
    assert errors(SHORTEST + more, tmp_path) == []


ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-5, 10**6),
    # 2.0 is a whole number to JSON Schema, and a slip of the pen to photogram
    st.floats(allow_nan=False, allow_infinity=False).filter(lambda v: not v.is_integer()),
    st.sampled_from(["auto", "none", "huber", "yes", "", "x"]),
    st.lists(st.integers(), max_size=2),
    st.dictionaries(st.sampled_from(["a"]), st.integers(), max_size=1),
)


def values_of(setting: Setting) -> st.SearchStrategy[object]:
    """Return values about what a setting may be, its limits and the numbers next to them among them."""
    if setting.within is not None:
        ends = (setting.within.low, setting.within.high)
        near = [float(end + step * max(1.0, abs(end))) for end in ends for step in (-1e-6, 0.0, 1e-6)]
        whole = [math.floor(v) + step for v in ends for step in (-1, 0, 1)]
        return st.one_of(st.sampled_from([*(v for v in near if not v.is_integer()), *whole]), ANYTHING)
    if setting.choices:
        return st.one_of(st.sampled_from(list(setting.choices)), ANYTHING)
    return ANYTHING


@pytest.mark.parametrize("section", SECTIONS)
@given(data=st.data())
def test_the_schema_and_photogram_agree_on_settings(section: str, data: st.DataObject) -> None:
    keys = {setting.name: values_of(setting) for setting in settings_of(SECTIONS[section])} | {"unknown": ANYTHING}
    names = data.draw(st.lists(st.sampled_from(list(keys)), max_size=3, unique=True))
    value = {name: data.draw(keys[name]) for name in names}
    try:
        settings_model(SECTIONS[section]).model_validate_json(json.dumps(value))
        accepted = True
    except ValidationError:
        accepted = False
    assert Draft202012Validator({**SCHEMA, "required": []}).is_valid({section: value}) == accepted
