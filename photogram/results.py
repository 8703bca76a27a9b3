"""What an adjustment returns: estimates with their covariances, reliability, variance components, deformation modes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import FloatArray, IntArray
from photogram.survey import Block, CommonError
from photogram.verbs import call
from photogram.wording import html_table, text_table, things

SIGNIFICANCE = 0.01
DIFFERENT = 0.001
"""Level at which GNSS heights and those of control points are of two systems."""
LEAST_GEOID_M = 3.0
"""A smaller difference is hardly one of height systems: geoid heights are tens of metres on most of the Earth."""
"""Probability by chance below which a common error is one."""


@dataclass(frozen=True, eq=False)
class Reliability:
    """Reliability of the surveyed quantities along the map's axes (Baarda 1968).

    ``_redundancy`` are redundancy numbers, ``_w`` test statistics, standard normal without a blunder, ``_left_out``
    predictions by all other observations minus the measurements. NaN for check points, for absent measurements, and
    where no other observation determines one.
    """

    ground_redundancy: FloatArray
    """Surveyed coordinates of control points (G, 3)."""
    ground_w: FloatArray
    """The same (G, 3)."""
    ground_left_out_m: FloatArray
    """The same (G, 3)."""
    ground_left_out_covariance_m2: FloatArray
    """Covariances of the differences (G, 3, 3)."""
    mark_redundancy: FloatArray
    """Marks of control points (M, 2): u, and v freed of its correlation with u."""
    mark_w: FloatArray
    """The same (M, 2)."""
    mark_left_out_px: FloatArray
    """The same (M, 2)."""
    mark_left_out_covariance_px2: FloatArray
    """Covariances of the differences (M, 2, 2)."""
    gnss_redundancy: FloatArray
    """GNSS positions of photographs (N, 3)."""
    gnss_w: FloatArray
    """The same (N, 3)."""
    gnss_left_out_m: FloatArray
    """The same (N, 3)."""
    gnss_left_out_covariance_m2: FloatArray
    """Covariances of the differences (N, 3, 3)."""
    attitude_left_out_rad: FloatArray
    """Measured attitudes (N, 3), as rotations about the camera's axes."""
    attitude_left_out_covariance_rad2: FloatArray
    """Covariances of the differences (N, 3, 3)."""
    focal_left_out_px: FloatArray
    """Given focal lengths (cameras,)."""
    focal_left_out_sigma_px: FloatArray
    """Standard deviations of the differences (cameras,)."""

    @staticmethod
    def unknown(ground: int, marks: int, photographs: int, cameras: int = 0) -> Reliability:
        """Return what is known of so many ground points, marks, photographs and cameras when nothing is."""
        points, pixels, positions = (np.full((n, d), np.nan) for n, d in ((ground, 3), (marks, 2), (photographs, 3)))
        return Reliability(
            points,
            points,
            points,
            np.full((ground, 3, 3), np.nan),
            pixels,
            pixels,
            pixels,
            np.full((marks, 2, 2), np.nan),
            positions,
            positions,
            positions,
            np.full((photographs, 3, 3), np.nan),
            positions,
            np.full((photographs, 3, 3), np.nan),
            np.full(cameras, np.nan),
            np.full(cameras, np.nan),
        )


@dataclass(frozen=True, eq=False)
class VarianceComponents:
    """Residuals by group of observations (K), against their stated sigmas; nothing is rescaled by them.

    All groups together give the redundancy and vᵀPv of the adjustment.
    """

    group: NDArray[np.str_]
    """Names of the groups (K,)."""
    observations: IntArray
    """Numbers of observations (K,)."""
    redundancy: FloatArray
    """Sums of redundancy numbers (K,)."""
    squares: FloatArray
    """vᵀPv of the residuals (K,)."""
    stated_sigma: FloatArray
    """Medians of the stated sigmas (K,), px, m or rad."""
    used_sigma: FloatArray
    """Medians of the sigmas (K,) that were used: the stated ones where none were estimated."""

    @staticmethod
    def unknown() -> VarianceComponents:
        """Return those of no observations."""
        none = np.zeros(0)
        return VarianceComponents(np.zeros(0, dtype=np.str_), none.astype(np.int64), none, none, none, none)


@dataclass(frozen=True, eq=False)
class ConstraintTests:
    """What the adjustment says of constraints between points, by observation (K) in the order of
    ``between_points.observations``; NaN where a point has no position, where a figure does not exist, and of
    tests where nothing else determines an observation."""

    residual_m: FloatArray
    """Adjusted minus measured (K,); of a point of a surface, how far it is above it, or in front of it."""
    adjusted_sigma_m: FloatArray
    """Standard deviations (K,) of what is adjusted; for a check, of what is predicted for it."""
    redundancy: FloatArray
    """Redundancy numbers (K,), NaN for what took no part, as of the next three."""
    w: FloatArray
    """Test statistics (K,), standard normal without a blunder."""
    left_out_m: FloatArray
    """Predictions by all other observations minus the measurements (K,)."""
    left_out_sigma_m: FloatArray
    """Standard deviations (K,) of these differences."""
    z: FloatArray
    """Residuals over their standard deviations (K,), of checks; NaN for what took part or is rejected."""

    @staticmethod
    def unknown(count: int = 0) -> ConstraintTests:
        """Return what is known of so many observations when nothing is."""
        return ConstraintTests(*(np.full(count, np.nan) for _ in range(7)))

    def __len__(self) -> int:
        return len(self.residual_m)


@dataclass(frozen=True, eq=False)
class ExposureTests:
    """What the adjustment says of cameras on one body: of their relative poses, by rig (K), and of their exposures (E),
    rig after rig. Six figures each, rotation in rad about the companion's axes, then offset in m along the master's;
    NaN for what took no part."""

    relative_covariance: FloatArray
    """Covariances (K, 6, 6) of the relative poses."""
    misfit: FloatArray
    """Relative pose of each exposure minus that of the rig (E, 6)."""
    redundancy: FloatArray
    """Redundancy numbers (E, 6)."""
    w: FloatArray
    """Test statistics (E, 6), standard normal without a blunder."""
    left_out: FloatArray
    """The relative pose of the exposure minus that of the rig (E, 6), as all other observations give them."""
    left_out_covariance: FloatArray
    """Covariances (E, 6, 6) of these differences."""

    @staticmethod
    def unknown(rigs: int = 0, exposures: int = 0) -> ExposureTests:
        """Return what is known of so many rigs and exposures when nothing is."""
        poses, covariances = np.full((rigs, 6, 6), np.nan), np.full((exposures, 6, 6), np.nan)
        misfit, redundancy, w, left_out = (np.full((exposures, 6), np.nan) for _ in range(4))
        return ExposureTests(poses, misfit, redundancy, w, left_out, covariances)

    def __len__(self) -> int:
        return len(self.misfit)


SigmaKind = Literal[
    "key_points", "transferred", "photograph", "gnss_plan", "gnss_height", "control_plan", "control_height", "marks"
]


SIGMA_TITLES: Mapping[str, str] = MappingProxyType(
    {
        "key_points": "Key points",
        "transferred": "Tie points by correlation",
        "photograph": "Tie points of a photograph",
        "gnss_plan": "GNSS positions in plan",
        "gnss_height": "GNSS positions in height",
        "control_plan": "Control points in plan",
        "control_height": "Control points in height",
        "marks": "Marks",
    }
)
"""By the kind of an estimated standard deviation."""


@dataclass(frozen=True, eq=False)
class EstimatedSigmas:
    """Standard deviations that were estimated from residuals, by group of observations (K).

    Groups are the key points and the transferred tie points of a camera, the tie points of a photograph that scatter
    more than those of its camera's others, and what has assumed sigmas: GNSS positions, by flight, and control points,
    in plan and in height, and marks.
    """

    kind: NDArray[np.str_]
    """What each group is (K,), a SigmaKind."""
    of: NDArray[np.str_]
    """Name of its camera, photograph or flight (K,)."""
    observations: IntArray
    """Numbers of observed coordinates (K,)."""
    redundancy: FloatArray
    """Sums of redundancy numbers (K,)."""
    stated_sigma: FloatArray
    """Medians of the stated or assumed sigmas (K,), px or m."""
    estimated_sigma: FloatArray
    """What the residuals say (K,), px or m; NaN where the redundancy is too small."""
    used_sigma: FloatArray
    """Medians of the sigmas (K,) that were used, px or m."""
    factor: FloatArray
    """By what stated sigmas were multiplied (K,); of a photograph, beside the factor of its camera's group."""

    @staticmethod
    def none() -> EstimatedSigmas:
        """Return those of an adjustment that estimates none."""
        names, figures = np.zeros(0, dtype=np.str_), np.zeros(0)
        return EstimatedSigmas(names, names, figures.astype(np.int64), *(figures,) * 5)

    def __len__(self) -> int:
        return len(self.kind)

    def factors(self, kind: SigmaKind) -> dict[str, float]:
        """Return the factors of the groups of a kind, by name of camera, photograph or flight."""
        mine = self.kind == kind
        return dict(zip(self.of[mine].tolist(), self.factor[mine].tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Deformation:
    """A-priori covariance of how a block may be shifted, tilted, domed or scaled as a whole.

    Height errors of the tie points are modelled as a + b x/R + c y/R + d ((x² + y²)/R² − mean), with x and y from the
    centre; d is the dome. The cameras' share means the uncertainty of exterior orientation and calibration alone.
    """

    centre_world_m: FloatArray
    """Centre of the block (2,)."""
    radius_m: float
    """R, the radius of the block."""
    covariance: FloatArray
    """Joint covariance (K, K) of the mean error of the ground (east, north, up), b, c, d, the mean error of the
    projection centres (east, north, up), all m; per camera the mean rotations of its photographs about its x and y
    axes, rad; per camera its 12 parameters, zero where fixed; per flight the GNSS offset (east, north, up), m."""
    intersection_sigma_m: FloatArray
    """Median sigma (3,) of tie points with the cameras taken as known."""
    height_sigma_m: FloatArray
    """The cameras' share of the height sigma (Q,) at places over the block."""
    given_parameters: FloatArray
    """Interior orientations (cameras, 12) before the adjustment."""
    remedy: NDArray[np.str_]
    """Names (R,) of the design options evaluated by covariance."""
    remedy_sigma_m: FloatArray
    """Before and after each (R, 2, 3): sigma in height in the middle, root mean square over the block, sigma of d."""
    freed_prior: FloatArray
    """Sigmas (cameras, 12) with which fixed parameters were released, 0 for the others."""
    freed_sigma: FloatArray
    """Their sigmas (cameras, 12) after an adjustment with them released, 0 for the others."""
    freed_height_sigma_m: FloatArray
    """Sigmas (3,) of the heights with them released, as in ``remedy_sigma_m``."""
    pattern_sigma_m: FloatArray
    """Effect (3,) on b, c and d of a camera model error judged by the common pattern of the residuals: NaN if unknown,
    zero without a significant pattern. All height sigmas include it."""
    absolute_sigma_m: FloatArray
    """Root mean square (3,) east, north, up of the cameras' share over the block."""
    relative_sigma_m: FloatArray
    """The same with the mean shift of all points removed: the shape of the block without its datum."""
    ground_place_world_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """Places (Q, 3) over the block."""
    ground_covariance_m2: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    """Joint covariance (3 Q, 3 Q) of the cameras' share at these places."""
    place_world_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """Places (S, 3) spread over the ground."""
    shape_covariance_m2: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    """The cameras' share (S, 3, 3) at these places, relative to the mean error of all of them."""
    component_shift_m2: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    """Covariance (C, 3, 3) of the vector from the mean tie point of the first adjusted component to that of each, by
    its number: zero of the first, NaN of those without; empty for a block in one piece."""
    model_error_covariance_m2: FloatArray = field(default_factory=lambda: np.zeros((4, 4)))
    """Covariance (4, 4) of what an error of the camera models does to the mean height, b, c and d, zero without a
    significant pattern in the residuals; it is in all covariances of heights above."""

    @staticmethod
    def unknown(given_parameters: FloatArray | None = None) -> Deformation:
        """Return what is known of a block without tie points enough to say anything."""
        nothing = np.full(3, np.nan)
        given = np.zeros((0, 0)) if given_parameters is None else given_parameters
        return Deformation(
            nothing[:2], float("nan"), np.zeros((0, 0)), nothing, np.zeros(0), given, np.zeros(0, np.str_),
            np.zeros((0, 2, 3)), np.zeros_like(given), np.zeros_like(given), nothing, nothing, nothing,
            nothing,
        )  # fmt: skip

    @property
    def known(self) -> bool:
        """Return whether there are tie points enough to say anything."""
        return bool(len(self.covariance))


@dataclass(frozen=True, eq=False)
class CommonErrorEstimate:
    """A common error of measurements as it was estimated and removed."""

    error: CommonError
    """The error, with its value and its prior."""
    estimate: FloatArray
    """What it comes to (k,). Attitude: rotation about the camera's axes by which measured attitudes are off, boresight
    and heading together, rad. Lever arm: along the camera's axes, m, NaN for components that are not determined. Time
    offset: of exposures after the epochs of the positions, s. Drift: over the flight, easting, northing, height, m."""
    covariance: FloatArray
    """Its covariance (k, k)."""
    photographs: int
    """Number of photographs whose measurements have it."""
    chi2: float
    """Statistic of the test against zero, NaN where only the prior determines it."""
    degrees: int
    """Its degrees of freedom."""
    p: float
    """Probability of an error this large by chance, NaN where only the prior determines it."""
    as_well: str
    """What explains the measurements as well as this error, and was not estimated; empty for nothing."""

    @property
    def significant(self) -> bool:
        """Return whether the error is not zero, at the level SIGNIFICANCE."""
        return self.degrees > 0 and self.p < SIGNIFICANCE


@dataclass(frozen=True)
class LensFieldDecision:
    """Whether a camera has a lens field, a smooth correction over its picture beside its parameters, and why not."""

    camera: str
    """Name of the camera."""
    estimated: bool = False
    """Whether the field was estimated and is used."""
    why: str = ""
    """Why there is none, empty where there is."""
    photographs: int = 0
    """Photographs of the camera with tie points."""
    pattern_px: float = float("nan")
    """RMS for a coordinate of the pattern of the residuals without a field, NaN with too few residuals."""
    covered: float = float("nan")
    """Share of the picture with residuals enough."""
    gain: float = float("nan")
    """Share of the residuals' square sum that the pattern of the other half of the photographs predicts, NaN where it
    was not looked for."""
    gain_errors: float = float("nan")
    """The same over its standard error."""
    rms_px: float = float("nan")
    """RMS of the field for a coordinate over the picture, NaN where none was estimated."""
    sigma_px: float = float("nan")
    """RMS of its standard deviation."""
    largest_px: float = float("nan")
    """Its largest shift anywhere in the picture."""
    left_px: float = float("nan")
    """RMS of the pattern of the residuals with the field."""


@dataclass(frozen=True)
class HeightDecision:
    """Whether GNSS heights and those of control points are of one system, where nobody says so."""

    difference_m: float
    """By how much GNSS heights lie above those of the control points, as the adjustment estimates it."""
    sigma_m: float
    """Its standard deviation."""
    p: float
    """Probability of a difference as large by chance, if there were none."""
    same: bool
    """Whether they are of one system; otherwise the difference is an unknown."""

    @property
    def sentence(self) -> str:
        """Return what there is to say of it."""
        p = "p < 0.001" if self.p < 0.001 else f"p = {self.p:.3f}"
        what = "GNSS heights and those of the control points, of which nobody declares what they are above,"
        if self.same:
            return f"{what} differ by {self.difference_m:+.3f} ± {self.sigma_m:.3f} m ({p}): they are of one system"
        kept = "the difference is an unknown, and the results have the heights of the control points"
        if self.p >= DIFFERENT:
            return (
                f"{what} differ by {self.difference_m:+.2f} ± {self.sigma_m:.2f} m: too little is known of it; {kept}"
            )
        found = f"{what} differ by {self.difference_m:+.2f} ± {self.sigma_m:.2f} m ({p})"
        if abs(self.difference_m) < LEAST_GEOID_M:
            return f"{found}, too little for two height systems, as of a wrong base station or antenna height; {kept}"
        side, other = ("above", "below") if self.difference_m > 0.0 else ("below", "above")
        return (
            f"{found}: GNSS heights are ellipsoidal and those orthometric if the geoid lies so much {side} the "
            f"ellipsoid there, the other way round if it lies so much {other}; {kept}: declare both under heights"
        )


@dataclass(frozen=True, eq=False)
class SurfaceDecision:
    """Whether a known surface is control of the block, and what it differs from the ground by."""

    name: str
    """Name of the surface."""
    adopted: bool
    """Whether it takes part."""
    used: int
    """Points on it that take part."""
    set_aside: int
    """Points on it that do not: changed ground, or mismatches."""
    mean_m: float
    """Mean distance of the points from the surface along its normals, less what it is off by as a whole."""
    rms_m: float
    """Root mean square of these distances."""
    scatter: float
    """Factor by which they scatter more than stated, 1 at least; their standard deviations are larger by it."""
    above_m: FloatArray
    """How far (3,) the surface lies above the ground: in height in the middle of its points, and by its slopes east and
    north at ``edge_m``; as adjusted where it takes part, else as it was found."""
    above_sigma_m: FloatArray
    """Its standard deviations (3,)."""
    edge_m: float
    """Distance from the middle at which slopes count."""
    sigma_m: float
    """Stated standard deviation of a cell."""
    common_sigma_m: float
    """Standard deviation of what all of it is off by together."""
    common_assumed: bool
    """Whether the latter is assumed."""
    statistic: float
    """χ² of offset and slopes against zero, found without the surface; NaN where they were not looked at."""
    p: float
    """Probability of as much by chance."""
    why: str = ""
    """Why it does not take part, empty where it does."""

    @property
    def sentence(self) -> str:
        """Return what there is to say of it."""
        if not self.adopted:
            tested = "" if np.isnan(self.p) else f" (p {'< 0.001' if self.p < 0.001 else f'= {self.p:.3f}'})"
            return f"the known surface {self.name} is left out: {self.why}{tested}"
        side = "above" if self.above_m[0] >= 0.0 else "below"
        set_aside = f"; {things(self.set_aside, 'point')} not on it set aside" if self.set_aside else ""
        return (
            f"the known surface {self.name} is control in {things(self.used, 'point')}, from which the ground differs "
            f"by {self.rms_m:.3f} m (RMS){set_aside}; as a whole it lies {abs(self.above_m[0]):.3f} ± "
            f"{self.above_sigma_m[0]:.3f} m {side} the adjusted ground"
        )


@dataclass(frozen=True, eq=False)
class Estimates:
    """What an adjustment estimates beside its block, and what is left: of the observations of tie points (n), marks
    (M), ground points (G) and flights (F)."""

    residual_px: FloatArray
    """Residuals of the tie-point observations (n, 2), projected minus measured."""
    mark_residual_px: FloatArray
    """Residuals of the marks (M, 2), projected minus measured."""
    ground_world_m: FloatArray
    """Adjusted ground points (G, 3), NaN for a check point with fewer than two marks."""
    flights: tuple[str, ...]
    """Flights with an estimated GNSS offset."""
    offset_world_m: FloatArray
    """Their offsets (F, 3)."""
    held_world_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """Positions (K, 3) that the control points are held to; along axes that are checks, where they started."""
    held_axes: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    """The axes (K, 3, 3), as columns, along which their sigmas lie."""


@dataclass(frozen=True, eq=False)
class AdjustmentCovariances:
    """Covariances of what is adjusted, a priori and in the world frame: of photographs (N), tie points (P), ground
    points (G) and flights (F)."""

    position_m2: FloatArray
    """Of the projection centres (N, 3, 3)."""
    rotation_rad2: FloatArray
    """Of the rotations (N, 3, 3) about the camera's axes."""
    calibration: FloatArray
    """Of the interior orientations (cameras, 12, 12)."""
    tie_point_m2: FloatArray
    """Of the tie points (P, 3, 3)."""
    tie_point_ray_m2: FloatArray
    """The part (P, 3, 3) of them from the points' own rays; neighbours share the rest, which comes from the
    photographs."""
    ground_m2: FloatArray
    """Of the ground points (G, 3, 3)."""
    ground_joint_m2: FloatArray
    """The joint one (3 G, 3 G) of all ground points, which share the errors of the photographs."""
    offset_m2: FloatArray
    """Of the GNSS offsets (F, 3, 3)."""
    lens_field_px2: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0)))
    """Of the coefficients of the lens fields (cameras, K, K), zero for a camera without; (0, 0, 0) where no camera has
    one."""
    deformation: Deformation = field(default_factory=Deformation.unknown)
    """Of the block as a whole, unknown until computed."""


@dataclass(frozen=True, eq=False)
class StatisticalTests:
    """What the residuals say of the measurements."""

    reliability: Reliability
    """Reliability of control points, marks, GNSS positions, attitudes and focal lengths."""
    components: VarianceComponents
    """Residuals by group of observations."""
    constraints: ConstraintTests = field(default_factory=ConstraintTests.unknown)
    """Constraints between points, those that took part and those that are checks."""
    exposures: ExposureTests = field(default_factory=ExposureTests.unknown)
    """Relative poses of cameras on one body, and their exposures."""
    implied_offset_world_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """GNSS offsets (H, 3) that the flights without one would have, NaN where only the positions determine the datum."""
    implied_offset_covariance_m2: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    """Covariances (H, 3, 3) of these offsets."""
    residual_lever_arm_m: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    """Residual lever arm (3,) in the camera frame, beyond the one applied."""
    residual_lever_arm_sigma_m: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    """Its standard deviations (3,)."""
    residual_lever_arm_p: float = float("nan")
    """Probability of a residual lever arm this large by chance."""


@dataclass(frozen=True)
class Decision:
    """One thing that was decided about the model, or about what takes part."""

    about: str
    """What was decided on, in words."""
    adopted: bool
    """Whether it is in the model now, or left out of it as what was found wrong."""
    sentence: str
    """What was decided, and why."""
    statistic: float = float("nan")
    """Test statistic, χ², NaN where there is none."""
    degrees: int = 0
    """Its degrees of freedom."""
    p: float = float("nan")
    """Probability of as much by chance, NaN where there is none."""
    rivals: tuple[str, ...] = ()
    """What would explain the same nearly as well, in words."""


@dataclass(frozen=True, eq=False)
class Decisions:
    """What was decided about the model and about what takes part."""

    made: tuple[Decision, ...] = ()
    """All decisions, one by one; () of an adjustment in which none was to be made."""

    flights_without_offset: tuple[str, ...] = ()
    """Flights (H) with GNSS positions where no offset is estimated."""
    common_errors: tuple[CommonErrorEstimate, ...] = ()
    """Common errors of the measured attitudes and positions that were estimated, beside the offsets."""
    lens_fields: tuple[LensFieldDecision, ...] = ()
    """Whether each camera has a lens field, and why not; () where none was looked for."""
    sigmas: EstimatedSigmas = field(default_factory=EstimatedSigmas.none)
    """Standard deviations that were estimated from residuals; the block of the adjustment has those that were used."""
    readout_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Read-out times (cameras,) as estimated, before those that are not significant were fixed at zero; NaN where none
    was looked for."""
    readout_sigma_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Their standard deviations (cameras,)."""
    readout_focal_correlation: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Their correlations (cameras,) with the focal length of their camera, NaN where either is fixed."""
    readout_time_offset_correlation: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Their correlations (cameras,) with a time offset of exposures after GNSS positions, one that is estimated or that
    would be; NaN where the read-out time is fixed, or nothing tells a time offset."""
    neighbours_scatter_m_s: float = float("nan")
    """Standard deviation by which photographs under a rolling shutter flew at other velocities than the positions of
    their neighbours tell, for each component; 0 where none is significant, NaN where no velocity comes from there."""
    rejected_observations: int = 0
    """Number of rejected tie-point observations."""
    rejected_points: int = 0
    """Number of rejected tie points."""
    reason: tuple[str, ...] = ()
    """Why each photograph (N,) was removed, empty if it was not; () if none was."""
    heights: HeightDecision | None = None
    """Whether GNSS heights and those of control points are of one system; None where that is declared, or nothing to
    decide."""
    known_surface: SurfaceDecision | None = None
    """Whether a known surface is control of the block; None without one."""


@dataclass(frozen=True, eq=False)
class Adjustment:
    """The result of the joint adjustment. Ground points, control and check, are in the order of
    ``block.control_points``."""

    block: Block
    """The block with adjusted cameras, poses and tie points; only points and observations that were used."""
    sigma0: float
    """Standard deviation of unit weight, 1 expected."""
    redundancy: int
    """Redundancy of the adjustment."""
    iterations: int
    """Iterations of all rounds."""
    rounds: int
    """Rounds of outlier rejection."""
    converged: bool
    """Whether the last round converged."""
    cost: float
    """Half the weighted square sum of the residuals."""
    estimates: Estimates
    covariances: AdjustmentCovariances
    tests: StatisticalTests
    decisions: Decisions = field(default_factory=Decisions)
    warnings: tuple[str, ...] = ()
    """Sentences on what is weak, or was rejected by the adjustment."""

    def _facts(self) -> list[tuple[str, str]]:
        residual = self.estimates.residual_px
        rms_px = float(np.sqrt(np.mean(residual**2))) if residual.size else float("nan")
        variance = np.diagonal(self.covariances.tie_point_m2, axis1=1, axis2=2)
        east, north, up = np.sqrt(np.median(variance, axis=0)) if len(variance) else np.full(3, np.nan)
        return [
            ("sigma0", f"{self.sigma0:.3f}"),
            ("redundancy", str(self.redundancy)),
            ("converged", f"{'yes' if self.converged else 'no'}, after {things(self.iterations, 'iteration')}"),
            ("photographs", f"{self.block.registered.sum()} of {len(self.block.photographs)}"),
            ("tie points", f"{len(self.block.tie_points)}, {things(self.decisions.rejected_points, 'point')} rejected"),
            ("residuals of tie points, RMS", f"{rms_px:.3f} px"),
            ("sigma of a tie point, median east, north, up", f"{east:.4f}, {north:.4f}, {up:.4f} m"),
            *(("warning", text) for text in self.warnings),
        ]

    def __repr__(self) -> str:
        state = "converged" if self.converged else "not converged"
        return f"<Adjustment: sigma0 {self.sigma0:.3f}, redundancy {self.redundancy}, {state}, {self.block!r}>"

    def _repr_html_(self) -> str:
        return html_table("Joint adjustment", (), self._facts())

    def summary(self) -> str:
        """Return sigma0, redundancy, residuals and warnings as a table of text."""
        return text_table(self._facts())

    def plot(self) -> None:
        """Draw photographs, ground points and the residuals of control points from above, in the current axes of
        matplotlib."""
        call("plot_adjustment", self)

    def write(self, path: Path | str) -> None:
        """Write the exterior orientation of every photograph with its standard deviations as a table (CSV). Raises
        WorkspaceError where it cannot be written."""
        call("write_adjustment", Path(path), self)


@dataclass(frozen=True)
class FocalLength:
    """A focal length from several sources."""

    focal_px: float
    """Focal length, px."""
    sigma_px: float
    """Its standard deviation."""
    rejected: float
    """Probability that the source of the focal length is wrong."""


@dataclass(frozen=True)
class PhotographsSay:
    """The focal length determined by photographs, control points and GNSS positions, without its source."""

    focal_px: float
    """Focal length, px."""
    formal_sigma_px: float
    """Its formal standard deviation."""
    model_sigma_px: float
    """Standard deviation of the camera model's error, from parts of the images."""

    @property
    def sigma_px(self) -> float:
        """Return both standard deviations together."""
        return float(np.hypot(self.formal_sigma_px, self.model_sigma_px))

    @property
    def trustworthy(self) -> bool:
        """Return whether the camera model's error is too small to be told from chance."""
        return self.model_sigma_px <= self.formal_sigma_px


@dataclass(frozen=True)
class FocalDecision:
    """The decision on a focal length whose source the photographs contradict."""

    given_px: float
    """Focal length of the source, px."""
    given_sigma_px: float
    """Its stated standard deviation."""
    says: PhotographsSay
    """The focal length from the photographs."""
    settled: FocalLength
    """The focal length decided on."""
    evidence: float
    """Log likelihood of the control points for one or the other."""

    @property
    def sentence(self) -> str:
        """Return what there is to say of it."""
        say, is_ = self.says, self.settled
        given = f"{self.given_px:.1f} ± {self.given_sigma_px:.1f} px"
        photographs = f"{say.focal_px:.1f} ± {say.formal_sigma_px:.1f} px"
        if say.trustworthy:
            return (
                f"its source gives {given}, the photographs give {photographs}, consistently in all parts of "
                "the images: the source is rejected"
            )
        return (
            f"its source gives {given}, the photographs give {photographs}, but parts of the images disagree by "
            f"{say.model_sigma_px:.0f} px: an effect outside the camera model, such as a rolling shutter, "
            f"biases it. It is set to {is_.focal_px:.1f} ± {is_.sigma_px:.1f} px, which every predicted sigma "
            "includes: calibrate the camera, or add oblique photographs or control points at different heights"
        )
