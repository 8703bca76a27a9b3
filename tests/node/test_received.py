"""Files of a task as they arrive: names, kinds, contents, archives."""

import io
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from photogram.node.received import FileKind, Room, checked_name, is_check, keep, kind_of
from photogram.node.refusals import RequestError

WIDE = Room(10**9)


def written(folder: Path, name: str, content: bytes) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(content)
    return folder / name


def archive(entries: Sequence[tuple[str, bytes]]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in entries:
            packed.writestr(name, content)
    return stream.getvalue()


@pytest.fixture(scope="module")
def picture() -> bytes:
    stream = io.BytesIO()
    values = np.random.default_rng(1).integers(0, 255, (60, 80, 3)).astype(np.uint8)
    Image.fromarray(values).save(stream, "JPEG")
    return stream.getvalue()


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "../IMG.JPG", "a/b.jpg", "a\\b.jpg", "C:x.jpg", ".hidden.jpg", "a\n.jpg", "a\0.jpg", "ä" * 120],
)
def test_names_that_lead_elsewhere_are_refused(name: str) -> None:
    with pytest.raises(RequestError):
        checked_name(name)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("DJI_0001.JPG", FileKind.PHOTOGRAPH),
        ("Überflug 1.tiff", FileKind.PHOTOGRAPH),
        ("DJI_1.dng", FileKind.PHOTOGRAPH),
        ("DJI_0001_mask.png", FileKind.MASK),
        ("gcp_list.txt", FileKind.GROUND_POINTS),
        ("Points.TXT", FileKind.GROUND_POINTS),
        ("check_points.csv", FileKind.GROUND_POINTS),
        ("geo.txt", FileKind.BESIDE),
        ("image_groups.txt", FileKind.BESIDE),
        ("x_Timestamp.MRK", FileKind.POSITIONS),
        ("photos.zip", FileKind.ARCHIVE),
    ],
)
def test_what_a_file_is_by_its_name(name: str, kind: FileKind) -> None:
    assert kind_of(name) is kind


@pytest.mark.parametrize("name", ["seed.zip", "align.laz", "readings.csv", "run.sh", "task.json", "a.webp", "noend"])
def test_what_a_task_has_no_use_for_is_refused(name: str) -> None:
    with pytest.raises(RequestError, match="leave this file out"):
        kind_of(name)


def test_check_points_are_known_by_their_name() -> None:
    assert is_check("Check_list.txt")
    assert not is_check("gcp_check.txt")


def test_each_file_has_its_place(tmp_path: Path, picture: bytes) -> None:
    task, come = tmp_path / "task", tmp_path / "come"
    assert keep(written(come, "a.jpg", picture), task, WIDE) == 1
    assert keep(written(come, "a_mask.jpg", picture), task, WIDE) == 0
    assert keep(written(come, "gcp_list.txt", b"EPSG:25832\n"), task, WIDE) == 0
    assert keep(written(come, "geo.txt", b"EPSG:4326\n"), task, WIDE) == 0
    places = {path.relative_to(task).as_posix() for path in task.rglob("*") if path.is_file()}
    assert places == {"images/a.jpg", "images/masks/a_mask.jpg", "tables/gcp_list.txt", "geo.txt"}


def test_the_same_file_twice_is_one_and_another_of_its_name_is_refused(tmp_path: Path, picture: bytes) -> None:
    task = tmp_path / "task"
    assert keep(written(tmp_path / "1", "a.jpg", picture), task, WIDE) == 1
    assert keep(written(tmp_path / "2", "a.jpg", picture), task, WIDE) == 0
    other = picture[:-2] + b"\0" + picture[-2:]
    with pytest.raises(RequestError, match=r"a\.jpg: another file of this name was sent before: rename one of them"):
        keep(written(tmp_path / "3", "a.jpg", other), task, WIDE)
    assert (task / "images/a.jpg").read_bytes() == picture


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.jpg", b"", "is empty"),
        ("a.jpg", b"GIF89a and no photograph", "a.jpg"),
        ("a.tif", b"II*\0 and nothing more", "a.tif"),
        ("a_mask.png", b"\x89PNG and no picture", "cannot be read as a picture"),
        ("gcp_list.txt", b"\x7fELF\0\0\0", "a text is expected"),
        ("a.zip", b"PK and nothing", "cannot be unpacked"),
    ],
)
def test_what_is_not_what_its_name_says_is_refused(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    with pytest.raises(RequestError) as caught:
        keep(written(tmp_path / "come", name, content), tmp_path / "task", WIDE)
    assert said in str(caught.value)
    assert str(tmp_path) not in str(caught.value)
    assert not list((tmp_path / "task").rglob("*.*"))


def test_a_photograph_that_is_cut_off_is_refused(tmp_path: Path, picture: bytes) -> None:
    with pytest.raises(RequestError, match=r"a\.jpg"):
        keep(written(tmp_path / "come", "a.jpg", picture[: len(picture) // 2]), tmp_path / "task", WIDE)


def test_an_archive_is_unpacked_whatever_its_folders(tmp_path: Path, picture: bytes) -> None:
    content = archive(
        [
            ("flight/a.jpg", picture),
            ("flight/b.jpg", picture),
            ("__MACOSX/flight/._a.jpg", b"x"),
            ("gcp_list.txt", b"EPSG:1\n"),
        ]
    )
    assert keep(written(tmp_path / "come", "all.zip", content), tmp_path / "task", WIDE) == 2
    places = {
        path.relative_to(tmp_path / "task").as_posix() for path in (tmp_path / "task").rglob("*") if path.is_file()
    }
    assert places == {"images/a.jpg", "images/b.jpg", "tables/gcp_list.txt"}
    assert not list((tmp_path / "come" / "unpacked").iterdir())


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ([("../../a.jpg", b"x")], "leads out of the archive"),
        ([("/etc/a.jpg", b"x")], "leads out of the archive"),
        ([("..\\a.jpg", b"x")], "leads out of the archive"),
        ([("a.jpg", b"\0" * 50_000_000)], "packed too tightly"),
        ([("a.zip", b"x")], "an archive within an archive"),
        ([("run.sh", b"x")], "leave this file out"),
        ([(f"{n}.jpg", b"") for n in range(20_001)], "20001 files"),
    ],
)
def test_archives_that_do_harm_are_refused(tmp_path: Path, entries: Sequence[tuple[str, bytes]], said: str) -> None:
    with pytest.raises(RequestError) as caught:
        keep(written(tmp_path / "come", "all.zip", archive(entries)), tmp_path / "task", WIDE)
    assert said in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["come"]


def test_an_archive_that_lies_about_its_sizes_or_is_damaged_is_refused(tmp_path: Path, picture: bytes) -> None:
    whole = bytearray(archive([("a.jpg", picture)]))
    for number in range(0, len(whole), max(len(whole) // 60, 1)):
        spoiled = bytearray(whole)
        spoiled[number] ^= 0x55
        file = written(tmp_path / str(number), "all.zip", bytes(spoiled))
        task = tmp_path / f"task {number}"
        try:
            keep(file, task, WIDE)
        except RequestError:
            continue
        for path in (task / "images").iterdir():  # harmless: a date, a name
            assert path.read_bytes() == picture


def test_an_archive_may_not_be_larger_than_there_is_room(tmp_path: Path) -> None:
    content = archive([("a.jpg", np.random.default_rng(2).bytes(100_000))])
    with pytest.raises(RequestError, match="there is no room for 100000 bytes more: this node has 50000 left"):
        keep(written(tmp_path / "come", "all.zip", content), tmp_path / "task", Room(50_000))
