"""What is refused before anything that computes is imported."""

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import laspy
import numpy as np
import pytest

HEAVY = ("numpy", "scipy", "numba", "gtsam", "cv2", "matplotlib", "pyproj", "rasterio", "laspy")

REFUSE = """
import json, pathlib, re, sys
heavy, arguments = map(json.loads, sys.argv[1:])
sys.argv = ["photogram", *arguments]
from photogram.cli.main import main
try:
    main()
except SystemExit as end:
    heavy = sorted(set(heavy) & set(sys.modules))
    peak_kb = int(re.search("VmHWM:\\s*(\\d+)", pathlib.Path("/proc/self/status").read_text())[1])
    print(json.dumps([end.code, heavy, peak_kb]))
"""


def refused(arguments: list[str], folder: Path) -> tuple[str, int]:
    """Run a command that has to be refused at once; return what it says and the most memory it held, kB."""
    done = subprocess.run(
        [sys.executable, "-c", REFUSE, json.dumps(HEAVY), json.dumps(arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
    )
    code, heavy, peak_kb = json.loads(done.stdout.splitlines()[-1])
    assert (code, heavy) == (1, []), (done.stdout, done.stderr)
    return done.stderr, peak_kb


@pytest.mark.parametrize("command", [["check"], ["adjust"], ["report"], ["study", "ransac"]])
@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("pipe", "it is a named pipe, not a file"),
        ("device", "it is a device, not a file"),
        ("large", "60 MB, at most 1 MB are read here"),
        ("deep", "nested deeper than 20 deep"),
        ("missing", "No such file or directory"),
    ],
)
def test_project_files_that_are_none(tmp_path: Path, command: list[str], what: str, said: str) -> None:
    path = tmp_path / "project.yaml"
    if what == "pipe":
        os.mkfifo(path)
    elif what == "large":
        with path.open("wb") as stream:
            stream.truncate(60_000_000)
    elif what == "deep":
        path.write_text("a: " + "[" * 1000 + "]" * 1000)
    words, peak_kb = refused([*command, "/dev/zero" if what == "device" else path.name], tmp_path)
    assert said in " ".join(words.split())
    assert peak_kb < 200_000


@pytest.mark.parametrize("option", ["--control", "--check", "--marks"])
def test_tables_that_are_none(tmp_path: Path, option: str) -> None:
    (tmp_path / "photographs").mkdir()
    words, peak_kb = refused(["init", "photographs", option, "/dev/zero"], tmp_path)
    assert "it is a device, not a file" in " ".join(words.split())
    assert peak_kb < 200_000


@pytest.mark.parametrize("place", ["cloud", "reference"])
def test_a_cloud_that_claims_two_thousand_million_points(tmp_path: Path, place: str) -> None:
    cloud = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    cloud.x = cloud.y = cloud.z = np.arange(3.0)
    cloud.write(tmp_path / "cloud.las")
    content = bytearray((tmp_path / "cloud.las").read_bytes())
    (tmp_path / "sound.las").write_bytes(content)
    struct.pack_into("<Q", content, 247, 2**31)
    (tmp_path / "cloud.las").write_bytes(content)
    names = ["cloud.las", "sound.las"] if place == "cloud" else ["sound.las", "cloud.las"]
    words, peak_kb = refused(["compare", names[0], "--reference", names[1]], tmp_path)
    assert "2147483648 points, but the file has room for 3" in " ".join(words.split())
    assert peak_kb < 200_000
