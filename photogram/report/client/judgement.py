"""The verdict and what an authority asks for, in the client's language."""

from dataclasses import dataclass

from photogram.languages.language import Language
from photogram.quality.asprs import ReportSettings
from photogram.report.numbers.completion import asprs_numbers
from photogram.report.numbers.overall import overall
from photogram.report.numbers.ranked_warnings import ranked_warnings
from photogram.report.record.report import Report
from photogram.report.record.verdict import StandardRecord, VerdictRecord
from photogram.report.standards.authorities import standard_record


@dataclass(frozen=True)
class Judgement:
    """The verdict, and the profile of an authority where the project asks for one."""

    verdict: VerdictRecord
    standard: StandardRecord | None


def judgement_in(report: Report, language: Language) -> Judgement:
    """Return what report.json says by rules: as it stands there, in English, or made of its figures in a language."""
    former = report.get("standard")
    if language.is_english:
        return Judgement(report["verdict"], former)
    asked = ReportSettings(
        standard="none" if former is None else former["profile"],
        target_rmse_h_m=report["asprs"]["target_rmse_h_m"],
        target_rmse_v_m=report["asprs"]["target_rmse_v_m"],
    )
    asprs = asprs_numbers(report["control_points"], asked, language)
    warnings = ranked_warnings(report, asprs, language)
    return Judgement(
        overall(report, asprs, report["summary"], warnings, language),
        standard_record(asked, report["control_points"], asprs, language),
    )
