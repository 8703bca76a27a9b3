"""A finished solution of another program, in photogram's terms: cameras, poses, tie points, and marked ground points.

Readers convert once and exactly: pixels have the centre of the top-left one at (0, 0), cameras look along +z with x to
the right and y down, rotations are world from camera. What a file holds and this form does not, a reader says in
``left_out``; it never drops it silently.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePosixPath
from typing import Literal

import numpy as np

from photogram.arrays import BoolArray, FloatArray, check_shapes
from photogram.camera import Camera, Pose, oriented_by
from photogram.errors import ExchangeError
from photogram.projection import PARAMETERS, OrientedCameras
from photogram.survey import ControlPoints, Role, TiePoints
from photogram.wording import some, things

_MOST_NAMED = 5

Frame = Literal["local", "topocentric", "geocentric", "map"]
"""What the coordinates of a solution are: those of a free network in a unit of its own, east, north and up at
``origin_lla``, geocentric ones of WGS 84, or those of the ground points, in the CRS ``crs`` where it is known, taken as
Cartesian."""


@dataclass(frozen=True)
class ForeignPhotograph:
    """A photograph of a foreign solution; its exterior orientation is None where the program did not orient it."""

    name: str
    """File name without folders, unique in the solution."""
    camera: int
    """Index of its camera."""
    pose: Pose | None
    """Exterior orientation in the solution's coordinates."""
    file: PurePosixPath
    """The file as the program names it: a path of the machine that it ran on."""
    measured: FloatArray | None = None
    """Measured position (3,) as the program was given it, in ``crs``; None without one."""
    measured_sigma_m: FloatArray | None = None
    """Its standard deviations (3,)."""

    @property
    def path(self) -> str:
        """Return its name with the folders that the program has it in."""
        return str(self.file.parent / self.name)


@dataclass(frozen=True, eq=False)
class StatedAdjustment:
    """What a program says of its own adjustment; a field is None where its files do not say it."""

    held: BoolArray | None = None
    """Parameters of interior orientation (cameras, 12) that it held for sure; others it may have estimated."""
    is_least_squares: bool = False
    """Whether all observations counted by their weights alone: no robust loss, and nothing rejected."""
    uses_check_marks: bool = False
    """Whether the marks of check points took part, as those of points without a survey."""
    fitted: BoolArray | None = None
    """Ground points (ground points,) whose survey took part, where others are control points now than were then."""
    sigma0: float | None = None
    """A posteriori standard deviation of the unit weight."""
    redundancy: int | None = None
    """Observations less unknowns."""
    sigmas_are_scaled: bool = False
    """Whether the standard deviations below are multiplied by sigma0."""
    angle_sigma_deg: FloatArray | None = None
    """Standard deviations of omega, phi, kappa (photographs, 3), degrees."""
    position_sigma_m: FloatArray | None = None
    """Those of projection centres (photographs, 3), along the solution's axes."""
    ground_m: FloatArray | None = None
    """Ground points as adjusted (ground points, 3), in the map of a solution whose coordinates are one."""
    ground_sigma_m: FloatArray | None = None
    """Their standard deviations (ground points, 3)."""


@dataclass(frozen=True, eq=False)
class ForeignSolution:
    """Cameras, photographs, tie points and ground points as another program left them."""

    program: str
    """The program that made it, with its version where the files say it."""
    cameras: tuple[Camera, ...]
    """The cameras as they were estimated; all sigmas 0."""
    photographs: tuple[ForeignPhotograph, ...]
    """The photographs."""
    tie_points: TiePoints
    """Tie points and their observations; ``feature`` is the number of the key point in the program's list of the
    photograph, TRANSFERRED where it has none."""
    ground_points: ControlPoints | None = None
    """Markers: surveyed positions in ``crs`` (NaN without), and marks; None where the format has no such thing."""
    frame: Frame = "local"
    """What the coordinates of poses and tie points are."""
    origin_lla: tuple[float, float, float] | None = None
    """Latitude and longitude, degrees, and ellipsoidal height, m, of a topocentric frame's origin."""
    crs: str | None = None
    """CRS of measured positions and ground points, as EPSG code or WKT, where the files say it."""
    stated_tie_sigma_px: float | None = None
    """Standard deviation of tie points that the program used, where the files say it."""
    reprojection_rms_px: float | None = None
    """The program's own figure of the root mean square of a reprojection residual (its length), where the files have
    it."""
    left_out: tuple[str, ...] = field(default=())
    """Sentences: what the files hold and this form cannot."""
    stated: StatedAdjustment = field(default_factory=StatedAdjustment)
    """What the program says of its own adjustment."""

    def __post_init__(self) -> None:
        names = [photograph.name for photograph in self.photographs]
        if len(set(names)) != len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise ValueError(f"photographs of a solution need names of their own; {twice[0]} comes twice")
        if any(not 0 <= photograph.camera < len(self.cameras) for photograph in self.photographs):
            raise ValueError("every photograph needs one of the cameras")
        if len(self.tie_points.photograph) and self.tie_points.photograph.max() >= len(self.photographs):
            raise ValueError("an observation of a tie point names a photograph that is not there")
        if (self.frame == "topocentric") != (self.origin_lla is not None):
            raise ValueError("a topocentric frame has an origin, no other has")
        self._check_stated()
        for photograph in self.photographs:
            check_shapes(photograph, measured=(3,))

    def _check_stated(self) -> None:
        points = 0 if self.ground_points is None else len(self.ground_points)
        photographs = (len(self.photographs), 3)
        check_shapes(self.stated, held=(len(self.cameras), PARAMETERS))
        check_shapes(self.stated, angle_sigma_deg=photographs, position_sigma_m=photographs)
        check_shapes(self.stated, fitted=(points,), ground_m=(points, 3), ground_sigma_m=(points, 3))
        if self.stated.ground_m is not None and self.frame != "map":
            raise ValueError("adjusted ground points are stated in a map")

    def __repr__(self) -> str:
        oriented = sum(photograph.pose is not None for photograph in self.photographs)
        counts = f"{oriented} of {things(len(self.photographs), 'photograph')} oriented, {self.tie_points!r}"
        return f"<ForeignSolution of {self.program}: {counts}>"

    @property
    def contents(self) -> str:
        """Return in words what a project can start from: poses, points, and image observations of these."""
        poses = sum(photograph.pose is not None for photograph in self.photographs)
        points, observations = len(self.tie_points), len(self.tie_points.point)
        seen = things(observations, "image observation") if observations else "no image observations"
        return f"{things(poses, 'pose')}, {things(points, 'point')} and {seen}"

    def oriented_cameras(self) -> OrientedCameras:
        """Return the photographs as compiled code takes them; NaN for those that have no pose."""
        camera_of = np.array([photograph.camera for photograph in self.photographs], dtype=np.int64)
        return oriented_by(self.cameras, camera_of, [photograph.pose for photograph in self.photographs])


def with_checks(solution: ForeignSolution, names: Sequence[str]) -> ForeignSolution:
    """Return a solution whose ground points of these names are check points. Raises ExchangeError where one is not
    there."""
    points = solution.ground_points
    there = () if points is None else points.name
    missing = [name for name in names if name not in there]
    if missing:
        known = some(there, _MOST_NAMED) if there else "none"
        raise ExchangeError(f"{missing[0]}: no such ground point in the solution; it has {known}")
    if not names or points is None:
        return solution
    roles: list[Role] = [
        "check" if name in names else role for name, role in zip(points.name, points.role, strict=True)
    ]
    stated = solution.stated
    fitted: BoolArray = np.asarray(points.controlled.any(axis=1) if stated.fitted is None else stated.fitted)
    stated = replace(stated, fitted=fitted)
    if stated.ground_m is not None:  # what was adjusted with its survey is no check of it
        became = np.array([new != old for new, old in zip(roles, points.role, strict=True)])
        stated = replace(stated, ground_m=np.where(became[:, None], np.nan, stated.ground_m))
    return replace(solution, ground_points=points.with_roles(roles), stated=stated)
