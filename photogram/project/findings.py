"""What a check of a survey finds: how bad it is, where it is, what it is, and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from photogram.wording import html_table, things

Severity = Literal["fault", "warning", "note"]
"""A fault makes the work fail, a warning makes its result doubtful, a note says what to expect."""

WORDS: dict[Severity, str] = {"fault": "error", "warning": "warning", "note": "note"}
"""What the user reads of each."""


@dataclass(frozen=True)
class Finding:
    """One thing found; ``remedy`` is empty where there is nothing to do, or ``text`` says it."""

    severity: Severity
    where: str
    text: str
    remedy: str = ""

    def __str__(self) -> str:
        return ": ".join(part for part in (self.where, self.text, self.remedy) if part)


class Findings(tuple[Finding, ...]):
    """Everything that a check has found, the worst first; a tuple of Finding that prints and shows itself."""

    __slots__ = ()

    @property
    def errors(self) -> Findings:
        """Return what makes the work fail."""
        return self._of("fault")

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
        return "\n".join([f"<Findings, {self._counts()}>", *(f"{WORDS[f.severity]}: {f}" for f in self)])

    def _repr_html_(self) -> str:
        rows = [(WORDS[f.severity], f.where, f.text, f.remedy) for f in self]
        return html_table(self._counts(), ("", "where", "what was found", "what to do"), rows)
