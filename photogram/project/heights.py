"""The height systems and the datum that a project file declares, and the positions in it brought to those of the map.

Errors are noted in the document where the file declares the systems.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from os.path import isfile  # false, not an exception, for a name that cannot be
from pathlib import Path

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import FrameError
from photogram.geodesy.crs import (
    NO_CRS,
    DeclaredDatum,
    changes_datum,
    crs_label,
    datum_change,
    height_system_of,
    map_units,
    middle_deg,
    plan_of,
    product_crs,
    projected_crs,
    vertical_of,
)
from photogram.geodesy.frames import LocalFrame, map_from_crs, map_heights
from photogram.geodesy.height_systems import GEOID_MODELS, DeclaredHeights, Geoid, HeightSystem, is_gnss_ellipsoid
from photogram.project.cross_checks import Located
from photogram.project.document import Document, Key
from photogram.project.folders import GRID_SUFFIXES
from photogram.project.schema import HeightsEntry, ProjectFile
from photogram.wording import shortened

_KEY: Key = ("heights",)


def read_heights(document: Document, file: ProjectFile) -> DeclaredHeights | None:
    """Return what the project declares of its heights, None where that cannot be; its errors are noted.

    A ``crs`` with a vertical part declares the system of results, of the positions in the file and of ground points
    that say nothing else.
    """
    entry, before = file.heights or HeightsEntry(), document.errors
    try:
        vertical = None if file.crs is None else vertical_of(file.crs)
        plan = None if file.crs is None or file.crs == NO_CRS else projected_crs(file.crs)
    except FrameError as error:
        if file.crs is not None and is_grid(file.crs):
            document.add_error(("crs",), f"its vertical part {error}")
        return None  # a plan that cannot be is noted with the positions
    if vertical is not None and entry.output == "ellipsoidal":
        says = f"must be orthometric, as the crs {shortened(str(file.crs))} says"
        text = f"{says}: remove the key, or the vertical part of the crs"
        document.add_error((*_KEY, "output"), text)
    output: HeightSystem | None = "orthometric" if vertical is not None else entry.output
    if file.heights is not None and output is None and not document.has((*_KEY, "output")):
        text = "is missing: write output: ellipsoidal or orthometric, the system of all results"
        document.add_error((*_KEY, "output"), text)
    geoid = _geoid(document, entry, vertical)
    needing = [name for name in ("output", "gnss", "control_points") if getattr(entry, name) == "orthometric"]
    of_files = [i for i, f in enumerate(file.control_points.files) if f.heights == "orthometric"]
    places: list[Key] = [
        *((*_KEY, name) for name in needing),
        *(("control_points", "files", i, "heights") for i in of_files),
        *([("comparison", "heights")] if file.comparison.heights == "orthometric" else []),
    ]
    if geoid is None and document.errors == before and places:
        text = f"orthometric needs a geoid: give heights.geoid: {', '.join(GEOID_MODELS)}, EPSG:… or the path of a grid"
        document.add_error(places[0], text)
    if output == "ellipsoidal" and plan is not None and not is_gnss_ellipsoid(plan):
        text = (
            f"{crs_label(str(file.crs))} ({plan.name}) has an ellipsoid other than that of GNSS, so its ellipsoidal "
            "heights are not those of GNSS: write orthometric with a geoid, or a crs on WGS 84 or ETRS89"
        )
        document.add_error((*_KEY, "output"), text)
    if document.errors > before:
        return None
    given: HeightSystem | None = "orthometric" if vertical is not None else None
    control_points = entry.control_points or given
    return DeclaredHeights(output, entry.gnss, entry.gnss or given, control_points, geoid, file.comparison.heights)


def read_datum(document: Document, file: ProjectFile) -> DeclaredDatum:
    """Return what the project says of the way of its positions into the datum of the map; a grid that is not there is
    noted."""
    path = None if file.datum_grid is None else str(document.base / file.datum_grid)
    if path is not None and not isfile(path):
        text = f"file {path} not found: give the path of a grid of datum shifts, relative to this file"
        document.add_error(("datum_grid",), text)
        path = None
    return DeclaredDatum(file.datum_accuracy_m, path)


def is_grid(crs: str) -> bool:
    """Return whether positions of a CRS are easting and northing: of a map grid, or of a local frame."""
    if crs == NO_CRS:
        return True
    try:
        projected_crs(crs)
    except FrameError:
        return False
    return True


def _geoid(document: Document, entry: HeightsEntry, vertical: str | None) -> Geoid | None:
    """Return the geoid that crs, ``geoid`` and ``grid`` name together; what is wrong with them is noted."""
    name, grid = entry.geoid, entry.grid
    if name is not None and Path(name).suffix.lower() in GRID_SUFFIXES:
        if grid is not None:
            document.add_error((*_KEY, "grid"), "is given here and as geoid: keep one of the two")
        name, grid = None, name
    key: Key = (*_KEY, "grid" if entry.grid is not None else "geoid")
    path = None if grid is None else str(document.base / grid)
    if path is not None and not isfile(path):
        document.add_error(key, f"file {path} not found: give the path of the geoid's grid, relative to this file")
        return None
    if name is not None:
        name = GEOID_MODELS.get(name.upper().replace(" ", "").replace("-", ""), name)
        name = name.upper() if name.upper().startswith("EPSG:") else name
    if name is not None and vertical is not None and name != vertical:
        document.add_error(
            (*_KEY, "geoid"), f"is {entry.geoid}, but the crs says {shortened(vertical)}: keep one of the two"
        )
        return None
    if name is None and vertical is None and path is None:
        return None
    geoid = Geoid(name or vertical, path)
    try:
        _ = geoid.crs
    except FrameError as error:
        document.add_error((*_KEY, "geoid"), str(error))
        return None
    return geoid


@dataclass(frozen=True, eq=False)
class Placed:
    """Positions of a file in the map."""

    map_m: FloatArray
    """Positions (N, 3)."""
    turned_map_m: FloatArray
    """Those of the same figures the other way round (N, 3)."""
    heights: HeightSystem | None
    """The system that their heights were given in."""


@dataclass(frozen=True)
class ProjectMap:
    """The map of a project, and what is declared of heights and of the way into its datum."""

    crs: str
    heights: DeclaredHeights
    datum: DeclaredDatum

    def placed(
        self,
        crs: str,
        declared: HeightSystem | None,
        otherwise: HeightSystem | None,
        given: FloatArray,
        *,
        exact: bool = False,
    ) -> Placed:
        """Return points (N, 3) of the CRS ``crs`` in the map.

        Their heights are as the CRS says, else as ``declared`` for the file, else as ``otherwise``. Raises FrameError
        as map_from_crs does, where CRS and file contradict each other, and where PROJ lacks the grid of the best way
        into the map's datum and ``datum`` accepts no less; a worse shift is not accepted at all of points that are to
        be ``exact``.
        """
        grid = self._checked_grid(crs, given, exact=exact)
        named, vertical = height_system_of(crs)
        if named is not None and declared is not None and named != declared:
            raise FrameError(f"{crs_label(crs)} has {named} heights, but heights says {declared}: keep one of the two")
        system = named or declared or otherwise
        own = self.heights.geoid is not None and self.heights.geoid.vertical == vertical
        product = product_crs(self.crs, self.heights)

        def in_plan(points: FloatArray, grid: str | None = None) -> FloatArray:
            if crs == self.crs:
                return map_units(product).in_metres(points)
            return map_from_crs(crs, plan_of(self.crs), points, grid)

        if vertical is not None and self.heights.output is not None and not own:
            # another levelling network than the project's: PROJ knows the way between them, or says what it lacks
            map_m = map_from_crs(crs, product, given, grid)
        else:
            map_m = map_heights(self.crs, self.heights, system, in_plan(given, grid))
        try:
            turned_map_m = in_plan(given[:, [1, 0, 2]])
        except FrameError:
            turned_map_m = np.full_like(map_m, np.nan)
        return Placed(map_m, turned_map_m, system)

    def _checked_grid(self, crs: str, given: FloatArray, *, exact: bool) -> str | None:
        """Return the file with the shifts from one datum to the other, None where none is needed or given."""
        if crs == self.crs or not changes_datum(crs, self.crs):
            return None
        place, datum = middle_deg(crs, given), self.datum
        if place is None:
            return datum.grid
        change = datum_change(crs, self.crs, place, datum.grid)
        accepted = datum.accuracy_m is not None and (change.is_null or not exact)
        if change.missing is not None and not accepted:
            raise FrameError(f"{change.loss}: {change.missing.remedy}, or give the points in the project's CRS")
        return datum.grid


def project_map(crs: str | None, heights: DeclaredHeights, datum: DeclaredDatum) -> ProjectMap | None:
    """Return the map of a project, None where its CRS is none: that is noted where the project names it."""
    return None if crs is None or not is_grid(crs) else ProjectMap(crs, heights, datum)


def listed_in_map(
    document: Document, file: ProjectFile, heights: DeclaredHeights, places: Sequence[Sequence[Located]]
) -> tuple[FloatArray, FloatArray]:
    """Return the ground points of the project's own list (G, 3) and the GNSS positions of its photographs (F, 3) in the
    map, NaN where one has none.

    A missing grid of the geoid, and one that does not reach to these positions or to ``places``, are noted. Nothing is
    done to positions of a document that has other errors.
    """
    control = _rows([p.position_m for p in file.control_points.list])
    gnss = _rows([p.gnss_m for p in file.photographs.list or ()])
    if document.errors or file.crs is None:
        return control, gnss
    known = [rows[np.isfinite(rows).all(axis=1)] for rows in (control, gnss)]
    others = _rows([(p.map_m[0], p.map_m[1], p.map_m[2]) for group in places for p in group])
    try:
        if heights.map_geoid is not None:
            LocalFrame(file.crs, (0.0, 0.0, 0.0), "grid", heights.map_geoid).geoid_height_m(np.vstack([*known, others]))
        for rows, own, given in zip((control, gnss), known, (heights.control_points, heights.gnss_given), strict=True):
            rows[np.isfinite(rows).all(axis=1)] = map_heights(file.crs, heights, given, own)
    except FrameError as error:
        document.add_error(_KEY if document.has(_KEY) else ("crs",), str(error).removeprefix("crs: "))
    return control, gnss


def _rows(positions: Sequence[tuple[float, float, float] | None]) -> FloatArray:
    return np.array([(np.nan,) * 3 if p is None else p for p in positions], dtype=np.float64).reshape(-1, 3)
