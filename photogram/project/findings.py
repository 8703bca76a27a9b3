"""Findings of an input validation: severity, place, finding and remedy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from photogram.wording import html_table, things

Severity = Literal["error", "warning", "note"]
"""An error makes processing fail, a warning makes its result doubtful, a note says what to expect."""


@dataclass(frozen=True)
class Finding:
    """One finding."""

    severity: Severity
    """Error, warning or note."""
    where: str
    """Key, file and line, photograph or point."""
    text: str
    """What was found."""
    remedy: str = ""
    """What to do, empty where there is nothing to do or the text says it."""

    def __str__(self) -> str:
        return ": ".join(part for part in (self.where, self.text, self.remedy) if part)


class Findings(tuple[Finding, ...]):
    """All findings of a check, the worst first: a tuple of Finding with a readable ``repr``."""

    __slots__ = ()

    @property
    def errors(self) -> Findings:
        """Return what makes processing fail."""
        return self._of("error")

    @property
    def warnings(self) -> Findings:
        """Return what makes the result doubtful."""
        return self._of("warning")

    @property
    def notes(self) -> Findings:
        """Return what is to be expected."""
        return self._of("note")

    @property
    def ready(self) -> bool:
        """Return whether the project can be processed: there is no error."""
        return not self.errors

    def _of(self, severity: Severity) -> Findings:
        return Findings(finding for finding in self if finding.severity == severity)

    def _counts(self) -> str:
        state = "ready" if self.ready else "not ready"
        return f"{state}: {things(len(self.errors), 'error')}, {things(len(self.warnings), 'warning')}"

    def __repr__(self) -> str:
        return "\n".join([f"<Findings, {self._counts()}>", *(f"{f.severity}: {f}" for f in self)])

    def _repr_html_(self) -> str:
        rows = [(f.severity, f.where, f.text, f.remedy) for f in self]
        return html_table(self._counts(), ("", "where", "finding", "remedy"), rows)
