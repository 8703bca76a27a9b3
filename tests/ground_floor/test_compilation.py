"""Compiled code, and where it is kept. Everything is tried in a process of its own, because code is compiled when it is
imported; root may write everywhere, so a file stands where a folder is not to be had."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from photogram import compilation

START = """
import sys
from numba import config
import numpy as np
from photogram.surface.ortho.resampling import catmull_rom
weight = np.zeros(4)
catmull_rom(0.5, weight)
assert np.allclose(weight, [-0.0625, 0.5625, 0.5625, -0.0625]), weight
assert config.CACHE_DIR == "", "other users of numba keep their own place"
print(sum(catmull_rom.stats.cache_hits.values()))
"""


def start(code: str, temporary: Path, **environment: str) -> str:
    """Run Python with a temporary directory, and without a cache folder of the user unless one is given; return what it
    prints."""
    kept = {name: value for name, value in os.environ.items() if name not in ("HOME", "NUMBA_CACHE_DIR")}
    given = {**kept, "XDG_CACHE_HOME": os.devnull, "TMPDIR": str(temporary), **environment}
    called = [sys.executable, "-c", code]
    done = subprocess.run(called, capture_output=True, text=True, timeout=120, cwd=temporary, env=given)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_code_is_kept_in_the_user_s_cache_folder(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert start(START, tmp_path, XDG_CACHE_HOME=str(cache)) == "0"
    assert [*cache.glob("photogram/kernels/photogram.surface.ortho.resampling/*/resampling.catmull_rom*.nbc")]
    assert start(START, tmp_path, XDG_CACHE_HOME=str(cache)) == "1"  # and read there
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]


def test_else_it_is_kept_in_a_temporary_folder_of_the_user_s_own(tmp_path: Path) -> None:
    assert start(START, tmp_path) == "0"
    folder = tmp_path / f"photogram-{os.getuid()}"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert list(folder.glob("photogram.surface.ortho.resampling/*/resampling.catmull_rom*.nbc"))
    assert start(START, tmp_path) == "1"


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
    start(code, tmp_path, XDG_CACHE_HOME="")
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


CONSTANT = "FACTOR = 3.0\n"
LOWER = """
from photogram import compilation
from photogram.constant import FACTOR
@compilation.njit(cache=True, inline="always")
def scaled(x):
    return FACTOR * x
"""
UPPER = """
from photogram.compilation import njit
from photogram.lower import scaled
@njit(cache=True)
def result(x):
    return scaled(x) + 1.0
"""
RESULT = """
from photogram.upper import result
print(result(2.0), sum(result.stats.cache_hits.values()))
"""


class Tree:
    """An installation of a few modules, and the folder where it keeps its code."""

    def __init__(self, root: Path) -> None:
        self.package, self.cache = root / "photogram", root.parent / "cache"
        self.package.mkdir(parents=True)
        shutil.copy(compilation.__file__, self.package)
        for name, text in (("__init__", ""), ("constant", CONSTANT), ("lower", LOWER), ("upper", UPPER)):
            self.write(name, text)

    def write(self, name: str, text: str) -> None:
        """Write a module, as if some time ago."""
        path = self.package / f"{name}.py"
        path.write_text(text, encoding="utf-8")
        before = time.time() - 1000.0
        os.utime(path, (before, before))

    def result(self, code: str = RESULT) -> str:
        """Return what the kernel returns, and how often its code was there already."""
        shutil.rmtree(self.package / "__pycache__", ignore_errors=True)  # Python asks for times and sizes
        paths = {"PYTHONPATH": str(self.package.parent), "NUMBA_CACHE_DIR": str(self.cache)}
        return start(code, self.cache.parent, **paths)

    def files(self) -> list[Path]:
        """Return the files of the upper kernel."""
        return sorted(self.cache.glob("photogram.upper/*/*"))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of code that an installation has kept."""
    made = Tree(tmp_path_factory.mktemp("compiled") / "first")
    assert made.result() == "7.0 0"
    assert made.result() == "7.0 1"
    return made.cache


@pytest.fixture
def tree(compiled: Path, tmp_path: Path) -> Tree:
    """An installation of the same sources, with a copy of that code."""
    shutil.copytree(compiled, tmp_path / "cache")
    return Tree(tmp_path / "second")


def test_installations_of_the_same_sources_share_their_code(tree: Tree) -> None:
    tree.write("unused", "X = 1\n")
    assert tree.result() == "7.0 1"


@pytest.mark.parametrize(
    ("name", "text", "result"),
    [("constant", "FACTOR = 5.0\n", "11.0 0"), ("lower", LOWER.replace("* x", "/ x"), "2.5 0")],
)
def test_code_follows_what_was_compiled_into_it_from_other_files(name: str, text: str, result: str, tree: Tree) -> None:
    before = {"constant": CONSTANT, "lower": LOWER}[name]
    tree.write(name, text)
    assert tree.result() == result
    tree.write(name, before)
    assert tree.result() == "7.0 1"  # what was there before is kept beside it


def test_code_of_a_file_that_was_changed_meanwhile_is_not_kept(tree: Tree) -> None:
    path = tree.package / "constant.py"
    meanwhile = f"import photogram.lower\nopen({str(path)!r}, 'w').write('FACTOR = 5.0')\n"
    assert tree.result(meanwhile + RESULT) == "7.0 0"  # it had imported the file before
    assert len(tree.files()) == 1
    tree.write("constant", "FACTOR = 5.0")
    assert tree.result() == "11.0 0"


def test_damaged_code_is_compiled_again(tree: Tree) -> None:
    [path] = tree.files()
    whole = path.read_bytes()
    for damaged in (b"", whole[:1000], whole[:-1] + bytes([whole[-1] ^ 1])):
        path.write_bytes(damaged)
        assert tree.result() == "7.0 0"
    assert tree.result() == "7.0 1"


def test_code_for_two_types_is_kept_side_by_side(tree: Tree) -> None:
    both = "from photogram.upper import result\nprint(result(2), result(2.0), len(result.stats.cache_hits))\n"
    assert tree.result(both) == "7.0 7.0 1"
    assert tree.result(both) == "7.0 7.0 2"
    assert len(tree.files()) == 2


def test_what_is_long_out_of_use_is_removed(tree: Tree) -> None:
    [path] = tree.files()
    used = path.parent.stat().st_mtime
    for k in range(1, 5):
        folder = path.parent.with_name(f"former{k}")
        folder.mkdir()
        os.utime(folder, (used - 50_000.0 * k,) * 2)
    tree.write("constant", "FACTOR = 5.0\n")
    assert tree.result() == "11.0 0"
    left = {folder.name for folder in path.parents[1].iterdir()}
    assert {"former1", path.parent.name} <= left
    assert left.isdisjoint({"former2", "former3", "former4"})
