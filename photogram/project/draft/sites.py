"""Where and when photographs were taken: sites, flights, and the UTM zone.

Sites are single-linkage clusters of the positions; a flight is a chain of photographs of one camera body without a
long pause.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import FloatArray, IntArray
from photogram.errors import FrameError
from photogram.project.positions.frozen import clusters

METRES_PER_DEGREE = 111_195.0
"""Along a meridian of a sphere of 6371 km."""

PAUSE_S = 600.0
"""A longer pause between photographs ends a flight: a change of battery takes a few minutes, and gives GNSS a new
offset."""

SMALLEST_GAP_M, LARGEST_GAP_M = 500.0, 5000.0
GAP_IN_SPACINGS = 5.0


@dataclass(frozen=True)
class Exposure:
    """When and where one photograph was taken, and by which camera body; None where the tags do not say.

    ``position_m`` is east and north as local_metres gives them.
    """

    name: str
    body: str
    time: datetime | None
    position_m: tuple[float, float] | None


def middle_of(longitude_deg: FloatArray, latitude_deg: FloatArray) -> tuple[float, float]:
    """Return the median longitude and latitude in degrees, also where the photographs lie across the 180th meridian."""
    first = float(longitude_deg[0])
    longitude = first + float(np.median((longitude_deg - first + 180.0) % 360.0 - 180.0))
    return (longitude + 180.0) % 360.0 - 180.0, float(np.median(latitude_deg))


def local_metres(longitude_deg: FloatArray, latitude_deg: FloatArray) -> FloatArray:
    """Return east and north (N, 2) in metres from the middle of positions in degrees, on a sphere.

    Good to one in a thousand within a survey, and good enough to tell one site from another.
    """
    longitude, latitude = middle_of(longitude_deg, latitude_deg)
    east = (longitude_deg - longitude + 180.0) % 360.0 - 180.0
    scale = np.array([np.cos(np.radians(latitude)), 1.0]) * METRES_PER_DEGREE
    return np.asarray(np.column_stack([east, latitude_deg - latitude]) * scale)


def gap_between_sites_m(position_m: FloatArray) -> float:
    """Return the distance across which two photographs belong to different sites.

    Five times the usual distance to the nearest neighbour, so that a lost strip does not split a survey; at least
    500 m, because a photograph left out by mistake is worse than one too many, which the orientation will notice; at
    most 5 km, which no survey's photographs are apart, or a folder of single photographs would make one site.
    """
    if len(position_m) < 2:
        return SMALLEST_GAP_M
    nearest_m = np.atleast_2d(cKDTree(position_m).query(position_m, k=2)[0])
    spacing = float(np.median(nearest_m[:, 1]))
    return float(np.clip(GAP_IN_SPACINGS * spacing, SMALLEST_GAP_M, LARGEST_GAP_M))


def group_sites(position_m: FloatArray, gap_m: float) -> IntArray:
    """Return the site (N,) of each position (N, 2): 0 the one with most photographs, then the next.

    Good to a tenth of the gap, as ``clusters``.
    """
    labels = clusters(position_m, gap_m)
    _, first, counts = np.unique(labels, return_index=True, return_counts=True)
    rank = np.empty(len(counts), dtype=np.int64)
    rank[np.lexsort((first, -counts))] = np.arange(len(counts))
    return np.asarray(rank[labels])


def _clock(exposure: Exposure) -> datetime:
    """Return the camera's own clock: one camera gives its zone always or never, two are not compared to the second."""
    return datetime.max if exposure.time is None else exposure.time.replace(tzinfo=None)


def _follows(earlier: Exposure, later: Exposure, gap_m: float) -> bool:
    if earlier.time is None or later.time is None or earlier.body != later.body:
        return False
    pause = (_clock(later) - _clock(earlier)).total_seconds()
    if not 0.0 <= pause <= PAUSE_S:
        return False
    if earlier.position_m is None or later.position_m is None:
        return True
    return float(np.hypot(*np.subtract(earlier.position_m, later.position_m))) <= gap_m


def separate_flights(exposures: Sequence[Exposure], gap_m: float) -> list[str]:
    """Return the flight of each photograph, "1", "2" and so on in the order of time.

    A photograph continues the flight of its camera body whose last photograph is at most PAUSE_S older and at most
    ``gap_m`` away. Photographs without a time join the flight of the one before them in the order of names.
    """
    timed = [i for i, e in enumerate(exposures) if e.time is not None]
    timed.sort(key=lambda i: (_clock(exposures[i]), exposures[i].name))
    last: list[int] = []
    flight: dict[int, int] = {}
    for i in timed:
        open_flights = [f for f, j in enumerate(last) if _follows(exposures[j], exposures[i], gap_m)]
        if open_flights:
            flight[i] = max(open_flights, key=lambda f: _clock(exposures[last[f]]))
            last[flight[i]] = i
        else:
            flight[i] = len(last)
            last.append(i)
    current = 0
    for i in sorted(range(len(exposures)), key=lambda i: exposures[i].name):
        current = flight.setdefault(i, current)
    return [str(flight[i] + 1) for i in range(len(exposures))]


def utm_crs(longitude_deg: float, latitude_deg: float) -> str:
    """Return the EPSG code of the WGS 84 / UTM zone of a position, Norway's exceptions included.

    Raises FrameError near the poles, where UTM ends.
    """
    if not -80.0 <= latitude_deg <= 84.0:
        raise FrameError(
            f"crs: UTM ends at 80° south and 84° north, the photographs lie at latitude {latitude_deg:.2f}: "
            "give the map grid with --crs, EPSG:3413 for example"
        )
    zone = int((longitude_deg + 180.0) % 360.0 // 6.0) + 1
    if 56.0 <= latitude_deg < 64.0 and 3.0 <= longitude_deg < 12.0:
        zone = 32
    elif latitude_deg >= 72.0 and 0.0 <= longitude_deg < 42.0:
        zone = 31 + 2 * int((longitude_deg + 3.0) // 12.0)
    return f"EPSG:{(32600 if latitude_deg >= 0 else 32700) + zone}"
