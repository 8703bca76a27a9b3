"""The script of DBAT, XML, and the tables that it names: photographs, marks, control and check points, a camera.

A table is text with commas, `#` begins a comment; the script says its columns in the attribute ``format`` and the
standard deviations of marks in ``sxy``. Control and check points may come from one table, filtered by their ids.
"""

from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.errors import ExchangeError
from photogram.files.solutions.parsing import (
    bytes_of,
    check_distinct,
    number_of,
    numbers,
    part_of,
    text_of,
    whole_numbers,
)
from photogram.files.xml_elements import Element, elements_of
from photogram.wording import printable, shortened, things

_MOST_BYTES = 100_000_000
_MOST_TABLE_BYTES = 2_000_000_000
_REMEDY = "correct the script of DBAT"
_IGNORED = "ignored"
_TEXTS = ("label", "name", "path", _IGNORED)
_IMAGE_COLUMNS = ("id", "path", "label", "name", "cam", _IGNORED)
_MARK_COLUMNS = ("id", "im", "x", "y", "sx", "sy", "sxy", _IGNORED)
_POINT_COLUMNS = ("id", "label", "name", "x", "y", "z", "sx", "sy", "sz", "sxy", "sxyz", _IGNORED)


@dataclass(frozen=True, eq=False)
class ScriptCamera:
    """A camera as the script gives it to DBAT."""

    place: str
    name: str
    size_px: FloatArray
    """Width and height (2,)."""
    pixel: FloatArray
    """Width and height (2,) of a pixel, in DBAT's camera unit."""
    values: dict[str, float]
    """Parameters by their names in DBAT, lengths in the camera unit: cc, px, py, as, sk, K1 …, P1 …"""


@dataclass(frozen=True, eq=False)
class Marks:
    """Image measurements of all tables of the script."""

    point: IntArray
    """Ids of the points (N,)."""
    image: IntArray
    """Numbers of the photographs (N,)."""
    pixel: FloatArray
    """Measured places (N, 2), px, as DBAT counts them."""
    sigma_px: FloatArray
    """Standard deviations (N,)."""


@dataclass(frozen=True, eq=False)
class Points:
    """Surveyed points."""

    id: IntArray
    """Ids (G,)."""
    label: tuple[str, ...]
    """Labels, empty without."""
    position_m: FloatArray
    """Coordinates (G, 3)."""
    sigma_m: FloatArray
    """Standard deviations (G, 3), NaN where none are stated."""


@dataclass(frozen=True, eq=False)
class Script:
    """What DBAT was given."""

    camera: ScriptCamera
    images: dict[int, str]
    """Paths of photographs by their numbers."""
    marks: Marks
    control: Points
    check: Points


@dataclass(frozen=True)
class _Table:
    """A table: texts of its columns by their names."""

    path: Path
    columns: dict[str, list[str]]
    lines: list[int]

    def numbers(self, name: str) -> FloatArray:
        """Return the numbers (N,) of a column. Raises ExchangeError with the line where one is none or not finite."""
        texts = self.columns[name]
        try:
            values = numbers(str(self.path), texts)
        except ExchangeError:
            values = np.full(len(texts), np.nan)
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong):
            i = int(wrong[0])
            number_of(f"{self.path}:{self.lines[i]}", name, texts[i])
        return values

    def whole(self, name: str) -> IntArray:
        """Return the whole numbers (N,) of a column."""
        return whole_numbers(str(self.path), name, self.numbers(name))


def name_of(path: str) -> str:
    """Return the file name of a path of the machine that DBAT ran on."""
    return PurePosixPath(path.replace("\\", "/")).name


def read_script(path: Path) -> Script:
    """Return what a script gave to DBAT, its tables read from beside it, by their file names alone.

    Raises ExchangeError where the script or a table is missing or damaged, has columns or filters that DBAT does not
    know, several cameras, or marks without standard deviations.
    """
    root = elements_of(bytes_of(path, _MOST_BYTES), path, ExchangeError, _REMEDY)
    given = root.first("document", "input")
    if given is None:
        raise ExchangeError(f"{root.place}: is no script of DBAT: it has no document / input: {_REMEDY}")
    images = _table(_one(given, "images", "file"), _IMAGE_COLUMNS, ("id", "path"))
    numbers_of_images = images.whole("id")
    check_distinct(str(images.path), "photograph", numbers_of_images)
    if "cam" in images.columns and len(set(images.columns["cam"])) > 1:
        raise ExchangeError(f"{images.path}: has several cameras: only projects of one camera are read")
    return Script(
        camera=_camera(given),
        images=dict(zip(numbers_of_images.tolist(), images.columns["path"], strict=True)),
        marks=_marks(given),
        control=_points(given.first("ctrl_pts")),
        check=_points(given.first("check_pts")),
    )


def _one(element: Element, *tags: str) -> Element:
    elements = list(element.all(*tags))
    if len(elements) != 1:
        count = things(len(elements), "element")
        raise ExchangeError(f"{element.place}: has {count} {' / '.join(tags)} where one is read: {_REMEDY}")
    return elements[0]


def _table(file: Element, known: tuple[str, ...], needed: tuple[str, ...]) -> _Table:
    """Return the table that an element ``file`` names, with the columns of its format."""
    place = file.place
    names = [name.strip() for name in file.attributes.get("format", "").split(",")]
    strange = [name for name in names if name not in known]
    if strange:
        unknown = printable(shortened(strange[0]))
        raise ExchangeError(f"{place}: the format has an unknown column {unknown!r}: {_REMEDY}")
    missing = [name for name in needed if name not in names]
    if missing:
        raise ExchangeError(f"{place}: the format has no column {missing[0]!r}: {_REMEDY}")
    read = [name for name in names if name != _IGNORED]
    if len(set(read)) < len(read):
        raise ExchangeError(f"{place}: the format has a column twice: {_REMEDY}")
    table = part_of(place, file.file.parent, name_of(file.text))
    rows, lines = [], []
    for line, text in enumerate(text_of(table, _MOST_TABLE_BYTES).splitlines(), 1):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        cells = text.split(",")
        if len(cells) != len(names):
            raise ExchangeError(
                f"{table}:{line}: has {things(len(cells), 'column')}, the script says {len(names)} "
                f"({', '.join(names)}): correct the table"
            )
        rows.append(cells)
        lines.append(line)
    columns = {name: [row[k].strip() for row in rows] for k, name in enumerate(names) if name != _IGNORED}
    return _Table(table, columns, lines)


def _camera(given: Element) -> ScriptCamera:
    camera = _one(given, "cameras", "camera")
    place = camera.place
    size, sensor, pp = (_pair(camera, tag) for tag in ("image", "sensor", "pp"))
    if not (size >= 1.0).all() or not (sensor > 0.0).all():
        raise ExchangeError(f"{place}: the sizes of image and sensor must be positive: {_REMEDY}")
    values = {"cc": _value(camera, "cc"), "px": float(pp[0]), "py": float(pp[1])}
    values["as"] = 0.0 if camera.first("aspect") is None else _value(camera, "aspect") - 1.0
    values["sk"] = 0.0 if camera.first("skew") is None else _value(camera, "skew")
    for letter in "KP":
        terms = camera.first(letter)
        if terms is not None:
            for i, text in enumerate(terms.text.split(","), 1):
                values[f"{letter}{i}"] = number_of(terms.place, f"{letter}{i}", text)
    label = camera.first("name")
    name = "" if label is None else label.text
    return ScriptCamera(place, name or "camera", size, sensor / size, values)


def _value(camera: Element, tag: str) -> float:
    element = _one(camera, tag)
    return number_of(element.place, tag, element.text)


def _pair(camera: Element, tag: str) -> FloatArray:
    element = _one(camera, tag)
    texts = element.text.split(",")
    if len(texts) != 2:
        raise ExchangeError(f"{element.place}: {tag} must be two numbers with a comma: {_REMEDY}")
    return np.array([number_of(element.place, tag, text) for text in texts])


def _marks(given: Element) -> Marks:
    files = list(given.all("image_pts", "file"))
    if not files:
        raise ExchangeError(f"{given.place}: names no table of marks (image_pts / file): {_REMEDY}")
    parts = [_marks_of(file) for file in files]
    return Marks(*(np.concatenate([part[k] for part in parts]) for k in range(4)))


def _marks_of(file: Element) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    place = file.place
    table = _table(file, _MARK_COLUMNS, ("id", "im", "x", "y"))
    sigmas = []
    for axis in ("sx", "sy"):  # attributes come before columns
        name = next((name for name in (axis, "sxy") if name in file.attributes), None)
        column = next((name for name in (axis, "sxy") if name in table.columns), None)
        if name is not None:
            sigmas.append(np.full(len(table.lines), number_of(place, name, file.attributes[name])))
        elif column is not None:
            sigmas.append(table.numbers(column))
        else:
            raise ExchangeError(f"{place}: the marks have no standard deviations: state them with sxy in the script")
    if not all((sigma > 0.0).all() for sigma in sigmas) or not np.array_equal(sigmas[0], sigmas[1]):
        raise ExchangeError(
            f"{place}: the standard deviations of marks must be positive, and the same in x and y: {_REMEDY}"
        )
    pixel = np.column_stack([table.numbers("x"), table.numbers("y")])
    return table.whole("id"), table.whole("im"), pixel, sigmas[0]


def _points(element: Element | None) -> Points:
    if element is None:
        return Points(np.zeros(0, dtype=np.int64), (), np.zeros((0, 3)), np.zeros((0, 3)))
    table = _table(_one(element, "file"), _POINT_COLUMNS, ("id", "x", "y", "z"))
    ids = table.whole("id")
    check_distinct(str(table.path), "ground point", ids)
    position = np.column_stack([table.numbers(axis) for axis in "xyz"])
    sigma = np.full((len(ids), 3), np.nan)
    for k, names in enumerate((("sx", "sxy", "sxyz"), ("sy", "sxy", "sxyz"), ("sz", "sxyz"))):
        column = next((name for name in names if name in table.columns), None)
        if column is not None:
            sigma[:, k] = table.numbers(column)
    if (sigma < 0.0).any():
        raise ExchangeError(f"{table.path}: a standard deviation is negative: correct the table")
    labels = table.columns.get("label", table.columns.get("name", [""] * len(ids)))
    keep = np.ones(len(ids), dtype=bool)
    for filter_ in element.all("filter"):
        place, action = filter_.place, filter_.text
        texts = [text for text in filter_.attributes.get("id", "").split(",") if text.strip()]
        named = np.isin(ids, whole_numbers(place, "id", numbers(place, texts)))
        if action not in ("keep", "remove"):
            raise ExchangeError(f"{place}: {printable(shortened(action))!r} is no filter of DBAT: {_REMEDY}")
        keep &= named if action == "keep" else ~named
    return Points(ids[keep], tuple(labels[i] for i in np.flatnonzero(keep)), position[keep], sigma[keep])
