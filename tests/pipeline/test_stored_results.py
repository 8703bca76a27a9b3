"""Adjustments as they lie on disk: relative poses of cameras on one body, and their exposures, there and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from makers import LEAST_SQUARES

from photogram.adjustment.adjustment import adjust
from photogram.files.npz_json import read_arrays
from photogram.pipeline.store.stored_results import ADJUSTED, adjusted_block_from, adjustment_from, write_adjustment
from photogram.quality.gross_errors.data_snooping import unmeasured, without
from photogram.simulation.rigs.two_cameras import simulate_two_cameras
from photogram.simulation.survey_plan import SurveyPlan


@pytest.mark.parametrize("known", [True, False])
def test_relative_poses_come_back_as_they_were_adjusted(tmp_path: Path, known: bool) -> None:
    """With a rejected exposure; and, where none takes part, with a relative pose that nobody knows."""
    block = simulate_two_cameras(
        SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=2), 1, tie_points=120
    ).block
    names = [name for name, _ in block.rigs[0].exposures]
    rejected = [unmeasured("exposure", name) for name in (names[1:2] if known else names)]
    result = adjust(without(block, rejected), LEAST_SQUARES)
    write_adjustment(tmp_path, result)
    arrays = read_arrays(tmp_path / ADJUSTED)
    stored = adjusted_block_from(block, arrays, result.block.tie_points, rejected)
    again = adjustment_from(stored, lambda name: tmp_path / name)
    (rig,), (expected,) = again.block.rigs, result.block.rigs
    assert rig.exposures == expected.exposures
    np.testing.assert_array_equal(rig.exposure_sigma, expected.exposure_sigma)
    np.testing.assert_array_equal(rig.value, expected.value)
    assert (rig.pose is not None) is known
    if rig.pose is not None and expected.pose is not None:
        np.testing.assert_array_equal(rig.pose.offset_m, expected.pose.offset_m)
        np.testing.assert_array_equal(
            rig.pose.rotation_master_from_companion, expected.pose.rotation_master_from_companion
        )
    for name, values in vars(result.exposures).items():
        np.testing.assert_array_equal(getattr(again.exposures, name), values)
    assert again.redundancy == result.redundancy
