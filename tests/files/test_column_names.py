"""Names of columns of surveyors' programs, in their languages."""

from itertools import chain, combinations

import pytest

from photogram.files.tables.column_names import MARKS, POINTS, POSITIONS, Names, plain, quantity_of, says_nothing


@pytest.mark.parametrize(
    ("column", "quantity"),
    [
        ("Name", "name"), ("Punktnummer", "name"), ("Point ID", "name"), ("GCP Label", "name"), ("#Label", None),
        ("Rechtswert [m]", "easting"), ("X/Easting", "easting"), ("Este", "easting"), ("E", "easting"),
        ("Hochwert", "northing"), ("Y (North)", "y"), ("Norte", "northing"), ("Nord", "northing"),
        ("Höhe", "height"), ("Cota", "height"), ("Z/Altitude", "height"), ("Ortho Height", "height"), ("RL", "height"),
        ("Ellipsoidal height", "ellipsoidal_height"), ("Height (ellipsoidal)", "ellipsoidal_height"),
        ("Longitude", "longitude"), ("Geogr. Breite", "latitude"), ("经度", "longitude"),
        ("Easting RMS", "sigma_east"), ("Lateral RMS", "sigma_plan"), ("Accuracy_X/Y/Z_(m)", "sigma"),
        ("Solution status", "solution"), ("CS name", "cs_name"),
        ("Antenna height", None), ("Base easting", None), ("X_est", None), ("Code", None),
    ],
)  # fmt: skip
def test_names_of_points(column: str, quantity: str | None) -> None:
    assert quantity_of(column, POINTS) == quantity


@pytest.mark.parametrize("column", ["Antenna height", "Base easting", "X_est", "Code", "", "#mine", "PDOP", "dx"])
def test_names_that_are_known_to_say_nothing(column: str) -> None:
    assert says_nothing(column)


@pytest.mark.parametrize("column", ["Hight", "crew"])
def test_names_that_nobody_knows_are_said(column: str) -> None:
    assert not says_nothing(column)
    assert quantity_of(column, POINTS) is None


@pytest.mark.parametrize("known", [POINTS, POSITIONS, MARKS])
def test_no_name_means_two_quantities_and_all_are_in_one_spelling(known: Names) -> None:
    for (_, one), (_, other) in combinations(known.items(), 2):
        assert not set(one) & set(other)
    assert all(plain(name) == name for name in chain(*known.values()))
