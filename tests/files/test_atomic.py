"""Files appear whole or not at all, under names that nobody can foresee, and through no link."""

import os
import shutil
from pathlib import Path

import pytest
from failing_files import failing

from photogram.errors import ReportError, WorkspaceError
from photogram.files.atomic import (
    make_folder,
    make_folder_within,
    observed,
    remove_leftovers,
    replacing,
    scratch_folder,
    unwritable,
    whole_folder,
)


def write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text)


def test_a_link_is_replaced_and_what_it_leads_to_left(tmp_path: Path) -> None:
    mine, path = tmp_path / "mine.txt", tmp_path / "results" / "dsm.tif"
    mine.write_text("mine")
    path.parent.mkdir()
    path.symlink_to(mine)
    write(path, "a result")
    assert mine.read_text() == "mine"
    assert not path.is_symlink()
    assert path.read_text() == "a result"


def test_temporary_names_cannot_be_foreseen_and_are_made_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = set()
    for _ in range(20):
        with replacing(tmp_path / "a.txt") as temporary:
            assert temporary.is_file()
            assert temporary.parent == tmp_path
            names.add(temporary.name)
    assert len(names) == 20
    # whoever did guess the name finds his link refused
    mine = tmp_path / "mine.txt"
    mine.write_text("mine")
    monkeypatch.setattr("secrets.token_hex", lambda _: "0" * 16)
    (tmp_path / f".photogram-{'0' * 16}.partial").symlink_to(mine)
    with pytest.raises(WorkspaceError, match=r"a\.txt: cannot be written \(File exists\)"):
        write(tmp_path / "a.txt", "text")
    assert mine.read_text() == "mine"


def test_long_names_can_be_written(tmp_path: Path) -> None:
    write(tmp_path / ("é" * 127), "text")
    assert (tmp_path / ("é" * 127)).read_text() == "text"


def test_files_have_the_permissions_that_the_user_gives_to_files(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write(tmp_path / "a.txt", "text")
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


def test_leftovers_are_removed_and_nothing_else(tmp_path: Path) -> None:
    mine = tmp_path / "mine.txt"
    mine.write_text("mine")
    (tmp_path / ".photogram-0123456789abcdef.partial").write_text("half")
    (tmp_path / ".photogram-0123456789abcdee.partial").symlink_to(mine)
    (tmp_path / ".photogram-0123456789abcdef.partial.parts").mkdir()
    (tmp_path / ".photogram-0123456789abcdef.partial.parts" / "cells.tif").write_text("half")
    for name in (".photogram-mine.partial", "dsm.tif.partial", ".dsm.tif.partial"):
        (tmp_path / name).write_text("mine")
    with replacing(tmp_path / "a.txt") as temporary, scratch_folder(temporary) as scratch:
        remove_leftovers(tmp_path)
        assert scratch.is_dir()
        temporary.write_text("whole")
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        ".dsm.tif.partial", ".photogram-mine.partial", "a.txt", "dsm.tif.partial", "mine.txt",
    ]  # fmt: skip
    assert mine.read_text() == "mine"
    with pytest.raises(WorkspaceError, match="cannot be cleaned up"):
        remove_leftovers(tmp_path / "missing")


def test_a_scratch_folder_is_not_made_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "x.partial.parts").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(FileExistsError), scratch_folder(tmp_path / "x.partial"):
        pass
    assert (tmp_path / "elsewhere").is_dir()


def test_a_folder_within_is_no_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "pictures").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(WorkspaceError, match="pictures: is a link in place of a folder that photogram writes to"):
        make_folder_within(tmp_path / "pictures")
    make_folder_within(tmp_path / "study")
    assert (tmp_path / "study").is_dir()


def test_a_folder_that_the_file_system_refuses_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(WorkspaceError, match=r"the folder cannot be created \(Input/output error\)"):
        make_folder(tmp_path / "a")


def test_who_may_not_write_is_known_beforehand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert unwritable(tmp_path / "new" / "deep") == ""
    (tmp_path / "file").write_text("")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    assert unwritable(tmp_path / "file" / "a") == f"{tmp_path / 'file'} is not a folder"
    assert unwritable(tmp_path / "dangling") == f"{tmp_path / 'dangling'} is not a folder"
    monkeypatch.setattr("os.access", lambda *_: False)
    assert unwritable(tmp_path / "new") == f"{tmp_path} is not writable"


def test_an_observer_sees_each_whole_file_before_it_is_there(tmp_path: Path) -> None:
    seen = []

    def note(temporary: Path, path: Path) -> None:
        seen.append((path.name, temporary.read_text(), path.exists()))

    (tmp_path / "inner").mkdir()
    with observed(tmp_path / "inner", note):
        write(tmp_path / "inner" / "a.txt", "a")
        write(tmp_path / "b.txt", "b")
    write(tmp_path / "inner" / "c.txt", "c")
    assert seen == [("a.txt", "a", False)]


def test_what_says_its_reason_itself_is_no_trouble_of_the_folder(tmp_path: Path) -> None:
    with pytest.raises(ReportError, match=r"^no browser is installed: install one$"), replacing(tmp_path / "a.pdf"):
        raise ReportError("no browser is installed: install one")
    assert list(tmp_path.iterdir()) == []


def test_a_scratch_folder_goes_although_a_file_in_it_cannot_be_removed_at_once(tmp_path: Path) -> None:
    with failing(tmp_path, 4) as changes, scratch_folder(tmp_path / "x.partial") as folder:
        (folder / "part").write_text("a", encoding="utf-8")
    assert changes.failed == ("unlink", "x.partial.parts/part")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("is_there", [False, True])
def test_a_folder_is_whole_or_as_it_was(tmp_path: Path, is_there: bool) -> None:
    root = tmp_path / "root"

    def write() -> None:
        with whole_folder(root / "out") as place:
            (place / "b").mkdir()
            (place / "b" / "c.txt").write_text("c", encoding="utf-8")
            (place / "a.txt").write_text("a", encoding="utf-8")

    refused = 0
    for number in range(1, 30):
        shutil.rmtree(root, ignore_errors=True)
        (root / "out" if is_there else root).mkdir(parents=True)
        before = sorted(root.rglob("*"))
        with failing(root, number) as changes:
            try:
                write()
            except WorkspaceError:
                refused += 1
        if changes.failed is None:
            break
        there = sorted(path.relative_to(root).as_posix() for path in root.rglob("*"))
        assert sorted(root.rglob("*")) == before or there == ["out", "out/a.txt", "out/b", "out/b/c.txt"]
    assert refused >= 6
