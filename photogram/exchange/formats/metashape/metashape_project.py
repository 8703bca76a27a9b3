"""Projects of Agisoft Metashape and PhotoScan: `.psz`, one archive, and `.psx` with the folder `.files` beside it.

A `.psz` holds doc.xml and its clouds. A `.psx` names project.zip in its folder, that names a chunk.zip for each chunk,
that a frame.zip for each frame, that the archive of tie points; each holds a doc.xml with an element of its own. What
the XML says is read by `metashape_chunk`. Tie points are binary PLY: points (x, y, z in the chunk's coordinates, id),
for each photograph projections (x, y, size, id), pixels with the centre of the top-left one at (0.5, 0.5), and tracks
(red, green, blue), the colour of the point whose id is its place in the list.
"""

import zipfile
import zlib
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, FloatArray, IntArray
from photogram.errors import ExchangeError
from photogram.exchange.formats.assembly import HALF_PIXEL, index_in, no_tie_points, sentences, tie_points_of
from photogram.exchange.formats.metashape.metashape_chunk import MOST_XML_BYTES, Chunk, read_chunk
from photogram.files.clouds.binary_ply import vertices_of
from photogram.files.reading import regular_file_size
from photogram.files.solutions.parsing import bytes_of, check_distinct, check_finite, part_of
from photogram.files.solutions.solution import ForeignSolution
from photogram.files.xml_elements import Element, elements_of
from photogram.survey import TiePoints
from photogram.wording import printable, shortened, some, things

MOST_UNPACKED_BYTES = 2_000_000_000
"""Of one archive: 100 million projections."""

_DOCUMENT = "doc.xml"
_REMEDY = "save the project in Metashape again"
_PROJECT_NAME = "{projectname}"
_RENAMED = (1, 5)
"""Version from which PhotoScan is called Metashape."""
_CLOUDS = ("tie_points", "point_cloud")


class _Archive:
    """A zip file that is read member by member, each no larger than it may be."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._left = MOST_UNPACKED_BYTES
        try:
            regular_file_size(path)
            self._zip = zipfile.ZipFile(path)
        except OSError as error:
            raise ExchangeError(f"{path}: cannot be read ({error.strerror}): check its name and folder") from error
        except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
            raise ExchangeError(f"{path}: is no archive ({printable(shortened(str(error)))}): {_REMEDY}") from error

    def close(self) -> None:
        self._zip.close()

    def read(self, name: str, most_bytes: int = MOST_UNPACKED_BYTES) -> bytes:
        """Return a member. Raises ExchangeError where it is missing, damaged or larger than ``most_bytes``, or all that
        was read of the archive is larger than an archive may be."""
        place = f"{self.path}: {printable(shortened(name))}"
        most_bytes = min(most_bytes, self._left)
        try:
            with self._zip.open(name) as stream:  # its stated size may be untrue: no more is unpacked than may be
                data = stream.read(most_bytes + 1)
        except KeyError as error:
            raise ExchangeError(f"{place} is not in the archive: {_REMEDY}") from error
        except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError) as error:
            raise ExchangeError(f"{place} is damaged ({printable(shortened(str(error)))}): {_REMEDY}") from error
        if len(data) > most_bytes:
            raise ExchangeError(f"{place} has more than the {most_bytes / 1e6:.1f} MB that are still read here")
        self._left -= len(data)
        return data


@dataclass(frozen=True)
class _Cloud:
    """Tie points as Metashape has them: bytes of PLY files, with the places they come from."""

    place: str
    points: bytes | None
    tracks: bytes | None
    projections: tuple[tuple[str, bytes], ...]
    """By the number of the camera."""


def read_metashape_project(path: Path, chunk: str | None = None) -> ForeignSolution:
    """Return the solution of a project, `.psz` or `.psx`; ``chunk`` is the label of its chunk, needed where there are
    several.

    Coordinates are geocentric where the chunk has a CRS, else local ones, those of its markers. Of several frames the
    first is read. Raises ExchangeError where a file is missing, damaged or hostile, or a camera model is not
    photogram's.
    """
    if path.suffix.lower() == ".psz":
        with closing(_Archive(path)) as archive:
            head = _document(archive, "document")
            chosen = _chosen(path, list(head.all("chunks", "chunk")), chunk)
            frame = chosen.first("frames", "frame")
            element = _cloud_element(frame)
            cloud = None if element is None else _cloud_of(archive, element)
    elif path.suffix.lower() == ".psx":
        root = elements_of(bytes_of(path, MOST_XML_BYTES), path, ExchangeError, _REMEDY)
        head = root.first("document") or root
        chosen, frame, cloud = _of_folder(path, head, chunk)
    else:
        raise ExchangeError(f"{path}: is no project of Metashape: give a file .psz or .psx")
    contents = read_chunk(chosen, frame)
    tie_points, left_out = (no_tie_points(), ()) if cloud is None else _tie_points(contents, cloud)
    frames = len(list(chosen.all("frames", "frame")))
    left_out = (*left_out, *sentences((frames > 1, f"All but the first of {frames} frames.")))
    return contents.solution(_program(path, head.attributes.get("version", "")), tie_points, left_out)


def _program(path: Path, version: str) -> str:
    """Return the program's name: it was PhotoScan before version 1.5."""
    numbers = [int(part) for part in version.split(".")[:2] if part.isascii() and part.isdigit() and len(part) < 4]
    name = "PhotoScan" if len(numbers) == 2 and tuple(numbers) < _RENAMED else "Metashape"
    return f"Agisoft {name} ({path.suffix.lower()})"


def _document(archive: _Archive, tag: str) -> Element:
    """Return the element ``tag`` of the doc.xml of an archive."""
    place = archive.path / _DOCUMENT
    root = elements_of(archive.read(_DOCUMENT, MOST_XML_BYTES), place, ExchangeError, _REMEDY)
    element = root.first(tag)
    if element is None:
        raise ExchangeError(f"{place}:1: has no element {tag}: {_REMEDY}")
    return element


def _chosen(path: Path, chunks: list[Element], label: str | None) -> Element:
    labels = [printable(shortened(chunk.attributes.get("label", ""))) for chunk in chunks]
    if label is not None:
        chunks = [chunk for chunk in chunks if chunk.attributes.get("label") == label]
    if len(chunks) != 1:
        which = "" if label is None else f" called {printable(shortened(label))}"
        raise ExchangeError(
            f"{path}: has {things(len(chunks), 'chunk')}{which} ({some(labels) or 'none'}): name one of them"
        )
    return chunks[0]


def _of_folder(path: Path, head: Element, label: str | None) -> tuple[Element, Element | None, _Cloud | None]:
    """Return the chunk of a `.psx` with the element ``head``, its first frame as its own archive has it, and its tie
    points."""
    project = _named(head, path.parent, "the path", head.attributes.get("path", "").replace(_PROJECT_NAME, path.stem))
    with closing(_Archive(project)) as archive:
        entries = _document(archive, "document").all("chunks", "chunk")
        files = dict.fromkeys(_named(entry, project.parent, "the path of a chunk") for entry in entries)
    chunks = []
    for file in files:
        with closing(_Archive(file)) as archive:
            chunks.append(_document(archive, "chunk"))
    chosen = _chosen(path, chunks, label)
    folder = next(file.parent for file, chunk in zip(files, chunks, strict=True) if chunk is chosen)
    entry = chosen.first("frames", "frame")
    if entry is None:
        return chosen, None, None
    with closing(_Archive(_named(entry, folder, "the path of a frame"))) as archive:
        frame = _document(archive, "frame")
    element = _cloud_element(frame)
    if element is None:
        return chosen, frame, None
    with closing(_Archive(_named(element, archive.path.parent, "the path of the tie points"))) as archive:
        root = elements_of(archive.read(_DOCUMENT, MOST_XML_BYTES), archive.path / _DOCUMENT, ExchangeError, _REMEDY)
        cloud = _cloud_element(root)
        return chosen, frame, None if cloud is None else _cloud_of(archive, cloud)


def _named(element: Element, folder: Path, what: str, name: str | None = None) -> Path:
    """Return the file within a folder that an element names by its attribute ``path``, or by ``name`` in its place."""
    return part_of(f"{element.place}: {what}", folder, element.attributes.get("path", "") if name is None else name)


def _cloud_element(frame: Element | None) -> Element | None:
    """Return the element of tie points of a frame; later versions call it tie_points, and the dense cloud as those
    before called it."""
    for tag in _CLOUDS:
        element = None if frame is None else frame.first(tag)
        if element is not None:
            return element
    return None


def _cloud_of(archive: _Archive, element: Element) -> _Cloud:
    def member(child: Element | None) -> bytes | None:
        name = "" if child is None else child.attributes.get("path", "")
        return archive.read(name) if name else None

    projections = []
    for child in element.all("projections"):
        data = member(child)
        if data is not None:
            projections.append((child.attributes.get("camera_id", ""), data))
    return _Cloud(
        str(archive.path), member(element.first("points")), member(element.first("tracks")), tuple(projections)
    )


def _vertices(place: str, what: str, data: bytes, *names: str) -> NDArray[np.void]:
    """Return the vertices of PLY data that have these properties. Raises ExchangeError where they are none."""
    try:
        vertices = vertices_of(data)
    except ValueError as error:
        raise ExchangeError(f"{place}: the PLY file of {what} cannot be read: {error}: {_REMEDY}") from error
    missing = [name for name in names if name not in (vertices.dtype.names or ())]
    if missing:
        raise ExchangeError(f"{place}: the PLY file of {what} has no property {missing[0]}: {_REMEDY}")
    return vertices


def _columns(vertices: NDArray[np.void], *names: str) -> FloatArray:
    with np.errstate(invalid="ignore"):  # a float that is a signalling NaN is refused as one that is not finite
        return np.column_stack([vertices[name].astype(np.float64) for name in names])


def _tie_points(chunk: Chunk, cloud: _Cloud) -> tuple[TiePoints, tuple[str, ...]]:
    """Return tie points with a position and their observations, and what is left out."""
    place = cloud.place
    if cloud.points is None:
        return no_tie_points(), ("Projections without points.",) if cloud.projections else ()
    points = _vertices(place, "points", cloud.points, "x", "y", "z", "id")
    ids = points["id"].astype(np.int64)
    position = _columns(points, "x", "y", "z")
    check_finite(place, "position of a tie point", position)
    check_distinct(place, "the id of a point", ids)
    photograph, point, feature, pixel = [], [], [], []
    unplaced = elsewhere = 0
    order = np.argsort(ids)
    for camera, data in cloud.projections:
        what = f"projections of camera {printable(shortened(camera))}"
        projected = _vertices(place, what, data, "x", "y", "id")
        if camera not in chunk.photograph_of:
            elsewhere += len(projected)
            continue
        xy, number = _columns(projected, "x", "y"), index_in(order, ids, projected["id"].astype(np.int64))
        check_finite(f"{place}: {what}", "a pixel", xy)
        known = number >= 0
        unplaced += int(len(known) - known.sum())
        photograph.append(np.full(int(known.sum()), chunk.photograph_of[camera]))
        point.append(number[known])
        feature.append(np.flatnonzero(known))
        pixel.append(xy[known])
    left_out = sentences(
        (unplaced, f"{things(unplaced, 'projection')} of points without a position."),
        (elsewhere, f"{things(elsewhere, 'projection')} in photographs that are not read."),
        (photograph, "The sizes of key points."),
    )
    none = [np.zeros(0, dtype=np.int64)]
    return tie_points_of(
        place,
        np.concatenate(photograph or none),
        np.concatenate(point or none),
        np.concatenate(pixel or [np.zeros((0, 2))]) - HALF_PIXEL,
        chunk.world.points(position),
        feature=np.concatenate(feature or none),
        sigma_px=chunk.tie_sigma_px or 1.0,
        colour=_colours(place, cloud, ids),
    ), tuple(left_out)


def _colours(place: str, cloud: _Cloud, ids: IntArray) -> ByteArray | None:
    """Return the colours (P, 3) of points, None where the project has none."""
    if cloud.tracks is None or not len(ids):
        return None
    tracks = _vertices(place, "tracks", cloud.tracks, "red", "green", "blue")
    if ids.max() >= len(tracks) or ids.min() < 0:
        raise ExchangeError(f"{place}: has a point {ids.max()} and only {things(len(tracks), 'track')}: {_REMEDY}")
    rgb = _columns(tracks, "red", "green", "blue")[ids]
    if not ((rgb >= 0) & (rgb <= 255)).all():
        raise ExchangeError(f"{place}: colours of tracks are not from 0 to 255: {_REMEDY}")
    return rgb.astype(np.uint8)
