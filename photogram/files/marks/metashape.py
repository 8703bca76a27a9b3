"""Markers of Agisoft Metashape and PhotoScan as XML: points with coordinates, and their projections in photographs.

In Metashape the centre of the top-left pixel has the coordinates (0.5, 0.5) (Agisoft Metashape User Manual,
Professional Edition, appendix Camera models), so half a pixel is taken off. Pinned projections, the green flags, were
placed by people and are marks; the others are where Metashape expects a marker, and are proposals.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

from photogram.errors import ControlPointError
from photogram.files.atomic import replacing
from photogram.files.marks.corner_pixels import from_corner, to_corner
from photogram.files.tables.point_file import PointFile, check_marks, mark_of
from photogram.files.tables.surveyed_points import Mark, MarkSource, PartialSigma3, SurveyedPoint
from photogram.files.text_lines import SIGMA_M, Errors, text_of
from photogram.files.xml_elements import Element, elements_of
from photogram.geodesy.crs import crs_of_wkt
from photogram.survey import Roles
from photogram.wording import shortened, some

_REMEDY = "export the markers from Metashape again"
_BOM = "\ufeff"


def _root(path: Path) -> Element:
    return elements_of(text_of(path, ControlPointError).encode(), path, ControlPointError, _REMEDY)


def holds_metashape_markers(first_line: str) -> bool:
    """Return whether a text that begins so is XML."""
    return first_line.lstrip(_BOM).lstrip().startswith("<")


# ---- reading -------------------------------------------------------------------------------------------------------


def _one_chunk(path: Path, root: Element) -> Element:
    chunks = [*root.all("document", "chunk"), *root.all("document", "chunks", "chunk")]
    marked = [chunk for chunk in chunks if any(chunk.all("markers", "marker"))]
    if not marked:
        line = root.children[0].line if root.children else 1
        raise ControlPointError(f"{path}:{line}: holds no markers of Metashape: export them with Tools, Export Markers")
    if len(marked) > 1:
        raise ControlPointError(
            f"{path}:{marked[1].line}: holds markers of {len(marked)} chunks: export those of one chunk at a time"
        )
    return marked[0]


def _sigma_m(reference: Element, name: str, errors: Errors) -> PartialSigma3:
    """Return the accuracies: sx, sy and sz, or sxy and sz as before version 1.3."""
    sigmas = []
    for column in ("sx", "sy", "sz"):
        text = reference.attributes.get(column) or (reference.attributes.get("sxy") if column != "sz" else None)
        value = None if not text else errors.number(text, f"{column} of {name}", reference.line)
        if value is not None and not SIGMA_M[0] <= value <= SIGMA_M[1]:
            allowed = f"from {SIGMA_M[0]:g} to {SIGMA_M[1]:g}"
            errors.note(reference.line, f"{column} of {name} must be {allowed}, found {text}: correct it in Metashape")
        sigmas.append(value)
    return sigmas[0], sigmas[1], sigmas[2]


def _named(elements: Iterable[Element], what: str, errors: Errors) -> dict[str, tuple[str, Element]]:
    """Return the labels of elements by their numbers, which Metashape calls id."""
    named: dict[str, tuple[str, Element]] = {}
    lines: dict[str, int] = {}
    for element in elements:
        label, number = element.attributes.get("label", "").strip(), element.attributes.get("id", "")
        if not label or not number or not label.isprintable():
            errors.note(element.line, f"a {what} without a printable label: give it one in Metashape")
        elif errors.name(label, f"the label of a {what}", element.line) is not None:
            first = lines.setdefault(label, element.line)
            if what == "marker" and first != element.line:
                errors.note(
                    element.line, f"marker {label} is there twice, first in line {first}: rename one of the two"
                )
            named[number] = (label, element)
    return named


def _points(markers: Mapping[str, tuple[str, Element]], errors: Errors) -> list[SurveyedPoint]:
    points = []
    for label, element in markers.values():
        for reference in element.all("reference"):
            texts = [reference.attributes.get(axis, "") for axis in "xyz"]
            if not any(texts):
                continue
            whats = [f"{axis} of {label}" for axis in "xyz"]
            position = [errors.number(t, what, reference.line) for t, what in zip(texts, whats, strict=True)]
            sigma_m = _sigma_m(reference, label, errors)
            x, y, z = position
            if x is not None and y is not None and z is not None:
                is_check = reference.attributes.get("enabled", "true").lower() in ("false", "0")
                role: Roles | None = ("check", "check") if is_check else None
                points.append(SurveyedPoint(label, (x, y, z), sigma_m, role, line=reference.line))
    return points


def _photographs(chunk: Element, frame: Element | None, errors: Errors) -> dict[str, str]:
    """Return the names of photographs by the numbers of their cameras: the file's where it is told, else the label."""
    cameras = (camera for group in chunk.all("cameras") for camera in group.below("camera"))
    names = {number: label for number, (label, _) in _named(cameras, "camera", errors).items()}
    for camera in frame.all("cameras", "camera") if frame else ():
        for photo in camera.all("photo"):
            name = PurePosixPath(photo.attributes.get("path", "").replace("\\", "/")).name
            if name:
                names[camera.attributes.get("camera_id", "")] = name
    return names


def _one_frame(path: Path, chunk: Element) -> Element | None:
    frames = [frame for frame in chunk.all("frames", "frame") if any(frame.all("markers", "marker", "location"))]
    if len(frames) > 1:
        raise ControlPointError(f"{path}:{frames[1].line}: holds markers of {len(frames)} frames: export one at a time")
    return frames[0] if frames else None


@dataclass(frozen=True)
class MarkerFile:
    """What a file of markers holds."""

    points: PointFile
    """Markers with coordinates; the pinned projections of all markers are its ``marks``."""
    without_position: tuple[str, ...]
    """Names of markers that have projections and no coordinates."""
    proposals: tuple[Mark, ...]
    """Projections that are not pinned."""


def read_markers(path: Path) -> MarkerFile:
    """Return the markers of one chunk, marks in photogram's pixels; photographs have the name of their file where it is
    there, else the label of the camera, which may lack the suffix.

    Accuracies that the settings of the chunk give to all markers are not read. Raises ControlPointError with a line for
    each error, and where the file is no export of markers or has a document type, through which XML can do harm.
    """
    chunk = _one_chunk(path, _root(path))
    frame = _one_frame(path, chunk)
    errors = Errors(path, ControlPointError)
    markers = _named(chunk.all("markers", "marker"), "marker", errors)
    points, photographs = _points(markers, errors), _photographs(chunk, frame, errors)
    pinned: list[Mark] = []
    others: list[Mark] = []
    for marker in frame.all("markers", "marker") if frame else ():
        number = marker.attributes.get("marker_id", "")
        if number not in markers:
            errors.note(
                marker.line, f"marker_id {shortened(number)!r} is no marker of the chunk: export the markers again"
            )
            continue
        for location in marker.all("location"):
            mark = _mark(location, markers[number][0], photographs, errors)
            if mark is not None:
                (pinned if location.attributes.get("pinned", "").lower() in ("true", "1") else others).append(mark)
    check_marks((*pinned, *others), errors)
    if others and not pinned:
        text = f"none of the {len(others)} projections is pinned, so none is a mark: place the markers in Metashape"
        errors.note(others[0].source.line, f"{text}, which turns their flags green")
    errors.raise_all()
    placed = {point.name for point in points}
    bare = dict.fromkeys(mark.point for mark in pinned if mark.point not in placed)
    reference = chunk.first("reference")
    file = PointFile(
        path,
        crs_of_wkt("" if reference is None else reference.text),
        None,
        True,
        tuple(points),
        tuple(pinned),
        format="metashape",
    )
    return MarkerFile(file, tuple(bare), tuple(others))


def _mark(location: Element, point: str, photographs: Mapping[str, str], errors: Errors) -> Mark | None:
    camera = location.attributes.get("camera_id", "")
    if camera not in photographs:
        text = f"camera_id {shortened(camera)!r} of marker {point} is no camera of the chunk"
        errors.note(location.line, f"{text}: export the markers again")
        return None
    texts = [location.attributes.get(axis, "") for axis in "xy"]
    if None in [errors.number(t, f"{axis} of {point}", location.line) for t, axis in zip(texts, "xy", strict=True)]:
        return None
    pixel = (from_corner(texts[0]), from_corner(texts[1]))
    source = MarkSource(location.line, is_of_photogram=True)
    return mark_of((point, photographs[camera]), pixel, source, errors)


# ---- writing -------------------------------------------------------------------------------------------------------


def write_markers(
    path: Path,
    points: Sequence[SurveyedPoint],
    marks: Iterable[Mark],
    crs_wkt: str | None = None,
    proposals: Iterable[Mark] = (),
) -> None:
    """Write points and marks, pinned, and proposals, not pinned, for Metashape's Import Markers.

    ``crs_wkt`` is the CRS of the points as WKT. Points may have no marks, and marks no point of the list: their markers
    have no coordinates. Standard deviations of marks, correlations, kinds and times have no place in it, nor a role of
    plan and height each. Raises ControlPointError for such a role, WorkspaceError where the file cannot be written.
    """
    mixed = [point.name for point in points if point.role is not None and len(set(point.role)) > 1]
    if mixed:
        raise ControlPointError(
            f"{path}: Metashape has one role for plan and height of {some(mixed)}: give them one role"
        )
    placed = sorted(
        [*((mark, "true") for mark in marks), *((mark, "false") for mark in proposals)],
        key=lambda entry: entry[0].key,
    )
    own: dict[str, list[tuple[Mark, str]]] = {}
    for mark, pin in placed:
        own.setdefault(mark.point, []).append((mark, pin))
    given = {point.name: point for point in points}
    names = sorted({*given, *own})
    cameras = {name: str(i) for i, name in enumerate(sorted({mark.photograph for mark, _ in placed}))}
    document = ElementTree.Element("document", version="1.2.0")
    chunk = ElementTree.SubElement(document, "chunk")
    listed = ElementTree.SubElement(chunk, "cameras")
    for name, number in cameras.items():
        ElementTree.SubElement(listed, "camera", id=number, label=name)
    markers = ElementTree.SubElement(chunk, "markers")
    frame = ElementTree.SubElement(ElementTree.SubElement(chunk, "frames"), "frame", id="0")
    located = ElementTree.SubElement(frame, "markers")
    for i, name in enumerate(names):
        marker = ElementTree.SubElement(markers, "marker", id=str(i), label=name)
        if name in given:
            ElementTree.SubElement(marker, "reference", _reference(given[name]))
        if name not in own:
            continue
        place = ElementTree.SubElement(located, "marker", marker_id=str(i))
        for mark, pin in own[name]:
            x, y = map(to_corner, mark.pixel)
            ElementTree.SubElement(place, "location", camera_id=cameras[mark.photograph], pinned=pin, x=x, y=y)
    if crs_wkt is not None:
        ElementTree.SubElement(chunk, "reference").text = crs_wkt
    ElementTree.indent(document)
    text = '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(document, encoding="unicode") + "\n"
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def _reference(point: SurveyedPoint) -> dict[str, str]:
    sigmas = zip(("sx", "sy", "sz"), point.sigma_m, strict=True)
    position = () if point.position is None else zip("xyz", point.position, strict=True)
    return {
        **{axis: repr(float(value)) for axis, value in position},
        **{axis: repr(float(value)) for axis, value in sigmas if value is not None},
        "enabled": "false" if point.role == ("check", "check") else "true",
    }
