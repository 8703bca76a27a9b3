"""What an adjustment returns: estimates with their covariances, reliability, variance components, deformation modes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import FloatArray, IntArray
from photogram.survey import Block
from photogram.wording import html_table, things


@dataclass(frozen=True, eq=False)
class Reliability:
    """How well blunders would show in what was surveyed, along the map's axes, and what the rest says of it.

    Redundancy numbers and w-tests (Baarda 1968): ``ground_redundancy``, ``ground_w`` (G, 3) of the surveyed coordinates
    of control points, ``mark_redundancy``, ``mark_w`` (marks, 2) of their marks, ``gnss_redundancy``, ``gnss_w`` (N, 3)
    of GNSS positions. ``ground_left_out_m`` (G, 3) is predicted minus surveyed for a control point whose survey took no
    part, ``ground_left_out_covariance_m2`` (G, 3, 3) what it would scatter by; ``mark_left_out_px`` (marks, 2) and
    ``mark_left_out_covariance_px2`` (marks, 2, 2) the same for a mark, ``gnss_left_out_m`` (N, 3) with its covariances
    (N, 3, 3) for a GNSS position, ``attitude_left_out_rad`` (N, 3) with its covariances for a measured attitude, as a
    turn about the camera's axes, ``focal_left_out_px`` (cameras,) with its sigmas for a given focal length. NaN for
    check points, for what is not there, and where nothing else determines an observation.
    """

    ground_redundancy: FloatArray
    ground_w: FloatArray
    ground_left_out_m: FloatArray
    ground_left_out_covariance_m2: FloatArray
    mark_redundancy: FloatArray
    mark_w: FloatArray
    mark_left_out_px: FloatArray
    mark_left_out_covariance_px2: FloatArray
    gnss_redundancy: FloatArray
    gnss_w: FloatArray
    gnss_left_out_m: FloatArray
    gnss_left_out_covariance_m2: FloatArray
    attitude_left_out_rad: FloatArray
    attitude_left_out_covariance_rad2: FloatArray
    focal_left_out_px: FloatArray
    focal_left_out_sigma_px: FloatArray

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
    """What the groups of an adjustment's observations scatter by, against what was stated; nothing is rescaled by it.

    By group (K,): ``group`` its name, ``observations`` how many, ``redundancy`` the sum of their redundancy numbers,
    ``squares`` vᵀPv of their residuals, ``stated_sigma`` the median of their stated sigmas, in px, m or rad. All
    groups together make the redundancy and vᵀPv of the adjustment.
    """

    group: NDArray[np.str_]
    observations: IntArray
    redundancy: FloatArray
    squares: FloatArray
    stated_sigma: FloatArray

    @staticmethod
    def unknown() -> VarianceComponents:
        """Return those of no observations."""
        none = np.zeros(0)
        return VarianceComponents(np.zeros(0, dtype=np.str_), none.astype(np.int64), none, none, none)


@dataclass(frozen=True, eq=False)
class Deformation:
    """How a block may be bent, shifted or scaled as a whole without its measurements showing it, a priori.

    Errors in height of the tie points are a + b x/R + c y/R + d ((x² + y²)/R² − mean), x and y from ``centre_world_m``
    (2,), R = ``radius_m``: d is the dome. ``covariance`` (K, K) is joint of: mean error of the ground (east, north,
    up), b, c, d; mean error of the projection centres (east, north, up), all in m; per camera the mean rotations of its
    photographs about its x and y axes, rad; per camera its 11 parameters, zero where held; per flight the GNSS offset
    (east, north, up), m. ``intersection_sigma_m`` (3,) is the median sigma of tie points with the cameras taken as
    known, ``height_sigma_m`` (Q,) what the cameras add to it in height at places over the block. ``given_parameters``
    (cameras, 11) are the interior orientations before the adjustment. ``remedy`` (R,) names what was tried by
    covariance, ``remedy_sigma_m`` (R, 2, 3) holds before and after: sigma in height in the middle, root mean square
    over the block, sigma of d. ``freed_prior`` and ``freed_sigma`` (cameras, 11) are the sigmas to which held
    parameters were freed and those that they would have after the adjustment, 0 for the others;
    ``freed_height_sigma_m`` (3,) the sigmas of the heights then, as in ``remedy_sigma_m``. ``pattern_sigma_m`` (3,) is
    what an error of the camera model as large as the pattern of the residuals does to b, c and d, NaN where nothing is
    known of it. ``absolute_sigma_m`` and ``relative_sigma_m`` (3,) east, north, up are root mean squares, over places
    of the block, of what the cameras do to a point there: as such, and after the mean shift of all points is taken off,
    which leaves the shape of the block without its datum. ``ground_place_world_m`` (Q, 3) are places over the block,
    ``ground_covariance_m2`` (3 Q, 3 Q) the joint covariance of what the cameras do to the ground there.
    ``place_world_m`` (S, 3) are places spread over the ground, ``shape_covariance_m2`` (S, 3, 3) what the cameras add
    to their errors relative to the mean error of all of them: without the datum's common part.
    """

    centre_world_m: FloatArray
    radius_m: float
    covariance: FloatArray
    intersection_sigma_m: FloatArray
    height_sigma_m: FloatArray
    given_parameters: FloatArray
    remedy: NDArray[np.str_]
    remedy_sigma_m: FloatArray
    freed_prior: FloatArray
    freed_sigma: FloatArray
    freed_height_sigma_m: FloatArray
    pattern_sigma_m: FloatArray
    absolute_sigma_m: FloatArray
    relative_sigma_m: FloatArray
    ground_place_world_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    ground_covariance_m2: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    place_world_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    shape_covariance_m2: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))

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
class Adjustment:
    """The result of the joint adjustment.

    ``block`` holds adjusted cameras, poses and tie points: only points and observations that took part. Covariances are
    a-priori, in the world frame: ``position_covariance_m2`` (N, 3, 3) of the projection centres,
    ``rotation_covariance_rad2`` (N, 3, 3) about the camera's axes, ``calibration_covariance`` (cameras, 11, 11),
    ``tie_point_covariance_m2`` (P, 3, 3). Ground points, control and check, in the order of ``block.control_points``:
    ``ground_world_m`` (G, 3), NaN where a check point has fewer than two marks, with ``ground_covariance_m2`` (G, 3,
    3). ``residual_px`` (observations, 2) and ``mark_residual_px`` (marks, 2) are projected minus measured.
    ``offset_world_m`` (flights, 3) with its covariance. ``reliability`` of control points, marks and GNSS positions;
    ``deformation`` of the block as a whole, unknown until it is asked for.
    ``ground_joint_covariance_m2`` (3 G, 3 G) is that of all ground points together: they share the errors of the
    photographs. ``tie_point_ray_covariance_m2`` (P, 3, 3) is the part of the tie points' covariances that is their own;
    neighbours share the rest, which comes from the photographs. ``components``: what groups of observations scatter by.
    Where no offset is estimated, ``held_flights`` are those with GNSS positions, ``implied_offset_world_m`` (F, 3) with
    its covariance the offsets that would be, NaN where nothing but the positions tells. ``left_arm_camera_m`` (3,) with
    its sigmas is the lever arm that the positions show beside the one that is counted, ``left_arm_p`` the p of none.
    ``warnings`` say what is weak, or was left out by the adjustment; ``reason`` (N,) why it left a photograph out,
    empty where it did not, or () where it left out none.
    """

    block: Block
    sigma0: float
    redundancy: int
    residual_px: FloatArray
    mark_residual_px: FloatArray
    position_covariance_m2: FloatArray
    rotation_covariance_rad2: FloatArray
    calibration_covariance: FloatArray
    tie_point_covariance_m2: FloatArray
    ground_world_m: FloatArray
    ground_covariance_m2: FloatArray
    flights: tuple[str, ...]
    offset_world_m: FloatArray
    offset_covariance_m2: FloatArray
    iterations: int
    rounds: int
    converged: bool
    cost: float
    discarded_observations: int
    discarded_points: int
    reliability: Reliability
    ground_joint_covariance_m2: FloatArray
    tie_point_ray_covariance_m2: FloatArray
    components: VarianceComponents
    held_flights: tuple[str, ...] = ()
    implied_offset_world_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    implied_offset_covariance_m2: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    left_arm_camera_m: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    left_arm_sigma_m: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    left_arm_p: float = float("nan")
    deformation: Deformation = field(default_factory=Deformation.unknown)
    warnings: tuple[str, ...] = ()
    reason: tuple[str, ...] = ()

    def _facts(self) -> list[tuple[str, str]]:
        residual = self.residual_px
        rms_px = float(np.sqrt(np.mean(residual**2))) if residual.size else float("nan")
        oriented = sum(pose is not None for pose in self.block.poses)
        variance = np.diagonal(self.tie_point_covariance_m2, axis1=1, axis2=2)
        east, north, up = np.sqrt(np.median(variance, axis=0)) if len(variance) else np.full(3, np.nan)
        return [
            ("sigma0", f"{self.sigma0:.3f}"),
            ("redundancy", str(self.redundancy)),
            ("converged", f"{'yes' if self.converged else 'no'}, after {things(self.iterations, 'iteration')}"),
            ("photographs", f"{oriented} of {len(self.block.photographs)}"),
            ("tie points", f"{len(self.block.tie_points)}, {things(self.discarded_points, 'point')} rejected"),
            ("residuals of tie points, RMS", f"{rms_px:.3f} px"),
            ("sigma of a tie point, median east, north, up", f"{east:.4f}, {north:.4f}, {up:.4f} m"),
            *(("warning", text) for text in self.warnings),
        ]

    def __repr__(self) -> str:
        state = "converged" if self.converged else "not converged"
        return f"<Adjustment: sigma0 {self.sigma0:.3f}, redundancy {self.redundancy}, {state}, {self.block!r}>"

    def _repr_html_(self) -> str:
        return html_table("Joint adjustment", (), self._facts())


@dataclass(frozen=True)
class FocalLength:
    """What is known of a focal length, px: ``focal_px`` with ``sigma_px``, and ``rejected``, the probability that its
    source is wrong."""

    focal_px: float
    sigma_px: float
    rejected: float


@dataclass(frozen=True)
class PhotographsSay:
    """The focal length that photographs, control points and GNSS positions determine without its source, px: its formal
    standard deviation, and that of the camera model's error, from the parts of pictures."""

    focal_px: float
    formal_sigma_px: float
    model_sigma_px: float

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
    """What was decided on a focal length: the ``given`` one, what photographs ``say``, what was ``settled``, and the
    ``evidence`` of control points; ``sentence`` says it."""

    given_px: float
    given_sigma_px: float
    says: PhotographsSay
    settled: FocalLength
    evidence: float

    @property
    def sentence(self) -> str:
        """Return what there is to say of it."""
        say, is_ = self.says, self.settled
        given = f"{self.given_px:.1f} ± {self.given_sigma_px:.1f} px"
        photographs = f"{say.focal_px:.1f} ± {say.formal_sigma_px:.1f} px"
        if say.trustworthy:
            return (
                f"its source gives {given}, the photographs determine {photographs}, in all parts of the pictures "
                "alike: the source is rejected"
            )
        return (
            f"its source gives {given}, the photographs want {photographs}, but parts of the pictures disagree by "
            f"{say.model_sigma_px:.0f} px: something that the camera model leaves out, such as a rolling shutter, "
            f"moves it. It is set to {is_.focal_px:.1f} ± {is_.sigma_px:.1f} px, which every predicted sigma counts: "
            "calibrate the camera, or add oblique photographs or control points at different heights"
        )
