"""What a project says of a known surface."""

from dataclasses import dataclass
from typing import Annotated

from photogram.errors import SettingError
from photogram.geodesy.height_systems import HeightSystem
from photogram.settings.settings import Default, Settings, Within

COMMON_SIGMA_M = 0.1
"""Of a surface of which nobody says what it is off by as a whole: models of national surveys from the air."""


@dataclass(frozen=True)
class KnownSurfaceSettings(Settings):
    """A height model whose ground is known, as control in height."""

    path: Annotated[
        str | None,
        "Height model of bare ground, GeoTIFF, or a cloud whose ground is classified (class 2), LAS or LAZ; in the "
        "plan of the CRS of the project, relative to the project file.",
        Default("no known surface"),
    ] = None
    sigma_m: Annotated[
        float | None,
        Within(0.001, 100, "m"),
        "Standard deviation of a cell (of a point, for LAS and LAZ), independent from one to the next.",
        Default("none: it must be given"),
    ] = None
    common_sigma_m: Annotated[
        float | None,
        Within(0.001, 100, "m"),
        "Standard deviation of what all of it is off by together: in height, in plan, and by its slopes at the edge of "
        "the site.",
        Default(f"{COMMON_SIGMA_M:g} m, assumed"),
    ] = None
    heights: Annotated[
        HeightSystem | None,
        "What its heights are counted from: `ellipsoidal` or `orthometric`.",
        Default("as the results"),
    ] = None
    stable: Annotated[
        str | None,
        "File of polygons in the plan of the map within which the ground is stable, GeoPackage or GeoJSON, relative to "
        "the project file.",
        Default("everywhere; what has changed is told by its heights"),
    ] = None

    def __post_init__(self) -> None:
        """Check that a surface has a standard deviation, and that nothing is said of one that is not named."""
        super().__post_init__()
        if self.path is not None and self.sigma_m is None:
            raise SettingError(
                "sigma_m", "is missing: give the standard deviation of a cell, as the surface's maker states it"
            )
        if self.path is None and (self.sigma_m, self.common_sigma_m, self.heights, self.stable) != (None,) * 4:
            raise SettingError("path", "is missing: give the height model, or remove the section")
