"""An adjusted survey as a solution for other programs, and back."""

import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from foreign import rms_px
from makers import simulated

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.errors import ExchangeError
from photogram.exchange.audit.foreign_block import foreign_block
from photogram.exchange.formats.names import SOLUTION_FORMATS, SolutionFormat
from photogram.exchange.formats.nearest_cameras import with_nearest_cameras
from photogram.exchange.formats.recognition import read_solution
from photogram.exchange.formats.table import WRITERS
from photogram.exchange.solution_export import adjusted_solution, export_solution
from photogram.pipeline.pipeline import load_project, open_run
from photogram.pipeline.stages.stored_adjustment import block_as_adjusted
from photogram.projection import PARAMETER_NAMES, Model
from photogram.results import Adjustment
from photogram.simulation.simulated_survey import SurveyPlan

PLAN = SurveyPlan(strips=2, photographs_per_strip=4, control_points=6, check_points=2)


@cache
def adjusted() -> Adjustment:
    return adjust(simulated(PLAN, tie_points=200).block, AdjustmentSettings(estimate_sigmas=False))


@pytest.mark.parametrize("frame", ["topocentric", "geocentric", "map"])
def test_a_placed_solution_comes_back_to_where_it_was(frame: Literal["topocentric", "geocentric", "map"]) -> None:
    """Through the frame of the file and the audit's own way from it: poses to a tenth of a millimetre; of a map,
    which is not Cartesian, rotations to its own scale along the axes."""
    result = adjusted()
    found = foreign_block(adjusted_solution(result, frame))
    assert found.is_placed
    there = found.block.frame
    for pose, own in zip(found.theirs.poses, result.block.poses, strict=True):
        assert pose is not None
        assert own is not None
        place = there.map_from_world(pose.position_world_m[None])
        np.testing.assert_allclose(result.block.frame.world_from_map(place)[0], own.position_world_m, atol=1e-4)
        turn = (
            there.rotation_world_from_map(pose.position_world_m).T @ pose.rotation_world_from_camera,
            result.block.frame.rotation_world_from_map(own.position_world_m).T @ own.rotation_world_from_camera,
        )
        np.testing.assert_allclose(turn[0], turn[1], atol=1e-6)
    np.testing.assert_allclose(
        there.map_from_world(found.theirs.tie_points.position_world_m),
        result.block.frame.map_from_world(result.block.tie_points.position_world_m), atol=1e-4,
    )  # fmt: skip


def test_local_coordinates_are_those_of_the_survey() -> None:
    result = adjusted()
    solution = adjusted_solution(result, "local")
    assert solution.crs == result.block.frame.crs
    for photograph, pose in zip(solution.photographs, result.block.poses, strict=True):
        assert photograph.pose is not None
        assert pose is not None
        np.testing.assert_array_equal(photograph.pose.position_world_m, pose.position_world_m)
    assert solution.ground_points is not None
    assert solution.ground_points.name == result.block.control_points.name


@pytest.mark.parametrize("form", SOLUTION_FORMATS)
def test_every_format_is_written(adjusted_survey: Path, tmp_path: Path, form: SolutionFormat) -> None:
    """And read again where it holds a solution; a camera that a format cannot hold is said, and nothing is left."""
    target = tmp_path / form
    said = export_solution(adjusted_survey / "project.yaml", form, target)
    assert ("the nearest camera without is written" in " ".join(said)) is (form == "bundler")
    assert target.is_dir() is WRITERS[form].is_folder
    with pytest.raises(ExchangeError, match="is there already"):
        export_solution(adjusted_survey / "project.yaml", form, target)
    if form in ("omega-phi-kappa", "yaw-pitch-roll"):
        assert len(target.read_text(encoding="utf-8").splitlines()) == 5
        return
    if form == "bundler":  # whose reader asks the photographs for their size
        shutil.copytree(adjusted_survey / "photographs", tmp_path, dirs_exist_ok=True)
    found = read_solution(target / "sparse" if form == "undistorted" else target)
    with open_run(load_project(adjusted_survey / "project.yaml")) as run:
        block = block_as_adjusted(run)
    assert len(found.photographs) == len(block.photographs)
    if form != "metashape":
        assert len(found.tie_points) == pytest.approx(len(block.tie_points), rel=0.02)
    centres = np.array([p.pose.position_world_m for p in found.photographs if p.pose is not None])
    own = np.array([p.position_world_m for p in block.poses if p is not None])
    apart = [np.linalg.norm(c[:, None] - c[None], axis=2) for c in (centres, own)]
    np.testing.assert_allclose(apart[0], apart[1], rtol=1e-3)  # the map's scale


def test_a_camera_that_a_format_cannot_hold_becomes_the_nearest_one() -> None:
    """A skew of half a pixel in COLMAP: residuals grow by what is said, in quadrature, and no more."""
    solution = adjusted_solution(adjusted(), "local")
    (camera,) = solution.cameras
    skewed = replace(solution, cameras=(replace(camera, affinity=np.array([0.0, 0.5])),))
    terms: dict[Model, frozenset[str]] = {"brown": frozenset(PARAMETER_NAMES) - {"k4", "b2"}}
    found, (said,) = with_nearest_cameras(skewed, terms)
    assert re.fullmatch(
        r"b2 of camera simulated; the nearest camera without is written, [\d.]+ px from it \(RMS over the picture\), "
        r"[\d.]+ px at most\.", said,
    )  # fmt: skip
    away = float(said.split("written, ")[1].split()[0])
    before, after = rms_px(skewed), rms_px(found)
    assert found.cameras[0].affinity[1] == 0.0
    assert abs(after - before) < 1.2 * away
    assert with_nearest_cameras(solution, terms)[1] == ()
    far = replace(solution, cameras=(replace(camera, affinity=np.array([0.0, 5.0])),))
    with pytest.raises(ExchangeError, match=r"camera simulated: has b2, for which the format has no place"):
        with_nearest_cameras(far, terms)


def test_what_is_not_adjusted_is_said(survey: Path, tmp_path: Path) -> None:
    with pytest.raises(ExchangeError, match="run photogram adjust first"):
        export_solution(survey / "project.yaml", "opensfm", tmp_path / "out")
    assert not (tmp_path / "out").exists()
