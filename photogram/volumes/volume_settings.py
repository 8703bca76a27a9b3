"""The section `volumes` of a project file: which volumes of the survey's own surface are asked for, over what."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Literal

from photogram.errors import SettingError
from photogram.settings.settings import Default, Settings, Within


@dataclass(frozen=True)
class VolumeSettings(Settings):
    """Which volumes are measured, and over what base."""

    polygons: Annotated[
        str | None,
        "File of polygons in the plan of the map, GeoPackage or GeoJSON, relative to the project file: the volume of "
        "the surface in each of them is measured.",
        Default("no volumes"),
    ] = None
    base: Annotated[
        Literal["rim", "level", "reference"],
        "`rim`: the plane through the ground around each polygon; `level`: the height `level_m`; `reference`: the "
        "surface `reference`.",
    ] = "rim"
    level_m: Annotated[
        float | None, Within(-1000, 9000, "m"), "Height of the base in the map.", Default("none: for `base: level`")
    ] = None
    reference: Annotated[
        str | None,
        "Surface that is the base, relative to the project file: GeoTIFF in the CRS of the project, a folder of "
        "results, or a design as TIN of LandXML or DXF.",
        Default("none: for `base: reference`"),
    ] = None
    reference_own_sigma_m: Annotated[
        float | None,
        Within(0, 100, "m"),
        "Standard deviation of a height of the reference by itself.",
        Default("its rasters `_sigma` and `_sigma_own`"),
    ] = None
    reference_common_sigma_m: Annotated[
        float | None,
        Within(0, 100, "m"),
        "Standard deviation of what all heights of the reference share.",
        Default("its rasters `_sigma` and `_sigma_own`"),
    ] = None
    correlation_m: Annotated[
        float | None,
        Within(0.001, 1000, "m"),
        "Length over which the errors of heights are alike.",
        Default("5 cells, the windows of the matching; without `dense` it must be given"),
    ] = None
    polygon_sigma_m: Annotated[
        float, Within(0, 100, "m"), "Standard deviation of the corners of the polygons, east and north each."
    ] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, base in (("level_m", "level"), ("reference", "reference")):
            given = getattr(self, name) is not None
            if given and self.base != base:
                raise SettingError(name, f"is the base of base: {base}, found base: {self.base}: remove one of them")
            if self.base == base and not given:
                raise SettingError("base", f"{base} needs {name}: give it, or choose base: rim")
        stated = (self.reference_own_sigma_m, self.reference_common_sigma_m)
        if (stated[0] is None) != (stated[1] is None):
            raise SettingError("reference_own_sigma_m", "and reference_common_sigma_m belong together: give both")
        if stated[0] is not None and self.base != "reference":
            raise SettingError("reference_own_sigma_m", "is that of a reference: give base: reference, or remove it")
        if self.polygons is None and any(getattr(self, field.name) != field.default for field in fields(self)):
            raise SettingError("polygons", "is missing: name the file of the polygons")
