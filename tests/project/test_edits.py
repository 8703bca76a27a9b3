"""One value of a project file changed: everything else stays, comments too."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photogram.errors import ProjectError
from photogram.project.document import Document
from photogram.project.draft.edits import with_value, write_values

PATH = Path("project.yaml")
TEXT = """# of a person
photogram: 1
report: {name: Old, author: B} # keep this
gnss:
  # what the receiver says
  offset_sigma_m: [1, 2, 3] # plan, plan, height
  time_offset: none
  # of nothing
cameras:
  a: {width_px: 10}
"""


def values(text: str) -> object:
    return Document.of_text(text, PATH).value


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        (("report", "name"), "Quarry: north", 'report: {name: "Quarry: north", author: B} # keep this'),
        (("report", "client"), "C", 'report: {name: Old, author: B, client: "C"} # keep this'),
        (("gnss", "offset_sigma_m"), [0.1, 0.1, 0.2], "  offset_sigma_m: [0.1, 0.1, 0.2] # plan, plan, height"),
        (("gnss", "lever"), 1.5, "  lever: 1.5"),
        (("heights", "output"), "ellipsoidal", '  output: "ellipsoidal"'),
    ],
)
def test_one_line_changes_and_every_comment_stays(key: tuple[str, ...], value: object, line: str) -> None:
    changed = with_value(TEXT, key, value, PATH)  # type: ignore[arg-type]
    assert line in changed.splitlines()
    assert [row for row in TEXT.splitlines() if "#" in row and row.lstrip().startswith("#")] == [
        row for row in changed.splitlines() if row.lstrip().startswith("#")
    ]
    block = values(changed)[key[0]]  # type: ignore[index]
    assert block[key[1]] == value


def test_a_value_is_taken_out_with_its_line() -> None:
    changed = with_value(TEXT, ("gnss", "offset_sigma_m"), None, PATH)
    assert changed == TEXT.replace("  offset_sigma_m: [1, 2, 3] # plan, plan, height\n", "")
    assert with_value(TEXT, ("heights", "output"), None, PATH) == TEXT
    assert with_value(TEXT, ("gnss", "lever"), None, PATH) == TEXT


def test_an_empty_block_goes_with_its_last_value() -> None:
    changed = with_value(TEXT, ("dense", "enabled"), False, PATH)
    assert changed.endswith("dense:\n  enabled: false\n")
    assert with_value(changed, ("dense", "enabled"), None, PATH) == TEXT
    flow = TEXT + "orthophoto: {enabled: false} # none\n"
    assert with_value(flow, ("orthophoto", "enabled"), None, PATH) == TEXT
    assert "report: {author: B} #" in with_value(TEXT, ("report", "name"), None, PATH)
    assert "report: {name: Old} #" in with_value(TEXT, ("report", "author"), None, PATH)


@given(st.text(st.characters(blacklist_categories=("Cs", "Cc", "Zl", "Zp", "Cf", "Cn", "Co", "Zs")), min_size=1))
def test_any_title_comes_back(title: str) -> None:
    assert values(with_value(TEXT, ("report", "name"), title, PATH))["report"]["name"] == title  # type: ignore[index]


def test_a_value_of_a_list_item_is_set_and_taken_out() -> None:
    listed = (
        TEXT + "control_points:\n  files:\n    - path: a.csv # ours\n      sigma_assumed: true\n    - path: b.csv\n"
    )
    changed = with_value(listed, ("control_points", "files", 0, "sigma_m"), [0.01, 0.01, 0.02], PATH)
    assert "      sigma_m: [0.01, 0.01, 0.02]\n    - path: b.csv\n" in changed
    without = with_value(changed, ("control_points", "files", 0, "sigma_assumed"), None, PATH)
    assert "sigma_assumed" not in without
    assert "- path: a.csv # ours" in without
    assert with_value(listed, ("control_points", "files", 1, "sigma_assumed"), None, PATH) == listed


def refuse(path: Path) -> None:
    raise ValueError(f"{path} is refused")


def test_what_cannot_be_set_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "project.yaml"
    path.write_text(TEXT)
    with pytest.raises(ProjectError, match="photogram is no block, so name has no place in it"):
        write_values(path, {("report", "name"): "y", ("photogram", "name"): "x"}, str)
    assert path.read_text() == TEXT
    with pytest.raises(ValueError, match="refused"):
        write_values(path, {("report", "name"): "y"}, refuse)
    assert path.read_text() == TEXT
    write_values(path, {("report", "name"): "New"}, str)
    assert 'name: "New"' in path.read_text()
