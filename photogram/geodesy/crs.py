"""Coordinate reference systems by name: kinds, height systems, zones, how products state them, and how positions come
from one datum into another in plan.

Between two datums PROJ knows several operations, each with an accuracy; the better ones need a grid of shifts, which an
installation may lack. PROJ then takes a worse one and says nothing. ``datum_change`` compares the two.
"""

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import PurePath
from typing import Any

import numpy as np
from pyproj import CRS, Transformer, proj_version_str
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from photogram.arrays import FloatArray
from photogram.errors import FrameError
from photogram.geodesy.height_systems import (
    DeclaredHeights,
    Geoid,
    HeightSystem,
    around,
    check_grid_path,
    crs_name,
    full_crs,
    how_to_fetch,
    in_metres,
    is_gnss_ellipsoid,
    vertical_crs,
)
from photogram.wording import printable, shortened

NO_CRS = "none"
"""What stands for the CRS of a survey in a Cartesian system of its own, which no map knows."""

WGS84 = "EPSG:4326"
"""The CRS of positions in tags, and of GNSS files in longitude and latitude."""

_PLACES = 1  # decimals of a degree: operations are chosen anew some 10 km farther on
_MOST_M = 1000.0
"""Datums lie less than this apart."""

_EPSG_AT_END = re.compile(r'(?:AUTHORITY|ID)\["EPSG",\s*"?(\d+)"?\]\]\s*$')
_SYMBOLS = {"metre": "m", "foot": "ft", "US survey foot": "ftUS"}
_SHORTEST_UNIT_M, _LONGEST_UNIT_M = 0.1, 2.0
"""Of maps on which lengths are counted: feet and metres, not degrees, chains or kilometres."""

_LONGEST_LABEL = 60  # characters

_ZONE = re.compile(r"(.*\bzone )(\d+)(.*)")


def any_crs(name: str) -> CRS:
    """Return the CRS called ``name``. Raises FrameError where PROJ does not know it, and for NO_CRS."""
    if name == NO_CRS:
        raise FrameError("crs: none: a local frame has no map grid: name the CRS of the site for what needs one")
    try:
        return CRS.from_user_input(name)
    except CRSError as error:
        raise FrameError(
            f"crs: {shortened(name)!r}: not a CRS known to PROJ (expected e.g. EPSG:25832), nor a file of its WKT"
        ) from error


def projected_crs(name: str) -> CRS:
    """Return the plan of the CRS called ``name`` (EPSG:25832, a PROJ string, WKT), in its own unit. Raises FrameError
    unless it is a map grid, or a local grid derived from one, whose axes have one unit of length."""
    crs = any_crs(name)
    horizontal = _upper(crs)
    if not (horizontal.is_projected or _is_derived(horizontal)):
        raise FrameError(
            f"crs: {shortened(name)!r} ({crs.name}) is not a projected CRS: choose a map grid, for example the UTM "
            "zone of the site"
        )
    units = {axis.unit_name for axis in horizontal.axis_info[:2]}
    factors = {axis.unit_conversion_factor for axis in horizontal.axis_info[:2]}
    if len(factors) != 1 or not _SHORTEST_UNIT_M <= min(factors) <= _LONGEST_UNIT_M:
        raise FrameError(
            f"crs: {shortened(name)!r} ({crs.name}) is in {', '.join(sorted(units))}: choose a map grid in metres or "
            "in feet"
        )
    return horizontal


def is_geographic(name: str) -> bool:
    """Return whether the CRS called ``name``, or the part of it in plan, has longitude and latitude. Raises FrameError
    where PROJ does not know it."""
    return bool(_upper(any_crs(name)).is_geographic)


def crs_of_wkt(wkt: str) -> str | None:
    """Return a CRS by the EPSG code with which its WKT ends, else as WKT; None for local coordinates and for none."""
    text = " ".join(wkt.split())
    if not text or text.upper().startswith(("LOCAL_CS", "ENGCRS", "ENGINEERINGCRS")):
        return None
    code = _EPSG_AT_END.search(text)
    return f"EPSG:{code[1]}" if code else printable(text)


def short_name(name: str) -> str:
    """Return a CRS by its EPSG code, or codes, where it has such; else as it is named. Raises FrameError where PROJ
    does not know it."""
    return name if name == NO_CRS else crs_name(any_crs(name))


def metric_crs(name: str) -> CRS:
    """Return the plan of the CRS called ``name`` with metres for its unit: the `map` in which photogram computes.
    Raises FrameError as projected_crs."""
    return in_metres(projected_crs(name))


def is_on_gnss_ellipsoid(name: str) -> bool:
    """Return whether the CRS called ``name`` is on the ellipsoid of GNSS. Raises FrameError where PROJ does not know
    it."""
    return is_gnss_ellipsoid(any_crs(name))


def metric_only(name: str) -> CRS:
    """Return the plan of the CRS called ``name`` where it counts metres, for coordinates that are not converted.
    Raises FrameError as projected_crs, and where it counts anything else."""
    crs = projected_crs(name)
    if crs.axis_info[0].unit_conversion_factor != 1.0:
        raise FrameError(
            f"crs: {shortened(name)!r} ({crs.name}) is in {crs.axis_info[0].unit_name}: choose a map grid in metres"
        )
    return crs


@dataclass(frozen=True)
class MapUnits:
    """The units in which a CRS counts easting and northing, and heights; those of files, never of what is computed."""

    plan_m: float = 1.0
    """A unit of easting and northing in metres."""
    height_m: float = 1.0
    """A unit of height in metres."""
    plan: str = "metre"
    """What PROJ calls the unit of easting and northing."""
    height: str = "metre"
    """What PROJ calls the unit of height."""

    @property
    def factors(self) -> FloatArray:
        """Metres to the unit of easting, northing and height (3,)."""
        return np.array([self.plan_m, self.plan_m, self.height_m])

    def in_metres(self, points: FloatArray) -> FloatArray:
        """Return points (N, 3) in m, of easting, northing and height in these units, as files give them."""
        return np.asarray(np.asarray(points, dtype=np.float64).reshape(-1, 3) * self.factors)

    def from_metres(self, points_m: FloatArray) -> FloatArray:
        """Return points (N, 3) in these units, the reverse of ``in_metres``."""
        return np.asarray(np.asarray(points_m, dtype=np.float64).reshape(-1, 3) / self.factors)

    @property
    def is_metric(self) -> bool:
        """Whether all three are in metres."""
        return self.plan_m == self.height_m == 1.0

    @property
    def plan_symbol(self) -> str:
        """Symbol of the unit of easting and northing: m, ftUS, ft."""
        return _SYMBOLS.get(self.plan, self.plan.replace(" ", "_"))

    @property
    def height_symbol(self) -> str:
        """Symbol of the unit of height."""
        return _SYMBOLS.get(self.height, self.height.replace(" ", "_"))

    @property
    def words(self) -> str:
        """The units in a sentence."""
        if self.plan == self.height:
            return self.plan
        return f"{self.plan}, heights in {self.height}"


METRES = MapUnits()
"""Of most maps, and of a local frame."""


def map_units(name: str) -> MapUnits:
    """Return the units of the CRS called ``name``: those of its axes, and for heights that of its plan where it has no
    vertical axis. Raises FrameError as projected_crs."""
    if name == NO_CRS:
        return METRES
    crs = any_crs(name)
    plan = projected_crs(name).axis_info[0]
    upright = next((axis for axis in crs.axis_info if axis.direction == "up"), plan)
    return MapUnits(
        float(plan.unit_conversion_factor),
        float(upright.unit_conversion_factor),
        str(plan.unit_name),
        str(upright.unit_name),
    )


def _upper(crs: CRS) -> CRS:
    return crs.sub_crs_list[0] if crs.is_compound else crs


def _is_derived(crs: CRS) -> bool:
    """Return whether a CRS is a map grid that was moved, turned or scaled, which pyproj does not call projected."""
    return str(crs.type_name) == "Derived Projected CRS"


def vertical_of(name: str) -> str | None:
    """Return the vertical CRS within the map ``name`` (EPSG:25832+5799), None where it has none.

    Raises FrameError as projected_crs, and where its heights are not lengths upwards.
    """
    if name == NO_CRS:
        return None
    projected_crs(name)
    vertical = height_system_of(name)[1]
    if vertical is not None:
        vertical_crs(vertical)
    return vertical


def height_system_of(name: str) -> tuple[HeightSystem | None, str | None]:
    """Return the system of the heights that a CRS of any kind names, None where it names none, and its vertical CRS
    where it is compound. Raises FrameError where PROJ does not know the CRS."""
    if name == NO_CRS:
        return None, None
    crs = any_crs(name)
    if crs.is_compound:
        code = crs.sub_crs_list[1].to_epsg()
        return "orthometric", f"EPSG:{code}" if code is not None else str(crs.sub_crs_list[1].to_wkt())
    spatial = any(axis.direction == "up" for axis in crs.axis_info) and is_gnss_ellipsoid(crs)
    return ("ellipsoidal" if spatial else None), None


@lru_cache(maxsize=64)
def plan_of(name: str) -> str:
    """Return the map ``name`` without a vertical part. Raises FrameError as projected_crs."""
    if name == NO_CRS:
        return name
    plan, crs = projected_crs(name), CRS.from_user_input(name)
    return crs_name(flat_crs(plan)) if crs.is_compound or len(crs.axis_info) > 2 else name


def same_plan(first: str, second: str) -> bool:
    """Return whether two CRS are the same map grid, whatever they say of heights and of the order of the axes. Raises
    FrameError where one is none."""
    a, b = (CRS.from_user_input(plan_of(name)).to_2d() for name in (first, second))
    return a == b or bool(a.equals(b, ignore_axis_order=True))


_HEMISPHERES = {"N": "S", "S": "N"}


def neighbouring_zones(name: str) -> tuple[str, ...]:
    """Return the codes of the other zones that a map grid, one of several of a datum, is mistaken for: up to three on
    each side, the nearest first, and the one of its number in the other hemisphere; none of a map without zones, or
    without a code. Raises FrameError as projected_crs."""
    if name == NO_CRS:
        return ()
    plan = projected_crs(name)
    code, zoned = plan.to_epsg(), _ZONE.fullmatch(plan.name)
    if code is None or zoned is None:
        return ()
    zones = []
    for step in (1, -1, 2, -2, 3, -3):
        try:
            other = _ZONE.fullmatch(projected_crs(f"EPSG:{code + step}").name)
        except FrameError:
            continue  # the codes beside the first and the last zone mean something else, or nothing
        if other is not None and (other[1], other[3]) == (zoned[1], zoned[3]):
            zones.append(f"EPSG:{code + step}")
    return (*zones, *_other_hemisphere(zoned))


def _other_hemisphere(zoned: re.Match[str]) -> tuple[str, ...]:
    """Return the code of the zone of the same number in the other hemisphere, none where its datum has none there."""
    if zoned[3] not in _HEMISPHERES:
        return ()
    try:
        code = projected_crs(f"{zoned[1]}{zoned[2]}{_HEMISPHERES[zoned[3]]}").to_epsg()
    except FrameError:
        return ()
    return () if code is None else (f"EPSG:{code}",)


def crs_in_metres(name: str) -> str:
    """Return the name of a map that counts metres, else the WKT of the same map in metres. Raises FrameError as
    projected_crs."""
    return name if name == NO_CRS or map_units(name).plan_m == 1.0 else crs_name(metric_crs(name))


@lru_cache(maxsize=64)
def product_crs(crs: str, heights: DeclaredHeights) -> str:
    """Return the CRS of every product: ``crs``, with what the heights are counted from where that is declared."""
    if heights.output is None or crs == NO_CRS:
        return crs
    return crs_name(full_crs(projected_crs(crs), heights.output, heights.geoid))


def crs_in_words(crs: str, heights: DeclaredHeights) -> str:
    """Return the CRS of results for people: its code or name, what its heights are counted from where that is declared,
    and its units where they are not metres."""
    words = crs_label(crs)
    if heights.output is not None:
        words += f", heights above {surface_in_words(heights.map_geoid)}"
    if crs == NO_CRS or map_units(product_crs(crs, heights)).is_metric:
        return words
    return f"{words}, in {map_units(product_crs(crs, heights)).words}"


def surface_in_words(geoid: Geoid | None) -> str:
    """Return what heights are above, the ellipsoid without a ``geoid``."""
    if geoid is None:
        return "the ellipsoid"
    return f"the plane {geoid.name}" if geoid.is_plane else f"the geoid {geoid.name}"


def crs_label(name: str) -> str:
    """Return a CRS in a few words: as it is written, or its own name where that is WKT."""
    return name if len(name) <= _LONGEST_LABEL else str(any_crs(name).name)


def written_crs(name: str) -> CRS | None:
    """Return the CRS ``name`` as products carry it, with its vertical axis where it has one, None for a local frame.
    Raises FrameError unless it is a map grid."""
    if name == NO_CRS:
        return None
    plan = projected_crs(name)
    crs = CRS.from_user_input(name)
    return crs if crs.is_compound else plan


def esri_wkt(name: str) -> str:
    """Return the plan of the map ``name`` as a ``.prj`` file holds it: WKT as ESRI writes it, or of the second edition
    where that has no word for it. Raises FrameError as projected_crs."""
    plan = flat_crs(projected_crs(name))
    try:
        return str(plan.to_wkt("WKT1_ESRI"))
    except CRSError:
        return str(plan.to_wkt())


def crs_title(crs: str) -> str:
    """Return what a CRS is called: `ETRS89 / UTM zone 32N` for EPSG:25832. Raises FrameError for an unknown one."""
    if crs == NO_CRS:
        return "local frame"
    return str(projected_crs(crs).name)


def proj_version() -> str:
    """Return the version of PROJ."""
    return str(proj_version_str)


def flat_crs(crs: CRS) -> CRS:
    """Return the plan of a CRS of any kind, without a third axis."""
    return _upper(crs).to_2d()


# ---- from one datum into another -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DeclaredDatum:
    """What a project says of the way of its positions into the datum of the map."""

    accuracy_m: float | None = None
    """Standard deviation, along easting and northing, of an error common to all GNSS positions that is accepted; None
    where nothing is."""
    grid: str | None = None
    """File of the grid that the best operation needs, None to take those that PROJ has."""


UNDECLARED_DATUM = DeclaredDatum()
"""Of a survey whose project says nothing of it."""


@dataclass(frozen=True)
class MissingGrid:
    """A grid that PROJ lacks, and what it would give."""

    name: str
    """Its file, as PROJ calls it."""
    others: tuple[str, ...]
    """Files that serve as well, of neighbouring regions for example."""
    package: str
    """What it comes in."""
    url: str
    """Where it is to be had, empty where PROJ knows no place."""
    accuracy_m: float
    """Accuracy of the operation with it, as PROJ states it."""

    @property
    def remedy(self) -> str:
        """How to get it."""
        return how_to_fetch(self.name, self.url, "datum_grid")


@dataclass(frozen=True)
class DatumChange:
    """How positions of one datum come into another in plan, at one place."""

    source: str
    """Name of the CRS that they come from: WGS 84 for example."""
    target: str
    """Code and name of the map."""
    operation: str
    """The operation that is used."""
    accuracy_m: float | None
    """Its accuracy as PROJ states it, None where it states none."""
    is_null: bool
    """Whether it takes the two datums as one."""
    missing: MissingGrid | None
    """The grid without which a better operation cannot be used, None where the best one is."""

    @property
    def loss(self) -> str:
        """What the missing grid costs, in words. Raises ValueError where none is missing."""
        if self.missing is None:
            raise ValueError("no grid is missing")
        others = f" (or {', '.join(self.missing.others)})" if self.missing.others else ""
        without = "nothing is known of them" if self.accuracy_m is None else f"they are right to {self.accuracy_m:g} m"
        return (
            f"PROJ lacks the grid {self.missing.name}{others} of the package {self.missing.package}, which brings "
            f"positions from {self.source} to {self.target} to {self.missing.accuracy_m:g} m; without it {without}"
        )


def changes_datum(source: str, target: str) -> bool:
    """Return whether positions of the CRS ``source`` change their datum on the way to ``target``. Raises FrameError
    where PROJ does not know one of them; a system of its own has no datum."""
    if NO_CRS in (source, target):
        return False
    given, wanted = any_crs(source).geodetic_crs, any_crs(target).geodetic_crs
    if given is None or wanted is None:
        return False
    return not given.to_2d().equals(wanted.to_2d(), ignore_axis_order=True)


def _rounded(place_deg: Sequence[float]) -> tuple[float, float]:
    longitude, latitude = (round(float(x), _PLACES) for x in place_deg)
    return longitude, latitude


def middle_deg(source: str, points: FloatArray) -> tuple[float, float] | None:
    """Return longitude and latitude of the median of points (N, 2 or more) of a CRS, to 0.1°; None where there is none,
    or where they lie nowhere on the globe."""
    known = points[np.isfinite(points[:, :2]).all(axis=1), :2]
    if not len(known):
        return None
    plan = flat_crs(any_crs(source))
    place = Transformer.from_crs(plan, WGS84, always_xy=True).transform(*np.median(known, axis=0))
    longitude, latitude = place
    return _rounded(place) if abs(longitude) <= 180.0 and abs(latitude) <= 90.0 else None


@lru_cache(maxsize=64)
def _operations(source: str, target: str, place_deg: tuple[float, float]) -> TransformerGroup:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of grids that are missing: said by the caller, with what to do
        return TransformerGroup(
            flat_crs(any_crs(source)), flat_crs(any_crs(target)), always_xy=True, area_of_interest=around(place_deg)
        )


@dataclass(frozen=True, eq=False)
class _WithGrid:
    """An operation with its grid read from a file; it takes and returns coordinates in the order of the CRS's axes,
    exchanged where ``swapped`` says so."""

    transformer: Transformer
    name: str
    accuracy_m: float | None
    swapped: tuple[bool, bool]

    def transform(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return easting and northing (N, 2) of longitude and latitude, or easting and northing (N,)."""
        given = (y, x) if self.swapped[0] else (x, y)
        result = np.column_stack(self.transformer.transform(*given))
        return result[:, ::-1] if self.swapped[1] else result

    def inverse(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return longitude and latitude, or easting and northing (N, 2), of easting and northing (N,)."""
        given = (y, x) if self.swapped[1] else (x, y)
        result = np.column_stack(self.transformer.transform(*given, direction="INVERSE"))
        return result[:, ::-1] if self.swapped[0] else result


def _northing_first(crs: CRS) -> bool:
    return bool(crs.axis_info[0].direction == "north")


def _stem(name: str) -> str:
    return PurePath(name).stem.lower()


def _grids_of(operation: Any) -> list[Any]:  # noqa: ANN401 - a Transformer or a CoordinateOperation
    steps = getattr(operation, "operations", None) or ()
    return [*getattr(operation, "grids", ()), *(grid for step in steps for grid in step.grids)]


def _stated_m(accuracy: float) -> float | None:
    return float(accuracy) if accuracy >= 0.0 else None


def _check_shift(source: str, target: str, place_deg: tuple[float, float], grid: str, operation: _WithGrid) -> None:
    """Raise FrameError where a grid moves positions as no datum does: it is another one than its name says."""
    x, y = Transformer.from_crs(WGS84, flat_crs(any_crs(source)), always_xy=True).transform(*place_deg)
    without = Transformer.from_crs(flat_crs(any_crs(source)), flat_crs(any_crs(target)), always_xy=True)
    shift = operation.transform(np.array([x]), np.array([y]))[0] - without.transform(x, y)
    shift_m = float(np.hypot(*shift)) * map_units(target).plan_m
    if np.isfinite(shift_m) and shift_m > _MOST_M:
        raise FrameError(
            f"datum_grid {grid}: it moves positions by {shift_m:.0f} m here, which no datum does: give the grid that "
            "its name says"
        )


@lru_cache(maxsize=64)
def _with_grid(source: str, target: str, place_deg: tuple[float, float], grid: str) -> _WithGrid:
    """Return the operation whose grid is the file ``grid``; PROJ's name of it holds that of the file or the reverse.

    Raises FrameError where PROJ knows no operation with such a grid here, or cannot read the file.
    """
    check_grid_path("datum_grid", grid)
    group = _operations(source, target, place_deg)
    names: dict[str, None] = {}
    for operation, native in (
        *((o, True) for o in group.unavailable_operations),
        *((t, False) for t in group.transformers),
    ):
        own = {g.short_name for g in _grids_of(operation)}
        names |= dict.fromkeys(sorted(own))
        called = [name for name in own if _stem(name) in _stem(grid) or _stem(grid) in _stem(name)]
        if len(own) != 1 or not called:
            continue
        text = operation.to_proj4() if native else operation.definition
        text = re.sub(rf"grids={re.escape(called[0])}", lambda _: f'grids="{grid}"', text)
        try:
            transformer = Transformer.from_pipeline(text)
        except ProjError as error:
            raise FrameError(
                f"datum_grid {grid}: PROJ cannot read it: give a grid of shifts, NTv2 (.gsb) or GeoTIFF (.tif)"
            ) from error
        axes = (_northing_first(flat_crs(any_crs(c))) for c in (source, target))
        first, last = axes if native else (False, False)
        name = operation.name if native else operation.description
        with_grid = _WithGrid(transformer, str(name), _stated_m(operation.accuracy), (first, last))
        _check_shift(source, target, place_deg, grid, with_grid)
        return with_grid
    known = f"give {' or '.join(names)}, under its own name" if names else "remove the key: it knows none with any grid"
    raise FrameError(
        f"datum_grid {grid}: PROJ knows no operation with this grid from {source} to {target} at longitude "
        f"{place_deg[0]:g}, latitude {place_deg[1]:g}: {known}"
    )


@lru_cache(maxsize=64)
def datum_change(source: str, target: str, place_deg: tuple[float, float], grid: str | None = None) -> DatumChange:
    """Return how positions of the CRS ``source`` come to the map ``target`` in plan, near a longitude and latitude.

    The operation is the one that this PROJ uses there, or that of the file ``grid``; the best one is the most accurate
    of all that PROJ knows for the place. Raises FrameError where PROJ does not know a CRS, or as the grid's file is
    wrong.
    """
    plan = flat_crs(any_crs(source))
    group = _operations(source, target, place_deg)
    if grid is not None:
        used = _with_grid(source, target, place_deg, grid)
        name, accuracy_m, text = used.name, used.accuracy_m, "gridshift"
    else:
        transformer = Transformer.from_crs(plan, flat_crs(any_crs(target)), always_xy=True)
        place = Transformer.from_crs(WGS84, plan, always_xy=True).transform(*place_deg)
        transformer.transform(*place)
        try:
            last = transformer.get_last_used_operation()
        except ProjError:
            last = transformer  # PROJ has nothing to do between two names of one system, and then no last operation
        name, accuracy_m, text = str(last.description), _stated_m(last.accuracy), str(last.definition)
    lacking = [o for o in group.unavailable_operations if _stated_m(o.accuracy) is not None and o.grids]
    best = min(lacking, key=lambda o: float(o.accuracy), default=None)
    missing = None
    if best is not None and (accuracy_m is None or best.accuracy < accuracy_m):
        alike = [g for o in lacking if o.accuracy == best.accuracy for g in o.grids if not g.available]
        first, *others = {g.short_name: g for g in alike}.values()
        package = first.package_name or "proj-data"
        missing = MissingGrid(
            first.short_name, tuple(g.short_name for g in others), package, first.url, float(best.accuracy)
        )
    code = f"{crs_label(crs_name(projected_crs(target)))} ({crs_title(target)})"
    name = name.removeprefix("axis order change (2D) + ").removesuffix(" + axis order change (2D)")
    is_null = not any(word in text for word in ("helmert", "shift", "molodensky", "molobadekas"))
    return DatumChange(str(plan.name), code, name, accuracy_m, is_null, missing)


def plan_with_grid(
    source: str, target: str, x: FloatArray, y: FloatArray, place_deg: tuple[float, float], grid: str
) -> FloatArray:
    """Return easting and northing (N, 2) in the map ``target`` of positions (N,) of the CRS ``source``, by the
    operation that uses the file ``grid``; infinite outside it. Raises FrameError as the grid's file is wrong."""
    return _with_grid(source, target, place_deg, grid).transform(x, y)


def plan_before_grid(
    source: str, target: str, x: FloatArray, y: FloatArray, place_deg: tuple[float, float], grid: str
) -> FloatArray:
    """Return the positions (N, 2) of the CRS ``source`` that ``plan_with_grid`` brings to easting and northing (N,)."""
    return _with_grid(source, target, place_deg, grid).inverse(x, y)
