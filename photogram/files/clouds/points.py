"""Point clouds in and out: text of x, y, z and LAS or LAZ."""

import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from itertools import islice
from os.path import isfile  # false, not an exception, for a name that cannot be
from pathlib import Path

import laspy
import numpy as np
from laspy.errors import LaspyException
from laspy.vlrs.known import WktCoordinateSystemVlr

from photogram.arrays import ByteArray, FloatArray
from photogram.errors import FrameError, ProjectError
from photogram.files.atomic import replacing
from photogram.files.clouds.las_headers import LARGEST_EXTENT, check_las
from photogram.files.clouds.laz_streams import laz_stream
from photogram.files.reading import check_size
from photogram.geodesy.crs import METRES, NO_CRS, MapUnits, map_units, written_crs
from photogram.geodesy.height_systems import first_wkt
from photogram.survey import PointCloud
from photogram.wording import is_number

TEXT_SUFFIXES = (".txt", ".csv", ".xyz")
LAS_SUFFIXES = (".las", ".laz")
NO_DATE = date(2000, 1, 1)
"""The creation date of LAZ files whose caller names none: the same cloud gives the same bytes on every day."""

LOCAL_SCALE = 1e-5
"""Of a local frame, whose photographs may be taken from a metre, or whose unit none knows."""

SCALE_M = 0.001
COLOURED_FORMAT = 7
"""Point format of LAS 1.4 with colour; 6 is the same without."""

_COMMENTS = ("#", "//")
_SEPARATORS = (";", ",", "\t")
# "sigma xy" and "sigma z" are the names that the LAS working group's draft of standard extra bytes gives to the
# uncertainty in plan and in height (ASPRS, Standard ExtraByte Definitions); the two others follow their pattern.
_SIGMA_NAMES = ("sigma x", "sigma y", "sigma z")
_PLAN_NAME = "sigma xy"
SIGMA_DESCRIPTIONS = {
    "sigma x": "st. deviation easting [{plan}]",
    "sigma y": "st. deviation northing [{plan}]",
    "sigma xy": "st. deviation in plan [{plan}]",
    "sigma z": "st. deviation in height [{height}]",
}
"""Of extra bytes, whose descriptions have 32 characters, with the symbols of the units."""
_COLUMN_NAMES: Mapping[str, tuple[str, ...]] = {
    "x": ("x", "easting", "east", "e"),
    "y": ("y", "northing", "north", "n"),
    "z": ("z", "height", "elevation", "altitude", "up", "h"),
    "red": ("red", "r"),
    "green": ("green", "g"),
    "blue": ("blue", "b"),
}
# Everything up to here is looked at for a header; a file with more comment lines than this is no cloud.
_HEAD_LINES = 1000
_LONGEST_LINE = 10_000
_MOST_TEXT_BYTES = 20_000_000_000
_CHUNK_POINTS = 1_000_000

# lazrs reports damage as its own kind of RuntimeError
_LAS_DAMAGE = (
    LaspyException,
    RuntimeError,
    ValueError,
    TypeError,
    AttributeError,
    LookupError,
    ArithmeticError,
    struct.error,
    MemoryError,
)


@dataclass(frozen=True)
class _Layout:
    """Of a text file: the lines before its first point, its separator (None for blanks), and its columns of x, y, z and
    red, green, blue, the latter empty where there are none."""

    head_lines: int
    separator: str | None
    position: tuple[int, ...]
    colour: tuple[int, ...]


def _finite(path: Path, cloud: PointCloud) -> FloatArray:
    if not np.all(np.isfinite(cloud.position_map_m)):
        raise ValueError(f"{path}: a point cloud has non-finite positions")
    return cloud.position_map_m


def write_xyz(path: Path, cloud: PointCloud, decimals: int = 3, crs: str = NO_CRS) -> None:
    """Write ``x,y,z`` lines in the units of ``crs`` with so many decimals and no header, as CloudCompare opens them;
    whole or not at all.

    Raises WorkspaceError where the file cannot be written.
    """
    position = _finite(path, cloud) / map_units(crs).factors
    with replacing(path) as partial, partial.open("w", encoding="ascii", newline="\n") as stream:
        np.savetxt(stream, position, fmt=f"%.{decimals}f", delimiter=",")


def write_cloud(path: Path, cloud: PointCloud, crs: str) -> None:
    """Write a cloud by the suffix of its file: .laz, or .xyz, .txt or .csv with a line for a point.

    Raises ProjectError for another suffix, and as ``write_laz`` and ``write_xyz`` do.
    """
    suffix = path.suffix.lower()
    if suffix == ".laz":
        write_laz(path, cloud, crs)
    elif suffix in TEXT_SUFFIXES:
        write_xyz(path, cloud, crs=crs)
    else:
        raise ProjectError(f"{path}: clouds are written as .laz, .xyz, .txt or .csv: choose one of these endings")


def las_header(crs: str, created: date, *, colour: bool) -> laspy.LasHeader:
    """Return the header of a LAS 1.4 file in ``crs``, to the thousandth of its unit; of one in a local frame without a
    CRS, to LOCAL_SCALE. Raises FrameError where ``crs`` is no map grid."""
    header = laspy.LasHeader(version="1.4", point_format=COLOURED_FORMAT if colour else 6)
    header.creation_date = created
    header.system_identifier, header.generating_software = "photogram", "photogram"
    written = written_crs(crs)
    header.scales = np.full(3, SCALE_M if written is not None else LOCAL_SCALE)
    if written is not None:
        # LAS 1.4 asks for the first edition of WKT, which laspy's own add_crs does not write.
        header.vlrs.append(WktCoordinateSystemVlr(first_wkt(written)))
    header.global_encoding.wkt = True
    return header


def add_extra_bytes(header: laspy.LasHeader, fields: Mapping[str, tuple[type[np.generic], str]]) -> None:
    """Add extra bytes to a header: of each name the type and the description. They state no range of values."""
    header.add_extra_dims([laspy.ExtraBytesParams(name, kind, text) for name, (kind, text) in fields.items()])
    # laspy 2.7 takes the first point of each chunk for the range of all, so that none is better.
    for described in header.vlrs.get("ExtraBytesVlr")[0].extra_bytes_structs:
        described.options &= ~(described.MIN_BIT_MASK | described.MAX_BIT_MASK)


def described(descriptions: Mapping[str, str], units: MapUnits) -> dict[str, tuple[type[np.generic], str]]:
    """Return extra bytes of float32 with their descriptions, as add_extra_bytes takes them."""
    symbols = {"plan": units.plan_symbol, "height": units.height_symbol}
    return {name: (np.float32, text.format(**symbols)) for name, text in descriptions.items()}


def write_laz(path: Path, cloud: PointCloud, crs: str, created: date = NO_DATE) -> None:
    """Write a LAZ 1.4 file in ``crs`` and its units, with its height system where it names one, to a thousandth of the
    unit; whole or not at all.

    Colour is 16-bit. ``sigma_m`` becomes the extra bytes "sigma x", "sigma y", "sigma xy" = sqrt(x² + y²) and "sigma z"
    (float32), in the units of ``crs``, which their descriptions name. Raises FrameError where ``crs`` is no map grid,
    WorkspaceError where the file cannot be written, ValueError where the cloud is wider than the format's 4 294 km.
    """
    units = map_units(crs)
    position = _finite(path, cloud) / units.factors
    header = las_header(crs, created, colour=cloud.colour is not None)
    if len(cloud):
        header.offsets = np.floor((position.min(axis=0) + position.max(axis=0)) / 2)
    if cloud.sigma_m is not None:
        add_extra_bytes(header, described(SIGMA_DESCRIPTIONS, units))
    steps = np.rint((position - header.offsets) / SCALE_M)
    if len(cloud) and np.abs(steps).max() > np.iinfo(np.int32).max:
        raise ValueError(f"{path}: a point cloud {np.ptp(position, axis=0).max() / 1000:.0f} km wide does not fit LAZ")
    points = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(len(cloud), header=header))
    points.X, points.Y, points.Z = steps.astype(np.int32).T
    points.return_number[:] = points.number_of_returns[:] = 1
    if cloud.colour is not None:
        points.red, points.green, points.blue = cloud.colour.astype(np.uint16).T * np.uint16(257)
    if cloud.sigma_m is not None:
        own = cloud.sigma_m / units.factors
        for name, sigma in zip(_SIGMA_NAMES, own.T, strict=True):
            points[name] = sigma.astype(np.float32)
        points[_PLAN_NAME] = np.hypot(own[:, 0], own[:, 1]).astype(np.float32)
    with laz_stream(path) as stream:
        points.write(stream, do_compress=True)


def read_cloud(path: Path | str, crs: str = NO_CRS) -> PointCloud:
    """Return the cloud of a .txt, .csv, .xyz, .las or .laz file, in the CRS it was written in: positions (N, 3) in m.

    The units of the file are those of the CRS that a LAS file names, else those of ``crs``.

    Text: one point a line, separated by comma, semicolon, tab or blanks; # starts a comment, // does before the first
    point. A header that names the columns x y z (or easting northing height) and red green blue is followed; without
    one the first three columns are x y z, and the next three the colour if all are whole numbers from 0 to 255.

    Raises ProjectError, with the line in text, where the file is missing, damaged, empty or of another kind.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in TEXT_SUFFIXES + LAS_SUFFIXES:
        raise ProjectError(
            f"point cloud {path}: photogram reads {' '.join(TEXT_SUFFIXES + LAS_SUFFIXES)}, not {suffix or 'this'}: "
            "convert it, with CloudCompare for example"
        )
    if not isfile(path):
        raise ProjectError(f"point cloud {path}: file not found: check its path")
    cloud = _read_las(path, crs) if suffix in LAS_SUFFIXES else _in_metres(_read_text(path), map_units(crs))
    if len(cloud) == 0:
        raise ProjectError(f"point cloud {path}: it contains no points: export it again")
    return cloud


def _in_metres(cloud: PointCloud, units: MapUnits) -> PointCloud:
    if units.is_metric:
        return cloud
    sigma = None if cloud.sigma_m is None else cloud.sigma_m * units.factors
    return PointCloud(cloud.position_map_m * units.factors, cloud.colour, sigma)


def las_units(header: laspy.LasHeader, crs: str = NO_CRS) -> MapUnits:
    """Return the units of a LAS file: those of the map that its header names, else those of ``crs``."""
    try:
        named = header.parse_crs()
        return METRES if named is None and crs == NO_CRS else map_units(crs if named is None else str(named.to_wkt()))
    except (FrameError, *_LAS_DAMAGE):
        return map_units(crs)  # a CRS that nobody can read, or none of a map, has never been looked at


@contextmanager
def opened_las(path: Path) -> Iterator[laspy.LasReader]:
    """Give a reader of a LAS or LAZ file. Raises ProjectError where the file is missing or damaged, and for what the
    block raises of such a file."""
    if not isfile(path):
        raise ProjectError(f"point cloud {path}: file not found: check its path")
    try:
        check_las(path)
        # the decoder is named, else damage would be tried again with any other one that is installed, and named by that
        with laspy.open(path, laz_backend=laspy.LazBackend.LazrsParallel) as reader:
            yield reader
    except ProjectError:
        raise
    except OSError as error:
        raise ProjectError(f"point cloud {path}: cannot be read ({error.strerror or error}): copy it again") from error
    except _LAS_DAMAGE as error:
        raise ProjectError(f"point cloud {path}: cannot be read ({error}): copy or export it again") from error


def las_parts(path: Path, reader: laspy.LasReader) -> Iterator[laspy.ScaleAwarePointRecord]:
    """Yield the points of an open LAS or LAZ file in parts; memory grows with what has been decoded, whatever the
    header claims. Raises ProjectError where there are fewer than in the header, or a coordinate cannot be."""
    count = 0
    for part in reader.chunk_iterator(_CHUNK_POINTS):
        count += len(part)
        extent = max((float(np.abs(np.asarray(part[axis])).max(initial=0.0)) for axis in "xyz"), default=0.0)
        if not extent <= LARGEST_EXTENT:
            raise ProjectError(f"point cloud {path}: damaged, a coordinate is {extent:.6g}: copy or export it again")
        yield part
    if count != reader.header.point_count:
        raise ProjectError(
            f"point cloud {path}: {count} of the {reader.header.point_count} points in its header: "
            "copy or export it again"
        )


def read_las(path: Path) -> laspy.LasData:
    """Return everything a LAS or LAZ file holds. Raises ProjectError where it is missing, damaged or cut off."""
    with opened_las(path) as reader:
        form = reader.header.point_format
        parts = [part.array for part in las_parts(path, reader)]
        array = np.concatenate(parts) if parts else np.zeros(0, form.dtype())
        return laspy.LasData(reader.header, laspy.PackedPointRecord(array, form))


def las_extent(path: Path, crs: str = NO_CRS) -> FloatArray:
    """Return the lowest and highest coordinates (2, 3) in m that the header of a LAS or LAZ file states, in the units
    of its CRS, else of ``crs``. Raises ProjectError where the file is missing or damaged."""
    with opened_las(path) as reader:
        header = reader.header
        return np.stack([header.mins, header.maxs]) * las_units(header, crs).factors


def las_colour(points: laspy.LasData) -> ByteArray | None:
    """Return the colours (N, 3) of a LAS file in 8 bits, None where its format holds none."""
    if "red" not in set(points.point_format.dimension_names):
        return None
    wide = np.column_stack([points.red, points.green, points.blue])
    # Some programs write 8 bits into the 16 of the format.
    return np.asarray(wide >> 8 if wide.size and wide.max() > 255 else wide).astype(np.uint8)


def _read_las(path: Path, crs: str) -> PointCloud:
    points = read_las(path)
    sigma = None
    if set(points.point_format.dimension_names).issuperset(_SIGMA_NAMES):
        sigma = np.column_stack([points[name] for name in _SIGMA_NAMES]).astype(np.float64)
    cloud = PointCloud(np.asarray(points.xyz, dtype=np.float64), las_colour(points), sigma)
    return _in_metres(cloud, las_units(points.header, crs))


def _separator(line: str) -> str | None:
    return next((separator for separator in _SEPARATORS if separator in line.split("#")[0]), None)


def _split(line: str, separator: str | None) -> list[str]:
    return [field.strip() for field in line.strip().split(separator)]


def _columns_of(header: list[str]) -> dict[str, int]:
    """Return the column of each quantity that a header names; units, as in x_m or x[m], are passed over."""
    plain = [
        name.strip("\"'").lower().removesuffix("[m]").removesuffix("(m)").strip().removesuffix("_m") for name in header
    ]
    columns = ((quantity, [plain.index(n) for n in names if n in plain]) for quantity, names in _COLUMN_NAMES.items())
    return {quantity: places[0] for quantity, places in columns if places}


def _layout(path: Path, lines: list[str]) -> _Layout:
    """Find out from its first lines how a text file is laid out. Raises ProjectError where they hold no point."""
    content = [n for n, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(_COMMENTS)]
    if not content:
        raise ProjectError(f"point cloud {path}: it contains no points: export it again")
    first = content[0]
    separator = _separator(lines[first])
    fields = _split(lines[first].split("#")[0], separator)
    if any(is_number(field) for field in fields):
        colour = (3, 4, 5) if len(fields) >= 6 and all(is_number(field) for field in fields[3:6]) else ()
        return _Layout(first, separator, (0, 1, 2), colour)
    columns = _columns_of(fields)
    missing = [name for name in ("x", "y", "z") if name not in columns]
    if missing:
        raise ProjectError(
            f"point cloud {path}, line {first + 1}: no column {', '.join(missing)} in {lines[first].strip()[:60]!r}: "
            "name the columns x y z, or remove the header"
        )
    if len(content) == 1:
        raise ProjectError(f"point cloud {path}: it contains no points, only a header: export it again")
    colours = [columns[name] for name in ("red", "green", "blue") if name in columns]
    position = (columns["x"], columns["y"], columns["z"])
    return _Layout(first + 1, _separator(lines[content[1]]), position, tuple(colours) if len(colours) == 3 else ())


def _bad_line(path: Path, layout: _Layout, columns: tuple[int, ...]) -> ProjectError:
    """Return the error of the first line that is no point; only called when there is one."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        for number, line in enumerate(stream, 1):
            text = line.split("#")[0].strip()
            if number <= layout.head_lines or not text:
                continue
            fields = _split(text, layout.separator)
            values = [fields[c] for c in columns if c < len(fields)]
            if len(values) == len(columns) and all(is_number(v) and np.isfinite(float(v)) for v in values):
                continue
            hint = "use a decimal point" if "," in line and layout.separator != "," else "correct or delete the line"
            return ProjectError(
                f"point cloud {path}, line {number}: {text[:60]!r} is not a point, expected at least "
                f"{max(columns) + 1} "
                f"numbers separated by {layout.separator or 'blanks'!r}: {hint}"
            )
    return ProjectError(f"point cloud {path}: cannot be read as text: export it again")


def _load(path: Path, layout: _Layout, columns: tuple[int, ...]) -> FloatArray:
    try:
        with path.open(encoding="utf-8-sig") as stream:
            values = np.loadtxt(
                stream, delimiter=layout.separator, skiprows=layout.head_lines, usecols=columns, ndmin=2, comments="#"
            )
    except ValueError as error:
        raise _bad_line(path, layout, columns) from error
    if not np.all(np.isfinite(values)):
        raise _bad_line(path, layout, columns)
    return values


def _bytes(colour: FloatArray) -> ByteArray | None:
    whole = np.all((colour >= 0) & (colour <= 255) & (colour == np.rint(colour)))
    return colour.astype(np.uint8) if whole else None


def _read_text(path: Path) -> PointCloud:
    try:
        check_size(path, _MOST_TEXT_BYTES)
        with path.open(encoding="utf-8-sig") as stream:
            lines = list(islice(iter(lambda: stream.readline(_LONGEST_LINE + 1), ""), _HEAD_LINES))
    except UnicodeDecodeError as error:
        raise ProjectError(f"point cloud {path}: not UTF-8 text: export it again as text") from error
    except OSError as error:
        raise ProjectError(f"point cloud {path}: cannot be read ({error.strerror}): check its permissions") from error
    longest = max(range(len(lines)), key=lambda n: len(lines[n]), default=0)
    if lines and len(lines[longest]) > _LONGEST_LINE:
        raise ProjectError(
            f"point cloud {path}, line {longest + 1}: more than {_LONGEST_LINE} characters, not a text file of points: "
            "export it again"
        )
    layout = _layout(path, lines)
    values = _load(path, layout, layout.position + layout.colour)
    return PointCloud(values[:, :3].copy(), _bytes(values[:, 3:]) if layout.colour else None)
