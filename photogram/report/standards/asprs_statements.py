"""The statements of the ASPRS standard on a survey, in its own words, or why there is none, in a language."""

import math
from collections.abc import Sequence

from photogram.languages.language import Language
from photogram.quality.asprs import Accuracy, ReportSettings, statement_h, statement_v


def asprs_statements(
    accuracy: Accuracy, assumed: str | None, settings: ReportSettings, language: Language
) -> tuple[list[str], list[str]]:
    """Return the standard's statements, in its own words, and a sentence for each that cannot be made that says why, or
    for both; ``assumed`` says of which points the accuracy of the survey is only assumed."""
    statements, missing = list[str](), list[str]()
    rows = (
        ("horizontal", accuracy.n_h, accuracy.rmse_h_m, settings.target_rmse_h_m, statement_h),
        ("vertical", accuracy.n_v, accuracy.rmse_v_m, settings.target_rmse_v_m, statement_v),
    )
    unknown = [name for name, n, rmse_m, *_ in rows if n and math.isnan(rmse_m)]
    if unknown:
        missing.append(_survey_unknown(unknown, str(assumed), language))
    for name, n, rmse_m, target_m, statement in rows:
        if name in unknown:
            continue
        text = None if target_m is None else statement(n, rmse_m, target_m)
        if text is not None:
            statements.append(text)
        elif name == "horizontal":
            missing.append(_no_horizontal(n, rmse_m, target_m, language))
        else:
            missing.append(_no_vertical(n, rmse_m, target_m, language))
    return statements, missing


def _survey_unknown(unknown: Sequence[str], assumed: str, language: Language) -> str:
    if len(unknown) == 2:
        return language.gettext(
            "No statement of accuracy: {assumed}; enter it as sigma_m, and remove sigma_assumed.", assumed=assumed
        )
    if unknown[0] == "horizontal":
        return language.gettext(
            "No statement of horizontal accuracy: {assumed}; enter it as sigma_m, and remove sigma_assumed.",
            assumed=assumed,
        )
    return language.gettext(
        "No statement of vertical accuracy: {assumed}; enter it as sigma_m, and remove sigma_assumed.", assumed=assumed
    )


def _no_horizontal(n: int, rmse_m: float, target_m: float | None, language: Language) -> str:
    if not n:
        return language.gettext("No statement of horizontal accuracy: no check points, the accuracy is not tested.")
    if target_m is None:
        return language.gettext(
            "No statement of horizontal accuracy: it needs an accuracy class, and the project gives none; set "
            "report.target_rmse_h_m."
        )
    return language.gettext(
        "No statement of horizontal accuracy: the tested RMSE of {rmse} m (n = {n}) does not meet the class of "
        "{target} m.",
        rmse=language.figure(f"{rmse_m:.3f}"),
        n=n,
        target=language.figure(f"{target_m:.3f}"),
    )


def _no_vertical(n: int, rmse_m: float, target_m: float | None, language: Language) -> str:
    if not n:
        return language.gettext("No statement of vertical accuracy: no check points, the accuracy is not tested.")
    if target_m is None:
        return language.gettext(
            "No statement of vertical accuracy: it needs an accuracy class, and the project gives none; set "
            "report.target_rmse_v_m."
        )
    return language.gettext(
        "No statement of vertical accuracy: the tested RMSE of {rmse} m (n = {n}) does not meet the class of "
        "{target} m.",
        rmse=language.figure(f"{rmse_m:.3f}"),
        n=n,
        target=language.figure(f"{target_m:.3f}"),
    )
