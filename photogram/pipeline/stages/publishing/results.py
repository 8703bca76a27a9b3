"""The last stage: everything a surveyor takes away, written beside the project file.

Numbers in report.json and as a page in report.html, exterior orientation as CSV and GeoJSON, point clouds as text and
LAZ, the DSM, tie points as npz and .mat, pictures. Every file is written whole or not at all; the stage is complete
only when all of them are there.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from heapq import nlargest
from os.path import relpath
from pathlib import Path
from shutil import copyfile
from threading import Event

import numpy as np
from typing_extensions import TypedDict

from photogram import __version__
from photogram.adjustment.oriented_subset import of_surveyed_points
from photogram.files.atomic import make_folder_within, remove_leftovers, replacing
from photogram.files.clouds.points import write_laz, write_xyz
from photogram.files.matlab import write_tie_points
from photogram.files.npz_json import file_fingerprint, read_json
from photogram.files.photographs.masks import name_of_mask, write_mask
from photogram.files.poses import write_pose_geojson, write_pose_table
from photogram.files.records import write_record
from photogram.geodesy.crs import NO_CRS, crs_in_words
from photogram.geodesy.height_systems import HeightSystem
from photogram.languages.language import Language
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import (
    ADJUSTED_BYTES,
    COARSER,
    LIBRARIES_BYTES,
    PICTURE_BYTES,
    POINT_BYTES,
    Costs,
    Extent,
    Memory,
    Rate,
)
from photogram.pipeline.stages.bands.band_orthophoto import band_records
from photogram.pipeline.stages.comparison import stored_comparisons
from photogram.pipeline.stages.features import stored_features
from photogram.pipeline.stages.matches import stored_matches
from photogram.pipeline.stages.order import BEFORE_RESULTS
from photogram.pipeline.stages.orientation import stored_orientation
from photogram.pipeline.stages.publishing.mark_pictures import mark_kinds, mark_pictures
from photogram.pipeline.stages.publishing.products import (
    CLOUD,
    copy_products,
    flight_date,
    report_surface,
    write_dense_cloud,
)
from photogram.pipeline.stages.publishing.report_files import (
    adjustment_effort,
    deliverables,
    discard_prints,
    mask_numbers,
    measurements_of,
    rejected_attitudes,
    rejected_blunders,
    survey_record,
    today,
    write_report,
)
from photogram.pipeline.stages.stored_adjustment import (
    CLOUDS,
    FIXED,
    OBSERVATIONS,
    stored_adjustment,
    stored_cloud,
    stored_resections,
)
from photogram.pipeline.stages.stored_surface import StoredSurface, reason_left_out
from photogram.pipeline.stages.surface_frame import SurfaceFrame, made_frame
from photogram.pipeline.stages.surfaces.volume_files import volumes_picture, volumes_record
from photogram.pipeline.store.readme import README, write_readme
from photogram.pipeline.store.results_record import recorded, records, remove_outdated
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.stage_summary import StageNote
from photogram.report.figures.difference_figure import difference_figure
from photogram.report.figures.page_figures import page_figures, volumes_figure
from photogram.report.figures.plan_view import plan_contents, plan_figure
from photogram.report.figures.style import (
    candidate_and_verified_matches,
    comparison_figure,
    field_figure,
    residual_figure,
    save_picture,
    surface_figure,
)
from photogram.report.known_surface import known_surface_numbers
from photogram.report.local_frame import constraint_numbers, distance_numbers, local_frame_numbers, marked_points
from photogram.report.marks import mark_kind_numbers
from photogram.report.numbers.dense import overlap_on_surface
from photogram.report.numbers.gnss import gnss_numbers
from photogram.report.numbers.heights import height_numbers
from photogram.report.numbers.numbers import report_numbers
from photogram.report.numbers.overlap import Overlap, ground_overlap
from photogram.report.numbers.rigs import rig_numbers
from photogram.report.numbers.statistics import dsm_numbers
from photogram.report.record.report import SurveyNumbers
from photogram.report.record.surfaces import DsmRecord, NoSurfaceRecord
from photogram.report.versions import versions
from photogram.result_files import MASKS, PICTURES, ResultFolder, within_results
from photogram.results import Adjustment
from photogram.sfm.tie_points.tracks import seen_in_all
from photogram.wording import Progress, file_stem, things

MATCH_PICTURES = 3


class ResultsSummary(TypedDict):
    """What the stage says of itself."""

    products: list[str]
    """Names of the files in the folder of results."""


@dataclass(frozen=True, eq=False)
class _Outcome:
    """What is published: the run, what it found, with points that are not surveyed (``whole``) and without, its
    surface, the folder of results, and that of the stage itself."""

    run: Run
    whole: Adjustment
    result: Adjustment
    overlap: Overlap | None
    surface: StoredSurface
    results: Path
    folder: Path


def publish(run: Run, folder: Path, progress: Progress) -> ResultsSummary:
    """Write report.json, report.html, exterior orientation, clouds, DSM, tie points and pictures into the project's
    folder of results, and remove what an earlier run has written there and this one does not."""
    results = run.project.results
    masks = [results / MASKS] if run.automatically_masked else []
    places = [*(results / name for name in ResultFolder), results / PICTURES, *masks]
    for place in places:
        make_folder_within(place)
    for place in (results, *places):
        remove_leftovers(place)
    discard_prints(results)
    with recorded(results):
        products = _written(run, folder, progress)
    remove_outdated(results, [*products, within_results(README)])
    write_readme(results, Language(run.project.report.language))
    return {"products": [*products, within_results(README), *records(results)]}


def _written(run: Run, folder: Path, progress: Progress) -> list[str]:
    """Write all products and return their names."""
    results, products = run.project.results, list[str]()
    whole = stored_adjustment(run)
    result = of_surveyed_points(whole)
    outcome = _Outcome(
        run, whole, result, ground_overlap(result, stored_cloud(run, "adjusted").position_map_m), StoredSurface(run),
        results, folder,
    )  # fmt: skip
    steps = (_clouds, _tables, _photographs, _masks, _pictures, _match_pictures)
    # rasters and the dense cloud are written by libraries that leave Python alone, while it draws
    ended = Event()
    with ThreadPoolExecutor(1) as writer:
        surfaces = writer.submit(_surfaces, outcome, ended)
        try:
            for number, step in enumerate(steps):
                progress(number, len(steps) + 1, step.__name__.strip("_").replace("_", " "))
                products += step(outcome)
            progress(len(steps), len(steps) + 1, "numbers")
            products += _numbers(outcome, products, surfaces)
        finally:
            ended.set()
    progress(len(steps) + 1, len(steps) + 1, "")
    return [*products, *surfaces.result()]


def _clouds(outcome: _Outcome) -> list[str]:
    products = []
    created = flight_date(outcome.run.notes(), outcome.result.block.poses)
    for name in CLOUDS:
        cloud, crs = stored_cloud(outcome.run, name), outcome.run.project.product_crs
        text, laz = within_results(f"points_{name}.txt"), within_results(f"points_{name}.laz")
        write_xyz(outcome.results / text, cloud, 5 if crs == NO_CRS else 3, crs)
        write_laz(outcome.results / laz, cloud, crs, created)
        products += [text, laz]
    return products


def _tables(outcome: _Outcome) -> list[str]:
    run, tie_points, results = outcome.run, outcome.result.block.tie_points, outcome.results
    products = [within_results("tie_points.npz"), within_results("tie_points.mat")]
    write_record(results / products[0], tie_points)
    write_tie_points(results / products[1], run.names, tie_points)
    products.append(within_results(OBSERVATIONS))
    with replacing(results / products[-1]) as temporary:
        copyfile(run.workspace.file("adjustment", OBSERVATIONS), temporary)
    common = seen_in_all(tie_points, np.unique(tie_points.photograph).tolist())
    if len(common):
        products.append(within_results("tie_points_in_all.npz"))
        write_record(results / products[-1], common)
    return products


def _surfaces(outcome: _Outcome, ended: Event) -> list[str]:
    copied, cloud = copy_products(outcome.run, outcome.results), within_results(CLOUD)
    return [*copied, cloud] if write_dense_cloud(outcome.run, outcome.results / cloud, ended) else copied


def _photographs(outcome: _Outcome) -> list[str]:
    words = crs_in_words(outcome.run.project.crs, outcome.run.project.heights)
    table, types, grid, points, footprints = map(
        within_results,
        ("photographs.csv", "photographs.csvt", "photographs.prj", "photographs.geojson", "footprints.geojson"),
    )
    write_pose_table(outcome.results / table, outcome.result, words)
    if outcome.result.block.frame.is_local:
        return [table, types]
    places = outcome.results / points, outcome.results / footprints
    write_pose_geojson(*places, outcome.result, outcome.run.project.datum.grid)
    return [table, types, grid, points, footprints]


def _masks(outcome: _Outcome) -> list[str]:
    """Write the whole mask of every photograph that has one found automatically, to be looked at, edited and given."""
    run, products = outcome.run, list[str]()
    for index, name in enumerate(run.names):
        used = run.mask(index) if name in run.automatically_masked else None
        if used is not None:
            products.append(f"{MASKS}/{name_of_mask(name)}")
            write_mask(outcome.results / products[-1], used)
    return products


def _pictures(outcome: _Outcome) -> list[str]:
    run, result, pictures = outcome.run, outcome.result, outcome.results / PICTURES
    block = result.block
    products = [f"{PICTURES}/plan.png"] if outcome.whole.block.has_scale else list[str]()
    if outcome.surface.is_there:
        products.append(f"{PICTURES}/surface.png")
        upright = made_frame(run).plane is not None
        figure = surface_figure(outcome.surface.heights(), "Digital surface model", upright=upright)
        save_picture(figure, pictures / "surface.png")
    if outcome.whole.block.has_scale:
        contents = plan_contents(result, outcome.overlap, stored_orientation(run).component)
        save_picture(plan_figure(contents, "Photographs, ground points and overlap"), pictures / "plan.png")
    for c, camera in enumerate(block.cameras):
        seen = np.array([p.camera == c for p in block.photographs], dtype=bool)[block.tie_points.photograph]
        if seen.any():
            name = f"residuals_{file_stem(c + 1, camera.name)}.png"
            title = f"Residuals of tie points in {camera.name}"
            pixel, residual_px = block.tie_points.pixel[seen], result.estimates.residual_px[seen]
            save_picture(residual_figure(camera, pixel, residual_px, title), pictures / name)
            products.append(f"{PICTURES}/{name}")
        if camera.field is not None:
            name, title = f"lens_field_{file_stem(c + 1, camera.name)}.png", f"Lens field of {camera.name}"
            figure = field_figure(camera, camera.field, result.covariances.lens_field_px2[c], title)
            save_picture(figure, pictures / name)
            products.append(f"{PICTURES}/{name}")
    volumes = volumes_picture(run)
    if volumes is not None:
        save_picture(difference_figure(volumes), pictures / "volumes.png")
        products.append(f"{PICTURES}/volumes.png")
    comparisons = stored_comparisons(run)
    if comparisons:
        save_picture(comparison_figure(comparisons), pictures / "comparison.png")
        products.append(f"{PICTURES}/comparison.png")
    return products


def _match_pictures(outcome: _Outcome) -> list[str]:
    """Picture the pairs with the most verified matches."""
    run, products = outcome.run, []
    best = nlargest(MATCH_PICTURES, stored_matches(run), key=lambda m: (int(m[1].sum()), -m[0].first, -m[0].second))
    for candidates, verified in best:
        first, second = run.project.photographs[candidates.first], run.project.photographs[candidates.second]
        stems = (file_stem(i + 1, p.name) for i, p in ((candidates.first, first), (candidates.second, second)))
        name = f"{PICTURES}/matches_{'_'.join(stems)}.png"
        candidate_and_verified_matches(
            outcome.results / name,
            run.pixels(candidates.first),
            run.pixels(candidates.second),
            stored_features(run, candidates.first).pixel[candidates.index[:, 0]],
            stored_features(run, candidates.second).pixel[candidates.index[:, 1]],
            verified,
            f"{first.name} and {second.name}",
        )
        products.append(name)
    return products


def _dsm(surface: StoredSurface) -> DsmRecord | NoSurfaceRecord:
    if not surface.is_there:
        return {"left_out": reason_left_out(surface.run, "surface")}
    shape, relative = SurfaceFrame(surface.run).shape(), surface.relative_sigma()
    datum = None if shape is None else shape.datum_covariance_m2
    return dsm_numbers(surface.heights(), surface.sigma(), surface.held_out_m(), relative, datum)


def _gnss_systems(run: Run) -> list[HeightSystem | None]:
    """Return the system in which every GNSS height there is was given."""
    notes = run.notes()
    systems = run.project.gnss_systems([note["height_is_ellipsoidal"] for note in notes])
    return [system for system, note in zip(systems, notes, strict=True) if note["gnss_map_m"] is not None]


def _numbers(outcome: _Outcome, products: list[str], surfaces: Future[list[str]]) -> list[str]:
    """Write the report over everything; ``products`` are the files that were written before it, and ``surfaces`` those
    that are written meanwhile."""
    run = outcome.run
    clouds = {name: stored_cloud(run, name) for name in CLOUDS}
    notes = {stage.name: run.workspace.summary(stage.name, StageNote) for stage in BEFORE_RESULTS}
    adjusted = report_numbers(
        outcome.result,
        replace(stored_orientation(run), resections=stored_resections(run)),
        clouds,
        stored_comparisons(run),
        outcome.overlap,
        version=__version__,
        seconds={name: note["seconds"] for name, note in notes.items()},
        fixed=dict(read_json(run.workspace.file("adjustment", FIXED))),
        blunders=rejected_blunders(run),
        rejected=rejected_attitudes(run),
        effort=adjustment_effort(run),
        measured=run.block().surveyed.control_points,
        mark_kinds=mark_kinds(run),
        sources=run.project.camera_source,
    )
    surface = report_surface(outcome.surface, adjusted["control_points"], outcome.results)
    upright = surface.plane is not None and surface.plane["used"]
    overlap = adjusted["block"]["overlap"]
    if overlap is not None and surface.dense is not None and not upright:
        adjusted["block"]["overlap"] = overlap_on_surface(overlap, surface.dense)
    numbers: SurveyNumbers = {
        **adjusted,
        "heights": height_numbers(
            run.project.heights,
            outcome.result.block.frame,
            _gnss_systems(run),
            [point.heights for point in run.project.surveyed.control_points],
            outcome.result.decisions.heights,
        ),
        "gnss": gnss_numbers(outcome.result, run.notes()),
        "dsm": _dsm(outcome.surface),
        "survey": survey_record(run),
        "versions": versions(),
        "peak_memory_bytes": {name: note.get("peak_memory_bytes") for name, note in notes.items()},
        "processed": today(),
        "deliverables": deliverables(outcome.results, [*products, *surfaces.result(), *surface.pictures]),
    }
    masks = mask_numbers(run)
    if masks is not None:
        numbers["masks"] = masks
    if run.stretches:
        numbers["stretches"] = {n: {"low_dn": own.low, "high_dn": own.high} for n, own in run.stretches.items()}
    marks = mark_pictures(run, adjusted["control_points"])
    if adjusted["control_points"]:
        numbers["marks"] = {"kinds": mark_kind_numbers(adjusted["control_points"]), "not_shown": marks.not_shown}
    local = local_frame_numbers(outcome.whole, run.block(), run.project.orientation.vertical)
    if local is not None:
        numbers["local_frame"] = local
    if run.project.constraints:
        numbers["distances"] = distance_numbers(outcome.whole, run.block())
        numbers["constraints"] = constraint_numbers(outcome.whole, run.block())
        numbers["marked_points"] = marked_points(outcome.whole)
    if run.project.rigs:
        numbers["rigs"] = rig_numbers(outcome.whole, run.block(), band_records(run))
    known = known_surface_numbers(outcome.result)
    if known is not None:
        numbers["known_surface"] = known
    if surface.orthophoto is not None:
        numbers["orthophoto"] = surface.orthophoto
    if surface.dense is not None:
        numbers["dense"] = surface.dense
    if surface.plane is not None:
        numbers["plane"] = surface.plane
    volumes, picture = volumes_record(run), volumes_picture(run)
    if volumes is not None:
        numbers["volumes"] = volumes
    sparse = outcome.surface.heights() if surface.dense is None and outcome.surface.is_there else None
    figures = page_figures(
        outcome.result,
        outcome.overlap,
        clouds["adjusted"],
        sparse,
        stored_comparisons(run),
        upright=upright,
        component=stored_orientation(run).component,
        language=Language(run.project.report.language),
    )
    figures += surface.figures + marks.figures
    if picture is not None:
        figures.append(volumes_figure(picture))
    return write_report(run.project, numbers, figures, outcome.folder) + surface.pictures


REPORT_DISK_BYTES = 14e6
"""On disk for the report, its figures and pictures."""

REPORT_BYTES, FIGURES_BYTES = 54.0, 140e6
"""In memory for a cell of the surface, measured on seven million cells, the relative standard deviations included; and
for figures."""


def _disk_bytes(extent: Extent) -> float:
    picture = extent.size.orthophoto_cells * extent.size.covered_share * PICTURE_BYTES
    copied = extent.relief_bytes + picture + extent.raster_bytes + POINT_BYTES * extent.matched_cells
    return copied + REPORT_DISK_BYTES + 2.0 * ADJUSTED_BYTES * extent.key_points


RESULTS: Stage = Stage(
    "results",
    "Report",
    (
        "orientation",
        "matches",
        "intersection",
        "adjustment",
        *(stage.name for stage in BEFORE_RESULTS if stage.products),
        "comparison",
    ),
    lambda run: [
        # from the project file, so that a survey that is moved as a whole keeps its results
        relpath(run.project.results, run.project.path.parent),
        run.project.report,
        *(file_fingerprint(path) for path in [measurements_of(run.project)] if path is not None),
        [point.mark_kind for point in run.project.surveyed.control_points],
    ],
    publish,
    line_of(ResultsSummary, lambda summary: f"{things(len(summary['products']), 'file')} written"),
    Costs(
        7.0,
        (
            Rate("photographs", 0.13, pieces=False),
            Rate("raster_mcells", 0.9, pieces=False),
            Rate("observations", 5e-5, pieces=False),
        ),
        disk_bytes=_disk_bytes,
        memory=lambda extent: Memory(LIBRARIES_BYTES + FIGURES_BYTES, REPORT_BYTES * extent.matched_cells, COARSER),
    ),
    is_uneven=True,
)
