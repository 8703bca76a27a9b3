"""Findings of an input validation: severity, place, finding and remedy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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
