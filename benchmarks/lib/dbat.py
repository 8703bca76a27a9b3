"""The survey dbat_sxb as the Damped Bundle Adjustment Toolbox (DBAT) adjusted it, and what its report says.

Five aerial frames with surveyed control and check points. The block is made of DBAT's own tie points, marks and
control points, with the map as a Cartesian frame and the calibration held, so that both adjust the same observations.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photogram.adjustment.adjustment import adjust
from photogram.arrays import FloatArray
from photogram.camera import omega_phi_kappa_deg
from photogram.exchange.audit.audit import LEAST_SQUARES
from photogram.exchange.audit.foreign_block import foreign_block, with_their_model
from photogram.exchange.audit.precision import exterior_sigmas
from photogram.exchange.formats.dbat.dbat import read_dbat
from photogram.exchange.formats.dbat.dbat_report import read_report
from photogram.results import Adjustment
from photogram.sfm.orientation import resections_of
from photogram.survey import Block

FRAMES = ("8811.jpg", "8936.jpg", "8937.jpg", "8938.jpg", "9111.jpg")
REPORT = "dbat_report.txt"


@dataclass(frozen=True, eq=False)
class Published:
    """What dbat_report.txt says: standard deviations are scaled by sigma0, angles are in degrees."""

    sigma0: float
    redundancy: int
    exterior: FloatArray
    """Omega, phi, kappa, easting, northing, height of the photographs (N, 6)."""
    deviation: FloatArray
    """Their standard deviations (N, 6), with three digits."""
    control_deviation_m: dict[str, FloatArray]
    """Standard deviations (3,) of the adjusted control points, with three digits."""
    check_m: dict[str, FloatArray]
    """Check points, adjusted minus surveyed (3,), to the millimetre."""
    check_deviation_m: dict[str, FloatArray]
    """Standard deviations (3,) of the adjusted check points, with three digits."""


def published(data: Path) -> Published:
    """Return the published result of the survey in a folder."""
    report, solution = read_report(data / REPORT), read_dbat(data / REPORT)
    points, stated = solution.ground_points, solution.stated
    if points is None or stated.ground_m is None or stated.ground_sigma_m is None:
        raise ValueError(f"{data}: {REPORT} states no adjusted ground points")
    if tuple(p.name for p in report.photographs) != FRAMES:
        raise ValueError(f"{data}: {REPORT} does not list the exterior orientation of {len(FRAMES)} photographs")
    off = np.round(stated.ground_m - points.position_world_m, 3)
    of = {role: [g for g, r in enumerate(points.role) if r == role] for role in ("control", "check")}
    return Published(
        report.sigma0,
        report.redundancy,
        np.array([photograph.values for photograph in report.photographs]),
        np.array([photograph.sigmas for photograph in report.photographs]),
        {points.name[g]: stated.ground_sigma_m[g] for g in of["control"]},
        {points.name[g]: off[g] for g in of["check"]},
        {points.name[g]: stated.ground_sigma_m[g] for g in of["check"]},
    )


def dbat_block(data: Path) -> Block:
    """Return the block as DBAT adjusts it, its poses by resection from the control points. The marks of check points,
    which count among DBAT's observations, come in as tie points."""
    solution = read_dbat(data / REPORT)
    block = with_their_model(foreign_block(solution), solution)
    block = replace(block, poses=(None,) * len(FRAMES))
    resections, faults = resections_of(block)
    if faults or not all(r is not None and r.inliers.all() for r in resections):
        raise ValueError(f"{data}: its photographs cannot be resected: {faults}")
    return replace(block, poses=tuple(r.refined for r in resections if r is not None))


def adjusted(data: Path) -> Adjustment:
    """Return the adjustment of the block by plain least squares, as DBAT adjusts it: nothing is rejected."""
    return adjust(dbat_block(data), LEAST_SQUARES)


def exterior(result: Adjustment) -> FloatArray:
    """Return omega, phi, kappa in degrees and the projection centres in the map (N, 6)."""
    poses = [pose for pose in result.block.poses if pose is not None]
    angles = [omega_phi_kappa_deg(pose.rotation_world_from_camera) for pose in poses]
    centres = result.block.frame.map_from_world(np.array([pose.position_world_m for pose in poses]))
    return np.column_stack([np.array(angles), centres])


def deviations(result: Adjustment) -> FloatArray:
    """Return the standard deviations (N, 6) of the exterior orientation, scaled by sigma0 as DBAT scales them."""
    return result.sigma0 * np.column_stack(exterior_sigmas(result))


def ground(result: Adjustment, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return ground points, adjusted minus surveyed (G, 3), and their standard deviations (G, 3) scaled by sigma0."""
    frame, points = result.block.frame, result.block.control_points
    g = [points.name.index(name) for name in names]
    off_m = frame.map_from_world(result.estimates.ground_world_m[g]) - frame.map_from_world(points.position_world_m[g])
    return off_m, result.sigma0 * np.sqrt(np.einsum("nii->ni", result.covariances.ground_m2[g]))
