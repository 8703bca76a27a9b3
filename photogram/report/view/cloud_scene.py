"""The cloud as the page holds it: its points as few bytes, and what the page must know of them."""

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import FloatArray
from photogram.files.clouds.described_points import DescribedCloud
from photogram.report.view.packing import UNKNOWN, pack_figures, pack_positions
from photogram.report.view.packing import as_text as packed_text

Json = dict[str, Any]

UNKNOWN_CONFIDENCE = 255

_SPACING_SAMPLE = 4000  # points whose nearest neighbour is looked for, about
_DIRECTIONS = 48  # in which the outline of the ground is sought


def cloud_scene(cloud: DescribedCloud) -> tuple[Json, dict[str, str]]:
    """Return what the page must know of the points, and their bytes as text.

    ``points``: step east, north, up, and sigma of the height, 16 bits each. ``looks``: red, green, blue, confidence, 8
    bits each. ``plan``: sigma in plan, 16 bits, where there is one.
    """
    packed = pack_positions(cloud.position_map_m)
    cloud = cloud.chosen(packed.order)
    n, position = len(cloud), cloud.position_map_m
    sigma, sigma_plan = cloud.figures.get("sigma z"), cloud.figures.get("sigma xy")
    confidence = cloud.figures.get("confidence")
    height_steps, height_step_m = pack_figures(sigma, n)
    looks = np.zeros((n, 4), dtype=np.uint8)
    looks[:, 3] = UNKNOWN_CONFIDENCE
    if cloud.colour is not None:
        looks[:, :3] = cloud.colour
    if confidence is not None:
        known = np.isfinite(confidence)
        looks[known, 3] = np.rint(254 * np.clip(confidence[known], 0.0, 1.0)).astype(np.uint8)
    arrays = {"points": packed_text(np.column_stack([packed.step, height_steps])), "looks": packed_text(looks)}
    plan_step_m = None
    if sigma_plan is not None:
        plan_steps, plan_step_m = pack_figures(sigma_plan, n)
        arrays["plan"] = packed_text(plan_steps)
    height = position[:, 2]
    core_low_m, core_high_m = np.percentile(position, [0.5, 99.5], axis=0)
    scene = {
        "shown": n,
        "origin_map_m": packed.origin_map_m.tolist(),
        "step_m": packed.step_m,
        "blocks": packed.blocks.tolist(),
        "low_m": (position.min(axis=0) - packed.origin_map_m).tolist(),
        "high_m": (position.max(axis=0) - packed.origin_map_m).tolist(),
        "core_low_m": (core_low_m - packed.origin_map_m).tolist(),
        "core_high_m": (core_high_m - packed.origin_map_m).tolist(),
        "outline_m": _outline(position - packed.origin_map_m).tolist(),
        "ground_m": float(np.median(height) - packed.origin_map_m[2]),
        "extent_m": max(float(np.linalg.norm((core_high_m - core_low_m)[:2])), 1e-3),
        "spacing_m": spacing_m(position),
        "colour": cloud.colour is not None,
        "height": _range(height, 1, 99),
        "sigma": None if sigma is None else _range(sigma, 0, 98),
        "sigma_step_m": height_step_m,
        "sigma_plan_step_m": plan_step_m,
        "unknown": UNKNOWN,
        "confidence": confidence is not None,
    }
    return scene, arrays


def _outline(place_m: FloatArray) -> FloatArray:
    """Return points (K, 3) of the cloud (N, 3) around what a first look should show: its hull in plan without the
    outermost points, and the highest and lowest of the others."""
    low, high = np.percentile(place_m, [0.5, 99.5], axis=0)
    core = place_m[np.all((place_m >= low) & (place_m <= high), axis=1)]
    core = core if len(core) else place_m
    angle = np.linspace(0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    ends = np.argmax(core[:, :2] @ np.vstack([np.cos(angle), np.sin(angle)]), axis=0)
    index = np.unique([*ends, np.argmin(core[:, 2]), np.argmax(core[:, 2])])
    return np.asarray(core[index])


def _range(values: FloatArray, low: float, high: float) -> list[float] | None:
    """Return the percentiles between which colours are spread, apart; None where nothing is known."""
    known = values[np.isfinite(values)]
    if not len(known):
        return None
    bottom, top = (float(np.percentile(known, end)) for end in (low, high))
    return [bottom, max(top, bottom + 1e-3)]


def spacing_m(position_map_m: FloatArray) -> float:
    """Return the median distance of a sample of points to their nearest neighbours."""
    if len(position_map_m) < 2:
        return 1.0
    sample = position_map_m[:: max(len(position_map_m) // _SPACING_SAMPLE, 1)]
    distance = np.asarray(cKDTree(position_map_m).query(sample, k=2)[0])
    return float(max(np.median(distance[:, 1]), 1e-4))
