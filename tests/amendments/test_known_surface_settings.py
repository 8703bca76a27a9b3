"""What a project must say of a known surface."""

import pytest

from photogram.amendments.surfaces.known_surface_settings import KnownSurfaceSettings
from photogram.errors import SettingError


def test_a_surface_needs_a_standard_deviation_and_what_is_said_needs_a_surface() -> None:
    assert KnownSurfaceSettings().path is None
    assert KnownSurfaceSettings("official.tif", 0.1).common_sigma_m is None
    with pytest.raises(SettingError, match="sigma_m: is missing"):
        KnownSurfaceSettings("official.tif")
    with pytest.raises(SettingError, match="path: is missing"):
        KnownSurfaceSettings(stable="stable.gpkg")
    with pytest.raises(SettingError, match=r"sigma_m: must be from 0\.001"):
        KnownSurfaceSettings("official.tif", 0.0)
