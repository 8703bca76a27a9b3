"""The commands on a system without what Windows lacks, and without GTSAM: in processes that ``tests/other_system``
takes it from. It is no Windows: paths, consoles and open files are those of this system."""

import ast
import contextlib
import http.client
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from makers import Json

from photogram.report.identity import VOLATILE

ROOT = Path(__file__).resolve().parents[2]
COMMAND = [sys.executable, "-m", "photogram.cli.main"]
OF_ONE_SYSTEM = {
    *("fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "posix", "syslog", "curses", "readline"),
    *("msvcrt", "winreg", "winsound", "nt"),
}
REPORTS = {"report.json", "report.html", "checksums.sha256"}
PATIENCE_S = 120.0

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="this is such a system")


def environment() -> dict[str, str]:
    path = os.pathsep.join([str(ROOT / "tests/other_system"), *filter(None, [os.environ.get("PYTHONPATH")])])
    return {**os.environ, "PYTHONPATH": path}


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    called = [*COMMAND, *map(str, arguments)]
    return subprocess.run(called, capture_output=True, text=True, timeout=600, env=environment())


def test_the_system_lacks_it() -> None:
    """What proves nothing where the stand-in does not work."""
    code = "import os, signal, sys; assert not hasattr(os, 'getuid') and not hasattr(signal, 'SIGKILL'); import gtsam"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment())
    assert "ModuleNotFoundError: import of gtsam halted" in done.stderr


@pytest.fixture(scope="module")
def adjusted_there(pristine_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small survey, adjusted on the other system."""
    folder = tmp_path_factory.mktemp("other system") / "survey"
    folder.mkdir()
    for file in pristine_survey.rglob("*"):
        if file.is_file():
            (folder / file.relative_to(pristine_survey)).parent.mkdir(exist_ok=True)
            (folder / file.relative_to(pristine_survey)).write_bytes(file.read_bytes())
    assert run("check", folder / "project.yaml").returncode == 0
    done = run("adjust", folder / "project.yaml")
    assert done.returncode == 0, done.stderr
    return folder


def files(results: Path) -> dict[str, bytes]:
    found = {path.relative_to(results).as_posix(): path for path in sorted(results.rglob("*")) if path.is_file()}
    return {name: path.read_bytes() for name, path in found.items() if path.name not in REPORTS}


def lasting(value: Json) -> Json:
    """A report without what differs from run to run."""
    if isinstance(value, dict):
        return {key: lasting(part) for key, part in value.items() if key not in {*VOLATILE, "sha256", "bytes"}}
    return [lasting(part) for part in value] if isinstance(value, list) else value


@pytest.mark.survey
def test_an_adjustment_there_gives_the_same_bytes(adjusted_there: Path, finished_survey: Path) -> None:
    there, here = files(adjusted_there / "results"), files(finished_survey / "results")
    assert len(there) > 25
    assert there.keys() == here.keys()
    assert [name for name in there if there[name] != here[name]] == []
    numbers = [
        lasting(json.loads((folder / "results/quality/report.json").read_text(encoding="utf-8")))
        for folder in (adjusted_there, finished_survey)
    ]
    assert numbers[0] == numbers[1]


@pytest.mark.survey
def test_what_is_made_of_its_results(adjusted_there: Path, tmp_path: Path) -> None:
    results = adjusted_there / "results"
    assert run("view", results).returncode == 0
    assert (results / "deliverables/view.html").stat().st_size > 100_000
    cloud, truth = results / "deliverables/dense.laz", adjusted_there / "truth_surface.tif"
    done = run("compare", cloud, "--reference", truth, "--output", tmp_path / "compared")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "compared/comparison.json").is_file()


def test_a_project_is_begun(pristine_survey: Path, tmp_path: Path) -> None:
    project = tmp_path / "project.yaml"
    done = run("init", pristine_survey / "photographs", "--project", project, "--focal-px", 604)
    assert done.returncode == 0, done.stderr
    assert "sim_0001.JPG" not in project.read_text(encoding="utf-8").split("photographs:")[0]


@contextlib.contextmanager
def marking(project: Path, log: Path) -> Iterator[Callable[[], str]]:
    """`photogram mark` while the block runs, and what tells what it has said."""
    with log.open("w") as said:
        process = subprocess.Popen([*COMMAND, "mark", str(project), "--no-browser"], stdout=said, env=environment())
    try:
        yield lambda: log.read_text(encoding="utf-8")
    finally:
        process.terminate()
        process.wait()


def test_the_page_of_marks_answers(survey: Path, tmp_path: Path) -> None:
    with marking(survey / "project.yaml", tmp_path / "log.txt") as said:
        until = time.monotonic() + PATIENCE_S
        while not (address := re.search(r"http://127\.0\.0\.1:(\d+)(/\S+)", said())) and time.monotonic() < until:
            time.sleep(0.1)
        assert address is not None, said()
        connection = http.client.HTTPConnection("127.0.0.1", int(address[1]), timeout=30)
        connection.request("GET", address[2])
        answer = connection.getresponse()
        assert (answer.status, b"<html" in answer.read()) == (200, True)
        connection.close()


@pytest.mark.parametrize("setting", ["engine: reference", "solver: gtsam"])
def test_what_needs_gtsam_is_refused_in_a_sentence(setting: str, survey: Path) -> None:
    project = survey / "project.yaml"
    project.write_text(project.read_text(encoding="utf-8") + f"adjustment: {{{setting}}}\n", encoding="utf-8")
    done = run("check", project)
    assert done.returncode == 1
    said = " ".join(re.sub(r"[│┃]", " ", done.stdout).split())
    for words in (setting, "needs GTSAM", "same result", "conda-forge"):
        assert words in said


@pytest.mark.skipif(find_spec("gtsam") is None, reason="GTSAM is not installed")
def test_a_command_imports_gtsam_only_where_it_is_asked_for() -> None:
    code = "import photogram.adjustment.adjustment, photogram.pipeline.pipeline, sys; print('gtsam' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def imported_at_once(tree: ast.AST) -> Iterator[str]:
    """Yield what a module imports when it is imported itself, but for what it tries."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield (node.module or "").split(".")[0]
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.Try):
            yield from imported_at_once(node)


def test_no_module_needs_what_another_system_lacks() -> None:
    sources = [path for tree in ("photogram", "factors", "cli") for path in (ROOT / tree).rglob("*.py")]
    assert len(sources) > 600
    found = {
        path.relative_to(ROOT).as_posix(): needed
        for path in sources
        if (needed := OF_ONE_SYSTEM & set(imported_at_once(ast.parse(path.read_text(encoding="utf-8")))))
    }
    assert found == {}
