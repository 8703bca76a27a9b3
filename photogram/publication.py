"""The last stage: everything a surveyor takes away, written beside the project file.

Numbers in report.json, point clouds as text and LAZ, the DSM, tie points as npz and .mat, pictures. Every file is
written whole or not at all; the stage is complete only when all of them are there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from photogram import __version__
from photogram.files.atomic import make_folder
from photogram.files.images import read_pixels
from photogram.files.matlab import write_tie_points
from photogram.files.points import write_laz, write_xyz
from photogram.files.rasters import write_geotiff
from photogram.records import Run
from photogram.report.numbers import report_numbers
from photogram.report.pictures import (
    PlanContents,
    candidate_and_verified_matches,
    comparison_picture,
    plan_picture,
    residual_picture,
    shaded_surface,
)
from photogram.stages import Progress
from photogram.survey import Adjustment
from photogram.tracks import seen_in_all
from photogram.workspace import write_json, write_record

CLOUDS = ("linear_2view", "linear_3view", "adjusted")
CLOUD_FILES = {
    "linear_2view": "points_linear_2view",
    "linear_3view": "points_linear_3view",
    "adjusted": "points_adjusted",
}
MATCH_PICTURES = 3


def publish(run: Run, _: Path, progress: Progress) -> Mapping[str, object]:
    """Write report.json, clouds, DSM, tie points and pictures into the project's folder of results."""
    results = run.project.results
    make_folder(results / "pictures")
    products: list[str] = []
    result = run.adjustment()
    steps = (_clouds, _tables, _pictures, _match_pictures, _numbers)
    for number, step in enumerate(steps):
        progress(number, len(steps), step.__name__.strip("_").replace("_", " "))
        products += step(run, result, results)
    progress(len(steps), len(steps), "")
    return {"products": products}


def _clouds(run: Run, _: Adjustment, results: Path) -> list[str]:
    products = []
    for name in CLOUDS:
        cloud = run.cloud(name)
        write_xyz(results / f"{CLOUD_FILES[name]}.txt", cloud)
        write_laz(results / f"{CLOUD_FILES[name]}.laz", cloud, run.project.crs)
        products += [f"{CLOUD_FILES[name]}.txt", f"{CLOUD_FILES[name]}.laz"]
    return products


def _tables(run: Run, result: Adjustment, results: Path) -> list[str]:
    write_record(results / "tie_points.npz", result.block.tie_points)
    write_tie_points(results / "tie_points.mat", run.names, result.block.tie_points)
    products = ["tie_points.npz", "tie_points.mat", "dsm.tif"]
    common = seen_in_all(result.block.tie_points, range(len(run.names)))
    if len(common):
        write_record(results / "tie_points_in_all.npz", common)
        products.append("tie_points_in_all.npz")
    write_geotiff(results / "dsm.tif", run.surface(), run.project.crs)
    return products


def _file_name(name: str) -> str:
    """Return a camera's or photograph's name without what a file name cannot hold."""
    return re.sub(r"[^\w-]+", "_", name.removesuffix(Path(name).suffix))


def _plan(result: Adjustment) -> PlanContents:
    """Gather what the plan shows, all in the map frame."""
    block, frame = result.block, result.block.frame
    position = frame.map_from_world(np.array([pose.position_world_m for pose in block.poses if pose is not None]))
    gnss = np.full_like(position, np.nan)
    for i, photograph in enumerate(block.photographs):
        if photograph.gnss_world_m is not None:
            gnss[i] = frame.map_from_world(photograph.gnss_world_m[None])[0]
    points = block.control_points
    surveyed = frame.map_from_world(points.position_world_m)
    return PlanContents(
        [p.name for p in block.photographs],
        position,
        position - gnss,
        points.name,
        points.role,
        surveyed,
        frame.map_from_world(result.ground_world_m) - surveyed,
        frame.map_from_world(block.tie_points.position_world_m),
    )


def _pictures(run: Run, result: Adjustment, results: Path) -> list[str]:
    pictures, block = results / "pictures", result.block
    products = ["pictures/surface.png", "pictures/plan.png"]
    shaded_surface(pictures / "surface.png", run.surface(), "Digital surface model")
    plan_picture(pictures / "plan.png", _plan(result), "Photographs, control points and tie points")
    for c, camera in enumerate(block.cameras):
        seen = np.array([p.camera == c for p in block.photographs], dtype=bool)[block.tie_points.photograph]
        if seen.any():
            name = f"residuals_{_file_name(camera.name)}.png"
            title = f"Residuals of tie points in {camera.name}"
            residual_picture(pictures / name, camera, block.tie_points.pixel[seen], result.residual_px[seen], title)
            products.append(f"pictures/{name}")
    comparisons = run.comparisons()
    if comparisons:
        comparison_picture(pictures / "comparison.png", comparisons)
        products.append("pictures/comparison.png")
    return products


def _match_pictures(run: Run, _: Adjustment, results: Path) -> list[str]:
    """Picture the pairs with the most verified matches."""
    products = []
    matches = sorted(run.matches(), key=lambda m: (-int(m[1].sum()), m[0].first, m[0].second))
    for candidates, verified in matches[:MATCH_PICTURES]:
        first, second = run.project.photographs[candidates.first], run.project.photographs[candidates.second]
        name = f"pictures/matches_{_file_name(first.name)}_{_file_name(second.name)}.png"
        candidate_and_verified_matches(
            results / name,
            read_pixels(first.path),
            read_pixels(second.path),
            run.features(candidates.first).pixel[candidates.index[:, 0]],
            run.features(candidates.second).pixel[candidates.index[:, 1]],
            verified,
            f"{first.name} and {second.name}",
        )
        products.append(name)
    return products


def _numbers(run: Run, result: Adjustment, results: Path) -> list[str]:
    clouds = {name: run.cloud(name) for name in CLOUDS}
    stages = (
        "photographs",
        "orientation",
        "features",
        "matches",
        "tie_points",
        "intersection",
        "adjustment",
        "surface",
        "comparison",
    )
    seconds = {name: float(run.workspace.summary(name)["seconds"]) for name in stages}
    value = report_numbers(result, run.orientation(), clouds, run.comparisons(), version=__version__, seconds=seconds)
    write_json(results / "report.json", value)
    return ["report.json"]
