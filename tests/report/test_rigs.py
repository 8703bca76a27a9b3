"""Cameras on one body in the report: figures against the adjustment, and their lines on the page."""

from dataclasses import replace

import numpy as np
import pytest
from jinja2 import StrictUndefined
from lib.simulated.two_cameras import simulate_two_cameras
from makers import LEAST_SQUARES
from pydantic import TypeAdapter
from scipy.spatial.transform import Rotation

from photogram.adjustment.adjustment import adjust
from photogram.amendments.gross_errors.data_snooping import without
from photogram.amendments.gross_errors.hypothesis import unmeasured
from photogram.report.numbers.rigs import rig_numbers
from photogram.report.numbers.wording import fixed, signed
from photogram.report.page import templates
from photogram.report.record.rigs import BandRecord, RigRecord
from photogram.results import Adjustment
from photogram.simulation.survey_plan import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=2)


@pytest.fixture(scope="module")
def adjusted() -> tuple[Block, Adjustment]:
    block = simulate_two_cameras(PLAN, 1, tie_points=120).block
    return block, adjust(without(block, [unmeasured("exposure", "sim_0002_B.JPG")]), LEAST_SQUARES)


def test_figures_are_those_of_the_adjustment(adjusted: tuple[Block, Adjustment]) -> None:
    block, result = adjusted
    (record,) = rig_numbers(result, block)
    TypeAdapter(RigRecord).validate_python(record)
    pose = result.block.rigs[0].pose
    assert pose is not None
    assert (record["camera"], record["master"], record["exposures"]) == ("companion", "simulated", 5)
    assert record["rejected"] == ["sim_0002_B.JPG"]
    np.testing.assert_allclose(record["offset_m"] or [], pose.offset_m)
    assert record["rotation_deg"] is not None
    angles = [Rotation.from_rotvec(np.deg2rad(a) * e) for a, e in zip(record["rotation_deg"], np.eye(3), strict=True)]
    np.testing.assert_allclose((angles[0] * angles[1] * angles[2]).as_matrix(), pose.rotation_master_from_companion)
    sigma = np.sqrt(np.diag(result.tests.exposures.relative_covariance[0]))
    np.testing.assert_allclose(record["offset_sigma_m"] or [], sigma[3:])
    np.testing.assert_allclose(record["rotation_sigma_deg"] or [], np.rad2deg(sigma[:3]))
    assert not record["offset_given"]
    w = np.delete(result.tests.exposures.w, 1, axis=0)
    assert record["largest_w"] == pytest.approx(np.abs(w).max())
    redundancy = np.delete(result.tests.exposures.redundancy, 1, axis=0)
    assert record["offset_redundancy"] == pytest.approx(redundancy[:, 3:].mean())
    assert record["rotation_redundancy"] == pytest.approx(redundancy[:, :3].mean())
    assert (record["offset_mdb_m"] or 0.0) > 4.0 * block.rigs[0].exposure_sigma[0, 3]


def test_nothing_is_said_where_no_exposure_takes_part(adjusted: tuple[Block, Adjustment]) -> None:
    block, _ = adjusted
    names = [unmeasured("exposure", name) for name, _ in block.rigs[0].exposures]
    (record,) = rig_numbers(adjust(without(block, names), LEAST_SQUARES), block)
    assert record["exposures"] == 0
    assert len(record["rejected"]) == 6
    nothing = [v for k, v in record.items() if k.startswith(("offset_", "rotation_")) and not k.endswith("given")]
    assert nothing == [None] * 8
    TypeAdapter(RigRecord).validate_python(record)


def test_the_page_has_a_line_for_each_part(adjusted: tuple[Block, Adjustment]) -> None:
    block, result = adjusted
    given = replace(block, rigs=(replace(block.rigs[0], sigma=np.full(6, 1e-3)),))
    environment = templates(StrictUndefined)
    environment.filters |= {"fixed": fixed, "signed": signed}
    template = environment.get_template("rigs.jinja")
    page = template.render(report={"rigs": rig_numbers(result, block)})
    assert "Offset, m, free" in page
    assert "Rotation, °, free" in page
    assert "Rejected of companion" in page
    assert "sim_0002_B.JPG" in page
    assert "Offset, m, given" in template.render(report={"rigs": rig_numbers(result, given)})


def test_the_registration_of_a_band_stands_with_its_camera(adjusted: tuple[Block, Adjustment]) -> None:
    block, result = adjusted
    environment = templates(StrictUndefined)
    environment.filters |= {"fixed": fixed, "signed": signed}
    template = environment.get_template("rigs.jinja")
    told: BandRecord = {"patches": 7, "mean_px": [0.02, -0.11], "rms_px": 0.14}
    silent: BandRecord = {"patches": 0, "mean_px": None, "rms_px": None}
    for band, words in ((told, "0.14 px off the master"), (silent, "no patch has edges enough")):
        records = rig_numbers(result, block, {"companion": band, "other": told})
        TypeAdapter(list[RigRecord]).validate_python(records)
        page = " ".join(template.render(report={"rigs": records}).split())
        assert words in page
    assert "registration" not in rig_numbers(result, block)[0]
