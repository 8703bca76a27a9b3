"""photogram check: everything that can be known to be wrong before the long work starts."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import typer
from rich.table import Table

from photogram.cli.adjust import Photographs, ProjectFile
from photogram.cli.app import app
from photogram.cli.terminal import console
from photogram.errors import ProjectError
from photogram.files.photograph_headers import equal_files, read_headers
from photogram.findings import Finding, things
from photogram.pipeline import load_project
from photogram.preflight import by_severity, check_survey, header_findings, project_faults
from photogram.project import photograph_paths

_COLOUR = {"fault": "red", "warning": "yellow", "note": "dim"}


def _free_disk_bytes(folder: Path) -> int:
    """Return the free space of the disk on which ``folder`` is, or will be made."""
    return shutil.disk_usage(next(p for p in (folder, *folder.parents) if p.exists())).free


def _memory_bytes() -> int:
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _findings(path: Path, photographs: Path | None) -> list[Finding]:
    with ThreadPoolExecutor(os.cpu_count()) as executor:
        try:
            project = load_project(path, photographs)
        except ProjectError as fault:
            # Photographs that are missing are among these faults already.
            there = [p for p in photograph_paths(path, photographs) if p.is_file()]
            headers = read_headers(there, executor)
            return by_severity([*project_faults(path, fault), *header_findings(headers, equal_files(there, executor))])
        paths = [p.path for p in project.photographs]
        headers, twins = read_headers(paths, executor), equal_files(paths, executor)
    free_disk_bytes = _free_disk_bytes(project.work.absolute())
    return check_survey(project, headers, twins, free_disk_bytes, _memory_bytes(), os.cpu_count() or 1)


def _verdict(findings: Sequence[Finding]) -> str:
    counts = Counter(finding.severity for finding in findings)
    numbers = f"{things(counts['fault'], 'fault')}, {things(counts['warning'], 'warning')}"
    if counts["fault"]:
        return f"[bold red]Not ready[/bold red]: {numbers}. Mend the faults first."
    return f"[bold green]Ready[/bold green]: {numbers}."


@app.command()
def check(project: ProjectFile, photographs: Photographs = None) -> None:
    """Look for everything that can be known to be wrong before the long work starts, in seconds."""
    findings = _findings(project, photographs)
    table = Table("", "where", "what was found", "what to do", title=f"Check of {project}", show_lines=False)
    for finding in findings:
        severity = f"[{_COLOUR[finding.severity]}]{finding.severity}[/]"
        table.add_row(severity, *map(_plain, (finding.where, finding.text, finding.remedy)))
    console.print(table)
    console.print(_verdict(findings))
    if any(finding.severity == "fault" for finding in findings):
        raise typer.Exit(1)


def _plain(text: str) -> str:
    """Return a text whose brackets Rich takes for brackets."""
    return text.replace("[", r"\[")
