"""What a check of a survey finds: how bad it is, where it is, what it is, and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]
"""An error makes processing fail, a warning makes its result doubtful, a note says what to expect."""


@dataclass(frozen=True)
class Finding:
    """One thing found; ``remedy`` is empty where there is nothing to do, or ``text`` says it."""

    severity: Severity
    where: str
    text: str
    remedy: str = ""

    def __str__(self) -> str:
        return ": ".join(part for part in (self.where, self.text, self.remedy) if part)
