"""Links, locks and drives: the same on systems that have other calls for them, or none."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from photogram.files.portable import path_from, through_no_link, try_lock

HOLDER = """
import sys
from photogram.files.portable import try_lock
with open(sys.argv[1], "ab") as lock:
    print(try_lock(lock.fileno()), flush=True)
    sys.stdin.read()
"""


class Windows(ModuleType):
    """The locks of Windows, of one process: bytes of a file that one descriptor has at most."""

    LK_NBLCK = 2

    def __init__(self) -> None:
        super().__init__("msvcrt")
        self.held: dict[tuple[int, int], int] = {}

    def locking(self, descriptor: int, _mode: int, count: int) -> None:
        place = (os.fstat(descriptor).st_ino, os.lseek(descriptor, 0, os.SEEK_CUR))
        assert count == 1
        assert place[1] > os.fstat(descriptor).st_size, "others may read the file"
        if self.held.setdefault(place, descriptor) != descriptor:
            raise PermissionError(errno.EACCES, "Permission denied")


@pytest.fixture(params=["fcntl", "msvcrt"])
def system(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The calls of POSIX, and those of Windows."""
    if request.param == "msvcrt":
        monkeypatch.setitem(sys.modules, "fcntl", None)
        monkeypatch.setitem(sys.modules, "msvcrt", Windows())
    else:
        pytest.importorskip("fcntl", reason="this system has other locks")
    return str(request.param)


@pytest.mark.usefixtures("system")
def test_a_file_is_locked_once_and_stays_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    path.write_text("mine")
    with path.open("ab") as first, path.open("ab") as second:
        assert try_lock(first.fileno())
        assert not try_lock(second.fileno())
        assert first.tell() in (0, 4)
        assert path.read_text() == "mine"
    assert path.read_text() == "mine"


def test_those_who_only_look_disturb_nobody(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="Windows shares no locks")
    with (tmp_path / "lock").open("ab") as one, (tmp_path / "lock").open() as other:
        assert try_lock(one.fileno(), shared=True)
        assert try_lock(other.fileno(), shared=True)
        assert not try_lock(one.fileno())


def test_a_lock_goes_with_its_process(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "True\n"
        with path.open("ab") as mine:
            assert not try_lock(mine.fileno())
            holder.kill()
            holder.wait()
            assert try_lock(mine.fileno())


def test_a_file_system_without_locks_is_no_lock_that_another_holds(
    tmp_path: Path, system: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    module = sys.modules[system]
    monkeypatch.setattr(module, "flock" if system == "fcntl" else "locking", none)
    with (tmp_path / "lock").open("ab") as lock, pytest.raises(OSError, match="No locks available"):
        try_lock(lock.fileno())


@pytest.mark.parametrize("has_flag", [True, False])
def test_nothing_is_written_through_a_link(tmp_path: Path, has_flag: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not has_flag:
        monkeypatch.delattr(os, "O_NOFOLLOW", raising=False)
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "mine")
    with pytest.raises(OSError, match="symbolic links") as refused:
        open(tmp_path / "link", "ab", opener=through_no_link).close()
    assert refused.value.errno == errno.ELOOP
    with open(tmp_path / "plain", "ab", opener=through_no_link) as stream:
        stream.write(b"written")
    assert ((tmp_path / "plain").read_text(), (tmp_path / "mine").read_text()) == ("written", "mine")


def test_a_path_is_said_from_a_folder_and_whole_on_another_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert path_from(tmp_path / "survey", tmp_path / "survey/work/a.tif") == Path("work/a.tif")
    assert path_from(tmp_path / "survey", tmp_path / "a.tif").as_posix() == "../a.tif"

    def other_drive(*_: object) -> str:
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr(os.path, "relpath", other_drive)
    assert path_from(tmp_path / "survey", tmp_path / "a.tif") == tmp_path / "a.tif"
