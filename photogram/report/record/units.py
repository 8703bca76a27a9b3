"""Figures of report.json by their units, with the bounds within which a reader believes them."""

from typing import Annotated

from pydantic import Field

LARGEST = 1e15
"""Of any figure with a unit, without sign."""
FARTHEST_M = 1e9
"""Of a coordinate, a residual or a sigma on this planet."""

Metres = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Pixels = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Degrees = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
SquareMetres = Annotated[float, Field(ge=0, le=LARGEST)]
Seconds = Annotated[float, Field(ge=0, le=LARGEST)]
Iterations = Annotated[float, Field(ge=0, le=LARGEST)]
"""Each counted by the share of the work that it is."""
Share = Annotated[float, Field(ge=0, le=1)]
Probability = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0, le=10**15)]

_three = Field(min_length=3, max_length=3)

EarthMetres = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M)]
Position = Annotated[list[EarthMetres], _three]
"""Easting, northing, height in the map, or differences of such."""
PartlyKnown = Annotated[list[EarthMetres | None], _three]
"""The same, null along an axis where nothing is known."""
Angles = Annotated[list[Degrees], _three]
AxisFigures = Annotated[list[float | None], _three]
"""A figure without unit along each of three axes, null where there is none."""
AxisMetres = Annotated[list[Metres | None], _three]
Pixel = Annotated[list[Pixels], Field(min_length=2, max_length=2)]
ParameterFigures = dict[str, float | None]
"""A figure of every parameter of interior orientation by its name, in the parameter's own unit."""
