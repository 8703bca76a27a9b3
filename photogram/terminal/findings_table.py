"""What the terminal shows of the findings of an input validation."""

from collections import Counter
from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from photogram.project.findings import Finding, Severity
from photogram.wording import printable, things

_COLOUR: dict[Severity, str] = {"error": "red", "warning": "yellow", "note": "dim"}


def findings_table(findings: Sequence[Finding], title: str) -> Table:
    """Return the findings as a table: how bad, where, what, and what to do."""
    table = Table("", "where", "finding", "remedy", title=escape(printable(title)), show_lines=False)
    for finding in findings:
        severity = f"[{_COLOUR[finding.severity]}]{finding.severity}[/]"
        table.add_row(severity, *(escape(printable(text)) for text in (finding.where, finding.text, finding.remedy)))
    return table


def has_errors(findings: Sequence[Finding]) -> bool:
    """Return whether processing cannot succeed."""
    return any(finding.severity == "error" for finding in findings)


def verdict(findings: Sequence[Finding]) -> str:
    """Return in one line whether the project is ready to be processed."""
    counts = Counter(finding.severity for finding in findings)
    numbers = f"{things(counts['error'], 'error')}, {things(counts['warning'], 'warning')}"
    if counts["error"]:
        return f"[bold red]Not ready[/bold red]: {numbers}. Fix the errors first."
    return f"[bold green]Ready[/bold green]: {numbers}."
