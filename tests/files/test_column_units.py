"""Units in the names of columns: read, and what they are called."""

import pytest

from photogram.files.tables.column_units import FOOT_M, SURVEY_FOOT_M, in_words, length_unit_m, unit_of, without_unit


@pytest.mark.parametrize(
    ("column", "name", "unit_m"),
    [
        ("Elevation (ft)", "Elevation", FOOT_M),
        ("altitude(feet)", "altitude", FOOT_M),
        ("sigma_plan (mm)", "sigma_plan", 0.001),
        ("Height [m]", "Height", 1.0),
        ("height_m", "height", 1.0),
        ("Easting (US survey feet)", "Easting", SURVEY_FOOT_M),
        ("northing_ftUS", "northing", SURVEY_FOOT_M),
        ("z ft", "z", FOOT_M),
        ("Lateral RMS (cm)", "Lateral RMS", 0.01),
        ("Height (ellipsoidal) [ft]", "Height", FOOT_M),
        ("Height (ellipsoidal)", "Height", None),
        ("longitude(deg)", "longitude", None),
        ("sigma_m", "sigma", 1.0),
        ("u_px", "u", None),
        ("name", "name", None),
        ("Elevation (in feet)", "Elevation", FOOT_M),
        ("X (East)", "X", None),
    ],
)
def test_a_unit_is_read_and_taken_off(column: str, name: str, unit_m: float | None) -> None:
    assert without_unit(column) == name
    assert length_unit_m(column) == unit_m


def test_units_that_need_no_conversion_are_known() -> None:
    assert unit_of("u [px]") == "px"
    assert unit_of("latitude (decimal degrees)") == "decimaldegrees"
    assert unit_of("Comment (anything)") is None


def test_units_in_words() -> None:
    assert in_words((None, None, FOOT_M)) == "heights in feet"
    assert (
        in_words((SURVEY_FOOT_M, SURVEY_FOOT_M, 1.0)) == "easting and northing in US survey feet and heights in metres"
    )
