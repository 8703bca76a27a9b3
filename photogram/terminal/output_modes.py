"""How a command speaks: in tables and bars, in warnings and one line alone, or in events for programs."""

import os
import shlex
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from rich.markup import escape

from photogram.files.portable import path_from
from photogram.pipeline.costs.forecast import Forecast
from photogram.pipeline.stage import Watcher
from photogram.pipeline.stages.publishing.report_files import PAGE
from photogram.project.findings import Finding
from photogram.project.project import Project
from photogram.report.record.report import Report
from photogram.result_files import within_results
from photogram.terminal.console import bars, console, steps
from photogram.terminal.cost_table import cost_line
from photogram.terminal.events import EventLines
from photogram.terminal.findings_table import findings_table, has_errors, verdict
from photogram.terminal.progress import EventWatcher, Quiet, Terminal, say_warning
from photogram.terminal.report_tables import show_report
from photogram.wording import Progress, silent


class Voice(ABC):
    """What a command that processes a survey says."""

    @abstractmethod
    def findings(self, findings: Sequence[Finding], title: str) -> None:
        """Say what the validation has found; notes are left out."""

    def forecast(self, predicted: Forecast) -> None:  # noqa: B027 - most say nothing
        """Say what the work will take, before it begins."""

    @contextmanager
    def preparing(self, title: str) -> Iterator[Progress]:  # noqa: ARG002
        """Show work before the stages, piece by piece."""
        yield silent

    @abstractmethod
    def watching(self, predicted: Mapping[str, float]) -> AbstractContextManager[Watcher]:
        """Watch a pipeline whose stages are predicted to take so many seconds."""

    @abstractmethod
    def result(self, survey: Project, report: Report | None) -> None:
        """Say what came out; there is no report where the run ended before its last stage."""


def results_folder(survey: Project) -> str:
    """Return the folder of results as it is shown: from here, or absolute where it lies elsewhere."""
    relative = path_from(Path(), survey.results)
    return str(survey.results if relative.parts[:1] == ("..",) else relative)


def say_results(survey: Project) -> None:
    """Say where the report is, and how to see the survey in 3-D."""
    folder = results_folder(survey)
    console.print(f"Report: {escape(os.path.join(folder, within_results(PAGE)))}", soft_wrap=True)
    console.print(f"3-D view: photogram view {escape(shlex.quote(folder))} --open", soft_wrap=True)


class Spoken(Voice):
    """Tables and bars on the terminal."""

    def forecast(self, predicted: Forecast) -> None:
        """Print one line."""
        if predicted.stages:
            console.print(cost_line(predicted), soft_wrap=True)

    def findings(self, findings: Sequence[Finding], title: str) -> None:
        """Print errors and warnings as a table."""
        serious = [finding for finding in findings if finding.severity != "note"]
        if serious:
            console.print(findings_table(serious, title))
        if has_errors(serious):
            console.print(verdict(serious))
            console.print("Nothing was processed; --no-check processes in spite of errors.")

    @contextmanager
    def preparing(self, title: str) -> Iterator[Progress]:
        """Show a bar."""
        with steps(title) as step:
            yield step

    @contextmanager
    def watching(self, predicted: Mapping[str, float]) -> Iterator[Watcher]:
        """Show bars, with a line for each finished stage."""
        with bars() as progress:
            yield Terminal(progress, predicted)

    def result(self, survey: Project, report: Report | None) -> None:
        """Print the essentials of the report, and where it is."""
        if report is not None:
            show_report(report)
            say_results(survey)


class Brief(Voice):
    """Warnings, errors and one line of the result."""

    def findings(self, findings: Sequence[Finding], title: str) -> None:  # noqa: ARG002
        """Print a line for each error and each warning."""
        for finding in findings:
            if finding.severity == "warning":
                say_warning(str(finding))
            elif finding.severity == "error":
                console.print(f"[bold red]Error:[/bold red] {escape(str(finding))}", soft_wrap=True)

    @contextmanager
    def watching(self, predicted: Mapping[str, float]) -> Iterator[Watcher]:  # noqa: ARG002
        """Say warnings alone."""
        yield Quiet()

    def result(self, survey: Project, report: Report | None) -> None:
        """Print the warnings of the report and its verdict, in one line with its place."""
        if report is None:
            console.print("Done.")
            return
        for text in warnings_of(report):
            say_warning(text)
        place = os.path.join(results_folder(survey), within_results(PAGE))
        console.print(f"{escape(report['verdict']['sentence'])} {escape(place)}", soft_wrap=True)


class InEvents(Voice):
    """Events for programs; of what the work will take, the first tells the seconds left."""

    def __init__(self, lines: EventLines) -> None:
        self._lines = lines

    def findings(self, findings: Sequence[Finding], title: str) -> None:  # noqa: ARG002
        """Write an event for each error and each warning."""
        for finding in findings:
            if finding.severity != "note":
                self._lines.say(finding.severity, str(finding))

    @contextmanager
    def watching(self, predicted: Mapping[str, float]) -> Iterator[Watcher]:
        """Write an event for each stage that begins, goes on and ends."""
        yield EventWatcher(self._lines, predicted)

    def result(self, survey: Project, report: Report | None) -> None:  # noqa: ARG002
        """Write the warnings of the report, and its verdict as the last event."""
        for text in () if report is None else warnings_of(report):
            self._lines.say("warning", text)
        sentence = "" if report is None else report["verdict"]["sentence"]
        self._lines.say("done", sentence, seconds_left=0.0)


def warnings_of(report: Report) -> list[str]:
    """Return what must not be overlooked in a report, each with what to do."""
    serious = [warning for warning in report["warnings"] if warning["severity"] != "note"]
    return ["; ".join(filter(None, (warning["sentence"].removesuffix("."), warning["remedy"]))) for warning in serious]


def voice_of(quiet: bool, lines: EventLines | None) -> Voice:
    """Return how a command speaks that was called with ``--quiet``, or with ``--json``, which goes first."""
    if lines is not None:
        return InEvents(lines)
    return Brief() if quiet else Spoken()
