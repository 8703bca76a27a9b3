"""Compiled code where numba's own places cannot be written. Root may write everywhere, so numba is told that there are
none; and everything is tried in a process of its own, because code is compiled when it is imported."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

START = """
import sys
from numba.core import caching
from numba import config
for name in ("InTreeCacheLocator", "UserWideCacheLocator"):
    getattr(caching, name).from_function = classmethod(lambda *_: None)
import numpy as np
from photogram.surface.ortho.resampling import catmull_rom
weight = np.zeros(4)
catmull_rom(0.5, weight)
assert np.allclose(weight, [-0.0625, 0.5625, 0.5625, -0.0625]), weight
assert config.CACHE_DIR == "", "other users of numba keep their own place"
print(sum(catmull_rom.stats.cache_hits.values()))
"""


def start(code: str, temporary: Path, **environment: str) -> str:
    """Run Python with a temporary directory and without a home; return what it prints."""
    kept = {name: value for name, value in os.environ.items() if name not in ("HOME", "NUMBA_CACHE_DIR")}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True, text=True, timeout=120, env={**kept, "TMPDIR": str(temporary), **environment},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_code_is_kept_in_a_folder_of_the_user_s_own(tmp_path: Path) -> None:
    assert start(START, tmp_path) == "0"
    folder = tmp_path / f"photogram-{os.getuid()}"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert list(folder.glob("ortho_*/resampling.catmull_rom*.nbc"))
    assert start(START, tmp_path) == "1"  # and found there


@pytest.mark.parametrize("kind", ["open to others", "a link", "a file"])
def test_a_folder_that_is_not_safe_is_not_used(kind: str, tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / f"photogram-{os.getuid()}", tmp_path / "elsewhere"
    elsewhere.mkdir()
    if kind == "a link":
        folder.symlink_to(elsewhere)
    elif kind == "a file":
        folder.touch()
    else:
        folder.mkdir()
        folder.chmod(0o777)
    assert start(START, tmp_path) == "0"
    assert list(tmp_path.rglob("*.nb?")) == []


def test_without_any_temporary_directory_it_starts_too(tmp_path: Path) -> None:
    nowhere = "import tempfile\ndef fail(): raise FileNotFoundError(2, 'No usable temporary directory')\n"
    assert start(f"{nowhere}tempfile.gettempdir = fail\n{START}", tmp_path) == "0"
    assert list(tmp_path.iterdir()) == []


def test_a_user_without_a_home_gets_no_folder_called_tilde(tmp_path: Path) -> None:
    code = f"import os, pwd\npwd.getpwuid = {{}}.__getitem__\nos.chdir({str(tmp_path)!r})\n{START}"
    start(code.replace('("InTreeCacheLocator", "UserWideCacheLocator")', '("InTreeCacheLocator",)'), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [f"photogram-{os.getuid()}"]


COUNTED = """
import numpy as np
from photogram.compilation import compile_time, kernels
from photogram.surface.ortho.resampling import catmull_rom
rooms = ("photogram.surface.ortho.resampling",)
before, there = kernels(rooms)
with compile_time() as spent:
    catmull_rom(0.5, np.zeros(4))
after, _ = kernels(rooms)
print(before, after, there, spent.seconds > 0.001, kernels(("photogram.nowhere",)))
"""


def test_what_is_compiled_is_known_before_it_is_used(tmp_path: Path) -> None:
    first = start(COUNTED, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "kept")).split()
    assert int(first[0]) == 0
    assert int(first[1]) >= 1
    assert int(first[2]) >= int(first[1])
    assert first[3:] == ["True", "(0,", "0)"]
    second = start(COUNTED, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "kept")).split()
    assert second[0] == second[1] == first[1]  # found there, before it is asked for
    assert second[3] == "False"
