"""TIN surfaces of drawings, DXF: 3DFACE entities, polyface and polygon meshes, MESH entities of the model space."""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import ezdxf
import numpy as np
from ezdxf.document import Drawing
from ezdxf.entities.dxfentity import DXFEntity
from ezdxf.entities.mesh import Mesh
from ezdxf.entities.polyline import Polyface, Polyline
from ezdxf.entities.solid import Face3d
from ezdxf.lldxf.const import DXFError

from photogram.arrays import FloatArray
from photogram.errors import ProjectError
from photogram.files.reading import MEGABYTE, check_size
from photogram.files.triangulations.triangulation import Triangulation, Unit, chosen_parts, triangles_of
from photogram.wording import printable, shortened

MOST_BYTES = 500 * MEGABYTE
"""A drawing takes some ten times its size in memory."""

UNITS = {
    1: Unit("inches", 0.0254),
    2: Unit("feet", 0.3048),
    4: Unit("millimetres", 0.001),
    5: Unit("centimetres", 0.01),
    6: Unit("metres", 1.0),
    7: Unit("kilometres", 1000.0),
    14: Unit("decimetres", 0.1),
    21: Unit("US survey feet", 1200.0 / 3937.0),
}
"""Values of ``$INSUNITS``; 0 states none."""

_KINDS = "3DFACE POLYLINE MESH"

DAMAGE = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError, StopIteration)
"""What ezdxf raises where a file is damaged, beside its own errors."""


@contextmanager
def _silent() -> Iterator[None]:
    """Keep what ezdxf says of a file from the terminal: an error of ours says what is wrong."""
    log = logging.getLogger("ezdxf")
    before = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        log.setLevel(before)


def read_drawing(path: Path, parts: Sequence[str] = ()) -> Triangulation:
    """Return the triangles of a layer, or of several by their names; a face of four corners is cut into two.

    Raises ProjectError where the file is damaged or no DXF, has no faces, or has them on several layers and none is
    named.
    """
    layers, has_blocks, unit = _read(path)
    if not layers and has_blocks:
        raise ProjectError(f"surface {path}: faces may lie in its blocks, which are not read: explode them")
    wanted = chosen_parts(path, {name: len(corner) for name, corner in layers.items()}, parts, "layer")
    return Triangulation(path, np.concatenate([layers[name] for name in wanted]), unit, None)


def layers_of(path: Path) -> dict[str, int]:
    """Return the layers of a file with faces and how many triangles each has. Raises ProjectError where it is damaged
    or no DXF."""
    return {name: len(corner) for name, corner in _read(path)[0].items()}


def _read(path: Path) -> tuple[dict[str, FloatArray], bool, Unit | None]:
    """Return the triangles of each layer, whether there are blocks, and the unit. Raises ProjectError where the file is
    damaged or no DXF."""
    try:
        check_size(path, MOST_BYTES)
        with _silent():
            document = ezdxf.readfile(path)
            space = document.modelspace()
            layers: dict[str, list[FloatArray]] = {}
            for entity in space.query(_KINDS):
                for corner in _faces(path, entity):
                    layers.setdefault(str(entity.dxf.layer), []).append(corner)
            joined = {name: np.concatenate(corners) for name, corners in layers.items()}
            return joined, len(space.query("INSERT")) > 0, _unit(path, document)
    except ProjectError:
        raise
    except DXFError as error:
        words = printable(shortened(str(error)))
        raise ProjectError(f"surface {path}: is no drawing that is read ({words}): export it again as DXF") from error
    except OSError as error:
        words = error.strerror or printable(shortened(str(error)))
        raise ProjectError(f"surface {path}: cannot be read ({words}): export it again as DXF") from error
    except DAMAGE as error:
        raise ProjectError(f"surface {path}: is a damaged drawing: export it again as DXF") from error


def _faces(path: Path, entity: DXFEntity) -> Iterator[FloatArray]:
    """Give the triangles (N, 3, 3) of an entity, none of a line."""
    if isinstance(entity, Face3d):
        yield _cut(path, np.array([corner.xyz for corner in entity.wcs_vertices()], dtype=np.float64))
    elif isinstance(entity, Mesh):
        vertex = np.array([tuple(place) for place in entity.vertices], dtype=np.float64).reshape(-1, 3)
        for face in entity.faces:
            yield _cut(path, vertex[_within(path, list(face), len(vertex))])
    elif isinstance(entity, Polyface):
        for corners in entity.faces():
            places = [corner.dxf.location.xyz for corner in list(corners)[:-1]]  # the last one is the face itself
            yield _cut(path, np.array(places, dtype=np.float64))
    elif isinstance(entity, Polyline) and entity.is_polygon_mesh:
        rows, columns = int(entity.dxf.m_count), int(entity.dxf.n_count)
        place = np.array([corner.dxf.location.xyz for corner in entity.vertices], dtype=np.float64)
        if len(place) != rows * columns:
            raise ProjectError(f"surface {path}: a mesh of {rows} × {columns} has {len(place)} vertices: export again")
        number = np.arange(rows * columns).reshape(rows, columns)
        a, b, c, d = (
            number[i : rows - 1 + i, j : columns - 1 + j].ravel() for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))
        )
        yield triangles_of(path, place, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])]))


def _within(path: Path, numbers: list[int], count: int) -> list[int]:
    if not all(0 <= number < count for number in numbers):
        raise ProjectError(f"surface {path}: a face names a vertex that its mesh has not: export it again")
    return numbers


def _cut(path: Path, corner: FloatArray) -> FloatArray:
    """Return a face (N, 3) as triangles (N − 2, 3, 3) around its first corner, none where it has fewer than three."""
    keep = np.r_[True, (np.diff(corner, axis=0) != 0.0).any(axis=1)] if len(corner) else np.zeros(0, dtype=bool)
    corner = corner[keep]
    if len(corner) < 3:
        return np.zeros((0, 3, 3))
    number = np.arange(1, len(corner) - 1)
    return triangles_of(path, corner, np.column_stack([np.zeros_like(number), number, number + 1]))


def _unit(path: Path, document: Drawing) -> Unit | None:
    code = int(document.header.get("$INSUNITS", 0))
    if code and code not in UNITS:
        raise ProjectError(f"surface {path}: $INSUNITS {code}: export it in metres or in feet")
    return UNITS.get(code)
