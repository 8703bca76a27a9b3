"""LAZ files on a disk that fails: one sentence with the reason, and no file."""

import errno
from collections.abc import Callable
from pathlib import Path

import numpy as np
from failing_files import failing

from photogram.errors import WorkspaceError
from photogram.files.clouds.copc import write_copc
from photogram.files.clouds.points import write_laz
from photogram.survey import PointCloud

CRS = "EPSG:25832"
PLACE_MAP_M = np.array([600_000.0, 5_800_000.0, 0.0])
CLOUD = PointCloud(PLACE_MAP_M + np.random.default_rng(1).uniform(0, 100, (5000, 3)))


def refusals(folder: Path, write: Callable[[Path], object], code: int) -> list[str]:
    """Write a file once for each of its changes, which fails, and return what was said."""
    with failing(folder) as changes:
        write(folder / "counted")
    said = []
    for number in range(1, len(changes.seen) + 1):
        path = folder / f"file {number}"
        with failing(folder, number, code) as one:
            try:
                write(path)
            except WorkspaceError as error:
                said.append(str(error).replace(path.name, "FILE"))
            else:
                assert one.failed is not None
                assert one.failed[0] in ("unlink", "rmdir")
        assert len(said) + len(list(folder.glob("file *"))) == number
    return said


def test_a_full_disk_is_named_at_whatever_write_it_shows(tmp_path: Path) -> None:
    said = refusals(tmp_path, lambda path: write_laz(path, CLOUD, CRS), errno.ENOSPC)
    assert len(said) >= 4
    begins = f"{tmp_path / 'FILE'}: cannot be written (No space left on device)"
    assert [text for text in said if not text.startswith(begins)] == []
    assert list(tmp_path.glob(".photogram-*")) == []


def test_an_octree_is_refused_as_well(tmp_path: Path) -> None:
    write_laz(tmp_path / "cloud.laz", CLOUD, CRS)
    said = refusals(tmp_path, lambda path: write_copc(path, tmp_path / "cloud.laz"), errno.EIO)
    assert len(said) >= 10
    assert [text for text in said if "cannot be written (Input/output error)" not in text] == []
