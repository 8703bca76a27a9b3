"""A triangulated surface as its file has it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.errors import ProjectError
from photogram.wording import shortened, some

LARGEST_COORDINATE = 1e9
"""Of a place in any unit: what is larger is damage."""


@dataclass(frozen=True, eq=False)
class Unit:
    """A unit of length."""

    name: str
    length_m: float


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Triangles (T) between places, in the unit of their file."""

    path: Path
    corner: FloatArray
    """Easting, northing and height (T, 3, 3) of the three corners of each triangle."""
    unit: Unit | None
    """Of all three coordinates; None where the file states none."""
    crs: str | None
    """EPSG:… or WKT; None where the file names none."""
    heights: str = ""
    """What the file says that its heights count from, in its own words."""


def triangles_of(path: Path, vertex: FloatArray, triangle: IntArray) -> FloatArray:
    """Return the corners (T, 3, 3) of triangles (T, 3) between vertices (V, 3). Raises ProjectError where a coordinate
    is damaged."""
    if not (np.abs(vertex) <= LARGEST_COORDINATE).all():
        raise ProjectError(f"surface {path}: a coordinate is damaged: export it again")
    return np.ascontiguousarray(vertex[triangle])


def chosen_parts(path: Path, triangles: Mapping[str, int], wanted: Sequence[str], what: str) -> list[str]:
    """Return which parts of a file are read, of all those with their numbers of ``triangles``: the ``wanted`` ones, or
    the only one. ``what`` is what a part is called. Raises ProjectError where there is none, several and none wanted,
    or one that is wanted is missing."""
    known = [name for name, count in triangles.items() if count]
    if not known:
        raise ProjectError(f"surface {path}: it contains no triangles: export the surface with its faces")
    shown = some([f"{shortened(name)!r} ({triangles[name]} triangles)" for name in known], 12)
    missing = [name for name in wanted if name not in known]
    if missing:
        raise ProjectError(f"surface {path}: no {what} {shortened(missing[0])!r} with triangles: it has {shown}")
    if not wanted and len(known) > 1:
        raise ProjectError(f"surface {path}: {len(known)} {what}s have triangles: choose (--part NAME) of {shown}")
    return list(wanted) or known
