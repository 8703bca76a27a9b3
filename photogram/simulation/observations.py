"""The observations of a block of up to thousands of photographs, without rendering, over the bare terrain."""

from dataclasses import dataclass, replace

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera, Pose
from photogram.simulation.flight import (
    Flight,
    Sightings,
    Truth,
    candidates,
    fly,
    footprints,
    measure_control,
    observe,
    place_control,
    sight_ground,
    turned,
)
from photogram.simulation.scene import terrain_height
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import Block, TiePoints


@dataclass(frozen=True, eq=False)
class SimulatedBlock:
    """A block with starting values, and the truth; ``mismatch`` (N,) are the observations that were displaced."""

    plan: SurveyPlan
    seed: int
    block: Block
    truth: Truth
    tie_point_position_world_m: FloatArray
    mismatch: BoolArray


def simulate_block(
    plan: SurveyPlan,
    seed: int,
    *,
    tie_points: int = 2000,
    sigma_px: float = 0.5,
    mismatches: float = 0.0,
    detection: float = 1.0,
    start_position_sigma_m: float = 1.0,
    start_attitude_sigma_deg: float = 1.0,
    start_point_sigma_m: float = 1.0,
) -> SimulatedBlock:
    """Make the observations of a block over the bare terrain, nothing hidden, with perturbed starting values.

    Each photograph that shows a tie point observes it with the probability ``detection``, and with noise ``sigma_px``
    per coordinate; points with one ray only are left out. The fraction ``mismatches`` of all observations is displaced
    by 10 to 300 px. Poses and tie points start at the truth with the errors stated. Raises ValueError as ``simulate``
    does, and when the photographs do not overlap.
    """
    rng = np.random.default_rng([seed, 2])
    flight = fly(plan, rng)
    place = candidates(flight, rng)
    candidate = np.column_stack([place, terrain_height(seed, plan.relief_m, place)])
    seen = observe(flight, candidate, 25.0).table(len(flight.poses), len(candidate))
    ground = place_control(plan, candidate, seen)
    control = measure_control(flight, ground, observe(flight, ground, 5 * plan.stated_mark_sigma_px), rng)
    ties, position, mismatch = _tie_points(flight, seed, tie_points, sigma_px, mismatches, detection, rng)
    start = replace(ties, position_world_m=position + start_point_sigma_m * rng.standard_normal(position.shape))
    moved = flight.centres + start_position_sigma_m * rng.standard_normal((len(flight.poses), 3))
    noise_rad = np.radians(start_attitude_sigma_deg) * rng.standard_normal(moved.shape)
    block = Block(
        frame=plan.frame,
        cameras=(flight.approximate,),
        photographs=flight.photographs,
        poses=tuple(Pose(R, C) for R, C in zip(turned(flight.rotations, noise_rad), moved, strict=True)),
        tie_points=start,
        control_points=control,
        gnss_offset_sigma_m=np.array(plan.gnss_offset_sigma_m),
    )
    return SimulatedBlock(plan, seed, block, flight.truth(ground), position, mismatch)


def _displaced(pixel: FloatArray, camera: Camera, rng: np.random.Generator) -> FloatArray:
    """Move pixels (N, 2) by 10 to 300 px, log-uniformly, in any direction that stays within the photograph."""
    last = np.array([camera.width_px, camera.height_px]) - 1.0
    length = np.exp(rng.uniform(np.log(10.0), np.log(min(300.0, last.min() / 2.5)), len(pixel)))
    angle = rng.uniform(0.0, 2 * np.pi, len(pixel))
    step = length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(np.where((pixel + step < 0) | (pixel + step > last), pixel - step, pixel + step))


def _sighted(
    flight: Flight, seed: int, wanted: int, margin_px: float, detection: float, rng: np.random.Generator
) -> tuple[FloatArray, Sightings]:
    """Return the true positions of ``wanted`` points (P, 3) and who sees them: at least two photographs each.

    Raises ValueError when the photographs do not overlap enough.
    """
    corners = footprints(flight, 0.0).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    drawn = max(200, int(1.5 * wanted))
    for _ in range(6):
        points, seen = sight_ground(flight, seed, rng.uniform(low, high, (drawn, 2)), margin_px, detection, rng)
        enough = np.flatnonzero(np.bincount(seen.point, minlength=drawn) >= 2)
        if len(enough) >= wanted:
            break
        drawn *= 2
    else:
        raise ValueError(f"only {len(enough)} of {wanted} tie points lie in two photographs: raise the overlap")
    number = np.full(drawn, -1, np.int64)
    number[enough[:wanted]] = np.arange(wanted)
    seen = seen.select(number[seen.point] >= 0)
    return points[enough[:wanted]], replace(seen, point=number[seen.point])


def _tie_points(
    flight: Flight,
    seed: int,
    wanted: int,
    sigma_px: float,
    mismatches: float,
    detection: float,
    rng: np.random.Generator,
) -> tuple[TiePoints, FloatArray, BoolArray]:
    """Return tie points of unknown position, their true positions (P, 3), and which observations are mismatches."""
    position, seen = _sighted(flight, seed, wanted, 5 * sigma_px, detection, rng)
    n = len(seen.point)
    mismatch = rng.permutation(n) < round(mismatches * n)
    observed = seen.pixel + sigma_px * rng.standard_normal((n, 2))
    observed[mismatch] = _displaced(observed[mismatch], flight.camera, rng)
    feature = np.empty(n, np.int64)
    order = np.argsort(seen.photograph, kind="stable")
    feature[order] = np.arange(n) - np.searchsorted(seen.photograph[order], seen.photograph[order])
    ties = TiePoints(
        seen.photograph, seen.point, feature, observed, np.full(n, float(sigma_px)), np.full((wanted, 3), np.nan),
        np.full((wanted, 3), 128, np.uint8),
    )  # fmt: skip
    return ties, position, mismatch
