"""What a survey asks of disk and memory before it is worked on, against areas known by hand and against what a run has
written."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photogram.files.photographs.images import read_tags
from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.costs.space import kept_disk_bytes, machine_needs, sparse_disk_bytes, surface_disk_bytes
from photogram.pipeline.pipeline import STAGES, load_project
from photogram.pipeline.stage_costs import LAYER_BYTES, MATCHED_BYTES, RASTER_BYTES, Extent
from photogram.project.epochs.entries import ProjectEpoch
from photogram.project.project import Project, ProjectPhotograph
from photogram.project.validation.resources import SurfaceSize, machine_findings, surface_size
from photogram.surface.dense.tile_matching import DenseSettings
from photogram.surface.dtm import TerrainSettings
from photogram.surface.ortho.orthophoto import OrthophotoSettings
from photogram.surface.tin_dsm import SurfaceSettings

Tags = list[PhotographTags | None]
FLYING_M = 60.0


@pytest.fixture
def strip(pristine_survey: Path) -> Project:
    """Four photographs in a line, 400 × 300 px of 10 cm seen straight down from 60 m, top to the north, 20 m apart."""
    project = load_project(pristine_survey / "project.yaml")
    (camera,) = project.cameras
    start = np.array([600_000.0, 5_800_000.0, 100.0 + FLYING_M])
    return replace(
        project,
        cameras=(replace(camera, focal_px=600.0, principal_point_px=np.array([199.5, 149.5])),),
        photographs=tuple(
            ProjectPhotograph(
                f"{i}.jpg", Path(f"{i}.jpg"), 0, gnss_map_m=start + np.array([20.0 * i, 0.0, 0.0]),
                attitude_deg=(0.0, -90.0, 0.0), height_above_ground_m=FLYING_M,
            )
            for i in range(4)
        ),
        control_points=(),
        surface=SurfaceSettings(cell_m=0.2),
        orthophoto=OrthophotoSettings(),
    )  # fmt: skip


NO_TAGS: Tags = [None] * 4


def changed(project: Project, **values: Any) -> Project:
    return replace(project, photographs=tuple(replace(p, **values) for p in project.photographs))


def test_cells_are_those_of_the_ground_that_two_photographs_show(strip: Project) -> None:
    """Each shows 40 m × 30 m, so two or more show 60 m × 30 m: what the outer two show alone, 20 m, falls away."""
    size = surface_size(strip, NO_TAGS)
    assert size.surface_cells == pytest.approx(60 * 30 / 0.2**2, rel=0.1)
    assert size.orthophoto_cells == pytest.approx(60 * 30 / 0.1**2, rel=0.1)
    assert size.cell_gsd == pytest.approx(2.0)


def test_photographs_across_the_line_show_a_narrower_strip(strip: Project) -> None:
    """Turned by 90° each shows 30 m along the line, and 40 m across: two or more show 50 m × 40 m in three parts."""
    turned = surface_size(changed(strip, attitude_deg=(90.0, -90.0, 0.0)), NO_TAGS)
    assert turned.surface_cells == pytest.approx(50 * 40 / 0.2**2, rel=0.1)


def test_photographs_that_look_at_the_horizon_show_no_ground_beyond_reach(strip: Project) -> None:
    level = surface_size(changed(strip, attitude_deg=(0.0, 0.0, 0.0)), NO_TAGS)
    assert 0 < level.surface_cells < (60 + 4 * FLYING_M) * 2 * FLYING_M / 0.2**2


def test_size_by_usual_overlap_where_nobody_says_how_high_they_flew(strip: Project) -> None:
    """A place is in two or three photographs of the strip, taken as four."""
    blind = changed(strip, height_above_ground_m=None)
    size, known = surface_size(blind, NO_TAGS), surface_size(strip, NO_TAGS)
    assert size.cell_gsd == 2.0
    assert 0.5 < size.surface_cells / known.surface_cells < 2.0
    assert size.orthophoto_cells == pytest.approx(4 * size.surface_cells)
    nowhere = changed(blind, gnss_map_m=None)
    assert surface_size(nowhere, NO_TAGS) == size


def test_of_epochs_together_no_surface_is_made(strip: Project) -> None:
    epochs = (ProjectEpoch("May", (0, 1)), ProjectEpoch("June", (2, 3)))
    together = surface_size(replace(strip, epochs=epochs), NO_TAGS)
    assert (together.surface_cells, together.orthophoto_cells) == (0.0, 0.0)
    assert surface_size(replace(strip, epochs=epochs, epoch="May"), NO_TAGS).surface_cells > 0.0


def test_stages_that_are_switched_off_need_nothing(strip: Project) -> None:
    off = replace(
        strip, dense=DenseSettings(enabled=False), surface=SurfaceSettings(),
        orthophoto=OrthophotoSettings(enabled=False),
    )  # fmt: skip
    size = surface_size(off, NO_TAGS)
    assert (size.surface_cells, size.orthophoto_cells) == (0.0, 0.0)
    kept = kept_disk_bytes(STAGES, Extent(off, size))
    assert kept["dense"] == kept["surface"] == kept["relief"] == kept["orthophoto"] == 0.0
    assert machine_needs(STAGES, off, NO_TAGS).disk_bytes == int(
        max(sparse_disk_bytes(Extent(off, size)), sum(kept.values()))
    )
    whole = kept_disk_bytes(STAGES, Extent(strip, surface_size(strip, NO_TAGS)))
    assert all(kept[stage] <= more for stage, more in whole.items())
    both = (strip, replace(off, dense=strip.dense))
    most, matched = (surface_disk_bytes(Extent(p, surface_size(p, NO_TAGS))) for p in both)
    assert 0 < matched < most
    without = replace(strip, terrain=TerrainSettings(enabled=False))
    assert surface_disk_bytes(Extent(without, surface_size(strip, NO_TAGS))) < most


def test_reduced_pictures_fill_the_disk_while_heights_of_coarse_cells_are_matched(strip: Project) -> None:
    """With cells of 8 GSD the finest pictures are reduced by 4: two bytes for a sixteenth of the pixels, and a third of
    that for all coarser ones."""
    size = SurfaceSize(1000.0, 0.0, 8.0)
    off = replace(strip, orthophoto=OrthophotoSettings(enabled=False))
    expected = 4 * 400 * 300 * 2 / 16 * 4 / 3 + 1000 * MATCHED_BYTES
    assert surface_disk_bytes(Extent(off, size)) == pytest.approx(expected, rel=2e-3)


def test_estimate_agrees_with_what_a_run_has_written(finished_survey: Path) -> None:
    project = load_project(finished_survey / "project.yaml")
    tags: Tags = [read_tags(p.path) for p in project.photographs]
    size, work = surface_size(project, tags), finished_survey / "work"
    for stage, cells in (("surface", size.surface_cells), ("orthophoto", size.orthophoto_cells)):
        made = json.loads((work / f"{stage}.stage" / "stage.json").read_text())
        assert 0.5 < cells / (made["rows"] * made["columns"]) < 2.0, stage
    made = json.loads((work / "surface.stage" / "stage.json").read_text())
    made_cells = made["rows"] * made["columns"]
    blocks = sum(path.stat().st_size for path in (work / "dense.stage").glob("heights*/*"))
    assert blocks == pytest.approx(MATCHED_BYTES * made_cells, rel=0.1)
    tiles = sum(path.stat().st_size for path in (work / "surface.stage" / "tiles").iterdir())
    assert tiles == pytest.approx(LAYER_BYTES * made_cells, rel=0.1)
    rasters = sum(path.stat().st_size for path in (work / "surface.stage").glob("*.tif"))
    assert 0.4 < rasters / (RASTER_BYTES * made_cells) < 2.0


def test_memory_grows_with_photographs_picture_size_cells_and_workers(strip: Project) -> None:
    def memory_bytes(project: Project, workers: int = 1) -> int:
        return machine_needs(STAGES, project, [None] * len(project.photographs), workers).memory_bytes

    sparse = replace(
        strip, dense=DenseSettings(enabled=False), surface=SurfaceSettings(),
        orthophoto=OrthophotoSettings(enabled=False),
    )  # fmt: skip
    rich = replace(sparse.features, maximum=40_000)
    many = replace(sparse, photographs=sparse.photographs * 500, features=rich)
    assert memory_bytes(many) > 10 * memory_bytes(sparse)
    large = replace(sparse, cameras=(replace(sparse.cameras[0], width_px=4000, height_px=3000),))
    assert memory_bytes(replace(large, quality="low")) < memory_bytes(large)
    usual = replace(strip, surface=SurfaceSettings(cell_m=0.02))
    two, four, eight = (memory_bytes(usual, workers) for workers in (2, 4, 8))
    assert eight - four == pytest.approx(2 * (four - two), rel=0.3)
    assert four > 1.1 * two
    fine = replace(strip, surface=SurfaceSettings(cell_m=0.004))
    assert memory_bytes(fine) > 2 * memory_bytes(strip)


def test_remedies_fit_what_fills_disk_and_memory(strip: Project) -> None:
    fine = replace(strip, surface=SurfaceSettings(cell_m=0.004))
    many = replace(strip, photographs=strip.photographs * 50, features=replace(strip.features, maximum=200_000))
    for project, disk, memory in (
        (fine, "surface.cell_m", "surface.cell_m"),
        (many, "features.maximum", "features.maximum"),
    ):
        needs = machine_needs(STAGES, project, [None] * len(project.photographs))
        found = machine_findings(project, needs, needs.disk_bytes - 1, needs.memory_bytes - 1)
        assert [(f.severity, f.where) for f in found] == [("warning", "disk"), ("warning", "memory")]
        assert disk in found[0].remedy
        assert memory in found[1].remedy
        assert machine_findings(project, needs, 2 * needs.disk_bytes, needs.memory_bytes) == []
    assert machine_findings(strip, machine_needs(STAGES, strip, NO_TAGS), None, None) == []


def test_oblique_photographs_are_counted_by_what_they_resolve(strip: Project) -> None:
    """Along the axis, 45° down, a pixel of level ground has a side of distance over focal length and over the root of
    the cosine: 16.8 cm, where flying height over focal length is 10 cm. What is far away and flat is not mapped."""
    oblique = changed(strip, attitude_deg=(0.0, -45.0, 0.0))
    size = surface_size(oblique, NO_TAGS)
    assert 0.2 / size.cell_gsd == pytest.approx(FLYING_M / 600.0 / np.cos(np.pi / 4) ** 1.5, rel=0.15)
    flat = replace(strip, photographs=(*strip.photographs, *changed(strip, attitude_deg=(0.0, -5.0, 0.0)).photographs))
    usual = surface_size(strip, NO_TAGS)
    assert surface_size(flat, [None] * 8).surface_cells == pytest.approx(usual.surface_cells, rel=0.2)


def test_an_area_that_is_asked_for_is_counted_instead(strip: Project, tmp_path: Path) -> None:
    """Ground of 20 m × 10 m, of which a triangle is half."""
    ring = [[600_000.0, 5_800_000.0], [600_020.0, 5_800_000.0], [600_000.0, 5_800_010.0], [600_000.0, 5_800_000.0]]
    crs = {"type": "name", "properties": {"name": strip.crs}}
    geometry = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {}, "geometry": geometry}
    path = tmp_path / "site.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]}))
    size = surface_size(replace(strip, surface=SurfaceSettings(cell_m=0.2, area=str(path))), NO_TAGS)
    assert size.surface_cells == pytest.approx(20 * 10 / 0.2**2)
    assert size.covered_share == pytest.approx(0.5)
