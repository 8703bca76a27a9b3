"""Accuracy as the ASPRS Positional Accuracy Standards for Digital Geospatial Data state it (Edition 2, 2023 and 2024).

With Δ the differences, product minus survey, of n check points: RMSE = √(ΣΔ²/n) per axis, RMSE_H = √(RMSE_X² + RMSE_Y²)
(sec. 7.3), RMSE_V that of heights (sec. 7.4), RMSE_3D = √(RMSE_H² + RMSE_V²) (sec. 7.5). The check points' own
uncertainty is part of the accuracy of the product (sec. 7.11): RMSE_H = √(RMSE_H1² + RMSE_H2²) with RMSE_H1 of the fit
and RMSE_H2 = √2 c of a survey with the sigma c per axis in plan, and RMSE_V = √(RMSE_V1² + RMSE_V2²).
What was measured is index 1. Where nobody has stated the survey's sigma, index 2 and the sum are unknown.
Errors beyond three times the target are blunders to be explained, means beyond a quarter of it systematic (sec. 7.2).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from photogram.arrays import FloatArray
from photogram.languages.codes import LanguageCode
from photogram.languages.language import ENGLISH, Language
from photogram.settings.settings import Default, Settings, Within

STANDARD = "ASPRS Positional Accuracy Standards for Digital Geospatial Data, Edition 2, Version 2 (2024)"
MINIMUM_POINTS = 30
BLUNDER_FACTOR = 3.0
SYSTEMATIC_SHARE = 0.25
SURVEY_FACTOR = 2.0  # how much more accurate than the target check points must be (sec. 7.12)
NSSDA_H, NSSDA_V = 1.7308, 1.9600  # FGDC-STD-007.3-1998, app. 3-A, of the radial RMSE and of that of heights
AXES = ("easting", "northing", "height")
STATE_SURVEY = "enter the accuracy of the check points' survey as sigma_m, and remove sigma_assumed"
"""What to do where nobody has stated how accurately the check points were surveyed."""


@dataclass(frozen=True)
class ReportSettings(Settings):
    """What the report says that no measurement tells: names, the accuracy that was agreed on, and its wording."""

    name: Annotated[str, "Name of the survey."] = ""
    client: Annotated[str, "Client."] = ""
    author: Annotated[str, "Author, whose name stands above the line for the signature."] = ""
    surveyor: Annotated[str, "Who has surveyed the ground points."] = ""
    instrument: Annotated[str, "What they were surveyed with, and how: receiver or total station, method."] = ""
    targets: Annotated[str, "How the ground points are marked on the ground."] = ""
    place: Annotated[str, "Place of the signature."] = ""
    standard: Annotated[
        Literal["none", "asprs-2024", "pec-pcd"], "Whose classes or statements the first part of the page has."
    ] = "none"
    language: Annotated[
        LanguageCode, "Language of the client's part of the page, of its pictures and of README.txt."
    ] = "en"
    target_rmse_h_m: Annotated[
        float | None,
        Within(0.0001, 1000, "m"),
        "Accuracy class in plan: the largest RMSE_H; verdicts and the accuracy statement follow from it.",
        Default("none agreed on"),
    ] = None
    target_rmse_v_m: Annotated[
        float | None,
        Within(0.0001, 1000, "m"),
        "Accuracy class in height: the largest RMSE_V.",
        Default("none agreed on"),
    ] = None
    measurements: Annotated[
        bool, "Whether the report has what was measured and named on the page of `photogram desk`."
    ] = False
    legacy_95: Annotated[bool, "Whether the 95 % figures of older standards are added."] = False


@dataclass(frozen=True)
class AxisAccuracy:
    """Differences along one axis, in m: how many, RMSE, mean and standard deviation (of n − 1), NaN where unknown."""

    n: int
    rmse_m: float
    mean_m: float
    sd_m: float


@dataclass(frozen=True)
class Accuracy:
    """Accuracy of a product, m; NaN without points. What tells of the survey, or of both together, is NaN as well where
    the survey's standard deviation of a point is unknown."""

    n_h: int
    """Points checked in plan."""
    n_v: int
    """Points checked in height."""
    axes: tuple[AxisAccuracy, AxisAccuracy, AxisAccuracy]
    """Easting, northing, height."""
    fit_h_m: float
    """Fit to the check points in plan, RMSE_H1."""
    fit_v_m: float
    """Fit in height, RMSE_V1."""
    survey_h_m: float
    """Uncertainty of their survey in plan, RMSE_H2."""
    survey_v_m: float
    """Uncertainty of their survey in height, RMSE_V2."""

    @property
    def rmse_h_m(self) -> float:
        """Return RMSE_H, the survey's own uncertainty included; NaN where that is unknown."""
        return math.hypot(self.fit_h_m, self.survey_h_m)

    @property
    def rmse_v_m(self) -> float:
        """Return RMSE_V, the survey's own uncertainty included; NaN where that is unknown."""
        return math.hypot(self.fit_v_m, self.survey_v_m)

    @property
    def rmse_3d_m(self) -> float:
        """Return RMSE_3D, the survey's own uncertainty included; NaN where that is unknown."""
        return math.hypot(self.rmse_h_m, self.rmse_v_m)

    @property
    def legacy_95_h_m(self) -> float:
        """Return the horizontal accuracy at 95 % of the NSSDA, of the fit alone as that standard has it."""
        return NSSDA_H * self.fit_h_m

    @property
    def legacy_95_v_m(self) -> float:
        """Return the vertical accuracy at 95 % of the NSSDA, of the fit alone as that standard has it."""
        return NSSDA_V * self.fit_v_m


def _axis(difference_m: FloatArray) -> AxisAccuracy:
    n = len(difference_m)
    if not n:
        return AxisAccuracy(0, math.nan, math.nan, math.nan)
    sd_m = float(difference_m.std(ddof=1)) if n > 1 else math.nan
    return AxisAccuracy(n, float(np.sqrt(np.mean(difference_m**2))), float(difference_m.mean()), sd_m)


def asprs_accuracy(difference_m: FloatArray, sigma_m: FloatArray) -> Accuracy:
    """Return the accuracy from differences, product minus survey (n, 3), of check points surveyed with ``sigma_m``
    (n, 3): easting, northing, height, in m.

    Differences are NaN where a point does not check an axis; a point tells the plan by both its axes or not at all. A
    ``sigma_m`` is NaN where nobody has stated it: then the uncertainty of the survey is that of no sum.
    """
    plan = np.isfinite(difference_m[:, :2]).all(axis=1)
    height = np.isfinite(difference_m[:, 2])
    east, north, up = (_axis(difference_m[m, k]) for k, m in enumerate((plan, plan, height)))
    known = bool(plan.any()), bool(height.any())
    # the mean of σ_E² + σ_N², 2c² where all are alike
    survey_h_m = float(np.sqrt(np.mean(np.sum(sigma_m[plan, :2] ** 2, axis=1)))) if known[0] else math.nan
    survey_v_m = float(np.sqrt(np.mean(sigma_m[height, 2] ** 2))) if known[1] else math.nan
    return Accuracy(
        int(plan.sum()),
        int(height.sum()),
        (east, north, up),
        math.hypot(east.rmse_m, north.rmse_m),
        up.rmse_m,
        survey_h_m,
        survey_v_m,
    )


def axis_targets_m(settings: ReportSettings) -> tuple[float | None, float | None, float | None]:
    """Return the target RMSE per axis in m: in plan the class over √2, since RMSE_H is that of both axes together."""
    h = None if settings.target_rmse_h_m is None else settings.target_rmse_h_m / math.sqrt(2.0)
    return h, h, settings.target_rmse_v_m


def blunders(difference_m: FloatArray, names: Sequence[str], settings: ReportSettings) -> list[str]:
    """Return a sentence for every difference (n, 3) beyond three times its target, to be explained."""
    sentences = []
    for k, target_m in enumerate(axis_targets_m(settings)):
        if target_m is None:
            continue
        limit_m = BLUNDER_FACTOR * target_m
        sentences += [
            f"check point {names[i]}, {AXES[k]}: {difference_m[i, k]:+.3f} m is beyond three times the target RMSE "
            f"({limit_m:.3f} m): a blunder to be explained"
            for i in np.flatnonzero(np.abs(difference_m[:, k]) > limit_m).tolist()
        ]
    return sentences


def systematic(accuracy: Accuracy, settings: ReportSettings) -> list[str]:
    """Return a sentence for every axis whose mean difference is beyond a quarter of its target."""
    sentences = []
    for name, axis, target_m in zip(AXES, accuracy.axes, axis_targets_m(settings), strict=True):
        if target_m is not None and abs(axis.mean_m) > SYSTEMATIC_SHARE * target_m:
            sentences.append(
                f"{name}: the mean difference of {axis.mean_m:+.3f} m ({axis.n} check points) is beyond 25 % of the "
                f"target RMSE ({SYSTEMATIC_SHARE * target_m:.3f} m): a systematic error to be investigated"
            )
    return sentences


def coarse_survey(accuracy: Accuracy, settings: ReportSettings) -> list[str]:
    """Return a sentence where the check points are not surveyed twice as accurately as the target (sec. 7.12)."""
    rows = (
        ("in plan", accuracy.survey_h_m, settings.target_rmse_h_m),
        ("in height", accuracy.survey_v_m, settings.target_rmse_v_m),
    )
    return [
        f"the check points are surveyed to {sigma_m:.3f} m {where}: the standard requires half the target "
        f"RMSE or better ({target_m / SURVEY_FACTOR:.3f} m)"
        for where, sigma_m, target_m in rows
        if target_m is not None and sigma_m > target_m / SURVEY_FACTOR
    ]


def assumed_survey(assumed: Sequence[str], n: int, language: Language = ENGLISH) -> str:
    """Return in words that the accuracy of the survey of the points ``assumed``, out of ``n`` check points, is only
    assumed."""
    if len(assumed) == n:
        return language.gettext("the accuracy of the check points' survey is only assumed")
    return language.gettext(
        "the accuracy of the survey of {some} of {n} check points ({names}) is only assumed",
        some=len(assumed),
        n=n,
        names=language.some(assumed),
    )


def _centimetres(length_m: float) -> str:
    return f"{length_m * 100:.1f} (cm)"


def _statement(count: int, rmse_m: float, target_m: float, accuracy_class: str, finding: str) -> str | None:
    if not count or not rmse_m <= target_m:
        return None
    graded = f"{_centimetres(target_m)} {accuracy_class} Accuracy Class."
    tested = f"{finding} = {_centimetres(rmse_m)}"
    if count >= MINIMUM_POINTS:
        return f"This data set was tested to meet {STANDARD} for a {graded} {tested}."
    return (
        f"{_reduced(count)} This data set was produced to meet a {graded} {tested} using the reduced number of "
        "checkpoints."
    )


def statement_h(n: int, rmse_h_m: float, target_m: float) -> str | None:
    """Return the standard's statement of horizontal accuracy (sec. 7.16) from the RMSE_H of ``n`` check points, m; None
    where it cannot be made: without check points, where the accuracy of their survey is unknown and ``rmse_h_m`` NaN,
    or where the class is not met."""
    finding = "The tested horizontal positional accuracy was found to be RMSE_H"
    return _statement(n, rmse_h_m, target_m, "RMSE_H Horizontal Positional", finding)


def statement_v(n: int, rmse_v_m: float, target_m: float) -> str | None:
    """Return the standard's statement of non-vegetated vertical accuracy (sec. 7.16) in the same way."""
    finding = "The Non-Vegetated Vertical Accuracy (NVA) was found to be RMSE_V"
    return _statement(n, rmse_v_m, target_m, "RMSE_V Vertical", finding)


def _reduced(count: int) -> str:
    return (
        f"This data set was tested as required by {STANDARD}. Although the Standards call for a minimum of thirty (30) "
        f"checkpoints, this test was performed using ONLY {count} checkpoints."
    )
