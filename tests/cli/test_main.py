"""The command line as a whole: how soon it answers, and how it ends when something goes wrong."""

import errno
import logging
import os
import signal
import subprocess
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from photogram.cli.commands import adjust, init
from photogram.cli.commands import check as commands_check
from photogram.cli.work import check as run_check
from photogram.errors import ProjectError
from photogram.geodesy.height_systems import HeightSystem
from photogram.pipeline.pipeline import STAGES
from photogram.pipeline.stage_names import StageName
from photogram.simulation.commands import plan
from photogram.simulation.planning.flight_plan import Gnss, Layout
from photogram.survey import Role
from photogram.terminal import exit_codes
from photogram.terminal.interruption import interruptible, raise_if_interrupted
from photogram.wording import THIN_SPACE

Run = Callable[..., Any]
COMMAND = [sys.executable, "-m", "photogram.cli.main"]

QUICK = """
import io, os, sys
from contextlib import redirect_stderr, redirect_stdout
from photogram.cli.main import main

def said(*arguments):
    sys.argv, out = ["photogram", *arguments], io.StringIO()
    try:
        with redirect_stdout(out), redirect_stderr(out):
            main()
    except SystemExit as end:
        return end.code, out.getvalue()

commands = ["adjust", "check", "compare", "demo", "init", "plan", "report", "schema", "study", "view"]
for arguments in ([], ["study", "ransac"], *([c] for c in commands)):
    code, text = said(*arguments, "--help")
    assert code == 0 and "Usage: photogram" in text, (arguments, code, text)
wrong = [["adjsut"], ["adjust", "p.yaml", "--form", "dense"], ["adjust", "p.yaml", "--from", "denes"],
         ["adjust", "p.yaml", "--workers", "0"], ["adjust", "p.yaml", "--workers", "2", "--scheduler", "tcp://a:1"],
         ["plan", "--area", "20"], ["plan", "--gnss", "rkt"], ["init", "--heights", "msl", "."],
         ["view", ".", "--points", "1"],
         ["study", "ransac", "p.yaml", "--sample-sizes", "eight"], ["compare", "a.txt"], ["demo", "--seed", "one"]]
for arguments in wrong:
    code, text = said(*arguments)
    assert code == 2 and "Usage: photogram" in text, (arguments, code, text)
os.environ.update(_PHOTOGRAM_COMPLETE="complete_bash", COMP_WORDS="photogram adjust p.yaml --from ", COMP_CWORD="4")
code, text = said()
assert "orthophoto" in text.split(), text
print(sorted({"numpy", "scipy", "numba", "gtsam", "cv2", "matplotlib", "pyproj", "rasterio"} & set(sys.modules)))
print(len(sys.modules))
"""


def test_help_typing_errors_and_completion_import_nothing_that_computes() -> None:
    done = subprocess.run([sys.executable, "-c", QUICK], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    libraries, modules = done.stdout.splitlines()
    assert libraries == "[]"
    assert int(modules) < 700  # 4 900 when every command was imported


def test_the_names_that_help_shows_are_those_of_the_library() -> None:
    names = [stage.name for stage in STAGES]
    assert list(get_args(StageName)) == names
    assert get_type_hints(adjust.adjust)["until"] == StageName | None
    _, option = get_args(get_type_hints(adjust.adjust, include_extras=True)["start"])
    assert option.help.endswith(f": {', '.join(names)}.")
    assert get_args(init.HeightSystemName) == get_args(HeightSystem)
    assert set(get_args(init.RoleName)) <= set(get_args(Role))
    assert get_args(plan.GnssName) == get_args(Gnss)
    assert get_args(plan.LayoutName) == get_args(Layout)


# ---- what a command raises -----------------------------------------------------------------------------------------


@pytest.fixture
def check_raises(monkeypatch: pytest.MonkeyPatch, photogram: Run, tmp_path: Path) -> Run:
    """Let `photogram check` do something else, and write the file of a defect into the folder of the test."""
    monkeypatch.setattr(tempfile, "mkstemp", partial(tempfile.mkstemp, dir=tmp_path))

    def run(work: Callable[[], object], *options: str) -> Any:
        monkeypatch.setattr(commands_check, "check_project_file", lambda _: None)
        monkeypatch.setattr(run_check, "run", lambda *_: work())
        return photogram(*options, "check", "project.yaml")

    return run


def raising(fault: BaseException) -> Callable[[], object]:
    def work() -> object:
        raise fault

    return work


def in_a_worker() -> object:
    with ThreadPoolExecutor(1) as executor:
        return executor.submit(raising(ZeroDivisionError("of a worker"))).result()


@pytest.mark.parametrize(
    ("work", "words"),
    [
        (raising(KeyError("no such thing")), "KeyError: 'no such thing'"),
        (raising(EOFError("end")), "EOFError: end"),
        (raising(RuntimeError("several\nlines")), "RuntimeError: several"),
        (raising(FileNotFoundError(errno.ENOENT, "No such file", "tags.json")), "FileNotFoundError"),
        (in_a_worker, "ZeroDivisionError: of a worker"),
    ],
)
def test_a_defect_is_one_sentence_and_a_file(
    work: Callable[[], object], words: str, check_raises: Run, tmp_path: Path
) -> None:
    outcome = check_raises(work)
    assert outcome.code == 70
    assert outcome.err.count("\n") == 1
    assert "defect of photogram" in outcome.err
    assert "please report it" in outcome.err
    assert words in outcome.err
    (file,) = tmp_path.glob("photogram-defect-*.txt")
    assert outcome.err.endswith(f"details in {file}\n")
    details = file.read_text(encoding="utf-8")
    for fact in ("photogram 0.", "Python 3", "platform ", "numpy ", "photogram check project.yaml", "Traceback", words):
        assert fact in details, fact
    assert file.stat().st_mode & 0o777 == 0o600


def test_a_defect_with_no_place_for_its_file_is_printed(check_raises: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(**_: str) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(tempfile, "mkstemp", full)
    outcome = check_raises(raising(KeyError("lost")))
    assert outcome.code == 70
    assert outcome.err.startswith("photogram: a defect of photogram (KeyError: 'lost'), please report it.")
    assert "Traceback" in outcome.err


def test_what_a_thread_raises_that_nobody_waits_for_is_a_defect_too(check_raises: Run) -> None:
    def work() -> None:
        thread = threading.Thread(target=raising(LookupError("behind the scenes")))
        thread.start()
        thread.join()

    outcome = check_raises(work)
    assert outcome.code == 70
    assert "LookupError: behind the scenes" in outcome.err
    assert "Traceback" not in outcome.err


def caused(fault: BaseException, cause: BaseException) -> BaseException:
    """Return what was raised from something else."""
    fault.__cause__ = cause
    return fault


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (
            OSError(errno.ENOSPC, "No space left on device", "work/x.npz"),
            "work/x.npz: No space left on device: free some",
        ),
        (OSError(errno.ENOSPC, "No space left on device"), "photogram: No space left on device: free some space"),
        (MemoryError(), "out of memory"),
        (caused(RuntimeError("cannot compile"), MemoryError()), "out of memory"),
        (ImportError("libx.so: failed to map segment from shared object"), "out of memory"),
        (RuntimeError("can't start new thread"), "no thread can be started: close other programs"),
        (ProjectError("project.yaml:3: crs is missing"), "photogram: project.yaml:3: crs is missing\n"),
        (ProjectError("photograph \x1b[2Ja.JPG: damaged"), r"photograph \x1b[2Ja.JPG: damaged"),
    ],
)
def test_what_the_user_can_mend_ends_with_1(fault: BaseException, words: str, check_raises: Run) -> None:
    outcome = check_raises(raising(fault))
    assert outcome.code == 1
    assert words in outcome.err
    assert "Traceback" not in outcome.err
    assert "defect" not in outcome.err


def test_v_twice_is_vv_and_shows_the_traceback(check_raises: Run) -> None:
    def traceback(*options: str) -> bool:
        outcome = check_raises(raising(ProjectError("wrong")), *options)
        assert outcome.code == 1
        assert outcome.err.endswith("photogram: wrong\n")
        return "Traceback" in outcome.err

    assert [traceback(), traceback("-v"), traceback("-vv"), traceback("-v", "-v")] == [False, False, True, True]


def test_warnings_of_libraries_stay_off_the_terminal_unless_asked_for(check_raises: Run) -> None:
    def wondering(what: str) -> Callable[[], object]:
        return lambda: warnings.warn(f"a library wonders {what}", stacklevel=1)

    assert check_raises(wondering("in vain")).err == ""
    assert "a library wonders aloud" in check_raises(wondering("aloud"), "-v").err
    assert check_raises(wondering("again")).err == ""


def test_v_shows_the_log_with_control_characters_as_escapes(check_raises: Run) -> None:
    def work() -> None:
        logging.getLogger("photogram.some.module").debug("of %s: round %d", "a\x1b[2J.JPG", 2)
        logging.getLogger("library").debug("nobody asked")

    assert check_raises(work).err == ""
    assert check_raises(work, "-v").err == "photogram.some.module: of a\\x1b[2J.JPG: round 2\n"


# ---- interruption and standard output ------------------------------------------------------------------------------


def test_an_interruption_says_what_is_kept(survey: Path) -> None:
    command = [*COMMAND, "adjust", str(survey / "project.yaml")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("About ")
        assert "Photographs" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert err == "photogram: interrupted; finished work is kept, the same command resumes it\n"


@pytest.mark.parametrize("arguments", [("--help",), ("--version",), ("plan", "--help")])
def test_standard_output_to_a_full_device_is_one_sentence(arguments: tuple[str, ...]) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    with open("/dev/full", "w") as full:
        done = subprocess.run([*COMMAND, *arguments], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "standard output cannot be written (No space left on device)" in done.stderr


@pytest.mark.parametrize("arguments", [("--help",), ("--version",)])
def test_a_closed_pipe_ends_quietly(arguments: tuple[str, ...]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run([*COMMAND, *arguments], stdout=writer, stderr=subprocess.PIPE, text=True, timeout=60)
    finally:
        os.close(writer)
    assert done.returncode == 1
    assert done.stderr == ""


def test_a_command_s_own_output_to_a_full_device(check_raises: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    with open("/dev/full", "w") as full, monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", full)
        outcome = check_raises(lambda: print("figures", flush=True))  # noqa: T201
    assert outcome.code == 1
    assert "standard output cannot be written" in outcome.err


@pytest.mark.parametrize("characters", ["ascii", "cp1252", "cp437"])
def test_a_terminal_that_has_few_characters(characters: str) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": characters, "PYTHONUTF8": "0"}
    done = subprocess.run([*COMMAND, "plan", "--help"], capture_output=True, timeout=60, env=environment)
    assert done.returncode == 0
    assert done.stderr == b""
    assert "Usage: photogram plan" in done.stdout.decode(characters)


SHOWN = """
import sys
from photogram.cli.streams import prepare_streams
from rich.table import Table
prepare_streams()
from photogram.terminal.console import bars, console, errors
from photogram.wording import THIN_SPACE
table = Table(title="σ0 ± 1 px – 12 mm × 3…")
table.add_row("Straße", f"1{THIN_SPACE}000 m²", "≤ ✓ ← →")
for terminal in (console, errors):
    terminal.print(table)
    with bars(terminal) as shown:
        shown.add_task("adjusting", total=None, text="σ")
        shown.refresh()
"""


@pytest.mark.parametrize("characters", ["ascii", "cp1252", "cp437", "utf-8"])
def test_tables_and_bars_are_shown_in_whatever_characters_there_are(characters: str) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": characters, "PYTHONUTF8": "0", "TERM": "xterm", "FORCE_COLOR": "1"}
    done = subprocess.run([sys.executable, "-c", SHOWN], capture_output=True, timeout=60, env=environment)
    assert done.returncode == 0, done.stderr
    for shown in (done.stdout, done.stderr):
        text = shown.decode(characters)
        assert ("σ0 ±" if characters in ("utf-8", "cp437") else "sigma0 ") in text, text
        assert f"1{THIN_SPACE if characters == 'utf-8' else ' '}000 m" in text
        assert "adjusting" in text


def test_completion_is_shown_for_a_shell() -> None:
    environment = {**os.environ, "_PHOTOGRAM_COMPLETE": "source_bash"}
    done = subprocess.run(COMMAND, capture_output=True, text=True, timeout=60, env=environment)
    assert "complete" in done.stdout
    assert "_PHOTOGRAM_COMPLETE=complete_bash" in done.stdout


def test_an_interruption_that_a_library_swallows_is_raised_again() -> None:
    with interruptible():
        raise_if_interrupted()
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            raise_if_interrupted()
    with interruptible():
        raise_if_interrupted()


def test_a_defect_for_whose_details_there_is_no_memory_is_no_defect(
    check_raises: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: str) -> str:
        raise MemoryError

    monkeypatch.setattr(exit_codes, "version", refuse)
    outcome = check_raises(raising(SystemError("error return without exception set")))
    assert outcome.code == 1
    assert "photogram: out of memory: close other programs" in outcome.err
