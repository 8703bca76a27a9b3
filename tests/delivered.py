"""What a survey of a known hill hands over: contour lines with truth, points, footprints and a rim."""

from datetime import date
from pathlib import Path

import numpy as np
import shapely

from photogram.delivery.survey_contents import Footprint, GroundPoints, SurveyContents
from photogram.surface.contours import ContourSettings, contour_lines
from photogram.survey import Raster

WEST, NORTH, CELL = 602_300.0, 5_794_160.0, 0.25
ROWS, COLUMNS = 200, 240


def hill() -> Raster:
    """A hill of 24 m on a slope, without data in a corner: heights of a formula, north-west corner at (WEST, NORTH)."""
    y, x = np.mgrid[0:ROWS, 0:COLUMNS] * CELL
    heights = 100.0 + 24.0 * np.exp(-(((x - 30.0) / 14.0) ** 2) - ((y - 24.0) / 11.0) ** 2) + 0.05 * x
    heights[:20, :30] = np.nan
    return Raster(heights.astype(np.float32), WEST, NORTH, CELL)


def handed_over(crs: str = "EPSG:25832") -> SurveyContents:
    """Return what is handed over of the hill: control points and a check point, footprints, a rim with a hole."""
    contours = contour_lines(hill(), ContourSettings(interval_m=1.0))
    places = np.array(
        [[602_310.25, 5_794_150.5, 101.125], [602_340.0, 5_794_130.0, 118.5], [602_355.5, 5_794_120.75, 102.0]]
    )
    square = np.array([WEST, NORTH - 50.0, 105.0]) + np.array([[0, 0, 0], [30, 0, 0], [30, 25, 0], [0, 25, 0]])
    rim = shapely.box(WEST, NORTH - 50.0, WEST + 60.0, NORTH).difference(
        shapely.box(WEST + 5, NORTH - 9, WEST + 9, NORTH - 5)
    )
    return SurveyContents(
        Path("results"),
        crs,
        f"{crs}, heights above the hill",
        GroundPoints(("GCP 1", "Übergang", "CP<3>"), np.array([True, True, False]), places),
        tuple(Footprint(f"DJI_000{i}.JPG", square + np.array([20.0 * i, 0.0, 0.0])) for i in (1, 2)),
        contours,
        "terrain",
        None,
        "terrain",
        date(2026, 5, 4),
        rim,
        {},
    )
