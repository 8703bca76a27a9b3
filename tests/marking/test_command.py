"""The command photogram mark: what it prints, and how it ends."""

import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

from photogram.marking.command import mark

COMMAND = (sys.executable, "-u", "-c", "from photogram.cli.main import main; main()", "mark")


def test_the_page_is_served_until_it_is_interrupted(survey: Path) -> None:
    assert mark.__doc__
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "COLUMNS": "200"}
    command = [*COMMAND, str(survey / "project.yaml"), "--no-browser"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as served:
        assert served.stdout is not None
        assert served.stderr is not None
        said = served.stdout.readline()
        address = re.search(r"http://127\.0\.0\.1:\d+/\S+/", said)
        assert address, said
        with urllib.request.urlopen(f"{address[0]}state", timeout=60) as answer:
            state = json.load(answer)
        served.send_signal(signal.SIGINT)
        # not communicate, which loses the lines that came with the first
        out, err = served.stdout.read(), served.stderr.read()
        served.wait(timeout=60)
    assert served.returncode == 0
    assert err == ""
    marks = sum(point["marks"] for point in state["points"])
    assert marks > 0, "those of the project"
    assert f"Ended: {marks} marks in {survey / 'marks.csv'}" in out
    assert "control_points.list" in out


def test_a_project_without_ground_points_and_a_port_in_use_are_errors(
    photogram: Callable[..., Any], survey: Path, edit: Callable[..., None]
) -> None:
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        outcome = photogram("mark", survey / "project.yaml", "--no-browser", "--port", taken.getsockname()[1])
    assert (outcome.code, outcome.err.count("\n")) == (1, 1)
    assert "give another with --port" in outcome.err
    edit(survey / "project.yaml", lambda values: values.pop("control_points"))
    outcome = photogram("mark", survey / "project.yaml", "--no-browser")
    assert (outcome.code, outcome.err.count("\n")) == (1, 1)
    assert "no ground points" in outcome.err
