"""What the benchmarks share: statistics beside known numbers, rows in the order of seeds, printed tables."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from lib import study
from study_trials import late_first, spoilt


def test_statistics_of_known_numbers() -> None:
    assert study.rms([3.0, -4.0, 0.0, 0.0]) == 2.5
    assert study.shares_within([0.5, -1.0, 1.5, -2.5, 9.0]) == pytest.approx([0.4, 0.6, 0.8])
    covariance = np.array([[[4.0, 0.0], [0.0, 1.0]], [[2.0, 1.0], [1.0, 2.0]]])
    assert study.normalised_squares(np.array([[2.0, 3.0], [1.0, 1.0]]), covariance) == pytest.approx([5.0, 1.0 / 3.0])


def test_bounds_of_chi_square_are_those_of_the_tables() -> None:
    # tables of χ² with 10 degrees of freedom: 2.156 and 25.188 at 0.5 and 99.5 %, 3.247 and 20.483 at 2.5 and 97.5 %
    assert study.mean_square_bounds(10) == pytest.approx((0.2156, 2.5188), abs=1e-4)
    assert study.mean_square_bounds(10, 0.95) == pytest.approx((0.3247, 2.0483), abs=1e-4)


def test_normal_errors_have_the_expected_shares_and_others_do_not() -> None:
    assert list(study.EXPECTED_SHARES) == pytest.approx([0.6827, 0.9545, 0.9973], abs=5e-5)
    z = np.random.default_rng(1).standard_normal(20000)
    assert study.shares_within(z) == pytest.approx(study.EXPECTED_SHARES, abs=0.01)
    assert study.kolmogorov_smirnov_p(z, "norm") > 0.01
    assert study.kolmogorov_smirnov_p(1.1 * z, "norm") < 1e-6
    # one value of 0.5: its distance from the uniform distribution is 0.5, and none can be nearer
    assert study.kolmogorov_smirnov_p([0.5], "uniform") == pytest.approx(1.0)


def test_rows_are_in_the_order_of_seeds_with_one_process_and_with_two() -> None:
    rows = [study.run(late_first, range(4), workers) for workers in (1, 2)]
    assert rows[0] == rows[1] == [(0, "1"), (1, "1"), (4, "1"), (9, "1")]


def test_an_error_of_a_trial_ends_the_study() -> None:
    with pytest.raises(ValueError, match="seed 1"):
        study.run(spoilt, range(3), 2)


def test_arguments_are_the_same_in_every_study() -> None:
    parser = study.parser("A study.", 50, first=1)
    assert parser.parse_args([]).seeds == range(1, 51)
    given = parser.parse_args(["3", "--workers", "1", "--json", "tables.json"])
    assert (given.seeds, given.workers, given.json) == (range(1, 4), 1, Path("tables.json"))


def test_a_table_is_printed_and_written_beside(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with study.recorded(tmp_path / "tables.json"):
        sys.stdout.write("2 surveys\n")
        table = study.Table("errors", "z")
        table.row("plan", f"{1.0:.2f}")
        table.row("height, all", f"{0.5:.2f}")
        sys.stdout.write("no table\n")
    text = capsys.readouterr().out
    assert text == (
        "2 surveys\n| errors | z   |\n|--------|-----|\n| plan   | 1.00 |\n| height, all | 0.50 |\nno table\n"
    )
    written = json.loads((tmp_path / "tables.json").read_text(encoding="utf-8"))
    assert written["text"] == text
    assert written["tables"][0]["columns"] == ["errors", "z"]
    assert written["tables"][0]["rows"] == [["plan", "1.00"], ["height, all", "0.50"]]


def test_two_tables_of_a_text_are_apart() -> None:
    text = "| a | b |\n|---|---|\n| 1 | 2 |\n\nbetween\n| c |\n|---|\n| 3 |\n"
    first, second = study.tables_of(text)
    assert (first["columns"], first["rows"]) == (["a", "b"], [["1", "2"]])
    assert (second["columns"], second["rows"]) == (["c"], [["3"]])
