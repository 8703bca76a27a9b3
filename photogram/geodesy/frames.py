"""Coordinate reference systems and the local frame in which a survey is adjusted.

The `map` frame is the project's CRS (easting, northing, height), in metres: where the CRS counts feet, what files give
and take is converted at the edge, with its unit (`crs.map_units`). The `world` frame is Cartesian, near the survey:

- ``tangent``: east, north, up of the tangent plane of the ellipsoid at the origin, every point projected exactly
  (map -> geodetic -> geocentric -> topocentric);
- ``grid``: the map's own easting, northing and height minus a round origin, the map taken as Cartesian. Its scale
  error is the map's scale factor (UTM: up to 0.4 ‰ at the central meridian); for exercises and small sites only.

Heights of the world are always above the ellipsoid. Those of the map are too, unless the frame has a geoid: then they
are above it, and each point's geoid height is added on the way to the world and taken off on the way back. Heights
whose system nobody declares go through unchanged; a geoid height left in them changes the scale by 7e-6 for 44 m. This
module, `crs` and `height_systems` are the only ones that use PROJ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from pyproj import CRS, Geod, Transformer
from pyproj.exceptions import ProjError

from photogram.arrays import FloatArray
from photogram.errors import FrameError
from photogram.geodesy.crs import (
    NO_CRS,
    WGS84,
    MapUnits,
    any_crs,
    flat_crs,
    map_units,
    metric_crs,
    middle_deg,
    plan_before_grid,
    plan_of,
    plan_with_grid,
)
from photogram.geodesy.height_systems import (
    DeclaredHeights,
    Geoid,
    HeightSystem,
    geographic_crs,
    geoid_height_m,
)
from photogram.wording import shortened

WorldKind = Literal["tangent", "grid"]


def map_heights(crs: str, heights: DeclaredHeights, given: HeightSystem | None, points_map_m: FloatArray) -> FloatArray:
    """Bring points (N, 3), whose heights are of the system ``given``, to the heights of the map, each exactly.

    Unchanged where a system is not declared. Raises FrameError where a point lies outside the CRS or the geoid's grid,
    or the grid is missing.
    """
    points = np.asarray(points_map_m, dtype=np.float64).reshape(-1, 3)
    sign = heights.sign_to_map(given)
    if heights.geoid is None or sign == 0.0 or not len(points):
        return points
    raised = points.copy()
    raised[:, 2] += sign * LocalFrame(crs, (0.0, 0.0, 0.0), "grid", heights.geoid).geoid_height_m(points)
    return raised


def _by_grid(source: str, target: str, points: FloatArray, grid: str) -> FloatArray:
    """Return easting and northing (N, 2) in the map of points (N, 3), their shift read from a file. Raises FrameError
    where the file is wrong, or does not reach to a point."""
    place = middle_deg(source, points)
    if place is None:
        plan = np.full((len(points), 2), np.nan)
    else:
        plan = plan_with_grid(source, plan_of(target), points[:, 0], points[:, 1], place, grid)
    lost = np.flatnonzero(~np.isfinite(plan).all(axis=1))
    if len(lost):
        x, y, _ = points[lost[0]]
        raise FrameError(
            f"datum_grid {grid}: position {x:.10g}, {y:.10g} of {shortened(source)} lies outside: give that of the site"
        )
    return plan * map_units(target).plan_m


def map_from_geodetic(crs: str, longitude_latitude_height: FloatArray, datum_grid: str | None = None) -> FloatArray:
    """Project WGS 84 longitude and latitude in degrees and height in m (N, 3) to the map (N, 3), height unchanged.

    ``datum_grid`` is a file with the shifts between the two datums. Raises FrameError where the projection is not
    defined, or the grid does not serve.
    """
    lon, lat, height = np.asarray(longitude_latitude_height, dtype=np.float64).T
    if datum_grid is not None and len(lon):
        return np.column_stack([_by_grid(WGS84, crs, np.column_stack([lon, lat, height]), datum_grid), height])
    easting, northing = Transformer.from_crs(WGS84, metric_crs(crs), always_xy=True).transform(lon, lat)
    if not np.all(np.isfinite(easting) & np.isfinite(northing)):
        raise FrameError(
            f"crs: {shortened(crs)} is not defined at longitude {lon[0]:.4f}, latitude {lat[0]:.4f}: choose the CRS of "
            "the site"
        )
    return np.column_stack([easting, northing, height])


def _transformer(source: CRS, target: CRS, names: str) -> Transformer:
    """Return the best transformation that PROJ has; a datum that is given is never passed over."""
    try:
        return Transformer.from_crs(source, target, always_xy=True, allow_ballpark=False)
    except ProjError as error:
        datums = [crs.geodetic_crs.datum for crs in (source, target) if crs.geodetic_crs is not None]
        if any(datum is not None and datum.name.startswith("Unknown") for datum in datums):
            # A PROJ string with an ellipsoid and no datum can only be read as the other's datum.
            return Transformer.from_crs(source, target, always_xy=True)
        raise FrameError(
            f"crs: PROJ has no transformation {names}, or lacks its grid: give the points in the project's CRS"
        ) from error


def map_from_crs(source: str, target: str, points: FloatArray, datum_grid: str | None = None) -> FloatArray:
    """Transform points (N, 3) of the CRS ``source`` to the map (N, 3) of the CRS ``target``, each exactly.

    ``source`` is anything that PROJ knows, a map grid or geographic; its columns are easting or longitude, northing or
    latitude, in its own unit (degrees where geographic), and height. Plan goes by the best transformation that this
    PROJ can do, or by the one whose grid is the file ``datum_grid``. Heights are transformed where both CRS define a
    vertical axis, else only brought to metres by the unit of the source's vertical axis, or left as they are where it
    has none: whether two heights have the same zero is not checked here. Raises FrameError where ``source`` is unknown
    or geocentric, no transformation is known, heights come beside feet without a unit of their own, or a point lies
    where the transformation has no values.
    """
    x, y, z = np.asarray(points, dtype=np.float64).reshape(-1, 3).T
    given = any_crs(source)
    plan = metric_crs(target)
    if given.is_geocentric or len(given.axis_info) < 2:
        raise FrameError(
            f"crs: {shortened(source)!r} ({given.name}) has no easting and northing, nor longitude and latitude"
        )
    full = CRS.from_user_input(target)
    upright = [axis for axis in given.axis_info if axis.direction == "up"]
    upright_map = [axis for axis in full.axis_info if axis.direction == "up"]
    names = f"from {shortened(source)} to {shortened(target)}"
    if upright and upright_map:
        result = np.column_stack(_transformer(given, full, names).transform(x, y, z)) * map_units(target).factors
    else:
        horizontal = flat_crs(given)
        unit = horizontal.axis_info[0].unit_name
        if not upright and horizontal.is_projected and unit != "metre":
            raise FrameError(
                f"crs: {shortened(source)!r} ({given.name}) is in {unit} and has no vertical part: name its height "
                "system too, EPSG:2229+6360 for example, or give the points in metres"
            )
        easting, northing = _transformer(horizontal, plan, names).transform(x, y)
        result = np.column_stack([easting, northing, z * (upright[0].unit_conversion_factor if upright else 1.0)])
    if datum_grid is not None and len(result):
        result[:, :2] = _by_grid(source, target, np.column_stack([x, y, z]), datum_grid)
    lost = np.flatnonzero(~np.isfinite(result).all(axis=1))
    if len(lost):
        first = lost[0]
        raise FrameError(
            f"position {x[first]:.10g}, {y[first]:.10g} of {shortened(source)} cannot be transformed to "
            f"{shortened(target)}: check the CRS, and that the columns are easting (or longitude) before "
            "northing (or latitude)"
        )
    return result


def geodetic_from_map(crs: str, points_map_m: FloatArray, datum_grid: str | None = None) -> FloatArray:
    """Return WGS 84 longitude and latitude in degrees and height in m (N, 3) of points (N, 3) of the map, height
    unchanged; ``datum_grid`` as of map_from_geodetic."""
    easting, northing, height = np.asarray(points_map_m, dtype=np.float64).T
    unit_m = map_units(crs).plan_m
    place = None if datum_grid is None else middle_deg(plan_of(crs), np.column_stack([easting, northing]) / unit_m)
    if datum_grid is not None and place is not None:
        plan = plan_before_grid(WGS84, plan_of(crs), easting / unit_m, northing / unit_m, place, datum_grid)
        return np.column_stack([plan, height])
    lon, lat = Transformer.from_crs(metric_crs(crs), WGS84, always_xy=True).transform(easting, northing)
    return np.column_stack([lon, lat, height])


def degrees_of(crs: str) -> str:
    """Return the geographic CRS, longitude and latitude in degrees, that a CRS of any kind rests on. Raises FrameError
    where it has no datum."""
    return str(geographic_crs(any_crs(crs)).to_wkt())


def geodetic_of(crs: str, points: FloatArray, *, geographic: bool) -> FloatArray:
    """Return longitude and latitude in degrees, on the CRS's own datum, and height (N, 3) of points (N, 3) of a CRS, as
    files give them; heights unchanged.

    ``geographic`` says what the points are: longitude and latitude, or easting and northing. Raises FrameError where
    the CRS is of the other kind, or a point lies outside it.
    """
    given, rows = any_crs(crs), np.asarray(points, dtype=np.float64).reshape(-1, 3)
    if given.is_geographic != geographic:
        kind = "longitude and latitude" if geographic else "easting and northing"
        remedy = "EPSG:4326, for example" if geographic else "the map grid"
        raise FrameError(f"crs: the points are {kind}, but {shortened(crs)} is not of them: name {remedy}")
    if geographic and all(axis.unit_name == "degree" for axis in given.axis_info[:2]):
        return rows.copy()
    plan = flat_crs(given)
    lon, lat = Transformer.from_crs(plan, geographic_crs(plan), always_xy=True).transform(rows[:, 0], rows[:, 1])
    lost = np.flatnonzero(~np.isfinite(np.column_stack([lon, lat])).all(axis=1))
    if len(lost):
        x, y, _ = rows[lost[0]]
        raise FrameError(f"position {x:.10g}, {y:.10g} lies outside {shortened(crs)}: check the CRS and the columns")
    return np.column_stack([lon, lat, rows[:, 2]])


def geocentric_from_geodetic(longitude_latitude_height: FloatArray) -> FloatArray:
    """Return geocentric points (N, 3), m, of WGS 84 longitude and latitude in degrees and ellipsoidal height in m
    (N, 3)."""
    turned = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True).transform(*longitude_latitude_height.T)
    return np.column_stack(turned)


def geodetic_from_geocentric(points_m: FloatArray) -> FloatArray:
    """Return WGS 84 longitude and latitude in degrees and ellipsoidal height in m (N, 3) of geocentric points (N, 3),
    m."""
    turned = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True).transform(*np.asarray(points_m).T)
    return np.column_stack(turned)


def _topocentric_at(origin_lla: tuple[float, float, float]) -> str:
    """Return PROJ's step from geocentric coordinates to east, north and up at an origin of such latitude, longitude and
    height."""
    latitude, longitude, height = origin_lla
    return f"+proj=topocentric +ellps=WGS84 +lon_0={longitude:.15g} +lat_0={latitude:.15g} +h_0={height:.15g}"


def _topocentric_of_geodetic(origin_lla: tuple[float, float, float]) -> Transformer:
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step {_topocentric_at(origin_lla)}"
    )


def topocentric_from_geodetic(
    origin_lla: tuple[float, float, float], longitude_latitude_height: FloatArray
) -> FloatArray:
    """Return points (N, 3) along east, north and up, m, at an origin of such latitude, longitude and height, of WGS 84
    longitude and latitude in degrees and ellipsoidal height in m (N, 3)."""
    return np.column_stack(_topocentric_of_geodetic(origin_lla).transform(*longitude_latitude_height.T))


def geodetic_from_topocentric(origin_lla: tuple[float, float, float], points_m: FloatArray) -> FloatArray:
    """Return what ``topocentric_from_geodetic`` takes (N, 3) of points (N, 3) along east, north and up."""
    return np.column_stack(_topocentric_of_geodetic(origin_lla).transform(*np.asarray(points_m).T, direction="INVERSE"))


def geocentric_from_topocentric(origin_lla: tuple[float, float, float], points_m: FloatArray) -> FloatArray:
    """Return geocentric points (N, 3), m, of points (N, 3) along east, north and up at an origin of such latitude,
    longitude and height."""
    turned = Transformer.from_pipeline(_topocentric_at(origin_lla))
    return np.column_stack(turned.transform(*np.asarray(points_m).T, direction="INVERSE"))


@dataclass(frozen=True)
class CombinedScale:
    """A short length on the map over the same on the ground (Ghilani & Wolf 2015, sec. 20.8)."""

    grid: float
    """Length on the map over that on the ellipsoid."""
    height: float
    """Length on the ellipsoid over that on the ground, R / (R + h) with the mean radius R = √(ρν)."""

    @property
    def combined(self) -> float:
        """Length on the map over that on the ground."""
        return self.grid * self.height


def _check_inside(points_map_m: FloatArray, transformed: FloatArray, where: str) -> None:
    """Raise FrameError where points (N, 3) of the map have become infinite or NaN (N, k), outside ``where``."""
    lost = ~np.isfinite(transformed).all(axis=1)
    if lost.any():
        easting, northing = points_map_m[lost][0, :2]
        raise FrameError(f"position easting {easting:.2f}, northing {northing:.2f} lies outside {where}")


@dataclass(frozen=True)
class LocalFrame:
    """The Cartesian `world` frame of a survey in the CRS ``crs``, with its origin at ``origin_map_m``.

    ``geoid`` is what the heights of the map are above, None where that is the ellipsoid.
    """

    crs: str
    origin_map_m: tuple[float, float, float]
    kind: WorldKind = "tangent"
    geoid: Geoid | None = None

    @classmethod
    def near(
        cls, crs: str, points_map_m: FloatArray, kind: WorldKind = "tangent", geoid: Geoid | None = None
    ) -> LocalFrame:
        """Return a frame with its origin at the centre of points (N, 3), rounded to 10 m so that it is stable and
        readable."""
        centre = np.round((points_map_m.min(axis=0) + points_map_m.max(axis=0)) / 2, -1)
        frame = cls(crs, (float(centre[0]), float(centre[1]), float(centre[2])), kind, geoid)
        frame.world_from_map(points_map_m[:1])
        return frame

    @classmethod
    def local(cls) -> LocalFrame:
        """Return the frame of a block that is nowhere: map and world are the same Cartesian axes."""
        return cls(NO_CRS, (0.0, 0.0, 0.0), "grid")

    @property
    def is_local(self) -> bool:
        """Return whether the map is a Cartesian system without a CRS."""
        return self.crs == NO_CRS

    @cached_property
    def units(self) -> MapUnits:
        """The units in which files count easting, northing and height of this map."""
        own = map_units(self.crs)
        if self.geoid is None:
            return own
        axis = self.geoid.crs.axis_info[0]
        return replace(own, height_m=float(axis.unit_conversion_factor), height=str(axis.unit_name))

    def map_from_unit(self, points: FloatArray) -> FloatArray:
        """Return points (N, 3) of the map in m from what files give of them, in the units of the CRS."""
        return self.units.in_metres(points)

    def unit_from_map(self, points_map_m: FloatArray) -> FloatArray:
        """Return points (N, 3) of the map in the units of the CRS, as files give them."""
        return self.units.from_metres(points_map_m)

    def __repr__(self) -> str:
        easting, northing, height = self.origin_map_m
        return (
            f"<LocalFrame {self.kind} in {shortened(self.crs)}, origin {easting:.2f}, {northing:.2f}, {height:.2f} m>"
        )

    @cached_property
    def _crs(self) -> CRS:
        return metric_crs(self.crs)

    @property
    def _semi_axes_m(self) -> tuple[float, float]:
        ellipsoid = self._crs.ellipsoid
        if ellipsoid is None:
            raise FrameError(f"crs: {shortened(self.crs)} has no ellipsoid")
        return ellipsoid.semi_major_metre, ellipsoid.semi_minor_metre

    @cached_property
    def _geodetic(self) -> Transformer:
        return Transformer.from_crs(self._crs, geographic_crs(self._crs), always_xy=True)

    @cached_property
    def _topocentric(self) -> Transformer:
        longitude, latitude, height = self._geodetic_from_map(np.array([self.origin_map_m]))[0]
        a, b = self._semi_axes_m
        shape = f"+a={a} +b={b}"
        return Transformer.from_pipeline(
            f"+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart {shape} "
            f"+step +proj=topocentric {shape} +lon_0={longitude:.15g} +lat_0={latitude:.15g} +h_0={height:.15g}"
        )

    @cached_property
    def _ellipsoidal_origin_m(self) -> FloatArray:
        origin = np.array(self.origin_map_m)
        return origin if self.geoid is None else self._above_ellipsoid(origin[None])[0]

    def _plan_from_map(self, points_map_m: FloatArray) -> FloatArray:
        """Return longitude and latitude (N, 2) in degrees. Raises FrameError outside the CRS."""
        geodetic = np.column_stack(self._geodetic.transform(points_map_m[:, 0], points_map_m[:, 1]))
        remedy = "check the CRS, and that easting and northing are not swapped"
        _check_inside(points_map_m, geodetic, f"{shortened(self.crs)}: {remedy}")
        return geodetic

    def _geodetic_from_map(self, points_map_m: FloatArray) -> FloatArray:
        plan = self._plan_from_map(points_map_m)
        return np.column_stack([plan, points_map_m[:, 2] + self._geoid_height_m(plan, points_map_m)])

    def _geoid_height_m(self, plan_deg: FloatArray, points_map_m: FloatArray) -> FloatArray:
        if self.geoid is None:
            return np.zeros(len(plan_deg))
        height = geoid_height_m(self._crs, self.geoid, plan_deg)
        _check_inside(points_map_m, height[:, None], f"the grid of geoid {self.geoid.name}: give the geoid of the site")
        return height

    def geoid_height_m(self, points_map_m: FloatArray) -> FloatArray:
        """Return the height (N,) of the frame's geoid above the ellipsoid at points (N, 3) of the map, zero without
        one. Raises FrameError outside the CRS or the geoid's grid."""
        points = np.asarray(points_map_m, dtype=np.float64).reshape(-1, 3)
        return self._geoid_height_m(self._plan_from_map(points), points)

    def _above_ellipsoid(self, points_map_m: FloatArray) -> FloatArray:
        if self.geoid is None:
            return points_map_m
        return np.column_stack([points_map_m[:, :2], points_map_m[:, 2] + self.geoid_height_m(points_map_m)])

    def world_from_map(self, points_map_m: FloatArray) -> FloatArray:
        """Transform points (N, 3) from the map to the world frame, exactly. Raises FrameError outside the CRS or the
        geoid's grid."""
        points = np.asarray(points_map_m, dtype=np.float64).reshape(-1, 3)
        if len(points) == 0:
            return points.copy()
        if self.kind == "grid":
            return np.asarray(self._above_ellipsoid(points) - self._ellipsoidal_origin_m)
        geodetic = self._geodetic_from_map(points)
        return np.column_stack(self._topocentric.transform(geodetic[:, 0], geodetic[:, 1], geodetic[:, 2]))

    def map_from_world(self, points_world_m: FloatArray) -> FloatArray:
        """Transform points (N, 3) from the world frame to the map, exactly; NaN stays NaN, and a point outside the
        geoid's grid has no height."""
        points = np.asarray(points_world_m, dtype=np.float64).reshape(-1, 3)
        known = np.isfinite(points).all(axis=1)
        result = np.full(points.shape, np.nan)
        if not known.any():
            return result
        if self.kind == "grid":
            result[known] = points[known] + self._ellipsoidal_origin_m
            plan = None if self.geoid is None else np.column_stack(self._geodetic.transform(*result[known, :2].T))
        else:
            east, north, up = points[known].T
            try:
                lon, lat, height = self._topocentric.transform(east, north, up, direction="INVERSE")
                easting, northing = self._geodetic.transform(lon, lat, direction="INVERSE")
            except ProjError as error:
                raise FrameError(f"positions cannot be transformed to {shortened(self.crs)}: {error}") from error
            result[known] = np.column_stack([easting, northing, height])
            plan = np.column_stack([lon, lat])
        if self.geoid is not None and plan is not None:
            result[known, 2] -= geoid_height_m(self._crs, self.geoid, plan)
        return result

    def rotation_world_from_map(self, position_world_m: FloatArray) -> FloatArray:
        """Return the rotation (3, 3) whose columns are the map's easting, northing and up axes at a position (3,), in
        the world.

        Meridian convergence and the tilt of the ellipsoid's normal are counted, the map's scale factor and the slope of
        a geoid (some 0.01 mm per metre, rarely 0.1) are not.
        """
        if self.kind == "grid":
            return np.eye(3)
        if self.geoid is not None:
            return self._ellipsoidal.rotation_world_from_map(position_world_m)
        step = 10.0
        centre = self.map_from_world(position_world_m[None])[0]
        ends = self.world_from_map(centre + step * np.vstack([np.eye(3), -np.eye(3)]))
        U, _, Vt = np.linalg.svd((ends[:3] - ends[3:]).T)
        return np.asarray(U @ Vt)

    @cached_property
    def _ellipsoidal(self) -> LocalFrame:
        """The same world over a map of ellipsoidal heights."""
        easting, northing, height = self._ellipsoidal_origin_m.tolist()
        return LocalFrame(self.crs, (easting, northing, height), self.kind)

    def rotation_world_from_true(self, position_world_m: FloatArray) -> FloatArray:
        """Return the rotation (3, 3) from true east, true north and up at a position (3,) to the world frame.

        The identity in a tangent frame, but for the curvature of the Earth within the survey; meridian convergence in
        a grid frame.
        """
        if self.kind == "tangent" or self.is_local:
            return np.eye(3)
        tangent = LocalFrame(self.crs, self.origin_map_m, "tangent", self.geoid)
        return tangent.rotation_world_from_map(position_world_m).T

    def grid_scale(self, position_map_m: FloatArray) -> float:
        """Return the map's point scale factor at a position (3,): a short length on the map over that on the ellipsoid,
        the mean of all directions where they differ."""
        step = 100.0
        centre = np.asarray(position_map_m, dtype=np.float64)[:2]
        offset = step * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        lon, lat = self._plan_from_map(np.column_stack([centre + offset, np.zeros(4)])).T
        a, b = self._semi_axes_m
        _, _, length_m = Geod(a=a, b=b).inv(lon[[0, 2]], lat[[0, 2]], lon[[1, 3]], lat[[1, 3]])
        return float(np.mean(2.0 * step / np.asarray(length_m)))

    def combined_scale(self, position_map_m: FloatArray) -> CombinedScale:
        """Return the scale factors of the map at a position (3,) of the ground."""
        at = np.asarray(position_map_m, dtype=np.float64).reshape(1, 3)
        _, latitude, height_m = self._geodetic_from_map(at)[0].tolist()
        a, b = self._semi_axes_m
        radius_m = b / (1.0 - (1.0 - (b / a) ** 2) * np.sin(np.deg2rad(latitude)) ** 2)  # Torge 2001, eq. 4.18
        return CombinedScale(self.grid_scale(at[0]), float(radius_m / (radius_m + height_m)))
