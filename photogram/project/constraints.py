"""Constraints between points in a project file: distances, height differences, level surfaces, planes.

A ground point that nobody has surveyed takes part in the adjustment where a constraint of role control needs it;
otherwise its marks alone say where it is, as those of a check point.
"""

from collections.abc import Iterator, Sequence

from photogram.constraints.between_points import (
    FEWEST_ON,
    CommonSurface,
    Constraint,
    ConstraintKind,
    Distance,
    HeightDifference,
    SurfaceKind,
)
from photogram.geodesy.crs import NO_CRS
from photogram.project.document import Document, Key, given, suggestion
from photogram.project.schema import DistanceEntry, HeightDifferenceEntry, ProjectFile, SurfaceEntry

_Entry = DistanceEntry | HeightDifferenceEntry | SurfaceEntry
_KINDS: dict[str, ConstraintKind] = {
    "distances": "distance",
    "height_differences": "height difference",
    "level_surfaces": "level surface",
    "planes": "plane",
}


def _entries(file: ProjectFile) -> Iterator[tuple[str, int, _Entry]]:
    """Yield every constraint of a file with its key and its number under it."""
    for key in _KINDS:
        for i, entry in enumerate(getattr(file, key)):
            yield key, i, entry


def _names(entry: _Entry) -> tuple[str, ...]:
    return tuple((entry.points if isinstance(entry, SurfaceEntry) else entry.between) or ())


def used_points(file: ProjectFile) -> set[str]:
    """Return the names that constraints name, of photographs too."""
    return {name for _, _, entry in _entries(file) for name in _names(entry)}


def controlling_points(file: ProjectFile) -> set[str]:
    """Return the names that constraints of role control name."""
    return {name for _, _, entry in _entries(file) if entry.role == "control" for name in _names(entry)}


def check_constraints(
    document: Document, file: ProjectFile, points: set[str], photographs: set[str] | None, checks: set[str]
) -> None:
    """Note the errors of constraints: points and photographs that are none, too few or the same, check points under
    role control, what a network without georeference cannot have.

    ``points`` are all ground points, ``photographs`` the photographs, None where they are not known, ``checks`` the
    surveyed ground points of role check.
    """
    named: dict[tuple[str, str], int] = {}
    for key, i, entry in _entries(file):
        place: Key = (key, i, "points" if isinstance(entry, SurfaceEntry) else "between")
        text = _error_in(key, _names(entry), points, photographs)
        touched = next((n for n in _names(entry) if n in checks), None) if entry.role == "control" else None
        if not text and touched is not None:
            text = (
                f"{touched!r} is a check point, which a {_KINDS[key]} of role control would move: give it role: check "
                "here, or the point role: control"
            )
        if text:
            document.add_error(place, text)
        if entry.name is not None and named.setdefault((key, entry.name), i) != i:
            line = document.line((key, named[key, entry.name], "name"))
            document.add_error(
                (key, i, "name"), f"{entry.name!r} is used twice, first in line {line}: give each its own"
            )
    _check_free_network(document, file)


def _error_in(key: str, names: Sequence[str], points: set[str], photographs: set[str] | None) -> str:
    """Return what is wrong with the names of a constraint, empty for nothing."""
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        pair = key in ("distances", "height_differences")
        return f"both ends are {twice!r}: give two" if pair else f"{twice!r} stands there twice: name each point once"
    fewest = FEWEST_ON.get(_KINDS[key], 2)
    if names and len(names) < fewest:
        return f"a {_KINDS[key]} needs {fewest} points or more, found {len(names)}"
    if key != "distances":
        lost = next((name for name in names if name not in points), None)
        return "" if lost is None else f"there is no ground point {lost!r}: {suggestion(lost, points)}"
    if photographs is None:
        return ""
    lost = next((name for name in names if name not in points | photographs), None)
    if lost is not None:
        return f"there is no ground point or photograph {lost!r}: {suggestion(lost, points | photographs)}"
    if not (set(names) <= points or set(names) <= photographs):
        return "one end is a ground point, the other a photograph: give two of one kind"
    return ""


def _check_free_network(document: Document, file: ProjectFile) -> None:
    """Note what means nothing in a network without georeference: heights without a vertical, metres without a scale."""
    surveyed = any(point.position_m is not None for point in file.control_points.list) or file.control_points.files
    if file.crs != NO_CRS or surveyed:
        return
    scaled = any(distance.role == "control" for distance in file.distances)
    for key in ("height_differences", "level_surfaces"):
        if getattr(file, key):
            text = "crs: none without surveyed points has no vertical that heights could be counted along"
            document.add_error((key,), f"{text}: give control points, or remove them")
    for key, what in (("distances", "role: control to one of them"), ("planes", "a distance of role control")):
        if getattr(file, key) and not scaled:
            document.add_error(
                (key,), f"crs: none without surveyed points has no scale, so that metres say nothing: give {what}"
            )


def constraints_of(file: ProjectFile, photographs: Sequence[str]) -> tuple[Constraint, ...]:
    """Return the constraints of a file without errors; the ends of distances are ground points, or photographs."""
    of_pictures = set(photographs)
    kinds: tuple[tuple[SurfaceKind, Sequence[SurfaceEntry]], ...] = (
        ("level surface", file.level_surfaces),
        ("plane", file.planes),
    )
    surfaces = [
        CommonSurface(s.name or f"{i}", kind, _names(s), (given(s.sigma_m),) * len(_names(s)), s.role)
        for kind, entries in kinds
        for i, s in enumerate(entries, 1)
    ]
    return (
        *(
            Distance(
                ends=given(d.between),
                of_photographs=set(given(d.between)) <= of_pictures,
                length_m=given(d.length_m),
                sigma_m=given(d.sigma_m),
                role=d.role,
                name=d.name or "",
            )
            for d in file.distances
        ),
        *(
            HeightDifference(
                ends=given(h.between),
                difference_m=given(h.difference_m),
                sigma_m=given(h.sigma_m),
                role=h.role,
                name=h.name or "",
            )
            for h in file.height_differences
        ),
        *surfaces,
    )
