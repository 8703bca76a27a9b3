"""project.yaml as a file: what is no project, and settings that any dataclass describes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

import pytest
from makers import no_matlab

from photogram.errors import ProjectError, SettingError
from photogram.project.document import Document, read_settings
from photogram.project.project import read_project
from photogram.settings.settings import Settings as BaseSettings

# -- files that are no project ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"photogram: 1\ncameras: [1, 2\nworld: grid\n", r":3: column 6: not valid YAML, .*: check indentation"),
        (b"photogram: 1\n\tcrs: x\n", r":2: column 1: not valid YAML, .*'\\t'"),
        (b"photogram: 1\nworld: \xff\n", r":2: byte 0xff is not UTF-8: save the file as UTF-8"),
        (b"photogram: 1\nworld: \x07\n", r":2: the character U\+0007 is not allowed in YAML"),
        (b"# nothing\n- a list\n", r":2: a project file is a mapping of keys that begins with photogram: 1"),
        (b"a: 1\n---\nb: 1\n", r":2: column 1: not valid YAML, .*another document"),
        (b"a: &x [*x]\n", r":1: a: unknown key"),
        (b"? [a, b]\n: 1\n", r":1: a key must be plain text on one line"),
        (b"", r":1: photogram: is missing"),
    ],
)
def test_what_is_no_project_file(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "project.yaml").write_bytes(content)
    with pytest.raises(ProjectError, match=message):
        read_project(tmp_path / "project.yaml", read_matlab_camera=no_matlab)


def test_no_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(
        ProjectError, match=r"project\.yaml: cannot be read \(No such file or directory\): give the path"
    ):
        read_project(tmp_path / "project.yaml", read_matlab_camera=no_matlab)
    with pytest.raises(ProjectError, match=r"cannot be read \(Is a directory\)"):
        read_project(tmp_path, read_matlab_camera=no_matlab)


# -- settings of any dataclass ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Inner:
    depth: int = 1


@dataclass(frozen=True)
class Settings:
    needed: float
    ratio: float = 0.8
    count: int | None = None
    kind: Literal["huber", "cauchy"] = "huber"
    sizes: tuple[int, ...] = (1, 2)
    either: float | Literal["all"] = 1.0
    inner: Inner = field(default_factory=Inner)
    derived: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        if not 0 < self.ratio < 1:
            raise SettingError("ratio", f"must lie between 0 and 1, found {self.ratio:g}")


@pytest.fixture
def document(tmp_path: Path) -> Callable[[str], Document]:
    def write(text: str) -> Document:
        (tmp_path / "project.yaml").write_text(text)
        return Document(tmp_path / "project.yaml")

    return write


def test_settings_are_the_dataclass(document: Callable[[str], Document]) -> None:
    text = "s: {needed: 2, count: 3, kind: cauchy, sizes: [4, 5, 6], either: all, inner: {depth: 2}}"
    expected = Settings(2.0, 0.8, 3, "cauchy", (4, 5, 6), "all", Inner(2))
    assert read_settings(document(text), "s", Settings) == expected
    assert read_settings(document("s: {needed: 1, ratio: 0.5, count:}"), "s", Settings) == Settings(1.0, 0.5)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("s: {}", ["s.needed: is missing: give this setting, it has no default"]),
        ("t: 1", ["s.needed: is missing: give this setting, it has no default"]),
        ("s: {needed: 1, ratio: 2}", ["s.ratio: must lie between 0 and 1, found 2"]),
        ("s: {needed: 1, derived: 2}", ["s.derived: unknown key: allowed here: "]),
        ("s: {needed: 1, inner: {dept: 2}}", ["s.inner.dept: unknown key: did you mean 'depth'?"]),
        ("s: {needed: 1, inner: 5}", ["s.inner: needs a mapping of keys, found 5"]),
        ("s: {needed: 1, sizes: [1, 2.5]}", ["s.sizes[#2]: must be a whole number, found 2.5"]),
        ("s: {needed: 1, sizes: 3}", ["s.sizes: must be a list, found 3"]),
        ("s: {needed: 1, either: some}", ["s.either: must be a number, found the text 'some', or must be all, found"]),
        (
            "s: {needed: '1', kind: hubber}",
            ["s.needed: must be a number, found the text '1'", "s.kind: must be huber or"],
        ),
    ],
)
def test_settings_faults(document: Callable[[str], Document], text: str, expected: list[str]) -> None:
    opened = document(text)
    assert read_settings(opened, "s", Settings) is None
    with pytest.raises(ProjectError) as raised:
        opened.raise_errors()
    lines = [line for line in str(raised.value).splitlines() if "errors:" not in line]
    assert len(lines) == len(expected)
    for start in expected:
        assert any(f"project.yaml:1: {start}" in line for line in lines), lines


def test_list_items_are_called_by_name_or_path(document: Callable[[str], Document]) -> None:
    opened = document("a: [{name: N}, {path: p.txt}, {path: q, name: 7}, {x: 1}, 3]")
    assert [opened.where(("a", i)) for i in range(5)] == ["a[N]", "a[p.txt]", "a[7]", "a[#4]", "a[#5]"]


@dataclass(frozen=True)
class Shortened(BaseSettings):
    gone: ClassVar[Mapping[str, str]] = {"height": "was the depth with its sign turned: write depth"}

    depth: int = 0


def test_a_setting_of_an_earlier_version_is_told_what_replaces_it(document: Callable[[str], Document]) -> None:
    opened = document("s: {height: 3, dept: 2}")
    assert read_settings(opened, "s", Shortened) is None
    with pytest.raises(ProjectError) as raised:
        opened.raise_errors()
    assert "s.height: was the depth with its sign turned: write depth" in str(raised.value)
    assert "s.dept: unknown key: did you mean 'depth'?" in str(raised.value)
