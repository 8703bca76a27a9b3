"""Pairs where flying heights are wrong: those between strips are found, and no pair more where heights are right."""

from collections.abc import Sequence
from dataclasses import replace

import pytest
from lib.pair_blocks import BLOCKS, SETTINGS, WIDE, selected, sharing, strips

from photogram.sfm.tie_points.ground_depth import MOST_PROBES, with_ground_depth
from photogram.sfm.tie_points.pairs import select_pairs

SMALL = {
    "wide": lambda: strips(7, 9, 0.8, 0.7),
    "low overlap": BLOCKS["low overlap, 60/25"],
    "oblique": lambda: strips(6, 8, 0.75, 0.6, pitch_deg=-60.0),
    "two heights": BLOCKS["two heights"],
}


@pytest.mark.parametrize("name", SMALL)
def test_strips_are_tied_to_each_other_whatever_the_height_above_take_off(name: str) -> None:
    flown = SMALL[name]()
    truth = sharing(flown)
    right = selected(flown, truth, 1.0)
    plain = selected(flown, truth, 1.0, probing=False)
    assert right.pairs == plain.pairs  # right heights cost some probes and no pair
    assert right.probed <= 2 * MOST_PROBES
    for factor in (0.3, 0.5, 2.0):
        found = selected(flown, truth, factor)
        assert found.verified_across >= 0.9 * right.verified_across, factor
        assert set(selected(flown, truth, factor, probing=False).pairs.pairs) <= set(found.pairs.pairs)
        assert found.probed <= 4 * MOST_PROBES


def test_without_probing_strips_are_lost() -> None:
    flown = SMALL["wide"]()
    truth = sharing(flown)
    right = selected(flown, truth, 1.0).verified_across
    assert selected(flown, truth, 0.5, probing=False).verified_across < 0.5 * right


def never(pairs: Sequence[tuple[int, int]]) -> list[bool]:
    raise AssertionError(f"asked for {pairs}")


def test_where_no_height_or_attitude_is_known_nothing_is_tried() -> None:
    flown = strips(3, 4, 0.75, 0.6)
    for values in ({"height_above_ground_m": None}, {"attitude_world_from_camera": None, "attitude_sigma_rad": None}):
        photographs = [replace(p, **values) for p in flown.photographs]  # type: ignore[arg-type]
        found = select_pairs(photographs, [WIDE], SETTINGS, similar=None)
        assert with_ground_depth(photographs, [WIDE], SETTINGS, found, never) == found


def test_reasons_say_which_pairs_are_for_another_depth() -> None:
    flown = SMALL["wide"]()
    found = selected(flown, sharing(flown), 0.5).pairs
    assert set(found.reasons) == {"footprint", "depth"}
    assert list(found.pairs) == sorted(set(found.pairs))
