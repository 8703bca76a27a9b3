"""The report page on disk: written beside report.json, made again from it, and printed as PDF."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from photogram.errors import ReportError
from photogram.files.atomic import replacing
from photogram.files.npz_json import file_fingerprint, read_json, write_json
from photogram.geodesy.crs import crs_title
from photogram.languages.codes import CODES, LanguageCode
from photogram.languages.language import Language
from photogram.pipeline.stages.adjustment import AdjustmentSummary
from photogram.pipeline.stages.features import MASKED
from photogram.pipeline.stages.order import BEFORE_RESULTS
from photogram.pipeline.stages.stored_adjustment import stored_verdict
from photogram.pipeline.store.readme import write_readme
from photogram.pipeline.store.results_record import recorded, remove_made
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.workspace import Workspace
from photogram.project.project import Project
from photogram.project.validation.masks import marks_in_masks
from photogram.report.figures.page_figures import CLIENTS, PageFigure
from photogram.report.kept_measurements import FILE as MEASUREMENTS
from photogram.report.kept_measurements import measurement_records
from photogram.report.numbers.completion import complete, survey_names
from photogram.report.numbers.numbers import RejectedAttitudes
from photogram.report.numbers.verdicts import RejectedBlunders
from photogram.report.page import report_page
from photogram.report.printing import print_pdf
from photogram.report.reading import making_of, read_report
from photogram.report.record.block import EffortRecord
from photogram.report.record.json_schema import report_schema
from photogram.report.record.photographs import MasksRecord
from photogram.report.record.report import Report, SurveyNumbers
from photogram.report.record.verdict import DeliverableRecord, SurveyRecord
from photogram.result_files import result_path, within_results

PAGE, PRINTED, NUMBERS, FIGURES, VIEW = "report.html", "report.pdf", "report.json", "figures.json", "view.html"
SCHEMA = "report.schema.json"


def survey_record(run: Run) -> SurveyRecord:
    """Return the days of flight, the map, and what the project calls the survey."""
    days = sorted(note["time"][:10] for note in run.notes() if note["time"])
    return {
        "flown_first": days[0] if days else None,
        "flown_last": days[-1] if days else None,
        "crs_name": crs_title(run.project.crs),
        **survey_names(run.project.report),
    }


def mask_numbers(run: Run) -> MasksRecord | None:
    """Return how much of the photographs is masked, None where nothing is and nothing was to be."""
    file = run.workspace.file("features", MASKED) if run.workspace.has("features", MASKED) else None
    given: dict[str, float] = {} if file is None else read_json(file)
    automatic = run.automatically_masked
    if not given and "sky" not in run.project.masks.auto:
        return None

    def mean(shares: Sequence[float]) -> float | None:
        return sum(shares) / len(shares) if shares else None

    return {
        "given": len(given),
        "given_share": mean(list(given.values())),
        "automatic": len(automatic),
        "automatic_share": mean(list(automatic.values())),
        "photographs": {
            name: {"given": given.get(name), "automatic": automatic.get(name)}
            for name in run.names
            if name in given or name in automatic
        },
        "marks": marks_in_masks(run.project, run.mask),
    }


def rejected_attitudes(run: Run) -> RejectedAttitudes:
    """Return how many attitudes and headings of the gimbal the adjustment did not believe."""
    summary = run.workspace.summary("adjustment", AdjustmentSummary)
    return RejectedAttitudes(summary.get("disbelieved_attitudes", 0), summary.get("rejected_headings", 0))


def adjustment_effort(run: Run) -> list[EffortRecord]:
    """Return the work for each decision of the adjustment, none where it was stored before this was counted."""
    return run.workspace.summary("adjustment", AdjustmentSummary).get("effort", [])


def rejected_blunders(run: Run) -> RejectedBlunders:
    """Return the blunders that the adjustment has rejected, and what they do to the check points."""
    verdict = stored_verdict(run)
    return RejectedBlunders(
        verdict["blunders"], verdict["check_points"], verdict["check_points_without"], verdict["focal_lengths"]
    )


def today() -> str:
    """Return the date, as report.json has it."""
    return datetime.now().astimezone().date().isoformat()


def write_report(project: Project, numbers: SurveyNumbers, figures: Sequence[PageFigure], kept: Path) -> list[str]:
    """Complete the numbers, write report.json with its schema and report.html, and keep the figures in the folder
    ``kept``. Returns what was written into the folder of results. Raises WorkspaceError where a file cannot be written.
    """
    write_json(kept / FIGURES, [figure.to_json() for figure in figures])
    completed = complete(_with_measurements(project, numbers), project.report)
    _write(project, completed, [figure.to_json() for figure in figures])
    return [within_results(name) for name in (NUMBERS, SCHEMA, PAGE)]


def measurements_of(project: Project) -> Path | None:
    """Return the file of measurements that the report is to have, None where it is to have none."""
    path = project.path.parent / MEASUREMENTS
    return path if project.report.measurements and path.is_file() else None


def _with_measurements(project: Project, numbers: SurveyNumbers) -> SurveyNumbers:
    """Return numbers with what was measured on the page, where the project asks for it, and without otherwise."""
    path, other = measurements_of(project), numbers.copy()
    other.pop("measurements", None)
    if path is not None:
        other["measurements"] = measurement_records(path, project.crs, numbers["deliverables"])
    return other


def _write(project: Project, completed: Report, figures: Sequence[dict[str, str]]) -> None:
    path = result_path(project.results, NUMBERS)
    write_json(path, completed)
    write_json(result_path(project.results, SCHEMA), report_schema())
    # from the file itself, so that the page of today and one made again from it are the same
    page = report_page(read_report(path), figures, {stage.name: stage.title for stage in BEFORE_RESULTS})
    with replacing(result_path(project.results, PAGE)) as temporary:
        temporary.write_text(page, encoding="utf-8")


# ---- what belongs to a result ----------------------------------------------------------------------------------------


def deliverables(results: Path, products: Sequence[str]) -> list[DeliverableRecord]:
    """Return `{file, bytes, sha256}` of files in the folder of results, by name with their folder."""
    return [
        {"file": name, "bytes": (results / name).stat().st_size, "sha256": file_fingerprint(results / name)}
        for name in sorted(set(products))
    ]


def discard_prints(results: Path) -> None:
    """Remove report.pdf and view.html, which would outlive the results that they show; not where somebody has changed
    them since, with a signature for example: their report id says what they belong to."""
    remove_made(results, [name for own in (PRINTED, VIEW) for name in (own, within_results(own))])


# ---- made again, and printed -----------------------------------------------------------------------------------------


def remake_report(project: Project) -> Path:
    """Make report.html again from report.json, with what the project now asks of the report; returns its path.

    Figures are those drawn with the results; without their folder the page says that they are left out. Raises
    ReportError where there is no report.json, WorkspaceError where the figures are damaged.
    """
    path, workspace = result_path(project.results, NUMBERS), Workspace(project.work)
    if not path.is_file():
        raise ReportError(f"{path}: no results yet: run photogram adjust {project.path} first")
    drawn = _drawn(workspace)
    numbers = read_report(path)
    former = numbers["report_id"]
    with making_of(path):
        completed = complete(_with_measurements(project, numbers), project.report)
        if completed["report_id"] != former:
            discard_prints(project.results)
        with recorded(project.results):
            _write(project, completed, drawn)
    write_readme(project.results, Language(project.report.language))
    return result_path(project.results, PAGE)


def _drawn(workspace: Workspace) -> list[dict[str, str]]:
    """Return the figures as they were kept with the results, none without their folder."""
    kept: list[dict[str, str]] = []
    return read_json(workspace.file("results", FIGURES)) if workspace.stage("results").is_dir() else kept


def picture_languages(project: Project) -> set[LanguageCode]:
    """Return the languages in which the pictures of the client's part are drawn, none where they are left out. Raises
    WorkspaceError where they are damaged."""
    figures = _drawn(Workspace(project.work))
    return {
        code
        for figure in figures
        for code in CODES
        if figure["key"] in CLIENTS and figure.get("language", "en") == code
    }


def print_report(project: Project) -> Path:
    """Print report.html as report.pdf beside it; returns its path. Raises ReportError where no browser can."""
    page = result_path(project.results, PAGE)
    target = page.with_name(PRINTED)
    with recorded(project.results), replacing(target) as temporary:
        print_pdf(page, temporary)
    write_readme(project.results, Language(project.report.language))
    return target
