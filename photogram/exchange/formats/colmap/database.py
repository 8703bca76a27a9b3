"""COLMAP's database of a project: photographs, cameras, key points, and verified matches; read only.

The tables are those of src/colmap/scene/database_sqlite.cc. The file is opened read-only and immutable, so that nothing
is written beside it, and nothing of it is run: no view, trigger, virtual table or generated column is read, no function
may be called, and no row is taken twice.
"""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import FloatArray
from photogram.camera import Camera
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import HALF_PIXEL, check_names, sentences
from photogram.exchange.formats.colmap.records import ColmapCamera, from_colmap, model_of
from photogram.files.reading import check_size
from photogram.files.solutions.parsing import MOST_BYTES, check_finite, file_of
from photogram.survey import Matches
from photogram.wording import printable, things

_HEADER = b"SQLite format 3\0"
_PAIR = 2_147_483_647
"""A pair of images has the number of the lower one times this, plus that of the other."""

_COLUMNS = {
    "cameras": ("camera_id", "model", "width", "height", "params"),
    "images": ("image_id", "name", "camera_id"),
    "keypoints": ("image_id", "rows", "cols", "data"),
    "two_view_geometries": ("pair_id", "rows", "cols", "data"),
}
_ALLOWED = {sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ}
_STEPS, _MOST_CALLS = 10_000, 1_000_000


@dataclass(frozen=True, eq=False)
class ColmapDatabase:
    """What a database holds of photographs (F)."""

    files: tuple[PurePosixPath, ...]
    """The files as COLMAP names them, relative to its folder of images."""
    cameras: tuple[Camera, ...]
    """The cameras as they went into COLMAP's adjustment."""
    camera_of: tuple[int, ...]
    """Index of the camera of each photograph."""
    pixels: tuple[FloatArray, ...]
    """Key points (N, 2) of each photograph; none where COLMAP extracted none."""
    matches: tuple[Matches, ...]
    """Matches that COLMAP verified by a two-view geometry."""
    left_out: tuple[str, ...] = ()
    """Sentences: what the database holds and this form cannot."""

    def __repr__(self) -> str:
        keys = sum(len(pixel) for pixel in self.pixels)
        matched = sum(len(matches) for matches in self.matches)
        counts = f"{things(len(self.files), 'photograph')}, {things(keys, 'key point')}"
        return f"<ColmapDatabase: {counts}, {things(matched, 'verified match', 'verified matches')}>"


class _Tables:
    """The tables of an open database."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path, self._connection = path, connection

    def rows(self, table: str) -> Iterator[tuple[int | bytes | str | None, ...]]:
        """Give the rows of a table, each with a key of its own."""
        columns = _COLUMNS[table]
        rows = self._connection.execute(f"SELECT {', '.join(columns)} FROM {table}")
        # a damaged tree of pages can lead to the same row again and again, which a key would else forbid
        keys: set[int | bytes | str | None] = set()
        for row in rows:
            if row[0] in keys:
                raise ExchangeError(f"{self.path}: {table} has the key {str(row[0])[:40]} twice: it is damaged")
            keys.add(row[0])
            yield row

    def check(self) -> None:
        """Raise ExchangeError unless the tables are there, and are tables."""
        for table, columns in _COLUMNS.items():
            entries = self._connection.execute(
                "SELECT type, sql FROM sqlite_master WHERE name = ? COLLATE NOCASE", (table,)
            ).fetchall()
            sql = str(entries[0][1]).upper() if entries else ""
            if len(entries) != 1 or entries[0][0] != "table" or "VIRTUAL" in sql or " AS " in sql or "GENERATED" in sql:
                raise ExchangeError(
                    f"{self.path}: has no plain table {table}: name the database.db that COLMAP's feature_extractor "
                    "and matcher have written"
                )
            present = {
                str(row[0]) for row in self._connection.execute(f"SELECT name FROM pragma_table_info('{table}')")
            }
            missing = [column for column in columns if column not in present]
            if missing:
                raise ExchangeError(
                    f"{self.path}: its table {table} has no column {missing[0]}: it is none of COLMAP's"
                )


def is_database(path: Path) -> bool:
    """Return whether a file is an SQLite database, whosever."""
    try:
        return _has_header(path)
    except OSError:
        return False


def _has_header(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(len(_HEADER)) == _HEADER


def read_colmap_database(path: Path) -> ColmapDatabase:
    """Return the photographs, cameras, key points and verified matches of a database.

    Pixels have the centre of the top-left one at (0, 0), half a pixel less than COLMAP's. Raises ExchangeError where
    the file is no database of COLMAP, is damaged, has changes beside it that COLMAP has not yet put into it, or has a
    camera model that is none of photogram's.
    """
    size = _checked_size(path)
    address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(address, uri=True)) as connection:
            _disarm(connection, size)
            tables = _Tables(path, connection)
            tables.check()
            connection.set_authorizer(_read_only)
            return _read(tables)
    except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
        reason = printable(str(error))[:200]
        raise ExchangeError(f"{path}: cannot be read as a database ({reason}): it is damaged: make it again") from error


def _checked_size(path: Path) -> int:
    try:
        size = check_size(path, 100 * MOST_BYTES)
        has_header = _has_header(path)
        log = path.with_name(f"{path.name}-wal")
        has_log = log.exists() and log.stat().st_size > 0
    except OSError as error:
        raise ExchangeError(f"{path}: cannot be read ({error.strerror}): check its name and folder") from error
    if not has_header:
        raise ExchangeError(f"{path}: is no SQLite database: name the database.db of a project of COLMAP")
    if has_log:
        raise ExchangeError(
            f"{log}: holds changes that are not in the database yet: end COLMAP, and open it there once"
        )
    return size


def _disarm(connection: sqlite3.Connection, size: int) -> None:
    """Let a database do nothing but hand out what is stored in it, and no more than it can hold."""
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA cell_size_check = ON")
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(max(size, 1_000_000), 2_000_000_000))
    calls = iter(range(_MOST_CALLS))
    connection.set_progress_handler(lambda: next(calls, None) is None, _STEPS)


def _read_only(action: int, first: str | None, second: str | None, _database: str | None, _trigger: str | None) -> int:
    del second
    tables = {"sqlite_master", *_COLUMNS}
    allowed = action in _ALLOWED and (first is None or first == "" or first.lower() in tables)
    return sqlite3.SQLITE_OK if allowed else sqlite3.SQLITE_DENY


def _read(tables: _Tables) -> ColmapDatabase:
    path = tables.path
    cameras: dict[int, Camera] = {}
    for row in tables.rows("cameras"):
        number, model, width, height = (_whole(path, "cameras", value) for value in row[:4])
        where, data = f"{path}: cameras: {number}", row[4]
        if not isinstance(data, bytes):
            raise ExchangeError(f"{path}: cameras: a camera has no parameters: it is damaged")
        parameters = len(model_of(where, model).parameters)
        if len(data) != 8 * parameters:
            raise ExchangeError(
                f"{where}: has {len(data)} bytes of parameters, expected {8 * parameters}: it is damaged"
            )
        camera = ColmapCamera(number, model, (width, height), np.frombuffer(data, "<f8").astype(np.float64))
        cameras[number] = from_colmap(where, camera)
    images: dict[int, tuple[PurePosixPath, int]] = {}
    for row in sorted(tables.rows("images"), key=lambda row: _whole(path, "images", row[0])):
        number, camera_id = _whole(path, "images", row[0]), _whole(path, "images", row[2])
        if camera_id not in cameras:
            raise ExchangeError(f"{path}: images: {number} names camera {camera_id}, which is not there: it is damaged")
        images[number] = (file_of(f"{path}: images: {number}", str(row[1])), camera_id)
    check_names(str(path), [file for file, _ in images.values()])
    index = {number: i for i, number in enumerate(images)}
    camera_index = {number: i for i, number in enumerate(cameras)}
    pixels, more = _key_points(tables, index)
    matches, unnamed = _matches(tables, index, [len(pixel) for pixel in pixels])
    left_out = sentences(
        (True, "Descriptors of key points, and matches that were not verified."),
        (more, "Scales and orientations of key points."),
        (unnamed, f"{things(unnamed, 'two-view geometry', 'two-view geometries')} without a match."),
    )
    return ColmapDatabase(
        tuple(file for file, _ in images.values()),
        tuple(cameras.values()),
        tuple(camera_index[camera_id] for _, camera_id in images.values()),
        pixels,
        matches,
        tuple(left_out),
    )


def _key_points(tables: _Tables, index: dict[int, int]) -> tuple[tuple[FloatArray, ...], bool]:
    """Return the key points of every photograph, and whether they have more than a position."""
    path, more = tables.path, False
    pixels = [np.zeros((0, 2)) for _ in index]
    for row in tables.rows("keypoints"):
        number, rows, columns = (_whole(path, "keypoints", value) for value in row[:3])
        where = f"{path}: keypoints: {number}"
        if number not in index:
            raise ExchangeError(f"{where}: there is no such image: it is damaged")
        values = _table(where, row[3], rows, columns, "<f4")
        if rows and columns not in (2, 4, 6):
            raise ExchangeError(f"{where}: has {columns} columns, expected 2, 4 or 6: it is damaged")
        pixels[index[number]] = values[:, :2].astype(np.float64) - HALF_PIXEL if rows else np.zeros((0, 2))
        check_finite(where, "a key point", pixels[index[number]])
        more = more or (rows > 0 and columns > 2)
    return tuple(pixels), more


def _matches(tables: _Tables, index: dict[int, int], keys: list[int]) -> tuple[tuple[Matches, ...], int]:
    """Return the verified matches, and the number of pairs that have none."""
    path, empty = tables.path, 0
    matches = []
    for row in tables.rows("two_view_geometries"):
        pair, rows, columns = (_whole(path, "two_view_geometries", value) for value in row[:3])
        where = f"{path}: two_view_geometries: {pair}"
        first, second = divmod(pair, _PAIR)
        if first not in index or second not in index:
            raise ExchangeError(f"{where}: names images that are not there: it is damaged")
        if not rows:
            empty += 1
            continue
        values = _table(where, row[3], rows, columns, "<u4").astype(np.int64)
        a, b = index[first], index[second]
        if columns != 2 or (values >= np.array([keys[a], keys[b]])).any():
            raise ExchangeError(f"{where}: names key points that are not there: it is damaged")
        matches.append(Matches(a, b, values))
    return tuple(matches), empty


def _table(where: str, value: int | bytes | str | None, rows: int, columns: int, kind: str) -> NDArray[Any]:
    data = value if isinstance(value, bytes) else b""
    if min(rows, columns) < 0 or rows * columns * 4 != len(data):
        raise ExchangeError(f"{where}: has {len(data)} bytes for {rows} rows of {columns}: it is damaged")
    return np.frombuffer(data, kind).reshape(rows, columns)


def _whole(path: Path, table: str, value: int | bytes | str | None) -> int:
    if not isinstance(value, int):
        text = printable(repr(value))[:60]
        raise ExchangeError(f"{path}: {table}: holds {text} where a whole number belongs: it is damaged")
    return value
