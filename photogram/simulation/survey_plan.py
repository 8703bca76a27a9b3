"""What a simulated survey is asked to be: camera, flight, ground and noise; and the plans with a name."""

from dataclasses import dataclass, field, fields
from typing import Literal

import numpy as np

from photogram.geodesy.frames import LocalFrame
from photogram.projection import READOUT, Model
from photogram.simulation.cover.leaves import CoverPlan

CalibrationSource = Literal["laboratory", "maker", "exif"]

CONSUMER_GNSS_SIGMA_M = (2.0, 2.0, 2.0)
RTK_GNSS_SIGMA_M = (0.015, 0.015, 0.02)
_FIXED_BELOW_M, _CORRECTED_BELOW_M = 0.05, 1.0
_CANOPY_TREES = 150
_DIAGONAL_35MM_MM = float(np.hypot(36.0, 24.0))


@dataclass(frozen=True)
class SurveyPlan:
    """All settings of a simulated survey.

    The mean height of the terrain is 0. Strips are flown to and fro and assigned to the flights in their order.
    """

    width_px: int = 1200
    """Width of the photographs."""
    height_px: int = 900
    """Height of the photographs."""
    focal_px: float = 1800.0
    """True focal length."""
    principal_point_offset_px: tuple[float, float] = (3.0, -2.0)
    """True principal point from the centre of the photograph."""
    radial: tuple[float, float, float, float] = (-0.08, 0.06, -0.01, 0.0)
    """True k1 k2 k3 k4."""
    tangential: tuple[float, float] = (0.0004, -0.0003)
    """True p1 p2."""
    affinity_px: tuple[float, float] = (0.0, 0.0)
    """True b1 b2."""
    camera_model: Model = "brown"
    """True camera model."""
    calibration_source: CalibrationSource = "laboratory"
    """What the surveyor knows of the camera: a laboratory's calibration, the maker's in the tags (DewarpData), or the
    EXIF focal length in whole millimetres on 35 mm film, without distortion."""
    focal_tag_factor: float = 1.0
    """Factor by which the EXIF focal length is wrong; 1.1: a tenth too long."""
    calibration_sigmas: tuple[float, ...] = (5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0)
    """Stated sigmas of the approximate camera, and its errors but for exif, in the order of PARAMETER_NAMES but
    for the read-out time; zero: known, infinity: free and without error."""
    flying_height_m: float = 80.0
    """Flying height above mean ground."""
    forward_overlap: float = 0.7
    """Forward overlap, 0 to 1."""
    side_overlap: float = 0.65
    """Side overlap, 0 to 1."""
    strips: int = 3
    """Number of parallel strips."""
    photographs_per_strip: int = 4
    """Photographs in each."""
    oblique_strip: bool = False
    """Whether an oblique strip crosses the others."""
    oblique_photographs: int | None = None
    """Photographs in the oblique strip; None: as many as in the others."""
    oblique_angle_deg: float = 25.0
    """Its forward tilt."""
    speed_m_s: float = 5.0
    """Ground speed."""
    readout_s: float = 0.0
    """Read-out time from first to last row of a rolling shutter; 0: global shutter."""
    velocity_tags: bool = False
    """Whether photographs know their velocity at the exposure, to 0.1 m/s as makers write it."""
    readout_sigma_s: float = 0.0
    """Prior standard deviation of the read-out time, which the surveyor believes to be 0; 0: held there."""
    attitude_noise_deg: float = 1.5
    """Standard deviation of the flown attitudes about the plan."""
    position_noise_m: float = 0.5
    """Standard deviation of the flown positions about the plan."""
    attitude_sigma_deg: float = 1.0
    """Standard deviation of the measured attitudes."""
    flights: int = 1
    """Number of flights."""
    gnss_tags: bool = True
    """Whether photographs have position, attitude and time in their tags."""
    gnss_sigma_m: tuple[float, float, float] = (0.02, 0.02, 0.04)
    """Standard deviations of the GNSS positions: east, north, up."""
    gnss_offset_sigma_m: tuple[float, float, float] = (0.3, 0.3, 0.5)
    """Standard deviations of the GNSS offset of a flight: east, north, up."""
    heading_error_deg: float = 0.0
    """Error of the compass, common to all measured attitudes: clockwise seen from above."""
    boresight_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation about the camera's axes by which all measured attitudes are off."""
    lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Arm from antenna to camera along the camera's axes, which the surveyor does not know of."""
    time_offset_s: float = 0.0
    """By how much later photographs are exposed than their positions are measured."""
    drift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Drift of the positions over a flight: east, north, up, projection centre minus position."""
    headwind_m_s: float = 0.0
    """By how much slower than ``speed_m_s`` strips are flown northwards, faster southwards."""
    crossing: bool = False
    """Whether every other strip is flown at right angles, eastwards or westwards."""
    turns: bool = True
    """Whether the aircraft heads where it flies; if not, its heading is north on all strips."""
    relief_m: float = 8.0
    """Relief from valley to hill."""
    cell_m: float = 0.1
    """Cell of the height field."""
    buildings: int = 12
    """Number of buildings."""
    trees: int = 100
    """Number of trees."""
    target_radius_m: float = 0.35
    """Radius of the targets of ground points."""
    control_points: int = 18
    """Number of control points."""
    check_points: int = 8
    """Number of check points."""
    control_marks_per_photograph: int = 0
    """Control points that every photograph must see."""
    control_sigma_m: tuple[float, float, float] = (0.01, 0.01, 0.015)
    """Standard deviations of the surveyed points: east, north, up."""
    mark_sigma_px: float = 0.3
    """Standard deviation of the marks."""
    whole_pixel_marks: bool = False
    """Whether marks are rounded to whole pixels."""
    blunder_point: str | None = None
    """Name of the point with a height blunder, None for none."""
    control_height_blunder_m: float = 0.0
    """The blunder, added to its surveyed height."""
    crs: str = "EPSG:25832"
    """Map grid."""
    origin_map_m: tuple[float, float, float] = (602340.0, 5794120.0, 120.0)
    """Easting, northing and height of the world frame's origin."""

    def __post_init__(self) -> None:
        if not (0 < self.forward_overlap < 1 and 0 < self.side_overlap < 1):
            raise ValueError("overlaps must be between 0 and 1")
        if min(self.strips, self.photographs_per_strip, self.flights) < 1 or self.flights > self.strips:
            raise ValueError("a survey has at least one photograph, one strip, and one strip per flight")
        if self.oblique_photographs is not None and self.oblique_photographs < 1:
            raise ValueError("oblique_photographs: an oblique strip has at least one photograph")
        if len(self.calibration_sigmas) != READOUT:
            raise ValueError(f"calibration_sigmas: {READOUT} values, not {len(self.calibration_sigmas)}")
        beyond_tags = any(self.radial[3:]) or any(self.affinity_px) or self.camera_model != "brown"
        if self.calibration_source == "maker" and beyond_tags:
            raise ValueError("a maker's tags hold k1 k2 k3 p1 p2 of a Brown camera, neither k4, affinity nor a fisheye")

    @property
    def gsd_m(self) -> float:
        """Return the ground sampling distance: the size of a pixel on the ground, in metres."""
        return self.flying_height_m / self.focal_px

    @property
    def base_m(self) -> float:
        """Return the distance between neighbouring projection centres of a strip, in metres."""
        return (1 - self.forward_overlap) * self.height_px * self.gsd_m

    @property
    def frame(self) -> LocalFrame:
        """Return the world frame of the survey."""
        return LocalFrame(self.crs, self.origin_map_m)

    @property
    def stated_mark_sigma_px(self) -> float:
        """Return the standard deviation of a mark, rounding included."""
        return float(np.hypot(self.mark_sigma_px, 12**-0.5 if self.whole_pixel_marks else 0.0))

    @property
    def rtk_flag(self) -> int | None:
        """Return what an RTK drone writes as its kind of solution (50 fixed, 34 float), None for any other drone."""
        plan = max(self.gnss_sigma_m[:2])
        return 50 if plan < _FIXED_BELOW_M else 34 if plan < _CORRECTED_BELOW_M else None

    @property
    def exact_focal_35mm_mm(self) -> float:
        """Return the focal length on 35 mm film with the same diagonal angle of view."""
        return self.focal_px * _DIAGONAL_35MM_MM / float(np.hypot(self.width_px, self.height_px))

    @property
    def focal_35mm_mm(self) -> int:
        """Return what EXIF says of it, in whole millimetres."""
        return round(self.exact_focal_35mm_mm * self.focal_tag_factor)


@dataclass(frozen=True)
class CoveredPlan(SurveyPlan):
    """A survey over a site with cover: trees of leaves that move, hedges, high grass, water, fences and wires."""

    cover: CoverPlan = field(default_factory=CoverPlan)
    """What covers the site."""


def demonstration_plan() -> SurveyPlan:
    """Return the plan of the built-in demonstration: twelve photographs, their control marks read to whole pixels."""
    return SurveyPlan(control_marks_per_photograph=4, mark_sigma_px=0.0, whole_pixel_marks=True)


def whole_survey_plan(width_px: int = 1200) -> SurveyPlan:
    """Return the plan of an ordinary survey: 24 photographs of a consumer drone, six control points somewhere.

    The camera is known by its EXIF focal length, positions are good to 2 m, and most photographs see no four control
    points. ``width_px`` sets the size of the pictures, their angle of view stays.
    """
    focal_px = width_px / 1.2
    return SurveyPlan(
        width_px=width_px,
        height_px=width_px * 3 // 4,
        focal_px=focal_px,
        calibration_source="exif",
        calibration_sigmas=(
            0.03 * focal_px,
            0.01 * width_px,
            0.01 * width_px,
            0.1,
            0.1,
            0.05,
            0.0,
            0.002,
            0.002,
            0.0,
            0.0,
        ),
        flying_height_m=60.0,
        forward_overlap=0.8,
        side_overlap=0.7,
        strips=4,
        photographs_per_strip=6,
        position_noise_m=1.0,
        attitude_noise_deg=2.5,
        gnss_sigma_m=CONSUMER_GNSS_SIGMA_M,
        gnss_offset_sigma_m=(1.0, 1.0, 2.0),
        target_radius_m=0.4,
        control_points=6,
        check_points=10,
    )


def canopy_plan(width_px: int = 1200) -> CoveredPlan:
    """Return whole_survey_plan over a site with cover (covered_site.py)."""
    plain = whole_survey_plan(width_px)
    settings = {f.name: getattr(plain, f.name) for f in fields(SurveyPlan)}
    return CoveredPlan(**{**settings, "trees": _CANOPY_TREES})


def rtk_plan(*, oblique: bool = False) -> SurveyPlan:
    """Return the plan of a survey without control: 28 nadir photographs of an RTK drone, all from one height.

    The focal length is known to 1 % only. ``oblique`` adds a strip of five photographs, 15 % of all, tilted by 15°.
    """
    return SurveyPlan(
        focal_px=1000.0,
        calibration_source="maker",
        calibration_sigmas=(10.0, 5.0, 5.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0),
        flying_height_m=60.0,
        forward_overlap=0.8,
        side_overlap=0.7,
        strips=4,
        photographs_per_strip=7,
        oblique_strip=oblique,
        oblique_photographs=5,
        oblique_angle_deg=15.0,
        gnss_sigma_m=RTK_GNSS_SIGMA_M,
        gnss_offset_sigma_m=(0.0, 0.0, 0.0),
        control_points=0,
        check_points=9,
    )
