"""What the report says of components without common tie points, and of what ties them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from lib.simulated.pieces import in_pieces
from pydantic import TypeAdapter

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.oriented_subset import registered_block, with_all_photographs
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import IntArray
from photogram.languages.language import ENGLISH
from photogram.quality.improvements import block_deformation
from photogram.report.components import component_numbers
from photogram.report.numbers.numbers import block_numbers
from photogram.report.numbers.ranked_warnings import _components
from photogram.report.record.block import BlockRecord, ComponentRecord
from photogram.results import Adjustment
from photogram.sfm.orientation import Orientation
from photogram.simulation.simulated_survey import simulate_block
from photogram.simulation.survey_plan import SurveyPlan

PLAN = SurveyPlan(strips=4, photographs_per_strip=3, control_points=12, check_points=8, side_overlap=0.7)
TIES = ("GNSS positions", "control points", "")


@cache
def adjusted() -> tuple[Adjustment, Orientation, IntArray]:
    """Three components, the last of which takes no part."""
    made, piece = in_pieces(simulate_block(PLAN, 2, tie_points=300), 3)
    poses = tuple(None if n == 2 else pose for n, pose in zip(piece.tolist(), made.block.poses, strict=True))
    block = replace(made.block, poses=poses)
    orientation = Orientation(poses, (None,) * len(poses), piece, "growth", ("",) * len(poses), ties=TIES)
    part, kept = registered_block(block)
    settings = AdjustmentSettings()
    result = with_all_photographs(adjust(part, settings), block, kept)
    deformation = block_deformation(result, settings, [c.parameters for c in block.cameras], piece)
    return replace(result, covariances=replace(result.covariances, deformation=deformation)), orientation, piece


def records() -> list[ComponentRecord]:
    result, orientation, _ = adjusted()
    return component_numbers(result, orientation)


def test_every_component_says_what_ties_it() -> None:
    found = records()
    TypeAdapter(list[ComponentRecord]).validate_python(found)
    result, _, piece = adjusted()
    assert [c["photographs"] for c in found] == np.bincount(piece).tolist()
    assert [c["adjusted"] for c in found] == [True, True, False]
    assert [c["placed_by"] for c in found] == list(TIES)
    points = result.block.control_points
    for number, component in enumerate(found):
        own = piece[points.mark_photograph] == number
        marked = {points.name[g] for g in points.mark_point[own]}
        other = {points.name[g] for g in points.mark_point[~own]}
        roles = dict(zip(points.name, points.role, strict=True))
        assert set(component["control_points"]) == {name for name in marked if roles[name] == "control"}
        assert set(component["shared_marks"]) == marked & other
        assert component["gnss_positions"] == component["photographs"]
        assert component["shared_cameras"] == ["simulated"]
        assert component["shared_tie_points"] == 0


def test_the_sigma_beside_the_first_is_that_of_the_mean_points() -> None:
    first, second, lost = records()
    result, _, _ = adjusted()
    sigma = second["sigma_to_first_m"]
    assert first["sigma_to_first_m"] is None
    assert lost["sigma_to_first_m"] is None
    assert sigma is not None
    covariance = result.covariances.deformation.component_shift_m2[1]
    assert sigma["plan"] ** 2 + sigma["height"] ** 2 == pytest.approx(np.trace(covariance), rel=1e-9)
    assert 0.001 < sigma["plan"] < 0.05


def test_what_is_loose_or_lost_is_a_warning_and_what_is_tight_a_note() -> None:
    result, orientation, _ = adjusted()
    block = block_numbers(result, orientation, None)

    def said(block: BlockRecord) -> dict[str, str]:
        return {w["sentence"]: w["severity"] for w in _components(block, ENGLISH)}

    lost, tight = said(block).items()
    assert lost[0].startswith(
        "a component of 3 photographs shares no tie points with the block, and nothing else ties it"
    )
    assert lost[1] == "attention"
    assert "photographs share no tie points with the rest and are tied to it by control points: 0.0" in tight[0]
    assert tight[1] == "note"
    loose = {**block["component_ties"][1], "sigma_to_first_m": {"plan": 0.5, "height": 2.0}}
    ((sentence, severity),) = said({**block, "component_ties": [loose]}).items()  # type: ignore[list-item]
    assert sentence.endswith("0.500 m in plan and 2.00 m in height (1 sigma)")
    assert severity == "attention"
