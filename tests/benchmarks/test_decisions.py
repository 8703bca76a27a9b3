"""What the benchmark of decisions counts is what the adjustment counts itself, and its blunders are found by name."""

import pytest
from decisions import KINDS, REAL, Outcome, cells, chosen, decided, grid, with_blunders

from photogram.adjustment.effort import tallied


@pytest.mark.parametrize("blunders", [0, 3])
def test_it_counts_what_the_adjustment_counts(blunders: int, monkeypatch: pytest.MonkeyPatch) -> None:
    block, names = with_blunders(blunders, 1) if blunders else grid(3, 4, 300, 1)
    assert len(names) == blunders
    with tallied(len(block.tie_points.photograph)) as tally:
        monkeypatch.setattr("decisions.once_s", lambda *_: 1.0)
        outcome = decided(block, names)
    assert outcome.solutions == sum(effort.solutions for effort in tally.efforts) >= 3
    assert outcome.iterations == pytest.approx(tally.iterations_over_all_rays, rel=1e-12)
    assert (outcome.right, outcome.wrong, outcome.blunders) == (blunders, 0, blunders)


def test_kinds_by_name() -> None:
    assert chosen("", with_real=False) == list(KINDS)
    assert chosen("kite+ few marks, 1 blunder", with_real=True) == ["kite, few marks", "1 blunder", *REAL]
    with pytest.raises(SystemExit, match=r"no kinds of surveys: bee; there are RTK\+ arm and compass"):
        chosen("bee", with_real=False)


def test_a_row() -> None:
    one = Outcome(12, 900, 4, 20.0, 2.0, 1.0, 2, 1, 0)
    none = Outcome(12, 900, note="not determined")
    real = Outcome(12, 900, 6, 30.0, 3.0, 1.0, None, 0, 5)
    assert cells([one, none]) == ["4", "20", "2.00", "1.00", "2.0", "1 of 2", "0"]
    assert cells([real]) == ["6", "30", "3.00", "1.00", "3.0", "", "5"]
    assert cells([none]) == ["", "", "", "", "", "", "0"]
