"""What report.json says in words and by rules: accuracy by the standard, lights, warnings, the verdict."""

from typing import Literal, NotRequired

from typing_extensions import TypedDict

from photogram.languages.codes import LanguageCode
from photogram.report.record.units import Count, Metres

Grade = Literal["good", "few", "attention", "bad", "unknown"]
Severity = Literal["bad", "attention", "note"]


class AxisAccuracyRecord(TypedDict):
    """Differences adjusted minus surveyed along an axis; null where there are too few."""

    n: Count
    rmse_m: Metres | None
    mean_m: Metres | None
    sd_m: Metres | None


class AccuracyByAxis(TypedDict):
    """The same along each axis of the map."""

    easting: AxisAccuracyRecord
    northing: AxisAccuracyRecord
    height: AxisAccuracyRecord


class LegacyRecord(TypedDict):
    """Accuracy at 95 % by the NSSDA."""

    horizontal_m: Metres | None
    vertical_m: Metres | None


class ProductAccuracyRecord(TypedDict):
    """Accuracy of a product itself by the ASPRS standards: of a `product` file in plan or in height (`where`), from
    the `n` check points that were found on it, and the standard's statement, or why there is none."""

    product: str
    where: Literal["plan", "height"]
    n: Count
    fit_rmse_m: Metres | None
    survey_rmse_m: Metres | None
    rmse_m: Metres | None
    target_rmse_m: Metres | None
    statement: str | None
    not_stated: str | None


class AsprsRecord(TypedDict):
    """Accuracy and statements by the ASPRS standards, from check points alone: of the triangulation, and of
    `products`. `survey_assumed` says of which check points nobody has stated the accuracy of the survey, null where of
    none; what needs it is null then."""

    standard: str
    n_h: Count
    n_v: Count
    axes: AccuracyByAxis
    fit_rmse_h_m: Metres | None
    fit_rmse_v_m: Metres | None
    survey_rmse_h_m: Metres | None
    survey_rmse_v_m: Metres | None
    survey_assumed: str | None
    rmse_h_m: Metres | None
    rmse_v_m: Metres | None
    rmse_3d_m: Metres | None
    target_rmse_h_m: Metres | None
    target_rmse_v_m: Metres | None
    statements: list[str]
    not_stated: list[str]
    blunders: list[str]
    systematic: list[str]
    survey: list[str]
    legacy_95: LegacyRecord | None
    products: NotRequired[list[ProductAccuracyRecord]]


class DiscardedRecord(TypedDict):
    """What took no part in the result, and why."""

    what: str
    count: Count
    reason: str


class WarningRecord(TypedDict):
    """What must not be overlooked, and what to do."""

    part: str
    severity: Severity
    sentence: str
    remedy: str


class LightRecord(TypedDict):
    """What is judged, how, what was found, and the rule that makes it so."""

    subject: str
    grade: Grade
    finding: str
    rule: str


class VerdictFigureRecord(TypedDict):
    """Accuracy in plan or in height: measured at check points (`rmse_m`), together with the uncertainty of their
    survey (`survey_m`) as ASPRS adds them (`asprs_rmse_m`), null where nobody has stated it; its target; predicted."""

    where: str
    n: Count
    rmse_m: Metres | None
    survey_m: Metres | None
    asprs_rmse_m: Metres | None
    target_m: Metres | None
    relative_sigma_m: Metres | None
    absolute_sigma_m: Metres | None


class VerdictRecord(TypedDict):
    """The verdict on the whole survey, in a sentence, two figures, and what to do."""

    grade: Grade
    sentence: str
    also: str
    figures: list[VerdictFigureRecord]
    to_do: list[str]


class NamesRecord(TypedDict):
    """What the project calls the survey, whose it is, and how its ground points were surveyed, null where it does not
    say; the language of the client's part of the page where it is not English, as report.json itself always is."""

    name: str | None
    client: str | None
    author: str | None
    surveyor: NotRequired[str | None]
    instrument: NotRequired[str | None]
    targets: NotRequired[str | None]
    place: NotRequired[str | None]
    language: NotRequired[LanguageCode]


class SurveyRecord(NamesRecord):
    """The names of a survey, when it was flown, and the name of its map grid."""

    flown_first: str | None
    flown_last: str | None
    crs_name: str | None


class StandardFigureRecord(TypedDict):
    """A figure that an authority asks for: its name there, from `n` check points, and the `key` that it comes from."""

    name: str
    value_m: Metres | None
    n: Count
    key: str


class ScaleClassRecord(TypedDict):
    """Classes at a scale, 1 to `scale`, with its contour interval; null where none is held or none can be told."""

    scale: Count
    contour_interval_m: Metres
    plan: Literal["A", "B", "C", "D"] | None
    height: Literal["A", "B", "C", "D"] | None


class StandardRecord(TypedDict):
    """What an authority asks for, from check points alone: a statement needs `least_points` of them, or says that they
    are fewer."""

    profile: Literal["asprs-2024", "pec-pcd"]
    standard: str
    least_points: Count
    figures: list[StandardFigureRecord]
    scales: list[ScaleClassRecord]
    statements: list[str]
    not_stated: list[str]


class DeliverableRecord(TypedDict):
    """A file of the results that belongs to the report."""

    file: str
    bytes: Count
    sha256: str
