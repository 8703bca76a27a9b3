"""`make figures` with benchmarks made for it: what is run, kept, and written to pages and JSON."""

import json
import subprocess
from pathlib import Path

import figures
import pytest

FAKE = """import sys
from pathlib import Path
with Path("calls").open("a") as file:
    file.write("x")
print("2 surveys")
print("| errors | z    |\\n|--------|------|\\n| plan   | " + sys.argv[1] + " |")
"""
PAGE = """# A page

<!-- figures: make demo, python benchmarks/fake.py 1.02, benchmarks/broken.py -->

| made by hand | 1.0 |

<!-- end of figures -->

<!-- printed: benchmarks/fake.py 1.02 -->

old

<!-- end of printed -->

<!-- printed: benchmarks/broken.py -->

stays

<!-- end of printed -->
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A repository with a benchmark that prints a table, one that fails, and tests that count their seeds."""
    for name in ("docs", "benchmarks", "tests"):
        (tmp_path / name).mkdir()
    (tmp_path / "benchmarks" / "fake.py").write_text(FAKE)
    (tmp_path / "benchmarks" / "broken.py").write_text("raise SystemExit(3)\n")
    (tmp_path / "tests" / "suite.py").write_text("import os\nprint(os.environ['PHOTOGRAM_SEEDS'])\n")
    (tmp_path / "docs" / "page.md").write_text(PAGE)
    return tmp_path


def test_printed_tables_are_written_and_those_by_hand_stay(root: Path) -> None:
    failures = figures.write_figures(root)
    assert failures == ["benchmarks/broken.py ended with 3"]
    new = "2 surveys\n\n| errors | z |\n| --- | --- |\n| plan | 1.02 |\n"
    assert (root / "docs" / "page.md").read_text() == PAGE.replace("old\n", new)
    written = json.loads((root / "docs" / "figures.json").read_text())
    assert sorted(written) == ["benchmarks/fake.py 1.02", "tests/suite.py"]
    assert written["benchmarks/fake.py 1.02"]["tables"] == [{"columns": ["errors", "z"], "rows": [["plan", "1.02"]]}]
    assert written["tests/suite.py"]["lines"] == ["all"]


def test_what_is_finished_is_kept_until_a_source_changes(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for _ in range(2):
        figures.write_figures(root, "fake")
    assert (root / "calls").read_text() == "x"
    assert "1 command took 0 minutes" in capsys.readouterr().out
    (root / "benchmarks" / "fake.py").write_text(FAKE.replace("2 surveys", "3 surveys"))
    figures.write_figures(root, "fake")
    assert (root / "calls").read_text() == "xx"
    assert "compare the tables of: page.md" in capsys.readouterr().out
    assert "3 surveys\n\n| errors" in (root / "docs" / "page.md").read_text()


def test_a_listing_runs_nothing(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert figures.write_figures(root, show=True) == []
    assert not (root / "docs" / "figures.json").exists()
    assert "3 of 3: tests/suite.py" in capsys.readouterr().out


def test_every_command_in_the_documentation_is_there() -> None:
    commands = figures.commands_of(sorted((figures.ROOT / "docs").glob("*.md")))
    assert len(commands) > 30
    for command in commands:
        assert (figures.ROOT / command.split()[0]).is_file(), command


def test_a_commit_is_compared_cell_by_cell(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def git(*words: str) -> None:
        who = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
        subprocess.run(["git", *who, *words], cwd=root, check=True, capture_output=True)

    (root / "docs" / "page.md").write_text("<!-- figures: benchmarks/fake.py 1.02, benchmarks/late.py -->\n")
    git("init", "-q")
    git("add", ".")
    git("commit", "-q", "-m", "a")
    (root / "benchmarks" / "fake.py").write_text(FAKE.replace("sys.argv[1]", "'1.30'"))
    (root / "benchmarks" / "late.py").write_text("print('x')\n")
    assert figures.compare_figures(root, "HEAD") == []
    said = capsys.readouterr().out
    assert "table 1, plan, z: 1.02 → 1.30 (+27 %)" in said
    assert "2 of 3: benchmarks/late.py\n  not there at HEAD" in said
    assert not (root / "docs" / "figures.json").exists()
    listed = subprocess.run(["git", "worktree", "list"], cwd=root, capture_output=True, text=True, check=True).stdout
    assert len(listed.splitlines()) == 1
