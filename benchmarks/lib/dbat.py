"""The survey dbat_sxb as the Damped Bundle Adjustment Toolbox (DBAT) adjusted it, and what its report says.

Five aerial frames with surveyed control and check points. The block is made of DBAT's own tie points, marks and
control points, with the map as a Cartesian frame and the calibration held, so that both adjust the same observations.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.camera import Camera, omega_phi_kappa_deg
from photogram.frames import LocalFrame
from photogram.results import Adjustment
from photogram.sfm.orientation import resections_of
from photogram.survey import Block, ControlPoints, Photograph, Role, TiePoints

FRAMES = ("8811.jpg", "8936.jpg", "8937.jpg", "8938.jpg", "9111.jpg")
CHECKS = ("B4.6", "B3.11")
ELEMENTS = ("Omega", "Phi", "Kappa", "Xc", "Yc", "Zc")
STEP_RAD = 1e-6


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


def _number(text: str, pattern: str) -> float:
    found = re.search(pattern, text)
    if found is None:
        raise ValueError(f"no {pattern} in the report of DBAT")
    return float(found.group(1))


def _rows(text: str, heading: str, name: int, values: slice) -> dict[str, FloatArray]:
    """Return figures by name of the table that follows a heading."""
    lines = text.partition(heading)[2].splitlines()[1:]
    found = {}
    for line in lines[1:]:
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) <= name:
            break
        found[cells[name]] = np.array([float(cell) for cell in cells[values]])
    return found


def published(data: Path) -> Published:
    """Return the published result of the survey in a folder."""
    text = (data / "dbat_report.txt").read_text(encoding="utf-8")
    found = re.findall(r"(Omega|Phi|Kappa|Xc|Yc|Zc):\s+Value:\s+(\S+) \w+\s+Deviation: (\S+)", text)
    if [name for name, *_ in found] != list(ELEMENTS) * len(FRAMES):
        raise ValueError(f"{data}: dbat_report.txt does not list the exterior orientation of {len(FRAMES)} photographs")
    exterior, deviation = (
        np.array([float(row[k]) for row in found]).reshape(len(FRAMES), len(ELEMENTS)) for k in (1, 2)
    )
    control, checks = text.partition("Check measurements")[::2]
    return Published(
        _number(text, r"Sigma0:\s+(\S+)"),
        int(_number(text, r"Redundancy\s+(\S+)")),
        exterior,
        deviation,
        _rows(control.partition("Ctrl measurements")[2], "Posterior", 8, slice(4, 7)),
        _rows(checks, "Diff (pos=abs diff, std=rel diff)", 10, slice(1, 4)),
    )


def _table(path: Path) -> tuple[FloatArray, list[str]]:
    """Return the figures of one of DBAT's tables, and its names where it has them."""
    rows = [
        [cell.strip() for cell in line.split(",")]
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.strip() and not line.startswith("#")
    ]
    named = path.name == "sxb-control.txt"
    return np.array([[float(c) for i, c in enumerate(row) if not (named and i == 1)] for row in rows]), [
        row[1] for row in rows if named
    ]


def dbat_block(data: Path) -> Block:
    """Return the block as DBAT adjusts it. The marks of check points, which count among DBAT's observations, come in as
    tie points."""
    control, names = _table(data / "sxb-control.txt")
    marks, ties = _table(data / "markpts.txt")[0], _table(data / "smartpts.txt")[0]
    order = np.argsort(control[:, 0])
    control, names = control[order], [names[i] for i in order]
    check = np.array([name in CHECKS for name in names])
    roles: tuple[Role, ...] = tuple("check" if c else "control" for c in check)
    point = np.searchsorted(control[:, 0], marks[:, 0])
    measured = [np.column_stack([ties, np.ones(len(ties))]), np.column_stack([marks, np.full(len(marks), 0.5)])]
    tied = np.vstack([measured[0], measured[1][check[point]]])
    tied = tied[np.lexsort((tied[:, 1], tied[:, 0]))]
    ids, number = np.unique(tied[:, 0], return_inverse=True)
    frame = LocalFrame("EPSG:27561", (1000000.0, 112400.0, 140.0), "grid")
    camera = Camera("Camera1", 8858, 12996, 123.9392 * 1000 / 6, np.array([4429.5, 6468.5]))
    photographs = tuple(Photograph(name, 0) for name in FRAMES)
    block = Block(
        frame, (camera,), photographs, (None,) * len(FRAMES),
        TiePoints(
            (tied[:, 1] - 1).astype(np.int64), number.astype(np.int64), np.zeros(len(tied), np.int64), tied[:, 2:4],
            tied[:, 4], np.full((len(ids), 3), np.nan), np.zeros((len(ids), 3), np.uint8),
        ),
        ControlPoints(
            tuple(names), roles, frame.world_from_map(control[:, 1:4]), control[:, 4:7],
            (marks[:, 1] - 1).astype(np.int64), point.astype(np.int64), marks[:, 2:4], np.full(len(marks), 0.5),
        ),
    )  # fmt: skip
    resections, faults = resections_of(block)
    if faults or not all(r is not None and r.inliers.all() for r in resections):
        raise ValueError(f"{data}: its photographs cannot be resected: {faults}")
    return replace(block, poses=tuple(r.refined for r in resections if r is not None))


def adjusted(data: Path) -> Adjustment:
    """Return the adjustment of the block by plain least squares, as DBAT adjusts it: nothing is rejected."""
    settings = AdjustmentSettings(
        robust_loss="none", outlier_threshold=100.0, first_outlier_threshold_px=200.0, estimate_sigmas=False
    )
    return adjust(dbat_block(data), settings)


def exterior(result: Adjustment) -> FloatArray:
    """Return omega, phi, kappa in degrees and the projection centres in the map (N, 6)."""
    poses = [pose for pose in result.block.poses if pose is not None]
    angles = [omega_phi_kappa_deg(pose.rotation_world_from_camera) for pose in poses]
    centres = result.block.frame.map_from_world(np.array([pose.position_world_m for pose in poses]))
    return np.column_stack([np.array(angles), centres])


def _turned(rotation: FloatArray, axis: int, angle_rad: float) -> FloatArray:
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[[a, b], [a, b]], turn[b, a], turn[a, b] = np.cos(angle_rad), np.sin(angle_rad), -np.sin(angle_rad)
    return np.asarray(rotation @ turn)


def deviations(result: Adjustment) -> FloatArray:
    """Return the standard deviations (N, 6) of the exterior orientation, scaled by sigma0 as DBAT scales them.

    Rotations about the camera's axes become angles by their numerical derivatives.
    """
    angles = []
    for pose, covariance in zip(result.block.poses, result.rotation_covariance_rad2, strict=True):
        if pose is None:
            raise ValueError("every photograph of dbat_sxb is oriented")
        R = pose.rotation_world_from_camera
        jacobian = np.column_stack(
            [
                (omega_phi_kappa_deg(_turned(R, k, STEP_RAD)) - omega_phi_kappa_deg(_turned(R, k, -STEP_RAD)))
                / (2.0 * STEP_RAD)
                for k in range(3)
            ]
        )
        angles.append(np.sqrt(np.diag(jacobian @ covariance @ jacobian.T)))
    centres = np.sqrt(np.einsum("nii->ni", result.position_covariance_m2))
    return result.sigma0 * np.column_stack([np.array(angles), centres])


def ground(result: Adjustment, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return ground points, adjusted minus surveyed (G, 3), and their standard deviations (G, 3) scaled by sigma0."""
    frame, points = result.block.frame, result.block.control_points
    g = [points.name.index(name) for name in names]
    off_m = frame.map_from_world(result.ground_world_m[g]) - frame.map_from_world(points.position_world_m[g])
    return off_m, result.sigma0 * np.sqrt(np.einsum("nii->ni", result.ground_covariance_m2[g]))
