"""`photogram desk` in a terminal: says its address, answers there, and ends with Ctrl-C."""

import os
import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from photogram.desk import work
from photogram.desk.desk import Desk
from photogram.desk.server import DeskServer
from photogram.errors import WorkspaceError


def test_it_serves_until_it_is_interrupted(survey: Path, tmp_path: Path) -> None:
    call = [sys.executable, "-m", "photogram.cli.main", "desk", str(survey), "--no-browser"]
    environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path), "COLUMNS": "200", "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(call, stdout=subprocess.PIPE, env=environment, text=True) as process:
        assert process.stdout is not None
        address = re.search(r"http://127\.0\.0\.1:\d+/[\w-]{24}/", process.stdout.readline())
        assert address is not None
        with urllib.request.urlopen(address[0], timeout=30) as page:
            assert b"<title>photogram desk</title>" in page.read()
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read()
        assert process.wait(30) == 0
    assert f"Survey: {survey}" in rest
    assert rest.rstrip().endswith("Ended.")


def test_a_port_that_is_taken_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with Desk(tmp_path / "desk.json") as desk:
        taken = DeskServer(desk)
        with pytest.raises(WorkspaceError, match=f"port {taken.port} of 127.0.0.1 cannot be used"):
            work.run(None, False, taken.port)
        taken.close()
