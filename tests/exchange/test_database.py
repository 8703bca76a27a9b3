"""Databases of COLMAP: read as pycolmap writes them, and refused where damaged or hostile."""

import errno
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from foreign import assert_refused_or_read, assert_refuses

from photogram.exchange.formats.colmap.database import is_database, read_colmap_database

SCHEMA = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, model INTEGER, width INTEGER, height INTEGER, params BLOB,
    prior_focal_length INTEGER);
CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, camera_id INTEGER NOT NULL);
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB, config INTEGER);
"""
PIXELS = np.array([[10.5, 20.25], [30.0, 40.75], [0.5, 0.5]])
PAIRS = np.array([[0, 2], [1, 1]])


@pytest.fixture
def database(tmp_path: Path) -> Path:
    """A database of two photographs."""
    return write_database(tmp_path / "data base #1?.db", "a/3.jpg", "a/5.jpg")


def write_database(path: Path, *names: str) -> Path:
    """Write a database as COLMAP 3 and 4 lay it out: two photographs with three key points and two verified matches."""
    connection = sqlite3.connect(path)
    connection.executescript(SCHEMA)
    camera = np.array([380.0, 200.0, 150.5, -0.1]).tobytes()
    connection.execute("INSERT INTO cameras VALUES (7, 2, 400, 301, ?, 0)", (camera,))
    for number, columns, name in zip((3, 5), (6, 2), names, strict=True):
        keys = np.hstack([PIXELS, np.ones((3, columns - 2))]).astype("<f4").tobytes()
        connection.execute("INSERT INTO images VALUES (?, ?, 7)", (number, name))
        connection.execute("INSERT INTO keypoints VALUES (?, 3, ?, ?)", (number, columns, keys))
    pair = 3 * 2147483647 + 5
    connection.execute("INSERT INTO two_view_geometries VALUES (?, 2, 2, ?, 3)", (pair, PAIRS.astype("<u4").tobytes()))
    connection.commit()
    connection.close()
    return path


def changed(path: Path, *statements: str) -> None:
    connection = sqlite3.connect(path)
    for statement in statements:
        connection.execute(statement)
    connection.commit()
    connection.close()


def test_what_stands_in_it_is_read(database: Path) -> None:
    before = sorted(p.name for p in database.parent.iterdir())
    read = read_colmap_database(database)
    assert [str(file) for file in read.files] == ["a/3.jpg", "a/5.jpg"]
    assert read.camera_of == (0, 0)
    assert np.array_equal(read.cameras[0].parameters[:4], [380.0, 199.5, 150.0, -0.1])
    for pixel in read.pixels:
        assert np.array_equal(pixel, PIXELS - 0.5)
    assert [(m.first, m.second) for m in read.matches] == [(0, 1)]
    assert np.array_equal(read.matches[0].index, PAIRS)
    assert "Scales" in " ".join(read.left_out)
    assert repr(read) == "<ColmapDatabase: 2 photographs, 6 key points, 2 verified matches>"
    assert sorted(p.name for p in database.parent.iterdir()) == before


def test_pycolmaps_own_database_is_read(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap writes the database that is read")
    path = tmp_path / "database.db"
    theirs = pycolmap.Database.open(str(path))
    camera = pycolmap.Camera.create_from_model_name(1, "OPENCV", 380.0, 400, 301)
    camera.params = [380.0, 381.0, 200.0, 150.5, -0.1, 0.02, 1e-3, 2e-3]
    number = theirs.write_camera(camera)
    images = [theirs.write_image(pycolmap.Image(name=f"{n}.jpg", camera_id=number)) for n in "ab"]
    for image in images:
        theirs.write_keypoints(image, PIXELS.astype(np.float32))
    geometry = pycolmap.TwoViewGeometry()
    geometry.inlier_matches = PAIRS.astype(np.uint32)
    theirs.write_two_view_geometry(*images, geometry)
    theirs.close()
    read = read_colmap_database(path)
    assert [file.name for file in read.files] == ["a.jpg", "b.jpg"]
    assert np.array_equal(read.pixels[1], PIXELS - 0.5)
    assert np.array_equal(read.matches[0].index, PAIRS)
    assert np.array_equal(read.cameras[0].affinity, [-1.0, 0.0])
    assert np.array_equal(read.cameras[0].tangential, [1e-3, 2e-3])


def test_damaged_databases_are_refused_or_read(database: Path) -> None:
    assert_refused_or_read(database, lambda: read_colmap_database(database))


HOSTILE: list[tuple[str, Callable[[Path], Any], str]] = [
    ("a count", lambda p: changed(p, "UPDATE keypoints SET rows = 9223372036854775807"), "bytes for"),
    ("a negative count", lambda p: changed(p, "UPDATE keypoints SET rows = -3, cols = -2"), "bytes for"),
    ("a key point", lambda p: changed(p, "UPDATE two_view_geometries SET data = x'0000000009000000', rows = 1"), "key"),
    ("a pair", lambda p: changed(p, "UPDATE two_view_geometries SET pair_id = 12"), "images that are not there"),
    ("a camera", lambda p: changed(p, "UPDATE images SET camera_id = 1"), "camera 1, which is not there"),
    ("a model", lambda p: changed(p, "UPDATE cameras SET model = 99"), "no camera model 99"),
    ("parameters", lambda p: changed(p, "UPDATE cameras SET params = x'00'"), "1 bytes of parameters"),
    ("a text for a number", lambda p: changed(p, "UPDATE images SET camera_id = 'x'"), "whole number"),
    ("a path", lambda p: changed(p, "UPDATE images SET name = 'x/..' WHERE image_id = 3"), "no name"),
    ("the same name", lambda p: changed(p, "UPDATE images SET name = 'b/5.jpg' WHERE image_id = 3"), "same file name"),
    ("NaN", lambda p: changed(p, "UPDATE keypoints SET rows=1, cols=2, data=x'0000c07f0000c07f'"), "nan"),
    (
        "a view",
        lambda p: changed(
            p,
            "DROP TABLE images",
            "CREATE VIEW images AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) "
            "SELECT x AS image_id, hex(randomblob(9)) AS name, 7 AS camera_id FROM c",
        ),
        "no plain table images",
    ),
    (
        "a generated column",
        lambda p: changed(
            p,
            "DROP TABLE keypoints",
            "CREATE TABLE keypoints (image_id, rows, cols, data GENERATED ALWAYS AS (zeroblob(1000000000)))",
            "INSERT INTO keypoints VALUES (3, 1, 2)",
        ),
        "no plain table keypoints",
    ),
    (
        "a key twice",
        lambda p: changed(
            p,
            "ALTER TABLE keypoints RENAME TO others",
            "CREATE TABLE keypoints (image_id, rows, cols, data)",
            "INSERT INTO keypoints SELECT * FROM others UNION ALL SELECT * FROM others",
        ),
        "keypoints has the key 3 twice",
    ),
    ("no table", lambda p: changed(p, "DROP TABLE keypoints"), "no plain table keypoints"),
    ("no column", lambda p: changed(p, "ALTER TABLE keypoints DROP COLUMN cols"), "no column cols"),
    ("a log beside it", lambda p: p.with_name(f"{p.name}-wal").write_bytes(b"1"), "not in the database yet"),
    ("a text", lambda p: p.write_text("SQLite"), "no SQLite database"),
    ("no file", lambda p: p.unlink(), "cannot be read"),
]


@pytest.mark.parametrize(("_what", "damage", "words"), HOSTILE, ids=[what for what, _, _ in HOSTILE])
def test_hostile_databases_are_refused(database: Path, _what: str, damage: Callable[[Path], Any], words: str) -> None:
    damage(database)
    assert_refuses(lambda: read_colmap_database(database), words)


def test_a_database_that_may_not_be_read_is_not_taken_for_another_file(
    database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(path: Path, *_: object) -> NoReturn:
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(Path, "open", forbidden)
    assert not is_database(database)
    assert_refuses(lambda: read_colmap_database(database), r"cannot be read \(Permission denied\): check its name")
