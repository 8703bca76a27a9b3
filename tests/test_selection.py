"""Which tests a change reaches, in a house of a few modules and in this one."""

import subprocess
from pathlib import Path

import pytest
import selection
from selection import Suite, changed_files, import_graph, own_suite

CONFTEST = """
from photogram.cli.main import main
from photogram.core.stage import run
from photogram.wing.making import make

@pytest.fixture(scope="session")
def made():
    return make()

@pytest.fixture
def finished(made):
    return run(made)

@pytest.fixture
def photogram():
    main()

@pytest.fixture(autouse=True)
def checked():
    run()
"""
TEXTS = {
    "tests/conftest.py": CONFTEST,
    "tests/makers.py": "from photogram.core.low import thing\nfrom photogram.wing import making\n",
    "tests/test_house.py": 'ROOT.rglob("*.py")',
    "tests/core/test_low.py": "from photogram.core import (\n    high,\n    low,\n)\n",
    "tests/core/test_high.py": 'CODE = "import photogram.core.high"',
    "tests/core/test_made.py": "from makers import thing\n",
    "tests/surveys/test_finished.py": "def test_it(finished): ...",
    "tests/surveys/test_marked.py": '@pytest.mark.usefixtures("finished")\ndef test_it(): ...',
    "tests/wing/test_making.py": "from photogram.wing.making import make\n",
    "tests/cli/test_wing.py": 'def test_it(photogram):\n    photogram("fly")\n',
    "tests/cli/test_adjust.py": 'def test_it(photogram):\n    photogram("adjust")\n',
    "tests/cli/test_any.py": "def test_it(photogram):\n    photogram(command)\n",
    "tests/docs/test_pages.py": 'PAGE = "docs/page.md"',
    "tests/door/test_door.py": "from photogram import thing\n",
    "benchmarks/lib/truth.py": "from photogram.core.low import thing\n",
    "tests/benchmarks/test_truth.py": "from lib.truth import x\n",
}
IMPORTED = {
    "photogram": {"photogram.core.high", "photogram.wing.making"},
    "photogram.core": set[str](),
    "photogram.core.low": set(),
    "photogram.core.high": {"photogram.core.low"},
    "photogram.core.stage": {"photogram.core.high"},
    "photogram.wing": set(),
    "photogram.wing.making": {"photogram.core.low"},
    "photogram.wing.command": {"photogram.wing.making"},
    "photogram.cli": set(),
    "photogram.cli.main": set(),
    "photogram.cli.commands.adjust": {"photogram.core.stage"},
}
COMMANDS = {"fly": "photogram.wing.command:fly", "adjust": "photogram.cli.commands.adjust:adjust"}
SUITE = Suite(TEXTS, {module: frozenset(imported) for module, imported in IMPORTED.items()}, COMMANDS)
OF_STAGE = ["cli/test_adjust", "cli/test_any", "surveys/test_finished", "surveys/test_marked", "test_house"]


@pytest.mark.parametrize(
    ("changed", "reached"),
    [
        ("photogram/core/stage.py", OF_STAGE),
        ("photogram/core/high.py", [*OF_STAGE, "core/test_high", "core/test_low", "door/test_door"]),
        ("photogram/wing/making.py",
         ["cli/test_any", "cli/test_wing", "door/test_door", "test_house", "wing/test_making"]),
        ("photogram/wing/command.py", ["cli/test_any", "cli/test_wing", "test_house"]),
        ("cli/main.py", ["cli/test_adjust", "cli/test_any", "cli/test_wing", "test_house"]),
        ("photogram/wing/templates/page.html", ["test_house", "wing/test_making"]),
        ("docs/page.md", ["docs/test_pages", "test_house"]),
        ("tests/core/test_low.py", ["core/test_low", "test_house"]),
        ("tests/core/test_gone.py", None),
        ("tests/makers.py", ["core/test_made", "test_house"]),
        ("benchmarks/lib/truth.py", ["benchmarks/test_truth", "test_house"]),
        ("photogram/__init__.py", None),
        ("tests/conftest.py", None),
        ("Makefile", None),
        ("pyproject.toml", None),
    ],
)  # fmt: skip
def test_a_change_reaches_what_stands_on_it(changed: str, reached: list[str] | None) -> None:
    expected = None if reached is None else sorted(f"tests/{name}.py" for name in reached)
    assert SUITE.reached_by([changed]) == expected


def test_several_changes_reach_what_each_of_them_reaches() -> None:
    both = SUITE.reached_by(["docs/page.md", "photogram/wing/command.py"])
    assert both == [f"tests/{name}.py" for name in ("cli/test_any", "cli/test_wing", "docs/test_pages", "test_house")]
    assert SUITE.reached_by(["docs/page.md", "Makefile"]) is None
    low = SUITE.reached_by(["photogram/core/low.py"])
    assert low is not None
    assert set(SUITE.tests) - set(low) == {"tests/docs/test_pages.py"}


def test_files_that_differ_from_where_a_branch_began(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def git(*arguments: str) -> None:
        named = ["git", "-c", "user.name=n", "-c", "user.email=e@x", *arguments]
        subprocess.run(named, cwd=tmp_path, check=True, capture_output=True)

    def commit(name: str) -> None:
        (tmp_path / name).write_text(name, encoding="utf-8")
        git("add", "-A")
        git("commit", "-qm", name)

    monkeypatch.setattr(selection, "ROOT", tmp_path)
    git("init", "-qb", "main")
    commit("first")
    git("branch", "branch")
    commit("of main")
    git("checkout", "-q", "branch")
    commit("of the branch")
    git("mv", "first", "moved")
    (tmp_path / "µ").touch()
    assert sorted(changed_files("main")) == ["first", "moved", "of the branch", "µ"]
    with pytest.raises(subprocess.CalledProcessError):
        changed_files("nowhere")


def test_of_this_house_a_wing_reaches_its_own_tests_and_the_core_whole_surveys() -> None:
    suite, imported = own_suite(), import_graph()
    fitting = suite.reached_by(["photogram/marking/targets/fitting.py"])
    assert fitting is not None
    assert {"tests/marking/test_fitting.py", "tests/marking/test_command.py", "tests/test_house.py"} <= set(fitting)
    assert len(fitting) < 0.1 * len(suite.tests)
    adjusting = suite.reached_by(["photogram/adjustment/adjustment.py"])
    assert adjusting is not None
    assert {"tests/surveys/test_resume.py", "tests/adjustment/test_adjustment.py"} <= set(adjusting)
    rendering = suite.reached_by(["photogram/simulation/rendering.py"])
    assert rendering is not None
    assert {"tests/simulation/test_rendering.py", "tests/cli/test_main.py"} <= set(rendering)
    assert "tests/sfm/test_orientation.py" not in rendering
    assert suite.reached_by(["pyproject.toml"]) is None
    assert "photogram.errors" in imported["photogram.geodesy.frames"]
