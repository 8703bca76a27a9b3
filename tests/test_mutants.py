"""What mutation testing changes, where, and by which tests it is judged."""

import importlib.util
from pathlib import Path

import mutants
import pytest
from mutants import Mutant, Notes, Record, Result, change_code, sampled, wanted

SOURCE = '''
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    LIMIT = 1

__all__ = ["first", "third"][:2]
Number = dict[str, int] | list[int]


def first(a: int | str, b: int = 4) -> int | None:
    """Add 3 and 5."""
    if isinstance(a, int | float):
        raise ValueError(f"{a * 2} is not allowed", a + 1)
    return a + b


class Third:
    def second(self, a: float) -> float:
        def inner(x: float) -> float:
            return x - a

        return inner(a - 1)
'''


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "changing.py"
    path.write_text(SOURCE, encoding="utf-8")
    return path


def test_types_and_words_are_no_mutants(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cosmic_ray")
    monkeypatch.setattr(mutants, "ROOT", file.parent)
    found = sampled([file.name], 100, 1)
    lines = SOURCE.splitlines()
    places = {lines[mutant.line - 1][mutant.column :].split(maxsplit=1)[0].strip("):") for mutant in found}
    assert places == {"4", "isinstance(a,", "+", "-", "1"}
    assert {mutant.session for mutant in found if mutant.line == 11} == {"module"}
    assert {mutant.session for mutant in found if mutant.line > 11} == {"compiled"}
    assert [m.name for m in sampled([file.name], 2, 1)] == [m.name for m in found[:2]]


def test_kernels_are_run_as_python(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cosmic_ray")
    kernels = "kernel = njit(cache=True)\n@kernel\ndef f(x): return x + 1\n@njit(nogil=True)\ndef g(x): return x + 1\n"
    file.write_text(kernels + "@cache\ndef h(x):\n    return x + 1\n", encoding="utf-8")
    monkeypatch.setattr(mutants, "ROOT", file.parent)
    found = {mutant.line: mutant.session for mutant in sampled([file.name], 100, 1)}
    assert found == {1: "module", 3: "interpreted", 5: "interpreted", 8: "compiled"}


def test_changed_code_is_run_wherever_the_function_is_known(file: Path) -> None:
    spec = importlib.util.spec_from_file_location("changing", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    first, third = module.first, module.Third()
    assert first("a", "b") == "ab"
    assert third.second(3.0) == -1.0
    change_code(file, SOURCE.replace("return a + b", "return b + a").replace("x - a", "x + a"))
    assert first("a", "b") == "ba"
    assert third.second(3.0) == 5.0
    with pytest.raises(RuntimeError, match="no function is changed"):
        change_code(file, SOURCE)


def test_the_quickest_tests_of_a_line_are_tried_first(tmp_path: Path) -> None:
    mutant = Mutant("a.py", "core/AddNot", 0, 3, 1, (3, 4), "compiled", "digest")
    tests = {
        "t.py::slow": Record(9.0, True, {"a.py": [4]}),
        "t.py::quick": Record(1.0, True, {"a.py": [3]}),
        "t.py::elsewhere": Record(0.5, True, {"a.py": [5]}),
        "t.py::failing": Record(0.1, False, {"a.py": [3]}),
        "u.py::other": Record(0.1, True, {"b.py": [3]}),
    }
    noted = Notes(tmp_path / "results.jsonl", Result)
    assert wanted(mutant, tests, noted, 60) == ["t.py::quick", "t.py::slow", "t.py::elsewhere"]
    assert wanted(mutant, tests, noted, 5) == ["t.py::quick"]
    tests["t.py::quick[1]"] = Record(2.0, True, {"a.py": [3]})
    assert wanted(mutant, tests, noted, 60) == ["t.py::quick", "t.py::slow", "t.py::quick[1]", "t.py::elsewhere"]
    assert wanted(mutant, {"u.py::other": tests["u.py::other"]}, noted, 60) == []
    noted.add(mutant.name, Result("survived", "", 1.0, ["t.py::quick"]))
    noted = Notes(tmp_path / "results.jsonl", Result)
    assert wanted(mutant, tests, noted, 5) == ["t.py::slow"]
    assert wanted(mutant, tests, noted, 60) == ["t.py::slow", "t.py::quick[1]", "t.py::elsewhere"]
    noted.add(mutant.name, Result("killed", "t.py::quick", 1.0, ["t.py::quick"]))
    assert wanted(mutant, tests, noted, 60) is None


def test_without_the_libraries_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mutants, "find_spec", lambda _: None)
    monkeypatch.setattr("sys.argv", ["mutants.py"])
    with pytest.raises(SystemExit, match="pip install cosmic-ray coverage"):
        mutants.main()
