"""Files of ground points in a draft: in which map grid, and in which order, their points lie among the photographs."""

from dataclasses import dataclass, replace

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import ProjectError
from photogram.geodesy.crs import NO_CRS, WGS84, neighbouring_zones
from photogram.geodesy.frames import map_from_geodetic
from photogram.gnss import Sigma3
from photogram.project.draft.sites import utm_crs
from photogram.survey import Role

NEAR_M = 20_000.0
"""Points whose median is nearer than this to the photographs lie among them."""


@dataclass(frozen=True, eq=False)
class ControlFile:
    """A file of ground points as the project names it; ``crs``, ``geographic`` and ``position`` (N, 3) as it says.

    ``grid`` is the map grid in which the points of a file that names none lie among the photographs, where that is not
    the one of the project, in which they would lie ``off_m`` away. Of a file whose order of coordinates is open
    ``columns`` are the names of its columns where it has to be read with northing before easting, ``turned`` these
    names until that is known. ``geodetic`` are longitude and latitude (N, 2) beside easting and northing. ``marks`` is
    the table of marks that its entry names, which has none yet where it is ``unmarked``. ``sigma_m`` and
    ``mark_sigma_px`` hold where the file has none.
    """

    path: str
    role: Role
    position: FloatArray
    crs: str | None = None
    geographic: bool | None = None
    has_marks: bool = True
    has_sigmas: bool = False
    marks: str | None = None
    unmarked: bool = False
    picture_size_px: tuple[int, int] | None = None
    sigma_m: Sigma3 | None = None
    grid: str | None = None
    off_m: float = 0.0
    columns: tuple[str, ...] = ()
    turned: tuple[str, ...] = ()
    geodetic: FloatArray | None = None

    @property
    def lacks_marks(self) -> bool:
        """Return whether nobody has marked its points yet, as far as files say."""
        return not self.has_marks and (self.marks is None or self.unmarked)


def fitting_zones(file: ControlFile, crs: str, middle: tuple[float, float]) -> list[str]:
    """Return the zones beside a map grid in which the points of a file lie among the photographs."""
    if not len(file.position):
        return []
    return [zone for zone in neighbouring_zones(crs) if _distance_m(file, zone, middle) <= NEAR_M]


def _distance_m(file: ControlFile, crs: str, middle: tuple[float, float]) -> float:
    """Return how far the points of a file lie from the photographs if they are in a map grid."""
    here = map_from_geodetic(crs, np.array([[*middle, 0.0]]))[0, :2]
    return float(np.hypot(*(np.median(file.position[:, :2], axis=0) - here)))


def in_fitting_order(file: ControlFile, crs: str, middle: tuple[float, float]) -> ControlFile:
    """Return a file whose order of coordinates is open with northing first, where only so its points lie among the
    photographs in ``crs`` or a zone beside it."""
    if crs == NO_CRS or not file.turned or not len(file.position):
        return file
    grids = (crs, *neighbouring_zones(crs)) if file.crs is None else (file.crs,)
    exchanged = replace(file, position=file.position[:, [1, 0, 2]], columns=file.turned)
    near = [min(_distance_m(f, grid, middle) for grid in grids) <= NEAR_M for f in (file, exchanged)]
    return replace(exchanged if near == [False, True] else file, turned=())


def _is_near(degrees: FloatArray, middle: tuple[float, float]) -> bool:
    """Return whether longitude and latitude (N, 2) lie among the photographs."""
    utm = utm_crs(*middle)
    points = map_from_geodetic(utm, np.column_stack([degrees, np.zeros(len(degrees))]))[:, :2]
    here = map_from_geodetic(utm, np.array([[*middle, 0.0]]))[0, :2]
    return float(np.hypot(*(np.median(points, axis=0) - here))) <= NEAR_M


def in_fitting_grid(
    file: ControlFile, crs: str, middle: tuple[float, float] | None, *, is_proposed: bool
) -> ControlFile:
    """Return a file that does not name its map grid with the zone beside ``crs`` in which its points lie among the
    photographs, where they do not in ``crs``. Raises ProjectError where there are several such zones, and where there
    is none and ``crs`` is only proposed from the photographs."""
    if crs == NO_CRS or middle is None or file.crs is not None or file.geographic or not len(file.position):
        return file
    distance_m = _distance_m(file, crs, middle)
    if distance_m <= NEAR_M:
        return file
    if file.geodetic is not None and _is_near(file.geodetic, middle):
        return replace(file, grid=WGS84, off_m=distance_m)
    fitting = fitting_zones(file, crs, middle)
    if len(fitting) == 1:
        return replace(file, grid=fitting[0], off_m=distance_m)
    if fitting or is_proposed:
        of_zones = ", ".join(fitting or neighbouring_zones(crs))
        others = f"among them in each of {of_zones}" if fitting else f"not among them in {of_zones} either"
        raise ProjectError(
            f"{file.path}: the file does not name its map grid; in {crs} its points would lie "
            f"{distance_m / 1000:.0f} km from the photographs, and {others}: give the file's map grid with --crs EPSG:…"
        )
    return file
